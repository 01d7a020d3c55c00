// SPDX-License-Identifier: Apache-2.0
// Hostile and damaged input files, streams and limits: exit code 2, one line with the file, nothing left behind, no hang.
#include <gmock/gmock.h>
#include <sys/stat.h>

#include <algorithm>
#include <cstring>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>

#include "core/io/files.h"
#include "core/io/input_file.h"
#include "core/io/tum_file.h"
#include "tests/tools/child.h"
#include "tools/run_score.h"

namespace fringeslam {
namespace {

using test::Finished;
using test::quoted;
using test::fs::path;
using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

constexpr const char* kPlane = "{shape: plane, size_m: [0.8, 0.8], material: table}";
constexpr const char* kTriangle = "v 0 0 0\nv 0.2 0 0\nv 0 0.2 0\nvt 0 0\nvt 1 0\nvt 0 1\n";

// Runs a shell command in an empty folder; PROGRAM stands for the program. It is given a minute.
Finished run_shell(std::string command) {
  const test::TempFolder temp;
  for (size_t at; (at = command.find("PROGRAM")) != std::string::npos;)
    command.replace(at, 7, "timeout 60 " + quoted(FRINGESLAM_PROGRAM));
  const int status =
      std::system(("cd " + quoted(temp.path().string()) + " && { " + command + " ; } 2> .err < /dev/null").c_str());
  return {WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status), "", test::read_bytes(temp / ".err")};
}

class HostileInput : public testing::Test {
 protected:
  void SetUp() override {
    test::write_small_scene(scene_);
    test::fs::create_directory(temp_ / "results");
  }
  std::string out() const { return (temp_ / "results/out").string(); }

  void expect_one_line(const Finished& finished, const std::vector<std::string>& says) const {
    EXPECT_EQ(finished.exit_code, 2) << finished.err;
    EXPECT_EQ(std::count(finished.err.begin(), finished.err.end(), '\n'), 1) << finished.err;
    EXPECT_THAT(finished.err, AllOf(testing::StartsWith("fringeslam: "), Not(HasSubstr(".partial-"))));
    for (const std::string& part : says) EXPECT_THAT(finished.err, HasSubstr(part));
  }
  void expect_refused(const Finished& finished, const std::vector<std::string>& says) const {
    expect_one_line(finished, says);
    EXPECT_EQ(test::listing(temp_ / "results"), std::set<std::string>{});
  }
  void expect_run_refused(const path& source, const std::vector<std::string>& says) const {
    expect_refused(run_shell("PROGRAM run " + quoted(source.string()) + " --quiet --out " + quoted(out())), says);
  }
  // An error after mapping costs only the files of its phase. Removes the results.
  void expect_mapped_without_score(const Finished& finished, std::vector<std::string> says) const {
    expect_mapped_without_score(finished, std::move(says), out());
  }
  void expect_mapped_without_score(const Finished& finished, std::vector<std::string> says, const path& folder) const {
    says.push_back("the other results are written to " + folder.string() + ", without truth.tum, score.json");
    expect_one_line(finished, says);
    for (const char* file : {"trajectory.tum", "map.ply", "mesh.ply", "overview.png", "frames/000001"})
      EXPECT_TRUE(test::fs::exists(folder / file)) << file;
    for (const char* file : {"score.json", "truth.tum"}) EXPECT_FALSE(test::fs::exists(folder / file)) << file;
    for (const std::string& name : test::listing(temp_ / "results")) EXPECT_TRUE(name.starts_with("out")) << name;
    test::fs::remove_all(folder);
  }
  // The scene with a mesh instead of its plane.
  void expect_mesh_refused(const std::string& mesh, const std::vector<std::string>& says) const {
    use_mesh(mesh);
    expect_run_refused(scene_, says);
  }
  void use_mesh(const std::string& mesh) const {
    test::write_bytes(scene_ / "scene.yaml",
                      test::replaced(test::kSmallScene, kPlane, "{shape: mesh, file: " + mesh + "}"));
  }
  path dataset(int type = CV_8UC1) const {
    test::record(temp_ / "data", test::noise_stacks(type));
    return temp_ / "data";
  }
  // A rendered dataset with ground truth.
  path rendered() const {
    (void)test::run_successfully({"render", scene_.string(), "--out", (temp_ / "rendered").string(), "--quiet", "--set",
                                  "render.samples_per_pixel=1"});
    return temp_ / "rendered";
  }

