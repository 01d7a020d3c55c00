// SPDX-License-Identifier: Apache-2.0
// hostile_inputs FIRST LAST SECONDS SCENES: gives mutated files to the program's verbs and counts broken promises.
//
// Case N mutates one file of one verb's input; the case determines everything, so findings can be repeated:
// `hostile_inputs N N 0 SCENES` keeps the folder and prints its name. The verb runs in a forked child, which saves the
// loading of the libraries. Promises:
//  - the child ends by itself, within 10 s of processor time, with exit code 0, or 1 for a failed check, or 2,
//  - with 2, it prints one line that names a file of its input and contains no text of an exception,
//  - it needs at most 1 GiB of memory more than with the good file,
//  - a command that fails leaves nothing behind.
// Prints one line of JSON: cases, accepted, refused, findings. Each finding is a line on standard error.
#include <fcntl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <filesystem>
#include <fstream>
#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "core/io/files.h"
#include "core/io/image_worker.h"
#include "core/io/input_file.h"
#include "core/rig/rig_file.h"
#include "core/types/error.h"
#include "tools/program.h"

namespace fringeslam::robust {
namespace {

namespace fs = std::filesystem;

constexpr int kMostCpu_s = 10, kMostWall_s = 120;
constexpr long kMostExtra_kib = 1 << 20;

constexpr const char* kScene = R"(name: small
seed: 3
rig:
  file: rig.yaml
patterns:
  axis: columns
  steps: 3
  periods_px: [1040, 131, 16.5]
  bits: 8
light:
  ambient_lux: 290
materials:
  table: {grain: wood, albedo: 0.4, contrast: 0.35, grain_m: 0.012}
  printed: {texture: texture.png, texture_m: 0.2}
objects:
  - {shape: plane, size_m: [0.8, 0.8], material: table}
  - {shape: box, size_m: [0.2, 0.1, 0.1], pose: {translation_m: [0, 0, 0.05]}, material: printed}
trajectory:
  interval_s: 0.5
  motions:
    - {translation_mm: [10, 5, -5], rotation_deg: [3, 1, -2]}
)";

// A scene with a mesh, which `scene check` reads.
std::string mesh_scene(const std::string& file) {
  std::string text = kScene;
  const std::string box =
      "{shape: box, size_m: [0.2, 0.1, 0.1], pose: {translation_m: [0, 0, 0.05]}, material: printed}";
  return text.replace(text.find(box), box.size(),
                      "{shape: mesh, file: " + file + ", unit_m: 1, up: z, material: table}");
}

constexpr const char* kObj =
    "mtllib mesh.mtl\nv 0 0 0\nv 0.2 0 0\nv 0 0.2 0\nv 0 0 0.2\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl m\nf 1/1 2/2 3/3\nf 1/1 "
    "3/3 "
    "4/2\nf 1/2 4/1 2/3\nf 2/1 4/2 3/3\n";
constexpr const char* kMtl = "newmtl m\nKd 0.5 0.4 0.3\nmap_Kd texture.png\n";
constexpr const char* kGltf = R"({"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0}],
"meshes":[{"primitives":[{"attributes":{"POSITION":0},"indices":1}]}],
"buffers":[{"uri":"data:application/octet-stream;base64,AAAAAAAAAAAAAAAAzcxMPgAAAAAAAAAAAAAAAM3MTD4AAAAAAAABAAIA","byteLength":42}],
"bufferViews":[{"buffer":0,"byteOffset":0,"byteLength":36},{"buffer":0,"byteOffset":36,"byteLength":6}],
"accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[0.2,0.2,0]},
{"bufferView":1,"componentType":5123,"count":3,"type":"SCALAR"}]})";
constexpr const char* kCollada = R"(<?xml version="1.0" encoding="utf-8"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit name="meter" meter="1"/><up_axis>Z_UP</up_axis></asset>
<library_geometries><geometry id="g" name="g"><mesh>
<source id="p"><float_array id="pa" count="9">0 0 0 0.2 0 0 0 0.2 0</float_array><technique_common>
<accessor source="#pa" count="3" stride="3"><param name="X" type="float"/><param name="Y" type="float"/><param name="Z" type="float"/></accessor>
</technique_common></source><vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="1"><input semantic="VERTEX" source="#v" offset="0"/><p>0 1 2</p></triangles>
</mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s"><node id="n"><instance_geometry url="#g"/></node></visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#s"/></scene></COLLADA>
)";

