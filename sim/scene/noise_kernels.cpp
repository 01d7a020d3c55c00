// SPDX-License-Identifier: Apache-2.0
// Noise for sixteen points at a time; the loops over lanes are auto-vectorised.
#include <cmath>

#include "core/types/selected_instruction_set.h"
#include "sim/scene/noise.h"

namespace fringeslam::sim {

namespace {

FRINGESLAM_INLINE uint32_t mixed(uint32_t h) {
  h ^= h >> 15;
  h *= 0x2c1b3c6du;
  h ^= h >> 12;
  h *= 0x297a2d39u;
  h ^= h >> 15;
  return h;
}

FRINGESLAM_INLINE float to_signed_unit(uint32_t h) {
  return static_cast<float>(static_cast<int32_t>(h >> 8)) * (1.0f / 8388608.0f) - 1.0f;
}

FRINGESLAM_INLINE float fade(float t) { return t * t * t * (t * (6 * t - 15) + 10); }

// Adds weight * noise(scale * p).
FRINGESLAM_INLINE void add_noise(const NoisePoints& p, float scale, float weight, uint32_t seed, NoiseValues& sum) {
  for (int i = 0; i < kNoiseLanes; ++i) {
    const float x = scale * p.x[i], y = scale * p.y[i], z = scale * p.z[i];
    // Floor without a library call: truncate, then subtract one where truncation rounded up.
    const auto tx = static_cast<int32_t>(x), ty = static_cast<int32_t>(y), tz = static_cast<int32_t>(z);
    const int32_t cx = tx - (static_cast<float>(tx) > x), cy = ty - (static_cast<float>(ty) > y),
                  cz = tz - (static_cast<float>(tz) > z);
    const float wx = fade(x - static_cast<float>(cx)), wy = fade(y - static_cast<float>(cy)),
                wz = fade(z - static_cast<float>(cz));
    const uint32_t x0 = static_cast<uint32_t>(cx) * 0x85ebca6bu, x1 = x0 + 0x85ebca6bu;
    const uint32_t y0 = static_cast<uint32_t>(cy) * 0xc2b2ae35u, y1 = y0 + 0xc2b2ae35u;
    const uint32_t z0 = static_cast<uint32_t>(cz) * 0x27d4eb2fu + seed * 0x9e3779b9u, z1 = z0 + 0x27d4eb2fu;
    const float n000 = to_signed_unit(mixed(x0 + y0 + z0)), n100 = to_signed_unit(mixed(x1 + y0 + z0));
    const float n010 = to_signed_unit(mixed(x0 + y1 + z0)), n110 = to_signed_unit(mixed(x1 + y1 + z0));
    const float n001 = to_signed_unit(mixed(x0 + y0 + z1)), n101 = to_signed_unit(mixed(x1 + y0 + z1));
    const float n011 = to_signed_unit(mixed(x0 + y1 + z1)), n111 = to_signed_unit(mixed(x1 + y1 + z1));
    const float a = n000 + wx * (n100 - n000), b = n010 + wx * (n110 - n010);
    const float c = n001 + wx * (n101 - n001), d = n011 + wx * (n111 - n011);
    const float front = a + wy * (b - a), back = c + wy * (d - c);
    sum.value[i] += weight * (front + wz * (back - front));
  }
}

FRINGESLAM_INLINE void fractal(const NoisePoints& points, int octaves, uint32_t seed, NoiseValues& sum) {
  float weight = 1, total = 0;
  for (int octave = 0; octave < octaves; ++octave) {
    total += weight;
    weight *= 0.5f;
  }
  weight = 1 / total;
  float scale = 1;
  for (int octave = 0; octave < octaves; ++octave) {
    add_noise(points, scale, weight, seed + static_cast<uint32_t>(octave) * 101u, sum);
    weight *= 0.5f;
    scale *= 2;
  }
}

}  // namespace

NoiseValues fractal_noise(const NoisePoints& points, int octaves, uint32_t seed) {
  static const auto add = Variants<fractal>::of(selected_instruction_set());
  NoiseValues sum{};
  add(points, octaves, seed, sum);
  return sum;
}

NoiseValues value_noise(const NoisePoints& points, uint32_t seed) { return fractal_noise(points, 1, seed); }

}  // namespace fringeslam::sim
