// SPDX-License-Identifier: Apache-2.0
// The command line: results are reproducible, and the output has the requested form.
#include "tools/command_line.h"

#include <gmock/gmock.h>

#include <csignal>
#include <nlohmann/json.hpp>

#include "core/io/files.h"
#include "core/io/jpeg_file.h"
#include "tests/tools/child.h"

namespace fringeslam {
namespace {

using nlohmann::json;
using test::run_program;
using test::run_successfully;
using testing::HasSubstr;

// One ray per pixel keeps the runs short.
const std::vector<std::string> kFast = {"--set", "render.samples_per_pixel=1"};

std::vector<std::string> words(std::vector<std::string> first, const std::vector<std::string>& second) {
  first.insert(first.end(), second.begin(), second.end());
  return first;
}

std::string differing_files(const test::fs::path& a, const test::fs::path& b) {
  std::string text;
  for (const std::string& name : test::listing(a)) {
    if (!test::fs::is_directory(a / name) && test::read_bytes(a / name) != test::read_bytes(b / name))
      text += " " + name;
  }
  return text;
}

void expect_same_folders(const test::fs::path& a, const test::fs::path& b) {
  EXPECT_EQ(test::listing(a), test::listing(b));
  EXPECT_EQ(differing_files(a, b), "");
}

// OpenImageIO's libraries would take most of the time of a start.
TEST(Start, DoesNotLoadLibrariesThatAreRarelyNeeded) {
  if (!FRINGESLAM_SHARED) GTEST_SKIP() << "static libraries link them";
  const test::TempFolder temp;
  const std::string list = (temp / "libraries").string();
  ASSERT_EQ(std::system(("LD_TRACE_LOADED_OBJECTS=1 " + test::quoted(FRINGESLAM_PROGRAM) + " > " + list).c_str()), 0);
  const std::string libraries = test::read_bytes(list);
  EXPECT_THAT(libraries, HasSubstr("libembree3"));
  EXPECT_THAT(libraries, testing::Not(HasSubstr("libOpenImageIO")));
  EXPECT_THAT(libraries, testing::Not(HasSubstr("libopenvdb")));
  EXPECT_THAT(libraries, testing::Not(HasSubstr("libav")));
}

// As in a broken installation: the folder of the library that loads modules lacks that of OpenImageIO.
TEST(Start, ReportsThatTheImageLibraryIsMissing) {
  if (!FRINGESLAM_SHARED) GTEST_SKIP() << "static libraries link it";
  const test::TempFolder temp;
  test::fs::copy_file(FRINGESLAM_TYPES_LIBRARY, temp / "libfringeslam_types.so.0");
  test::write_small_scene(temp / "scene");
  std::string scene = test::read_bytes(temp / "scene/scene.yaml");
  const std::string wood = "{grain: wood, albedo: 0.4, contrast: 0.35, grain_m: 0.012}";
  scene.replace(scene.find(wood), wood.size(), "{texture: wood.jpg}");
  test::write_bytes(temp / "scene/scene.yaml", scene);
  test::write_bytes(temp / "scene/wood.jpg", jpeg_bytes(cv::Mat1b(8, 8, uchar{90}), 90));
  // The address sanitizer, where there is one, is loaded after the library.
  const std::string command = "ASAN_OPTIONS=\"$ASAN_OPTIONS:verify_asan_link_order=0\" LD_PRELOAD=" +
                              test::quoted((temp / "libfringeslam_types.so.0").string()) + " " +
                              test::quoted(FRINGESLAM_PROGRAM) + " render " + test::quoted((temp / "scene").string()) +
                              " --out " + test::quoted((temp / "out").string()) + " > /dev/null 2> " +
                              test::quoted((temp / "err").string());
  EXPECT_EQ(WEXITSTATUS(std::system(command.c_str())), 2);
  const std::string message = test::read_bytes(temp / "err");
  EXPECT_THAT(message, HasSubstr("wood.jpg: cannot be read: OpenImageIO cannot be loaded: "));
  EXPECT_EQ(std::count(message.begin(), message.end(), '\n'), 1) << message;
}

class CommandLine : public testing::Test {
 protected:
  void SetUp() override { test::write_small_scene(scene_); }
  std::string at(const std::string& name) const { return (temp_ / name).string(); }
  void run_scene(const std::string& out, const std::vector<std::string>& more = {}) const {
    run_successfully(words(words({"run", scene_.string(), "--out", at(out), "--quiet"}, kFast), more));
  }

