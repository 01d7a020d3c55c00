// SPDX-License-Identifier: Apache-2.0
#include "core/registration/ambiguity.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "core/base/constants.h"
#include "core/base/parallel.h"
#include "core/base/symmetric_filter.h"
#include "core/registration/plane_pairs.h"
#include "core/types/linear_algebra.h"
#include "core/types/projection.h"
#include "core/types/selected_instruction_set.h"

namespace fringeslam {

namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

// Texture without the illumination, which moves with the projector: the relative deviation from the mean of the
// measured surroundings. Zero without a depth, where shadows move as well.
cv::Mat1f relative_texture(const Frame& frame) {
  constexpr int kSurroundings_px = 31;
  constexpr double kDark = 4, kSharpness_px = 0.7;  // dark pixels are noise
  const int width = frame.width(), height = frame.height();
  cv::Mat1f grey, mask(height, width), masked(height, width);
  frame.texture.convertTo(grey, CV_32F);
  for_each_row(height, [&](int row) {
    for (int col = 0; col < width; ++col) {
      mask(row, col) = frame.valid(row, col) ? 1.0f : 0.0f;
      masked(row, col) = frame.valid(row, col) ? grey(row, col) : 0.0f;
    }
  });
  cv::Mat1f mean, share;
  const cv::Size window(kSurroundings_px, kSurroundings_px);
  cv::blur(masked, mean, window, {-1, -1}, cv::BORDER_REFLECT);
  cv::blur(mask, share, window, {-1, -1}, cv::BORDER_REFLECT);
  grey = filtered(grey, gaussian_half(kSharpness_px), FilterBorder::mirrored, selected_instruction_set());
  cv::Mat1f relative(height, width);
  for_each_row(height, [&](int row) {
    for (int col = 0; col < width; ++col) {
      const float around = mean(row, col) / std::max(share(row, col), 1e-3f);
      relative(row, col) = mask(row, col) > 0 ? (grey(row, col) - around) / (around + static_cast<float>(kDark)) : 0.0f;
    }
  });
  return relative;
}

// A view prepared for comparison.
struct Side {
  const Frame& frame;
  cv::Mat1f texture;

  explicit Side(const Frame& f) : frame(f), texture(relative_texture(f)) {}
};

struct Pixel {
  float x = 0, y = 0, z = 0;  // the point in the other camera, m
  float u = 0, v = 0;         // px
  bool inside = false;        // by at least one pixel
};

Pixel projected(const Projection& p, const cv::Vec3f& point) {
  Pixel at;
  at.x = p.r[0] * point[0] + p.r[1] * point[1] + p.r[2] * point[2] + p.t[0];
  at.y = p.r[3] * point[0] + p.r[4] * point[1] + p.r[5] * point[2] + p.t[1];
  at.z = p.r[6] * point[0] + p.r[7] * point[1] + p.r[8] * point[2] + p.t[2];
  if (!(at.z > 0)) return at;
  const float a = at.x / at.z, b = at.y / at.z, r2 = a * a + b * b, radial = 1 + r2 * (p.k1 + r2 * (p.k2 + r2 * p.k3));
  at.u = p.fx * (a * radial + 2 * p.p1 * a * b + p.p2 * (r2 + 2 * a * a)) + p.cx;
  at.v = p.fy * (b * radial + p.p1 * (r2 + 2 * b * b) + 2 * p.p2 * a * b) + p.cy;
  at.inside =
      at.u >= 1 && at.v >= 1 && at.u < static_cast<float>(p.width - 2) && at.v < static_cast<float>(p.height - 2);
  return at;
}

Eigen::Vector3f rotated(const Projection& p, const cv::Vec3f& v) {
  return {p.r[0] * v[0] + p.r[1] * v[1] + p.r[2] * v[2], p.r[3] * v[0] + p.r[4] * v[1] + p.r[5] * v[2],
          p.r[6] * v[0] + p.r[7] * v[1] + p.r[8] * v[2]};
}

struct Sampled {
  float value, du, dv;
};

// Bilinear interpolation, with derivatives.
Sampled sampled(const cv::Mat1f& image, float u, float v) {
  const int col = static_cast<int>(u), row = static_cast<int>(v);
  const float a = u - static_cast<float>(col), b = v - static_cast<float>(row);
  const float p00 = image(row, col), p01 = image(row, col + 1), p10 = image(row + 1, col),
              p11 = image(row + 1, col + 1);
  const float top = p00 + a * (p01 - p00), bottom = p10 + a * (p11 - p10);
  return {top + b * (bottom - top), (1 - b) * (p01 - p00) + b * (p11 - p10), bottom - top};
}

// Pixels between samples: about 30,000 samples per view.
int stride_of(const Frame& frame) {
  constexpr double kSamples = 30000;
  return std::max(1, static_cast<int>(std::lround(std::sqrt(frame.width() * frame.height() / kSamples))));
}

// Evidence of a block of samples of one view against the other: log-likelihoods, zero at best. Samples of a block share
// their errors, so each block counts as a few independent measurements only.
struct BlockEvidence {
  float log_likelihood = 0;
  float weight = 0;     // share of the block's samples that the other view can judge
  float structure = 0;  // log-likelihood that the block would lose at a place that looks different
};

constexpr int kBlockSamples = 4;  // per side of a block

class Comparison {
 public:
  Comparison(const Side& from, const Side& to, const Pinhole& camera, const Vector3d& from_normal)
      : from_(from), to_(to), camera_(camera), normal_(from_normal), stride_(stride_of(from.frame)) {
    const int block = kBlockSamples * stride_;
    rows_ = from.frame.height() / block;
    cols_ = from.frame.width() / block;
  }

