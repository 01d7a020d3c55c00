// SPDX-License-Identifier: Apache-2.0
#include "core/map/expected_view.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>

#include "core/base/constants.h"
#include "core/base/instruction_set.h"
#include "core/base/parallel.h"
#include "core/types/error.h"
#include "core/types/linear_algebra.h"
#include "core/types/projection.h"

namespace fringeslam {

namespace {

constexpr float kNowhere = -1e6f;      // for points that are not visible
constexpr float kLeastCosine = 0.05f;  // of the viewing angle of a plane; planes at a smaller one are ignored
constexpr int kBandRows = 16;
// Standard deviation, relative to the point's, of a plane through a point and its two neighbours at a distance of 1.5
// pixels in both directions.
constexpr float kRoughSigmas = 2.3f;

// Projections of points, their tangent planes m, and the relative standard deviation of 1/z due to the points' noise.
struct Splats {
  float *u, *v, *mx, *my, *mz, *noise;
  Splats from(size_t first) const { return {u + first, v + first, mx + first, my + first, mz + first, noise + first}; }
};

FRINGESLAM_INLINE void splat_body(const cv::Vec3f* points, const cv::Vec3f* normals, const float* sigma, int width,
                                  Projection p, Splats out) {
  const float *point = &points[0][0], *normal = &normals[0][0];
#pragma GCC ivdep
  for (int i = 0; i < width; ++i) {
    const float sx = point[3 * i], sy = point[3 * i + 1], sz = point[3 * i + 2];
    const float ax = normal[3 * i], ay = normal[3 * i + 1], az = normal[3 * i + 2];
    const float rx = p.r[0] * sx + p.r[1] * sy + p.r[2] * sz, nx = p.r[0] * ax + p.r[1] * ay + p.r[2] * az;
    const float ry = p.r[3] * sx + p.r[4] * sy + p.r[5] * sz, ny = p.r[3] * ax + p.r[4] * ay + p.r[5] * az;
    const float rz = p.r[6] * sx + p.r[7] * sy + p.r[8] * sz, nz = p.r[6] * ax + p.r[7] * ay + p.r[8] * az;
    const float x = rx + p.t[0], y = ry + p.t[1], z = rz + p.t[2];
    const float offset = nx * x + ny * y + nz * z;
    const bool seen =
        (z > 0) & (offset < 0) & (offset * offset > kLeastCosine * kLeastCosine * (x * x + y * y + z * z));
    const float a = x / z, b = y / z, r2 = a * a + b * b, radial = 1 + r2 * (p.k1 + r2 * (p.k2 + r2 * p.k3));
    const float u = p.fx * (a * radial + 2 * p.p1 * a * b + p.p2 * (r2 + 2 * a * a)) + p.cx;
    const float v = p.fy * (b * radial + p.p1 * (r2 + 2 * b * b) + 2 * p.p2 * a * b) + p.cy;
    out.u[i] = seen ? u : kNowhere;
    out.v[i] = seen ? v : kNowhere;
    out.mx[i] = nx / offset;
    out.my[i] = ny / offset;
    out.mz[i] = nz / offset;
    out.noise[i] = sigma[i] * std::abs((nx * rx + ny * ry + nz * rz) / (sz * offset));
  }
}

void splat_portable(const cv::Vec3f* points, const cv::Vec3f* normals, const float* sigma, int width,
                    const Projection& p, const Splats& out) {
  splat_body(points, normals, sigma, width, p, out);
}
FRINGESLAM_AVX2 void splat_avx2(const cv::Vec3f* points, const cv::Vec3f* normals, const float* sigma, int width,
                                const Projection& p, const Splats& out) {
  splat_body(points, normals, sigma, width, p, out);
}
FRINGESLAM_AVX512 void splat_avx512(const cv::Vec3f* points, const cv::Vec3f* normals, const float* sigma, int width,
                                    const Projection& p, const Splats& out) {
  splat_body(points, normals, sigma, width, p, out);
}

// A row of a known frame and the range of image rows it projects to.
struct SourceRow {
  int view = 0, row = 0;
  size_t first = 0;  // index of its first splat
  int width = 0;
  float lowest_v = 0, highest_v = 0;
};

// Properties of a view that the final pass needs.
struct ViewError {
  std::array<float, 3> translation{};
  std::array<std::array<float, 6>, 6> root{};  // columns of a root of the covariance: cov = root root^T
  float relative_sigma = 0;                    // largest relative sigma of 1/z due to the pose
};

// Returns the standard deviations of the image shift due to the view's pose error, px: the maximum over a grid of its
// points.
Eigen::Vector2d image_shift_px(const KnownView& view, const Pinhole& camera, double& relative_depth) {
  constexpr int kStep = 32;
  Eigen::Vector2d shift = Eigen::Vector2d::Zero();
  for (int row = kStep / 2; row < view.frame->height(); row += kStep) {
    for (int col = kStep / 2; col < view.frame->width(); col += kStep) {
      if (!view.frame->valid(row, col)) continue;
      const cv::Vec3f& p = view.frame->points_m(row, col);
      const Eigen::Vector3d turned = view.current_from_known.rotation * Eigen::Vector3d(p[0], p[1], p[2]);
      const Eigen::Vector3d x = turned + view.current_from_known.translation;
      if (!(x.z() > 0) || !camera.contains(camera.project(x))) continue;
      Eigen::Matrix<double, 3, 6> moved;
      moved << -skew(turned), Eigen::Matrix3d::Identity();
      Eigen::Matrix<double, 2, 3> seen;
      seen << camera.fx / x.z(), 0, -camera.fx * x.x() / (x.z() * x.z()), 0, camera.fy / x.z(),
          -camera.fy * x.y() / (x.z() * x.z());
      const Eigen::Matrix3d covariance = moved * view.covariance * moved.transpose();
      shift = shift.cwiseMax((seen * covariance * seen.transpose()).diagonal().cwiseMax(0).cwiseSqrt());
      relative_depth = std::max(relative_depth, std::sqrt(std::max(0.0, covariance.trace())) / x.z());
    }
  }
  return shift;
}

ViewError error_of(const KnownView& view, double relative_sigma) {
  ViewError error;
  const Matrix6d root = covariance_root(view.covariance);
  for (size_t i = 0; i < 36; ++i)
    error.root[i / 6][i % 6] = static_cast<float>(root(static_cast<int>(i % 6), static_cast<int>(i / 6)));
  for (size_t i = 0; i < 3; ++i)
    error.translation[i] = static_cast<float>(view.current_from_known.translation[static_cast<int>(i)]);
  error.relative_sigma = static_cast<float>(relative_sigma);
  return error;
}

class Rendering {
 public:
  Rendering(const std::vector<KnownView>& known, const Pinhole& camera, const PixelRays& rays,
            const ExpectedViewOptions& options)
      : known_(known), camera_(camera), rays_(rays), surface_sigmas_(static_cast<float>(options.surface_sigmas)) {
    Eigen::Vector2d shift = Eigen::Vector2d::Zero();
    size_t points = 0;
    for (size_t v = 0; v < known.size(); ++v) {
      const Frame& frame = *known[v].frame;
      double relative_depth = 0;
      shift = shift.cwiseMax(image_shift_px(known[v], camera, relative_depth));
      errors_.push_back(error_of(known[v], relative_depth));
      for (int row = 0; row < frame.height(); ++row, points += static_cast<size_t>(frame.width()))
        rows_.push_back({static_cast<int>(v), row, points, frame.width()});
    }
    // The splats extend half a pixel beyond the shift.
    reach_ = {static_cast<int>(std::ceil(0.5 + options.shift_sigmas * shift.x())),
              static_cast<int>(std::ceil(0.5 + options.shift_sigmas * shift.y()))};
    arrays_.resize(6 * points);
    float* free_floats = arrays_.data();
    for (float** array : {&splats_.u, &splats_.v, &splats_.mx, &splats_.my, &splats_.mz, &splats_.noise}) {
      *array = free_floats;
      free_floats += points;
    }
  }

