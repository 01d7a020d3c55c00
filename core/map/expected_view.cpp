// SPDX-License-Identifier: Apache-2.0
#include "core/map/expected_view.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <memory>
#include <opencv2/imgproc.hpp>

#include "core/base/constants.h"
#include "core/base/parallel.h"
#include "core/types/error.h"
#include "core/types/linear_algebra.h"
#include "core/types/projection.h"
#include "core/types/selected_instruction_set.h"

namespace fringeslam {

namespace {

constexpr float kNowhere = -1e6f;      // for points that are not visible
constexpr float kLeastCosine = 0.05f;  // of the viewing angle of a plane; planes at a smaller one are ignored
constexpr int kBandRows = 16;
constexpr uint8_t kNoView = 255;
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

// A row of the image that is rendered: its viewing rays, the tangent planes m that win its pixels and their noise (NaN
// where nothing is visible), and the depths on those planes.
struct PlaneRow {
  const float *ray, *mx, *my, *mz, *noise, *depth;
};

// Pose of a view for the final pass.
struct ViewError {
  float translation[3];
  float root[6][6];          // columns of a root of the covariance: cov = root root^T
  float relative_sigma = 0;  // largest relative sigma of 1/z due to the pose
};

// Writes depth and sigma of the pixels that show view `view`.
FRINGESLAM_INLINE void finish_body(const PlaneRow& row, const uint8_t* winning_view, uint8_t view,
                                   const ViewError& error, int width, float* __restrict depth,
                                   float* __restrict sigma) {
#pragma GCC ivdep
  for (int i = 0; i < width; ++i) {
    const float mx = row.mx[i], my = row.my[i], mz = row.mz[i], rx = row.ray[2 * i], ry = row.ray[2 * i + 1];
    const float z_here = 1 / (mx * rx + my * ry + mz);
    const float x = z_here * rx - error.translation[0], y = z_here * ry - error.translation[1],
                z = z_here - error.translation[2];
    // With m in place of n, g becomes g / D, and n.d becomes D / z.
    const float g[6] = {y * mz - z * my, z * mx - x * mz, x * my - y * mx, mx, my, mz};
    float square = row.noise[i] * row.noise[i];
    for (int column = 0; column < 6; ++column) {
      float along = 0;
      for (int k = 0; k < 6; ++k) along += error.root[column][k] * g[k];
      square += along * along;
    }
    const bool own = winning_view[i] == view;
    depth[i] = own ? z_here : depth[i];
    sigma[i] = own ? z_here * std::sqrt(square) : sigma[i];
  }
}

// Distance of two pixels from each other's planes, m; 0 if noise explains it, NaN if either is unknown.
FRINGESLAM_INLINE float step_between(const PlaneRow& a, int i, const PlaneRow& b, int j, float surface_sigmas) {
  const float off_b = std::abs(1 - b.depth[j] * (a.mx[i] * b.ray[2 * j] + a.my[i] * b.ray[2 * j + 1] + a.mz[i]));
  const float off_a = std::abs(1 - a.depth[i] * (b.mx[j] * a.ray[2 * i] + b.my[j] * a.ray[2 * i + 1] + b.mz[j]));
  const float noise = surface_sigmas * std::sqrt(a.noise[i] * a.noise[i] + b.noise[j] * b.noise[j]) + 1e-5f;
  const float at_a = off_a * a.depth[i], at_b = off_b * b.depth[j];
  const float least = off_a < off_b ? off_a : off_b, size = at_a < at_b ? at_a : at_b;
  return least <= noise ? 0 : size;
}

// Raises `step` to the distances between pixels `offset` apart in two rows.
FRINGESLAM_INLINE void steps_body(const PlaneRow& row, const PlaneRow& other, int offset, int width,
                                  float surface_sigmas, float* __restrict step) {
#pragma GCC ivdep
  for (int i = 0; i < width; ++i) {
    const float size = step_between(row, i, other, i + offset, surface_sigmas);
    step[i] = size > step[i] ? size : step[i];  // false for NaN
  }
}

// A row of a known frame and the range of image rows it projects to.
struct SourceRow {
  int view = 0, row = 0;
  size_t first = 0;  // index of its first splat
  int width = 0;
  float lowest_v = 0, highest_v = 0;
};

// How a view's points appear from the new pose: the maximum over a grid of them.
struct Appearance {
  Eigen::Vector2d shift_px = Eigen::Vector2d::Zero();  // standard deviations of the shift due to the view's pose error
  double relative_depth = 0;                           // that of the depth, relative to it
  double magnification = 1;
};

Appearance appearance_of(const KnownView& view, const Pinhole& camera) {
  constexpr int kStep = 32;
  Appearance result;
  const double largest_r2 = camera.largest_r2();
  for (int row = kStep / 2; row < view.frame->height(); row += kStep) {
    for (int col = kStep / 2; col < view.frame->width(); col += kStep) {
      if (!view.frame->valid(row, col)) continue;
      const cv::Vec3f& p = view.frame->points_m(row, col);
      const Eigen::Vector3d turned = view.current_from_known.rotation * Eigen::Vector3d(p[0], p[1], p[2]);
      const Eigen::Vector3d x = turned + view.current_from_known.translation;
      Eigen::Vector2d pixel;
      if (!camera.shows(x, largest_r2, pixel)) continue;
      Eigen::Matrix<double, 3, 6> moved;
      moved << -skew(turned), Eigen::Matrix3d::Identity();
      Eigen::Matrix<double, 2, 3> seen;
      seen << camera.fx / x.z(), 0, -camera.fx * x.x() / (x.z() * x.z()), 0, camera.fy / x.z(),
          -camera.fy * x.y() / (x.z() * x.z());
      const Eigen::Matrix3d covariance = moved * view.covariance * moved.transpose();
      result.shift_px =
          result.shift_px.cwiseMax((seen * covariance * seen.transpose()).diagonal().cwiseMax(0).cwiseSqrt());
      result.relative_depth = std::max(result.relative_depth, std::sqrt(std::max(0.0, covariance.trace())) / x.z());
      result.magnification = std::max(result.magnification, static_cast<double>(p[2]) / x.z());
    }
  }
  return result;
}

ViewError error_of(const KnownView& view, double relative_sigma) {
  ViewError error;
  const Matrix6d root = covariance_root(view.covariance);
  for (int i = 0; i < 36; ++i) error.root[i / 6][i % 6] = static_cast<float>(root(i % 6, i / 6));
  for (int i = 0; i < 3; ++i) error.translation[i] = static_cast<float>(view.current_from_known.translation[i]);
  error.relative_sigma = static_cast<float>(relative_sigma);
  return error;
}

class Rendering {
 public:
  Rendering(const std::vector<KnownView>& known, const Pinhole& camera, const PixelRays& rays,
            const ExpectedViewOptions& options)
      : known_(known), camera_(camera), rays_(rays), surface_sigmas_(static_cast<float>(options.surface_sigmas)) {
    // A footprint of two pixels leaves no gaps between points up to sqrt(2) pixels apart.
    constexpr double kMagnified = 1.25;
    Eigen::Vector2d shift = Eigen::Vector2d::Zero();
    size_t points = 0;
    for (size_t v = 0; v < known.size(); ++v) {
      const Frame& frame = *known[v].frame;
      const Appearance appearance = appearance_of(known[v], camera);
      shift = shift.cwiseMax(appearance.shift_px);
      errors_.push_back(error_of(known[v], appearance.relative_depth));
      magnified_ = magnified_ || appearance.magnification > kMagnified;
      for (int row = 0; row < frame.height(); ++row, points += static_cast<size_t>(frame.width()))
        rows_.push_back({static_cast<int>(v), row, points, frame.width()});
    }
    // The splats extend half a pixel beyond the shift.
    reach_ = {static_cast<int>(std::ceil(0.5 + options.shift_sigmas * shift.x())),
              static_cast<int>(std::ceil(0.5 + options.shift_sigmas * shift.y()))};
    arrays_ = std::make_unique_for_overwrite<float[]>(6 * points);
    float* free_floats = arrays_.get();
    for (float** array : {&splats_.u, &splats_.v, &splats_.mx, &splats_.my, &splats_.mz, &splats_.noise}) {
      *array = free_floats;
      free_floats += points;
    }
  }

