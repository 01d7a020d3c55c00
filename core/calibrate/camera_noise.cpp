// SPDX-License-Identifier: Apache-2.0
#include "core/calibrate/camera_noise.h"

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <numbers>
#include <optional>

#include "core/calibrate/median.h"
#include "core/patterns/patterns.h"
#include "core/types/error.h"
#include "core/types/grey_value.h"
#include "core/types/linear_algebra.h"

namespace fringeslam {

namespace {

constexpr int kTiles = 8;         // the image is divided into kTiles x kTiles tiles,
constexpr int kBlocks = 16;       // of which every 4th in both directions forms a block of the jackknife
constexpr int kHarmonics = 5;     // harmonics 2 to 6 of a waveform
constexpr double kDarkestDn = 2;  // samples whose expected grey value is below may be clipped at 0
// Half of the 95 % confidence interval in standard errors: Student's t for kBlocks - 1 degrees of freedom.
constexpr double kStudent = 2.131;

// --- linear model of a stack ---

// Images of one pattern sequence as a linear function of per-pixel parameters.
struct StackModel {
  std::vector<int> images;  // the images that the model describes
  std::vector<FringeGroup> groups;
  Eigen::MatrixXd parameters;  // p x N: least-squares parameters = parameters * grey values
  Eigen::MatrixXd design;      // N x p: expected grey values = design * parameters
  Eigen::MatrixXd residual;    // N x d: orthonormal; noise samples = residual^T * grey values
};

// Appends a column for every parameter and returns its index.
class Design {
 public:
  explicit Design(size_t images) : rows_(images) {}
  int column() {
    for (auto& row : rows_) row.push_back(0);
    return columns_++;
  }
  void set(int image, int column, double value) {
    rows_[static_cast<size_t>(image)][static_cast<size_t>(column)] = value;
  }
  std::vector<int> described_images() const {
    std::vector<int> images;
    for (size_t i = 0; i < rows_.size(); ++i) {
      if (std::any_of(rows_[i].begin(), rows_[i].end(), [](double v) { return v != 0; }))
        images.push_back(static_cast<int>(i));
    }
    return images;
  }
  Eigen::MatrixXd matrix(const std::vector<int>& images) const {
    Eigen::MatrixXd m(static_cast<int>(images.size()), columns_);
    for (size_t i = 0; i < images.size(); ++i) {
      for (int c = 0; c < columns_; ++c)
        m(static_cast<int>(i), c) = rows_[static_cast<size_t>(images[i])][static_cast<size_t>(c)];
    }
    return m;
  }