  std::vector<BlockEvidence> at(const Pose& to_from_from) const {
    std::vector<BlockEvidence> blocks(static_cast<size_t>(rows_ * cols_));
    const Projection projection(to_from_from, camera_);
    for_each_row(rows_, [&](int row) {
      for (int col = 0; col < cols_; ++col)
        blocks[static_cast<size_t>(row * cols_ + col)] = block(row, col, projection);
    });
    return blocks;
  }

 private:
  // Depth residual of a point, squared and in sigmas; the nearest of the 3 x 3 pixels around, because edges are only
  // known to a pixel. NaN where the other view cannot judge it: where it has no depth, would see the surface from
  // behind, or sees another one in front.
  // A surface that the other view looks through contradicts the pose.
  float depth_square(const Eigen::Vector3f& n, float sigma_m, const Pixel& at) const {
    if (n[0] * at.x + n[1] * at.y + n[2] * at.z >= 0) return kNaN;  // seen from behind
    const float floor_m = 0.2f * at.z / static_cast<float>(camera_.fx);
    const int col = static_cast<int>(at.u + 0.5f), row = static_cast<int>(at.v + 0.5f);
    constexpr float kHidden = 9;  // three sigmas
    float least = std::numeric_limits<float>::infinity();
    bool hidden = false;
    for (int r = row - 1; r <= row + 1; ++r) {
      for (int c = col - 1; c <= col + 1; ++c) {
        const cv::Vec3f& q = to_.frame.points_m(r, c);
        const float residual = n[0] * (at.x - q[0]) + n[1] * (at.y - q[1]) + n[2] * (at.z - q[2]);
        const float other = to_.frame.sigma_m(r, c);
        const float square = residual * residual / (4 * (sigma_m * sigma_m + other * other) + floor_m * floor_m);
        if (!(square < least)) continue;  // true for NaN
        least = square;
        hidden = q[2] < at.z;
      }
    }
    return std::isinf(least) || (hidden && least > kHidden) ? kNaN : least;
  }

  BlockEvidence block(int block_row, int block_col, const Projection& projection) const {
    constexpr float kMostDepth = 5;                                             // nats
    constexpr float kTextureNoise = 0.04f, kMisplaced_px = 0.4f, kTexture = 2;  // measurements per block, halved
    constexpr float kShading = 0.15f;  // faces turn towards or away from the projector
    constexpr float kRelief_m = 1e-3f, kSameFace = 0.85f;
    const Frame& frame = from_.frame;
    float depth = 0, squares = 0, sum = 0, slopes = 0, own_sum = 0, own_squares = 0;
    int judged = 0, compared = 0;
    float least_height = std::numeric_limits<float>::infinity(), most_height = -least_height;
    for (int i = 0; i < kBlockSamples; ++i) {
      for (int j = 0; j < kBlockSamples; ++j) {
        const int row = (block_row * kBlockSamples + i) * stride_, col = (block_col * kBlockSamples + j) * stride_;
        const cv::Vec3f &point = frame.points_m(row, col), &normal = frame.normals(row, col);
        // Without a normal, the pixel sees an edge, and its depth and texture may be those of either side.
        if (std::isnan(normal[2])) continue;
        const float height = static_cast<float>(normal_.dot(vector_of(point)));
        least_height = std::min(least_height, height);
        most_height = std::max(most_height, height);
        const Pixel at = projected(projection, point);
        if (!at.inside) continue;
        const Eigen::Vector3f turned = rotated(projection, normal);
        const float square = depth_square(turned, frame.sigma_m(row, col), at);
        if (std::isnan(square)) continue;
        ++judged;
        depth += std::min(0.5f * square, kMostDepth);
        // Faces that are turned differently are lit differently.
        const cv::Vec3f& facing = to_.frame.normals(static_cast<int>(at.v + 0.5f), static_cast<int>(at.u + 0.5f));
        if (!(turned[0] * facing[0] + turned[1] * facing[1] + turned[2] * facing[2] > kSameFace)) continue;
        ++compared;
        const float own = from_.texture(row, col);
        const Sampled other = sampled(to_.texture, at.u, at.v);
        sum += other.value - own;
        squares += (other.value - own) * (other.value - own);
        slopes += other.du * other.du + other.dv * other.dv;
        own_sum += own;
        own_squares += own * own;
      }
    }
    BlockEvidence result;
    if (2 * judged < kBlockSamples * kBlockSamples) return result;
    result.weight = static_cast<float>(judged) / (kBlockSamples * kBlockSamples);
    result.log_likelihood = -depth / static_cast<float>(judged);
    result.structure = std::min(kMostDepth, (most_height - least_height) / kRelief_m);
    if (2 * compared < judged) return result;
    const float n = static_cast<float>(compared);
    const float texture_noise = kTextureNoise * kTextureNoise + kMisplaced_px * kMisplaced_px * slopes / n;
    const float mean = sum / n, own_mean = own_sum / n, shading = 1 / (kShading * kShading);
    const float spread = std::max(0.0f, squares / n - mean * mean) / texture_noise + mean * mean * shading;
    const float own_spread =
        std::max(0.0f, own_squares / n - own_mean * own_mean) / texture_noise + own_mean * own_mean * shading;
    result.log_likelihood -= kTexture * std::log1p(spread);
    result.structure =
        kTexture * std::log1p(2 * own_spread) + std::min(kMostDepth, (most_height - least_height) / kRelief_m);
    return result;
  }

