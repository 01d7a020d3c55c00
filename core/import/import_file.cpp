// SPDX-License-Identifier: Apache-2.0
#include "core/import/import_file.h"

#include <fnmatch.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <map>
#include <numbers>
#include <optional>
#include <set>

#include "core/import/file_names.h"
#include "core/import/opencv_calibration.h"
#include "core/import/projected.h"
#include "core/io/input_file.h"
#include "core/io/yaml.h"
#include "core/patterns/design.h"
#include "core/patterns/long_run_code.h"
#include "core/patterns/waveform.h"
#include "core/rig/rig_file.h"
#include "core/types/fringe_stack.h"

namespace fringeslam {

namespace fs = std::filesystem;

namespace {

constexpr Range kImagePixels{1, 16384};
constexpr Range kImagePeriod{2, 1e5};
constexpr Range kImageCell{1, 1e5};  // OpenCV's Gray codes have cells of 1 px
constexpr Range kPhaseDegrees{-1e4, 1e4};
constexpr int kInverseEntries = 1025;
constexpr int kMostSteps = 1000, kMaxBits = 30, kMaxNumber = 1000000;

double radians(double degrees) { return degrees * std::numbers::pi / 180; }

// --- assignment of images to patterns ---

// One entry of `patterns:` and the images that it names, in order.
struct Entry {
  YamlMap map;
  bool single = false;  // `file` instead of `files`
  std::vector<Pattern> patterns;
  std::vector<std::string> files;
  std::vector<double> inverse_response;  // from `sequence`
  double offset_rad = 0;                 // phase shift of step 0 of `fringe`
  std::vector<fs::path> projected = {};  // what the images show, to be recognized
};

std::vector<std::string> entry_files(const Entry& entry) {
  const size_t count = entry.patterns.size();
  if (entry.single && count != 1)
    throw entry.map.error(
        "file", "'file' is one image, but the entry describes " + std::to_string(count) + " patterns; use `files`");
  if (entry.single) return {entry.map.text("file")};
  std::vector<std::string> files = entry.map.texts("files");
  if (is_numbered(files)) {
    const std::string format = files[0];
    const int first = entry.map.integer_or("first", 0, {0, kMaxNumber});
    files.clear();
    for (size_t i = 0; i < count; ++i)
      files.push_back(numbered(entry.map, "files", format, first + static_cast<int>(i)));
  }
  if (files.size() != count)
    throw entry.map.error("files",
                          "'files' lists " + std::to_string(files.size()) + " image" + (files.size() == 1 ? "" : "s") +
                              ", but the entry describes " + std::to_string(count) +
                              " patterns; list one image per pattern, or use a name with a number field such as %02d");
  return files;
}

double read_period(const YamlMap& map, int length_px, const Range& range) {
  if (!map.has("number_of_periods")) return map.number("period_px", range);
  if (map.has("period_px")) throw map.error("number_of_periods", "specify period_px or number_of_periods, not both");
  const double period = length_px / map.number("number_of_periods", {1e-3, 1e4});
  if (!range.contains(period)) throw map.error("number_of_periods", range_error("the period", period, range));
  return period;
}

// Phase offset from the other rig's convention to the one used here (see the header); `key`: the offset at u' = 0.
double phase_offset_rad(const YamlMap& map, double period_px, const std::string& key = "phase_offset_deg") {
  double offset_deg = map.number_or(key, 0, kPhaseDegrees);
  if (map.has("wave") && map.choice("wave", {"cos", "sin"}) == "sin") offset_deg -= 90;
  const bool at_edge =
      map.has("coordinate_origin") && map.choice("coordinate_origin", {"pixel_centre", "pixel_edge"}) == "pixel_edge";
  if (!at_edge) offset_deg -= 180 / period_px;
  return radians(offset_deg);
}

double read_shift_sign(const YamlMap& map) {
  const double sign = map.has("shift_sign") ? map.number("shift_sign", {-1, 1}) : 1;
  if (std::abs(sign) != 1) throw map.error("shift_sign", "'shift_sign' is 1 or -1");
  return sign;
}

std::vector<double> read_shifts_deg(const YamlMap& map, bool single) {
  const double sign = read_shift_sign(map);
  if (map.has("shift_deg")) {
    std::vector<double> shifts =
        single ? std::vector{map.number("shift_deg", kPhaseDegrees)} : map.numbers("shift_deg", 0, kPhaseDegrees);
    for (double& shift : shifts) shift *= sign;
    return shifts;
  }
  const int steps = map.integer(single ? "of" : "steps", {3, kMostSteps});
  const double step_deg = sign * map.number_or("shift_step_deg", 360.0 / steps, kPhaseDegrees);
  if (single) return {step_deg * map.integer("step", {0, kMostSteps})};
  std::vector<double> shifts;
  for (int k = 0; k < steps; ++k) shifts.push_back(k * step_deg);
  return shifts;
}

std::vector<Pattern> read_fringe(const YamlMap& map, bool single, const cv::Size& projector, double& offset_rad) {
  Pattern pattern;
  pattern.axis = map.choice<Axis>("axis");
  pattern.period_px =
      read_period(map, pattern.axis == Axis::columns ? projector.width : projector.height, kImagePeriod);
  offset_rad = phase_offset_rad(map, pattern.period_px);
  std::vector<Pattern> patterns;
  for (const double shift_deg : read_shifts_deg(map, single)) {
    pattern.shift_rad = std::remainder(offset_rad + radians(shift_deg), 2 * std::numbers::pi);
    patterns.push_back(pattern);
  }
  return patterns;
}

double wrapped_rad(double angle_rad) { return std::remainder(angle_rad, 2 * std::numbers::pi); }

// One image for each period; `periods_px` instead of `period_px` lists several.
std::vector<Pattern> read_extra(const YamlMap& map, bool single, const cv::Size& projector) {
  Pattern pattern;
  pattern.coding = Coding::extra;
  pattern.axis = map.choice<Axis>("axis");
  const int length_px = pattern.axis == Axis::columns ? projector.width : projector.height;
  const double shift_deg = read_shift_sign(map) * map.number_or("shift_deg", 0, kPhaseDegrees);
  const bool several = !single && map.has("periods_px");
  std::vector<Pattern> patterns;
  for (const double period_px :
       several ? map.numbers("periods_px", 0, kImagePeriod) : std::vector{read_period(map, length_px, kImagePeriod)}) {
    pattern.period_px = period_px;
    pattern.shift_rad = wrapped_rad(phase_offset_rad(map, period_px) + radians(shift_deg));
    patterns.push_back(pattern);
  }
  return patterns;
}

// Phase shifts of one cosine of a product: listed, or equal steps of a turn.
std::vector<double> read_product_shifts_deg(const YamlMap& map, bool single, const std::string& prefix) {
  constexpr int kMaxProductSteps = 64;
  const double sign = read_shift_sign(map);
  const std::string key = prefix + "shift_deg";
  if (single) return {sign * map.number_or(key, 0, kPhaseDegrees)};
  std::vector<double> shifts;
  if (map.has(key)) {
    for (const double shift : map.numbers(key, 0, kPhaseDegrees)) shifts.push_back(sign * shift);
    return shifts;
  }
  const int steps = map.integer(prefix + "steps", {1, kMaxProductSteps});
  for (int k = 0; k < steps; ++k) shifts.push_back(sign * k * 360 / steps);
  return shifts;
}

// Two lists of shifts are those of each image; steps are combined, the carrier's first.
std::vector<Pattern> read_product(const YamlMap& map, bool single, const cv::Size& projector) {
  Pattern pattern;
  pattern.coding = Coding::product;
  pattern.axis = map.choice<Axis>("axis");
  const int length_px = pattern.axis == Axis::columns ? projector.width : projector.height;
  pattern.period_px = read_period(map, length_px, kImagePeriod);
  pattern.carrier_px = map.number("carrier_px", kImagePeriod);
  const double offset_rad = phase_offset_rad(map, pattern.period_px),
               carrier_offset_rad = phase_offset_rad(map, pattern.carrier_px, "carrier_offset_deg");
  const std::vector<double> shifts = read_product_shifts_deg(map, single, ""),
                            carrier_shifts = read_product_shifts_deg(map, single, "carrier_");
  const bool paired = !single && map.has("shift_deg") && map.has("carrier_shift_deg");
  if (paired && shifts.size() != carrier_shifts.size())
    throw map.error("carrier_shift_deg", "'shift_deg' lists " + std::to_string(shifts.size()) +
                                             " shifts and 'carrier_shift_deg' " +
                                             std::to_string(carrier_shifts.size()) + "; list one of each per image");
  std::vector<Pattern> patterns;
  for (size_t i = 0; i < shifts.size(); ++i) {
    for (size_t k = paired ? i : 0; k < (paired ? i + 1 : carrier_shifts.size()); ++k) {
      pattern.shift_rad = wrapped_rad(offset_rad + radians(shifts[i]));
      pattern.carrier_shift_rad = wrapped_rad(carrier_offset_rad + radians(carrier_shifts[k]));
      patterns.push_back(pattern);
    }
  }
  return patterns;
}

// Coarsest bit first.
std::vector<double> read_cells(const YamlMap& map, bool single, double period_px, int length_px) {
  // Bit 0 changes from period to period; bit -1, the complementary bit, from half period to half period.
  if (single) return {period_px * std::exp2(map.integer("bit", {-1, kMaxBits}))};
  const int needed = std::max(1, static_cast<int>(std::ceil(std::log2(length_px / period_px) - 1e-9)));
  const int bits = map.integer_or("bits", needed, {1, kMaxBits});
  const bool complementary = map.boolean_or("complementary", false);
  std::vector<double> cells;
  for (int bit = bits - 1; bit >= (complementary ? -1 : 0); --bit) cells.push_back(period_px * std::exp2(bit));
  return cells;
}

// Coarsest bit first.
std::vector<Pattern> read_reflected_bits(const YamlMap& map, bool single, Axis axis, double period_px, int length_px) {
  const double carrier_px = map.has("xor_px") ? 0.5 * map.number("xor_px", kImageCell) : 0;
  std::vector<Pattern> bits;
  for (const double cell : read_cells(map, single, period_px, length_px)) {
    Pattern bit{.axis = axis, .period_px = cell, .coding = Coding::gray};
    if (cell > carrier_px) bit.carrier_px = carrier_px;
    bits.push_back(bit);
  }
  return bits;
}

// Bits of a code with long runs, whose cells have the width `cell_px`; first bit first.
std::vector<Pattern> read_long_run_bits(const YamlMap& map, bool single, Axis axis, double cell_px, int length_px) {
  std::vector<Pattern> bits = long_run_patterns(axis, cell_px, length_px, 8);
  if (!single) return bits;
  return {bits[static_cast<size_t>(map.integer("bit", {0, static_cast<double>(bits.size()) - 1}))]};
}

std::vector<Pattern> read_gray(const YamlMap& map, bool single, const cv::Size& projector) {
  const auto axis = map.choice<Axis>("axis");
  const int length_px = axis == Axis::columns ? projector.width : projector.height;
  const double period_px = read_period(map, length_px, kImageCell);
  std::vector<Pattern> bits = map.boolean_or("long_runs", false)
                                  ? read_long_run_bits(map, single, axis, period_px, length_px)
                                  : read_reflected_bits(map, single, axis, period_px, length_px);
  const bool inverted = !map.boolean_or("bright_is_one", true);
  std::string inverse = "none";
  if (!single) {
    if (map.has("order") && map.choice("order", {"msb_first", "lsb_first"}) == "lsb_first")
      std::reverse(bits.begin(), bits.end());
    if (map.has("inverse")) inverse = map.choice("inverse", {"none", "after_each", "after_all"});
  }
  std::vector<Pattern> patterns;
  const auto add = [&](Pattern bit, bool is_inverted) {
    bit.inverted = is_inverted;
    patterns.push_back(bit);
  };
  for (const Pattern& bit : bits) {
    add(bit, inverted);
    if (inverse == "after_each") add(bit, !inverted);
  }
  if (inverse == "after_all") {
    for (const Pattern& bit : bits) add(bit, !inverted);
  }
  return patterns;
}

Pattern flat(double level) {
  Pattern pattern;
  pattern.coding = Coding::flat;
  pattern.level = level;
  return pattern;
}

// Reads a patterns.yaml written by `fringeslam patterns`.
PatternSequence read_sequence(const YamlMap& map, const cv::Size& projector) {
  const PatternSequence sequence = read_patterns(map.path("sequence"));
  if (sequence.width != projector.width || sequence.height != projector.height)
    throw map.error("sequence", map.text("sequence") + " is for a projector of " + std::to_string(sequence.width) +
                                    "x" + std::to_string(sequence.height) + " px, but this one has " +
                                    std::to_string(projector.width) + "x" + std::to_string(projector.height));
  return sequence;
}

std::vector<Pattern> read_coding(const YamlMap& map, bool single, const cv::Size& projector, double& offset_rad) {
  const bool white = map.boolean_or("white", false), black = map.boolean_or("black", false);
  if (map.has("fringe") + map.has("gray") + map.has("flat") + map.has("extra") + map.has("product") + white + black !=
      1)
    throw map.error(
        "an entry of patterns must have exactly one of fringe, gray, flat, white: true, black: true, extra, product, "
        "projected and sequence");
  if (map.has("fringe")) return read_fringe(map.map("fringe"), single, projector, offset_rad);
  if (map.has("gray")) return read_gray(map.map("gray"), single, projector);
  if (map.has("extra")) return read_extra(map.map("extra"), single, projector);
  if (map.has("product")) return read_product(map.map("product"), single, projector);
  if (white || black) return {flat(white ? 1 : 0)};
  if (single) return {flat(map.number("flat", {0, 1}))};
  std::vector<Pattern> patterns;
  for (const double level : map.numbers("flat", 0, {0, 1})) patterns.push_back(flat(level));
  return patterns;
}

// Exposures of the images of an entry relative to `exposure_s`: of a file, or several of each pattern, which vary fastest.
std::vector<Pattern> exposed(const std::vector<Pattern>& patterns, const YamlMap& entry) {
  constexpr Range kExposure{1e-4, 1e4};
  if (!entry.has("exposures")) {
    std::vector<Pattern> all = patterns;
    for (Pattern& pattern : all) pattern.exposure = entry.number_or("exposure", pattern.exposure, kExposure);
    return all;
  }
  if (entry.has("exposure")) throw entry.error("exposures", "give either 'exposure' or 'exposures'");
  if (entry.has("file")) throw entry.error("exposures", "'file' is one image; use 'exposure', or 'files'");
  if (has_exposures({0, 0, patterns, {}}))
    throw entry.error("exposures", "the patterns of this entry have exposures already; remove 'exposures'");
  const std::vector<double> exposures = entry.numbers("exposures", 0, kExposure);
  try {
    return at_exposures(patterns, exposures);
  } catch (const Error& e) {
    throw entry.error("exposures", e.what());
  }
}

std::vector<Entry> read_entries(const YamlMap& map, const cv::Size& projector, const fs::path& folder) {
  std::vector<Entry> entries;
  for (const YamlMap& line : map.maps("patterns")) {
    Entry entry{line, line.has("file"), {}, {}, {}, 0};
    if (entry.single == line.has("files"))
      throw line.error("an entry of patterns needs either `file` for one image or `files` for several, not both");
    if (!entry.single && line.has("sequence")) {
      PatternSequence sequence = read_sequence(line, projector);
      entry.patterns = std::move(sequence.patterns);
      entry.inverse_response = std::move(sequence.inverse_response);
    } else if (line.has("projected")) {
      for (const char* other : {"fringe", "gray", "flat", "white", "black", "extra", "product", "sequence"}) {
        if (line.has(other))
          throw line.error(other,
                           "'projected' gives the patterns of this entry; remove it or '" + std::string(other) + "'");
      }
      entry.projected = projected_files(line, folder);
      for (const fs::path& file : entry.projected) line.note_file(file);
      entry.patterns.resize(entry.projected.size());
    } else {
      entry.patterns = read_coding(line, entry.single, projector, entry.offset_rad);
    }
    if (line.has("projected") && line.has("exposures"))
      throw line.error("exposures",
                       "'projected' names one image each; list the exposures of one at a time by 'exposure'");
    entry.patterns = exposed(entry.patterns, line);
    entry.files = entry_files(entry);
    entries.push_back(std::move(entry));
  }
  if (entries.empty()) throw map.error("patterns", "'patterns' is empty; specify which file shows which pattern");
  return entries;
}

// Recognizes what the images of `projected` show.
void recognize_entries(std::vector<Entry>& entries, const cv::Size& projector) {
  std::vector<RecognizedPattern> recognized;
  std::vector<Pattern> described;
  for (const Entry& entry : entries) {
    if (entry.projected.empty()) described.insert(described.end(), entry.patterns.begin(), entry.patterns.end());
    for (const fs::path& file : entry.projected) recognized.push_back(recognize_file(entry.map, file, projector));
  }
  reconcile_patterns(recognized, described, projector);
  auto next = recognized.begin();
  for (Entry& entry : entries) {
    if (entry.projected.empty()) continue;
    for (Pattern& pattern : entry.patterns) {
      const double exposure = pattern.exposure;
      pattern = (next++)->pattern;
      pattern.exposure = exposure;
    }
  }
}

PatternSequence sequence_of(const std::vector<Entry>& entries, const cv::Size& projector, const YamlMap& map) {
  PatternSequence sequence{projector.width, projector.height, {}};
  std::map<std::string, int> users;
  for (const Entry& entry : entries) {
    if (!entry.inverse_response.empty()) sequence.inverse_response = entry.inverse_response;
    for (const std::string& file : entry.files) {
      if (++users[fs::path(file).lexically_normal().string()] > 1)
        throw entry.map.error(entry.single ? "file" : "files", file + " is used twice; each image shows one pattern");
    }
    for (const Pattern& pattern : entry.patterns) {
      const bool known =
          std::find(sequence.patterns.begin(), sequence.patterns.end(), pattern) != sequence.patterns.end();
      if (known && pattern.coding != Coding::flat)
        throw entry.map.error("this pattern is a duplicate of an earlier one; specify how they differ");
      sequence.patterns.push_back(pattern);
    }
  }
  try {
    for (const Axis axis : {Axis::columns, Axis::rows}) fringe_groups(sequence, axis);
  } catch (const Error& e) {
    throw map.error("patterns", e.what());
  }
  return sequence;
}

// --- image files ---

std::vector<std::string> matching_folders(const fs::path& folder, const std::string& glob) {
  std::vector<std::string> names;
  for (const auto& entry : fs::directory_iterator(folder)) {
    const std::string name = entry.path().filename().string();
    if (entry.is_directory() && fnmatch(glob.c_str(), name.c_str(), FNM_PERIOD) == 0) names.push_back(name);
  }
  std::sort(names.begin(), names.end(), natural_order_less);
  return names;
}

std::vector<fs::path> stack_folders(const YamlMap& map, const fs::path& folder) {
  if (!map.has("stacks")) return {folder};
  std::vector<std::string> names = map.texts("stacks");
  const bool is_glob = names.size() == 1 && names[0].find_first_of("*?[") != std::string::npos;
  if (is_glob) names = matching_folders(folder, names[0]);
  if (names.empty())
    throw map.error("stacks", folder.string() + " has no folder that matches '" + map.text("stacks") + "'");
  std::vector<fs::path> folders;
  for (const std::string& name : names) {
    if (!fs::is_directory(folder / name)) throw map.error("stacks", (folder / name).string() + " is not a folder");
    if (std::find(folders.begin(), folders.end(), folder / name) != folders.end())
      throw map.error("stacks", name + " is listed twice");
    folders.push_back(folder / name);
  }
  return folders;
}

std::vector<fs::path> images_of(const fs::path& stack, const std::vector<Entry>& entries) {
  std::vector<fs::path> images;
  for (const Entry& entry : entries) {
    for (const std::string& file : entry.files) {
      if (!fs::is_regular_file(stack / file))
        throw entry.map.error(entry.single ? "file" : "files", (stack / file).string() + " is missing");
      images.push_back(stack / file);
    }
  }
  return images;
}

// Throws Error for images that no entry names: they more likely indicate a mistake in the file than unrelated images.
void check_unused_images(const fs::path& stack, const std::vector<fs::path>& used,
                         const std::vector<std::string>& ignored, const YamlMap& map) {
  constexpr size_t kShown = 5;
  std::vector<std::string> unused;
  for (const auto& entry : fs::directory_iterator(stack)) {
    const std::string name = entry.path().filename().string();
    const bool wanted = !entry.is_regular_file() || !is_image(entry.path()) ||
                        std::any_of(used.begin(), used.end(),
                                    [&](const fs::path& file) { return fs::equivalent(file, entry.path()); }) ||
                        std::any_of(ignored.begin(), ignored.end(), [&](const std::string& glob) {
                          return fnmatch(glob.c_str(), name.c_str(), 0) == 0;
                        });
    if (!wanted) unused.push_back(name);
  }
  if (unused.empty()) return;
  std::sort(unused.begin(), unused.end(), natural_order_less);
  std::string list;
  for (size_t i = 0; i < std::min(kShown, unused.size()); ++i) list += (i ? ", " : "") + unused[i];
  if (unused.size() > kShown) list += " and " + std::to_string(unused.size() - kShown) + " more";
  throw map.error("patterns", stack.string() + " has images that no entry uses: " + list +
                                  "; describe them, or add `ignore: [...]` with their names or globs");
}

// --- the rig ---

// Looks for the file next to the YAML file and then among the images.
fs::path calibration_file(const YamlMap& map, const std::string& name, const fs::path& folder) {
  for (const fs::path& candidate : {map.folder() / name, folder / name}) {
    if (!fs::is_regular_file(candidate)) continue;
    map.note_file(candidate);
    return candidate;
  }
  throw map.error("file", name + " is neither next to this file nor in " + folder.string());
}

CalibrationFiles read_calibration_section(const YamlMap& map, const fs::path& folder) {
  CalibrationFiles source;
  for (const std::string& name : map.texts("file")) source.files.push_back(calibration_file(map, name, folder));
  CalibrationNames& names = source.names;
  for (const auto& [key, name] :
       {std::pair("camera_matrix", &names.camera_matrix), std::pair("camera_distortion", &names.camera_distortion),
        std::pair("projector_matrix", &names.projector_matrix),
        std::pair("projector_distortion", &names.projector_distortion), std::pair("rotation", &names.rotation),
        std::pair("translation", &names.translation), std::pair("camera_size", &names.camera_size),
        std::pair("projector_size", &names.projector_size)})
    *name = map.text_or(key, "");
  if (map.has("direction"))
    source.projector_from_camera =
        map.choice("direction", {"projector_from_camera", "camera_from_projector"}) == "projector_from_camera";
  // OpenCV files do not state their length unit.
  source.unit_m = map.number("unit_m", {1e-6, 1e3});
  return source;
}

// The response of the projector to the patterns' ideal light, and the phase correction that it requires.
struct Waveform {
  std::vector<double> response, inverse_response;
  bool linear = true;
};

// Combines the projector's response with the distortion that was applied to the patterns beforehand. If together they
// are linear, the patterns need no correction. Otherwise the fringes are described as ideal ones behind the combination.
Waveform read_waveform(const YamlMap& section) {
  constexpr double kNegligible_rad = 1e-3;  // phase error of three steps
  Waveform waveform;
  waveform.response = read_response(section, "response");
  if (section.has("pre_distortion")) {
    const YamlMap distortion = section.map("pre_distortion");
    waveform.inverse_response = distortion.has("gamma")
                                    ? gamma_table(1 / distortion.number("gamma", {0.2, 5}), kInverseEntries)
                                    : read_response(distortion, "table");
    if (waveform.inverse_response.empty())
      throw section.error("pre_distortion",
                          "'pre_distortion' needs gamma: (level = light^(1/gamma)) or table: (levels "
                          "at equally spaced light from 0 to 1)");
    // Without a stated response, the distortion is taken to linearize the projector.
    if (waveform.response.empty()) waveform.response = invert_table(waveform.inverse_response, kInverseEntries);
  }
  const std::vector<double> total = composed_table(waveform.response, waveform.inverse_response);
  waveform.linear = largest_offset_rad(phase_correction_of(total, 3)) < kNegligible_rad;
  if (!waveform.linear) waveform = {total, {}, false};
  return waveform;
}

Waveform read_projector(const YamlMap& map, Pinhole& projector) {
  if (!map.has("projector")) {
    if (projector.width == 0)
      throw map.error("'projector' is missing; add `projector: {width_px: ..., height_px: ...}`");
    return {};
  }
  const YamlMap section = map.map("projector");
  if (projector.width > 0 && !section.has("width_px") && !section.has("height_px")) return read_waveform(section);
  const int width = section.integer("width_px", kImagePixels), height = section.integer("height_px", kImagePixels);
  if (projector.width > 0 && (projector.width != width || projector.height != height))
    throw map.error("projector", "the calibration is for a projector of " + std::to_string(projector.width) + "x" +
                                     std::to_string(projector.height) + " px");
  projector.width = width, projector.height = height;
  return read_waveform(section);
}

RigModel read_rig_parts(const YamlMap& map, const std::string& name, const fs::path& folder, Waveform& waveform) {
  RigModel rig;
  rig.name = name;
  rig.near_m = map.number_or("near_m", 0.3, {0.01, 100});
  rig.far_m = map.number_or("far_m", 3, {0.01, 100});
  if (rig.far_m <= rig.near_m) throw map.error("far_m", "far_m must be larger than near_m");
  rig.calibrated = map.has("calibration");
  if (rig.calibrated) {
    const RigCalibration calibration =
        read_opencv_calibration(read_calibration_section(map.map("calibration"), folder));
    rig.camera = calibration.camera;
    rig.projector = calibration.projector;
    rig.projector_from_camera = calibration.projector_from_camera;
  }
  waveform = read_projector(map, rig.projector);
  return rig;
}

// `noise: measured | default | FILE`.
void read_noise_source(const YamlMap& map, const fs::path& folder, ImportCamera& camera) {
  const bool described = camera.gain_dn_per_electron >= 0 || camera.dark_noise_electrons >= 0;
  if (!map.has("noise")) {
    if (described) camera.noise = NoiseSource::defaults;
    return;
  }
  const std::string source = map.text("noise");
  if (source == "default") {
    camera.noise = NoiseSource::defaults;
    return;
  }
  if (described)
    throw map.error(
        "noise", "specify either gain_dn_per_electron and dark_noise_electrons or `noise: " + source + "`, not both");
  if (source == "measured") {
    camera.noise = NoiseSource::measured;
    return;
  }
  camera.noise = NoiseSource::file;
  for (const fs::path& candidate : {map.folder() / source, folder / source}) {
    if (camera.noise_file.empty() && fs::is_regular_file(candidate)) camera.noise_file = candidate;
  }
  if (camera.noise_file.empty())
    throw map.error("noise", "'noise' must be measured, default or a rig.yaml file; " + source +
                                 " is neither next to this file nor in " + folder.string());
  map.note_file(camera.noise_file);
}

ImportCamera read_camera(const YamlMap& map, const fs::path& folder) {
  ImportCamera camera;
  if (map.has("bits")) camera.bits = map.integer("bits", {8, 16});
  camera.msb_aligned = map.boolean_or("msb_aligned", false);
  if (camera.msb_aligned && camera.bits == 0) throw map.error("msb_aligned", "'msb_aligned' needs `bits`");
  camera.grey_from = map.choice_or("channel", camera.grey_from);
  camera.gain_dn_per_electron = map.number_or("gain_dn_per_electron", -1, {1e-6, 1e3});
  camera.dark_noise_electrons = map.number_or("dark_noise_electrons", -1, {0, 1e5});
  camera.full_well_electrons = map.number_or("full_well_electrons", -1, {1, 1e9});
  camera.offset_dn = map.number_or("offset_dn", -1, {0, 3e4});
  read_noise_source(map, folder, camera);
  return camera;
}

std::string read_board(const YamlMap& map) {
  const std::string kind = map.choice("kind", {"checkerboard", "circles", "asymmetric_circles", "charuco"});
  const int columns = map.integer("columns", {3, 1000}), rows = map.integer("rows", {3, 1000});
  const double spacing_m = map.number("spacing_m", {1e-5, 100});
  std::string text = "kind: " + kind + "\ncolumns: " + std::to_string(columns) + "\nrows: " + std::to_string(rows) +
                     "\nspacing_m: " + to_text(spacing_m) + "\n";
  const auto add_smaller = [&](const char* key) {
    const double size_m = map.number(key, {1e-5, 100});
    if (size_m >= spacing_m) throw map.error(key, std::string(key) + " must be less than spacing_m");
    text += std::string(key) + ": " + to_text(size_m) + "\n";
  };
  if (kind == "charuco") {
    add_smaller("marker_m");
    const int markers = map.integer_or("markers", 50, {50, 1000});
    if (markers != 50 && markers != 100 && markers != 250 && markers != 1000)
      throw map.error("markers", "'markers' is the size of the dictionary: 50, 100, 250 or 1000");
    text += "marker_bits: " + std::to_string(map.integer_or("marker_bits", 4, {4, 7})) +
            "\nmarkers: " + std::to_string(markers) + "\n";
  } else if (kind != "checkerboard" && map.has("diameter_m")) {
    add_smaller("diameter_m");
  }
  return text;
}

// Each pattern is shown while one image is taken.
void set_image_interval(double interval_s, ImportPlan& plan) {
  plan.rig.timing.camera_rate_hz = plan.rig.timing.pattern_rate_hz = 1 / interval_s;
  plan.rig.timing.exposure_s = std::min(plan.rig.timing.exposure_s, interval_s);
}

// Reads `image_interval_s` and returns the name of `image_times`; empty if there is none.
std::string read_image_timing(const YamlMap& map, ImportPlan& plan) {
  const std::string file = map.text_or("image_times", "");
  if (!map.has("image_interval_s")) return file;
  if (!file.empty()) throw map.error("image_interval_s", "specify image_interval_s or image_times, not both");
  plan.image_interval_s = map.number("image_interval_s", {1e-5, 100});
  set_image_interval(plan.image_interval_s, plan);
  return file;
}

// A camera takes the images of a stack one after another, and its stacks too.
void check_image_interval(const YamlMap& map, bool interval_is_set, bool exposure_is_set, ImportPlan& plan) {
  if (plan.image_interval_s <= 0) return;
  constexpr double kRounding = 1 + 1e-9;
  if (exposure_is_set && plan.exposure_s > kRounding * plan.image_interval_s)
    throw map.error("exposure_s", "exposure_s exceeds image_interval_s; both are in seconds");
  const double duration_s = static_cast<double>(plan.sequence.patterns.size()) * plan.image_interval_s;
  if (interval_is_set && duration_s > kRounding * plan.interval_s)
    throw map.error("interval_s", "the stacks overlap: " + std::to_string(plan.sequence.patterns.size()) +
                                      " images at image_interval_s take " + to_text(duration_s) +
                                      " s, more than interval_s; both are in seconds");
  plan.interval_s = std::max(plan.interval_s, duration_s);
}

// Reads a text file: the middle of each exposure in seconds, in the order of the patterns. All stacks count from the same
// origin, so each is later than the one before.
std::vector<double> read_image_times(const fs::path& file, const ImportPlan& plan) {
  std::istringstream text(read_input(file));
  constexpr double kLatest_s = 1e12;  // as in dataset.yaml
  std::vector<double> times_s;
  for (std::string word; text >> word;) {
    char* end = nullptr;
    const double time_s = std::strtod(word.c_str(), &end);
    if (end != word.c_str() + word.size() || !(time_s >= 0 && time_s <= kLatest_s))
      throw Error(file.string() + ": '" + word +
                  "' is no time from 0 to 1e12 s; list one number per image, in seconds");
    times_s.push_back(time_s);
  }
  if (times_s.size() != plan.sequence.patterns.size())
    throw Error(file.string() + ": lists " + std::to_string(times_s.size()) + " times for " +
                std::to_string(plan.sequence.patterns.size()) + " images; list one number per image");
  std::vector<double> sorted_s = times_s;
  std::sort(sorted_s.begin(), sorted_s.end());
  if (!plan.image_times_s.empty() &&
      !(sorted_s.front() > *std::max_element(plan.image_times_s.back().begin(), plan.image_times_s.back().end())))
    throw Error(file.string() +
                ": is not later than the stack before it; count the times of all stacks from the same origin, and list "
                "the stacks in the order of time");
  if (std::adjacent_find(sorted_s.begin(), sorted_s.end()) != sorted_s.end())
    throw Error(file.string() + ": two images have the same time; correct the times");
  return times_s;
}

// Median time between images that follow each other. Throws Error if no camera is that slow.
double median_interval_s(std::vector<double> times_s, const fs::path& file) {
  std::sort(times_s.begin(), times_s.end());
  std::vector<double> intervals_s;
  for (size_t i = 1; i < times_s.size(); ++i) intervals_s.push_back(times_s[i] - times_s[i - 1]);
  std::sort(intervals_s.begin(), intervals_s.end());
  const double median_s = intervals_s[intervals_s.size() / 2];
  constexpr double kLongest_s = 100;  // as image_interval_s
  if (median_s > kLongest_s)
    throw Error(file.string() + ": the median time between images is " + to_text(median_s) + " s, more than " +
                to_text(kLongest_s) + " s; list the times in seconds");
  return median_s;
}

// The correction belongs to the number of steps of the finest period.
void apply(const Waveform& waveform, ImportPlan& plan) {
  plan.rig.projector_response = waveform.response;
  if (!waveform.inverse_response.empty()) plan.sequence.inverse_response = waveform.inverse_response;
  if (waveform.linear) return;
  // Images of a pattern at several exposures are combined before phases are computed.
  const PatternSequence combined = has_exposures(plan.sequence) ? at_one_exposure(plan.sequence) : plan.sequence;
  for (const Axis axis : {Axis::rows, Axis::columns}) {
    const std::vector<FringeGroup> groups = fringe_groups(combined, axis);
    if (!groups.empty())
      plan.rig.phase_correction =
          phase_correction_of(waveform.response, static_cast<int>(groups.back().shifts_rad.size()));
  }
}

BagSelection bag_selection(const YamlMap& map) {
  if (!map.has("bag"))
    throw map.error(
        "'bag' is missing; add `bag: {images_per_stack: N}`, the number of images of each pass through the "
        "patterns");
  const YamlMap section = map.map("bag");
  BagSelection selection;
  selection.topic = section.text_or("topic", "");
  selection.first = section.integer_or("first", 0, {0, 1e9});
  selection.per_stack = section.integer("images_per_stack", {1, kMaxNumber});
  selection.stacks = section.integer_or("stacks", 0, {0, kMaxNumber});
  return selection;
}

// Stacks and times of a bag are in its own section.
std::string read_bag_stacks(const YamlMap& map, const fs::path& folder, std::vector<fs::path>& stacks) {
  bag_selection(map);
  for (const char* key : {"stacks", "image_times", "image_interval_s", "interval_s"}) {
    if (map.has(key))
      throw map.error(key,
                      "'" + std::string(key) + "' has no effect on a ROS bag, whose messages have times; remove it");
  }
  for (const std::string& name : matching_folders(folder, "*")) stacks.push_back(folder / name);
  return kBagTimesFile;
}

}  // namespace

BagSelection read_bag_selection(const fs::path& config) { return bag_selection(YamlMap::load(config)); }

ImportPlan read_import(const fs::path& config, const fs::path& folder, bool unpacked_bag) {
  if (!fs::is_directory(folder)) throw Error(folder.string() + ": is not a folder; specify the folder with the images");
  const YamlMap map = YamlMap::load(config);
  ImportPlan plan;
  plan.config = config;
  Waveform waveform;
  plan.rig = read_rig_parts(map, map.text("name"), folder, waveform);
  if (map.has("camera")) plan.camera = read_camera(map.map("camera"), folder);
  plan.interval_s = map.number_or("interval_s", plan.interval_s, {1e-6, 1e6});
  std::vector<fs::path> stacks;
  const std::string image_times = unpacked_bag ? read_bag_stacks(map, folder, stacks) : read_image_timing(map, plan);
  if (!unpacked_bag && map.has("bag"))
    throw map.error("bag", "'bag' needs a ROS bag, but " + folder.string() + " is a folder");
  plan.exposure_s = map.number_or("exposure_s", plan.exposure_s, {1e-9, 1e3});
  if (map.has("board")) plan.board_yaml = read_board(map.map("board"));
  const cv::Size projector(plan.rig.projector.width, plan.rig.projector.height);
  std::vector<Entry> entries = read_entries(map, projector, folder);
  const std::vector<std::string> ignored = map.has("ignore") ? map.texts("ignore") : std::vector<std::string>{};
  if (!unpacked_bag) stacks = stack_folders(map, folder);
  const bool interval_is_set = map.has("interval_s"), exposure_is_set = map.has("exposure_s");
  map.finish();  // report misspelt keys before their consequences
  recognize_entries(entries, projector);
  plan.sequence = sequence_of(entries, projector, map);
  check_image_interval(map, interval_is_set, exposure_is_set, plan);
  apply(waveform, plan);
  for (const Entry& entry : entries)
    plan.offset_rad.insert(plan.offset_rad.end(), entry.patterns.size(), entry.offset_rad);
  for (const fs::path& stack : stacks) {
    plan.stacks.push_back(images_of(stack, entries));
    std::vector<fs::path> used = plan.stacks.back();
    for (const Entry& entry : entries) used.insert(used.end(), entry.projected.begin(), entry.projected.end());
    check_unused_images(stack, used, ignored, map);
    if (image_times.empty()) continue;
    const fs::path file = stack / image_times;
    plan.image_times_s.push_back(read_image_times(file, plan));
    if (plan.image_times_s.size() == 1 && plan.sequence.patterns.size() > 1)
      set_image_interval(median_interval_s(plan.image_times_s.front(), file), plan);
  }
  plan.named_files = map.asked_files();
  return plan;
}

std::vector<fs::path> inputs_of(const ImportPlan& plan) {
  std::set<fs::path> inputs(plan.named_files.begin(), plan.named_files.end());
  inputs.insert(plan.config);
  for (const std::vector<fs::path>& stack : plan.stacks) {
    for (const fs::path& image : stack) inputs.insert(image.parent_path());
  }
  return {inputs.begin(), inputs.end()};
}

}  // namespace fringeslam
