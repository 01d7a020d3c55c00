// SPDX-License-Identifier: Apache-2.0
// ROS bags: what is written is read back exactly, broken bags are errors of one line, truth is not in evaluated bags.
#include <gmock/gmock.h>
#include <sys/resource.h>

#include <algorithm>
#include <cmath>
#include <csignal>
#include <fstream>
#include <nlohmann/json.hpp>

#include "core/io/files.h"
#include "core/io/tum_file.h"
#include "core/patterns/design.h"
#include "tests/tools/child.h"
#include "tools/bag/bag_dataset.h"
#include "tools/bag/bag_stream.h"

namespace fringeslam {
namespace {

using test::message_of;
using test::run_program;
using test::run_successfully;
using testing::HasSubstr;
using testing::Not;
using testing::StartsWith;
using namespace tools;

constexpr BagTime kSecond = 1000000000;

class Bags : public testing::Test {
 protected:
  void SetUp() override {
    if (!has_bags()) GTEST_SKIP() << "built without librosbag-storage; tools/setup --test installs it";
  }
  std::string at(const std::string& name) const { return (temp_ / name).string(); }

  // Writes a bag of stacks of the tiny rig.
  void record(const std::string& name, const std::vector<FringeStack>& stacks,
              const RigModel& rig = test::tiny_rig()) const {
    DatasetInfo info;
    info.name = "noise: \"quoted\"";
    info.seed = 18446744073709551615u;
    BagRecorder recorder(temp_ / name, rig, test::short_sequence(), info, "");
    for (const FringeStack& stack : stacks) recorder.add(stack);
    recorder.finish({});
  }
  std::vector<BagMessage> messages(const std::string& name, const std::string& topic) const {
    BagStream stream(temp_ / name, {topic});
    std::vector<BagMessage> all;
    while (auto message = stream.next()) all.push_back(std::move(*message));
    return all;
  }
  std::set<std::string> topics(const std::string& name) const {
    std::set<std::string> names;
    const BagStream stream(temp_ / name, {});
    for (const BagTopic& topic : stream.topics()) names.insert(topic.name);
    return names;
  }

  // Writes stacks until the file has reached the largest size that the process may write, and keeps it, also if there is `room`
  // when the bag is to be finished.
  test::fs::path record_until_full(const std::string& name, bool room = false) const {
    constexpr rlim_t kMost = 2000000;  // several chunks
    rlimit before{};
    getrlimit(RLIMIT_FSIZE, &before);
    const auto handler = std::signal(SIGXFSZ, SIG_IGN);
    const FringeStack stack = test::noise_stacks(CV_8UC1).front();
    BagRecorder recorder(temp_ / name, test::tiny_rig(), test::short_sequence(), {}, "");
    const rlimit small{kMost, before.rlim_max};
    setrlimit(RLIMIT_FSIZE, &small);
    const std::string error = message_of([&] {
      for (int i = 0; i < 100000; ++i) recorder.add(stack);
    });
    if (room) setrlimit(RLIMIT_FSIZE, &before);
    const std::string again = message_of([&] { recorder.finish({}); });
    setrlimit(RLIMIT_FSIZE, &before);
    std::signal(SIGXFSZ, handler);
    EXPECT_THAT(error, HasSubstr("cannot be written"));
    EXPECT_THAT(again, HasSubstr("cannot be written"));
    return recorder.keep_unfinished();
  }

  // Reads a bag of ours to its end and returns the error.
  std::string read_error(const std::string& name) const {
    return message_of([&] {
      BagRig rig(temp_ / name);
      while (rig.capture(rig.sequence())) continue;
    });
  }

  // Runs `import` and expects it to fail with one line and without output. Returns the line.
  std::string import_error(const std::string& name, const std::vector<std::string>& more = {}) const {
    std::vector<std::string> words = {"import", at(name), "--out", at("none"), "--quiet"};
    words.insert(words.end(), more.begin(), more.end());
    const test::Finished finished = run_program(words);
    EXPECT_EQ(finished.exit_code, 2) << name;
    EXPECT_EQ(std::count(finished.err.begin(), finished.err.end(), '\n'), 1) << finished.err;
    for (const auto& entry : test::fs::directory_iterator(temp_.path()))
      EXPECT_THAT(entry.path().filename().string(), Not(StartsWith("none"))) << name;
    return finished.err;
  }