  test::TempFolder temp_;
  path scene_ = temp_ / "scene";
};

TEST_F(HostileInput, ImagesThatAreNoRegularFiles) {
  const path data = dataset(), image = data / "stacks/000001/03.png";
  test::fs::remove(image);
  ASSERT_EQ(mkfifo(image.c_str(), 0600), 0);
  expect_run_refused(data, {image.string() + ": is not a regular file"});
  test::fs::remove(image);
  test::fs::create_symlink("/dev/zero", image);
  expect_run_refused(data, {image.string() + ": is not a regular file"});
  test::fs::remove(image);
  test::fs::create_directory(image);
  expect_run_refused(data, {image.string() + ": is a folder"});
  test::fs::remove(image);
  test::write_bytes(image, "");
  expect_run_refused(data, {image.string() + ": is empty"});
}

TEST_F(HostileInput, EverythingElseThatIsNoRegularFile) {
  const path data = dataset();
  for (const char* name : {"dataset.yaml", "rig.yaml", "patterns.yaml", "stacks/000000/stack.yaml"}) {
    const std::string good = test::read_bytes(data / name);
    test::fs::remove(data / name);
    test::fs::create_symlink("/dev/zero", data / name);
    expect_run_refused(data, {(data / name).string() + ": is not a regular file"});
    test::fs::remove(data / name);
    test::write_bytes(data / name, good);
  }
  const std::string pipe = (temp_ / "pipe").string();
  ASSERT_EQ(mkfifo(pipe.c_str(), 0600), 0);
  const std::string map = " --map " + quoted(pipe), quiet = " --quiet --out " + quoted(out());
  expect_refused(run_shell("PROGRAM run " + quoted(data.string()) + map + quiet), {pipe + ": is not a regular file"});
  for (const std::string& arguments : {"score " + quoted(pipe) + " --truth " + quoted(pipe), "info " + quoted(pipe)})
    expect_refused(run_shell("PROGRAM " + arguments), {pipe + ": is not a regular file"});
}

TEST_F(HostileInput, ImagesThatTheRigCannotHaveTaken) {
  const path data = dataset(), image = data / "stacks/000001/03.png";
  const cv::Mat1b grey = read_grey(image);
  write_png(image, cv::Mat1w(grey.size(), uint16_t{4000}));
  expect_run_refused(data, {image.string() + ": has a grey value of 4000, which exceeds the 8 bits"});
  test::fs::remove(image);
  const path exr = data / "stacks/000001/03.exr";
  write_exr(exr, {{"Y", cv::Mat1f(grey.size(), std::numeric_limits<float>::quiet_NaN())}});
  expect_run_refused(data, {exr.string() + ": no pixel has a finite value"});
}

TEST_F(HostileInput, MirroredImages) {
  const path data = rendered();
  for (const auto& entry : test::fs::recursive_directory_iterator(data / "stacks")) {
    if (entry.path().extension() != ".png") continue;
    cv::Mat image;
    cv::flip(read_grey(entry.path()), image, 1);
    write_png(entry.path(), image);
  }
  expect_run_refused(data, {data.string() + ": ", "face away from the projector"});
}

TEST_F(HostileInput, ADamagedPngIsOneMessage) {
  const path data = dataset(), image = data / "stacks/000001/03.png";
  std::string bytes = test::read_bytes(image);
  for (const size_t at : {17u, 25u, 60u}) {
    std::string damaged = bytes;
    damaged[at] = static_cast<char>(damaged[at] ^ 0x55);
    test::write_bytes(image, damaged);
    expect_run_refused(data, {image.string() + ": is truncated or damaged"});
  }
}

TEST_F(HostileInput, AnImageThatDeclaresAHugeSize) {
  const path data = rendered(), truth = data / "truth/000001.exr";
  std::string bytes = test::read_bytes(truth);
  for (const char* name : {"dataWindow", "displayWindow"}) {
    // name\0 box2i\0 length, four integers
    const size_t window = bytes.find(std::string(name) + '\0') + std::strlen(name) + 1 + 6 + 4;
    const int32_t limits[4] = {0, 0, 16383, 16383};
    std::memcpy(bytes.data() + window, limits, sizeof limits);
  }
  test::write_bytes(truth, bytes);
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)  // their shadow memory exceeds any limit
  const std::string limit;
#else
  const std::string limit = "ulimit -v 4000000; ";
#endif
  expect_mapped_without_score(
      run_shell(limit + "PROGRAM run " + quoted(data.string()) + " --quiet --no-report --out " + quoted(out())),
      {truth.string() + ": is 16384x16384 but the camera of rig.yaml has 266x250"});
  EXPECT_THAT(test::message_of([&] { (void)read_exr(truth); }), HasSubstr(" MiB of pixels; at most 1024 MiB"));
}

