// SPDX-License-Identifier: Apache-2.0
// fringeslam rig list|check|latency|focus: detects and tests the camera and the projector.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <exception>
#include <memory>
#include <nlohmann/json.hpp>
#include <utility>

#include "core/rig/rig_file.h"
#include "core/types/error.h"
#include "core/types/options.h"
#include "hw/network.h"
#include "hw/rig_hardware.h"
#include "hw/sdl_projector.h"
#include "tools/advise.h"
#include "tools/interrupt.h"
#include "tools/verbs.h"

namespace fringeslam::tools {

namespace {

using nlohmann::ordered_json;

int list(const Common& common) {
  ordered_json document{
      {"cameras", ordered_json::array()}, {"displays", ordered_json::array()}, {"controllers", ordered_json::array()}};
  std::string text = "cameras:";
  const std::vector<FoundCamera> cameras = find_cameras();
  const std::vector<NetworkInterface> interfaces = network_interfaces();
  for (const FoundCamera& c : cameras) {
    document["cameras"].push_back({{"id", c.id},
                                   {"vendor", c.vendor},
                                   {"model", c.model},
                                   {"serial", c.serial},
                                   {"address", c.address},
                                   {"protocol", c.protocol}});
    text += "\n  id: " + c.id + "  (" + c.vendor + " " + c.model + ", " + c.protocol + " at " + c.address + ")";
    if (const std::string fault = network_fault(c.address, 0, interfaces); !fault.empty()) text += "\n    but " + fault;
  }
  if (cameras.empty())
    text +=
        "\n  none; check that a camera is powered, connected, in this computer's subnet and not blocked by the "
        "firewall";
  text += "\ndisplays:";
  try {
    for (const FoundDisplay& d : find_displays()) {
      document["displays"].push_back({{"display", d.number},
                                      {"name", d.name},
                                      {"width_px", d.area.width},
                                      {"height_px", d.area.height},
                                      {"refresh_hz", d.refresh_hz}});
      text += "\n  display: " + std::to_string(d.number) + "  (" + d.name + ", " + std::to_string(d.area.width) + "x" +
              std::to_string(d.area.height) + " px at " + to_text(d.refresh_hz) + " Hz)";
    }
  } catch (const Error& e) {
    text += std::string("\n  none: ") + e.what();
  }
  text += "\nprojector controllers:";
  try {
    const std::string faults = open_dlpc350().status().faults;
    document["controllers"].push_back({{"controller", "dlpc350"}, {"faults", faults}});
    text += "\n  dlpc350: " + (faults.empty() ? "ready" : faults);
  } catch (const Error& e) {
    text += std::string("\n  none: ") + e.what();
  }
  print_result(common, document, text);
  return 0;
}

void throw_if_interrupted() {
  if (interrupted()) throw Error("rig: interrupted");
}

// Captures a stack, at a shorter exposure if the images are saturated. Returns it and the exposure relative to the rig's.
std::pair<FringeStack, double> first_look(HardwareRig& rig, const PatternSequence& sequence) {
  constexpr double kShorter = 0.25, kShortest = 1.0 / 64;
  std::exception_ptr reason;
  for (double exposure = 1; exposure >= kShortest; exposure *= kShorter) {
    throw_if_interrupted();
    try {
      if (exposure < 1) rig.scale_exposure(kShorter);
      return {*rig.capture(sequence), exposure};
    } catch (const Overexposed&) {
      reason = std::current_exception();
    } catch (const UnsupportedExposure&) {
      if (!reason) throw;
      break;
    }
  }
  std::rethrow_exception(reason);
}

int check(const std::string& rig_file, const Common& common) {
  const RigModel model = read_rig(rig_file);
  catch_interrupts();  // the devices are released in an orderly way
  const auto rig = open_hardware(rig_file);
  const PatternSequence sequence = phase_shift_sequence(model.projector.width, model.projector.height,
                                                        {model.projector.width + 16.0}, 3, Axis::columns, 8);
  const auto [stack, exposure] = first_look(*rig, sequence);
  cv::Mat brightest = stack.images.front().clone();
  for (const cv::Mat& image : stack.images) brightest = cv::max(brightest, image);
  const double full = model.sensor.saturation_dn();
  const double saturated =
      static_cast<double>(cv::countNonZero(brightest >= full)) / static_cast<double>(brightest.total());
  const double mean = cv::mean(brightest)[0] / full;
  const double gamma = rig->gamma();
  const bool bent = std::abs(gamma - 1) > 0.1;
  const auto look = [&](const PatternSequence& patterns) -> std::optional<FringeStack> {
    throw_if_interrupted();
    if (!rig->takes_exposures()) return std::nullopt;
    try {
      return rig->capture(patterns);
    } catch (const SequenceRejected&) {
      return std::nullopt;  // too little is visible at this exposure
    } catch (const UnsupportedExposure&) {
      return std::nullopt;
    }
  };
  const RigAdvice advice = advise_for(*rig, look, rig_file, rig->takes_exposures());
  print_result(
      common,
      {{"exposure", exposure},
       {"saturated", saturated},
       {"brightness", mean},
       {"gamma", gamma},
       {"sequences_retaken", rig->retaken()},
       {"advice", advice.document}},
      (exposure < 1 ? "the images are saturated at the rig's exposure; what follows is for " + to_text(exposure) +
                          " times that, " + to_text(1e3 * rig->camera().exposure_s()) + " ms\n"
                    : "") +
          "camera and projector work together: brightest image at " + std::to_string(std::lround(100 * mean)) +
          " % of full scale on average, " + to_text(std::round(1e4 * saturated) / 100) + " % saturated" +
          (saturated > 0.01 ? "; lower exposure or gain, or close the aperture"
           : mean < 0.05    ? "; raise exposure or gain"
                            : "") +
          (bent ? "\nthe projector's response is not linear: its light is proportional to the gray value to the power "
                  "of " +
                      to_text(std::round(10 * gamma) / 10) + "; see fringeslam calibrate response"
                : "") +
          "\n" + advice.text);
  return 0;
}

// Measures the delay from show() to the start of the first exposure that sees only the new image, alternating between
// black and white, and suggests a settle time.
int latency(const std::string& rig_file, const Common& common) {
  const RigModel model = read_rig(rig_file);
  const HardwareSettings settings = read_hardware(rig_file, model);
  catch_interrupts();
  const auto projector = open_projector(settings, model);
  AravisCamera camera(settings.camera);
  using Clock = std::chrono::steady_clock;
  const cv::Mat1b black(projector->size(), uchar{0}), white(projector->size(), uchar{255});
  const auto level = [&] {
    throw_if_interrupted();
    return cv::mean(camera.take().image)[0];
  };
  const auto settled = [&](const cv::Mat1b& image) {
    projector->show(image);
    double last = level();
    for (int i = 0; i < 20; ++i) last = level();
    return last;
  };
  const double low = settled(black), high = settled(white);
  if (high - low < 3)
    throw Error(
        "rig: the camera sees no difference between white and black; check that the projector lights the scene");
  std::vector<double> delays_s;
  double image_s = 0;
  for (int i = 0; i < 10; ++i) {
    const bool up = i % 2 != 0;
    projector->show(up ? white : black);
    const Clock::time_point shown = Clock::now();
    double begun_s = 0;
    bool reached = false;
    for (int k = 0; k < 100 && !reached; ++k) {
      begun_s = std::chrono::duration<double>(Clock::now() - shown).count();
      const double share = (level() - low) / (high - low);
      image_s = std::chrono::duration<double>(Clock::now() - shown).count() - begun_s;
      reached = std::abs(share - (up ? 1 : 0)) < 0.02;
    }
    if (!reached)
      throw Error(
          "rig: the brightness does not settle within 100 images after the projector changes; check for other light "
          "that flickers, and expose for a multiple of the projector's refresh interval");
    delays_s.push_back(begun_s);
  }
  std::sort(delays_s.begin(), delays_s.end());
  const double worst_s = delays_s.back(),
               settle_s = std::ceil(1e3 * (1.5 * worst_s + 0.5 * projector->refresh_s())) / 1e3;
  print_result(common,
               {{"delay_s", delays_s[delays_s.size() / 2]},
                {"largest_delay_s", worst_s},
                {"image_s", image_s},
                {"present_interval_s", projector->present_interval_s()},
                {"refresh_s", projector->refresh_s()},
                {"settle_s", settle_s}},
               "an exposure captures a new pattern completely if it starts " +
                   std::to_string(std::lround(1e3 * worst_s)) + " ms after the pattern was shown; an image takes " +
                   std::to_string(std::lround(1e3 * image_s)) +
                   " ms\nadd to the rig file:\n  hardware: {settle_s: " + to_text(settle_s) + "}");
  return 0;
}

}  // namespace

Verb add_rig(Command app, const Common& common) {
  const Command group = app.add_subcommand("rig", "Detect and test the camera and the projector");
  group.require_subcommand(1);
  const Command list_verb = group.add_subcommand("list", "List cameras, displays and projector controllers");
  const Command check_verb = group.add_subcommand(
      "check", "Check that the rig's camera and projector work together, and advise on patterns and exposure");
  const Command latency_verb = group.add_subcommand("latency", "Measure the delay from showing a pattern to seeing it");
  const Verb focus = add_rig_focus(group, common);
  auto file = std::make_shared<std::string>();
  for (const Command& verb : {check_verb, latency_verb})
    verb.add_option("--rig", *file, "Rig file with a hardware: section").required();
  return [=, &common] {
    if (list_verb.parsed()) return list(common);
    if (check_verb.parsed()) return check(*file, common);
    return latency_verb.parsed() ? latency(*file, common) : focus();
  };
}

}  // namespace fringeslam::tools
