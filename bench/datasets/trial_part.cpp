// SPDX-License-Identifier: Apache-2.0
#include "bench/datasets/trial_part.h"

#include <libdeflate.h>

#include <fstream>
#include <nlohmann/json.hpp>
#include <optional>

#include "bench/datasets/sample_files.h"
#include "bench/datasets/sha256.h"
#include "bench/datasets/tar.h"
#include "bench/studies/trial_settings.h"
#include "core/io/files.h"

namespace fringeslam::datasets {

namespace fs = std::filesystem;

namespace {

// Removes the folder of the scene from a message, so that it does not depend on where the files are.
std::string without_folders(std::string message, const Spec& spec) {
  std::vector<fs::path> folders;
  for (const auto& files : {spec.scenes, spec.rigs}) {
    for (const fs::path& file : files) folders.push_back(file.parent_path());
  }
  for (const fs::path& folder : folders) {
    const std::string prefix = folder.string() + "/";
    for (size_t at; (at = message.find(prefix)) != std::string::npos;) message.erase(at, prefix.size());
  }
  return message;
}

// Appends samples to the piece.
class PieceWriter {
 public:
  explicit PieceWriter(const fs::path& file) : file_(file), staged_(file), out_(staged_.path(), std::ios::binary) {}

  PartSample add(int sample, const std::vector<SampleFile>& files) {
    PartSample entry{sample, offset_, 0, "", 0};
    Sha256 sum;
    for (const SampleFile& file : files) {
      const std::string member = tar_member(sample_name(sample) + "." + file.extension, file.bytes);
      sum.add(member);
      entry.crc32 = libdeflate_crc32(entry.crc32, member.data(), member.size());
      out_ << member;
      entry.bytes += member.size();
    }
    check();
    entry.sha256 = sum.hex();
    offset_ += entry.bytes;
    return entry;
  }
  void commit() {
    out_.close();
    check();
    staged_.commit();
  }

 private:
  void check() const {
    if (!out_) throw Error(file_.string() + ": cannot be written; is the disk full?");
  }
  fs::path file_;
  StagedFile staged_;
  std::ofstream out_;
  uint64_t offset_ = 0;
};

enum class Stage { setup, views };  // files are read during the setup

// An error of the simulator: the drawn values make no valid scene, or one of its files cannot be read. Other errors concern
// the machine.
struct Refusal {
  std::string message;
  Stage stage;
};

template <class Result, class Action>
Result simulated(Stage stage, const Action& action) {
  try {
    return action();
  } catch (const Error& e) {
    throw Refusal{e.what(), stage};
  }
}

void write_index(const fs::path& file, const TrialIndex& index) {
  StagedFile staged(file);
  write_text(staged.path(), index_text(index) + "\n");
  staged.commit();
}

void render_trial(const Spec& spec, const studies::Trial& trial, const fs::path& folder, TrialIndex& index) {
  const auto settings =
      simulated<studies::TrialSettings>(Stage::setup, [&] { return studies::settings_of(spec, trial); });
  const auto scene = simulated<sim::Scene>(Stage::setup, [&] { return scene_of(spec, trial); });
  auto rig = simulated<std::unique_ptr<sim::VirtualRig>>(
      Stage::setup, [&] { return std::make_unique<sim::VirtualRig>(scene, settings.render); });
  const PixelRays rays = pixel_rays(scene.rig.camera);
  const TrialContext context{spec, trial, scene, rig->model(), rays, settings.pipeline.decode};
  index.scene = scene.name;
  index.rig = rig->model().name;
  PieceWriter piece(part_file(folder, trial.index));
  for (int number = 0; number < spec.views; ++number) {
    const auto view =
        simulated<std::optional<sim::SimulatedView>>(Stage::views, [&] { return rig->simulate(scene.patterns); });
    if (!view) throw Refusal{"the path ends after " + std::to_string(number) + " views", Stage::views};
    const auto files =
        simulated<std::vector<SampleFile>>(Stage::views, [&] { return sample_files(context, *view, number); });
    index.samples.push_back(piece.add(trial.index * spec.views + number, files));
  }
  piece.commit();
}

// Renders a trial, and returns why it was refused, if it was; then it has no samples.
std::optional<Refusal> attempt(const Spec& spec, const studies::Trial& trial, const fs::path& folder,
                               TrialIndex& index) {
  try {
    render_trial(spec, trial, folder, index);
    return std::nullopt;
  } catch (const Refusal& refusal) {
    index.samples.clear();
    return refusal;
  }
}

}  // namespace

fs::path part_file(const fs::path& folder, int trial) { return folder / ("trial-" + std::to_string(trial) + ".part"); }
fs::path part_index_file(const fs::path& folder, int trial) {
  return folder / ("trial-" + std::to_string(trial) + ".json");
}

TrialIndex write_trial(const Spec& spec, const studies::Trial& trial, const fs::path& folder) {
  fs::create_directories(folder);
  TrialIndex index;
  index.trial = trial.index;
  std::optional<Refusal> refusal = attempt(spec, trial, folder, index);
  if (refusal && refusal->stage == Stage::setup) {
    // A refusal is recorded for good, so it must be due to the drawn values. If a file has disappeared, the first trial of
    // the same scene, which was valid at the start, is refused now as well. A temporary failure does not happen again.
    check_inputs(spec, trial);
    refusal = attempt(spec, trial, folder, index);
  }
  if (refusal) index.refused = without_folders(refusal->message, spec);
  write_index(part_index_file(folder, trial.index), index);
  return index;
}

std::string index_text(const TrialIndex& index) {
  nlohmann::ordered_json json = {{"trial", index.trial}, {"scene", index.scene}, {"rig", index.rig}};
  json["samples"] = nlohmann::ordered_json::array();
  for (const PartSample& sample : index.samples)
    json["samples"].push_back({sample.sample, sample.offset, sample.bytes, sample.sha256, sample.crc32});
  if (!index.refused.empty()) json["refused"] = index.refused;
  return json.dump();
}

std::optional<TrialIndex> trial_index_of(const std::string& text) {
  const auto json = nlohmann::json::parse(text, nullptr, false);
  if (!json.is_object()) return std::nullopt;
  TrialIndex index;
  try {
    index.trial = json.at("trial").get<int>();
    index.scene = json.at("scene").get<std::string>();
    index.rig = json.at("rig").get<std::string>();
    index.refused = json.value("refused", "");
    for (const auto& entry : json.at("samples"))
      index.samples.push_back({entry.at(0).get<int>(), entry.at(1).get<uint64_t>(), entry.at(2).get<uint64_t>(),
                               entry.at(3).get<std::string>(), entry.size() > 4 ? entry[4].get<uint32_t>() : 0});
  } catch (const nlohmann::json::exception&) {
    return std::nullopt;
  }
  return index;
}

std::optional<TrialIndex> read_trial(const fs::path& folder, int trial) {
  std::optional<TrialIndex> index = trial_index_of(read_bytes(part_index_file(folder, trial)));
  if (!index) return std::nullopt;
  uint64_t bytes = 0;
  for (const PartSample& sample : index->samples) bytes += sample.bytes;
  std::error_code failed;
  const uint64_t found = bytes > 0 ? fs::file_size(part_file(folder, trial), failed) : 0;
  return index->trial == trial && !failed && found == bytes ? index : std::nullopt;
}

}  // namespace fringeslam::datasets