  ExpectedView render() {
    for_each_row(static_cast<int>(rows_.size()), [&](int row) { project(rows_[static_cast<size_t>(row)]); });
    ExpectedView view{cv::Mat1f(rays_.size()), cv::Mat1f(rays_.size())};
    for (cv::Mat1f* image : {&mx_, &my_, &mz_, &noise_}) image->create(rays_.size());
    winning_view_.create(rays_.size());
    const int bands = (rays_.rows + kBandRows - 1) / kBandRows;
    for_each_row(bands,
                 [&](int band) { magnified_ ? cover<3>(band * kBandRows, view) : cover<2>(band * kBandRows, view); });
    inflate_sigma_at_steps(view);
    return view;
  }

 private:
  void project(SourceRow& source) {
    static const auto splat = Variants<splat_body>::of(selected_instruction_set());
    const KnownView& view = known_[static_cast<size_t>(source.view)];
    const Frame& frame = *view.frame;
    const Projection projection(view.current_from_known, camera_);
    const Splats out = splats_.from(source.first);
    const cv::Vec3f* normals = frame.normals[source.row];
    splat(frame.points_m[source.row], normals, frame.sigma_m[source.row], source.width, projection, out);
    source.lowest_v = std::numeric_limits<float>::max();
    source.highest_v = std::numeric_limits<float>::lowest();
    splat_without_normals(frame, source, projection, out);
    for (int i = 0; i < source.width; ++i) {
      if (out.u[i] == kNowhere) continue;
      source.lowest_v = std::min(source.lowest_v, out.v[i]);
      source.highest_v = std::max(source.highest_v, out.v[i]);
    }
  }