  const Side &from_, &to_;
  Pinhole camera_;
  Vector3d normal_;
  int stride_, rows_, cols_;
};

// Both views against each other.
using Evidence = std::vector<BlockEvidence>;

struct Balance {
  double difference = 0;  // log-likelihood of an alternative minus that of the registration
  double sigma = 0;       // of the difference
};

// Small differences arise from interpolation and count as none; a single block decides nothing.
double counted(double difference) {
  constexpr double kNegligible = 0.75, kMost = 4;
  const double size = std::min(kMost, std::max(0.0, std::abs(difference) - kNegligible));
  return difference < 0 ? -size : size;
}

// Compares poses over the same evidence. Blocks that only the alternative makes visible are compared with what the
// registration typically reaches; those that only the registration makes visible say nothing about the alternative.
Balance balance(const Evidence& registration, const Evidence& alternative) {
  double typical = 0, judged = 0;
  for (const BlockEvidence& block : registration) {
    typical += static_cast<double>(block.weight * block.log_likelihood);
    judged += static_cast<double>(block.weight);
  }
  typical /= std::max(1.0, judged);
  Balance result;
  double squares = 0;
  for (size_t i = 0; i < registration.size(); ++i) {
    if (alternative[i].weight == 0) continue;
    const double before = registration[i].weight > 0 ? static_cast<double>(registration[i].log_likelihood) : typical;
    const double difference = counted(static_cast<double>(alternative[i].log_likelihood) - before) *
                              static_cast<double>(alternative[i].weight);
    result.difference += 0.5 * difference;  // both views see the same surfaces
    squares += 0.25 * difference * difference;
  }
  result.sigma = std::sqrt(2 * squares);
  return result;
}

// Evidence that a correct pose loses to shadows, gloss and other effects that the evidence does not model.
double unmodelled(const Evidence& registration) {
  constexpr double kShare = 0.3;
  double loss = 0;
  for (const BlockEvidence& block : registration)
    loss -= 0.5 * counted(static_cast<double>(block.log_likelihood)) * static_cast<double>(block.weight);
  return kShare * loss;
}

struct Structure {
  double judged = 0, explained = 0;
  double share() const { return judged > 0 ? explained / judged : 0; }
};

Structure structure_of(const Evidence& evidence) {
  Structure result;
  for (const BlockEvidence& block : evidence) {
    const double here = static_cast<double>(block.weight * block.structure);
    result.judged += here;
    if (block.structure > 0)
      result.explained += here * std::max(0.0, 1 + static_cast<double>(block.log_likelihood / block.structure));
  }
  return result;
}

// Dominant plane of a view: its frame's z axis is the normal towards the camera, the origin the mean of the points.
Pose camera_from_plane(const Frame& frame) {
  constexpr int kStride = 8, kRounds = 4;
  std::vector<Vector3d> points;
  for (int row = 0; row < frame.height(); row += kStride) {
    for (int col = 0; col < frame.width(); col += kStride) {
      if (frame.valid(row, col)) points.push_back(vector_of(frame.points_m(row, col)));
    }
  }
  Pose plane;
  if (points.size() < 10) return plane;
  std::vector<double> weights(points.size(), 1);
  for (int round = 0; round < kRounds; ++round) {
    Vector3d mean = Vector3d::Zero();
    double total = 0;
    for (size_t i = 0; i < points.size(); ++i) mean += weights[i] * points[i], total += weights[i];
    mean /= total;
    Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();
    for (size_t i = 0; i < points.size(); ++i)
      scatter += weights[i] * (points[i] - mean) * (points[i] - mean).transpose();
    const SymmetricEigen<3> axes = symmetric_eigen(scatter);
    Vector3d normal = axes.vectors.col(0);
    if (normal.dot(mean) > 0) normal = -normal;
    const double variance = std::max(1e-12, 4 * axes.values[0] / total);
    for (size_t i = 0; i < points.size(); ++i) {
      const double height = normal.dot(points[i] - mean);
      weights[i] = 1 / (1 + height * height / variance);
    }
    const Vector3d along = (Vector3d::UnitX() - normal.x() * normal).normalized();
    plane.rotation << along, normal.cross(along), normal;
    plane.translation = mean;
  }
  return plane;
}

// Heights and texture on a grid in the plane.
struct PlaneGrid {
  double cell_m = 0;
  Vector2d low_m = Vector2d::Zero();  // its corner
  int size = 0;                       // cells
};

struct GridPoint {
  float x, y;  // in the plane, m
  float height_m, texture;
};

std::vector<GridPoint> grid_points(const Side& side, const Pose& plane_from_camera) {
  std::vector<GridPoint> points;
  const Frame& frame = side.frame;
  points.reserve(frame.points_m.total());
  for (int row = 0; row < frame.height(); ++row) {
    for (int col = 0; col < frame.width(); ++col) {
      if (!frame.valid(row, col)) continue;
      const Eigen::Vector3f p = (plane_from_camera * vector_of(frame.points_m(row, col))).cast<float>();
      points.push_back({p.x(), p.y(), p.z(), side.texture(row, col)});
    }
  }
  return points;
}

constexpr int kGrid = 150, kTransform = 256;  // cells; shifts up to their difference do not wrap around

// Channels of a view at every n-th point, transformed: mask, the masked heights and textures in sigmas, and their squares.
struct Spectra {
  std::array<cv::Mat1f, 4> of;
  double variance = 0;  // mean of the squares
};

struct Scales {
  float height_m = 0, texture = 0, middle_m = 0;
};

Scales scales_of(const std::vector<GridPoint>& points) {
  constexpr double kLeastHeight_m = 3e-4, kLeastTexture = 0.02;
  double sum = 0, squares = 0, texture = 0;
  for (const GridPoint& p : points) {
    sum += static_cast<double>(p.height_m);
    squares += static_cast<double>(p.height_m * p.height_m);
    texture += static_cast<double>(p.texture * p.texture);
  }
  const double n = std::max(1.0, static_cast<double>(points.size())), mean = sum / n;
  return {static_cast<float>(std::max(kLeastHeight_m, std::sqrt(std::max(0.0, squares / n - mean * mean)))),
          static_cast<float>(std::max(kLeastTexture, std::sqrt(texture / n))), static_cast<float>(mean)};
}

Spectra spectra_of(const std::vector<GridPoint>& points, size_t every, const PlaneGrid& grid, const Scales& scales,
                   double turn_rad) {
  constexpr float kMost = 2.5f;  // sigmas
  constexpr double kSmooth = 0.7;
  cv::Mat1f mask(kTransform, kTransform, 0.0f), height = mask.clone(), texture = mask.clone();
  const float c = static_cast<float>(std::cos(turn_rad)), s = static_cast<float>(std::sin(turn_rad));
  const float scale = static_cast<float>(1 / grid.cell_m);
  for (size_t i = 0; i < points.size(); i += every) {
    const GridPoint& p = points[i];
    const float x = c * p.x - s * p.y, y = s * p.x + c * p.y;
    const int col = static_cast<int>(std::floor((x - static_cast<float>(grid.low_m.x())) * scale));
    const int row = static_cast<int>(std::floor((y - static_cast<float>(grid.low_m.y())) * scale));
    if (row < 0 || col < 0 || row >= grid.size || col >= grid.size) continue;
    mask(row, col) += 1;
    height(row, col) += std::clamp((p.height_m - scales.middle_m) / scales.height_m, -kMost, kMost);
    texture(row, col) += std::clamp(p.texture / scales.texture, -kMost, kMost);
  }
  const cv::Rect used(0, 0, grid.size, grid.size);
  for (cv::Mat1f* channel : {&mask, &height, &texture}) {
    cv::Mat1f part = (*channel)(used);
    cv::GaussianBlur(part, part, {}, kSmooth, kSmooth, cv::BORDER_CONSTANT);
  }
  cv::Mat1f squares(kTransform, kTransform, 0.0f);
  double total = 0, cells = 0;
  for (int row = 0; row < grid.size; ++row) {
    for (int col = 0; col < grid.size; ++col) {
      float& m = mask(row, col);
      if (m < 0.5f) {
        m = height(row, col) = texture(row, col) = 0;
        continue;
      }
      height(row, col) /= m;
      texture(row, col) /= m;
      m = 1;
      squares(row, col) = height(row, col) * height(row, col) + texture(row, col) * texture(row, col);
      total += static_cast<double>(squares(row, col));
      cells += 1;
    }
  }
  Spectra spectra;
  spectra.variance = total / std::max(1.0, cells);
  const std::array<cv::Mat1f, 4> channels = {mask, height, texture, squares};
  for (size_t i = 0; i < channels.size(); ++i) cv::dft(channels[i], spectra.of[i]);
  return spectra;
}

// Adds the spectrum of the correlation of two channels.
void add_product(const cv::Mat1f& a, const cv::Mat1f& b, double factor, cv::Mat1f& sum) {
  cv::Mat1f product;
  cv::mulSpectrums(a, b, product, 0, true);
  cv::scaleAdd(product, factor, sum, sum);
}

// A shift of the source in the plane after a turn, and the mean square difference there relative to that of unrelated
// places.
struct Shift {
  double turn_rad = 0;
  Vector2d shift_m = Vector2d::Zero();
  double difference = 0;
};

// Appends the local minima of the difference over all shifts with enough overlap, best first.
void add_shifts(const Spectra& target, const Spectra& source, const PlaneGrid& grid, double turn_rad,
                std::vector<Shift>& shifts) {
  constexpr double kLeastOverlap = 0.12, kMostDifference = 0.75;
  constexpr int kReach = kTransform - kGrid - 1;
  cv::Mat1f overlap(kTransform, kTransform, 0.0f), difference = overlap.clone();
  add_product(target.of[0], source.of[0], 1, overlap);
  add_product(target.of[3], source.of[0], 1, difference);
  add_product(target.of[0], source.of[3], 1, difference);
  for (const size_t channel : {size_t{1}, size_t{2}})
    add_product(target.of[channel], source.of[channel], -2, difference);
  for (cv::Mat1f* spectrum : {&overlap, &difference}) cv::idft(*spectrum, *spectrum, cv::DFT_SCALE);
  double most = 0;
  cv::minMaxLoc(overlap, nullptr, &most);
  const double unrelated = std::max(1e-9, target.variance + source.variance);
  cv::Mat1f relative(2 * kReach + 1, 2 * kReach + 1);
  for (int y = -kReach; y <= kReach; ++y) {
    for (int x = -kReach; x <= kReach; ++x) {
      const int row = (y + kTransform) % kTransform, col = (x + kTransform) % kTransform;
      const double cells = static_cast<double>(overlap(row, col));
      relative(y + kReach, x + kReach) =
          cells < kLeastOverlap * most
              ? 9.0f
              : static_cast<float>(static_cast<double>(difference(row, col)) / cells / unrelated);
    }
  }
  for (int y = 1; y < 2 * kReach; ++y) {
    for (int x = 1; x < 2 * kReach; ++x) {
      const float here = relative(y, x);
      if (static_cast<double>(here) > kMostDifference) continue;
      bool least = true;
      for (int i = -1; i <= 1 && least; ++i) {
        for (int j = -1; j <= 1; ++j) least = least && (relative(y + i, x + j) >= here);
      }
      if (!least) continue;
      // The vertex of a parabola through the neighbours.
      const auto vertex = [here](float before, float after) {
        const float curvature = before + after - 2 * here;
        return curvature > 0 && before < 5 && after < 5
                   ? static_cast<double>(std::clamp(0.5f * (before - after) / curvature, -0.5f, 0.5f))
                   : 0;
      };
      const Vector2d cells(x - kReach + vertex(relative(y, x - 1), relative(y, x + 1)),
                           y - kReach + vertex(relative(y - 1, x), relative(y + 1, x)));
      shifts.push_back({turn_rad, grid.cell_m * cells, static_cast<double>(here)});
    }
  }
}

// Largest distance from the origin that 95 % of the points of both views stay within.
double reach_m(const std::vector<GridPoint>& there, const std::vector<GridPoint>& here) {
  constexpr size_t kEvery = 29;
  constexpr double kShare = 0.95;
  float reach = 0;
  for (const auto* points : {&there, &here}) {
    std::vector<float> sizes;
    for (size_t i = 0; i < points->size(); i += kEvery) sizes.push_back(std::hypot((*points)[i].x, (*points)[i].y));
    const auto far = sizes.begin() + static_cast<std::ptrdiff_t>(kShare * static_cast<double>(sizes.size() - 1));
    std::nth_element(sizes.begin(), far, sizes.end());
    reach = std::max(reach, *far);
  }
  return static_cast<double>(reach);
}

// Mean position of the source's points that lie within the target's bounds.
Vector2d middle_of_overlap(const std::vector<GridPoint>& there, const std::vector<GridPoint>& here) {
  Eigen::Array2f low = Eigen::Array2f::Constant(1e9f), high = -low;
  for (const GridPoint& p : there) {
    low = low.min(Eigen::Array2f(p.x, p.y));
    high = high.max(Eigen::Array2f(p.x, p.y));
  }
  Vector2d sum = Vector2d::Zero();
  double count = 0;
  for (const GridPoint& p : here) {
    const Eigen::Array2f at(p.x, p.y);
    if ((at < low).any() || (at > high).any()) continue;
    sum += Vector2d(static_cast<double>(p.x), static_cast<double>(p.y));
    count += 1;
  }
  return sum / std::max(1.0, count);
}

// Rotations and shifts of the moved source in the plane that look similar to the target, as motions of the target's
// camera frame. Structure of any period shows at one of three scales: that of the whole view, and those of its middle at
// a half and a quarter of the cell size.
std::vector<Pose> similar_places(const Side& target, const Side& source, const Pose& target_from_source,
                                 const Admissible& admissible) {
  constexpr size_t kMost = 20, kLeastPoints = 2000;
  constexpr double kApart = 4, kSame = 1.5;  // cells
  const Pose target_from_plane = camera_from_plane(target.frame), plane_from_target = target_from_plane.inverse();
  const std::vector<GridPoint> there = grid_points(target, plane_from_target),
                               here = grid_points(source, plane_from_target * target_from_source);
  if (there.size() < kLeastPoints || here.size() < kLeastPoints) return {};
  const double half_m = reach_m(there, here);
  const Scales unit = scales_of(there);
  // Lattices have no other rotational symmetries; what repeats after a turn repeats without it at a finer scale.
  const std::vector<int> turns_deg =
      admissible ? std::vector<int>{0} : std::vector<int>{0, 60, 90, 120, 180, 240, 270, 300};
  struct Scale {
    PlaneGrid grid;
    size_t every;  // of these points, one is used
    Spectra fixed;
  };
  std::vector<Scale> scales;
  const Vector2d middle_m = middle_of_overlap(there, here);
  for (const int finer : {1, 2, 4}) {
    // The whole view is centred at the plane's origin, about which the source turns.
    PlaneGrid grid{2 * half_m / (kGrid * finer), Vector2d::Constant(-half_m / finer), kGrid};
    if (finer > 1) grid.low_m += middle_m;
    scales.push_back({grid, finer > 1 ? size_t{1} : size_t{3}, {}});
  }
  struct Turned {
    size_t scale;
    double turn_rad;
    std::vector<Shift> shifts;
  };
  std::vector<Turned> attempts;
  for (const int turn_deg : turns_deg) attempts.push_back({0, turn_deg * std::numbers::pi / 180, {}});
  attempts.push_back({1, 0, {}});
  attempts.push_back({2, 0, {}});
  for_each_row(static_cast<int>(scales.size()), [&](int i) {
    Scale& scale = scales[static_cast<size_t>(i)];
    scale.fixed = spectra_of(there, scale.every, scale.grid, unit, 0);
  });
  for_each_row(static_cast<int>(attempts.size()), [&](int i) {
    Turned& attempt = attempts[static_cast<size_t>(i)];
    const Scale& scale = scales[attempt.scale];
    add_shifts(scale.fixed, spectra_of(here, scale.every, scale.grid, unit, attempt.turn_rad), scale.grid,
               attempt.turn_rad, attempt.shifts);
  });
  std::vector<Pose> motions;
  for (size_t scale = 0; scale < scales.size(); ++scale) {
    const PlaneGrid& grid = scales[scale].grid;
    std::vector<Shift> shifts;
    for (const Turned& attempt : attempts) {
      if (attempt.scale == scale) shifts.insert(shifts.end(), attempt.shifts.begin(), attempt.shifts.end());
    }
    std::stable_sort(shifts.begin(), shifts.end(),
                     [](const Shift& a, const Shift& b) { return a.difference < b.difference; });
    std::vector<Shift> chosen;
    size_t found = 0;
    for (const Shift& shift : shifts) {
      if (found >= kMost) break;
      const bool apart = std::none_of(chosen.begin(), chosen.end(), [&](const Shift& other) {
        return other.turn_rad == shift.turn_rad && (other.shift_m - shift.shift_m).norm() < kApart * grid.cell_m;
      });
      if (!apart) continue;
      chosen.push_back(shift);
      if (shift.turn_rad == 0 && shift.shift_m.norm() < kSame * grid.cell_m) continue;
      const Pose in_plane{rotation_exp({0, 0, shift.turn_rad}), {shift.shift_m.x(), shift.shift_m.y(), 0}};
      const Pose motion = target_from_plane * in_plane * plane_from_target;
      if (admissible && !admissible(motion * target_from_source)) continue;
      motions.push_back(motion);
      ++found;
    }
  }
  return motions;
}

// Registers by depth and texture together, from a start that is off by a few pixels.
class JointRefinement {
 public:
  JointRefinement(const Side& target, const Side& source, const Pinhole& camera)
      : target_(target), source_(source), camera_(camera), planes_(target.frame, source.frame, camera, 30) {}

