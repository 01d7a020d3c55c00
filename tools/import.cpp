// SPDX-License-Identifier: Apache-2.0
// fringeslam import FOLDER --out DATASET: converts another rig's images to a dataset.
#include "core/import/import.h"

#include <algorithm>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>

#include "core/calibrate/camera_noise.h"
#include "core/calibrate/response.h"
#include "core/check/conventions.h"
#include "core/decode/exposures.h"
#include "core/io/json_text.h"
#include "core/patterns/waveform.h"
#include "core/rig/dataset.h"
#include "core/rig/rig_file.h"
#include "tools/bag/bag_dataset.h"
#include "tools/bag/bag_stream.h"
#include "tools/bag/bag_unpack.h"
#include "tools/board_file.h"
#include "tools/output_file.h"
#include "tools/progress.h"
#include "tools/report/noise_report.h"
#include "tools/verbs.h"

namespace fringeslam::tools {

namespace fs = std::filesystem;

namespace {

constexpr const char* kImportFile = "import.yaml";

// Noise parameters of the imported rig and their description for the user.
struct ImportedNoise {
  SensorModel sensor;
  std::optional<CameraNoise> measured;
  std::string summary;
  std::vector<std::string> warnings;
};

std::string summary_of(const CameraNoise& noise) {
  char text[200];
  const NoiseInterval &gain = noise.gain_dn_per_electron, &dark = noise.dark_noise_electrons;
  std::snprintf(text, sizeof text,
                "measured: gain %.4g DN/electron (%.4g to %.4g), dark noise %.3g electrons (%.3g to %.3g), offset %.3g "
                "DN; %lld samples",
                gain.value, gain.low, gain.high, dark.value, dark.low, dark.high, noise.offset_dn.value,
                static_cast<long long>(noise.samples));
  return text;
}

double clip_dn(const SensorModel& sensor) { return DecodeOptions().saturation * sensor.saturation_dn(); }

// Measures the noise from the first stacks, or reads it, as import.yaml requests.
ImportedNoise noise_of(const ImportPlan& plan) {
  constexpr int kStacks = 8;
  ImportedRig rig(plan);
  ImportedNoise result{rig.model().sensor, {}, "", {}};
  if (plan.camera.noise == NoiseSource::defaults) {
    result.summary = "as described in " + plan.config.filename().string() + ", otherwise defaults";
    return result;
  }
  if (plan.camera.noise == NoiseSource::file) {
    result.sensor = read_rig(plan.camera.noise_file).sensor;
    result.summary = "from " + plan.camera.noise_file.string();
    return result;
  }
  NoiseEstimator estimator(result.sensor, {});
  OneExposure one(clip_dn(result.sensor));
  for (int i = 0; i < kStacks; ++i) {
    const auto stack = rig.capture(rig.sequence());
    if (!stack) break;
    estimator.add(one.of(*stack));
  }
  try {
    result.measured = estimator.estimate();
    result.sensor = result.measured->sensor;
    result.summary = summary_of(*result.measured);
    result.warnings = warnings_of(*result.measured);
  } catch (const Error& e) {
    if (plan.camera.noise == NoiseSource::measured)
      throw Error(plan.config.string() + ": camera.noise: measured: " + e.what());
    result.summary = "defaults";
    result.warnings.push_back(
        "the camera's noise is unknown, so sigmas may be wrong by a factor of two: " + std::string(e.what()) +
        "; or set `camera: {noise: FILE}` with a rig.yaml of `fringeslam calibrate noise`");
  }
  return result;
}

// Compares the described conventions with alternatives on the first stack. Throws Error if one fits far better; returns
// warnings otherwise.
std::vector<std::string> convention_warnings(const ImportPlan& plan, const FringeStack& stack, const RigModel& rig,
                                             const std::vector<double>& offset_rad) {
  ConventionReport report;
  try {
    report = check_conventions(stack, rig, offset_rad);
  } catch (const Error& e) {
    return {"the described conventions were not checked: " + std::string(e.what())};
  }
  if (report.verdict == ConventionReport::Verdict::fits) return {};
  const std::string message = plan.config.string() + ": " + report.message;
  if (report.verdict == ConventionReport::Verdict::wrong)
    throw Error(message + "; correct the description, or pass --no-check to import it as it is");
  return {message};
}

// True if a correction applies to all periods of an axis.
bool corrects(const PhaseCorrection& correction, const std::vector<FringeGroup>& groups) {
  return !correction.offset_rad.empty() && std::all_of(groups.begin(), groups.end(), [&](const FringeGroup& group) {
    return correction.steps == static_cast<int>(group.images.size()) && equally_spaced(group.shifts_rad);
  });
}

// Returns a warning if the phases of two periods disagree in a way that repeats with the phase: waveforms that are not the
// described sinusoids bias three-step phases by several percent of a period.
std::vector<std::string> waveform_warnings(const FringeStack& stack, const RigModel& rig) {
  constexpr double kLeast_rad = 0.03, kLeast_px = 0.1, kSigmas = 5;
  std::optional<PeriodDeviation> worst;
  for (const Axis axis : {Axis::columns, Axis::rows}) {
    if (corrects(rig.phase_correction, fringe_groups(stack.patterns, axis))) continue;
    for (const PeriodDeviation& deviation : period_deviations(stack.images, stack.patterns, axis, rig.sensor, {})) {
      const bool significant = deviation.rms_rad > std::max(kLeast_rad, kSigmas * deviation.sigma_rad);
      if (significant && deviation.rms_px() > kLeast_px && (!worst || deviation.rms_rad > worst->rms_rad))
        worst = deviation;
    }
  }
  if (!worst) return {};
  char text[300];
  std::snprintf(
      text, sizeof text,
      "the fringes are not sinusoidal: the phase of the %s px period deviates from the next finer one by %.2f px "
      "(RMS) as it repeats, as behind a projector of gamma %.2f; ",
      to_text(worst->period_px).c_str(), worst->rms_px(), worst->gamma);
  const PhaseCorrection& stated = rig.phase_correction;
  const std::string advice =
      stated.offset_rad.empty()
          ? "measure it with `fringeslam calibrate response` and import again with --rig, or state "
            "`projector: {gamma: ...}`"
          : "the rig's correction is for " + std::to_string(stated.steps) +
                " equally spaced steps of every period, which these patterns do not have; measure "
                "one for them with `fringeslam calibrate response`";
  return {text + advice};
}

// Throws Error if 16-bit images have no values of 16 bits: saturation would go unnoticed, and sigmas would be wrong.
void check_bits(const ImportPlan& plan, const FringeStack& stack) {
  if (plan.camera.bits > 0 || stack.images[0].depth() != CV_16U) return;
  double largest = 0;
  for (const cv::Mat& image : stack.images) {
    double in_image = 0;
    cv::minMaxLoc(image, nullptr, &in_image);
    largest = std::max(largest, in_image);
  }
  constexpr double k12Bits = 4095, k14Bits = 16383, kSaturated = 1e-4;
  const auto is_saturated = [&](const cv::Mat& image) {
    return cv::countNonZero(image == largest) > kSaturated * static_cast<double>(image.total());
  };
  if (largest <= k12Bits || (largest == k14Bits && std::any_of(stack.images.begin(), stack.images.end(), is_saturated)))
    throw Error(
        plan.config.string() + ": no gray value of the first stack exceeds " + to_text(largest) +
        " of 65535; add `camera: {bits: N}` with the bits of the camera's values, such as 12, or 16 if the images "
        "are that dark");
}

// Checks the bits of the first stack and, unless `conventions` is false, compares it with its description.
std::vector<std::string> check_of(const ImportPlan& plan, const SensorModel& sensor,
                                  const std::optional<RigModel>& calibration, bool conventions) {
  ImportedRig rig(plan);
  if (calibration) rig.recalibrate(*calibration);
  rig.set_sensor(sensor);
  const auto stack = rig.capture(rig.sequence());
  if (!stack) return {};
  check_bits(plan, *stack);
  if (!conventions) return {};
  const double exposure = clearest_exposure(*stack, clip_dn(sensor));
  const FringeStack one = as_one_exposure(images_at(*stack, exposure));
  std::vector<double> offset_rad;
  for (size_t i = 0; i < plan.offset_rad.size(); ++i) {
    if (stack->patterns.patterns[i].exposure == exposure) offset_rad.push_back(plan.offset_rad[i]);
  }
  std::vector<std::string> warnings = convention_warnings(plan, one, rig.model(), offset_rad);
  for (std::string& warning : waveform_warnings(one, rig.model())) warnings.push_back(std::move(warning));
  return warnings;
}

// Prints what was imported.
void print_imported(const std::string& out, int stacks, size_t images, const RigModel& model,
                    const nlohmann::ordered_json& noise, const std::string& noise_summary, const Common& common) {
  if (common.json) {
    const nlohmann::ordered_json json = {{"dataset", out},
                                         {"stacks", stacks},
                                         {"images_per_stack", images},
                                         {"calibrated", model.calibrated},
                                         {"noise", noise}};
    std::printf("%s\n", json_text(json).c_str());
  } else if (!common.quiet) {
    std::printf("dataset: %s (%d x %zu images, %dx%d px%s)\n", out.c_str(), stacks, images, model.camera.width,
                model.camera.height, model.calibrated ? "" : "; not calibrated: run fringeslam calibrate rig");
    std::printf("camera noise: %s\n", noise_summary.c_str());
  }
}

int import_images(ImportPlan plan, const std::string& out, const std::optional<RigModel>& calibration, bool check,
                  const Common& common) {
  require_not_an_input(out, inputs_of(plan));
  const size_t stacks = plan.stacks.size(), images = plan.sequence.patterns.size();
  const std::string name = plan.rig.name, board_yaml = plan.board_yaml;
  const bool image_times = plan.has_image_times();
  ImportedNoise noise = noise_of(plan);
  for (std::string& warning : check_of(plan, noise.sensor, calibration, check))
    noise.warnings.push_back(std::move(warning));
  ImportedRig rig(std::move(plan));
  if (calibration) rig.recalibrate(*calibration);
  rig.set_sensor(noise.sensor);
  StagedFolder folder(out, "dataset");
  RecordingRig recording(rig, folder.path());
  {
    Progress progress("importing", static_cast<int>(stacks), common.quiet || common.json);
    while (recording.capture(rig.sequence())) progress.step();
  }
  if (!board_yaml.empty()) write_text(folder.path() / "board.yaml", board_yaml);
  recording.finish(name, 0, false, true, image_times);
  if (noise.measured) {
    write_text(folder.path() / "noise.json", json_text(to_json(*noise.measured), 2) + "\n");
    write_png(folder.path() / "noise.png", picture_of(*noise.measured, noise.measured->sensor));
  }
  folder.commit();
  const RigModel& model = rig.model();
  for (const std::string& warning : noise.warnings) std::fprintf(stderr, "warning: %s\n", single_line(warning).c_str());
  print_imported(out, static_cast<int>(stacks), images, model,
                 noise.measured ? to_json(*noise.measured) : nlohmann::ordered_json(noise.summary), noise.summary,
                 common);
  return 0;
}

// Imports a bag that this program wrote: it contains its rig and its patterns.
int import_our_bag(const fs::path& file, const std::string& out, const std::optional<RigModel>& calibration,
                   const Common& common) {
  BagRig rig(file);
  if (calibration) rig.recalibrate(*calibration);
  StagedFolder folder(out, "dataset");
  RecordingRig recording(rig, folder.path());
  const DatasetInfo& info = rig.info();
  {
    Progress progress("importing", info.stacks, common.quiet || common.json);
    while (recording.capture(rig.sequence())) progress.step();
  }
  if (!rig.board_yaml().empty()) write_text(folder.path() / kBoardFile, rig.board_yaml());
  recording.finish(info.name, info.seed, false, info.imported, info.image_times);
  folder.commit();
  const std::string noise = "as in the bag";
  print_imported(out, info.stacks, rig.sequence().patterns.size(), rig.model(), noise, noise, common);
  return 0;
}

int import_bag(const fs::path& file, const fs::path& config, const std::string& out,
               const std::optional<RigModel>& calibration, bool check, const Common& common) {
  if (!is_bag(file)) throw Error(file.string() + ": is neither a folder with images nor a ROS bag (format 2.0)");
  const std::vector<BagTopic> topics = BagStream(file, {}).topics();
  if (is_our_bag(topics)) {
    if (!config.empty())
      throw Error(file.string() + ": contains its rig and its patterns, so --config has no effect; leave it out");
    return import_our_bag(file, out, calibration, common);
  }
  if (config.empty())
    throw Error(file.string() +
                ": was not written by fringeslam; describe its images in an import.yaml and pass it as --config");
  StagedFolder unpacked(out, "dataset");
  const std::vector<std::string> warnings = unpack_bag(file, read_bag_selection(config), unpacked.path());
  const int status = import_images(read_import(config, unpacked.path(), true), out, calibration, check, common);
  for (const std::string& warning : warnings) std::fprintf(stderr, "warning: %s\n", single_line(warning).c_str());
  return status;
}

}  // namespace

Verb add_import(Command app, const Common& common) {
  struct ImportArguments {
    std::string folder, config, out, rig;
    bool unchecked = false;
  };
  auto a = std::make_shared<ImportArguments>();
  const Command verb = app.add_subcommand("import", "Convert the images of any structured-light rig to a dataset");
  verb.add_option("folder", a->folder, "Folder with the images, or a ROS bag").required();
  verb.add_option("--config", a->config,
                  "Description of the images (default: FOLDER/import.yaml); not for bags written by fringeslam");
  verb.add_option("--out", a->out, "Dataset folder to write").required();
  verb.add_option("--rig", a->rig, "Calibration, a rig.yaml such as that of calibrate rig; replaces import.yaml's")
      .check_existing_file();
  verb.add_flag("--no-check", a->unchecked, "Import even if other conventions fit the images far better");
  return [a, &common] {
    const fs::path source(a->folder), config(a->config);
    std::optional<RigModel> calibration;
    if (!a->rig.empty()) calibration = read_rig(fs::path(a->rig));
    require_not_an_input(a->out, {source, config, a->rig});
    if (fs::is_regular_file(source)) return import_bag(source, config, a->out, calibration, !a->unchecked, common);
    return import_images(read_import(config.empty() ? source / kImportFile : config, source), a->out, calibration,
                         !a->unchecked, common);
  };
}

}  // namespace fringeslam::tools