  test::TempFolder temp_;
};

void expect_equal(const FringeStack& a, const FringeStack& b) {
  EXPECT_EQ(a.index, b.index);
  EXPECT_EQ(a.timestamp_s, b.timestamp_s);
  EXPECT_EQ(a.exposure_s, b.exposure_s);
  EXPECT_EQ(a.exposure_time_s, b.exposure_time_s);
  EXPECT_TRUE(a.patterns == b.patterns);
  ASSERT_EQ(a.images.size(), b.images.size());
  for (size_t i = 0; i < a.images.size(); ++i) {
    ASSERT_EQ(a.images[i].type(), b.images[i].type());
    EXPECT_EQ(cv::norm(a.images[i], b.images[i], cv::NORM_INF), 0);
  }
}

TEST_F(Bags, ReplayTheSameImagesAndTimes) {
  for (const int type : {CV_8UC1, CV_16UC1, CV_32FC1}) {
    std::vector<FringeStack> stacks = test::noise_stacks(type);
    for (FringeStack& stack : stacks) std::swap(stack.exposure_time_s[1], stack.exposure_time_s[2]);
    record("noise.bag", stacks);
    BagRig rig(temp_ / "noise.bag");
    EXPECT_EQ(rig.info().name, "noise: \"quoted\"");
    EXPECT_EQ(rig.info().seed, 18446744073709551615u);
    EXPECT_EQ(rig.info().stacks, 2);
    EXPECT_EQ(to_yaml(rig.model()), to_yaml(test::tiny_rig()));
    EXPECT_TRUE(rig.sequence() == test::short_sequence());
    for (const FringeStack& stack : stacks) {
      const auto replayed = rig.capture(rig.sequence());
      ASSERT_TRUE(replayed);
      expect_equal(*replayed, stack);
    }
    EXPECT_FALSE(rig.capture(rig.sequence()));
  }
}

TEST_F(Bags, KeepThermalImages) {
  RigModel model = test::tiny_rig();
  model.thermal.emplace();
  model.thermal->lens = {8, 6, 10, 10, 3.5, 2.5, {}};
  for (const bool recordable : {true, false}) {
    std::vector<FringeStack> stacks = test::noise_stacks(CV_8UC1);
    for (FringeStack& stack : stacks) {
      stack.thermal_c = cv::Mat1f(6, 8);
      for (int i = 0; i < 48; ++i)
        stack.thermal_c(i / 8, i % 8) =
            recordable ? celsius_image(cv::Mat1w(1, 1, uint16_t(29000 + i)), "")(0) : 0.123f * static_cast<float>(i);
    }
    record("thermal.bag", stacks, model);
    EXPECT_EQ(messages("thermal.bag", "/thermal/image_raw").at(0).image.encoding, recordable ? "16UC1" : "32FC1");
    BagRig rig(temp_ / "thermal.bag");
    EXPECT_TRUE(rig.info().has_thermal);
    for (const FringeStack& stack : stacks)
      EXPECT_EQ(cv::norm(rig.capture(rig.sequence())->thermal_c, stack.thermal_c, cv::NORM_INF), 0);
  }
}

TEST(BagClock, ClocksThatDoNotCountFrom1970AreShifted) {
  EXPECT_EQ(clock_offset_s(0), 1e9);
  EXPECT_EQ(clock_offset_s(-0.1), 1e9);
  EXPECT_EQ(clock_offset_s(1e7), 1e9);       // an uptime
  EXPECT_EQ(clock_offset_s(1764100000), 0);  // 2025
  EXPECT_EQ(tools::bag_time(0, 1e9), 1000000000 * kSecond);
  EXPECT_EQ(tools::bag_time(-0.077777777, 1e9), 1000000000 * kSecond - 77777777);
  EXPECT_EQ(tools::bag_time(0.5, 0), kSecond / 2);
  EXPECT_EQ(tools::bag_time(4294967295.5, 0), 4294967295 * kSecond + kSecond / 2);
  for (const auto& [time_s, offset_s] :
       {std::pair(0.0, 0.0), std::pair(-1e9, 1e9), std::pair(4294967296.0, 0.0), std::pair(1e300, 1e9),
        std::pair(-1e300, 1e9), std::pair<double, double>(NAN, 1e9)})
    EXPECT_THAT(message_of([t = time_s, o = offset_s] { tools::bag_time(t, o); }), HasSubstr("cannot be stored"));
}

TEST_F(Bags, StampsAreCaptureTimes) {
  std::vector<FringeStack> stacks = test::noise_stacks(CV_8UC1);
  record("early.bag", stacks);
  for (FringeStack& stack : stacks) {
    stack.timestamp_s += 1.5e9;
    for (double& time : stack.exposure_time_s) time += 1.5e9;
  }
  record("now.bag", stacks);
  const auto early = messages("early.bag", "/camera/image_raw"), now = messages("now.bag", "/camera/image_raw");
  ASSERT_EQ(early.size(), 12u);
  ASSERT_EQ(now.size(), 12u);
  const double first_s = 0.1 + 0.2 - 0.4;
  EXPECT_EQ(early[0].stamp, 1000000000 * kSecond + std::llround(1e9 * first_s));
  for (size_t i = 0; i < 12; ++i) {
    EXPECT_EQ(early[i].recorded, early[i].stamp);
    EXPECT_NEAR(static_cast<double>(now[i].stamp - early[i].stamp - kSecond / 2 * 1000000000), 0,
                240);  // a double's step
  }
}

TEST_F(Bags, ARenderedBagIsTheDataset) {
  test::write_small_scene(temp_ / "scene");
  const std::vector<std::string> render = {"render", at("scene"), "--quiet", "--set", "render.samples_per_pixel=1",
                                           "--out"};
  const auto rendered = [&](const std::string& out, const std::vector<std::string>& more) {
    std::vector<std::string> words = render;
    words.push_back(at(out));
    words.insert(words.end(), more.begin(), more.end());
    run_successfully(words);
  };
  rendered("data", {});
  rendered("a.bag", {"--format", "rosbag", "--distorted"});
  rendered("b.bag", {"--format", "rosbag", "--distorted"});
  EXPECT_EQ(test::read_bytes(temp_ / "a.bag"), test::read_bytes(temp_ / "b.bag"));
  run_successfully({"render", at("data"), "--format", "rosbag", "--distorted", "--quiet", "--out", at("c.bag")});
  EXPECT_EQ(test::read_bytes(temp_ / "a.bag"), test::read_bytes(temp_ / "c.bag"));
  EXPECT_EQ(test::listing(temp_.path()).count("scratch"), 0u);

  run_successfully({"import", at("a.bag"), "--out", at("imported"), "--quiet"});
  for (const std::string& name : test::listing(temp_ / "imported")) {
    if (test::fs::is_directory(temp_ / "imported" / name) || name == "dataset.yaml" || name == ".fringeslam")
      continue;  // the names of the files differ
    EXPECT_EQ(test::read_bytes(temp_ / "imported" / name), test::read_bytes(temp_ / "data" / name)) << name;
  }
  EXPECT_EQ(read_dataset_info(temp_ / "imported").stacks, 2);
  EXPECT_FALSE(test::fs::exists(temp_ / "imported/truth"));
  for (const char* name : {"data", "imported"})
    run_successfully({"run", at(name), "--out", at(std::string("run_") + name), "--quiet", "--no-report"});
  EXPECT_EQ(test::read_bytes(temp_ / "run_data/trajectory.tum"),
            test::read_bytes(temp_ / "run_imported/trajectory.tum"));

  const test::Finished refused = run_program({"render", at("data"), "--out", at("no.bag"), "--format", "rosbag"});
  EXPECT_EQ(refused.exit_code, 2);
  EXPECT_THAT(refused.err, HasSubstr("add --distorted"));
}

TEST_F(Bags, TheTruthIsNotInEvaluatedBags) {
  test::write_small_scene(temp_ / "scene");
  test::write_bytes(temp_ / "suite.yaml", "datasets:\n  - {name: small, scene: scene, seeds: 1}\n");
  const auto evaluated = [&](const std::string& system, const std::string& format) {
    const test::Finished finished = run_successfully({"evaluate", at("suite.yaml"), "--name", format, "--format",
                                                      format, "--out", at("out"), "--json", "--with", system});
    return nlohmann::json::parse(finished.out).at("results").back();
  };
  const auto bag = evaluated(
      "cp {dataset} {out}/../seen.bag; ls -A $(dirname {dataset}) > {out}/../files; "
      "cp $(dirname {dataset})/../truth/groundtruth.txt {out}/trajectory.txt",
      "rosbag");
  EXPECT_LT(bag.at("ate_m").get<double>(), 1e-9);
  EXPECT_EQ(bag.at("poses"), 2);
  EXPECT_EQ(test::read_bytes(temp_ / "out/outputs/rosbag/suite/small-1/files"), "views.bag\n");
  const std::string seen = "out/outputs/rosbag/suite/small-1/seen.bag";
  for (const std::string& topic : topics(seen)) EXPECT_THAT(topic, Not(HasSubstr("truth")));
  EXPECT_EQ(topics(seen).count("/camera/points"), 1u);
  EXPECT_EQ(topics(seen).count("/tf"), 0u);
  // Times of the true trajectory are those of the bag.
  const Trajectory truth = read_tum(temp_ / "out/outputs/rosbag/suite/small-1/out/trajectory.txt");
  const auto depth = messages(seen, "/camera/depth");
  ASSERT_EQ(depth.size(), truth.size());
  for (size_t i = 0; i < truth.size(); ++i) EXPECT_EQ(depth[i].stamp, std::llround(truth[i].timestamp_s * 1e9));
}

TEST_F(Bags, ATrajectoryIsScoredAgainstTheBag) {
  test::write_small_scene(temp_ / "scene");
  for (const auto& [format, out] : {std::pair("rosbag", "a.bag"), std::pair("euroc", "euroc")})
    run_successfully({"render", at("scene"), "--format", format, "--quiet", "--set", "render.samples_per_pixel=1",
                      "--out", at(out)});
  const test::Finished score = run_successfully({"score", at("euroc/mav0/state_groundtruth_estimate0/data.csv"),
                                                 "--truth", at("a.bag"), "--align", "none", "--json"});
  EXPECT_LT(nlohmann::json::parse(score.out).at("ape_m").at("max").get<double>(), 1e-9);
  record("without.bag", test::noise_stacks(CV_8UC1));
  const test::Finished none =
      run_program({"score", at("euroc/mav0/state_groundtruth_estimate0/data.csv"), "--truth", at("without.bag")});
  EXPECT_EQ(none.exit_code, 2);
  EXPECT_THAT(none.err, HasSubstr("has no ground truth"));
}

TEST_F(Bags, NothingIsLeftOfWhatFails) {
  test::write_small_scene(temp_ / "scene");
  test::write_bytes(temp_ / "results/thesis.bag", "precious");
  const std::vector<std::string> render = {"render", at("scene"), "--set", "render.samples_per_pixel=1", "--out"};
  for (const auto& [out, more, says] :
       {std::tuple("results/thesis.bag", std::vector<std::string>{"--format", "rosbag"}, "is not a ROS bag"),
        std::tuple("results", std::vector<std::string>{"--format", "rosbag"}, "is not a ROS bag"),
        std::tuple("results/a.bag", std::vector<std::string>{"--format", "rosbag", "--depth-scale", "1000"},
                   "--depth-scale has no effect"),
        std::tuple("results/b.bag",
                   std::vector<std::string>{"--format", "rosbag", "--set", "decode.unwrapping=predicted"},
                   "predicted")}) {
    std::vector<std::string> words = render;
    words.push_back(at(out));
    words.insert(words.end(), more.begin(), more.end());
    const test::Finished finished = run_program(words);
    EXPECT_EQ(finished.exit_code, 2) << out;
    EXPECT_EQ(std::count(finished.err.begin(), finished.err.end(), '\n'), 1) << finished.err;
    EXPECT_THAT(finished.err, HasSubstr(says));
  }
  // Limits file sizes, which acts like a disk that is full at once, or after 1 MiB.
  for (const int kib : {1, 1024}) {
    const std::string full = "trap '' XFSZ; " + test::limit_file_size(kib, at("counters")) +
                             test::quoted(FRINGESLAM_PROGRAM) + " render " + test::quoted(at("scene")) +
                             " --quiet --set render.samples_per_pixel=1 --format rosbag --out " +
                             test::quoted(at("results/full.bag")) + " 2> " + test::quoted(at("full.txt"));
    const int status = std::system(("bash -c " + test::quoted(full)).c_str());
    EXPECT_EQ(WEXITSTATUS(status), 2) << kib;
    EXPECT_THAT(test::read_bytes(temp_ / "full.txt"), HasSubstr("cannot be written"));
    EXPECT_EQ(test::listing(temp_ / "results"), (std::set<std::string>{"thesis.bag"}));
  }
  EXPECT_EQ(test::read_bytes(temp_ / "results/thesis.bag"), "precious");
}

// --- broken bags ---

// A recording that fills the disk is kept, and ROS repairs it.
TEST_F(Bags, MessagesThatFitOnTheDiskAreKept) {
  const test::fs::path kept = record_until_full("full.bag");
  EXPECT_EQ(kept, temp_ / "full.bag.unfinished");
  EXPECT_FALSE(test::fs::exists(temp_ / "full.bag"));
  EXPECT_EQ(record_until_full("full.bag", true), temp_ / "full.bag.2.unfinished");
  EXPECT_EQ(std::distance(test::fs::directory_iterator(temp_.path()), {}), 2) << "no temporary folder is left";
  if (std::system("command -v rosbag > /dev/null") != 0)
    GTEST_SKIP() << "rosbag is missing; tools/setup --test installs it";
  test::fs::rename(kept, temp_ / "full.bag");
  ASSERT_EQ(std::system(("cd " + temp_.path().string() + " && rosbag reindex full.bag > /dev/null 2>&1").c_str()), 0);
  EXPECT_GT(messages("full.bag", "/camera/image_raw").size(), 30u);
}

TEST_F(Bags, FilesThatAreNoBagsAreErrors) {
  record("good.bag", test::noise_stacks(CV_8UC1));
  const std::string good = test::read_bytes(temp_ / "good.bag");
  std::string noise(20000, ' ');
  cv::RNG random(3);
  for (char& c : noise) c = static_cast<char>(random.uniform(0, 256));
  const std::string start = "#ROSBAG V2.0\n";
  std::string huge_header = good, huge_chunk = good;
  huge_header.replace(start.size(), 4, "\xff\xff\xff\x7f", 4);  // length of the first header
  const size_t chunk = good.find("compression=none");
  ASSERT_NE(chunk, std::string::npos);
  huge_chunk.replace(good.find("size=", chunk) + 9, 4, "\xff\xff\xff\xff", 4);  // length of the first chunk
  for (const auto& [name, bytes] :
       std::vector<std::pair<std::string, std::string>>{{"empty", ""},
                                                        {"text", "hello\n"},
                                                        {"noise", noise},
                                                        {"start", start},
                                                        {"start_and_noise", start + noise},
                                                        {"old", "#ROSRECORD V1.1\n" + noise},
                                                        {"newer", "#ROSBAG V9.9\n" + good.substr(start.size())},
                                                        {"huge_header", huge_header},
                                                        {"huge_chunk", huge_chunk},
                                                        {"half", good.substr(0, good.size() / 2)},
                                                        {"without_end", good.substr(0, good.size() - 100)},
                                                        {"without_index", good.substr(0, 5000)}}) {
    test::write_bytes(temp_ / (name + ".bag"), bytes);
    EXPECT_THAT(read_error(name + ".bag"), StartsWith(at(name + ".bag: "))) << name;
  }
  for (const char* name : {"empty.bag", "huge_chunk.bag", "half.bag"}) EXPECT_THAT(import_error(name), HasSubstr(name));
}

// Any damage is an error or harmless; the program neither crashes nor hangs.
TEST_F(Bags, DamagedBytesAreErrorsOrHarmless) {
  record("good.bag", test::noise_stacks(CV_8UC1));
  const std::string good = test::read_bytes(temp_ / "good.bag");
  cv::RNG random(5);
  int errors = 0;
  for (int trial = 0; trial < 60; ++trial) {
    std::string bytes = good;
    // Most of the bytes are pixels. Records of other kinds are behind the padded header and at the end.
    constexpr int kHeader = 4096, kWindow = 8192;
    ASSERT_GT(good.size(), size_t{kHeader + kWindow});
    for (int k = 0; k < 4; ++k) {
      const int near = random.uniform(0, kWindow);
      const size_t where =
          trial % 2 ? static_cast<size_t>(kHeader + near) : good.size() - 1 - static_cast<size_t>(near);
      bytes[where] = static_cast<char>(random.uniform(0, 256));
    }
    test::write_bytes(temp_ / "damaged.bag", bytes);
    try {
      BagRig rig(temp_ / "damaged.bag");
      while (rig.capture(rig.sequence())) continue;
    } catch (const Error& e) {
      ++errors;
      EXPECT_THAT(e.what(), HasSubstr("damaged.bag"));
    }
  }
  EXPECT_GT(errors, 5);  // the format has no checksums
}

// Bags that the library reads, with contents that make no sense.
TEST_F(Bags, InconsistentContentsAreErrors) {
  const std::vector<FringeStack> stacks = test::noise_stacks(CV_8UC1);
  const std::string info = "format: fringeslam-bag-1\nname: x\nseed: 1\nclock_offset_s: 1e9\n";
  const cv::Mat& first = stacks[0].images[0];
  const auto image = [&] {
    BagImage out;
    out.encoding = "mono8";
    out.width = out.step = static_cast<uint32_t>(first.cols), out.height = static_cast<uint32_t>(first.rows);
    out.bytes.assign(first.total(), 7);
    return out;
  };
  struct Contents {
    std::string info, rig, patterns, stack;
    std::function<void(BagImage&)> change = [](BagImage&) {};
    size_t images = 6;
    BagTime late = 0;
  };
  const Contents good{info, to_yaml(test::tiny_rig()), to_yaml(test::short_sequence()), stack_yaml(stacks[0])};
  const auto write = [&](const Contents& contents) {
    BagWriter bag(temp_ / "odd.bag");
    const BagTime begin = 900000000 * kSecond;
    for (const auto& [topic, text] : {std::pair("dataset", contents.info), std::pair("rig", contents.rig),
                                      std::pair("patterns", contents.patterns), std::pair("stack", contents.stack)}) {
      if (!text.empty()) bag.text({std::string("/fringeslam/") + topic, "", begin}, text);
    }
    for (size_t i = 0; i < contents.images; ++i) {
      BagImage pixels = image();
      contents.change(pixels);
      bag.image({"/camera/image_raw", "camera", tools::bag_time(stacks[0].exposure_time_s[i], 1e9) + contents.late},
                pixels);
    }
    bag.close();
  };
  write(good);
  run_successfully({"import", at("odd.bag"), "--out", at("fine"), "--quiet"});
  const auto with = [&](auto change) {
    Contents contents = good;
    change(contents);
    return contents;
  };
  using C = Contents;
  for (const auto& [contents, says] : std::vector<std::pair<Contents, std::string>>{
           {with([](C& c) { c.info = "format: other\n"; }), "this version reads only that format"},
           {with([](C& c) { c.info += "colour: red\n"; }), "unknown key 'colour'"},
           {with([](C& c) { c.rig = ""; }), "no message on /fringeslam/rig"},
           {with([](C& c) { c.rig = "{[:"; }), "/fringeslam/rig"},
           {with([](C& c) { c.rig = "name: x\n"; }), "/fringeslam/rig"},
           {with([](C& c) { c.patterns = ""; }), "no message on /fringeslam/patterns"},
           {with([](C& c) { c.stack = ""; }), "no message on /fringeslam/stack"},
           {with([](C& c) { c.stack = "timestamp_s: 1\nexposure_s: [1]\n"; }), "/fringeslam/stack, stack 0"},
           {with([](C& c) { c.images = 5; }), "ends after 5 images"},
           {with([](C& c) { c.images = 0; }), "ends after 0 images"},
           {with([](C& c) { c.late = 1000; }), "ends after 6 images"},
           {with([](C& c) { c.change = [](BagImage& i) { i.encoding = "bayer_rggb8"; }; }), "encoding 'bayer_rggb8'"},
           {with([](C& c) { c.change = [](BagImage& i) { i.encoding = "mono16"; }; }), "is not an image of"},
           {with([](C& c) { c.change = [](BagImage& i) { i.bytes.pop_back(); }; }), "is not an image of"},
           {with([](C& c) { c.change = [](BagImage& i) { i.height = 4000000000; }; }), "4000000000 px"},
           {with([](C& c) { c.change = [](BagImage& i) { i.width = i.height = 0; }; }), "0x0 px"},
           {with([](C& c) { c.change = [](BagImage& i) { i.height /= 2, i.bytes.resize(i.step * i.height); }; }),
            "but the camera of /fringeslam/rig has"}}) {
    write(contents);
    EXPECT_THAT(read_error("odd.bag"), testing::AllOf(StartsWith(at("odd.bag: ")), HasSubstr(says)));
  }
  EXPECT_THAT(import_error("odd.bag"), HasSubstr("odd.bag: "));
  {
    BagWriter bag(temp_ / "types.bag");  // the topics have other types
    bag.image({"/fringeslam/dataset", "camera", kSecond}, image());
    bag.text({"/camera/image_raw", "", kSecond}, "image");
    bag.lens({"/fringeslam/rig", "camera", kSecond}, {});
    bag.close();
  }
  EXPECT_THAT(import_error("types.bag"),
              HasSubstr("types.bag: topic /fringeslam/rig contains sensor_msgs/CameraInfo, not images or text"));
}

TEST_F(Bags, TextAndPosesBeyondTheLimitsAreRefused) {
  DatasetInfo info;
  info.name = "long";
  BagRecorder recorder(temp_ / "long.bag", test::tiny_rig(), test::short_sequence(), info, "");
  const std::vector<FringeStack> stacks = test::noise_stacks(CV_8UC1);
  for (const FringeStack& stack : stacks) recorder.add(stack);
  recorder.finish({{1, Pose{}}, {2, Pose{}}, {3, Pose{}}});
  size_t longest = 0, all = 0;
  for (const char* topic : {"dataset", "rig", "patterns", "stack"}) {
    for (const BagMessage& message : messages("long.bag", std::string("/fringeslam/") + topic)) {
      longest = std::max(longest, message.text.size());
      all += message.text.size();
    }
  }
  const BagLimits enough{longest, all, stacks.size(), 3};
  EXPECT_EQ(BagRig(temp_ / "long.bag", enough).info().stacks, 2);
  EXPECT_EQ(true_camera_trajectory(temp_ / "long.bag", enough).size(), 3u);
  const auto refused = [&](const BagLimits& limits, const std::string& says) {
    EXPECT_THAT(message_of([&] { BagRig(temp_ / "long.bag", limits); }),
                testing::AllOf(StartsWith(at("long.bag: /fringeslam/")), HasSubstr(says)));
  };
  refused({longest - 1, all, 2, 3}, " bytes in a message, the limit");
  refused({longest, all - 1, 2, 3}, " bytes of text up to here");
  refused({longest, all, 1, 3}, "more than 1 stacks");
  EXPECT_THAT(message_of([&] {
                true_camera_trajectory(temp_ / "long.bag", {longest, all, 2, 2});
              }),
              HasSubstr("/ground_truth/path: has more than 2 poses"));
}

// --- bags of other programs ---

class ForeignBags : public Bags {
 protected:
  void SetUp() override {
    Bags::SetUp();
    if (IsSkipped()) return;
    for (FringeStack& stack : stacks_) {
      for (double& time : stack.exposure_time_s) time += 1.6e9 + 10 * stack.index;  // one stack after the other
    }
    test::write_bytes(temp_ / "import.yaml", description("{images_per_stack: 6}"));
  }
  static std::string description(const std::string& bag) {
    return "name: foreign\nnear_m: 0.7\nfar_m: 1.4\nprojector: {width_px: 1024, height_px: 768}\nbag: " + bag +
           "\npatterns:\n"
           "  - {files: \"%02d.png\", fringe: {axis: columns, period_px: 1040, steps: 3}}\n"
           "  - {files: \"%02d.png\", first: 3, fringe: {axis: columns, period_px: 131, steps: 3}}\n";
  }
  BagImage bag_image(const cv::Mat& image, const std::string& encoding) const {
    BagImage out;
    out.encoding = encoding;
    out.width = static_cast<uint32_t>(image.cols), out.height = static_cast<uint32_t>(image.rows);
    out.step = static_cast<uint32_t>(image.cols * image.elemSize()) + 3;  // padded rows
    for (int row = 0; row < image.rows; ++row) {
      out.bytes.insert(out.bytes.end(), image.ptr(row), image.ptr(row) + image.cols * image.elemSize());
      out.bytes.insert(out.bytes.end(), 3, 99);
    }
    return out;
  }
  BagTime time(size_t stack, size_t image) const { return tools::bag_time(stacks_[stack].exposure_time_s[image], 0); }
  std::string import_error(const std::string& name, const std::string& bag = "{images_per_stack: 6}") const {
    test::write_bytes(temp_ / "import.yaml", description(bag));
    return Bags::import_error(name, {"--config", at("import.yaml"), "--no-check"});
  }
  // Records the stacks on a topic; `skipped` images are left out from the end.
  void record_on(const std::string& name, const std::vector<std::string>& topics, size_t skipped = 0) const {
    BagWriter bag(temp_ / name);
    for (const std::string& topic : topics) {
      for (size_t i = 0; i < 12 - skipped; ++i)
        bag.image({topic, "optical", time(i / 6, i % 6)}, bag_image(stacks_[i / 6].images[i % 6], "mono8"));
    }
    bag.close();
  }

