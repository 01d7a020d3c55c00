// SPDX-License-Identifier: Apache-2.0
#include "bench/robust/bit_trials.h"

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>

#include "bench/robust/child_runs.h"
#include "core/base/fnv.h"
#include "core/io/files.h"
#include "core/types/error.h"
#include "core/types/selected_instruction_set.h"

namespace fringeslam::robust {

namespace fs = std::filesystem;

const std::vector<std::string> kBitTasks = {"render", "run", "moving", "study", "dataset"};

namespace {

constexpr const char* kStudy = R"(name: bits
scene: small/scene.yaml
trials: 4
worlds: 2
seed: 5
parameters:
  light.ambient_lux: {log_uniform: [10, 1000]}
)";
constexpr const char* kDataset = R"(name: bits
description: Boxes
scenes: [small/scene.yaml]
samples: 6
views: 2
worlds: 3
seed: 5
samples_per_tar: 2
split: {train: 0.67, validation: 0, test: 0.33}
patterns:
  - {axis: columns, steps: 3, periods_px: [1040, 131, 16.5]}
  - {axis: columns, steps: 4, periods_px: [131], gray: plain}
parameters:
  light.ambient_lux: {log_uniform: [10, 1000]}
)";

struct Variant {
  InstructionSet set = InstructionSet::portable;
  int threads = 1, shards = 1;
};

std::string text_of(const Variant& variant) {
  return std::string(to_string(variant.set)) + ", " + std::to_string(variant.threads) + " threads, " +
         std::to_string(variant.shards) + (variant.shards == 1 ? " shard" : " shards");
}

// Words of a shell that restrict the program and its libraries to an instruction set.
std::string restriction(InstructionSet set) {
  std::string words = "env " + std::string(kInstructionSetVariable) + "=" + to_string(set) + " ";
  if (set == InstructionSet::portable)
    words +=
        "OPENCV_CPU_DISABLE=SSE4.1,SSE4.2,POPCNT,AVX,FP16,AVX2,FMA3,AVX512-SKX "
        "GLIBC_TUNABLES=glibc.cpu.hwcaps=-AVX,-AVX2,-FMA,-FMA4,-AVX512F,-AVX512VL ";
  if (set == InstructionSet::avx2)
    words += "OPENCV_CPU_DISABLE=AVX512-SKX GLIBC_TUNABLES=glibc.cpu.hwcaps=-AVX512F,-AVX512VL ";
  return words;
}

class Trials {
 public:
  Trials(const fs::path& program, const fs::path& folder, const BitOptions& options)
      : program_(program), folder_(fs::canonical(folder)), options_(options) {
    write_small_scene(folder_ / "small", 2);
    write_moving_scene(folder_ / "moving");
    write_text(folder_ / "study.yaml", kStudy);
    write_text(folder_ / "dataset.yaml", kDataset);
    setenv("FRINGESLAM_CACHE", (folder_ / "cache").c_str(), 1);
    scene_ = options.scene.empty() ? folder_ / "small" : fs::canonical(options.scene);
  }

  BitReport report() {
    BitReport report;
    for (const InstructionSet set : supported_instruction_sets()) report.sets.emplace_back(to_string(set));
    std::string all;
    const auto start = std::chrono::steady_clock::now();
    for (const std::string& task : kBitTasks) {
      const auto& tasks = options_.tasks;
      if (!tasks.empty() && std::find(tasks.begin(), tasks.end(), task) == tasks.end()) continue;
      const Content reference = result(task, {widest_instruction_set(), 1, 1});
      report.files += static_cast<int>(reference.size());
      for (const auto& [name, hash] : reference) {
        // The resolved scene has absolute paths, which differ between computers.
        if (fs::path(name).filename() != "resolved_scene.yaml") all += name + std::to_string(hash);
      }
      for (const Variant& variant : variants(task)) {
        const double minutes = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count() / 60;
        if (options_.minutes > 0 && minutes > options_.minutes) break;
        const std::string difference = first_difference(reference, result(task, variant));
        ++report.compared;
        if (difference.empty()) continue;
        report.differences.push_back(task + ", " + text_of(variant) + ": " + difference);
        std::fprintf(stderr, "  %s\n", report.differences.back().c_str());
      }
    }
    report.digest = fnv1a(all);
    return report;
  }