// A zip archive with one stored file.
std::string archive(const std::string& name, const std::string& content) {
  std::string bytes;
  const auto u16 = [&](unsigned v) { bytes += {static_cast<char>(v), static_cast<char>(v >> 8)}; };
  const auto u32 = [&](uint32_t v) { u16(v & 0xffff), u16(v >> 16); };
  uint32_t crc = ~0u;
  for (const char c : content) {
    crc ^= static_cast<unsigned char>(c);
    for (int bit = 0; bit < 8; ++bit) crc = crc >> 1 ^ (crc & 1 ? 0xedb88320u : 0);
  }
  crc = ~crc;
  const auto common = [&] {
    u16(20), u16(0), u16(0), u16(0), u16(0x21), u32(crc);
    u32(static_cast<uint32_t>(content.size())), u32(static_cast<uint32_t>(content.size()));
    u16(static_cast<unsigned>(name.size())), u16(0);
  };
  u32(0x04034b50), common(), bytes += name + content;
  const auto directory = static_cast<uint32_t>(bytes.size());
  u32(0x02014b50), u16(20), common(), u16(0), u16(0), u16(0), u32(0), u32(0), bytes += name;
  const auto size = static_cast<uint32_t>(bytes.size()) - directory;
  u32(0x06054b50), u16(0), u16(0), u16(1), u16(1), u32(size), u32(directory), u16(0);
  return bytes;
}

// An uncompressed TIFF of grey bytes.
std::string tiff(const cv::Mat1b& image) {
  std::string bytes("II*\0\x08\0\0\0", 8);
  const auto put = [&](auto value) { bytes.append(reinterpret_cast<const char*>(&value), sizeof value); };
  const auto size = static_cast<uint32_t>(image.total());
  const std::vector<std::array<uint32_t, 3>> entries = {{256, 4, static_cast<uint32_t>(image.cols)},
                                                        {257, 4, static_cast<uint32_t>(image.rows)},
                                                        {258, 3, 8},
                                                        {259, 3, 1},
                                                        {262, 3, 1},
                                                        {273, 4, 200},
                                                        {277, 3, 1},
                                                        {278, 4, static_cast<uint32_t>(image.rows)},
                                                        {279, 4, size}};
  put(static_cast<uint16_t>(entries.size()));
  for (const auto& [tag, type, value] : entries)
    put(static_cast<uint16_t>(tag)), put(static_cast<uint16_t>(type)), put(uint32_t{1}), put(value);
  put(uint32_t{0});
  bytes.resize(200, '\0');
  return bytes.append(reinterpret_cast<const char*>(image.data), size);
}

// A verb and a file of its input. Words may contain OUT.
struct Target {
  fs::path file;
  std::vector<std::string> words;
  bool text = false;
  std::string good = {};
  long memory_kib = 0;  // with the good file
};

struct Ended {
  int exit_code = 0;  // 128 + signal if a signal ended it
  bool hung = false;
  long memory_kib = 0;
  std::string err;
};

