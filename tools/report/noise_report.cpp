// SPDX-License-Identifier: Apache-2.0
#include "tools/report/noise_report.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "core/types/options.h"
#include "tools/report/plot.h"

namespace fringeslam::tools {

namespace {

nlohmann::ordered_json interval_json(const NoiseInterval& interval) {
  return {{"value", interval.value}, {"low", interval.low}, {"high", interval.high}};
}

std::string percentage(double share) {
  char text[32];
  std::snprintf(text, sizeof text, "%.0f %%", 100 * share);
  return text;
}

}  // namespace

nlohmann::ordered_json to_json(const CameraNoise& noise) {
  nlohmann::ordered_json bins = nlohmann::ordered_json::array();
  for (const NoiseBin& bin : noise.bins)
    bins.push_back({{"grey_dn", bin.grey_dn}, {"variance_dn2", bin.variance_dn2}, {"samples", bin.samples}});
  return {{"gain_dn_per_electron", interval_json(noise.gain_dn_per_electron)},
          {"dark_noise_electrons", interval_json(noise.dark_noise_electrons)},
          {"offset_dn", interval_json(noise.offset_dn)},
          {"saturation_dn", noise.saturation_dn},
          {"samples", noise.samples},
          {"residual_stacks", noise.residual_stacks},
          {"repeated_stacks", noise.repeated_stacks},
          {"nonlinearity", noise.nonlinearity},
          {"flicker", noise.flicker},
          {"harmonics", noise.harmonics},
          {"correlation", noise.correlation},
          {"bins", bins}};
}

std::string to_table(const CameraNoise& noise) {
  std::string text = "                         estimate   95 % confidence\n";
  char line[160];
  const auto row = [&](const char* name, const NoiseInterval& interval) {
    std::snprintf(line, sizeof line, "%-22s %10.4g   %.4g to %.4g\n", name, interval.value, interval.low,
                  interval.high);
    text += line;
  };
  row("gain, DN/electron", noise.gain_dn_per_electron);
  row("dark noise, electrons", noise.dark_noise_electrons);
  row("offset, DN", noise.offset_dn);
  std::snprintf(line, sizeof line, "%-22s %10.4g\n", "saturation, DN", noise.saturation_dn);
  text += line;
  std::snprintf(
      line, sizeof line,
      "from %lld samples; variances within %.1f %% (RMS) of the line; flicker %.2f %%; largest harmonic of the "
      "fringes %.2f %%\n",
      static_cast<long long>(noise.samples), 100 * noise.nonlinearity, 100 * noise.flicker, 100 * noise.harmonics);
  return text + line;
}

std::vector<std::string> warnings_of(const CameraNoise& noise) {
  std::vector<std::string> warnings;
  const NoiseInterval& gain = noise.gain_dn_per_electron;
  if (noise.nonlinearity > 0.15)
    warnings.push_back("the noise variance deviates from a straight line over the gray value by " +
                       percentage(noise.nonlinearity) +
                       "; the images may be gamma-corrected, compressed or averaged: use raw images");
  if (std::abs(noise.correlation) > 0.1)
    warnings.push_back("the noise of neighbouring pixels is correlated (" +
                       to_text(std::round(noise.correlation * 100) / 100) +
                       "), so the images are interpolated, filtered or compressed, or the view moved; sigmas of "
                       "smoothed results would be too small");
  constexpr double kLargestHarmonic = 0.05;
  if (noise.harmonics > kLargestHarmonic)
    warnings.push_back("the fringes have harmonics of " + percentage(noise.harmonics) +
                       " of their modulation, as from a projector with a nonlinear response, which bias the phase with "
                       "few steps: measure the response with `fringeslam calibrate response` and project linearized "
                       "patterns");
  if (gain.high - gain.low > gain.value)
    warnings.push_back("the gain is uncertain; use more stacks or a view with more gray levels");
  return warnings;
}

cv::Mat3b picture_of(const CameraNoise& noise, const SensorModel& before) {
  double greatest = 0;
  Plot plot{{"gray value, DN", 0, 1.1 * noise.bins.back().grey_dn},
            {"temporal variance, DN^2"},
            {{{}, {110, 110, 110}, 1}, {}},
            {{}}};
  for (const NoiseBin& bin : noise.bins) {
    plot.marks[0].points.emplace_back(bin.grey_dn, bin.variance_dn2);
    plot.marks[0].sigma.push_back(bin.variance_dn2 * std::sqrt(2 / static_cast<double>(bin.samples)));
    greatest = std::max(greatest, bin.variance_dn2);
  }
  constexpr int kPoints = 200;
  for (int i = 0; i <= kPoints; ++i) {
    const double grey = before.max_dn() * i / kPoints;
    plot.lines[0].points.emplace_back(grey, before.variance_dn2(grey));
    plot.lines[1].points.emplace_back(grey, noise.sensor.variance_dn2(grey));
  }
  plot.y.high = 1.3 * greatest;
  return draw(plot);
}

}  // namespace fringeslam::tools
