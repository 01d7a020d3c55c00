// SPDX-License-Identifier: Apache-2.0
// fringeslam decode DATASET --out FOLDER: projector coordinates, phases and their uncertainties as images and arrays. No
// calibration is needed.
#include "core/decode/decode.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>
#include <numbers>

#include "core/io/files.h"
#include "core/io/json_text.h"
#include "core/io/npy.h"
#include "core/io/setting_groups.h"
#include "core/rig/dataset.h"
#include "tools/output_file.h"
#include "tools/progress.h"
#include "tools/verbs.h"

namespace fringeslam::tools {

namespace fs = std::filesystem;

namespace {

struct DecodeSettings {
  DecodeOptions decode;

  template <class Visit>
  void for_each_group(Visit&& visit) {
    visit("decode", decode);
  }
};

struct DecodeArguments {
  std::string dataset, out;
  std::vector<std::string> sets, formats = {"exr", "png", "npy", "csv"};
};

// An image to be written and what its values are.
struct Map {
  std::string name, unit;
  cv::Mat1f values;  // NaN: invalid
  double low, high;  // range of the 16-bit PNG
};

// 16 bits, 0 where invalid: value = low + (v - 1) (high - low) / 65534.
cv::Mat1w to_16_bits(const Map& map) {
  cv::Mat1w image(map.values.size());
  const double scale = 65534 / (map.high - map.low);
  for (int row = 0; row < image.rows; ++row) {
    for (int col = 0; col < image.cols; ++col) {
      const float value = map.values(row, col);
      image(row, col) = value == value ? cv::saturate_cast<uint16_t>(std::clamp(
                                             1 + (static_cast<double>(value) - map.low) * scale, 1.0, 65535.0))
                                       : uint16_t{0};
    }
  }
  return image;
}

// The axes that can be decoded. Throws Error if there are none.
std::vector<Axis> coded_axes(const PatternSequence& sequence) {
  std::vector<Axis> coded;
  for (const Axis axis : {Axis::columns, Axis::rows}) {
    if (codes_axis(sequence, axis)) coded.push_back(axis);
  }
  if (!coded.empty()) return coded;
  for (const Axis axis : {Axis::columns, Axis::rows}) require_decoder(sequence, axis);
  throw Error("its patterns code neither columns nor rows");
}

// Returns the options with which the axis can be decoded: as given, or, if no method yields absolute coordinates,
// relative phases along connected pixels.
DecodeOptions usable_options(const PatternSequence& sequence, const RigModel& rig, DecodeOptions options, Axis axis) {
  DecodeContext context;
  context.axis = axis;
  if (options.unwrapping != Unwrapping::automatic) return options;
  try {
    const Unwrapping method = resolve_unwrapping(sequence, rig, options, context);
    // The nominal geometry of an uncalibrated rig bounds nothing.
    if (rig.calibrated || method != Unwrapping::geometric) return options;
  } catch (const Error&) {
  }
  options.unwrapping = Unwrapping::spatial;
  options.spatial_reference = SpatialReference::none;
  return options;
}

struct DecodedAxis {
  Axis axis;
  DecodedStack decoded;
};

std::vector<Map> maps_of(const DecodedAxis& a, const PatternSequence& sequence, bool prefixed) {
  const DecodedStack& d = a.decoded;
  const std::string axis = a.axis == Axis::columns ? "column" : "row", prefix = prefixed ? axis + "_" : "";
  const double length = a.axis == Axis::columns ? sequence.width : sequence.height, pi = std::numbers::pi;
  double largest_phase = 2 * pi;
  std::vector<Map> maps = {{axis, "projector px, integer at pixel centers", d.coordinate_px, -0.5, length - 0.5},
                           {axis + "_sigma", "projector px, standard deviation", d.sigma_px, 0, 4},
                           {prefix + "modulation", "DN", d.modulation, 0, d.full_scale_dn}};
  if (d.finest_period_px > 0) maps.push_back({prefix + "wrapped_phase", "rad", d.wrapped_phase, -pi, pi});
  if (!d.relative_phase.empty()) {
    for (const float phase : d.relative_phase) {
      if (phase == phase) largest_phase = std::max(largest_phase, std::abs(static_cast<double>(phase)));
    }
    maps.push_back({prefix + "relative_phase", "rad, up to a multiple of 2 pi for each connected region",
                    d.relative_phase, -largest_phase, largest_phase});
  }
  return maps;
}

// Camera pixel, projector coordinates and their standard deviations, one line per pixel that has all of them.
std::string correspondences(const std::vector<DecodedAxis>& axes) {
  std::string text = "camera_x_px,camera_y_px";
  for (const DecodedAxis& a : axes) {
    const std::string name = a.axis == Axis::columns ? "projector_x" : "projector_y";
    text += "," + name + "_px," + name + "_sigma_px";
  }
  text += "\n";
  char number[64];
  const cv::Size size = axes[0].decoded.coordinate_px.size();
  for (int row = 0; row < size.height; ++row) {
    for (int col = 0; col < size.width; ++col) {
      bool valid = true;
      for (const DecodedAxis& a : axes) valid = valid && std::isfinite(a.decoded.coordinate_px(row, col));
      if (!valid) continue;
      text += std::to_string(col) + "," + std::to_string(row);
      for (const DecodedAxis& a : axes) {
        std::snprintf(number, sizeof number, ",%.4f,%.4f", static_cast<double>(a.decoded.coordinate_px(row, col)),
                      static_cast<double>(a.decoded.sigma_px(row, col)));
        text += number;
      }
      text += "\n";
    }
  }
  return text;
}

int64_t valid_pixels(const cv::Mat1f& values) {
  return std::count_if(values.begin(), values.end(), [](float v) { return v == v; });
}

int decode_dataset(const DecodeArguments& arguments, const Common& common) {
  DecodeSettings settings;
  apply_settings(settings, arguments.sets);
  const auto wants = [&](const char* format) {
    return std::find(arguments.formats.begin(), arguments.formats.end(), format) != arguments.formats.end();
  };
  ReplayRig replay(arguments.dataset);
  const PatternSequence& sequence = replay.sequence();
  std::vector<Axis> coded;
  try {
    coded = coded_axes(sequence);
  } catch (const Error& e) {
    throw Error(arguments.dataset + ": " + e.what());
  }
  require_not_an_input(arguments.out, {arguments.dataset});
  StagedFolder folder(arguments.out, "decoded");
  nlohmann::ordered_json stacks = nlohmann::ordered_json::array();
  {
    Progress progress("decoding", replay.info().stacks, common.quiet || common.json);
    while (const auto stack = replay.capture(sequence)) {
      const fs::path here = folder.path() / stack_name(stack->index);
      fs::create_directories(here);
      std::vector<DecodedAxis> axes;
      nlohmann::ordered_json entry = {{"index", stack->index}, {"timestamp_s", stack->timestamp_s}};
      nlohmann::ordered_json files;
      const auto write = [&](const Map& map) {
        if (wants("exr")) write_exr(here / (map.name + ".exr"), {{"Y", map.values}});
        if (wants("npy")) write_npy(here / (map.name + ".npy"), map.values);
        if (wants("png")) write_png(here / (map.name + ".png"), to_16_bits(map));
        files[map.name] = {{"unit", map.unit}, {"png_low", map.low}, {"png_high", map.high}};
      };
      for (const Axis axis : coded) {
        DecodeContext context;
        context.axis = axis;
        const DecodeOptions options = usable_options(sequence, replay.model(), settings.decode, axis);
        try {
          axes.push_back({axis, decode(*stack, replay.model(), options, context)});
        } catch (const Error& e) {
          throw Error(arguments.dataset + ": " + e.what());
        }
        for (const Map& map : maps_of(axes.back(), sequence, coded.size() > 1)) write(map);
        const DecodedStack& decoded = axes.back().decoded;
        entry[axis == Axis::columns ? "columns" : "rows"] = {{"unwrapping", to_string(*decoded.unwrapping)},
                                                             {"valid_pixels", valid_pixels(decoded.coordinate_px)}};
      }
      write({"texture", "DN, without the fringes", axes[0].decoded.mean, 0, axes[0].decoded.full_scale_dn});
      entry["images"] = std::move(files);
      if (wants("csv")) write_text(here / "correspondences.csv", correspondences(axes));
      stacks.push_back(std::move(entry));
      progress.step();
    }
  }
  const nlohmann::ordered_json document = {
      {"png", "16 bits, 0 where invalid: value = png_low + (v - 1) (png_high - png_low) / 65534"}, {"stacks", stacks}};
  write_text(folder.path() / "decoded.json", json_text(document, 2) + "\n");
  folder.commit();
  int64_t valid = 0;
  for (const auto& entry : stacks) {
    for (const char* axis : {"columns", "rows"}) {
      if (entry.contains(axis)) valid += entry[axis]["valid_pixels"].get<int64_t>();
    }
  }
  print_result(common, {{"decoded", arguments.out}, {"stacks", stacks}},
               "written: " + arguments.out + ": " + std::to_string(stacks.size()) + " stacks, " +
                   std::to_string(valid) + " coordinates");
  return 0;
}

}  // namespace

Verb add_decode(Command app, const Common& common) {
  auto arguments = std::make_shared<DecodeArguments>();
  const Command verb = app.add_subcommand(
      "decode", "Write projector coordinates, phases and uncertainties of a dataset as images and arrays");
  verb.add_option("dataset", arguments->dataset, "Dataset folder; its rig need not be calibrated").required();
  verb.add_option("--out", arguments->out, "Folder to write").required();
  verb.add_option("--format", arguments->formats,
                  "What to write: exr, png (16 bits), npy (NumPy), csv (correspondences); default: all (repeatable)")
      .check_one_of({"exr", "png", "npy", "csv"});
  verb.add_option("--set", arguments->sets, "decode.key=value (repeatable; listed below)");
  verb.footer(groups_help(DecodeSettings()));
  return [arguments, &common] { return decode_dataset(*arguments, common); };
}

}  // namespace fringeslam::tools