class Trials {
 public:
  explicit Trials(fs::path scenes) : scenes_(std::move(scenes)) {
    std::string name = (fs::temp_directory_path() / "fringeslam-hostile-XXXXXX").string();
    if (!mkdtemp(name.data())) throw Error(name + ": cannot be created");
    folder_ = fs::canonical(name);
    setenv("FRINGESLAM_CACHE", (folder_ / "cache").c_str(), 1);
    prepare_image_decoding();
    write_inputs();
    std::string refused;
    for (Target& target : targets_) {
      target.good = read_input(target.file);
      const Ended ended = run(target.words);
      if (ended.exit_code != 0) refused += " " + target.file.string() + ": " + ended.err;
      target.memory_kib = ended.memory_kib;
      fs::remove_all(out());
    }
    if (!refused.empty()) throw Error("good inputs are refused:" + refused);
  }

  void run_case(int number, bool keep) {
    cv::RNG random(static_cast<uint64_t>(number) * 0x9e3779b97f4a7c15ull + 1);
    const Target& target = targets_[static_cast<size_t>(number) % targets_.size()];
    const std::string bytes = mutated(target, random);
    overwrite(target.file, bytes);
    const Ended ended = run(target.words);
    ++cases_;
    (ended.exit_code == 2 ? refused_ : accepted_) += 1;
    const std::string fault = fault_of(target, ended);
    if (!fault.empty()) {
      ++findings_;
      std::fprintf(stderr, "case %d: %s of `%s`: %s%s%s\n", number, target.file.filename().c_str(),
                   target.words[0].c_str(), fault.c_str(), ended.err.empty() ? "" : ": ", ended.err.c_str());
    }
    if (keep) {
      std::fprintf(stderr, "%s", ended.err.c_str());
      std::fprintf(stderr, "kept: %s, exit code %d\n", target.file.c_str(), ended.exit_code);
      return;
    }
    overwrite(target.file, target.good);
    fs::remove_all(out());
  }

  void remove() const { fs::remove_all(folder_); }

  void print() const {
    std::printf("{\"cases\": %d, \"accepted\": %d, \"refused\": %d, \"findings\": %d}\n", cases_, accepted_, refused_,
                findings_);
  }

 private:
  fs::path out() const { return folder_ / "results"; }

  static void overwrite(const fs::path& file, const std::string& bytes) {
    std::ofstream stream(file, std::ios::binary);
    stream << bytes;
    stream.close();
    if (!stream) throw Error(file.string() + ": cannot be written");
  }

  void run_well(const std::vector<std::string>& words) {
    const Ended ended = run(words);
    if (ended.exit_code != 0) throw Error("the inputs cannot be prepared: " + words[0] + ": " + ended.err);
  }