  test::TempFolder temp_;
  test::fs::path scene_ = temp_ / "scene";
};

TEST_F(CommandLine, ThreadsDoNotChangeARun) {
  run_scene("one", {"--threads", "1"});
  run_scene("two", {"--threads", "2"});
  // Both views must be registered, otherwise little of the pipeline is compared.
  EXPECT_EQ(json::parse(test::read_bytes(temp_ / "one/score.json")).at("tracked"), 2);
  expect_same_folders(temp_ / "one", temp_ / "two");
}

TEST_F(CommandLine, ARunOfARenderedDatasetIsARunOfItsScene) {
  run_scene("direct");
  run_successfully(words({"render", scene_.string(), "--out", at("dataset"), "--quiet"}, kFast));
  run_successfully({"run", at("dataset"), "--out", at("replayed"), "--quiet"});
  expect_same_folders(temp_ / "direct", temp_ / "replayed");
}

TEST_F(CommandLine, ARunOfTheFirstViewsIsTheBeginningOfTheWhole) {
  run_scene("whole");
  run_scene("first", {"--views", "1"});
  const json score = json::parse(test::read_bytes(temp_ / "first/score.json"));
  EXPECT_EQ(score.at("frames").size(), 1u);
  // One pose has no trajectory error, which would be the best of all.
  EXPECT_FALSE(score.contains("trajectory"));
  EXPECT_THAT(run_successfully({"score", at("first"), "--align", "se3"}).out, HasSubstr("no motion was estimated"));
  EXPECT_EQ(test::read_bytes(temp_ / "first/frames/000000/depth.exr"),
            test::read_bytes(temp_ / "whole/frames/000000/depth.exr"));
  EXPECT_FALSE(test::fs::exists(temp_ / "first/frames/000001"));
}

TEST_F(CommandLine, ScoringARunAgainGivesItsScore) {
  run_scene("run");
  const std::string written = test::read_bytes(temp_ / "run/score.json");
  EXPECT_EQ(run_successfully({"score", at("run"), "--json"}).out, written);
  EXPECT_EQ(run_successfully({"score", at("run"), "--json"}).out, written);
  EXPECT_EQ(test::read_bytes(temp_ / "run/score.json"), written);
  EXPECT_EQ(run_successfully({"score", at("run")}).out, run_successfully({"score", at("run")}).out);
}

TEST_F(CommandLine, ASecondRunReplacesTheFirst) {
  run_scene("run");
  const std::set<std::string> first = test::listing(temp_.path());
  run_scene("run", {"--save-map"});
  test::write_bytes(temp_ / "run/notes.txt", "precious");
  run_scene("run", {"--map", at("run/saved.map")});
  std::set<std::string> names = test::listing(temp_.path());
  EXPECT_EQ(names.erase("run/saved.map"), 1u) << "the map that a run continued is lost";
  EXPECT_EQ(names.erase("run/notes.txt"), 1u) << "the user's file is lost";
  EXPECT_EQ(names, first);
}

// Maps `loop` into run/, and ends the program after two views. Returns its exit code.
int interrupted_run(const test::TempFolder& temp) {
  const std::string scene = std::string(FRINGESLAM_SOURCE_DIR) + "/scenes/loop";
  const auto at = [&](const char* name) { return test::quoted((temp / name).string()); };
  const std::string command = test::quoted(FRINGESLAM_PROGRAM) + " run " + test::quoted(scene) + " --out " + at("run") +
                              " --set render.samples_per_pixel=1 --save-map > " + at("out") + " 2> " + at("err") +
                              " & pid=$!; until ls " + test::quoted(temp.path().string()) +
                              "/run.partial-*/run/frames/000001/depth.exr > /dev/null 2>&1; do sleep 0.05; done; "
                              "kill -TERM $pid; wait $pid; exit $?";
  return WEXITSTATUS(std::system(command.c_str()));
}

// The views mapped until then may be fewer than those of an earlier result.
TEST_F(CommandLine, AnInterruptedRunKeepsAnEarlierResult) {
  run_scene("run", {"--save-map"});
  const std::string map = test::read_bytes(temp_ / "run/saved.map"), cloud = test::read_bytes(temp_ / "run/map.ply");
  ASSERT_EQ(interrupted_run(temp_), 130) << test::read_bytes(temp_ / "err");
  EXPECT_EQ(test::read_bytes(temp_ / "run/saved.map"), map);
  EXPECT_EQ(test::read_bytes(temp_ / "run/map.ply"), cloud);
  EXPECT_TRUE(test::fs::exists(temp_ / "run.incomplete/saved.map"));
  EXPECT_THAT(test::read_bytes(temp_ / "err"), HasSubstr("the older result in " + at("run") + " is unchanged"));
  EXPECT_THAT(test::read_bytes(temp_ / "out"), HasSubstr("written: " + at("run.incomplete")));
}

// Ends `run` while it maps, and looks at what it leaves.
TEST_F(CommandLine, AnInterruptedRunKeepsItsViews) {
  const std::string out = at("run");
  ASSERT_EQ(interrupted_run(temp_), 130) << test::read_bytes(temp_ / "err");
  for (const auto& entry : test::fs::directory_iterator(temp_.path()))
    EXPECT_THAT(entry.path().filename().string(),
                testing::Not(testing::AnyOf(HasSubstr("partial"), HasSubstr("mapping"))));
  const json frames = json::parse(test::read_bytes(temp_ / "run/frames.json"));
  EXPECT_GE(frames.size(), 2u);
  EXPECT_EQ(json::parse(run_successfully({"map", "info", out, "--verify", "--json"}).out).at("verified"), true);
  for (const char* file : {"trajectory.tum", "landmarks.json", "saved.map", "rig.yaml"})
    EXPECT_TRUE(test::fs::exists(temp_ / "run" / file)) << file;
  for (const char* file : {"map.ply", "mesh.ply", "mesh.glb", "score.json", "overview.png", "report.html"})
    EXPECT_FALSE(test::fs::exists(temp_ / "run" / file)) << file;
  EXPECT_THAT(test::read_bytes(temp_ / "err"),
              HasSubstr("interrupted: " + std::to_string(frames.size()) + " of 121 views are kept, without map.ply, "));
  // Views that were not taken are not lost.
  EXPECT_EQ(json::parse(run_successfully({"score", out, "--json"}).out).at("stacks"), frames.size());
}

// Ctrl-C ends the program that reads the messages as well, and a terminal that is closed sends SIGHUP.
TEST_F(CommandLine, AnInterruptedRunKeepsItsViewsIfNothingReadsItsMessages) {
  const std::string scene = std::string(FRINGESLAM_SOURCE_DIR) + "/scenes/loop",
                    folder = test::quoted(temp_.path().string());
  const std::string command =
      "cd " + folder + " && mkfifo messages && { cat messages > read & } && reader=$! && { " +
      test::quoted(FRINGESLAM_PROGRAM) + " run " + test::quoted(scene) +
      " --out run --set render.samples_per_pixel=1 > messages 2>&1 & } && pid=$! && "
      "while kill -0 $pid && ! ls run.partial-*/run/frames/000001/depth.exr > /dev/null 2>&1; do sleep 0.05; done; "
      "kill $reader; kill -HUP $pid; wait $pid; exit $?";
  const auto before = std::signal(SIGHUP, SIG_DFL);  // tests may be started by nohup
  const int code = WEXITSTATUS(std::system(command.c_str()));
  std::signal(SIGHUP, before);
  EXPECT_TRUE(code == 130 || code == 2) << code;  // 2: its last line cannot be written
  EXPECT_GE(json::parse(test::read_bytes(temp_ / "run/frames.json")).size(), 2u);
}

// Kills `run` at several moments while it maps; the next commands find its map and restore it.
TEST_F(CommandLine, TheMapOfAKilledRunIsRecovered) {
  const std::string scene = std::string(FRINGESLAM_SOURCE_DIR) + "/scenes/loop", out = at("run");
  for (const std::string view : {"000000", "000002"}) {
    const std::string folder = test::quoted(temp_.path().string());
    const std::string command =
        test::quoted(FRINGESLAM_PROGRAM) + " run " + test::quoted(scene) + " --out " + test::quoted(out) +
        " --set render.samples_per_pixel=1 --set mapping.every_view=true --save-map > " + test::quoted(at("out")) +
        " 2>&1 & pid=$!; until ls " + folder + "/run.mapping-*/index " + folder + "/run.partial-*/run/frames/" + view +
        "/depth.exr > /dev/null 2>&1; do sleep 0.02; done; kill -KILL $pid; wait $pid; exit $?";
    ASSERT_EQ(WEXITSTATUS(std::system(command.c_str())), 128 + SIGKILL) << test::read_bytes(temp_ / "out");
    EXPECT_FALSE(test::fs::exists(out));
    for (const std::vector<std::string>& words : std::vector<std::vector<std::string>>{
             {"map", "info", out}, {"run", scene, "--out", at("other"), "--map", out + "/saved.map"}}) {
      const test::Finished refused = run_program(words);
      EXPECT_EQ(refused.exit_code, 2);
      EXPECT_THAT(refused.err, HasSubstr("restore it with `fringeslam map recover " + out + "`"));
    }
    const json restored = json::parse(run_successfully({"map", "recover", out, "--json"}).out);
    EXPECT_GE(restored.at("keyframes"), 1);
    EXPECT_EQ(restored.at("damaged"), 0);
    EXPECT_EQ(test::listing(temp_ / "run.recovered"), (std::set<std::string>{"rig.yaml", "saved.map"}));
    const json info = json::parse(run_successfully({"map", "info", at("run.recovered"), "--verify", "--json"}).out);
    EXPECT_EQ(info.at("keyframes"), restored.at("keyframes"));
    EXPECT_EQ(run_program({"map", "recover", out}).exit_code, 2) << "it was restored before";
    for (const auto& entry : test::fs::directory_iterator(temp_.path()))
      EXPECT_THAT(entry.path().filename().string(), testing::Not(HasSubstr(".mapping-")));
    run_successfully({"run", scene, "--out", at("next"), "--map", at("run.recovered/saved.map"), "--views", "1",
                      "--set", "render.samples_per_pixel=1", "--no-report", "--quiet"});
    EXPECT_EQ(json::parse(test::read_bytes(temp_ / "next/frames.json"))[0].at("tracking"), "refined");
    test::fs::remove_all(at("run.recovered"));
  }
}

// The complete output must be one JSON value: the parser refuses anything before or after it.
json whole_json(const test::Finished& finished) {
  EXPECT_EQ(finished.err, "");
  const json document = json::parse(finished.out, nullptr, false);
  EXPECT_FALSE(document.is_discarded()) << finished.out;
  return document;
}

TEST_F(CommandLine, JsonIsOneDocument) {
  const json rendered =
      whole_json(run_successfully(words({"render", scene_.string(), "--out", at("data"), "--json"}, kFast)));
  EXPECT_EQ(rendered.at("stacks"), 2);
  const json run = whole_json(run_successfully({"run", at("data"), "--out", at("run"), "--json"}));
  EXPECT_EQ(run.at("run"), at("run"));
  EXPECT_EQ(run.at("score"), json::parse(test::read_bytes(temp_ / "run/score.json")));
  EXPECT_EQ(whole_json(run_successfully({"score", at("run"), "--json"})), run.at("score"));
  EXPECT_EQ(whole_json(run_successfully({"score", at("run/trajectory.tum"), "--truth", at("run/truth.tum"), "--json"})),
            run.at("score").at("trajectory"));
  for (const std::string what : {"scene", "data", "run", "run/rig.yaml"})
    EXPECT_EQ(whole_json(run_successfully({"info", at(what), "--json"})).at("camera_px"), json({266, 250})) << what;
  const json mesh = whole_json(run_successfully({"info", at("run/mesh.ply"), "--json"}));
  EXPECT_EQ(mesh.at("kind"), "mesh");
  EXPECT_GT(mesh.at("triangles"), 1000);
  EXPECT_GT(mesh.at("to_m")[2], mesh.at("from_m")[2]);
}

TEST_F(CommandLine, JsonHoldsAnyFolderName) {
  const std::string out = at("a \"quoted\\ name");
  const json rendered = whole_json(run_successfully(words({"render", scene_.string(), "--out", out, "--json"}, kFast)));
  if (!rendered.is_discarded()) {
    EXPECT_EQ(rendered.at("dataset"), out);
  }
}

// A scene's name is free text; it is written to config.yaml and dataset.yaml and used for the run folder's name.
TEST_F(CommandLine, AnySceneNameCanBeRun) {
  test::write_bytes(scene_ / "scene.yaml",
                    test::replaced(test::kSmallScene, "name: small", "name: \"boxes: and foam #2\""));
  run_scene("run");
  ASSERT_TRUE(test::fs::exists(temp_ / "run/score.json"));
  EXPECT_EQ(json::parse(test::read_bytes(temp_ / "run/score.json")).at("name"), "boxes: and foam #2");
}

// Options as those of the verbs.
struct Parsed {
  std::string out = "default", rig;
  std::vector<std::string> sets;
  std::vector<double> periods_px;
  int views = 1;
  uint64_t seed = 1;
  std::optional<int> steps, port;
  std::optional<uint64_t> other_seed;
  std::optional<int> exit_code;  // empty: parsed
  std::string error;
};

Parsed parsed(std::vector<std::string> arguments) {
  tools::CommandLine line("program", "help", "version");
  const tools::Command verb = line.root().add_subcommand("run", "help");
  Parsed result;
  verb.add_option("--out", result.out, "");
  verb.add_option("--rig", result.rig, "").check_existing_file();
  verb.add_option("--set", result.sets, "");
  verb.add_option("--periods", result.periods_px, "").delimiter(',').check_range(2.0, 1e5);
  verb.add_option("--views", result.views, "").check_range(1, 1'000'000);
  verb.add_option("--seed", result.seed, "");
  verb.add_option("--steps", result.steps, "");
  verb.add_option("--other-seed", result.other_seed, "").check_non_negative();
  verb.add_option("--live", result.port, "").expected(0, 1).default_str("8080").check_range(0, 65535);
  arguments.insert(arguments.begin(), {"program", "run"});
  std::vector<char*> words;
  for (std::string& argument : arguments) words.push_back(argument.data());
  testing::internal::CaptureStderr();
  result.exit_code = line.parse(static_cast<int>(words.size()), words.data());
  result.error = testing::internal::GetCapturedStderr();
  return result;
}

// An empty value is mostly that of a script's unset variable.
TEST(CommandLineValues, AreNotEmpty) {
  for (const std::string name : {"--out", "--rig", "--set", "--live"}) {
    for (const std::vector<std::string>& words :
         {std::vector{name, std::string()}, {name + "=", "next"}, {name + "="}}) {
      const Parsed refused = parsed(words);
      EXPECT_EQ(refused.exit_code, 2) << name;
      EXPECT_THAT(refused.error, testing::StartsWith("program: " + name + ": is empty; ")) << words.size();
    }
  }
  for (const std::string name : {"--periods", "--views", "--seed", "--steps", "--other-seed"})
    EXPECT_EQ(parsed({name, ""}).exit_code, 2) << name;
  EXPECT_EQ(parsed({"--live"}).port, 8080);
  EXPECT_EQ(parsed({"--set", "a=", "--out=b"}).sets, std::vector<std::string>{"a="});
  for (const std::vector<std::string>& words :
       std::vector<std::vector<std::string>>{{"run", "data", "--map", ""},
                                             {"run", ""},
                                             {"score", "a.ply", "--truth", "b", "--trajectory", ""},
                                             {"landmarks", "data", "--out", ""},
                                             {"evaluate", "smoke", "--with", "x {dataset} {out}", "--out", ""}}) {
    const test::Finished refused = run_program(words);
    EXPECT_EQ(refused.exit_code, 2) << words[0];
    EXPECT_THAT(refused.err, HasSubstr(": is empty; give it a value or leave it out")) << words[0];
  }
}

TEST(CommandLineValues, AreDecimalNumbers) {
  const Parsed zeros =
      parsed({"--views", "010", "--seed", "08", "--steps", "007", "--other-seed", "0019", "--live", "090"});
  EXPECT_EQ(zeros.exit_code, std::nullopt) << zeros.error;
  EXPECT_EQ(zeros.views, 10);
  EXPECT_EQ(zeros.seed, 8u);
  EXPECT_EQ(zeros.steps, 7);
  EXPECT_EQ(zeros.other_seed, 19u);
  EXPECT_EQ(zeros.port, 90);
  EXPECT_EQ(parsed({"--seed", "18446744073709551615"}).seed, UINT64_MAX);
  for (const std::string text : {"0x10", "1e1", " 1", "1.0", "0b1", "18446744073709551616", "ten"}) {
    for (const std::string name : {"--views", "--seed", "--steps", "--other-seed", "--live"}) {
      const Parsed refused = parsed({name, text});
      EXPECT_EQ(refused.exit_code, 2) << name << " " << text;
      EXPECT_THAT(refused.error, HasSubstr(name + ": '" + text + "' is not a whole number from "));
    }
  }
  for (const std::string name : {"--views", "--seed", "--other-seed", "--live"})
    EXPECT_EQ(parsed({name, "-1"}).exit_code, 2) << name;
  EXPECT_EQ(parsed({"--steps", "-010"}).steps, -10);
}

TEST(CommandLineHelp, OfEachVerbIsPrintedWithoutFailure) {
  for (const std::string verb : {"run", "render", "score", "info", "patterns", "import"}) {
    const test::Finished finished = run_program({verb, "--help"});
    EXPECT_EQ(finished.exit_code, 0) << verb;
    EXPECT_EQ(finished.err, "") << verb;
    EXPECT_THAT(finished.out, HasSubstr(verb));
  }
  EXPECT_THAT(run_program({"run", "--help"}).out, HasSubstr("decode.min_modulation_dn"));
  const test::Finished all = run_program({"--help"});
  EXPECT_EQ(all.exit_code, 0);
  for (const std::string verb : {"run", "render", "score", "info", "patterns", "import"})
    EXPECT_THAT(all.out, HasSubstr(verb));
  EXPECT_EQ(run_program({"--version"}).exit_code, 0);
}

TEST(CommandLineScene, AreListedAndChecked) {
  const test::TempFolder temp;
  test::write_small_scene(temp / "scenes/small");
  const auto list = test::run_program({"scene", "list", "--in", (temp / "scenes").string()});
  EXPECT_EQ(list.exit_code, 0);
  EXPECT_THAT(list.out, testing::HasSubstr("Two views of a few boxes"));
  const auto check = test::run_program({"--json", "scene", "check", (temp / "scenes/small").string()});
  ASSERT_EQ(check.exit_code, 0) << check.err;
  const auto printed = json::parse(check.out);
  EXPECT_EQ(printed.at("views").size(), 2u);
  EXPECT_GT(printed.at("views")[1].at("overlap"), 0.5);
  EXPECT_TRUE(printed.at("warnings").empty());
  for (const std::string& what : {std::string("list"), std::string("check")}) {
    const auto refused = test::run_program({"scene", what, what == "list" ? "--in" : (temp / "none").string(),
                                            what == "list" ? (temp / "none").string() : "--quiet"});
    EXPECT_EQ(refused.exit_code, 2) << what;
    EXPECT_THAT(refused.err, testing::HasSubstr((temp / "none").string() + ": "));
  }
}

// All errors of a scene file are reported in one pass, each with its line.
TEST(CommandLineScene, AllErrorsAreFoundAtOnce) {
  const test::TempFolder temp;
  test::write_small_scene(temp / "scene");
  std::string text = test::read_bytes(temp / "scene/scene.yaml");
  text.insert(text.find("ambient_lux"), "bounce: 3\n  ");
  text.insert(text.find("ambient_lux: ") + 13, "-");
  text += "dust: {}\nwhatever: 1\n";
  test::write_bytes(temp / "scene/scene.yaml", text);
  const auto refused = run_program({"scene", "check", (temp / "scene").string()});
  EXPECT_EQ(refused.exit_code, 2);
  for (const std::string what : {"'ambient_lux' is -", "unknown key 'bounce'; did you mean 'bounces'?",
                                 "'cover' is missing", "unknown key 'whatever'"})
    EXPECT_THAT(refused.err, HasSubstr(what));
  EXPECT_EQ(std::count(refused.err.begin(), refused.err.end(), '\n'), 4) << refused.err;
  EXPECT_EQ(run_program({"run", (temp / "scene").string(), "--out", (temp / "run").string()}).exit_code, 2);
}

// A new scene equals its template except for the name, in any folder; existing folders are not overwritten.
TEST(CommandLineScene, AreMadeFromOthers) {
  const test::TempFolder temp;
  test::write_small_scene(temp / "scenes/small");
  test::fs::create_directory(temp / "scenes/rigs");
  test::fs::rename(temp / "scenes/small/rig.yaml", temp / "scenes/rigs/rig.yaml");
  std::string text = test::read_bytes(temp / "scenes/small/scene.yaml");
  text.replace(text.find("rig.yaml"), 8, "../rigs/rig.yaml");
  test::write_bytes(temp / "scenes/small/scene.yaml", text);
  const auto made = run_program({"scene", "new", "mine", "--from", "small", "--in", (temp / "scenes").string()});
  ASSERT_EQ(made.exit_code, 0) << made.err;
  const std::string elsewhere = (temp / "a/b/own").string();
  ASSERT_EQ(run_program({"scene", "new", elsewhere, "--from", (temp / "scenes/small").string()}).exit_code, 0);
  for (const std::string& folder : {(temp / "scenes/mine").string(), elsewhere}) {
    const json checked = whole_json(run_successfully({"--json", "scene", "check", folder}));
    EXPECT_EQ(checked.at("scene"), test::fs::path(folder).filename().string());
  }
  const auto again = run_program({"scene", "new", elsewhere, "--from", (temp / "scenes/small").string()});
  EXPECT_EQ(again.exit_code, 2);
  EXPECT_THAT(again.err, HasSubstr("own: exists"));
  EXPECT_EQ(run_program({"scene", "new", (temp / "x").string(), "--from", (temp / "none").string()}).exit_code, 2);
}

// A mesh brings its materials and textures, from wherever they are found.
TEST(CommandLineScene, AreMadeFromAMesh) {
  const test::TempFolder temp;
  constexpr const char* kTetrahedron =
      "v 0 0 0\nv 0.3 0 0\nv 0 0.3 0\nv 0 0 0.3\nvt 0 0\nvt 1 0\nvt 0 1\n"
      "usemtl m\nf 1/1 3/2 2/3\nf 1/1 2/2 4/3\nf 1/1 4/2 3/3\nf 2/1 3/2 4/3\n";
  const auto made_from = [&](const std::string& mesh, const std::string& name) {
    return run_program({"scene", "new", (temp / name).string(), "--mesh", (temp / mesh).string(), "--quiet"});
  };
  test::write_bytes(temp / "kit/meshes/part.obj", std::string("mtllib m/part.mtl\n") + kTetrahedron);
  test::write_bytes(temp / "kit/meshes/m/part.mtl", "newmtl m\nmap_Kd ../../images/paint.png\n");
  test::fs::create_directories(temp / "kit/materials/textures");
  write_png(temp / "kit/materials/textures/paint.png", cv::Mat1b(4, 4, uchar{128}));
  ASSERT_EQ(made_from("kit/meshes/part.obj", "scene").exit_code, 0);
  test::fs::remove_all(temp / "kit");
  EXPECT_TRUE(test::fs::exists(temp / "scene/m/part.mtl"));
  EXPECT_TRUE(test::fs::exists(temp / "scene/paint.png"));
  run_successfully({"scene", "check", (temp / "scene").string(), "--quiet"});

  // Other files of the user stay where they are.
  test::write_bytes(temp / "kit/meshes/part.obj", std::string("mtllib ../part.mtl\n") + kTetrahedron);
  test::write_bytes(temp / "kit/part.mtl", "newmtl m\nKd 0.9 0.9 0.9\n");
  const test::Finished refused = made_from("kit/meshes/part.obj", "none");
  EXPECT_EQ(refused.exit_code, 2);
  EXPECT_THAT(refused.err,
              HasSubstr("part.obj: refers to " + (temp / "kit/part.mtl").string() + ", which is not copied"));
  EXPECT_FALSE(test::fs::exists(temp / "none"));

  // Textures that do not exist, and files whose names the scene needs.
  test::write_bytes(temp / "kit/meshes/part.obj", std::string("mtllib m.mtl\n") + kTetrahedron);
  for (const auto& [material, says] :
       {std::pair("newmtl m\nmap_Kd gone.png\n", "gone.png, which does not exist; put it"),
        std::pair("newmtl m\nmap_Kd rig.yaml\n", "the name of another file of the scene")}) {
    test::write_bytes(temp / "kit/meshes/m.mtl", material);
    test::write_bytes(temp / "kit/meshes/rig.yaml", "no image");
    const test::Finished failed = made_from("kit/meshes/part.obj", "none");
    EXPECT_EQ(failed.exit_code, 2);
    EXPECT_THAT(failed.err, HasSubstr(says));
    EXPECT_EQ(std::count(failed.err.begin(), failed.err.end(), '\n'), 1) << failed.err;
    EXPECT_FALSE(test::fs::exists(temp / "none"));
  }
}

// Their name is a text like any other, and the scene file may have lines of any length.
TEST(CommandLineScene, AreMadeWithAnyName) {
  const test::TempFolder temp;
  test::write_small_scene(temp / "small");
  const std::string line(50000, 'x');
  const std::string text = test::replaced(test::kSmallScene, "description: Two",
                                          "# name: none " + line + "\ndescription: \"" + line + "\" #");
  test::write_bytes(temp / "small/scene.yaml", text);
  for (const std::string name : {"a$1b$&c", "it's: #1 \"{", "plain"}) {
    run_successfully({"scene", "new", name, "--from", (temp / "small").string(), "--in", temp.path().string()});
    EXPECT_EQ(whole_json(run_successfully({"--json", "info", (temp / name).string()})).at("name"), name);
  }
  EXPECT_EQ(test::read_bytes(temp / "plain/scene.yaml"), test::replaced(text, "name: small", "name: \"plain\""));
  // A name may also come from an included file.
  test::write_bytes(temp / "other/scene.yaml", "include: ../plain/scene.yaml\n");
  run_successfully({"scene", "new", (temp / "mine/").string(), "--from", (temp / "other").string()});
  EXPECT_EQ(whole_json(run_successfully({"--json", "info", (temp / "mine").string()})).at("name"), "mine");
  test::write_bytes(temp / "other/scene.yaml", "include: ../plain/scene.yaml\nname: |\n  two\n  lines\n");
  const auto refused = run_program({"scene", "new", (temp / "none").string(), "--from", (temp / "other").string()});
  EXPECT_EQ(refused.exit_code, 2);
  EXPECT_THAT(refused.err, HasSubstr("other/scene.yaml:2: this value cannot be replaced"));
}

// In all included files that are copied, also where other files lie in the same place seen from the new folder.
TEST(CommandLineScene, MeanTheFilesOfTheirTemplate) {
  const test::TempFolder temp;
  test::write_small_scene(temp / "small");
  test::fs::create_directory(temp / "lib");
  test::fs::rename(temp / "small/rig.yaml", temp / "lib/rig.yaml");
  write_png(temp / "lib/a texture.png", cv::Mat1b(4, 4, uchar{128}));
  for (const char* decoy : {"deep/lib/rig.yaml", "deep/lib/a texture.png", "deep/small/stage.yaml"})
    test::write_bytes(temp / decoy, "of another scene");
  test::write_bytes(temp / "small/parts/materials.yaml",
                    "materials:\n  # As ../../lib/rig.yaml\n  cardboard: {texture: '../../lib/a texture.png'}\n");
  test::write_bytes(temp / "small/stage.yaml", "include: parts/materials.yaml\nrig: {file: ./../lib/rig.yaml}\n");
  std::string text = test::replaced(test::kSmallScene, "rig:\n  file: rig.yaml\n", "include: [../small/stage.yaml]\n");
  text = test::replaced(text, "  cardboard: {grain: cardboard, albedo: 0.55, contrast: 0.35, grain_m: 0.01}\n", "");
  test::write_bytes(temp / "small/scene.yaml", text);
  const std::string folder = (temp / "deep/er/").string();
  run_successfully({"scene", "new", folder, "--from", (temp / "small").string()});
  EXPECT_EQ(test::read_bytes(temp / "deep/er/parts/materials.yaml"),
            "materials:\n  # As ../../lib/rig.yaml\n  cardboard: {texture: \"../../../lib/a texture.png\"}\n");
  EXPECT_EQ(test::read_bytes(temp / "deep/er/stage.yaml"),
            "include: parts/materials.yaml\nrig: {file: \"../../lib/rig.yaml\"}\n");
  EXPECT_THAT(test::read_bytes(temp / "deep/er/scene.yaml"), HasSubstr("include: [\"stage.yaml\"]\n"));
  EXPECT_EQ(whole_json(run_successfully({"--json", "info", folder})).at("name"), "er");
}

// Generated scenes are the template drawn with their seeds; they no longer need the template.
TEST(CommandLineScene, AreGenerated) {
  const test::TempFolder temp;
  test::write_small_scene(temp / "small");
  std::string text = test::read_bytes(temp / "small/scene.yaml");
  text.replace(text.find("seed: "), 7, "dust: {cover: {uniform: [0.1, 0.9]}}");
  test::write_bytes(temp / "small/scene.yaml", text);
  const std::string out = (temp / "many").string();
  run_successfully(
      {"scene", "generate", (temp / "small").string(), "--count", "3", "--seed", "5", "--out", out, "--quiet"});
  for (const std::string seed : {"5", "6", "7"}) {
    const std::string one = out + "/00000" + seed;
    EXPECT_EQ(test::read_bytes(one + "/scene.yaml").find("uniform"), std::string::npos);
    run_successfully({"scene", "preview", one, "--size", "360", "--out", (temp / "one.png").string(), "--quiet"});
    run_successfully({"scene", "preview", (temp / "small").string(), "--seed", seed, "--size", "360", "--out",
                      (temp / "other.png").string(), "--quiet"});
    EXPECT_EQ(test::read_bytes(temp / "one.png"), test::read_bytes(temp / "other.png")) << seed;
  }
}

TEST_F(CommandLine, MapsOfTwoRunsAreMerged) {
  for (const char* name : {"one", "two"}) run_scene(name, {"--set", "mapping.every_view=true", "--save-map"});
  const json merged = json::parse(
      run_successfully({"map", "merge", at("one"), at("two/saved.map"), "--out", at("both"), "--json"}).out);
  EXPECT_EQ(merged.at("keyframes"), 4);
  // The runs are the same, so the worlds are, too.
  for (size_t row = 0; row < 4; ++row) {
    for (size_t col = 0; col < 4; ++col)
      EXPECT_NEAR(merged.at("a_from_b").at(row).at(col).get<double>(), row == col, 1e-4);
  }
  EXPECT_EQ(test::listing(temp_ / "both"),
            (std::set<std::string>{".fringeslam", "map.ply", "merge.json", "rig.yaml", "saved.map"}));
  run_scene("third", {"--map", at("both/saved.map")});
  EXPECT_EQ(json::parse(test::read_bytes(temp_ / "third/score.json")).at("tracked"), 2);
}

TEST_F(CommandLine, MapsThatCannotBeMergedLeaveNothingBehind) {
  run_scene("one", {"--save-map"});
  run_scene("without");
  for (const std::string& other : {at("without"), at("one/rig.yaml"), at("one")}) {
    const test::Finished finished = run_program({"map", "merge", at("one"), other, "--out", at("both")});
    EXPECT_EQ(finished.exit_code, 2) << other;
    EXPECT_THAT(finished.err, HasSubstr(other));
    EXPECT_FALSE(test::fs::exists(temp_ / "both"));
  }
}

TEST_F(CommandLine, ScenesArePictured) {
  const std::string out = at("preview.png");
  run_successfully({"scene", "preview", scene_.string(), "--out", out, "--size", "420x280", "--quiet"});
  const std::string first = test::read_bytes(out);
  run_successfully({"scene", "preview", scene_.string(), "--out", out, "--size", "420", "--quiet", "--threads", "1"});
  EXPECT_TRUE(test::read_bytes(out) == first) << "a width alone implies a height of two thirds of it";
  run_successfully({"scene", "preview", scene_.string(), "--out", out, "--size", "420", "--seed", "8", "--quiet"});
  EXPECT_FALSE(test::read_bytes(out) == first);
  EXPECT_EQ(whole_json(run_successfully({"--json", "scene", "preview", scene_.string(), "--out", out})).at("written"),
            out);
  for (const std::string size : {"12", "420x", "420x280x", "axb", "99999", "420x-3"}) {
    const auto refused = run_program({"scene", "preview", scene_.string(), "--out", at("none.png"), "--size", size});
    EXPECT_EQ(refused.exit_code, 2) << size;
    EXPECT_THAT(refused.err, HasSubstr("--size " + size + ": must be WxH or a width"));
  }
  const auto refused = run_program({"scene", "preview", scene_.string(), "--out", at("none/preview.png")});
  EXPECT_EQ(refused.exit_code, 2);
  EXPECT_THAT(refused.err, HasSubstr(at("none/preview.png") + ": cannot be written"));
  EXPECT_THAT(test::listing(temp_.path()), testing::Not(testing::Contains(HasSubstr("none"))));
}

TEST_F(CommandLine, ScenesAreExported) {
  for (const std::string name : {"a.glb", "a.gltf", "a.ply", "a.obj"}) {
    const json written =
        whole_json(run_successfully({"--json", "scene", "export", scene_.string(), "--out", at(name)}));
    EXPECT_EQ(written.at("written"), at(name));
    EXPECT_GT(written.at("objects"), 2);
    EXPECT_TRUE(test::fs::exists(at(name)));
  }
  const auto refused = [&](const std::vector<std::string>& more, const std::string& why) {
    const auto finished = run_program(words({"scene", "export", scene_.string()}, more));
    EXPECT_EQ(finished.exit_code, 2) << why;
    EXPECT_THAT(finished.err, HasSubstr(why));
  };
  refused({"--out", at("b.stl")}, at("b.stl") + ": unsupported mesh format");
  refused({"--out", at("b.ply"), "--format", "gltf"}, at("b.ply") + ": does not match the format gltf");
  refused({"--out", at("b.stl"), "--format", "stl"}, "--format");
  refused({"--out", at("none/b.glb")}, at("none/b.glb") + ": cannot be written");
  EXPECT_FALSE(test::fs::exists(temp_ / "b.ply"));
}

// docs/reference/settings.md is the output of `fringeslam settings`.
TEST_F(CommandLine, TheSettingsReferenceIsUpToDate) {
  const test::Finished finished = test::run_program({"settings"});
  EXPECT_EQ(finished.exit_code, 0);
  EXPECT_EQ(finished.out, test::read_bytes(std::string(FRINGESLAM_SOURCE_DIR) + "/docs/reference/settings.md"))
      << "run `fringeslam settings > docs/reference/settings.md`";
  const json settings = whole_json(run_successfully({"--json", "settings"}));
  EXPECT_EQ(settings.at("decode").at("steps").at("default"), 0);
  EXPECT_EQ(settings.at("decode").at("unwrapping").at("permitted").at(0), "auto");
}

}  // namespace
}  // namespace fringeslam
