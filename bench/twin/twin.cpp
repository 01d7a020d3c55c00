// SPDX-License-Identifier: Apache-2.0
#include "bench/twin/twin.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <opencv2/imgproc.hpp>

#include "core/calibrate/camera_noise.h"
#include "core/decode/decode.h"
#include "core/decode/exposures.h"
#include "core/depth/depth.h"
#include "core/io/files.h"
#include "core/patterns/patterns.h"
#include "core/rig/rig_file.h"
#include "core/score/local_scatter.h"
#include "core/types/camera_pupil.h"
#include "core/types/grey_value.h"
#include "sim/virtual_rig.h"

namespace fringeslam::twin {

namespace fs = std::filesystem;

namespace {

constexpr int kSamplesPerPixel = 4;

Capture measured(FringeStack stack, const RigModel& rig) {
  Capture capture;
  capture.decoded = decode(stack, rig, {});
  DepthOptions options;
  options.near_m = rig.near_m;
  options.far_m = rig.far_m;
  capture.frame = reconstruct(capture.decoded, rig, pixel_rays(rig.camera), options);
  cv::extractChannel(capture.frame.points_m, capture.depth_m, 2);
  capture.stack = std::move(stack);
  return capture;
}

double median_of(std::vector<double> values) {
  if (values.empty()) return std::nan("");
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

double quantile_of(std::vector<double> values, double share) {
  if (values.empty()) return std::nan("");
  const auto nth = values.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), nth, values.end());
  return *nth;
}

// Median of value(row, col) over the pixels of a mask.
template <class Value>
double median_over(const cv::Mat1b& mask, Value&& value) {
  std::vector<double> values;
  for (int row = 0; row < mask.rows; ++row) {
    for (int col = 0; col < mask.cols; ++col) {
      const double v = mask(row, col) ? value(row, col) : std::nan("");
      if (std::isfinite(v)) values.push_back(v);
    }
  }
  return median_of(std::move(values));
}

// --- the rig ---

// Modulation of every pixel for one period.
cv::Mat1f modulation_of(const FringeStack& stack, const FringeGroup& group, const RigModel& rig) {
  FringeStack part;
  part.patterns = {stack.patterns.width, stack.patterns.height, {}};
  for (const int image : group.images) {
    const auto i = static_cast<size_t>(image);
    part.patterns.patterns.push_back(stack.patterns.patterns[i]);
    part.images.push_back(stack.images[i]);
    part.exposure_s.push_back(stack.exposure_s[i]);
    part.exposure_time_s.push_back(stack.exposure_time_s[i]);
  }
  DecodeOptions options;
  options.unwrapping = Unwrapping::spatial;
  options.spatial_reference = SpatialReference::none;
  DecodeContext context;
  context.axis = group.axis;
  return decode(part, rig, options, context).modulation;
}

// Mean absolute value of a square wave between -1 and 1 after a Gaussian blur of sigma, both in units of its period.
double blurred_square_wave(double sigma) {
  constexpr int kPoints = 64, kHarmonics = 31;
  double mean = 0;
  for (int i = 0; i < kPoints; ++i) {
    double value = 0;
    for (int m = 1; m <= kHarmonics; m += 2)
      value += 4 / (std::numbers::pi * m) * std::exp(-2 * std::pow(std::numbers::pi * m * sigma, 2)) *
               std::sin(2 * std::numbers::pi * m * (i + 0.5) / kPoints);
    mean += std::abs(value) / kPoints;
  }
  return mean;
}

// Blur of projector and camera together, projector px, from the contrast of the finest Gray bit relative to white and
// black; 0 without these images.
double gray_blur_px(const FringeStack& stack, const cv::Mat1b& mask) {
  const std::vector<GrayBit> bits = gray_bits(stack.patterns, Axis::columns);
  const cv::Mat *white = nullptr, *black = nullptr;
  for (size_t i = 0; i < stack.images.size(); ++i) {
    const Pattern& pattern = stack.patterns.patterns[i];
    if (pattern.coding == Coding::flat && pattern.level == 1) white = &stack.images[i];
    if (pattern.coding == Coding::flat && pattern.level == 0) black = &stack.images[i];
  }
  if (bits.empty() || bits.back().image < 0 || !white || !black) return 0;
  const cv::Mat& bit = stack.images[static_cast<size_t>(bits.back().image)];
  double sum = 0;
  int count = 0;
  for (int row = 0; row < mask.rows; ++row) {
    for (int col = 0; col < mask.cols; ++col) {
      const double low = static_cast<double>(grey_value(*black, row, col)),
                   range = static_cast<double>(grey_value(*white, row, col)) - low;
      constexpr double kLeastRange = 30;  // DN; noise also makes values differ from the mean
      if (!mask(row, col) || range < kLeastRange) continue;
      sum += std::min(1.0, std::abs(2 * (static_cast<double>(grey_value(bit, row, col)) - low) / range - 1));
      ++count;
    }
  }
  if (count < 100) return 0;
  const double contrast = sum / count;
  double least = 0, greatest = 1;
  for (int i = 0; i < 40; ++i) {
    const double middle = 0.5 * (least + greatest);
    (blurred_square_wave(middle) > contrast ? least : greatest) = middle;
  }
  return least * 4 * bits.back().cell_px;  // a bit's period has four cells
}

// Returns the black level of each pixel: the darkest of its coarser Gray bits, which lies far from the edges of most of
// them. Empty with fewer than four bits.
cv::Mat black_of_gray_code(const FringeStack& stack) {
  constexpr size_t kLeastBits = 4;
  const std::vector<GrayBit> bits = gray_bits(stack.patterns, Axis::columns);
  cv::Mat black;
  for (size_t b = 0; bits.size() >= kLeastBits && b + 1 < bits.size(); ++b) {
    if (bits[b].image < 0) continue;
    const cv::Mat& image = stack.images[static_cast<size_t>(bits[b].image)];
    black = black.empty() ? image.clone() : cv::Mat(cv::min(black, image));
  }
  return black;
}

// Blur of fringes from their modulation relative to their mean above black, which are equal without blur.
double fringe_blur_px(const FringeStack& stack, const FringeGroup& group, const cv::Mat1b& mask, const RigModel& rig) {
  const cv::Mat black = black_of_gray_code(stack);
  if (black.empty()) return 0;
  const DecodedStack decoded = decode(stack, rig, {});
  const double ratio = median_over(mask, [&](int row, int col) {
    return static_cast<double>(decoded.modulation(row, col)) /
           (static_cast<double>(decoded.mean(row, col)) - static_cast<double>(grey_value(black, row, col)));
  });
  return ratio > 0 && ratio < 1 ? group.period_px * std::sqrt(-std::log(ratio) / 2) / std::numbers::pi : 0;
}

// Blur of projector and camera together, projector px, from the lower modulation of the finest period: a period p keeps
// exp(-2 pi^2 sigma^2 / p^2). With a single period, from the contrast of the Gray code, or else from its black level.
double blur_px(const FringeStack& stack, const cv::Mat1b& mask, const RigModel& rig) {
  const std::vector<FringeGroup> groups = fringe_groups(stack.patterns, Axis::columns);
  if (groups.size() < 2) {
    const double by_contrast = gray_blur_px(stack, mask);
    return by_contrast > 0 || groups.empty() ? by_contrast : fringe_blur_px(stack, groups.front(), mask, rig);
  }
  const cv::Mat1f coarse = modulation_of(stack, groups.front(), rig), fine = modulation_of(stack, groups.back(), rig);
  const double ratio =
      median_over(mask, [&](int row, int col) { return static_cast<double>(fine(row, col) / coarse(row, col)); });
  const double frequencies = 1 / std::pow(groups.back().period_px, 2) - 1 / std::pow(groups.front().period_px, 2);
  if (!(ratio < 1)) return 0;
  return std::sqrt(-std::log(ratio) / (2 * std::numbers::pi * std::numbers::pi * frequencies));
}

// --- the scene ---

// Writes the smoothed surface in the camera's frame as a mesh whose texture coordinates are the camera's pixels.
void write_surface(const fs::path& folder, const cv::Mat1f& depth_m, const PixelRays& rays) {
  constexpr int kStep = 2;
  constexpr float kLargestStep = 0.01f;  // of the depth; larger ones are edges
  std::string text = "mtllib surface.mtl\nusemtl captured\n";
  cv::Mat1i index(depth_m.size(), 0);
  char line[160];
  int vertices = 0;
  for (int row = 0; row < depth_m.rows; row += kStep) {
    for (int col = 0; col < depth_m.cols; col += kStep) {
      const float z = depth_m(row, col);
      if (!(z > 0)) continue;
      index(row, col) = ++vertices;
      const cv::Vec2f& ray = rays(row, col);
      std::snprintf(line, sizeof line, "v %.7f %.7f %.7f\nvt %.6f %.6f\n", static_cast<double>(z * ray[0]),
                    static_cast<double>(z * ray[1]), static_cast<double>(z), (col + 0.5) / depth_m.cols,
                    1 - (row + 0.5) / depth_m.rows);
      text += line;
    }
  }
  const auto triangle = [&](const cv::Point& a, const cv::Point& b, const cv::Point& c) {
    const int i = index(a), j = index(b), k = index(c);
    if (i == 0 || j == 0 || k == 0) return;
    const float least = std::min({depth_m(a), depth_m(b), depth_m(c)}),
                greatest = std::max({depth_m(a), depth_m(b), depth_m(c)});
    if (greatest - least > kLargestStep * least) return;
    std::snprintf(line, sizeof line, "f %d/%d %d/%d %d/%d\n", i, i, j, j, k, k);
    text += line;
  };
  for (int row = 0; row + kStep < depth_m.rows; row += kStep) {
    for (int col = 0; col + kStep < depth_m.cols; col += kStep) {
      const cv::Point here(col, row), right(col + kStep, row), below(col, row + kStep),
          beyond(col + kStep, row + kStep);
      triangle(here, below, right);
      triangle(right, below, beyond);
    }
  }
  write_text(folder / "surface.obj", text);
  write_text(folder / "surface.mtl", "newmtl captured\nKd 1 1 1\nmap_Kd albedo.exr\n");
}

// Albedo image; pixels without one take the nearest pixel's.
void write_albedo(const fs::path& folder, const cv::Mat1f& albedo) {
  cv::Mat1f filled = albedo.clone();
  cv::Mat1b unknown(albedo.size(), uchar{0});
  for (int row = 0; row < albedo.rows; ++row) {
    for (int col = 0; col < albedo.cols; ++col) unknown(row, col) = std::isfinite(albedo(row, col)) ? 0 : 255;
  }
  cv::patchNaNs(filled, 0.3);
  cv::Mat1f distance;
  cv::Mat1i label;
  cv::distanceTransform(unknown, distance, label, cv::DIST_L2, 5, cv::DIST_LABEL_PIXEL);
  std::vector<float> by_label(1, 0.3f);
  for (int row = 0; row < albedo.rows; ++row) {
    for (int col = 0; col < albedo.cols; ++col) {
      const auto l = static_cast<size_t>(label(row, col));
      if (l >= by_label.size()) by_label.resize(l + 1, 0.3f);
      if (!unknown(row, col)) by_label[l] = albedo(row, col);
    }
  }
  for (int row = 0; row < albedo.rows; ++row) {
    for (int col = 0; col < albedo.cols; ++col) {
      if (unknown(row, col)) filled(row, col) = by_label[static_cast<size_t>(label(row, col))];
    }
  }
  write_exr(folder / "albedo.exr", {{"Y", filled}});
}

void write_scene(const fs::path& folder, const std::string& name, const RigModel& rig, const Lighting& light) {
  write_text(folder / "rig.yaml", to_yaml(rig));
  const std::string render = states_defocus(rig.camera_lens) ? "" : "; render it with render.depth_of_field=false";
  write_text(folder / "scene.yaml",
             "name: " + name + "\ndescription: Digital twin of a real capture" + render +
                 "\nrig: {file: rig.yaml}\npatterns: " + "{axis: columns, steps: 3, periods_px: [" +
                 std::to_string(rig.projector.width) + "]}\nlight: {ambient_lux: " + to_text(light.ambient_lux) +
                 ", exposure_s: " + to_text(light.exposure_s) +
                 "}\nobjects:\n  - {shape: mesh, file: surface.obj, unit_m: 1, up: z}\ntrajectory: {}\n");
}

FringeStack simulated(const fs::path& folder, const PatternSequence& sequence, bool noise) {
  const sim::Scene scene = sim::load_scene(folder / "scene.yaml");
  sim::RenderOptions options;
  options.samples_per_pixel = kSamplesPerPixel;
  options.noise = options.quantise = noise;
  // A capture does not separate the blur of the two lenses: the projector's has all of it. A camera lens that is only nominal
  // adds none.
  options.effects.depth_of_field = states_defocus(scene.rig.camera_lens);
  sim::VirtualRig rig(scene, options);
  return rig.simulate(sequence)->stack;
}

// --- comparison ---

// Share of the valid coordinates that lie more than half a period from the median of their neighbourhood.
double wrong_orders(const DecodedStack& decoded) {
  constexpr int kStride = 3, kRadius = 3;
  const double period = decoded.finest_period_px > 0 ? decoded.finest_period_px : 16;
  int wrong = 0, valid = 0;
  const cv::Mat1f& u = decoded.coordinate_px;
  for (int row = kRadius; row + kRadius < u.rows; row += kStride) {
    for (int col = kRadius; col + kRadius < u.cols; col += kStride) {
      if (!std::isfinite(u(row, col))) continue;
      std::vector<double> around;
      for (int dy = -kRadius; dy <= kRadius; ++dy) {
        for (int dx = -kRadius; dx <= kRadius; ++dx) {
          const float value = u(row + dy, col + dx);
          if (std::isfinite(value)) around.push_back(static_cast<double>(value));
        }
      }
      if (around.size() < 25) continue;
      ++valid;
      wrong += std::abs(static_cast<double>(u(row, col)) - median_of(std::move(around))) > 0.5 * period;
    }
  }
  return valid > 0 ? static_cast<double>(wrong) / valid : std::nan("");
}

std::vector<Comparison> compare(const Capture& real, const Capture& twin, const cv::Mat1b& surface,
                                const SensorModel& sensor) {
  cv::Mat1b both = surface.clone();
  for (int row = 0; row < both.rows; ++row) {
    for (int col = 0; col < both.cols; ++col) {
      if (!real.frame.valid(row, col) || !twin.frame.valid(row, col)) both(row, col) = 0;
    }
  }
  std::vector<Comparison> rows;
  const auto add = [&](const char* name, const char* unit, auto&& value) {
    rows.push_back({name, unit, value(real), value(twin)});
  };
  const auto median_image = [&](const cv::Mat1f& image) {
    return median_over(both, [&](int row, int col) { return static_cast<double>(image(row, col)); });
  };
  const auto scatter = [&](cv::Mat1f values, const cv::Mat1f& sigma) {
    values = values.clone();
    values.setTo(std::nanf(""), both == 0);
    return local_scatter(values, sigma).value;
  };
  add("mean grey value", "DN", [&](const Capture& c) { return median_image(c.decoded.mean); });
  add("modulation", "DN", [&](const Capture& c) { return median_image(c.decoded.modulation); });
  add("phase noise", "px", [&](const Capture& c) { return scatter(c.decoded.coordinate_px, c.decoded.sigma_px); });
  add("depth scatter", "mm", [&](const Capture& c) { return 1e3 * scatter(c.depth_m, c.frame.sigma_m); });
  add("valid share of the surface", "", [&](const Capture& c) {
    int valid = 0, all = 0;
    for (int row = 0; row < surface.rows; ++row) {
      for (int col = 0; col < surface.cols; ++col) {
        if (!surface(row, col)) continue;
        ++all;
        valid += c.frame.valid(row, col);
      }
    }
    return static_cast<double>(valid) / std::max(1, all);
  });
  add("wrong fringe orders", "", [&](const Capture& c) { return wrong_orders(c.decoded); });
  // Both captures are measured at the exposure that is the clearest one of the real capture.
  OneExposure one(NoiseOptions().saturation * sensor.saturation_dn());
  if (noise_samples_per_pixel(one.of(real.stack).patterns) > 0) {
    add("camera gain", "DN/e-", [&](const Capture& c) {
      NoiseEstimator estimator(sensor, {});
      estimator.add(one.of(c.stack));
      return estimator.estimate().gain_dn_per_electron.value;
    });
  }
  return rows;
}

}  // namespace