  static void splat_without_normals(const Frame& frame, const SourceRow& source, const Projection& projection,
                                    const Splats& out) {
    static const auto splat = Variants<splat_body>::of(selected_instruction_set());
    std::vector<int> cols;
    std::vector<cv::Vec3f> points, normals;
    std::vector<float> sigmas;
    for (int i = 0; i < source.width; ++i) {
      if (!std::isnan(frame.normals(source.row, i)[2]) || !frame.valid(source.row, i)) continue;
      cols.push_back(i);
      points.push_back(frame.points_m(source.row, i));
      normals.push_back(neighbour_normal(frame.points_m, source.row, i));
      sigmas.push_back(kRoughSigmas * frame.sigma_m(source.row, i));
    }
    if (cols.empty()) return;
    std::array<std::vector<float>, 6> some;
    for (std::vector<float>& values : some) values.resize(cols.size());
    splat(points.data(), normals.data(), sigmas.data(), static_cast<int>(cols.size()), projection,
          {some[0].data(), some[1].data(), some[2].data(), some[3].data(), some[4].data(), some[5].data()});
    float* const to[6] = {out.u, out.v, out.mx, out.my, out.mz, out.noise};
    for (size_t k = 0; k < some.size(); ++k) {
      for (size_t i = 0; i < cols.size(); ++i) to[k][cols[i]] = some[k][i];
    }
  }

  PlaneRow plane_row(const ExpectedView& view, int row) const {
    return {&rays_[row][0][0], mx_[row], my_[row], mz_[row], noise_[row], view.depth_m[row]};
  }