 private:
  std::vector<std::vector<double>> rows_;
  int columns_ = 0;
};

void add_fringes(Design& design, const std::vector<FringeGroup>& groups) {
  if (groups.empty()) return;
  const int mean = design.column();
  for (const FringeGroup& group : groups) {
    const int cosine = design.column(), sine = design.column();
    for (size_t k = 0; k < group.images.size(); ++k) {
      design.set(group.images[k], mean, 1);
      design.set(group.images[k], cosine, std::cos(group.shifts_rad[k]));
      design.set(group.images[k], sine, -std::sin(group.shifts_rad[k]));
    }
  }
}

// Gray bits with their inverses, and white with black: each pair has the same sum.
void add_pairs(Design& design, const PatternSequence& sequence) {
  std::vector<GrayBit> pairs;
  for (const Axis axis : {Axis::columns, Axis::rows}) {
    for (const GrayBit& bit : gray_bits(sequence, axis)) {
      if (bit.image >= 0 && bit.inverted_image >= 0) pairs.push_back(bit);
    }
  }
  std::vector<int> white, black;
  for (size_t i = 0; i < sequence.patterns.size(); ++i) {
    const Pattern& pattern = sequence.patterns[i];
    if (pattern.coding != Coding::flat) continue;
    if (pattern.level == 1) white.push_back(static_cast<int>(i));
    if (pattern.level == 0) black.push_back(static_cast<int>(i));
  }
  const bool flats = !white.empty() && !black.empty();
  if (pairs.empty() && !(flats && white.size() + black.size() > 2)) return;
  const int mean = design.column();
  for (const GrayBit& bit : pairs) {
    const int contrast = design.column();
    design.set(bit.image, mean, 1), design.set(bit.inverted_image, mean, 1);
    design.set(bit.image, contrast, 1), design.set(bit.inverted_image, contrast, -1);
  }
  if (!flats) return;
  const int contrast = design.column();
  for (const int image : white) design.set(image, mean, 1), design.set(image, contrast, 1);
  for (const int image : black) design.set(image, mean, 1), design.set(image, contrast, -1);
}

StackModel model_of(const PatternSequence& sequence) {
  StackModel model;
  for (const Axis axis : {Axis::columns, Axis::rows}) {
    for (FringeGroup& group : fringe_groups(sequence, axis)) model.groups.push_back(std::move(group));
  }
  Design design(sequence.patterns.size());
  add_fringes(design, model.groups);
  add_pairs(design, sequence);
  model.images = design.described_images();
  model.design = design.matrix(model.images);
  if (model.images.empty()) return model;
  const Eigen::MatrixXd gram = model.design.transpose() * model.design;
  model.parameters = inverse_positive_definite(gram) * model.design.transpose();
  // The null space of design design^T.
  const SymmetricEigen<Eigen::Dynamic> eigen =
      symmetric_eigen(Eigen::MatrixXd(model.design * model.design.transpose()));
  model.residual = eigen.vectors.leftCols(model.design.rows() - model.design.cols());
  // Positions of the groups' images among the described images.
  for (FringeGroup& group : model.groups) {
    for (int& image : group.images)
      image =
          static_cast<int>(std::lower_bound(model.images.begin(), model.images.end(), image) - model.images.begin());
  }
  return model;
}

// --- pixels ---

uint8_t block_of(int row, int col, const cv::Size& size) {
  const int r = row * kTiles / size.height, c = col * kTiles / size.width;
  return static_cast<uint8_t>(r % 4 * 4 + c % 4);
}

// Calls visit(row, col) for about `count` pixels in a regular grid; the pixel to the right is inside the image, too.
template <class Visit>
void for_grid(const cv::Size& size, int count, Visit&& visit) {
  const int stride = std::max(1, static_cast<int>(std::sqrt(static_cast<double>(size.area()) / count)));
  for (int row = 0; row < size.height; row += stride) {
    for (int col = 0; col + 1 < size.width; col += stride) visit(row, col);
  }
}

// Grey values of one pixel and what the model makes of them.
struct PixelFit {
  Eigen::VectorXd grey, parameters, expected, residual;

  // Returns false if a sample is saturated.
  bool fit(const StackModel& model, const FringeStack& stack, int row, int col, double limit_dn) {
    grey.resize(static_cast<int>(model.images.size()));
    for (size_t i = 0; i < model.images.size(); ++i) {
      const float y = grey_value(stack.images[static_cast<size_t>(model.images[i])], row, col);
      if (!(static_cast<double>(y) < limit_dn)) return false;
      grey[static_cast<int>(i)] = static_cast<double>(y);
    }
    parameters.noalias() = model.parameters * grey;
    expected.noalias() = model.design * parameters;
    residual.noalias() = model.residual.transpose() * grey;
    return true;
  }
};

// Residuals that a nonlinear projector and flicker would cause: residual = derivatives * coefficients, with one
// coefficient per image (relative brightness) followed by a cosine and a sine per group and harmonic.
void derivatives_of(const StackModel& model, const PixelFit& pixel, Eigen::MatrixXd& in_images,
                    Eigen::MatrixXd& derivatives) {
  const auto images = static_cast<int>(model.images.size());
  in_images.setZero(images, images + static_cast<int>(model.groups.size()) * 2 * kHarmonics);
  for (int i = 0; i < images; ++i) in_images(i, i) = pixel.expected[i];
  int column = images;
  for (size_t g = 0; g < model.groups.size(); ++g) {
    const FringeGroup& group = model.groups[g];
    const double c = pixel.parameters[1 + 2 * static_cast<int>(g)], s = pixel.parameters[2 + 2 * static_cast<int>(g)];
    const double modulation = std::max(std::hypot(c, s), 1e-9);
    for (size_t k = 0; k < group.images.size(); ++k) {
      const int image = group.images[k];
      // The angle phase + shift as a complex number of modulus 1, and its powers.
      const std::complex<double> turn = std::complex<double>(c, s) / modulation * std::polar(1.0, group.shifts_rad[k]);
      std::complex<double> power = modulation * turn;
      for (int m = 0; m < kHarmonics; ++m) {
        power *= turn;
        in_images(image, column + 2 * m) = power.real();
        in_images(image, column + 2 * m + 1) = power.imag();
      }
    }
    column += 2 * kHarmonics;
  }
  derivatives.noalias() = model.residual.transpose() * in_images;
}

// Coefficients of the deterministic residuals by least squares with a prior, which keeps combinations near zero that the
// residuals hardly show, such as a factor common to all images.
class Regression {
 public:
  void add(const Eigen::MatrixXd& derivatives, const Eigen::VectorXd& residual, double weight) {
    if (normal_.size() == 0) {
      normal_.setZero(derivatives.cols(), derivatives.cols());
      right_.setZero(derivatives.cols());
    }
    normal_.noalias() += weight * derivatives.transpose() * derivatives;
    right_.noalias() += weight * derivatives.transpose() * residual;
  }
  // `scale` is the variance of a residual of weight 1.
  Eigen::VectorXd solve(double scale, Eigen::Index images) const {
    constexpr double kBrightness = 0.02, kHarmonic = 0.1;  // standard deviations of the prior
    Eigen::MatrixXd normal = normal_ / scale;
    for (Eigen::Index i = 0; i < normal.rows(); ++i) {
      const double sigma = i < images ? kBrightness : kHarmonic;
      normal(i, i) += 1 / (sigma * sigma);
    }
    return solve_positive_definite(normal, right_ / scale);
  }