TEST_F(HostileInput, TruthOfAnotherRecording) {
  const path data = rendered(), truth = data / "truth/truth.tum";
  const std::string good = test::read_bytes(truth);
  Trajectory other = read_tum(truth);
  for (TimedPose& pose : other) pose.timestamp_s += 100;
  test::write_bytes(truth, to_tum(other));
  expect_run_refused(data, {truth.string() + ": pose 0 is at 100 s", "is of another recording"});
  test::write_bytes(truth, "0 0 0 0 0 0 0 1\n");
  expect_run_refused(data, {truth.string() + ": has 1 poses, but dataset.yaml lists 2 stacks"});
  test::write_bytes(truth, good);
  const path image = data / "truth/000001.exr";
  const auto run = [&] {
    return run_shell("PROGRAM run " + quoted(data.string()) + " --quiet --out " + quoted(out()));
  };
  const std::string sound = test::read_bytes(image);
  test::truncate_file(image, 0.5);
  expect_mapped_without_score(run(), {image.string() + ": "});
  test::write_bytes(image, "no EXR");
  expect_mapped_without_score(run(), {image.string() + ": "});
  // An older result stays as it is, and the new one appears beside it.
  test::write_bytes(image, sound);
  ASSERT_EQ(run().exit_code, 0);
  const std::string score = test::read_bytes(path(out()) / "score.json");
  test::write_bytes(image, "no EXR");
  expect_mapped_without_score(run(), {image.string() + ": "}, out() + ".incomplete");
  test::write_bytes(out() + ".incomplete", "of somebody else");
  expect_mapped_without_score(run(), {image.string() + ": "}, out() + ".incomplete-2");
  EXPECT_EQ(test::read_bytes(path(out()) / "score.json"), score);
  EXPECT_EQ(test::read_bytes(out() + ".incomplete"), "of somebody else");
}

TEST_F(HostileInput, TexturesThatAreNoImages) {
  test::write_bytes(scene_ / "a.obj", std::string("mtllib a.mtl\n") + kTriangle + "usemtl m\nf 1/1 2/2 3/3\n");
  test::write_bytes(scene_ / "a.mtl", "newmtl m\nmap_Kd /dev/zero\n");
  expect_mesh_refused("a.obj", {"the mesh's texture /dev/zero: is not a regular file"});
  test::write_bytes(scene_ / "a.mtl", "newmtl m\nmap_Kd broken.png\n");
  write_png(scene_ / "broken.png", cv::Mat1b(40, 30, uchar{7}));
  test::truncate_file(scene_ / "broken.png", 0.6);
  expect_mesh_refused("a.obj", {(scene_ / "broken.png").string() + ": is truncated or damaged"});
  test::fs::remove(scene_ / "a.mtl");
  test::fs::create_symlink("/dev/zero", scene_ / "a.mtl");
  expect_mesh_refused("a.obj", {"a.obj: refers to ", "a.mtl: is not a regular file"});
}

TEST_F(HostileInput, MeshesOfAbsurdSize) {
  for (const char* size : {"1e30", "2.7e26", "1e-30", "1e-8", "1e7"}) {
    const std::string x = size;
    test::write_bytes(scene_ / "a.obj", "v 0 0 0\nv " + x + " 0 0\nv 0 " + x + " 0\nf 1 2 3\n");
    use_mesh("a.obj");
    const Finished finished = run_shell("PROGRAM run " + quoted(scene_.string()) + " --quiet --out " + quoted(out()));
    expect_refused(finished, {(scene_ / "a.obj").string() + ": "});
    EXPECT_THAT(finished.err, testing::AnyOf(HasSubstr("unit_m"), HasSubstr("no triangle of nonzero area"))) << size;
  }
  test::write_bytes(scene_ / "a.ply",
                    "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n"
                    "end_header\n0 0 0\n");
  expect_mesh_refused("a.ply", {(scene_ / "a.ply").string() + ": "});
}

