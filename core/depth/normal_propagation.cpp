// SPDX-License-Identifier: Apache-2.0
#include "core/depth/normal_propagation.h"

#include "core/base/lanes.h"

namespace fringeslam {

namespace {

constexpr float kMaxSigmas = 2.5f, kMaxNeighbourSigmas = 4.5f;

// Pointers to column 0 of a row.
struct Rows {
  const float *x, *y, *z, *sigma;
  const float* normal[3];
  ptrdiff_t stride;
};

template <int lanes>
struct Points {
  typename Lanes<lanes>::Floats x, y, z, sigma;  // sigma relative to z
};

// Squared distance of points from a plane, and its variance due to the noise of both: depth noise moves a point along
// its ray, and thus along the normal in proportion to the point's distance from the origin along the normal.
template <int lanes>
struct Distance {
  typename Lanes<lanes>::Floats square, variance;
  FRINGESLAM_INLINE typename Lanes<lanes>::Mask within(float sigmas) const {
    return Lanes<lanes>::not_negative(sigmas * sigmas * variance - square);
  }
};

template <int lanes>
FRINGESLAM_INLINE void adopt_lanes(const Rows& rows, int radius, int col, int32_t* wanted, float* const to[3]) {
  using L = Lanes<lanes>;
  using V = typename L::Floats;
  const auto point = [&](ptrdiff_t by) __attribute__((always_inline)) {
    const auto at = [&](const float* from) __attribute__((always_inline)) { return L::load(from + col + by); };
    const V z = at(rows.z);
    return Points<lanes>{z * at(rows.x), z * at(rows.y), z, at(rows.sigma)};
  };
  const Points<lanes> here = point(0), left = point(-1), right = point(1), above = point(-rows.stride),
                      below = point(rows.stride);
  const auto asked = L::load(wanted + col);
  typename L::Mask found{};
  V best[3] = {}, best_square = V{} + kMaxSigmas * kMaxSigmas;
  for (int direction = 0; direction < 9; ++direction) {
    const ptrdiff_t by = (direction / 3 - 1) * radius * rows.stride + (direction % 3 - 1) * radius;
    const V nx = L::load(rows.normal[0] + col + by), ny = L::load(rows.normal[1] + col + by),
            nz = L::load(rows.normal[2] + col + by);
    const auto along = [&](const Points<lanes>& p) __attribute__((always_inline)) {
      return nx * p.x + ny * p.y + nz * p.z;
    };
    const Points<lanes> centre = point(by);
    const V offset = along(centre), own = offset * centre.sigma;
    const auto distance = [&](const Points<lanes>& p) __attribute__((always_inline)) {
      const V height = along(p), off = height - offset, sigma = height * p.sigma;
      return Distance<lanes>{off * off, sigma * sigma + own * own};
    };
    const Distance<lanes> d = distance(here);
    // Without a plane both are 0, and the comparison is false.
    const auto closer = L::negative(d.square - best_square * d.variance) & asked;
    if (!L::any(closer)) continue;
    const auto better = closer & distance(left).within(kMaxNeighbourSigmas) &
                        distance(right).within(kMaxNeighbourSigmas) & distance(above).within(kMaxNeighbourSigmas) &
                        distance(below).within(kMaxNeighbourSigmas);
    best_square = L::chosen(better, d.square / d.variance, best_square);
    found |= better;
    best[0] = L::chosen(better, nx, best[0]);
    best[1] = L::chosen(better, ny, best[1]);
    best[2] = L::chosen(better, nz, best[2]);
  }
  for (int k = 0; k < 3; ++k) L::store(L::chosen(found, best[k], L::load(to[k] + col)), to[k] + col);
  L::store(asked & ~found, wanted + col);
}

template <int lanes>
FRINGESLAM_INLINE void adopt_row(const Rows& rows, int width, int radius, int32_t* wanted, float* const to[3]) {
  using L = Lanes<lanes>;
  for (int col = 0; col < width; col += lanes) {
    if (L::any(L::load(wanted + col))) adopt_lanes<lanes>(rows, radius, col, wanted, to);
  }
}

}  // namespace

void propagate_normals(const FitImage& image, const NormalImages& fitted, int row, int radius, int32_t* wanted,
                       NormalImages& normals, InstructionSet set) {
  const Rows rows{
      image.x[row],    image.y[row], image.z[row], image.sigma[row], {fitted.x[row], fitted.y[row], fitted.z[row]},
      image.z.stride()};
  float* const to[3] = {normals.x[row], normals.y[row], normals.z[row]};
  Variants<adopt_row<4>, adopt_row<8>, adopt_row<16>>::of(set)(rows, image.size.width, radius, wanted, to);
}

}  // namespace fringeslam
