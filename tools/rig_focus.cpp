// SPDX-License-Identifier: Apache-2.0
// fringeslam rig focus: projects fine fringes repeatedly while a person adjusts the lenses.
#include <algorithm>
#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>

#include "core/io/json_text.h"
#include "core/rig/rig_file.h"
#include "core/types/error.h"
#include "hw/rig_hardware.h"
#include "tools/focus_reading.h"
#include "tools/interrupt.h"
#include "tools/live/live_option.h"
#include "tools/verbs.h"

namespace fringeslam::tools {

namespace {

using nlohmann::ordered_json;

struct RigFocusArguments {
  std::string rig;
  int count = 0;
  double period_px = 16;
  LiveOption live;
};

// JSON has no NaN.
ordered_json figure(double value) { return std::isfinite(value) ? ordered_json(value) : ordered_json(); }

std::string percent(double share) {
  return std::isfinite(share) ? std::to_string(std::lround(100 * share)) + " %" : "none";
}

std::string decimals(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.4f", value);
  return std::isfinite(value) ? text : "none";
}

// Best values so far. std::fmax ignores a NaN.
struct Best {
  double fringes = std::nan(""), sharpness = std::nan("");
  void take(const FocusReading& reading) {
    fringes = std::fmax(fringes, reading.fringes);
    sharpness = std::fmax(sharpness, reading.sharpness);
  }
};

std::string line_of(const FocusReading& reading, const Best& best) {
  std::string line = "fringes " + percent(reading.fringes) + " (best " + percent(best.fringes) + "), center " +
                     percent(reading.centre) + ", corners " + percent(reading.corners) + "; texture sharpness " +
                     decimals(reading.sharpness) + " (best " + decimals(best.sharpness) + ")";
  if (reading.measured < 0.1)
    line += "; only " + percent(reading.measured) +
            " of the pixels separate white from black and are not saturated: check exposure and scene";
  return line;
}

int focus(const RigFocusArguments& arguments, const Common& common) {
  const RigModel model = read_rig(arguments.rig);
  const PatternSequence sequence = focus_sequence(model, arguments.period_px);
  catch_interrupts();  // from now on, the devices are released in an orderly way
  const std::unique_ptr<LivePage> page = open_live_page(
      arguments.live,
      {.verb = "focus", .name = model.name, .rig = model, .sequence = sequence, .stacks = arguments.count});
  const auto rig = open_hardware(arguments.rig);
  ordered_json readings = ordered_json::array();
  Best best;
  for (int i = 0; (arguments.count == 0 || i < arguments.count) && !interrupted(); ++i) {
    std::optional<FringeStack> stack;
    try {
      stack = rig->capture(sequence);
    } catch (const SequenceRejected& e) {
      // Later failures may come from a hand at the lens or in the beam; a rig that has never worked is an error.
      if (readings.empty()) throw;
      if (!common.quiet) std::fprintf(stderr, "no reading: %s\n", e.what());
      continue;
    }
    if (page) page->feed().show(*stack);
    const FocusReading reading = read_focus(*stack, model);
    best.take(reading);
    readings.push_back({{"fringes", figure(reading.fringes)},
                        {"centre", figure(reading.centre)},
                        {"corners", figure(reading.corners)},
                        {"sharpness", figure(reading.sharpness)},
                        {"measured", reading.measured}});
    if (common.json) continue;
    std::printf("%s\n", line_of(reading, best).c_str());
    std::fflush(stdout);
  }
  if (common.json) std::printf("%s\n", json_text(readings, 2).c_str());
  return 0;
}

}  // namespace

Verb add_rig_focus(Command group, const Common& common) {
  auto arguments = std::make_shared<RigFocusArguments>();
  const Command verb =
      group.add_subcommand("focus", "Print fringe contrast and texture sharpness while the lenses are adjusted");
  verb.add_option("--rig", arguments->rig, "Rig file with a hardware: section").required();
  verb.add_option("--count", arguments->count, "Number of readings; 0: until Ctrl-C").check_range(0, 1000000);
  verb.add_option("--period", arguments->period_px, "Fringe period, projector px").check_range(4.0, 512.0);
  add_live_option(verb, arguments->live);
  return [arguments, &common] { return focus(*arguments, common); };
}

}  // namespace fringeslam::tools