// COLLADA declares its up axis whatever the file's extension.
TEST_F(HostileInput, ColladaUnderAnotherNameKeepsItsUpAxis) {
  const std::string collada = R"(<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit meter="1"/><up_axis>Y_UP</up_axis></asset>
<library_geometries><geometry id="g"><mesh>
<source id="p"><float_array id="pa" count="9">0 0 0 1 0 0 0 3 0</float_array>
<technique_common><accessor source="#pa" count="3" stride="3"><param name="X" type="float"/><param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="1"><input semantic="VERTEX" source="#v" offset="0"/><p>0 1 2</p></triangles>
</mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s"><node id="n"><instance_geometry url="#g"/></node></visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#s"/></scene></COLLADA>)";
  for (const std::string name : {"a.dae", "a.xml"}) {
    test::write_bytes(scene_ / name, collada);
    use_mesh(name);
    const Finished finished = run_shell("PROGRAM scene check " + quoted(scene_.string()) + " > .out; cat .out >&2");
    EXPECT_THAT(finished.err, HasSubstr("y up; 1 part, 1 triangles, 1 x 0 x 3 m")) << name;
  }
}

// Where programs on other systems and Gazebo keep textures.
TEST_F(HostileInput, TexturesAreFoundWhereMeshesKeepThem) {
  const std::string mesh = std::string("mtllib a.mtl\n") + kTriangle + "usemtl m\nf 1/1 2/2 3/3\n";
  const path pictures[] = {"model/meshes/sub/wood.png", "model/materials/textures/wood.png",
                           "model/meshes/textures/wood.png"};
  const std::string names[] = {"sub\\wood.png", "wood.png", "C:\\art\\wood.png"};
  for (size_t i = 0; i < 3; ++i) {
    test::fs::remove_all(scene_ / "model");
    test::write_bytes(scene_ / "model/meshes/a.obj", mesh);
    test::write_bytes(scene_ / "model/meshes/a.mtl", "newmtl m\nmap_Kd " + names[i] + "\n");
    test::fs::create_directories((scene_ / pictures[i]).parent_path());
    write_png(scene_ / pictures[i], cv::Mat1b(8, 8, uchar{100}));
    use_mesh("model/meshes/a.obj");
    const Finished finished = run_shell("PROGRAM scene check " + quoted(scene_.string()) + " > .out");
    EXPECT_EQ(finished.exit_code, 0) << names[i] << ": " << finished.err;
  }
}

TEST_F(HostileInput, AFileSizeLimitIsAnError) {
  expect_refused(run_shell(test::limit_file_size(16, (temp_ / "counters").string()) + "PROGRAM render " +
                           quoted(scene_.string()) + " --quiet --out " + quoted(out())),
                 {out(), "cannot be written: File too large"});
}

TEST_F(HostileInput, AnExportThatDoesNotFitOnTheDiskLeavesTheOlderOne) {
  const path results = temp_ / "results";
  const auto content = [&] {
    std::map<std::string, std::string> files;
    for (const std::string& name : test::listing(results)) files[name] = test::read_bytes(results / name);
    return files;
  };
  for (const char* name : {"world.ply", "world.obj", "world.gltf", "world.glb"}) {
    const std::string mesh = (results / name).string();
    test::run_successfully({"scene", "export", scene_.string(), "--out", mesh});
    const auto older = content();
    expect_one_line(run_shell(test::limit_file_size(4, (temp_ / "counters").string()) + "PROGRAM scene export " +
                              quoted(scene_.string()) + " --seed 9 --out " + quoted(mesh)),
                    {(results / "world.").string(), ": cannot be written: File too large"});
    EXPECT_EQ(content(), older) << name;
    test::run_successfully({"scene", "export", scene_.string(), "--seed", "9", "--out", mesh});
    EXPECT_NE(content(), older) << name;
  }
}

TEST_F(HostileInput, StandardOutputThatCannotBeWrittenIsAnError) {
  const std::string info = "PROGRAM info --json " + quoted((scene_ / "rig.yaml").string());
  for (const std::string target : {" > /dev/full", " >&-"}) {
    expect_refused(run_shell(info + target), {"standard output cannot be written: "});
    expect_refused(run_shell("PROGRAM --help" + target), {"standard output cannot be written: "});
  }
  // The number of a closed stream is not reused: what is printed would end up in a file.
  const Finished finished = run_shell("PROGRAM patterns --size 16x16 --periods 20 --out " + quoted(out()) + " >&-");
  EXPECT_EQ(finished.exit_code, 2);
  EXPECT_EQ(test::read_bytes(temp_ / "results/out/patterns.yaml").find("written"), std::string::npos);
}

