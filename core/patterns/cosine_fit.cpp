// SPDX-License-Identifier: Apache-2.0
#include "core/patterns/cosine_fit.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <opencv2/core.hpp>

#include "core/base/constants.h"

namespace fringeslam {

namespace {

constexpr int kMaxCosineIterations = 50;

// Position of pixel i in units of the length, from the middle of the image. Angles are w s, so that a turn rate w of
// 2 pi n cycles over the image is well scaled against the other parameters.
double cosine_position(size_t i, size_t count) {
  return (static_cast<double>(i) + 0.5) / static_cast<double>(count) - 0.5;
}

double turn_rate(double period_px, size_t count) { return kTwoPi * static_cast<double>(count) / period_px; }
double period_of_rate(double rate, size_t count) { return kTwoPi * static_cast<double>(count) / rate; }

// Shift at the image's edge of a cosine with this phase in its middle.
double shift_of_phase(double phase_rad, double rate) { return std::remainder(phase_rad - 0.5 * rate, kTwoPi); }

// mean + c cos(w s) + d sin(w s).
struct Wave3 {
  double rate = 0;
  Eigen::Vector3d linear = Eigen::Vector3d::Zero();
  double square = 0;      // sum of the squared residuals
  double rate_sigma = 0;  // of a refined rate, for residuals of variance 1
};

// Solves the normal equations with a negligible prior, which keeps undetermined parameters finite.
template <int N>
Eigen::Matrix<double, N, 1> solved(Eigen::Matrix<double, N, N> normal, const Eigen::Matrix<double, N, 1>& right) {
  normal.diagonal().array() += 1e-12 * normal.trace();
  return normal.ldlt().solve(right);
}

Wave3 wave_at(const std::vector<double>& levels, double rate) {
  Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
  Eigen::Vector3d right = Eigen::Vector3d::Zero();
  const auto basis = [&](size_t i) {
    const double angle = rate * cosine_position(i, levels.size());
    return Eigen::Vector3d(1, std::cos(angle), std::sin(angle));
  };
  for (size_t i = 0; i < levels.size(); ++i) {
    const Eigen::Vector3d b = basis(i);
    normal += b * b.transpose();
    right += b * levels[i];
  }
  Wave3 wave{rate, solved<3>(normal, right), 0};
  for (size_t i = 0; i < levels.size(); ++i) wave.square += std::pow(levels[i] - wave.linear.dot(basis(i)), 2);
  return wave;
}

// Gauss-Newton over all four parameters; the linear ones are optimal at every rate.
Wave3 refined_wave(const std::vector<double>& levels, double rate) {
  constexpr double kSettled = 1e-11;
  const double fastest = kPi * static_cast<double>(levels.size());  // a period of 2 px
  Wave3 wave = wave_at(levels, rate);
  for (int iteration = 0; iteration < kMaxCosineIterations; ++iteration) {
    Eigen::Matrix4d normal = Eigen::Matrix4d::Zero();
    Eigen::Vector4d right = Eigen::Vector4d::Zero();
    for (size_t i = 0; i < levels.size(); ++i) {
      const double s = cosine_position(i, levels.size()), cosine = std::cos(wave.rate * s),
                   sine = std::sin(wave.rate * s);
      const Eigen::Vector4d j(1, cosine, sine, s * (wave.linear[2] * cosine - wave.linear[1] * sine));
      normal += j * j.transpose();
      right += j * (levels[i] - wave.linear.dot(j.head<3>()));
    }
    double step = solved<4>(normal, right)[3];
    wave.rate_sigma = std::sqrt(std::max(0.0, solved<4>(normal, Eigen::Vector4d::UnitW())[3]));
    Wave3 next = wave;
    for (int halving = 0; halving < 12; ++halving, step *= 0.5) {
      if (!(wave.rate + step > 0 && wave.rate + step <= fastest)) continue;
      next = wave_at(levels, wave.rate + step);
      if (next.square < wave.square) break;
    }
    if (!(next.square < wave.square)) return wave;
    const double change = std::abs(next.rate - wave.rate);
    next.rate_sigma = wave.rate_sigma;
    wave = next;
    if (change < kSettled * wave.rate) return wave;
  }
  return wave;
}

// Rate of the largest peak of the spectrum.
double spectral_peak(const std::vector<double>& levels) {
  constexpr int kPadding = 4;
  const auto count = static_cast<int>(levels.size());
  const double mean = std::accumulate(levels.begin(), levels.end(), 0.0) / count;
  cv::Mat1d padded(1, cv::getOptimalDFTSize(kPadding * count), 0.0);
  for (int i = 0; i < count; ++i) {
    const double window = 0.5 - 0.5 * std::cos(kTwoPi * (i + 0.5) / count);
    padded(0, i) = window * (levels[static_cast<size_t>(i)] - mean);
  }
  cv::Mat2d spectrum;
  cv::dft(padded, spectrum, cv::DFT_COMPLEX_OUTPUT);
  int peak = 1;
  for (int k = 1; k <= padded.cols / 2; ++k) {
    if (cv::norm(spectrum(0, k)) > cv::norm(spectrum(0, peak))) peak = k;
  }
  return kTwoPi * count * peak / padded.cols;
}

CosineFit with_residuals(const std::vector<double>& levels, CosineFit fit) {
  double square = 0;
  for (size_t i = 0; i < levels.size(); ++i) {
    const double x = static_cast<double>(i) + 0.5;
    const double off = levels[i] - fit.mean - fit.modulation * std::cos(kTwoPi * x / fit.period_px + fit.shift_rad);
    square += off * off;
    fit.largest = std::max(fit.largest, std::abs(off));
  }
  fit.rms = std::sqrt(square / static_cast<double>(levels.size()));
  return fit;
}

CosineFit cosine_of(const std::vector<double>& levels, const Wave3& wave) {
  CosineFit fit;
  fit.period_px = period_of_rate(wave.rate, levels.size());
  fit.shift_rad = shift_of_phase(std::atan2(-wave.linear[2], wave.linear[1]), wave.rate);
  fit.mean = wave.linear[0];
  fit.modulation = std::hypot(wave.linear[1], wave.linear[2]);
  fit = with_residuals(levels, fit);
  fit.period_sigma_px = fit.rms * wave.rate_sigma / wave.rate * fit.period_px;
  return fit;
}

// --- monotone functions of a cosine ---

// sum_k a_k cos(k (w s + phase)): an even function of the phase, as every function of its cosine is.
struct EvenWave {
  double rate = 0, phase_rad = 0;
};

EvenWave refined_even_wave(const std::vector<double>& levels, EvenWave wave) {
  constexpr int kHarmonics = 5, kLinear = kHarmonics + 1, kAll = kLinear + 2;
  using Vector = Eigen::Matrix<double, kAll, 1>;
  Eigen::Matrix<double, kLinear, 1> amplitudes = Eigen::Matrix<double, kLinear, 1>::Zero();
  for (int iteration = 0; iteration < kMaxCosineIterations; ++iteration) {
    // The first pass solves for the amplitudes alone.
    Eigen::Matrix<double, kAll, kAll> normal = Eigen::Matrix<double, kAll, kAll>::Zero();
    Vector right = Vector::Zero();
    for (size_t i = 0; i < levels.size(); ++i) {
      const double s = cosine_position(i, levels.size()), angle = wave.rate * s + wave.phase_rad;
      Vector j = Vector::Zero();
      double slope = 0;
      for (int k = 0; k < kLinear; ++k) {
        j[k] = std::cos(k * angle);
        slope -= k * amplitudes[k] * std::sin(k * angle);
      }
      const double off = levels[i] - amplitudes.dot(j.head<kLinear>());
      j[kLinear] = slope;
      j[kLinear + 1] = s * slope;
      normal += j * j.transpose();
      right += j * off;
    }
    const Vector step = solved<kAll>(normal, right);
    if (!step.allFinite()) return wave;
    amplitudes += step.head<kLinear>();
    if (iteration == 0) continue;
    constexpr double kLargest_rad = 0.3;
    const double scale = std::min(1.0, kLargest_rad / std::max(std::abs(step[kLinear]), std::abs(step[kLinear + 1])));
    wave.phase_rad += scale * step[kLinear];
    wave.rate += scale * step[kLinear + 1];
    if (!(wave.rate > 0)) return {};
    if (step.tail<2>().norm() < 1e-10) return wave;
  }
  return wave;
}

// Isotonic regression: the increasing sequence with the least squared distance from the values, by pooling adjacent
// violators.
std::vector<double> increasing(const std::vector<double>& values) {
  struct Block {
    double sum;
    size_t count;
    double mean() const { return sum / static_cast<double>(count); }
  };
  std::vector<Block> blocks;
  for (const double value : values) {
    blocks.push_back({value, 1});
    while (blocks.size() > 1 && blocks[blocks.size() - 2].mean() > blocks.back().mean()) {
      blocks[blocks.size() - 2].sum += blocks.back().sum;
      blocks[blocks.size() - 2].count += blocks.back().count;
      blocks.pop_back();
    }
  }
  std::vector<double> result;
  for (const Block& block : blocks) result.insert(result.end(), block.count, block.mean());
  return result;
}

struct LevelOfCosine {
  double cosine, level;
};

// The exponent of levels that are a power of (1 + cos) / 2, between the least and the greatest level; 0 if they are not.
double power_of(const std::vector<LevelOfCosine>& sorted) {
  constexpr double kMostOff = 0.01;
  const double low = sorted.front().level, range = sorted.back().level - low;
  double products = 0, squares = 0;
  for (const auto& [cosine, level] : sorted) {
    const double base = 0.5 + 0.5 * cosine, share = (level - low) / range;
    if (base < 0.25 || base > 0.9 || share <= 0) continue;  // rounding matters less than in the dark
    products += std::log(base) * std::log(share);
    squares += std::log(base) * std::log(base);
  }
  if (squares == 0) return 0;
  const double gamma = products / squares;
  double off = 0;
  for (const auto& [cosine, level] : sorted)
    off += std::pow((level - low) / range - std::pow(std::max(0.0, 0.5 + 0.5 * cosine), gamma), 2);
  return std::sqrt(off / static_cast<double>(sorted.size())) < kMostOff ? gamma : 0;
}

}  // namespace

CosineFit fit_cosine(const std::vector<double>& levels) {
  // The spectrum does not resolve less than about three cycles over the image.
  constexpr double kLeastCycles = 0.25, kMostCycles = 3.5, kCycleStep = 0.25;
  Wave3 slow = wave_at(levels, kTwoPi * kLeastCycles);
  for (double cycles = kLeastCycles + kCycleStep; cycles <= kMostCycles; cycles += kCycleStep) {
    const Wave3 wave = wave_at(levels, kTwoPi * cycles);
    if (wave.square < slow.square) slow = wave;
  }
  slow = refined_wave(levels, slow.rate);
  const Wave3 fast = refined_wave(levels, spectral_peak(levels));
  return cosine_of(levels, slow.square < fast.square ? slow : fast);
}

CosineFit fit_cosine(const std::vector<double>& levels, double period_px) {
  return cosine_of(levels, wave_at(levels, turn_rate(period_px, levels.size())));
}

CosineFit fit_cosine(const std::vector<double>& levels, double period_px, double shift_rad) {
  Eigen::Matrix2d normal = Eigen::Matrix2d::Zero();
  Eigen::Vector2d right = Eigen::Vector2d::Zero();
  for (size_t i = 0; i < levels.size(); ++i) {
    const Eigen::Vector2d basis(1, std::cos(kTwoPi * (static_cast<double>(i) + 0.5) / period_px + shift_rad));
    normal += basis * basis.transpose();
    right += basis * levels[i];
  }
  const Eigen::Vector2d linear = solved<2>(normal, right);
  CosineFit fit;
  fit.period_px = period_px;
  fit.shift_rad = shift_rad;
  fit.mean = linear[0];
  fit.modulation = linear[1];
  return with_residuals(levels, fit);
}

DistortedCosineFit fit_distorted_cosine(const std::vector<double>& levels, const CosineFit& start) {
  const double rate = turn_rate(start.period_px, levels.size());
  const EvenWave wave = refined_even_wave(levels, {rate, start.shift_rad + 0.5 * rate});
  DistortedCosineFit fit;
  if (!(wave.rate > 0)) return fit;
  fit.period_px = period_of_rate(wave.rate, levels.size());
  fit.shift_rad = shift_of_phase(wave.phase_rad, wave.rate);
  std::vector<LevelOfCosine> sorted;
  for (size_t i = 0; i < levels.size(); ++i)
    sorted.push_back({std::cos(wave.rate * cosine_position(i, levels.size()) + wave.phase_rad), levels[i]});
  std::stable_sort(sorted.begin(), sorted.end(),
                   [](const LevelOfCosine& a, const LevelOfCosine& b) { return a.cosine < b.cosine; });
  std::vector<double> values;
  for (const LevelOfCosine& each : sorted) values.push_back(each.level);
  const std::vector<double> monotone = increasing(values);
  double square = 0;
  for (size_t i = 0; i < values.size(); ++i) square += std::pow(values[i] - monotone[i], 2);
  fit.rms = std::sqrt(square / static_cast<double>(levels.size()));
  if (monotone.back() > monotone.front()) fit.gamma = power_of(sorted);
  return fit;
}

}  // namespace fringeslam