  void write_inputs() {
    RigModel rig = read_rig(scenes_ / "rigs/thesis.yaml");
    constexpr int kFactor = 8;  // smaller images show too little to be found in their map again
    Pinhole& camera = rig.camera;
    camera.width /= kFactor, camera.height /= kFactor;
    camera.fx /= kFactor, camera.fy /= kFactor;
    camera.cx = (camera.cx + 0.5) / kFactor - 0.5, camera.cy = (camera.cy + 0.5) / kFactor - 0.5;
    const fs::path scene = folder_ / "scene";
    fs::create_directories(scene);
    cv::Mat1b texture(40, 30);
    cv::RNG(5).fill(texture, cv::RNG::UNIFORM, 0, 256);
    write_png(scene / "texture.png", texture);
    overwrite(scene / "rig.yaml", to_yaml(rig));
    overwrite(scene / "scene.yaml", kScene);
    const std::string data = (folder_ / "data").string(), mapped = (folder_ / "mapped").string();
    const std::vector<std::string> fast = {"--quiet", "--threads", "1"};
    const auto with = [&](std::vector<std::string> words) {
      words.insert(words.end(), fast.begin(), fast.end());
      return words;
    };
    run_well(with({"render", scene.string(), "--out", data, "--set", "render.samples_per_pixel=1"}));
    const std::vector<std::string> map_data = with({"run", data, "--out", "OUT", "--no-report"});
    std::vector<std::string> first = map_data;
    first[3] = mapped;
    first.push_back("--save-map");
    run_well(first);
    fs::copy_file(fs::path(mapped) / "saved.map", folder_ / "saved.map");

    for (const char* name : {"dataset.yaml", "rig.yaml", "patterns.yaml", "stacks/000001/stack.yaml"})
      add(fs::path(data) / name, map_data, true);
    add(fs::path(data) / "stacks/000001/02.png", map_data);
    add(fs::path(data) / "truth/000001.exr", map_data);
    add(fs::path(data) / "truth/truth.tum", map_data, true);
    std::vector<std::string> continued = map_data;
    continued.insert(continued.end(), {"--map", (folder_ / "saved.map").string()});
    add(folder_ / "saved.map", continued);

    const std::vector<std::string> check = with({"scene", "check", scene.string()});
    for (const char* name : {"scene.yaml", "rig.yaml"}) add(scene / name, check, true);
    add(scene / "texture.png", check);
    const std::vector<std::pair<std::string, std::string>> meshes = {
        {"mesh.obj", kObj}, {"mesh.gltf", kGltf}, {"mesh.dae", kCollada}, {"mesh.zae", archive("mesh.dae", kCollada)}};
    for (const auto& [name, content] : meshes) {
      const fs::path place = folder_ / ("scene_" + name);
      fs::create_directories(place);
      for (const char* file : {"rig.yaml", "texture.png"}) fs::copy_file(scene / file, place / file);
      overwrite(place / "scene.yaml", mesh_scene(name));
      overwrite(place / name, content);
      overwrite(place / "mesh.mtl", kMtl);
      add(place / name, with({"scene", "check", place.string()}), name != "mesh.zae");
      if (name == "mesh.obj") add(place / "mesh.mtl", with({"scene", "check", place.string()}), true);
    }

    const std::string estimate = (folder_ / "estimate.tum").string(), truth = data + "/truth/truth.tum";
    fs::copy_file(truth, estimate);
    add(estimate, with({"score", estimate, "--truth", truth}), true);
    if (fs::exists(mapped + "/map.ply")) {
      const std::string map = (folder_ / "map.ply").string();
      fs::copy_file(mapped + "/map.ply", map);
      add(map, with({"score", map, "--truth", scene.string()}));
    }
    add(fs::path(mapped) / "config.yaml", with({"info", mapped}), true);

    // Images of an unknown rig, as TIFF.
    const fs::path images = folder_ / "images";
    fs::create_directories(images);
    for (int i = 0; i < 9; ++i) {
      const std::string name = "0" + std::to_string(i) + ".tif";
      overwrite(images / name, tiff(read_grey(fs::path(data) / "stacks/000000" / ("0" + std::to_string(i) + ".png"))));
    }
    std::string import_text =
        "name: images\ncamera: {bits: 8}\nprojector: {width_px: 1024, height_px: 768}\npatterns:\n";
    for (int i = 0; i < 3; ++i)
      import_text +=
          "  - {files: \"%02d.tif\", first: " + std::to_string(3 * i) +
          ", fringe: {axis: columns, period_px: " + std::array{"1040", "131", "16.5"}[static_cast<size_t>(i)] +
          ", shift_deg: [-120, 0, 120]}}\n";
    overwrite(images / "import.yaml", import_text);
    const std::vector<std::string> import = with({"import", images.string(), "--out", "OUT", "--no-check"});
    add(images / "03.tif", import);
    add(images / "import.yaml", import, true);

    const std::string bag = (folder_ / "views.bag").string();
    if (run(with({"render", scene.string(), "--out", bag, "--format", "rosbag"})).exit_code == 0)
      add(bag, with({"import", bag, "--out", "OUT"}));
    const fs::path study = folder_ / "study.yaml";
    overwrite(
        study,
        "name: s\nscene: scene/scene.yaml\ntrials: 3\nparameters:\n  light.ambient_lux: {log_uniform: [10, 1000]}\n");
    add(study, with({"study", "check", study.string()}), true);
  }