  // Renders everything that falls on a band of rows; each band is written by one thread. The band's buffers have a
  // border of two pixels, so that the footprint of any splat that covers one of its pixels lies within them.
  // `footprint`: pixels that a point covers along rows and columns.
  template <int footprint>
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
    // Surfaces behind this share of the inverse depth are hidden. Pose errors only matter between different views.
    const auto share_of = [&](const Candidate& c) {
      const float other = known_.size() > 1 ? errors_[static_cast<size_t>(c.view)].relative_sigma : 0;
      const float noise = splats_.noise[c.splat];
      return 1 - surface_sigmas_ * std::sqrt(noise * noise + other * other) - 1e-6f;
    };
    const auto for_each_covered = [&](const Candidate& c, const auto& use) {
      const auto splat = static_cast<size_t>(c.splat);
      const float mx = splats_.mx[splat], my = splats_.my[splat], mz = splats_.mz[splat];
      for (int row = 0; row < footprint; ++row) {
        const auto first = static_cast<size_t>(c.corner + row * stride);
        for (size_t col = 0; col < static_cast<size_t>(footprint); ++col)
          use(first + col, row, col, mx * ray_x[first + col] + my * ray_y[first + col] + mz);
      }
    };
    size_t entered = 0;
    const auto enter_candidates = [&] {
      for (; entered < candidates.size(); ++entered) {
        for_each_covered(candidates[entered], [&](size_t at, int, size_t, float inverse) {
          nearest[at] = inverse > nearest[at] ? inverse : nearest[at];  // false for NaN
        });
      }
    };
    // The first pixel of a footprint is the rounded position, less one for three pixels, and the one below it for two.
    const float to_first = footprint == 3 ? 0.5f - 1 : 0;
    const float before = static_cast<float>(footprint - 1) + to_first;
    const float low = static_cast<float>(first_row) - before, high = static_cast<float>(first_row + rows) - to_first;
    const float right = static_cast<float>(cols) - to_first;
    int last_view = 0;
    for (const SourceRow& source : rows_) {
      if (source.highest_v < low || source.lowest_v > high) continue;
      if (source.view != last_view) enter_candidates();
      last_view = source.view;
      for (size_t i = source.first; i < source.first + static_cast<size_t>(source.width); ++i) {
        const float u = splats_.u[i], v = splats_.v[i];
        if (!((v >= low) & (v < high) & (u >= -before) & (u < right))) continue;
        // The arguments are positive, so the conversion rounds down.
        const int col = static_cast<int>(u + to_first + kBorder),
                  row = static_cast<int>(v - static_cast<float>(first_row) + to_first + kBorder);
        const Candidate candidate{static_cast<int>(i), source.view, row * stride + col,
                                  u - static_cast<float>(col - kBorder),
                                  v - static_cast<float>(first_row + row - kBorder)};
        // Later views fill what the earlier ones leave open, and cover what they show behind them.
        if (source.view > 0) {
          const auto at = static_cast<size_t>(candidate.corner + static_cast<int>(candidate.u + 0.5f) +
                                              stride * static_cast<int>(candidate.v + 0.5f));
          const float inverse = splats_.mx[i] * ray_x[at] + splats_.my[i] * ray_y[at] + splats_.mz[i];
          if (nearest[at] > 0 && !(share_of(candidate) * inverse > nearest[at])) continue;
        }
        candidates.push_back(candidate);
      }
    }
    enter_candidates();
    for (const Candidate& c : candidates) {
      const float share = share_of(c);
      for_each_covered(c, [&](size_t at, int row, size_t col, float inverse) {
        const float du = c.u - static_cast<float>(col), dv = c.v - static_cast<float>(row), square = du * du + dv * dv;
        if (!((inverse >= share * nearest[at]) & (square < distance[at]))) return;
        distance[at] = square;
        winner[at] = c.splat;
        winning_view[at] = c.view;
      });
    }
    for (int row = 0; row < rows; ++row) {
      const auto first = static_cast<size_t>((row + kBorder) * stride + kBorder);
      show(first_row + row, winner.data() + first, winning_view.data() + first, view);
    }
  }

