// SPDX-License-Identifier: Apache-2.0
// fringeslam calibrate noise DATASET... --out FOLDER
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>

#include "core/calibrate/camera_noise.h"
#include "core/decode/exposures.h"
#include "core/io/files.h"
#include "core/io/json_text.h"
#include "core/io/setting_groups.h"
#include "core/rig/dataset.h"
#include "core/rig/rig_file.h"
#include "tools/output_file.h"
#include "tools/report/noise_report.h"
#include "tools/verbs.h"

namespace fringeslam::tools {

namespace {

struct NoiseSettings {
  NoiseOptions noise;

  template <class Visit>
  void for_each_group(Visit&& visit) {
    visit("noise", noise);
  }
};

struct CalibrateNoiseArguments {
  std::vector<std::string> datasets;
  std::string out;
  std::vector<std::string> sets;
};

int calibrate(const CalibrateNoiseArguments& arguments, const Common& common) {
  NoiseSettings settings;
  apply_settings(settings, arguments.sets);
  ReplayRig first(arguments.datasets.front());
  RigModel rig = first.model();
  NoiseEstimator estimator(rig.sensor, settings.noise);
  OneExposure one(settings.noise.saturation * rig.sensor.saturation_dn());
  for (const std::string& dataset : arguments.datasets) {
    ReplayRig replay(dataset);
    if (replay.model().sensor.bits != rig.sensor.bits)
      throw Error(dataset + ": has " + std::to_string(replay.model().sensor.bits) + " bits per pixel, but " +
                  arguments.datasets.front() + " has " + std::to_string(rig.sensor.bits) +
                  "; use datasets of one camera");
    while (const auto stack = replay.capture(replay.sequence())) estimator.add(one.of(*stack));
  }
  CameraNoise noise;
  try {
    noise = estimator.estimate();
  } catch (const Error& e) {
    throw Error(arguments.datasets.front() + ": " + e.what());
  }
  require_not_an_input(arguments.out, {arguments.datasets.begin(), arguments.datasets.end()});
  StagedFolder folder(arguments.out, "camera noise");
  const SensorModel before = rig.sensor;
  rig.sensor = noise.sensor;
  write_text(folder.path() / "rig.yaml", to_yaml(rig));
  write_text(folder.path() / "noise.json", json_text(to_json(noise), 2) + "\n");
  write_png(folder.path() / "noise.png", picture_of(noise, before));
  folder.commit();
  for (const std::string& warning : warnings_of(noise)) std::fprintf(stderr, "warning: %s\n", warning.c_str());
  if (common.json)
    std::printf("%s\n", json_text(to_json(noise), 2).c_str());
  else
    std::printf("%s\nwritten: %s  (rig.yaml, noise.json, noise.png)\n", to_table(noise).c_str(), arguments.out.c_str());
  return 0;
}

}  // namespace

Verb add_calibrate_noise(Command group, const Common& common) {
  auto arguments = std::make_shared<CalibrateNoiseArguments>();
  const Command verb =
      group.add_subcommand("noise", "Camera gain, dark noise and saturation, from fringe stacks of any view");
  verb.add_option("datasets", arguments->datasets, "Datasets of one camera with unchanged gain").required();
  verb.add_option("--out", arguments->out, "Folder for rig.yaml, noise.json and noise.png").required();
  verb.add_option("--set", arguments->sets, "noise.key=value (repeatable; listed below)");
  verb.footer(groups_help(NoiseSettings()));
  return [arguments, &common] { return calibrate(*arguments, common); };
}

}  // namespace fringeslam::tools