  ExpectedView render() {
    for_each_row(static_cast<int>(rows_.size()), [&](int row) { project(rows_[static_cast<size_t>(row)]); });
    ExpectedView view{cv::Mat1f(rays_.size(), kNaN), cv::Mat1f(rays_.size(), kNaN)};
    winner_ = cv::Mat1i(rays_.size(), -1);
    const int bands = (rays_.rows + kBandRows - 1) / kBandRows;
    for_each_row(bands, [&](int band) { cover(band * kBandRows, view); });
    inflate_sigma_at_steps(view);
    return view;
  }

 private:
  void project(SourceRow& source) {
    static const auto splat = widest(splat_portable, splat_avx2, splat_avx512);
    const KnownView& view = known_[static_cast<size_t>(source.view)];
    const Frame& frame = *view.frame;
    const Projection projection(view.current_from_known, camera_);
    const Splats out = splats_.from(source.first);
    const cv::Vec3f* normals = frame.normals[source.row];
    splat(frame.points_m[source.row], normals, frame.sigma_m[source.row], source.width, projection, out);
    source.lowest_v = std::numeric_limits<float>::max();
    source.highest_v = std::numeric_limits<float>::lowest();
    for (int i = 0; i < source.width; ++i) {
      if (std::isnan(normals[i][2]) && frame.valid(source.row, i)) {
        const cv::Vec3f rough = neighbour_normal(frame.points_m, source.row, i);
        const float sigma = kRoughSigmas * frame.sigma_m(source.row, i);
        splat(&frame.points_m(source.row, i), &rough, &sigma, 1, projection,
              splats_.from(source.first + static_cast<size_t>(i)));
      }
      if (out.u[i] == kNowhere) continue;
      source.lowest_v = std::min(source.lowest_v, out.v[i]);
      source.highest_v = std::max(source.highest_v, out.v[i]);
    }
  }