  std::vector<FringeStack> stacks_ = test::noise_stacks(CV_8UC1);
};

TEST_F(ForeignBags, BecomeDatasetsWithTheirTimes) {
  for (const std::string encoding : {"mono8", "rgb8", "mono16"}) {
    BagWriter bag(temp_ / "foreign.bag");
    for (size_t i = 0; i < 12; ++i) {
      const cv::Mat& grey = stacks_[i / 6].images[i % 6];
      cv::Mat image = grey;
      if (encoding == "rgb8") cv::merge(std::vector<cv::Mat>{grey, grey, grey}, image);
      BagImage message;
      if (encoding == "mono16") {
        grey.convertTo(image, CV_16U, 256, 5);  // the bytes are swapped below: value = 256 grey + 5
        for (auto pixel = image.begin<uint16_t>(); pixel != image.end<uint16_t>(); ++pixel)
          *pixel = static_cast<uint16_t>(*pixel << 8 | *pixel >> 8);
      }
      message = bag_image(image, encoding);
      message.big_endian = encoding == "mono16";
      bag.image({"/cam/image_mono", "optical", time(i / 6, i % 6)}, message);
    }
    bag.text({"/chatter", "", kSecond}, "hello");
    bag.close();
    run_successfully(
        {"import", at("foreign.bag"), "--config", at("import.yaml"), "--out", at("data"), "--quiet", "--no-check"});
    ReplayRig rig(temp_ / "data");
    EXPECT_TRUE(rig.info().imported);
    EXPECT_TRUE(rig.info().image_times);
    for (const FringeStack& stack : stacks_) {
      const auto imported = rig.capture(rig.sequence());
      ASSERT_TRUE(imported);
      for (size_t i = 0; i < 6; ++i) {
        cv::Mat expected = stack.images[i];
        if (encoding == "mono16") stack.images[i].convertTo(expected, CV_16U, 256, 5);
        ASSERT_EQ(imported->images[i].type(), expected.type());
        EXPECT_EQ(cv::norm(imported->images[i], expected, cv::NORM_INF), 0);
        EXPECT_NEAR(imported->exposure_time_s[i], stack.exposure_time_s[i], 3e-7);
      }
    }
    EXPECT_FALSE(rig.capture(rig.sequence()));
    for (const auto& entry : test::fs::directory_iterator(temp_.path()))
      EXPECT_THAT(entry.path().filename().string(), Not(HasSubstr("partial")));
  }
}

TEST_F(ForeignBags, SelectionsThatDoNotFitAreErrors) {
  record_on("one.bag", {"/cam"});
  record_on("two.bag", {"/left", "/right"});
  record_on("short.bag", {"/cam"}, 1);
  EXPECT_THAT(Bags::import_error("one.bag"), HasSubstr("was not written by fringeslam"));
  EXPECT_THAT(import_error("two.bag"), HasSubstr("several topics with images: /left (12), /right (12)"));
  EXPECT_THAT(import_error("two.bag", "{topic: /lef, images_per_stack: 6}"), HasSubstr("no topic /lef"));
  EXPECT_THAT(import_error("short.bag"), HasSubstr("has 11 images"));
  EXPECT_THAT(import_error("one.bag", "{images_per_stack: 6, stacks: 3}"), HasSubstr("are not 3 stacks of 6"));
  EXPECT_THAT(import_error("one.bag", "{images_per_stack: 6, first: 13}"), HasSubstr("has 12 images"));
  EXPECT_THAT(import_error("one.bag", "{images_per_stack: 0}"), HasSubstr("import.yaml:5"));
  EXPECT_THAT(import_error("one.bag", "{image_per_stack: 6}"), HasSubstr("images_per_stack"));
  EXPECT_THAT(import_error("one.bag", "{images_per_stack: 12}"), HasSubstr("no entry uses"));
  run_successfully({"import", at("short.bag"), "--config",
                    [&] {
                      test::write_bytes(temp_ / "import.yaml",
                                        description("{images_per_stack: 6, first: 2, stacks: 1}"));
                      return at("import.yaml");
                    }(),
                    "--out", at("part"), "--quiet", "--no-check"});
  EXPECT_EQ(read_dataset_info(temp_ / "part").stacks, 1);
  BagWriter bag(temp_ / "backwards.bag");
  for (size_t i = 0; i < 6; ++i) bag.image({"/cam", "", 5 * kSecond}, bag_image(stacks_[0].images[i], "mono8"));
  bag.close();
  EXPECT_THAT(import_error("backwards.bag"), HasSubstr("image 1: its stamp is not later"));
  test::write_bytes(temp_ / "folder/import.yaml", description("{images_per_stack: 6}"));
  EXPECT_THAT(Bags::import_error("folder"), HasSubstr("'bag' needs a ROS bag"));
}

// An image lost between two stacks shifts all patterns after it.
TEST_F(ForeignBags, AnImageLostBetweenStacksIsSuspected) {
  constexpr BagTime kInterval = kSecond / 10;
  const auto warnings = [&](size_t lost, BagTime pause) {
    BagWriter bag(temp_ / "lost.bag");
    for (size_t i = 0; i < 18; ++i) {
      const size_t exposure = i < lost ? i : i + 1;
      const BagTime stamp = kSecond + static_cast<BagTime>(exposure) * kInterval + static_cast<BagTime>(i / 6) * pause;
      bag.image({"/cam", "", stamp}, bag_image(stacks_[i / 6 % 2].images[i % 6], "mono8"));
    }
    bag.close();
    const std::string out = at("lost" + std::to_string(lost) + "_" + std::to_string(pause));
    return run_successfully(
               {"import", at("lost.bag"), "--config", at("import.yaml"), "--out", out, "--quiet", "--no-check"})
        .err;
  };
  EXPECT_THAT(warnings(12, 0), HasSubstr("0.2 s pass between image 5 of stack 1 and image 0 of stack 2, but 0.1 s in "
                                         "the median; if images were lost there"));
  EXPECT_THAT(warnings(14, 0), HasSubstr("between image 1 of stack 2 and image 2 of stack 2"));
  EXPECT_THAT(warnings(99, 0), Not(HasSubstr("images were lost")));
  EXPECT_THAT(warnings(99, kSecond), Not(HasSubstr("images were lost")));
}

TEST(WithoutBags, TheProgramNamesThePackage) {
  if (has_bags()) GTEST_SKIP() << "built with librosbag-storage";
  const test::TempFolder temp;
  test::write_small_scene(temp / "scene");
  const test::Finished finished =
      run_program({"render", (temp / "scene").string(), "--out", (temp / "a.bag").string(), "--format", "rosbag"});
  EXPECT_EQ(finished.exit_code, 2);
  EXPECT_THAT(finished.err, HasSubstr("librosbag-storage-dev"));
}

}  // namespace
}  // namespace fringeslam