  // `coarse` takes few steps on few points.
  Pose refined(Pose pose, bool coarse) {
    constexpr double kFirstGate_m = 4e-3, kLastGate_m = 1e-3, kHold = 1e-4;
    const int steps = coarse ? 4 : 6, plane_stride = coarse ? 8 : 4;
    const int texture_stride = stride_of(source_.frame) * (coarse ? 3 : 1);
    const double first_m = coarse ? kFirstGate_m : 2 * kLastGate_m;
    for (int step = 0; step < steps; ++step) {
      const double gate_m = first_m * std::pow(kLastGate_m / first_m, static_cast<double>(step) / (steps - 1));
      PlaneSums sums = planes_.linearise(pose, {gate_m, 40}, plane_stride);
      if (sums.pairs < 20) return pose;
      add_texture(pose, gate_m, texture_stride, sums);
      const double hold = kHold * sums.information.diagonal().maxCoeff();
      const Vector6d change = solve_symmetric(Matrix6d(sums.information + hold * Matrix6d::Identity()), -sums.gradient);
      if (!change.allFinite()) return pose;
      pose = retract(pose, change);
    }
    return orthonormalised(pose);
  }

 private:
  void add_texture(const Pose& pose, double gate_m, int stride, PlaneSums& sums) const {
    constexpr float kNoise = 0.1f;
    const Frame& frame = source_.frame;
    const int rows = (frame.height() + stride - 1) / stride;
    const Projection projection(pose, camera_);
    std::vector<PlaneSums> of_rows(static_cast<size_t>(rows));
    for_each_row(rows, [&](int r) {
      PlaneSums& here = of_rows[static_cast<size_t>(r)];
      for (int col = 0; col < frame.width(); col += stride) {
        const cv::Vec3f& point = frame.points_m(r * stride, col);
        if (std::isnan(point[2])) continue;
        const Pixel at = projected(projection, point);
        if (!at.inside) continue;
        const cv::Vec3f& q = target_.frame.points_m(static_cast<int>(at.v + 0.5f), static_cast<int>(at.u + 0.5f));
        if (!(std::abs(static_cast<double>(q[2] - at.z)) < 2 * gate_m)) continue;
        const Sampled other = sampled(target_.texture, at.u, at.v);
        const float residual = other.value - source_.texture(r * stride, col);
        const float ratio = residual / (3 * kNoise), weight = 1 / (kNoise * kNoise * (1 + ratio * ratio));
        // Derivative of the pixel by the point, without the small effect of the distortion.
        const float gx = other.du * projection.fx / at.z, gy = other.dv * projection.fy / at.z;
        const Vector3d by_point(gx, gy, -(gx * at.x + gy * at.y) / at.z);
        const Vector3d turned = Vector3d(at.x, at.y, at.z) - pose.translation;
        Vector6d jacobian;
        jacobian << turned.cross(by_point), by_point;
        here.information += static_cast<double>(weight) * jacobian * jacobian.transpose();
        here.gradient += static_cast<double>(weight * residual) * jacobian;
      }
    });
    for (const PlaneSums& row : of_rows) {
      sums.information += row.information;
      sums.gradient += row.gradient;
    }
  }