  float inverse_depth(size_t splat, const cv::Vec2f& ray) const {
    return splats_.mx[splat] * ray[0] + splats_.my[splat] * ray[1] + splats_.mz[splat];
  }

  // Renders everything that falls on a band of rows; each band is written by one thread. The band's buffers have a
  // border of two pixels, so that the footprint of any splat that covers one of its pixels lies within them.
  void cover(int first_row, ExpectedView& view) {
    constexpr int kBorder = 2;
    const int rows = std::min(kBandRows, rays_.rows - first_row), cols = rays_.cols, stride = cols + 2 * kBorder;
    const auto size = static_cast<size_t>((rows + 2 * kBorder) * stride);
    std::vector<float> ray_x(size), ray_y(size), nearest(size), distance(size, std::numeric_limits<float>::max());
    std::vector<int> winner(size, -1), winning_view(size);
    for (int row = 0; row < rows; ++row) {
      const auto first = static_cast<size_t>((row + kBorder) * stride + kBorder);
      for (size_t col = 0; col < static_cast<size_t>(cols); ++col) {
        const cv::Vec2f& ray = rays_(first_row + row, static_cast<int>(col));
        ray_x[first + col] = ray[0], ray_y[first + col] = ray[1];
      }
    }
    struct Candidate {
      int splat, view, corner;  // first of the covered pixels
      float u, v;               // relative to that pixel
    };
    std::vector<Candidate> candidates;
    candidates.reserve(size);
    const float low = static_cast<float>(first_row) - 1.5f, high = static_cast<float>(first_row + rows) + 0.5f;
    const float right = static_cast<float>(cols) + 0.5f;
    for (const SourceRow& source : rows_) {
      if (source.highest_v < low || source.lowest_v > high) continue;
      for (size_t i = source.first; i < source.first + static_cast<size_t>(source.width); ++i) {
        const float u = splats_.u[i], v = splats_.v[i];
        if (!((v >= low) & (v < high) & (u >= -1.5f) & (u < right))) continue;
        // The argument is positive, so the conversion rounds down.
        const int col = static_cast<int>(u + 2.5f) - 1,
                  row = static_cast<int>(v - static_cast<float>(first_row) + 2.5f) - 1;
        candidates.push_back({static_cast<int>(i), source.view, row * stride + col,
                              u - static_cast<float>(col - kBorder),
                              v - static_cast<float>(first_row + row - kBorder)});
      }
    }
    const auto for_each_covered = [&](const Candidate& c, const auto& use) {
      const auto splat = static_cast<size_t>(c.splat);
      const float mx = splats_.mx[splat], my = splats_.my[splat], mz = splats_.mz[splat];
      for (int row = 0; row < 3; ++row) {
        const auto first = static_cast<size_t>(c.corner + row * stride);
        for (size_t col = 0; col < 3; ++col)
          use(first + col, row, col, mx * ray_x[first + col] + my * ray_y[first + col] + mz);
      }
    };
    for (const Candidate& c : candidates) {
      for_each_covered(c, [&](size_t at, int, size_t, float inverse) {
        nearest[at] = inverse > nearest[at] ? inverse : nearest[at];  // false for NaN
      });
    }
    const bool several = known_.size() > 1;
    for (const Candidate& c : candidates) {
      // Pose errors only matter between different views.
      const float other = several ? errors_[static_cast<size_t>(c.view)].relative_sigma : 0;
      const float noise = splats_.noise[c.splat];
      const float share = 1 - surface_sigmas_ * std::sqrt(noise * noise + other * other) - 1e-6f;
      for_each_covered(c, [&](size_t at, int row, size_t col, float inverse) {
        const float du = c.u - static_cast<float>(col), dv = c.v - static_cast<float>(row), square = du * du + dv * dv;
        if (!((inverse >= share * nearest[at]) & (square < distance[at]))) return;
        distance[at] = square;
        winner[at] = c.splat;
        winning_view[at] = c.view;
      });
    }
    for (int row = 0; row < rows; ++row) {
      for (int col = 0; col < cols; ++col) {
        const auto at = static_cast<size_t>((row + kBorder) * stride + col + kBorder);
        if (winner[at] < 0) continue;
        winner_(first_row + row, col) = winner[at];
        finish(first_row + row, col, errors_[static_cast<size_t>(winning_view[at])], view);
      }
    }
  }