  void add(const fs::path& file, const std::vector<std::string>& words, bool text = false) {
    Target target{file, words, text};
    targets_.push_back(std::move(target));
  }

  // Runs a verb in a child.
  Ended run(std::vector<std::string> words) const {
    for (std::string& word : words) {
      if (word == "OUT") word = (out() / "out").string();
    }
    fs::create_directories(out());
    const std::string err = (folder_ / "err").string();
    const pid_t child = fork();
    if (child < 0) throw Error("hostile_inputs: cannot fork");
    if (child == 0) {
      const int file = open(err.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600), nowhere = open("/dev/null", O_RDWR);
      dup2(nowhere, 0), dup2(nowhere, 1), dup2(file, 2);
      const rlimit time{kMostCpu_s, kMostCpu_s + 1}, no_core{0, 0};
      setrlimit(RLIMIT_CPU, &time);
      setrlimit(RLIMIT_CORE, &no_core);
      words.insert(words.begin(), "fringeslam");
      std::vector<char*> arguments;
      for (std::string& word : words) arguments.push_back(word.data());
      arguments.push_back(nullptr);
      const int code = tools::run_program(static_cast<int>(words.size()), arguments.data());
      std::fflush(nullptr);
      _exit(code);
    }
    Ended ended;
    int status = 0;
    rusage usage{};
    const auto start = std::chrono::steady_clock::now();
    for (int wait_us = 200; wait4(child, &status, WNOHANG, &usage) == 0; wait_us = std::min(2 * wait_us, 5000)) {
      std::this_thread::sleep_for(std::chrono::microseconds(wait_us));
      if (std::chrono::steady_clock::now() - start > std::chrono::seconds(kMostWall_s)) {
        ended.hung = true;
        kill(child, SIGKILL);
        wait4(child, &status, 0, &usage);
        break;
      }
    }
    ended.exit_code = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
    ended.hung |= ended.exit_code == 128 + SIGXCPU;
    ended.memory_kib = usage.ru_maxrss;
    ended.err = read_input(err);
    return ended;
  }

  std::string fault_of(const Target& target, const Ended& ended) const {
    if (ended.hung) return "hangs";
    if (ended.exit_code > 2) return "crashes, exit code " + std::to_string(ended.exit_code);
    if (ended.memory_kib > target.memory_kib + kMostExtra_kib)
      return "needs " + std::to_string(ended.memory_kib >> 10) + " MiB";
    if (ended.exit_code != 2) return "";
    const std::string& err = ended.err;
    if (std::count(err.begin(), err.end(), '\n') != 1 || !err.starts_with("fringeslam: ")) {
      // `scene check` prints all errors of a scene, one per line.
      if (target.words[0] != "scene" || err.empty()) return "is not one line";
    }
    if (err.find(folder_.string()) == std::string::npos &&
        err.find(target.file.filename().string()) == std::string::npos)
      return "names no file";
    for (const char* raw :
         {"bad_alloc", "std::", "basic_string", "filesystem error", "OpenCV", "cv::", "vector::", "json.exception",
          "internal error", "length_error", ".partial-", "memory does not suffice"}) {
      if (err.find(raw) != std::string::npos) return std::string("has '") + raw + "'";
    }
    // A run whose mapping succeeded keeps its other results, and says so.
    const fs::path result = out() / "out";
    if (err.find("the other results are written to " + result.string()) != std::string::npos)
      return fs::exists(result) ? "" : "names a result that does not exist";
    if (fs::exists(result)) return "leaves a result";
    if (!fs::is_empty(out())) return "leaves a file";
    return "";
  }