  // Writes a row of the image, given the splats and the views that won its pixels.
  void show(int row, const int* winner, const int* winning_view, ExpectedView& view) {
    static const auto finish = Variants<finish_body>::of(selected_instruction_set());
    float *const mx = mx_[row], *const my = my_[row], *const mz = mz_[row], *const noise = noise_[row];
    uint8_t* const shown = winning_view_[row];
    const int cols = rays_.cols;
    std::array<bool, kNoView> shows{};
    for (int col = 0; col < cols; ++col) {
      const int splat = winner[col];
      const bool any = splat >= 0;
      mx[col] = any ? splats_.mx[splat] : kNaN;
      my[col] = any ? splats_.my[splat] : kNaN;
      mz[col] = any ? splats_.mz[splat] : kNaN;
      noise[col] = any ? splats_.noise[splat] : kNaN;
      shown[col] = any ? static_cast<uint8_t>(winning_view[col]) : kNoView;
      if (any) shows[shown[col]] = true;
    }
    std::fill_n(view.depth_m[row], cols, kNaN);
    std::fill_n(view.sigma_m[row], cols, kNaN);
    for (size_t v = 0; v < errors_.size(); ++v) {
      if (shows[v])
        finish(plane_row(view, row), shown, static_cast<uint8_t>(v), errors_[v], cols, view.depth_m[row],
               view.sigma_m[row]);
    }
  }

  bool is_visible(int row, int col) const { return winning_view_(row, col) != kNoView; }

  // Compares each pixel with the nearest visible ones to its left and right, above and below.
  void inflate_sigma_at_steps(ExpectedView& view) const {
    static const auto compare = Variants<steps_body>::of(selected_instruction_set());
    cv::Mat1f steps(view.depth_m.size(), 0.0f);
    const int rows = steps.rows, cols = steps.cols;
    for_each_row(rows, [&](int row) {
      const PlaneRow here = plane_row(view, row);
      float* const step = steps[row];
      compare(here, here, 1, cols - 1, surface_sigmas_, step);
      const PlaneRow next{here.ray + 2, here.mx + 1, here.my + 1, here.mz + 1, here.noise + 1, here.depth + 1};
      compare(next, here, 0, cols - 1, surface_sigmas_, step + 1);
      if (row > 0) compare(here, plane_row(view, row - 1), 0, cols, surface_sigmas_, step);
      if (row + 1 < rows) compare(here, plane_row(view, row + 1), 0, cols, surface_sigmas_, step);
      // Across gaps.
      const auto raise = [](float& value, float size) { value = std::max(value, size); };
      for (int col = 0, last = -1; col < cols; ++col) {
        if (!is_visible(row, col)) continue;
        if (last >= 0 && last + 1 < col) {
          const float size = step_between(here, col, here, last, surface_sigmas_);
          raise(step[col], size);
          raise(step[last], size);
        }
        last = col;
        for (const int way : {-1, 1}) {
          int other = row + way;
          if (other < 0 || other >= rows || is_visible(other, col)) continue;
          while (other >= 0 && other < rows && !is_visible(other, col)) other += way;
          if (other >= 0 && other < rows)
            raise(step[col], step_between(here, col, plane_row(view, other), col, surface_sigmas_));
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
  bool magnified_ = false;
  cv::Size reach_;
  std::vector<ViewError> errors_;
  std::vector<SourceRow> rows_;
  std::unique_ptr<float[]> arrays_;
  Splats splats_{};
  cv::Mat1f mx_, my_, mz_, noise_;  // of the splats that win the pixels
  cv::Mat1b winning_view_;
};

}  // namespace

ExpectedView expected_view(const std::vector<KnownView>& known, const Pinhole& camera, const PixelRays& rays,
                           const ExpectedViewOptions& options) {
  check_options(options, "expected_view");
  if (rays.size() != cv::Size(camera.width, camera.height))
    throw Error("expected view: the rays do not have the camera's size");
  if (known.size() >= kNoView) throw Error("expected view: more than " + std::to_string(kNoView - 1) + " frames");
  for (const KnownView& view : known) {
    if (view.frame->normals.size() != view.frame->points_m.size() ||
        view.frame->sigma_m.size() != view.frame->points_m.size())
      throw Error("expected view: points, sigmas and normals of frame " + std::to_string(view.frame->index) +
                  " differ in size");
  }
  return Rendering(known, camera, rays, options).render();
}

}  // namespace fringeslam