  // Sets the depth and sigma of a pixel from the splat that covers it.
  void finish(int row, int col, const ViewError& error, ExpectedView& view) const {
    const auto splat = static_cast<size_t>(winner_(row, col));
    const cv::Vec2f& ray = rays_(row, col);
    const float inverse = inverse_depth(splat, ray);
    const float depth = 1 / inverse;
    const float mx = splats_.mx[splat], my = splats_.my[splat], mz = splats_.mz[splat];
    const float x = depth * ray[0] - error.translation[0], y = depth * ray[1] - error.translation[1],
                z = depth - error.translation[2];
    // With m in place of n, g becomes g / D, and n.d becomes D / z.
    const float g[6] = {y * mz - z * my, z * mx - x * mz, x * my - y * mx, mx, my, mz};
    float by_pose = 0;
    for (const std::array<float, 6>& column : error.root) {
      float along = 0;
      for (size_t i = 0; i < 6; ++i) along += column[i] * g[i];
      by_pose += along * along;
    }
    const float by_noise = splats_.noise[splat];
    view.depth_m(row, col) = depth;
    view.sigma_m(row, col) = depth * std::sqrt(by_pose + by_noise * by_noise);
  }

  // Returns the distance of two pixels from each other's planes, m; 0 if noise explains it.
  float step(const ExpectedView& view, int row, int col, int other_row, int other_col) const {
    const auto here = static_cast<size_t>(winner_(row, col)),
               there = static_cast<size_t>(winner_(other_row, other_col));
    const float z_here = view.depth_m(row, col), z_there = view.depth_m(other_row, other_col);
    const float off_there = std::abs(1 - z_there * inverse_depth(here, rays_(other_row, other_col)));
    const float off_here = std::abs(1 - z_here * inverse_depth(there, rays_(row, col)));
    const float a = splats_.noise[here], b = splats_.noise[there];
    const float noise = surface_sigmas_ * std::sqrt(a * a + b * b) + 1e-5f;
    return std::min(off_here, off_there) <= noise ? 0 : std::min(off_here * z_here, off_there * z_there);
  }

  void inflate_sigma_at_steps(ExpectedView& view) const {
    cv::Mat1f steps(view.depth_m.size(), 0.0f);
    for_each_row(steps.rows, [&](int row) {
      const auto compare = [&](int col, int other_row, int other_col) {
        const float size = step(view, row, col, other_row, other_col);
        steps(row, col) = std::max(steps(row, col), size);
        if (other_row == row) steps(row, other_col) = std::max(steps(row, other_col), size);
      };
      for (int col = 0, last = -1; col < steps.cols; ++col) {
        if (winner_(row, col) < 0) continue;
        if (last >= 0) compare(col, row, last);
        last = col;
        for (const int way : {-1, 1}) {
          int other = row + way;
          while (other >= 0 && other < steps.rows && winner_(other, col) < 0) other += way;
          if (other >= 0 && other < steps.rows) compare(col, other, col);
        }
      }
    });
    cv::dilate(steps, steps, cv::getStructuringElement(cv::MORPH_RECT, {2 * reach_.width + 1, 2 * reach_.height + 1}));
    for_each_row(steps.rows, [&](int row) {
      for (int col = 0; col < steps.cols; ++col)
        view.sigma_m(row, col) = std::hypot(view.sigma_m(row, col), steps(row, col));
    });
  }

  const std::vector<KnownView>& known_;
  const Pinhole& camera_;
  const PixelRays& rays_;
  float surface_sigmas_;
  cv::Size reach_;
  std::vector<ViewError> errors_;
  std::vector<SourceRow> rows_;
  std::vector<float> arrays_;
  Splats splats_{};
  cv::Mat1i winner_;
};

}  // namespace

ExpectedView expected_view(const std::vector<KnownView>& known, const Pinhole& camera, const PixelRays& rays,
                           const ExpectedViewOptions& options) {
  check_options(options, "expected_view");
  if (rays.size() != cv::Size(camera.width, camera.height))
    throw Error("expected view: the rays do not have the camera's size");
  for (const KnownView& view : known) {
    if (view.frame->normals.size() != view.frame->points_m.size() ||
        view.frame->sigma_m.size() != view.frame->points_m.size())
      throw Error("expected view: points, sigmas and normals of frame " + std::to_string(view.frame->index) +
                  " differ in size");
  }
  return Rendering(known, camera, rays, options).render();
}

}  // namespace fringeslam