TEST_F(HostileInput, JsonOfANameThatIsNotUtf8) {
  const std::string name = (temp_ / "results/\xff\xfe out").string();
  const Finished finished =
      test::run_program({"render", scene_.string(), "--out", name, "--json", "--set", "render.samples_per_pixel=1"});
  EXPECT_EQ(finished.exit_code, 0) << finished.err;
  EXPECT_THAT(nlohmann::json::parse(finished.out).at("dataset").get<std::string>(), HasSubstr("\uFFFD\uFFFD out"));
  EXPECT_TRUE(test::fs::exists(name + "/dataset.yaml"));
}

// Nor do names imitate lines of the program.
TEST_F(HostileInput, NamesSendNoCommandsToTheTerminal) {
  const std::string name = "name: \"a\\e]0;pwn\\a\\nfake: line\"";
  const auto expect_plain = [&](const std::vector<std::string>& arguments) {
    const std::string out = test::run_successfully(arguments).out;
    EXPECT_THAT(out, AllOf(HasSubstr("a ]0;pwn  fake: line"), Not(HasSubstr("\x1b")), Not(HasSubstr("\x07"))));
  };
  test::write_bytes(scene_ / "scene.yaml", test::replaced(test::kSmallScene, "name: small", name));
  expect_plain({"info", scene_.string()});
  expect_plain({"scene", "check", scene_.string(), "--quiet"});
  tools::RunScore score;
  score.name = "a\x1b\nb";
  EXPECT_THAT(tools::to_table(score), testing::StartsWith("a  b, seed 0: "));
  const path about = dataset() / "dataset.yaml";
  const std::string text = test::read_bytes(about);
  const size_t begin = text.find("name: ");
  test::write_bytes(about, test::replaced(text, text.substr(begin, text.find('\n', begin) - begin), name));
  expect_plain({"info", (temp_ / "data").string()});
  test::write_bytes(scene_ / "scene.yaml", "description" + name.substr(4));
  expect_plain({"scene", "list", "--in", temp_.path().string()});
}

TEST_F(HostileInput, InvalidNumbers) {
  const std::string run = "PROGRAM run " + quoted(scene_.string()) + " --quiet --out " + quoted(out());
  for (const char* seed : {"-1", "12345678901234567890123", "1e3", "0x10", " 7"}) {
    const Finished finished = run_shell(run + " --seed " + quoted(seed));
    expect_refused(finished, {"--seed: '", "is not a whole number from 0 to 18446744073709551615"});
    EXPECT_LT(finished.err.size(), 160u) << finished.err;
  }
  expect_refused(run_shell(run + " --set depth.near_m=3 --set depth.far_m=1"),
                 {"depth.near_m is 3 but depth.far_m is 1"});
  test::write_bytes(temp_ / "a.tum", "0 0 0 0 0 0 0 1\n1 1e300 0 0 0 0 0 1\n");
  test::write_bytes(temp_ / "b.csv", "0,0,0,0,1,0,0,0\n1000000000,1e200,0,0,1,0,0,0\n");
  test::write_bytes(temp_ / "good.tum", "0 0 0 0 0 0 0 1\n1 1 0 0 0 0 0 1\n");
  for (const char* name : {"a.tum", "b.csv"})
    expect_refused(run_shell("PROGRAM score " + quoted((temp_ / name).string()) + " --truth " +
                             quoted((temp_ / "good.tum").string())),
                   {(temp_ / name).string() + ":2: a position is farther than 1e9 m"});
}

TEST_F(HostileInput, AFileBeyondItsLimitIsNotRead) {
  const path big = temp_ / "big.yaml";
  test::write_bytes(big, "name: a\n");
  test::fs::resize_file(big, uintmax_t{1} << 40);
  expect_refused(run_shell("PROGRAM info " + quoted(big.string())),
                 {big.string() + ": has 1048576 MiB, but at most 16 MiB"});
  const path data = dataset(), image = data / "stacks/000001/03.png";
  test::fs::resize_file(image, uintmax_t{1} << 40);
  expect_run_refused(data, {image.string() + ": has 1048576 MiB, but at most 1024 MiB"});
}

}  // namespace
}  // namespace fringeslam
