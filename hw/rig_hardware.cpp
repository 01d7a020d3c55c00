// SPDX-License-Identifier: Apache-2.0
#include "hw/rig_hardware.h"

#include <chrono>
#include <thread>
#include <utility>

#include "core/io/yaml.h"
#include "core/rig/rig_file.h"
#include "hw/pixel_formats.h"
#include "hw/sdl_projector.h"

namespace fringeslam {

namespace fs = std::filesystem;

namespace {

const std::vector<std::string> kPackings = {"RGB", "RBG", "GRB", "GBR", "BRG", "BGR"};

CameraSettings read_camera(const YamlMap& map, const RigModel& rig) {
  CameraSettings camera;
  camera.size = {rig.camera.width, rig.camera.height};
  camera.id = map.text_or("id", "");
  camera.pixel_format = map.text_or("pixel_format", camera.pixel_format);
  const PixelFormat* format = nullptr;
  try {
    format = &pixel_format(camera.pixel_format);
  } catch (const Error& e) {
    throw map.error("pixel_format", e.what());
  }
  if (format->bits != rig.sensor.bits)
    throw map.error("pixel_format", camera.pixel_format + " has " + std::to_string(format->bits) +
                                        " bits, but camera.sensor.bits is " + std::to_string(rig.sensor.bits));
  if (map.has("offset_px")) {
    const std::vector<double> offset = map.numbers("offset_px", 2, {0, 65535});
    camera.offset = {static_cast<int>(offset[0]), static_cast<int>(offset[1])};
  }
  camera.exposure_s = map.number_or("exposure_s", rig.timing.exposure_s, {1e-6, 60});
  if (map.has("gain")) camera.gain = map.number("gain", {-1e3, 1e6});
  camera.trigger = map.text_or("trigger", camera.trigger);
  camera.packet_bytes = map.integer_or("packet_bytes", camera.packet_bytes, {0, 65535});
  camera.timeout_s = map.number_or("timeout_s", camera.timeout_s, {0.001, 600});
  camera.attempts = map.integer_or("attempts", camera.attempts, {1, 1000});
  camera.reopen_s = map.number_or("reopen_s", camera.reopen_s, {0, 3600});
  return camera;
}

Dlpc350Settings read_dlpc350(const YamlMap& map, const std::string& packing) {
  Dlpc350Settings settings;
  settings.packing = packing;
  settings.period_us = map.integer_or("period_us", settings.period_us, {8333, 2000000});
  settings.exposure_us = map.integer_or("exposure_us", settings.pattern_period_us(), {4500, 2000000});
  settings.led_current = map.integer_or("led_current", settings.led_current, {-1, 255});
  return settings;
}

// A display that is a LightCrafter 4500; its controller is set to show each frame as patterns.
class LightCrafter : public Projector {
 public:
  LightCrafter(std::unique_ptr<Projector> display, const Dlpc350Settings& settings)
      : display_(std::move(display)), controller_(open_dlpc350()) {
    controller_.show_video_as_patterns(settings, [] { std::this_thread::sleep_for(std::chrono::milliseconds(20)); });
    if (const std::string faults = controller_.status().faults; !faults.empty())
      throw Error("projector: the controller reports: " + faults);
  }
  cv::Size size() const override { return display_->size(); }
  void show(const cv::Mat& image) override { display_->show(image); }
  double refresh_s() const override { return display_->refresh_s(); }
  double present_interval_s() const override { return display_->present_interval_s(); }

 private:
  std::unique_ptr<Projector> display_;
  Dlpc350 controller_;
};

}  // namespace

HardwareSettings read_hardware(const fs::path& rig_file, const RigModel& rig) {
  const YamlMap file = YamlMap::load(rig_file);
  if (!file.has("hardware"))
    throw Error(rig_file.string() +
                ": has no 'hardware:' section, which specifies camera and projector; see "
                "hw/README.md");
  const YamlMap map = file.map("hardware");
  HardwareSettings settings;
  settings.camera = read_camera(map.has("camera") ? map.map("camera") : YamlMap::parse("{}", "camera"), rig);
  if (map.has("projector")) {
    const YamlMap projector = map.map("projector");
    settings.display = projector.integer_or("display", -1, {-1, 63});
    if (projector.has("packing")) settings.rig.packing = projector.choice("packing", kPackings);
    if (projector.has("dlpc350")) settings.dlpc350 = read_dlpc350(projector.map("dlpc350"), settings.rig.packing);
    if (!settings.rig.packing.empty() && settings.camera.trigger == "software")
      throw map.error("projector",
                      "packed patterns are timed by the projector; set camera.trigger to the input line that its "
                      "trigger output is connected to");
  }
  settings.rig.settle_s = map.number_or("settle_s", settings.rig.settle_s, {0, 60});
  settings.rig.attempts = map.integer_or("attempts", settings.rig.attempts, {1, 1000});
  map.finish();
  return settings;
}

std::unique_ptr<Projector> open_projector(const HardwareSettings& settings, const RigModel& rig) {
  int display = settings.display;
  if (display < 0) {
    const size_t displays = find_displays().size();
    if (displays != 1)
      throw Error("projector: found " + std::to_string(displays) +
                  " displays; set hardware.projector.display (see fringeslam rig list)");
    display = 0;
  }
  std::unique_ptr<Projector> projector =
      std::make_unique<SdlProjector>(display, cv::Size(rig.projector.width, rig.projector.height));
  if (settings.dlpc350) projector = std::make_unique<LightCrafter>(std::move(projector), *settings.dlpc350);
  return projector;
}

std::unique_ptr<HardwareRig> open_hardware(const fs::path& rig_file) {
  const RigModel rig = read_rig(rig_file);
  const HardwareSettings settings = read_hardware(rig_file, rig);
  auto projector = open_projector(settings, rig);
  auto camera = std::make_unique<AravisCamera>(settings.camera);
  return std::make_unique<HardwareRig>(rig, std::move(camera), std::move(projector), settings.rig);
}

}  // namespace fringeslam