  static std::string mutated(const Target& target, cv::RNG& random) {
    static const std::array<const char*, 26> kWords = {"0",
                                                       "-1",
                                                       "1e308",
                                                       "-1e308",
                                                       "nan",
                                                       "inf",
                                                       "1e-300",
                                                       "99999999999999999999",
                                                       "2147483648",
                                                       "4294967296",
                                                       "16385",
                                                       "\"\"",
                                                       "''",
                                                       "[]",
                                                       "{}",
                                                       "~",
                                                       "null",
                                                       "true",
                                                       "../../etc/passwd",
                                                       "/dev/zero",
                                                       "\n",
                                                       "\t",
                                                       "\xff\xfe",
                                                       "- -",
                                                       ": :",
                                                       "&a [*a, *a]"};
    std::string bytes = target.good;
    const auto at = [&] { return static_cast<size_t>(random.uniform(0, static_cast<int>(bytes.size()))); };
    const int edits = 1 + random.uniform(0, 4) * random.uniform(0, 2);
    for (int edit = 0; edit < edits && !bytes.empty(); ++edit) {
      // Most values that matter are at the beginning of a binary file.
      const size_t place =
          !target.text && random.uniform(0, 2) == 0 ? at() % std::min<size_t>(bytes.size(), 400) : at();
      const size_t length = std::min(bytes.size() - place, static_cast<size_t>(1 << random.uniform(0, 8)));
      switch (random.uniform(0, target.text ? 9 : 7)) {
        case 0:
          bytes[place] = static_cast<char>(bytes[place] ^ 1 << random.uniform(0, 8));
          break;
        case 1:
          bytes[place] = static_cast<char>(random.uniform(0, 256));
          break;
        case 2:
          bytes.erase(place, length);
          break;
        case 3:
          bytes.insert(at(), bytes.substr(place, length));
          break;
        case 4:
          bytes.resize(place);
          break;
        case 5: {
          constexpr std::array<uint64_t, 8> kNumbers = {0, 1, 0x7f, 0xffff, 0x7fffffff, 0x80000000, 0xffffffff, ~0ull};
          const uint64_t number = kNumbers[static_cast<size_t>(random.uniform(0, 8))];
          for (size_t i = 0; i < (size_t{1} << random.uniform(0, 4)) && place + i < bytes.size(); ++i)
            bytes[place + i] = static_cast<char>(number >> 8 * i);
          break;
        }
        case 6: {
          const size_t other = at(), count = std::min(length, bytes.size() - std::max(place, other));
          for (size_t i = 0; i < count; ++i) std::swap(bytes[place + i], bytes[other + i]);
          break;
        }
        default: {  // replaces a word
          const auto is_word = [](char c) {
            return std::isalnum(static_cast<unsigned char>(c)) || c == '.' || c == '-';
          };
          size_t begin = place, end = place;
          while (begin > 0 && is_word(bytes[begin - 1])) --begin;
          while (end < bytes.size() && is_word(bytes[end])) ++end;
          bytes.replace(begin, end - begin, kWords[static_cast<size_t>(random.uniform(0, kWords.size()))]);
        }
      }
    }
    return bytes;
  }

  fs::path scenes_, folder_;
  std::vector<Target> targets_;
  int cases_ = 0, accepted_ = 0, refused_ = 0, findings_ = 0;
};

int run(int first, int last, double seconds, const fs::path& scenes) {
  Trials trials(scenes);
  const auto start = std::chrono::steady_clock::now();
  const bool keep = first == last;
  for (int number = first; number <= last; ++number) {
    if (seconds > 0 && std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count() > seconds) break;
    trials.run_case(number, keep);
  }
  trials.print();
  if (!keep) trials.remove();
  return 0;
}

}  // namespace
}  // namespace fringeslam::robust

int main(int argc, char** argv) {
  if (argc != 5) {
    std::fprintf(stderr, "usage: hostile_inputs FIRST LAST SECONDS SCENES\n");
    return 2;
  }
  try {
    return fringeslam::robust::run(std::atoi(argv[1]), std::atoi(argv[2]), std::atof(argv[3]), argv[4]);
  } catch (const std::exception& e) {
    std::fprintf(stderr, "hostile_inputs: %s\n", e.what());
    return 2;
  }
}
