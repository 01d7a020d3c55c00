// SPDX-License-Identifier: Apache-2.0
#include "core/map/mesh.h"

#include <cmath>
#include <numbers>

namespace fringeslam {

namespace {

constexpr uint32_t kNoVertex = UINT32_MAX;

struct Pixel {
  int row = 0, col = 0;
};

class GridMesher {
 public:
  GridMesher(const Frame& frame, const MeshOptions& options)
      : frame_(frame),
        max_slope_(std::tan(options.max_slope_deg * std::numbers::pi / 180)),
        max_step_m_(options.max_step_m) {}

  Mesh mesh() {
    for (int row = 0; row + 1 < frame_.height(); ++row) {
      for (int col = 0; col + 1 < frame_.width(); ++col) add_block(row, col);
    }
    number_vertices();
    return std::move(mesh_);
  }

 private:
  Eigen::Vector3d point(const Pixel& p) const {
    const cv::Vec3f& v = frame_.points_m(p.row, p.col);
    return {v[0], v[1], v[2]};
  }
  bool valid(const Pixel& p) const { return frame_.valid(p.row, p.col); }

  bool is_edge(const Pixel& from, const Pixel& to) const {
    const Eigen::Vector3d p = point(from), q = point(to), edge = q - p;
    const double along = std::abs(edge.dot((p + q).normalized()));
    const double across = std::sqrt(std::max(0.0, edge.squaredNorm() - along * along));
    return along <= max_step_m_ && along <= across * max_slope_;
  }

  void add_triangle(const Pixel& a, const Pixel& b, const Pixel& c) {
    if (!valid(a) || !valid(b) || !valid(c)) return;
    if (!is_edge(a, b) || !is_edge(b, c) || !is_edge(c, a)) return;
    const auto index = [&](const Pixel& p) { return static_cast<uint32_t>(p.row * frame_.width() + p.col); };
    mesh_.triangles.push_back({index(a), index(b), index(c)});
  }

  // The y axis points down, so down before right is counter-clockwise for the camera.
  void add_block(int row, int col) {
    const Pixel a{row, col}, b{row, col + 1}, c{row + 1, col}, d{row + 1, col + 1};
    const int corners = valid(a) + valid(b) + valid(c) + valid(d);
    if (corners < 3) return;
    const double falling = (point(d) - point(a)).squaredNorm(), rising = (point(c) - point(b)).squaredNorm();
    const bool cut_falling = corners == 4 ? falling <= rising : valid(a) && valid(d);
    if (cut_falling) {
      add_triangle(a, c, d);
      add_triangle(a, d, b);
    } else {
      add_triangle(a, c, b);
      add_triangle(b, c, d);
    }
  }

  // Numbers the vertices; triangles contain pixel indices up to here.
  void number_vertices() {
    const size_t pixels = frame_.points_m.total();
    std::vector<uint32_t> vertex(pixels, kNoVertex);
    for (const auto& triangle : mesh_.triangles) {
      for (const uint32_t pixel : triangle) vertex[pixel] = 0;
    }
    for (size_t pixel = 0; pixel < pixels; ++pixel) {
      if (vertex[pixel] == kNoVertex) continue;
      vertex[pixel] = static_cast<uint32_t>(mesh_.vertices.size());
      const Pixel p{static_cast<int>(pixel) / frame_.width(), static_cast<int>(pixel) % frame_.width()};
      mesh_.vertices.push_back({point(p).cast<float>(), frame_.texture(p.row, p.col)});
    }
    for (auto& triangle : mesh_.triangles) {
      for (uint32_t& corner : triangle) corner = vertex[corner];
    }
  }

  const Frame& frame_;
  double max_slope_, max_step_m_;
  Mesh mesh_;
};

}  // namespace

Mesh frame_mesh(const Frame& frame, const MeshOptions& options) {
  check_options(options, "mesh");
  return GridMesher(frame, options).mesh();
}

}  // namespace fringeslam
