// SPDX-License-Identifier: Apache-2.0
// fringeslam patterns --out DIR: writes pattern images for a projector and their description.
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>

#include "core/io/files.h"
#include "core/patterns/design.h"
#include "core/rig/rig_file.h"
#include "core/types/error.h"
#include "sim/scene/scene.h"
#include "tools/output_file.h"
#include "tools/source.h"
#include "tools/verbs.h"

namespace fringeslam::tools {

namespace fs = std::filesystem;

namespace {

constexpr int kMaxSize = 16384;           // px
constexpr int kResponseEntries = 1025;    // in the table of the inverse response
constexpr size_t kImagesInOneColour = 3;  // R, G, B

struct PatternsArguments {
  std::string out, rig, size, scene, axis = "columns", pack;
  GrayCode gray = GrayCode::none;
  std::vector<double> periods_px, extra_periods_px, product_periods_px, exposures;
  int steps = 3, ramp_levels = 0, bits = 8;
  double gray_cell_px = 0, carrier_px = 0, micro_period_px = 0, modulated_period_px = 0;
  int micro_images = 0;
  std::vector<double> gray_xor_px;
  bool linearise = false, gray_inverted = false, gray_long_runs = false, white_black = false, dithered = false;
};

cv::Size read_size(const std::string& text) {
  cv::Size size;
  char end = 0;
  if (std::sscanf(text.c_str(), "%dx%d%c", &size.width, &size.height, &end) != 2 || size.width < 1 || size.height < 1 ||
      size.width > kMaxSize || size.height > kMaxSize)
    throw Error("--size " + text + ": must be WIDTHxHEIGHT in pixels, such as 1920x1080");
  return size;
}

SequenceDesign design_of(const PatternsArguments& arguments, const cv::Size& size) {
  SequenceDesign design;
  design.width = size.width, design.height = size.height;
  design.columns = arguments.axis != "rows";
  design.rows = arguments.axis != "columns";
  design.periods_px = arguments.periods_px;
  design.steps = arguments.steps;
  design.gray = arguments.gray;
  design.gray_cell_px = arguments.gray_cell_px;
  design.gray_inverted = arguments.gray_inverted;
  design.gray_xor_px = arguments.gray_xor_px;
  design.gray_long_runs = arguments.gray_long_runs;
  design.white_black = arguments.white_black;
  design.ramp_levels = arguments.ramp_levels;
  design.bits = arguments.bits;
  design.dithered = arguments.dithered;
  design.extra_periods_px = arguments.extra_periods_px;
  design.product_periods_px = arguments.product_periods_px;
  design.carrier_px = arguments.carrier_px;
  design.micro_period_px = arguments.micro_period_px;
  design.modulated_period_px = arguments.modulated_period_px;
  design.micro_images = arguments.micro_images;
  design.exposures = arguments.exposures;
  return design;
}

// Adds the files that are read to `inputs`.
PatternSequence sequence_of(const PatternsArguments& arguments, std::vector<fs::path>& inputs) {
  const int sources = !arguments.rig.empty() + !arguments.size.empty() + !arguments.scene.empty();
  if (sources != 1)
    throw Error("patterns: give the projector's size by one of --rig RIG.yaml, --size WxH or --scene SCENE");
  if (arguments.linearise && arguments.rig.empty()) throw Error("--linearise: needs --rig for the response to invert");
  if (!arguments.scene.empty()) {
    sim::SceneLoadOptions reading;
    reading.files = &inputs;
    return sim::load_scene(scene_file(arguments.scene), reading).patterns;
  }
  if (!arguments.size.empty()) return design_sequence(design_of(arguments, read_size(arguments.size)));
  inputs.emplace_back(arguments.rig);
  const RigModel rig = read_rig(arguments.rig);
  PatternSequence sequence = design_sequence(design_of(arguments, {rig.projector.width, rig.projector.height}));
  if (arguments.linearise) {
    if (rig.projector_response.empty())
      throw Error(arguments.rig +
                  ": has no projector response for --linearise; run fringeslam calibrate response first");
    sequence.inverse_response = invert_table(rig.projector_response, kResponseEntries);
  }
  return sequence;
}

std::string image_name(size_t number) {
  char name[32];
  std::snprintf(name, sizeof name, "%03zu.png", number);
  return name;
}

cv::Mat shown_image(const PatternSequence& sequence, size_t number) {
  const Pattern& pattern = sequence.patterns[number];
  if (pattern.bits == 0)
    throw Error("patterns: pattern " + std::to_string(number) +
                " has bits: 0 (continuous), which an image file cannot store; give it 1 to 16");
  return pattern_image(pattern, sequence);
}

// Writes one image per pattern; returns the lines of projection.yaml.
std::string write_images(const PatternSequence& sequence, const fs::path& folder) {
  std::string lines;
  for (size_t i = 0; i < sequence.patterns.size(); ++i) {
    write_png(folder / image_name(i), shown_image(sequence, i));
    lines += "  - {file: " + image_name(i) + ", grey: " + std::to_string(i) + "}\n";
  }
  return lines;
}

// Writes one colour image for every three patterns; returns the lines of projection.yaml.
std::string write_packed(const PatternSequence& sequence, const std::string& order, const fs::path& folder) {
  const size_t count = sequence.patterns.size();
  if (count % kImagesInOneColour != 0)
    throw Error("--pack " + order + ": packs three patterns into one image, but there are " + std::to_string(count) +
                "; use a multiple of 3");
  fs::create_directories(folder / "packed");
  std::string lines;
  for (size_t i = 0; i < count; i += kImagesInOneColour) {
    std::vector<cv::Mat1b> images;
    const std::string file = "packed/" + image_name(i / kImagesInOneColour);
    lines += "  - {file: " + file;
    for (size_t k = 0; k < kImagesInOneColour; ++k) {
      if (sequence.patterns[i + k].bits > 8)
        throw Error("--pack " + order + ": a channel of a color image has 8 bits; give --bits 8 or less");
      images.push_back(shown_image(sequence, i + k));
      lines += std::string(", ") + order.substr(k, 1) + ": " + std::to_string(i + k);
    }
    write_png(folder / file, packed_image(images, order));
    lines += "}\n";
  }
  return lines;
}

int write_patterns(const PatternsArguments& arguments, const Common& common) {
  std::vector<fs::path> inputs;
  const PatternSequence sequence = sequence_of(arguments, inputs);
  require_not_an_input(arguments.out, inputs);
  StagedFolder folder(arguments.out, "patterns");
  const bool packed = !arguments.pack.empty();
  const std::string lines =
      packed ? write_packed(sequence, arguments.pack, folder.path()) : write_images(sequence, folder.path());
  write_text(folder.path() / "patterns.yaml", to_yaml(sequence));
  write_text(folder.path() / "projection.yaml",
             "width_px: " + std::to_string(sequence.width) + "\nheight_px: " + std::to_string(sequence.height) +
                 "\npacking: " + (packed ? arguments.pack : "none") + "\nimages:\n" + lines);
  folder.commit();
  const size_t count = sequence.patterns.size();
  print_result(common, {{"patterns", arguments.out}, {"count", count}},
               "patterns: " + arguments.out + " (" + std::to_string(count) + " patterns of " +
                   std::to_string(sequence.width) + "x" + std::to_string(sequence.height) + " px)");
  return 0;
}

}  // namespace

Verb add_patterns(Command app, const Common& common) {
  auto a = std::make_shared<PatternsArguments>();
  const Command verb = app.add_subcommand("patterns", "Write the pattern images for a projector and their description");
  verb.add_option("--out", a->out, "Folder to write").required();
  const Option rig = verb.add_option("--rig", a->rig, "Rig file with the projector's size and response");
  const Option size = verb.add_option("--size", a->size, "Projector size, WIDTHxHEIGHT").excludes(rig);
  const Option scene =
      verb.add_option("--scene", a->scene, "Scene whose patterns are written").excludes(rig).excludes(size);
  std::vector<Option> design;
  const auto note = [&](Option option) {
    design.push_back(option);
    return option;
  };
  note(verb.add_flag("--linearise", a->linearise, "Apply the inverse of the rig's projector response to the patterns"));
  note(verb.add_option("--periods", a->periods_px, "Fringe periods, px").delimiter(',').check_range(2.0, 1e5));
  note(verb.add_option("--steps", a->steps, "Phase shifts per period").check_range(3, 64));
  note(verb.add_option("--exposures", a->exposures,
                       "Exposure times of each pattern, relative to the rig's: one image each")
           .delimiter(',')
           .check_range(1e-3, 1e3));
  note(verb.add_option("--extra-periods", a->extra_periods_px,
                       "Add one image of each of these periods, px, as for micro phase shifting")
           .delimiter(',')
           .check_range(2.0, 1e5));
  note(
      verb.add_option("--micro", a->micro_period_px,
                      "Micro phase shifting, which indirect light does not disturb: --steps shifts of this period, px, "
                      "and single images of other periods near it")
          .check_range(2.0, 1e5));
  note(verb.add_option("--micro-images", a->micro_images,
                       "Images of micro phase shifting per axis (default: four more than --steps)")
           .check_range(5, 64));
  note(
      verb.add_option("--modulated", a->modulated_period_px,
                      "Modulated phase shifting, which indirect light does not disturb: --steps shifts of this period, "
                      "px, and products of longer ones with it")
          .check_range(2.0, 1e5));
  const Option products =
      verb.add_option("--product-periods", a->product_periods_px,
                      "Add products of cosines of these periods, px, and a carrier, in --steps shifts of "
                      "each, as for modulated phase shifting");
  note(products.delimiter(',').check_range(2.0, 1e5));
  note(verb.add_option("--carrier", a->carrier_px, "Period of the products' second cosine, px").check_range(2.0, 1e5));
  note(verb.add_option("--axis", a->axis, "Coded coordinate").check_one_of({"columns", "rows", "both"}));
  note(add_choice(verb, "--gray", a->gray, "Gray code of the finest fringe's period number"));
  note(verb.add_option("--gray-cell", a->gray_cell_px,
                       "Gray code with cells of this width, px, with or without fringes (OpenCV's: 1)")
           .check_range(0.5, 1e5));
  note(verb.add_flag("--gray-inverted", a->gray_inverted, "Also write each Gray code image inverted"));
  note(verb.add_option("--gray-xor", a->gray_xor_px,
                       "Combine the Gray code's bits by XOR with the one whose stripes have this width, px, so that "
                       "none has wider stripes; one code for each width listed, 0 for the plain one")
           .delimiter(',')
           .check_range(0.0, 2e5));
  note(verb.add_flag(
      "--gray-long-runs", a->gray_long_runs,
      "A Gray code whose stripes are all several cells wide and none much wider than the others, instead of "
      "the reflected code or, with --gray-xor, in addition"));
  note(verb.add_flag("--white-black", a->white_black, "Add a white and a black image"));
  note(verb.add_option("--ramp-levels", a->ramp_levels, "Add a gray ramp with this number of flat images")
           .check_range(0, 65536));
  note(verb.add_option("--bits", a->bits, "Bit depth of the projector's gray levels").check_range(1, 16));
  note(verb.add_flag("--dither", a->dithered, "Dither by error diffusion between gray levels"));
  for (const Option& option : design) option.excludes(scene);
  verb.add_option("--pack", a->pack,
                  "Pack three patterns into one color image, in this order of its channels, such as RGB")
      .check_one_of({"RGB", "RBG", "GRB", "GBR", "BRG", "BGR"});
  return [a, &common] { return write_patterns(*a, common); };
}

}  // namespace fringeslam::tools