 private:
  using Content = std::map<std::string, uint64_t>;

  static bool in_shards(const std::string& task) { return task == "study" || task == "dataset"; }

  // All variants but the reference. Studies and datasets run their trials in processes of one thread.
  std::vector<Variant> variants(const std::string& task) const {
    std::vector<Variant> all;
    const auto sets = supported_instruction_sets();
    const auto& counts = in_shards(task) ? options_.shards : options_.threads;
    for (size_t s = 0; s < sets.size(); ++s) {
      for (size_t c = 0; c < counts.size(); ++c) {
        if (!options_.every_pair && c % sets.size() != s) continue;
        Variant variant{sets[s], counts[c], 1};
        if (in_shards(task)) variant.shards = counts[c];
        if (variant.threads > 1 || variant.set != sets.back()) all.push_back(variant);
      }
    }
    return all;
  }

  Content result(const std::string& task, const Variant& variant) const {
    const fs::path out = folder_ / "out";
    fs::remove_all(out);
    std::vector<std::string> words = {program_.string(), "--quiet", "--threads", std::to_string(variant.threads)};
    const auto execute = [&](const std::vector<std::string>& more) {
      std::vector<std::string> line = words;
      line.insert(line.end(), more.begin(), more.end());
      execute_well(folder_, restriction(variant.set) + shell_line(line));
    };
    const std::vector<std::string> output = {"--out", out.string()};
    const auto with_output = [&](std::vector<std::string> line, const std::vector<std::string>& more) {
      line.insert(line.end(), output.begin(), output.end());
      line.insert(line.end(), more.begin(), more.end());
      execute(line);
    };
    if (task == "render") {
      with_output({"render", scene_.string()}, {});
    } else if (task == "run") {
      with_output({"run", scene_.string()}, {"--mesh", "--save-map", "--vdb"});
    } else if (task == "moving") {
      with_output({"run", (folder_ / "moving").string()}, {"--mesh", "--save-map", "--image-poses", "--no-report"});
    } else {
      const bool study = task == "study";
      for (int shard = variant.shards - 1; shard >= 0; --shard) {
        std::vector<std::string> line = {"dataset", (folder_ / "dataset.yaml").string()};
        if (study) line = {"study", "run", (folder_ / "study.yaml").string()};
        with_output(line, {"--jobs", std::to_string(variant.threads), "--shard",
                           std::to_string(shard) + "/" + std::to_string(variant.shards)});
      }
      if (study) {
        for (const char* verb : {"merge", "report"})
          execute({"study", verb, (folder_ / "study.yaml").string(), "--out", out.string()});
      }
    }
    Content files = content(out);
    // The shards themselves follow from their number.
    std::erase_if(files, [](const auto& file) { return file.first.starts_with("shards/"); });
    return files;
  }

  static std::string first_difference(const Content& reference, const Content& other) {
    int differing = 0;
    std::string first;
    const auto compare = [&](const Content& some, const Content& against, const char* missing) {
      for (const auto& [name, hash] : some) {
        const auto found = against.find(name);
        if (found != against.end() && (missing[0] == 'e' || found->second == hash)) continue;
        if (differing++ == 0) first = name + (found == against.end() ? std::string(" is ") + missing : " differs");
      }
    };
    compare(reference, other, "missing");
    compare(other, reference, "extra");
    return differing == 0 ? "" : first + " (" + std::to_string(differing) + " files)";
  }

  const fs::path& program_;
  fs::path folder_, scene_;
  const BitOptions& options_;
};

}  // namespace

BitReport compare_bits(const fs::path& program, const fs::path& folder, const BitOptions& options) {
  return Trials(program, folder, options).report();
}

}  // namespace fringeslam::robust