  const Side &target_, &source_;
  Pinhole camera_;
  PlanePairs planes_;
};

// Largest displacement of points in the corners of the image at mid-depth.
double displacement_m(const Pose& a, const Pose& b, const Pinhole& camera, double depth_m) {
  const double x = 0.5 * depth_m * camera.width / camera.fx, y = 0.5 * depth_m * camera.height / camera.fy;
  double largest = 0;
  for (const Vector3d& p : {Vector3d(0, 0, depth_m), Vector3d(x, y, depth_m), Vector3d(-x, y, depth_m),
                            Vector3d(x, -y, depth_m), Vector3d(-x, -y, depth_m)})
    largest = std::max(largest, (a * p - b * p).norm());
  return largest;
}

}  // namespace

AmbiguityReport find_alternatives(const Frame& target, const Frame& source, const Pinhole& camera,
                                  const Pose& target_from_source, const AmbiguityOptions& options,
                                  const Admissible& admissible) {
  constexpr double kSigmas = 3, kCoarse = 0.6;
  constexpr size_t kEnough = 3;
  check_options(options, "ambiguity");
  AmbiguityReport report;
  const Side there(target), here(source);
  const std::vector<Pose> motions = similar_places(there, here, target_from_source, admissible);
  if (motions.empty() && admissible) return report;
  const Pose plane = camera_from_plane(target);
  const Vector3d normal = plane.rotation.col(2);
  const Comparison forward(here, there, camera, target_from_source.rotation.transpose() * normal),
      backward(there, here, camera, normal);
  const auto evidence_at = [&](const Pose& pose) {
    Evidence evidence = forward.at(pose);
    const Evidence more = backward.at(pose.inverse());
    evidence.insert(evidence.end(), more.begin(), more.end());
    return evidence;
  };
  JointRefinement refinement(there, here, camera);
  const Pose refined = refinement.refined(target_from_source, false);
  const Evidence own = evidence_at(refined);
  const Structure structure = structure_of(own);
  report.explained = structure.share();
  report.contradicted = report.explained < options.min_explained;
  const double depth_m = plane.translation.norm(), margin = options.min_difference + unmodelled(own);
  const double distinct_m = least_period_m(camera, depth_m);
  std::vector<Pose> seen = {target_from_source, refined};
  const auto is_known = [&](const Pose& pose) {
    return std::any_of(seen.begin(), seen.end(),
                       [&](const Pose& other) { return displacement_m(pose, other, camera, depth_m) < distinct_m; });
  };
  // Explains as much as an alternative has to.
  const auto explains = [&](const Evidence& evidence, double least) {
    const Structure explained = structure_of(evidence);
    return explained.explained >= options.min_structure * structure.explained && explained.share() >= least;
  };
  for (const Pose& motion : motions) {
    if (report.alternatives.size() >= kEnough) break;
    const Pose near = refinement.refined(motion * target_from_source, true);
    if (is_known(near) || !explains(evidence_at(near), kCoarse * options.min_explained)) continue;
    const Pose pose = refinement.refined(near, false);
    if (is_known(pose) || (admissible && !admissible(pose))) continue;
    seen.push_back(pose);
    const Evidence evidence = evidence_at(pose);
    if (!explains(evidence, options.min_explained)) continue;
    const Balance compared = balance(own, evidence);
    if (compared.difference > -(margin + kSigmas * compared.sigma))
      report.alternatives.push_back({pose, compared.difference});
  }
  std::stable_sort(
      report.alternatives.begin(), report.alternatives.end(),
      [](const AlternativePose& a, const AlternativePose& b) { return a.log_likelihood > b.log_likelihood; });
  return report;
}