 private:
  Eigen::MatrixXd normal_;
  Eigen::VectorXd right_;
};

// Correlation of pairs (x, y) of zero mean whose products are limited, so that single outliers do not dominate.
double limited_correlation(const std::vector<std::pair<double, double>>& pairs) {
  if (pairs.empty()) return 0;
  std::vector<double> sizes;
  for (const auto& [x, y] : pairs) sizes.push_back(std::max(std::abs(x), std::abs(y)));
  const double limit = 4 * median(std::move(sizes));
  double products = 0, squares = 0;
  for (auto [x, y] : pairs) {
    x = std::clamp(x, -limit, limit), y = std::clamp(y, -limit, limit);
    products += x * y;
    squares += 0.5 * (x * x + y * y);
  }
  return squares > 0 ? products / squares : 0;
}

// --- saturation ---

// Grey value at which the histogram (256 bins over the full scale) piles up at its upper end; the full scale if it
// does not.
double saturation_of(const std::vector<int64_t>& histogram, double max_dn) {
  size_t last = histogram.size();
  while (last > 0 && histogram[last - 1] == 0) --last;
  if (last < 32 || last == histogram.size()) return max_dn;
  // Noise spreads the brightest values of an unsaturated camera over several bins.
  constexpr size_t kBelow = 16;
  constexpr double kExcess = 8, kShare = 5e-4;
  int64_t all = 0, below = 0;
  for (const int64_t count : histogram) all += count;
  for (size_t i = 0; i < kBelow; ++i) below += histogram[last - 3 - i];
  const auto pile = static_cast<double>(histogram[last - 1]);
  const bool piled = pile > kShare * static_cast<double>(all) && pile > kExcess * static_cast<double>(below) / kBelow;
  return piled ? max_dn * static_cast<double>(last - 1) / 255 : max_dn;
}

// --- variance over grey value ---

// Huber's scale (proposal 2): E min((x / s)^2, limit^2) equals its value for the normal distribution. Unlike a median,
// it varies smoothly even if the samples take only a few values.
double robust_variance(const std::vector<float>& samples) {
  constexpr double kLimit = 1.5;
  const double density = std::exp(-0.5 * kLimit * kLimit) / std::sqrt(2 * std::numbers::pi);
  const double outside = std::erfc(kLimit / std::numbers::sqrt2);
  const double expected = 1 - outside - 2 * kLimit * density + kLimit * kLimit * outside;
  double variance = 0;
  for (const float x : samples) variance += static_cast<double>(x) * static_cast<double>(x);
  variance /= static_cast<double>(std::max<size_t>(1, samples.size()));
  for (int iteration = 0; iteration < 100 && variance > 0; ++iteration) {
    const double limit = kLimit * kLimit * variance;
    double sum = 0;
    for (const float x : samples) sum += std::min(static_cast<double>(x) * static_cast<double>(x), limit);
    const double next = sum / static_cast<double>(samples.size()) / expected;
    if (std::abs(next - variance) < 1e-6 * variance) return next;
    variance = next;
  }
  return variance;
}

// variance = slope * grey + constant.
struct Line {
  double slope = 0, constant = 0;
  double at(double grey_dn) const { return slope * grey_dn + constant; }
};

// Weighted least squares; the weights follow from the fitted variances. No bin counts for more than a relative standard
// error of kModelError, since the line itself is an approximation.
std::optional<Line> fit_line(const std::vector<NoiseBin>& bins) {
  constexpr double kModelError = 0.03;
  if (bins.size() < 3) return std::nullopt;
  Line line;
  for (int iteration = 0; iteration < 20; ++iteration) {
    double w = 0, wx = 0, wy = 0, wxx = 0, wxy = 0;
    for (const NoiseBin& bin : bins) {
      const double fitted = iteration == 0 ? bin.variance_dn2 : std::max(line.at(bin.grey_dn), 0.1 * bin.variance_dn2);
      const double relative = 2 / static_cast<double>(bin.samples) + kModelError * kModelError;
      const double weight = 1 / (fitted * fitted * relative);
      w += weight, wx += weight * bin.grey_dn, wy += weight * bin.variance_dn2;
      wxx += weight * bin.grey_dn * bin.grey_dn, wxy += weight * bin.grey_dn * bin.variance_dn2;
    }
    const double determinant = w * wxx - wx * wx;
    if (!(determinant > 1e-12 * w * wxx)) return std::nullopt;
    line.slope = (w * wxy - wx * wy) / determinant;
    line.constant = (wxx * wy - wx * wxy) / determinant;
  }
  return line;
}

// Sensor parameters of a line. Images show the offset and the dark noise only in combination: the offset remains the
// known one unless the variance at black would then be less than that of rounding.
struct LineParameters {
  double gain = 0, dark_noise = 0, offset = 0;
};
LineParameters parameters_of(const Line& line, double known_offset_dn) {
  const double dark = line.at(known_offset_dn) - 1.0 / 12;
  LineParameters p{line.slope, 0, known_offset_dn};
  if (dark >= 0)
    p.dark_noise = std::sqrt(dark) / line.slope;
  else
    p.offset -= dark / line.slope;
  return p;
}

}  // namespace

int noise_samples_per_pixel(const PatternSequence& sequence) {
  const StackModel model = model_of(sequence);
  return static_cast<int>(model.residual.cols());
}

NoiseEstimator::NoiseEstimator(const SensorModel& prior, const NoiseOptions& options)
    : prior_(prior), options_(options), histogram_(256, 0) {
  check_options(options, "noise");
}

void NoiseEstimator::add(const FringeStack& stack) {
  check_stack(stack);
  const std::vector<Pattern>& patterns = stack.patterns.patterns;
  if (std::any_of(patterns.begin(), patterns.end(),
                  [&](const Pattern& pattern) { return pattern.exposure != patterns.front().exposure; }))
    throw Error("stack " + std::to_string(stack.index) +
                " has patterns at several exposures; measure the noise at one of them");
  const cv::Size size = stack.images[0].size();
  for (const cv::Mat& image : stack.images) {
    for_grid(size, options_.max_pixels, [&](int row, int col) {
      const double level = static_cast<double>(grey_value(image, row, col)) / prior_.max_dn() * 255;
      ++histogram_[static_cast<size_t>(std::clamp(level, 0.0, 255.0))];
    });
  }
  add_residuals(stack);
  if (previous_patterns_ == stack.patterns && previous_.size() == stack.images.size() && previous_[0].size() == size)
    add_differences(stack);
  previous_ = stack.images;
  previous_patterns_ = stack.patterns;
}

void NoiseEstimator::add_residuals(const FringeStack& stack) {
  const StackModel model = model_of(stack.patterns);
  if (model.residual.cols() == 0) return;
  const cv::Size size = stack.images[0].size();
  const double limit_dn = options_.saturation * saturation_of(histogram_, prior_.max_dn());
  const Eigen::MatrixXd squared = model.residual.cwiseAbs2().transpose();
  PixelFit pixel;
  Eigen::MatrixXd in_images, derivatives;
  // The second regression leaves out pixels whose residuals the first could not explain.
  Eigen::VectorXd coefficients;
  double typical = 0;
  for (int pass = 0; pass < 2; ++pass) {
    Regression regression;
    std::vector<double> sizes;
    int used = 0;
    for_grid(size, options_.max_pixels / 4, [&](int row, int col) {
      if (!pixel.fit(model, stack, row, col, limit_dn) || pixel.expected.minCoeff() < kDarkestDn) return;
      derivatives_of(model, pixel, in_images, derivatives);
      const double variance = pixel.grey.mean() + 10;  // up to a factor
      Eigen::VectorXd left = pixel.residual;
      if (pass > 0) left.noalias() -= derivatives * coefficients;
      const double normalized = left.squaredNorm() / variance;
      if (pass == 0) {
        sizes.push_back(normalized);
      } else if (normalized > 9 * typical * static_cast<double>(model.residual.cols())) {
        return;
      }
      ++used;
      regression.add(derivatives, pixel.residual, 1 / variance);
    });
    if (used < 100) return;
    if (pass == 0) typical = std::max(median(std::move(sizes)) / static_cast<double>(model.residual.cols()), 1e-6);
    coefficients = regression.solve(typical, static_cast<Eigen::Index>(model.images.size()));
  }
  // The remaining deterministic residuals, such as indirect light, vary smoothly over the image, and harmonics whose
  // amplitude varies over the image vary only across the fringes. The second difference over kDistance px along
  // the rows or the columns, whichever is smaller, removes both; over 1 px it would also remove noise that
  // interpolation has correlated.
  constexpr int kDistance = 3;
  constexpr double kWeights[3] = {1, -2, 1};
  const double norm = std::sqrt(6.0);
  struct Difference {
    Eigen::VectorXd noise, grey;
    double darkest = 0;
  };
  bool along_rows = true;
  const auto difference_at = [&](int row, int col, Difference& d) {
    const int at = along_rows ? col : row, length = along_rows ? size.width : size.height;
    if (at < kDistance || at + kDistance >= length) return false;
    d.darkest = prior_.max_dn();
    d.noise.setZero(model.residual.cols());
    d.grey.setZero(model.residual.cols());
    for (int i = 0; i < 3; ++i) {
      const int step = (i - 1) * kDistance;
      if (!pixel.fit(model, stack, along_rows ? row : row + step, along_rows ? col + step : col, limit_dn))
        return false;
      derivatives_of(model, pixel, in_images, derivatives);
      d.noise += kWeights[i] / norm * (pixel.residual - derivatives * coefficients);
      d.grey += kWeights[i] * kWeights[i] / 6 * (squared * pixel.grey);
      d.darkest = std::min(d.darkest, pixel.expected.minCoeff());
    }
    return true;
  };
  constexpr int kCompared = 4;  // every kCompared-th pixel is compared with its neighbour
  std::vector<std::pair<double, double>> neighbours;
  Difference here, beside;
  double least = 0;
  bool best = true;
  for (const bool rows : {true, false}) {
    along_rows = rows;
    std::vector<double> sizes;
    for_grid(size, options_.max_pixels / 16, [&](int row, int col) {
      if (difference_at(row, col, here) && here.darkest >= kDarkestDn)
        sizes.push_back(here.noise.squaredNorm() / (here.grey.mean() + 10));
    });
    const double typical_size = sizes.empty() ? 0 : median(std::move(sizes));
    if (rows || typical_size < least) best = rows, least = typical_size;
  }
  along_rows = best;
  int visited = 0;
  for_grid(size, options_.max_pixels, [&](int row, int col) {
    if (!difference_at(row, col, here)) return;
    for (int j = 0; j < here.noise.size(); ++j)
      samples_.push_back({static_cast<float>(here.grey[j]), static_cast<float>(here.noise[j]),
                          static_cast<float>(here.darkest), block_of(row, col, size)});
    if (here.darkest < kDarkestDn || ++visited % kCompared != 0 || !difference_at(row, col + 1, beside)) return;
    for (int j = 0; j < here.noise.size(); ++j) neighbours.emplace_back(here.noise[j], beside.noise[j]);
  });
  ++residual_stacks_;
  correlations_.push_back(limited_correlation(neighbours));
  const auto images = static_cast<int>(model.images.size());
  // With few residuals, combinations of brightness and harmonics are indistinguishable.
  if (model.residual.cols() < 3) return;
  const Eigen::VectorXd brightness = coefficients.head(images).array() - coefficients.head(images).mean();
  flicker_.push_back(std::sqrt(brightness.squaredNorm() / images));
  const auto harmonics = coefficients.tail(coefficients.size() - images);
  double largest = 0;
  for (int i = 0; i + 1 < harmonics.size(); i += 2)
    largest = std::max(largest, std::hypot(harmonics[i], harmonics[i + 1]));
  harmonics_.push_back(largest);
}

void NoiseEstimator::add_differences(const FringeStack& stack) {
  const cv::Size size = stack.images[0].size();
  const double limit_dn = options_.saturation * saturation_of(histogram_, prior_.max_dn());
  std::vector<Sample> samples;
  std::vector<std::pair<double, double>> neighbours;
  for (size_t i = 0; i < stack.images.size(); ++i) {
    const cv::Mat &now = stack.images[i], &before = previous_[i];
    double products = 0, squares = 0;
    for_grid(size, options_.max_pixels, [&](int row, int col) {
      const double a = static_cast<double>(grey_value(now, row, col)),
                   b = static_cast<double>(grey_value(before, row, col));
      if (a >= limit_dn || b >= limit_dn) return;
      products += a * b, squares += b * b;
    });
    if (squares == 0) continue;
    const double factor = products / squares, norm = std::sqrt(1 + factor * factor);
    const auto difference = [&](int row, int col) {
      return (static_cast<double>(grey_value(now, row, col)) -
              factor * static_cast<double>(grey_value(before, row, col))) /
             norm;
    };
    for_grid(size, std::max(1000, options_.max_pixels / static_cast<int>(stack.images.size())), [&](int row, int col) {
      const double a = static_cast<double>(grey_value(now, row, col)),
                   b = static_cast<double>(grey_value(before, row, col));
      if (a >= limit_dn || b >= limit_dn) return;
      const double grey = 0.5 * (a + b), noise = difference(row, col);
      samples.push_back(
          {static_cast<float>(grey), static_cast<float>(noise), static_cast<float>(grey), block_of(row, col, size)});
      if (grey > kDarkestDn) neighbours.emplace_back(noise, difference(row, col + 1));
    });
  }
  if (std::abs(limited_correlation(neighbours)) > options_.max_correlation) return;
  samples_.insert(samples_.end(), samples.begin(), samples.end());
  ++repeated_stacks_;
}

CameraNoise NoiseEstimator::estimate() const {
  if (residual_stacks_ + repeated_stacks_ == 0)
    throw Error(
        "the images contain no redundancy that shows noise; more than three steps of a period, two periods, or Gray "
        "codes with inverses are required, or two or more stacks of a static view");
  CameraNoise result;
  result.sensor = prior_;
  result.residual_stacks = residual_stacks_;
  result.repeated_stacks = repeated_stacks_;
  if (!flicker_.empty()) result.flicker = median(flicker_);
  if (!harmonics_.empty()) result.harmonics = median(harmonics_);
  if (!correlations_.empty()) result.correlation = median(correlations_);
  result.saturation_dn = saturation_of(histogram_, prior_.max_dn());
  const double top_dn = options_.saturation * result.saturation_dn;

  // Bins of one jackknife replicate, or of all samples if `without` is negative.
  double darkest_dn = kDarkestDn;
  std::optional<Line> line;
  // Variance by which samples are divided before they are pooled: that of the previous fit, because a mixture of
  // variances would have heavier tails than the normal distribution.
  const auto pooling_variance = [&](double grey_dn) {
    constexpr double kLeast = 1.0 / 24;
    return line ? std::max(line->at(grey_dn), kLeast) : 1.0;
  };
  const auto binned = [&](int without) {
    std::vector<std::vector<float>> noise(static_cast<size_t>(options_.bins));
    std::vector<double> grey(noise.size(), 0);
    for (const Sample& sample : samples_) {
      const double y = static_cast<double>(sample.grey_dn);
      if (sample.block == without || static_cast<double>(sample.darkest_dn) < darkest_dn || y >= top_dn) continue;
      const auto bin = static_cast<size_t>(y / top_dn * options_.bins);
      noise[bin].push_back(sample.noise_dn / static_cast<float>(std::sqrt(pooling_variance(y))));
      grey[bin] += y;
    }
    std::vector<NoiseBin> bins;
    for (size_t i = 0; i < noise.size(); ++i) {
      if (noise[i].size() < static_cast<size_t>(options_.min_bin_samples)) continue;
      const auto count = static_cast<double>(noise[i].size());
      const double variance = robust_variance(noise[i]) * pooling_variance(grey[i] / count);
      // Below that of rounding, grey values repeat without showing the noise.
      if (variance > 1.0 / 12) bins.push_back({grey[i] / count, variance, static_cast<int64_t>(noise[i].size())});
    }
    return bins;
  };
  // Samples within three sigmas of black are clipped at zero; the sigma there follows from the first fit.
  for (int pass = 0; pass < 3; ++pass) {
    result.bins = binned(-1);
    result.samples = 0;
    for (const NoiseBin& bin : result.bins) result.samples += bin.samples;
    if (result.samples < options_.min_samples)
      throw Error("only " + std::to_string(result.samples) + " of " + std::to_string(samples_.size()) +
                  " noise samples are neither saturated nor black; at least " + std::to_string(options_.min_samples) +
                  " are required: correct the exposure, or use more images");
    line = fit_line(result.bins);
    if (!line)
      throw Error("the images cover too few grey levels (" + std::to_string(result.bins.size()) +
                  " bins); use a view with bright and dark parts");
    darkest_dn = std::max(kDarkestDn, 3 * std::sqrt(std::max(0.0, line->at(kDarkestDn))));
  }
  if (!(line->slope > 0))
    throw Error(
        "the noise does not grow with the grey value, as photon noise does; the images seem processed or the view "
        "moved");
  const LineParameters best = parameters_of(*line, prior_.offset_dn);

  std::vector<LineParameters> replicates;
  for (int block = 0; block < kBlocks; ++block) {
    const auto replicate = fit_line(binned(block));
    if (replicate && replicate->slope > 0) replicates.push_back(parameters_of(*replicate, prior_.offset_dn));
  }
  const auto interval = [&](double value, auto&& of) {
    double mean = 0, squares = 0;
    const auto n = static_cast<double>(replicates.size());
    for (const LineParameters& p : replicates) mean += of(p) / n;
    for (const LineParameters& p : replicates) squares += (of(p) - mean) * (of(p) - mean);
    const double half = kStudent * std::sqrt(squares * (n - 1) / n);
    return NoiseInterval{value, std::max(0.0, value - half), value + half};
  };
  // Those that fail are the most deviant ones, without which the interval would be too small.
  if (replicates.size() < kBlocks)
    throw Error("the noise samples cover too little of the image for a confidence interval");
  result.gain_dn_per_electron = interval(best.gain, [](const LineParameters& p) { return p.gain; });
  result.dark_noise_electrons = interval(best.dark_noise, [](const LineParameters& p) { return p.dark_noise; });
  result.offset_dn = interval(best.offset, [](const LineParameters& p) { return p.offset; });

  double squares = 0, weights = 0;
  for (const NoiseBin& bin : result.bins) {
    const double deviation = bin.variance_dn2 / std::max(line->at(bin.grey_dn), 1e-9) - 1;
    const double weight = 1 / (2 / static_cast<double>(bin.samples) + 0.03 * 0.03);
    squares += weight * deviation * deviation, weights += weight;
  }
  result.nonlinearity = std::sqrt(squares / weights);
  result.sensor.gain_dn_per_electron = best.gain;
  result.sensor.dark_noise_electrons = best.dark_noise;
  result.sensor.offset_dn = best.offset;
  result.sensor.full_well_electrons = (result.saturation_dn - best.offset) / best.gain;
  return result;
}

}  // namespace fringeslam
