// SPDX-License-Identifier: Apache-2.0
// Fuzz target (libFuzzer, run by tools/fuzz): arbitrary bytes as a text file other than a scene must give a valid value or a
// one-line Error that names the file. The first letter selects the kind of file. OpenCV's parser, which ends the process on some
// damaged calibrations, runs in a child process as it does in the program. Rigs and pattern sequences, which are written
// with datasets, must be equal when read again.
#include <cmath>
#include <map>
#include <vector>

#include "bench/datasets/spec.h"
#include "bench/evaluation/leaderboard.h"
#include "bench/evaluation/suite_file.h"
#include "bench/studies/results.h"
#include "bench/studies/rows.h"
#include "bench/studies/study.h"
#include "bench/studies/trial_run.h"
#include "core/import/import_file.h"
#include "core/import/opencv_calibration.h"
#include "core/io/yaml.h"
#include "core/rig/dataset.h"
#include "core/rig/rig_file.h"
#include "hw/rig_hardware.h"
#include "tests/fuzz/fuzzing.h"
#include "tools/board_file.h"

namespace fringeslam::fuzz {

namespace {

namespace fs = std::filesystem;

bool is_valid(const Pinhole& lens) {
  return std::isfinite(lens.fx + lens.fy + lens.cx + lens.cy) && lens.width >= 0 && lens.height >= 0;
}

// Writes what was read and reads it again.
template <class Value, class Read>
void check_again(const fs::path& file, const Value& value, const Read& read) {
  const std::string text = to_yaml(value);
  write(file, text);
  try {
    require(to_yaml(read(file)) == text, "the file written again differs:\n" + text);
  } catch (const Error& error) {
    fail("the file written again is refused: " + std::string(error.what()) + "\n" + text);
  }
}

void check_rig(const fs::path& file) {
  const RigModel rig = read_rig(file);
  require(is_valid(rig.camera) && is_valid(rig.projector), "a rig with an invalid lens");
  require(rig.projector_from_camera.is_finite() && rig.robot_from_camera.is_finite(), "a rig with a non-finite pose");
  require(rig.near_m > 0 && rig.near_m < rig.far_m, "a rig without a working range");
  check_again(file, rig, [](const fs::path& again) { return read_rig(again); });
}

void check_patterns(const fs::path& file) {
  const PatternSequence sequence = read_patterns(file);
  require(!sequence.patterns.empty(), "a sequence without patterns");
  check_again(file, sequence, [](const fs::path& again) { return read_patterns(again); });
}

void check_hardware(const fs::path& file) {
  const RigModel rig = read_rig(file);
  const HardwareSettings settings = read_hardware(file, rig);
  require(settings.camera.exposure_s > 0, "an invalid exposure");
}

void check_stack(const fs::path& file) {
  FringeStack stack;
  read_stack_times(YamlMap::load(file), 3, {}, stack);
  require(stack.exposure_s.size() == 3 && stack.exposure_time_s.size() == 3, "a stack with other numbers of times");
}

void check_import(const fs::path& file) {
  const ImportPlan plan = read_import(file, folder() / "images");
  require(!plan.stacks.empty(), "an import without stacks");
  for (const auto& stack : plan.stacks)
    require(stack.size() == plan.sequence.patterns.size(), "a stack with other images than patterns");
}

void check_calibration(const fs::path& file) {
  const RigCalibration rig = read_opencv_calibration({{file}, {}});
  require(is_valid(rig.camera) && is_valid(rig.projector) && rig.projector_from_camera.is_finite(),
          "an invalid calibration");
}

void check_sampling(const studies::Sampling& sampling) {
  for (int trial = 0; trial < 3; ++trial) (void)studies::trial_of(sampling, trial);
}

void check_study(const fs::path& file) {
  const studies::Study study = studies::read_study(file);
  require(study.trials > 0, "a study without trials");
  check_sampling(study);
}

void check_spec(const fs::path& file) {
  const datasets::Spec spec = datasets::read_spec(file);
  require(spec.trials() > 0, "a dataset without samples");
  check_sampling(spec);
}

const studies::Study& small_study() {
  static const studies::Study study = [] {
    write(folder() / "scene.yaml", "name: scene\n");
    write(folder() / "study.yaml",
          "name: fuzz\nscene: scene.yaml\ntrials: 4\nparameters:\n  light.ambient_lux: {uniform: [10, 1000]}\n");
    return studies::read_study(folder() / "study.yaml");
  }();
  return study;
}

// The file of a shard of the small study.
void check_study_results(const fs::path& file) {
  const studies::Study& study = small_study();
  const fs::path results = folder() / "results";
  fs::create_directories(results / "shards");
  fs::copy_file(file, results / "shards/0-of-1.jsonl", fs::copy_options::overwrite_existing);
  // Messages name the file in this folder.
  const bool accepted = read_or_refuse(results, [&] {
    for (const studies::Row& row : studies::rows_of(study, studies::merged_lines(results, study)))
      require(row.trial >= 0 && row.trial < study.trials, "a row of no trial");
  });
  if (!accepted) throw Error(file.string() + ": refused");
}

struct Kind {
  const char* name;
  void (*check)(const fs::path&);
};

const std::map<char, Kind>& kinds() {
  static const std::map<char, Kind> all = {
      {'b', {"board.yaml", [](const fs::path& file) { (void)tools::read_board(file); }}},
      {'c', {"calibration.yml", check_calibration}},
      {'d', {"dataset.yaml", [](const fs::path& file) { (void)read_dataset_info(file.parent_path()); }}},
      {'e', {"suite.yaml", [](const fs::path& file) { (void)evaluation::read_suite(file, folder()); }}},
      {'g', {"spec.yaml", check_spec}},
      {'h', {"hardware.yaml", check_hardware}},
      {'i', {"import.yaml", check_import}},
      {'k', {"bag.yaml", [](const fs::path& file) { (void)read_bag_selection(file); }}},
      {'j', {"calibration.json", check_calibration}},
      {'l', {"results.jsonl", check_study_results}},
      {'p', {"patterns.yaml", check_patterns}},
      {'r', {"rig.yaml", check_rig}},
      {'s', {"study_file.yaml", check_study}},
      {'t', {"stack.yaml", check_stack}},
      {'v', {"leaderboard.jsonl", [](const fs::path& file) { (void)evaluation::read_results(file); }}},
      {'x', {"calibration.xml", check_calibration}}};
  return all;
}

// Writes the seeds that the program can write; tools/fuzz writes the others.
void write_seeds(const fs::path& seeds) {
  studies::TrialResult trial;
  trial.outcome = studies::Outcome::success;
  trial.metrics = {{"translation_mm", 0.5}};
  write(seeds / "results", "l" + to_line(small_study(), trial_of(small_study(), 0), trial) + "\n");
  evaluation::Result result;
  result.suite = result.dataset = result.system = "x";
  result.ate_m = 0.1;
  write(seeds / "leaderboard", "v" + evaluation::to_lines({result}));
}

// Provides the files that others refer to.
void lay_out() {
  fs::create_directories(folder() / "images");
  for (int i = 0; i < 12; ++i) write(folder() / "images" / (std::to_string(i) + ".png"), "");
  (void)small_study();
}

}  // namespace

}  // namespace fringeslam::fuzz

extern "C" int LLVMFuzzerInitialize(int* argc, char*** argv) {
  return fringeslam::fuzz::seeds_on_request(*argc, *argv, fringeslam::fuzz::write_seeds);
}

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace fringeslam::fuzz;
  [[maybe_unused]] static const bool ready = (lay_out(), true);
  const auto kind = kinds().find(size > 0 ? static_cast<char>(data[0]) : '\0');
  if (kind == kinds().end()) return -1;
  const fs::path file = folder() / kind->second.name;
  write(file, text_of(data + 1, size - 1));
  // A file may name others, which are then at fault.
  read_or_refuse(folder(), [&] { kind->second.check(file); });
  return 0;
}

// The first letter remains.
extern "C" size_t LLVMFuzzerCustomMutator(uint8_t* data, size_t size, size_t max_size, unsigned seed) {
  if (size < 2) return LLVMFuzzerMutate(data, size, max_size);
  return 1 + fringeslam::fuzz::mutate_yaml(data + 1, size - 1, max_size - 1, seed);
}
