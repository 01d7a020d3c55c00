// SPDX-License-Identifier: Apache-2.0
// fringeslam calibrate response DATASET --out FOLDER
#include <algorithm>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>

#include "core/calibrate/response.h"
#include "core/io/files.h"
#include "core/io/json_text.h"
#include "core/io/setting_groups.h"
#include "core/patterns/waveform.h"
#include "core/rig/dataset.h"
#include "core/rig/rig_file.h"
#include "tools/output_file.h"
#include "tools/report/plot.h"
#include "tools/verbs.h"

namespace fringeslam::tools {

namespace {

struct ResponseSettings {
  ResponseOptions response;

  template <class Visit>
  void for_each_group(Visit&& visit) {
    visit("response", response);
  }
};

struct CalibrateResponseArguments {
  std::string dataset, out;
  std::optional<int> steps;
  std::vector<std::string> sets;
};

// Returns the mean images of all stacks, which must show the same view.
std::vector<cv::Mat1f> mean_images(ReplayRig& replay) {
  std::vector<cv::Mat1f> sums;
  int stacks = 0;
  while (const auto stack = replay.capture(replay.sequence())) {
    ++stacks;
    for (size_t i = 0; i < stack->images.size(); ++i) {
      cv::Mat1f image;
      stack->images[i].convertTo(image, CV_32F);
      if (stacks == 1)
        sums.push_back(image);
      else
        sums[i] += image;
    }
  }
  for (cv::Mat1f& sum : sums) sum *= 1.0 / stacks;
  return sums;
}

// Indices and levels of a sequence's flat images.
struct Ramp {
  std::vector<size_t> images;
  std::vector<double> levels;
};
Ramp ramp_of(const PatternSequence& sequence) {
  Ramp ramp;
  for (size_t i = 0; i < sequence.patterns.size(); ++i) {
    if (sequence.patterns[i].coding != Coding::flat) continue;
    ramp.images.push_back(i);
    ramp.levels.push_back(sequence.patterns[i].level);
  }
  return ramp;
}

// Returns the first fringe group with at least 8 equally spaced phase steps.
std::optional<FringeGroup> many_steps(const PatternSequence& sequence) {
  for (const Axis axis : {Axis::columns, Axis::rows}) {
    for (const FringeGroup& group : fringe_groups(sequence, axis)) {
      if (group.images.size() >= 8 && equally_spaced(group.shifts_rad)) return group;
    }
  }
  return std::nullopt;
}

template <class Indices>
std::vector<cv::Mat1f> pick(const std::vector<cv::Mat1f>& images, const Indices& indices) {
  std::vector<cv::Mat1f> picked;
  for (const auto i : indices) picked.push_back(images[static_cast<size_t>(i)]);
  return picked;
}

nlohmann::ordered_json to_json(const Response& response, const PhaseCorrection& correction) {
  return {{"pixels", response.pixels},
          {"gamma", response.gamma},
          {"level", response.level},
          {"light", response.light},
          {"sigma", response.sigma},
          {"phase_correction", {{"steps", correction.steps}, {"offset_rad", correction.offset_rad}}}};
}

std::string to_table(const Response& response, const PhaseCorrection& correction) {
  std::string text = "level    light\n";
  char line[128];
  const size_t stride = std::max<size_t>(1, response.level.size() / 16);
  for (size_t i = 0; i < response.level.size(); i += stride) {
    std::snprintf(line, sizeof line, "%.4f   %.5f ± %.5f\n", response.level[i], response.light[i], response.sigma[i]);
    text += line;
  }
  std::snprintf(line, sizeof line, "\nbest-fit gamma %.3f, from %d pixels\n", response.gamma, response.pixels);
  text += line;
  if (!correction.offset_rad.empty()) {
    double largest = 0;
    for (const double offset : correction.offset_rad) largest = std::max(largest, std::abs(offset));
    std::snprintf(line, sizeof line, "phase error with %d steps: up to %.4f rad\n", correction.steps, largest);
    text += line;
  }
  return text;
}

cv::Mat3b picture_of(const Response& response) {
  Plot plot{{"projector input"}, {"light"}, {{{{0, 0}, {1, 1}}, {90, 90, 90}, 1}, {}}, {{}}};
  const double last = static_cast<double>(response.table.size() - 1);
  for (size_t i = 0; i < response.table.size(); ++i)
    plot.lines[1].points.emplace_back(static_cast<double>(i) / last, response.table[i]);
  for (size_t i = 0; i < response.level.size(); ++i)
    plot.marks[0].points.emplace_back(response.level[i], response.light[i]);
  plot.marks[0].sigma = response.sigma;
  return draw(plot);
}

// Returns the axes with at least two periods of equally spaced steps.
std::vector<Axis> axes_of_several_periods(const PatternSequence& sequence) {
  std::vector<Axis> axes;
  for (const Axis axis : {Axis::columns, Axis::rows}) {
    const std::vector<FringeGroup> groups = fringe_groups(sequence, axis);
    const bool even = std::all_of(groups.begin(), groups.end(),
                                  [](const FringeGroup& group) { return equally_spaced(group.shifts_rad); });
    if (groups.size() > 1 && even) axes.push_back(axis);
  }
  return axes;
}

// Measures the response by comparing the periods of one sequence, over all stacks, and corrects the phases of as many
// steps as the finest period has.
void calibrate_by_periods(const CalibrateResponseArguments& arguments, ReplayRig& replay,
                          const ResponseOptions& options, RigModel& rig, Response& response) {
  std::vector<PeriodDeviation> deviations;
  while (const auto stack = replay.capture(replay.sequence())) {
    for (const Axis axis : axes_of_several_periods(stack->patterns)) {
      for (PeriodDeviation& deviation : period_deviations(stack->images, stack->patterns, axis, rig.sensor, options))
        deviations.push_back(std::move(deviation));
    }
  }
  response = response_from_deviations(deviations, options);
  rig.projector_response = response.table;
  const Axis axis = axes_of_several_periods(replay.sequence()).front();
  const auto finest = static_cast<int>(fringe_groups(replay.sequence(), axis).back().images.size());
  rig.phase_correction = phase_correction_of(response.table, arguments.steps.value_or(finest));
}

int calibrate(const CalibrateResponseArguments& arguments, const Common& common) {
  ResponseSettings settings;
  apply_settings(settings, arguments.sets);
  ReplayRig replay(arguments.dataset);
  const PatternSequence& sequence = replay.sequence();
  if (has_exposures(sequence))
    throw Error(arguments.dataset +
                ": its patterns have several exposures, which look like phase steps; capture patterns at one exposure");
  const Ramp ramp = ramp_of(sequence);
  const std::optional<FringeGroup> fringes = many_steps(sequence);
  const bool by_periods = ramp.images.size() < 5 && !fringes;
  if (by_periods && axes_of_several_periods(sequence).empty())
    throw Error(arguments.dataset +
                ": contains neither a gray ramp of 5 levels or more nor 8 or more steps of a period, nor three or more "
                "steps of several periods, all equally spaced; render or capture patterns with `ramp_levels: 33`, "
                "`steps: 12` or `periods_px: [1040, 131, 16.5]`");
  if (!sequence.inverse_response.empty())
    throw Error(arguments.dataset +
                ": its patterns are already corrected by an inverse response; capture uncorrected ones");
  require_not_an_input(arguments.out, {arguments.dataset});
  StagedFolder folder(arguments.out, "response");
  RigModel rig = replay.model();
  Response response;
  try {
    if (by_periods) {
      calibrate_by_periods(arguments, replay, settings.response, rig, response);
    } else {
      const std::vector<cv::Mat1f> images = mean_images(replay);
      response = ramp.images.size() >= 5
                     ? response_from_ramp(pick(images, ramp.images), ramp.levels, rig.sensor, settings.response)
                     : response_from_fringes(pick(images, fringes->images), fringes->shifts_rad, rig.sensor,
                                             settings.response);
      rig.projector_response = response.table;
      rig.phase_correction = {};
      if (arguments.steps && !fringes)
        throw Error(
            "--steps: a phase correction needs fringes with 8 or more equally spaced steps; the dataset has none");
      // By default a correction for the papers' three steps, if their number divides that of the fringes' steps.
      if (arguments.steps || (fringes && fringes->images.size() % 3 == 0))
        rig.phase_correction =
            phase_correction_from_fringes(pick(images, fringes->images), fringes->shifts_rad,
                                          arguments.steps.value_or(3), rig.sensor, settings.response);
    }
  } catch (const Error& e) {
    throw Error(arguments.dataset + ": " + e.what());
  }
  write_text(folder.path() / "rig.yaml", to_yaml(rig));
  write_text(folder.path() / "response.json", json_text(to_json(response, rig.phase_correction), 2) + "\n");
  write_png(folder.path() / "response.png", picture_of(response));
  folder.commit();
  if (common.json)
    std::printf("%s\n", json_text(to_json(response, rig.phase_correction), 2).c_str());
  else
    std::printf("%s\nwritten: %s  (rig.yaml, response.json, response.png)\n",
                to_table(response, rig.phase_correction).c_str(), arguments.out.c_str());
  return 0;
}

}  // namespace

Verb add_calibrate_response(Command group, const Common& common) {
  auto arguments = std::make_shared<CalibrateResponseArguments>();
  const Command verb = group.add_subcommand("response", "Projector response, from a gray ramp or from fringes");
  verb.add_option("dataset", arguments->dataset,
                  "Dataset with flat patterns or 8 or more equally spaced steps of one period, of one view, or with "
                  "three or more of several periods")
      .required();
  verb.add_option("--out", arguments->out, "Folder for rig.yaml, response.json and response.png").required();
  verb.add_option(
          "--steps", arguments->steps,
          "Number of steps for the phase correction, a divisor of the fringes' steps (default: 3 if it divides)")
      .check_range(3, 1000);
  verb.add_option("--set", arguments->sets, "response.key=value (repeatable; listed below)");
  verb.footer(groups_help(ResponseSettings()));
  return [arguments, &common] { return calibrate(*arguments, common); };
}

}  // namespace fringeslam::tools