Twin make_twin(FringeStack stack, const RigModel& measured_rig, const std::string& name, const fs::path& scene,
               const std::function<void()>& step) {
  const PatternSequence sequence = stack.patterns;
  RigModel rig = measured_rig;
  rig.robot_from_camera = {};
  // The scene's exposure may be as long as the brightness requires.
  rig.timing.pattern_rate_hz = rig.timing.camera_rate_hz = 1;
  Twin result;
  result.real = measured(std::move(stack), rig);
  const cv::Mat1f smooth = locally_smoothed(result.real.depth_m, result.real.frame.sigma_m);
  cv::Mat1b surface(smooth.size(), uchar{0});
  int pixels = 0;
  for (int row = 0; row < smooth.rows; ++row) {
    for (int col = 0; col < smooth.cols; ++col) {
      surface(row, col) = smooth(row, col) > 0 ? 255 : 0;
      pixels += smooth(row, col) > 0;
    }
  }
  constexpr int kLeastPixels = 1000;
  if (pixels < kLeastPixels)
    throw Error("only " + std::to_string(pixels) +
                " pixels of its first view lie on a smooth surface; a twin requires " + std::to_string(kLeastPixels));
  rig.projector_lens.blur_px = blur_px(result.real.stack, surface, rig);
  rig.projector_lens.pixel_fill = 1;
  rig.projector_black_level = 0;
  rig.camera_lens.blur_px = 0;
  rig.sensor.prnu = rig.sensor.dsnu_electrons = 0;

  write_surface(scene, smooth, pixel_rays(rig.camera));
  Lighting light;

  // Exposure and albedo from the modulation; a uniform surface shows what geometry and lenses contribute.
  constexpr float kFirstAlbedo = 0.5f;
  constexpr double kBrightest = 0.9;
  write_albedo(scene, cv::Mat1f(smooth.size(), kFirstAlbedo));
  write_scene(scene, name, rig, light);
  const FringeStack uniform_stack = simulated(scene, sequence, false);
  const DecodedStack uniform = decode(uniform_stack, rig, {});
  // The pixels' size blurs, too, so the simulation's total blur is compared with the measured one.
  double& lens_blur_px = rig.projector_lens.blur_px;
  const double total_px = blur_px(uniform_stack, surface, rig);
  lens_blur_px = std::sqrt(std::max(0.0, 2 * lens_blur_px * lens_blur_px - total_px * total_px));
  step();
  cv::Mat1f ratio(smooth.size(), std::nanf(""));
  std::vector<double> ratios;
  for (int row = 0; row < ratio.rows; ++row) {
    for (int col = 0; col < ratio.cols; ++col) {
      if (!surface(row, col) || !(uniform.modulation(row, col) > 0)) continue;
      ratio(row, col) = result.real.decoded.modulation(row, col) / uniform.modulation(row, col);
      ratios.push_back(static_cast<double>(ratio(row, col)));
    }
  }
  // The modulation is noisy; the albedo of a pixel is that of its neighbourhood.
  cv::Mat1f smooth_ratio;
  cv::Mat1f known = ratio.clone();
  cv::patchNaNs(known, median_of(ratios));
  cv::GaussianBlur(known, smooth_ratio, {}, 1);
  const double factor = quantile_of(ratios, 0.995) * static_cast<double>(kFirstAlbedo) / kBrightest;
  light.exposure_s *= factor;
  cv::Mat1f albedo(smooth.size(), std::nanf(""));
  for (int row = 0; row < ratio.rows; ++row) {
    for (int col = 0; col < ratio.cols; ++col) {
      if (std::isfinite(ratio(row, col)))
        albedo(row, col) = std::clamp(smooth_ratio(row, col) * kFirstAlbedo / static_cast<float>(factor), 0.001f, 1.0f);
    }
  }
  write_albedo(scene, albedo);

  // Ambient light and black level together, from the mean beyond the modulation.
  constexpr double kFirstAmbient_lux = 1000;
  const auto beyond = [&](const DecodedStack& d) {
    return median_over(
        surface, [&](int row, int col) { return static_cast<double>(d.mean(row, col) - d.modulation(row, col)); });
  };
  write_scene(scene, name, rig, light);
  const double without = beyond(decode(simulated(scene, sequence, false), rig, {}));
  light.ambient_lux = kFirstAmbient_lux;
  write_scene(scene, name, rig, light);
  const double with = beyond(decode(simulated(scene, sequence, false), rig, {}));
  step();
  light.ambient_lux = std::max(0.0, kFirstAmbient_lux * (beyond(result.real.decoded) - without) / (with - without));
  write_scene(scene, name, rig, light);

  result.simulated = measured(simulated(scene, sequence, true), rig);
  step();
  result.comparisons = compare(result.real, result.simulated, surface, measured_rig.sensor);
  result.rig = rig;
  result.light = light;
  return result;
}

}  // namespace fringeslam::twin