double least_period_m(const Pinhole& camera, double distance_m) {
  constexpr double kLeast_px = 6, kLeast_m = 1e-3;
  return std::max(kLeast_m, kLeast_px * distance_m / std::min(camera.fx, camera.fy));
}

DepthAgreement depth_agreement(const Frame& target, const Frame& source, const Pinhole& camera,
                               const Pose& target_from_source, double tolerance_m) {
  constexpr int kStride = 4;
  constexpr float kSameSide = 0.5f;
  const Projection projection(target_from_source, camera);
  int points = 0, judged = 0, agreeing = 0;
  for (int row = 0; row < source.height(); row += kStride) {
    for (int col = 0; col < source.width(); col += kStride) {
      const cv::Vec3f& normal = source.normals(row, col);
      if (std::isnan(normal[2])) continue;
      ++points;
      const Pixel at = projected(projection, source.points_m(row, col));
      if (!at.inside) continue;
      const int there_row = static_cast<int>(at.v + 0.5f), there_col = static_cast<int>(at.u + 0.5f);
      const cv::Vec3f& facing = target.normals(there_row, there_col);
      if (std::isnan(facing[2])) continue;
      ++judged;
      const double off_m = static_cast<double>(target.points_m(there_row, there_col)[2] - at.z);
      agreeing +=
          std::abs(off_m) <= tolerance_m && rotated(projection, normal).dot(Eigen::Vector3f(facing.val)) > kSameSide;
    }
  }
  return {static_cast<double>(judged) / std::max(1, points), static_cast<double>(agreeing) / std::max(1, judged)};
}

}  // namespace fringeslam
