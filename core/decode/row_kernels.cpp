// SPDX-License-Identifier: Apache-2.0
#include "core/decode/row_kernels.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>

#include "core/base/constants.h"
#include "core/base/turns.h"
#include "core/decode/steps.h"

namespace fringeslam {

namespace {

// Phase noise due to the projector's 256 grey levels, turns.
constexpr float kPatternSigma = static_cast<float>(kProjectorSigma_rad) / kTwoPiFloat;
constexpr float kWrapSigmas = 4.5f;
constexpr float kBorderPx = 0.5f;  // margin by which noise may move a coordinate past the projector's border

FRINGESLAM_INLINE float wrapped(float turns) { return turns - std::floor(turns + 0.5f); }

// Returns the probability that a normal variable exceeds x standard deviations, with an absolute error of 3e-7
// (Abramowitz and Stegun 7.1.28).
FRINGESLAM_INLINE float normal_tail(float x) {
  const float z = std::abs(x) * (1 / std::numbers::sqrt2_v<float>);
  float sum = 0.0000430638f;
  sum = sum * z + 0.0002765672f;
  sum = sum * z + 0.0001520143f;
  sum = sum * z + 0.0092705272f;
  sum = sum * z + 0.0422820123f;
  sum = sum * z + 0.0705230784f;
  sum = sum * z + 1;
  const float p2 = sum * sum, p4 = p2 * p2, p8 = p4 * p4;
  const float tail = 0.5f / (p8 * p8);
  return x < 0 ? 1 - tail : tail;
}

// Phase of one period from the linear estimates c of I'' cos phi and s of I'' sin phi. d phi = (c ds - s dc) / I''^2 is
// linear in the samples as well, which gives its variance.
struct PhaseRow {
  float *mean, *modulation, *turns, *variance;
  int32_t* valid;
};

FRINGESLAM_INLINE void finish_phase(const RowPlan& plan, int i, float mean, float c, float s, float variance_sum,
                                    float largest, const PhaseRow& out) {
  const float power = c * c + s * s;
  const float modulation = std::sqrt(power);
  const float variance = variance_sum / (power * power * (kTwoPiFloat * kTwoPiFloat));
  out.mean[i] = mean;
  out.modulation[i] = modulation;
  out.turns[i] = atan2_turns(s, c);
  out.variance[i] = variance;
  const float max_variance = plan.max_sigma_turns * plan.max_sigma_turns;
  out.valid[i] = (largest < plan.clip_dn) & (modulation >= plan.min_modulation_dn) &
                 (modulation >= plan.min_data_modulation * mean) & (variance <= max_variance);
}

FRINGESLAM_INLINE float grey_variance(const RowPlan& plan, float grey) {
  const float signal = grey - plan.offset_dn;
  return plan.noise_constant + plan.noise_per_dn * (signal > 0 ? signal : 0);
}

FRINGESLAM_INLINE void phase_of_three(const RowPlan& plan, const StepEstimator& e, const float* const* samples,
                                      int width, const PhaseRow& out) {
  const float* s0 = samples[e.images[0]];
  const float* s1 = samples[e.images[1]];
  const float* s2 = samples[e.images[2]];
  const float m0 = e.mean[0], m1 = e.mean[1], m2 = e.mean[2];
  const float c0 = e.cosine[0], c1 = e.cosine[1], c2 = e.cosine[2];
  const float w0 = e.sine[0], w1 = e.sine[1], w2 = e.sine[2];
#pragma GCC ivdep
  for (int i = 0; i < width; ++i) {
    const float a = s0[i], b = s1[i], d = s2[i];
    const float mean = m0 * a + m1 * b + m2 * d;
    const float c = c1 * (b - a) + c2 * (d - a);
    const float s = w1 * (b - a) + w2 * (d - a);
    const float slope0 = c * w0 - s * c0, slope1 = c * w1 - s * c1, slope2 = c * w2 - s * c2;
    const float variance = slope0 * slope0 * grey_variance(plan, a) + slope1 * slope1 * grey_variance(plan, b) +
                           slope2 * slope2 * grey_variance(plan, d);
    const float ab = a > b ? a : b;
    finish_phase(plan, i, mean, c, s, variance, ab > d ? ab : d, out);
  }
}

FRINGESLAM_INLINE void phase_of_many(const RowPlan& plan, const StepEstimator& e, const float* const* samples,
                                     int width, const PhaseRow& out) {
  constexpr int kBlock = 128;
  float mean[kBlock], c[kBlock], s[kBlock], variance[kBlock], largest[kBlock];
  const float* first = samples[e.images[0]];
  for (int begin = 0; begin < width; begin += kBlock) {
    const int count = std::min(kBlock, width - begin);
#pragma GCC ivdep
    for (int i = 0; i < kBlock; ++i) mean[i] = c[i] = s[i] = variance[i] = largest[i] = 0;
    for (size_t k = 0; k < e.images.size(); ++k) {
      const float* grey = samples[e.images[k]] + begin;
      const float wm = e.mean[k], wc = e.cosine[k], ws = e.sine[k];
#pragma GCC ivdep
      for (int i = 0; i < count; ++i) {
        const float difference = grey[i] - first[begin + i];
        mean[i] += wm * grey[i];
        c[i] += wc * difference;
        s[i] += ws * difference;
        largest[i] = grey[i] > largest[i] ? grey[i] : largest[i];
      }
    }
    for (size_t k = 0; k < e.images.size(); ++k) {
      const float* grey = samples[e.images[k]] + begin;
      const float wc = e.cosine[k], ws = e.sine[k];
#pragma GCC ivdep
      for (int i = 0; i < count; ++i) {
        const float slope = c[i] * ws - s[i] * wc;
        variance[i] += slope * slope * grey_variance(plan, grey[i]);
      }
    }
#pragma GCC ivdep
    for (int i = 0; i < count; ++i) finish_phase(plan, begin + i, mean[i], c[i], s[i], variance[i], largest[i], out);
  }
}

// The phase at the reference time of a stack taken in motion. The shifts delta_k + 2 pi drift_k / p differ from pixel to
// pixel: least squares over (1, cos, -sin) of them.
FRINGESLAM_INLINE void phase_in_motion(const RowPlan& plan, const StepEstimator& e, const RowScratch& scratch,
                                       int width, const PhaseRow& out) {
  constexpr int kBlock = 128;
  const size_t steps = e.images.size();
  const float per_px = 1 / e.period_px;
  float cosine[kMaxSteps][kBlock], sine[kMaxSteps][kBlock];
  for (int begin = 0; begin < width; begin += kBlock) {
    const int count = std::min(kBlock, width - begin);
    float cc[kBlock], ss[kBlock], cs[kBlock], c1[kBlock], s1[kBlock], i1[kBlock], ic[kBlock], is[kBlock],
        largest[kBlock], mean[kBlock], c[kBlock], s[kBlock], variance[kBlock];
    float vc_c[kBlock], vc_s[kBlock];
    for (int i = 0; i < kBlock; ++i)
      cc[i] = ss[i] = cs[i] = c1[i] = s1[i] = i1[i] = ic[i] = is[i] = largest[i] = variance[i] = 0;
    for (size_t k = 0; k < steps; ++k) {
      const auto image = static_cast<size_t>(e.images[k]);
      const float *grey = scratch.samples[image] + begin, *drift = scratch.drift_px[image] + begin;
      const float shift = e.shift_turns[k];
#pragma GCC ivdep
      for (int i = 0; i < count; ++i) {
        float a, b;
        cosine_sine(shift + per_px * drift[i], a, b);
        cosine[k][i] = a;
        sine[k][i] = b;
        cc[i] += a * a;
        ss[i] += b * b;
        cs[i] += a * b;
        c1[i] += a;
        s1[i] += b;
        i1[i] += grey[i];
        ic[i] += grey[i] * a;
        is[i] += grey[i] * b;
        largest[i] = grey[i] > largest[i] ? grey[i] : largest[i];
      }
    }
    const auto n = static_cast<float>(steps);
#pragma GCC ivdep
    for (int i = 0; i < count; ++i) {
      // Centred second moments; I = I' + C cos - S sin.
      const float mc = c1[i] / n, ms = s1[i] / n, mi = i1[i] / n;
      const float vcc = cc[i] - n * mc * mc, vss = ss[i] - n * ms * ms, vcs = cs[i] - n * mc * ms;
      const float vic = ic[i] - n * mi * mc, vis = is[i] - n * mi * ms;
      const float determinant = vcc * vss - vcs * vcs;
      // Ill-conditioned where the drift makes two shifts equal.
      const float per = determinant > 1e-3f * n * n ? 1 / determinant : kNaN;
      const float cosine_part = (vss * vic - vcs * vis) * per;
      const float sine_part = -(vcc * vis - vcs * vic) * per;
      c[i] = cosine_part;
      s[i] = sine_part;
      mean[i] = mi - cosine_part * mc + sine_part * ms;
      // d phi = slope_k dI_k with slope_k = c dS/dI_k - s dC/dI_k, both linear in (cos_k - mc, sin_k - ms).
      vc_c[i] = (cosine_part * vcs - sine_part * vss) * per;
      vc_s[i] = (-cosine_part * vcc + sine_part * vcs) * per;
    }
    for (size_t k = 0; k < steps; ++k) {
      const float* grey = scratch.samples[static_cast<size_t>(e.images[k])] + begin;
#pragma GCC ivdep
      for (int i = 0; i < count; ++i) {
        const float slope = vc_c[i] * (cosine[k][i] - c1[i] / n) + vc_s[i] * (sine[k][i] - s1[i] / n);
        variance[i] += slope * slope * grey_variance(plan, grey[i]);
      }
    }
#pragma GCC ivdep
    for (int i = 0; i < count; ++i) {
      finish_phase(plan, begin + i, mean[i], c[i], s[i], variance[i], largest[i], out);
      const bool known = variance[i] == variance[i];
      out.mean[begin + i] = known ? out.mean[begin + i] : i1[i] / n;
      out.modulation[begin + i] = known ? out.modulation[begin + i] : 0;
      out.valid[begin + i] &= known;
    }
  }
}

// The phase from grey values of which each has its own variance: least squares over (1, cos delta_k, -sin delta_k), each
// sample weighted by its inverse variance. A correction of the projector's harmonics holds for equal weights only.
FRINGESLAM_INLINE void phase_of_weighted(const RowPlan& plan, const StepEstimator& e, const RowScratch& scratch,
                                         int width, const PhaseRow& out) {
  const size_t steps = e.images.size();
  float cosine[kMaxSteps], sine[kMaxSteps];
  for (size_t k = 0; k < steps; ++k) cosine_sine(e.shift_turns[k], cosine[k], sine[k]);
  const bool equal = !e.correction_turns.empty();
  for (int i = 0; i < width; ++i) {
    float weight[kMaxSteps], grey[kMaxSteps];
    float sum = 0, mi = 0, mc = 0, ms = 0, largest = 0;
    for (size_t k = 0; k < steps; ++k) {
      const auto image = static_cast<size_t>(e.images[k]);
      grey[k] = scratch.samples[image][i];
      weight[k] = equal ? 1 : 1 / scratch.variances[image][i];
      sum += weight[k];
      mi += weight[k] * grey[k];
      mc += weight[k] * cosine[k];
      ms += weight[k] * sine[k];
      largest = grey[k] > largest ? grey[k] : largest;
    }
    mi /= sum;
    mc /= sum;
    ms /= sum;
    float vcc = 0, vss = 0, vcs = 0, vic = 0, vis = 0;
    for (size_t k = 0; k < steps; ++k) {
      const float a = cosine[k] - mc, b = sine[k] - ms, d = grey[k] - mi;
      vcc += weight[k] * a * a;
      vss += weight[k] * b * b;
      vcs += weight[k] * a * b;
      vic += weight[k] * d * a;
      vis += weight[k] * d * b;
    }
    const float per = 1 / (vcc * vss - vcs * vcs);
    const float c = (vss * vic - vcs * vis) * per, s = -(vcc * vis - vcs * vic) * per;
    // The slope c dS/dI_k - s dC/dI_k of the phase is linear in (cos_k - mc, sin_k - ms).
    const float slope_c = (c * vcs - s * vss) * per, slope_s = (s * vcs - c * vcc) * per;
    float variance = 0;
    for (size_t k = 0; k < steps; ++k) {
      const float slope = weight[k] * (slope_c * (cosine[k] - mc) + slope_s * (sine[k] - ms));
      variance += slope * slope * scratch.variances[static_cast<size_t>(e.images[k])][i];
    }
    finish_phase(plan, i, mi - c * mc + s * ms, c, s, variance, largest, out);
  }
}

FRINGESLAM_INLINE void correct_phase(const std::vector<float>& table, int width, float* turns) {
  const float* entries = table.data();
  const auto size = static_cast<int>(table.size());
#pragma GCC ivdep
  for (int i = 0; i < width; ++i) {
    // A phase that motion left undetermined remains NaN.
    const float at = turns[i] == turns[i] ? (turns[i] - std::floor(turns[i])) * static_cast<float>(size) : 0;
    const int low = static_cast<int>(at) < size ? static_cast<int>(at) : size - 1;
    const int high = low + 1 < size ? low + 1 : 0;
    const float part = at - static_cast<float>(low);
    turns[i] = wrapped(turns[i] - entries[low] - part * (entries[high] - entries[low]));
  }
}

// Absolute phase up to the current level, with its order, failure probability and validity.
struct AbsoluteRow {
  float *turns, *order, *failure;
  int32_t* valid;
};

FRINGESLAM_INLINE void level_phase(const UnwrappingLevel& rung, const PhaseRow* groups, int width, float* turns) {
#pragma GCC ivdep
  for (int i = 0; i < width; ++i) turns[i] = 0;
  int terms = 0;
  for (size_t g = 0; g < rung.multiples.size(); ++g) {
    const auto multiple = static_cast<float>(rung.multiples[g]);
    if (multiple == 0) continue;
    ++terms;
    const float* group = groups[g].turns;
#pragma GCC ivdep
    for (int i = 0; i < width; ++i) turns[i] += multiple * group[i];
  }
  if (terms == 1) return;  // a single period is already wrapped, and half a turn must remain half a turn
#pragma GCC ivdep
  for (int i = 0; i < width; ++i) turns[i] = wrapped(turns[i]);
}

// Variance of a weighted sum of the groups' phases.
FRINGESLAM_INLINE void combined_variance(const float* weights, size_t groups_count, const PhaseRow* groups, int width,
                                         float* variance) {
#pragma GCC ivdep
  for (int i = 0; i < width; ++i) variance[i] = 0;
  for (size_t g = 0; g < groups_count; ++g) {
    const float square = weights[g] * weights[g];
    if (square == 0) continue;
    const float* group = groups[g].variance;
#pragma GCC ivdep
    for (int i = 0; i < width; ++i) variance[i] += square * (group[i] + kPatternSigma * kPatternSigma);
  }
}

// The coarsest phase is unique over one period, which may exceed the projector's length. Phases that noise moves past a
// border fall in the gap between the phases of the last and the first column; each border is assigned half of the gap.
// In the middle of the gap, or at the border if there is no gap, the assignment is ambiguous.
FRINGESLAM_INLINE void unwrap_coarsest_level(float first_turns, const float* phase, const float* variance, int width,
                                             const AbsoluteRow& out) {
#pragma GCC ivdep
  for (int i = 0; i < width; ++i) {
    const float order = phase[i] < first_turns ? 1.0f : 0.0f;
    const float turns = phase[i] + order;
    // Phase error required if the light came from beyond the other border.
    const float below = turns - 2 * first_turns, above = 1 - turns;
    const float to_other_border = below < above ? below : above;
    out.turns[i] = turns;
    out.order[i] = order;
    out.failure[i] = 0;
    out.valid[i] &= to_other_border >= kWrapSigmas * std::sqrt(variance[i]);
  }
}

// K = round(R t_low - theta_high), wrong with probability erfc(1/2 / (sqrt 2 sigma)); docs/method.md, section 3.2.
FRINGESLAM_INLINE void unwrap_level(float ratio, float max_residual_sigma, const float* phase, const float* variance,
                                    int width, const AbsoluteRow& out) {
  const float max_square = max_residual_sigma * max_residual_sigma;
#pragma GCC ivdep
  for (int i = 0; i < width; ++i) {
    const float predicted = ratio * out.turns[i];
    const float order = std::floor(predicted - phase[i] + 0.5f);
    const float residual = predicted - phase[i] - order;
    out.valid[i] &= residual * residual <= max_square * variance[i];
    out.failure[i] += 2 * normal_tail(0.5f / std::sqrt(variance[i]));
    out.order[i] = order;
    out.turns[i] = phase[i] + order;
  }
}

// K = round(t_anchor - theta). This order lies |r| from the anchor, the next one 1 - |r|; their probabilities follow
// from the anchor's uniform and normal uncertainty.
FRINGESLAM_INLINE void order_from_prior(const RowPrior& anchor, float max_residual_sigma, const PhaseRow& finest,
                                        int width, const AbsoluteRow& out) {
  const float* expected = anchor.turns.data();
  const float* half_width = anchor.half_width.data();
  const float* sigma = anchor.sigma.data();
  const float* failure = anchor.failure.data();
#pragma GCC ivdep
  for (int i = 0; i < width; ++i) {
    const float order = std::floor(expected[i] - finest.turns[i] + 0.5f);
    const float residual = std::abs(expected[i] - finest.turns[i] - order);
    const float spread = std::sqrt(sigma[i] * sigma[i] + finest.variance[i]);
    const float this_one = normal_tail((residual - half_width[i]) / spread);
    const float next_one = normal_tail((1 - residual - half_width[i]) / spread);
    out.valid[i] &= residual <= half_width[i] + max_residual_sigma * spread;
    out.failure[i] = failure[i] + next_one / (this_one + next_one);
    out.order[i] = order;
    out.turns[i] = finest.turns[i] + order;
  }
}

// `fringe` marks pixels with a valid phase, `absolute` those whose order is also known.
FRINGESLAM_INLINE void write_row(const RowPlan& plan, const PhaseRow& finest, const int32_t* fringe,
                                 const AbsoluteRow* absolute, int width, const RowOutput& out) {
  const auto period = static_cast<float>(plan.period_px);
#pragma GCC ivdep
  for (int i = 0; i < width; ++i) {
    out.modulation[i] = finest.modulation[i];
    out.wrapped_phase[i] = fringe[i] ? kTwoPiFloat * finest.turns[i] : kNaN;
    out.sigma[i] = fringe[i] ? std::sqrt(finest.variance[i]) * period : kNaN;
  }
  if (!absolute) {
#pragma GCC ivdep
    for (int i = 0; i < width; ++i) out.coordinate[i] = out.confidence[i] = kNaN;
#pragma GCC ivdep
    for (int i = 0; i < width; ++i) out.order[i] = -1;
    return;
  }
  const auto length = static_cast<float>(plan.length_px);
  const float gap = plan.unwrapping_levels.empty()
                        ? 2 * kBorderPx
                        : static_cast<float>(plan.unwrapping_levels.front().period_px) - length;
  const float border = std::min(kBorderPx, gap / 2);
#pragma GCC ivdep
  for (int i = 0; i < width; ++i) {
    const float coordinate = absolute->turns[i] * period - 0.5f;
    const int32_t valid = absolute->valid[i] & (absolute->failure[i] <= plan.max_order_failure) &
                          (coordinate >= -0.5f - border) & (coordinate < length - 0.5f + border);
    out.coordinate[i] = valid ? coordinate : kNaN;
    out.confidence[i] = valid ? 1 - absolute->failure[i] : kNaN;
    out.order[i] = valid ? static_cast<int32_t>(absolute->order[i]) : -1;
  }
}

FRINGESLAM_INLINE void decode_row_body(const RowPlan& plan, int width, RowScratch& scratch, const RowOutput& out) {
  const size_t groups_count = plan.groups.size(), stride = static_cast<size_t>(width);
  scratch.floats.resize((4 * groups_count + 5) * stride);
  scratch.masks.resize((groups_count + 1) * stride);
  float* free_floats = scratch.floats.data();
  const auto take = [&] { return std::exchange(free_floats, free_floats + stride); };

  PhaseRow groups[kMaxGroups];
  for (size_t g = 0; g < groups_count; ++g) {
    groups[g] = {take(), take(), take(), take(), scratch.masks.data() + g * stride};
    const StepEstimator& estimator = plan.groups[g];
    if (!scratch.drift_px.empty())
      phase_in_motion(plan, estimator, scratch, width, groups[g]);
    else if (!scratch.variances.empty())
      phase_of_weighted(plan, estimator, scratch, width, groups[g]);
    else if (estimator.images.size() == 3)
      phase_of_three(plan, estimator, scratch.samples.data(), width, groups[g]);
    else
      phase_of_many(plan, estimator, scratch.samples.data(), width, groups[g]);
    if (!estimator.correction_turns.empty()) correct_phase(estimator.correction_turns, width, groups[g].turns);
    if (estimator.error_turns2 > 0) {
#pragma GCC ivdep
      for (int i = 0; i < width; ++i) {
        groups[g].variance[i] += estimator.error_turns2;
        groups[g].valid[i] &= groups[g].variance[i] <= plan.max_sigma_turns * plan.max_sigma_turns;
      }
    }
  }
  const PhaseRow& finest = groups[groups_count - 1];

#pragma GCC ivdep
  for (int i = 0; i < width; ++i) out.mean[i] = groups[0].mean[i];
  for (size_t g = 1; g < groups_count; ++g) {
#pragma GCC ivdep
    for (int i = 0; i < width; ++i) out.mean[i] += groups[g].mean[i];
  }
#pragma GCC ivdep
  for (int i = 0; i < width; ++i) out.mean[i] *= 1 / static_cast<float>(groups_count);

  const AbsoluteRow absolute{take(), take(), take(), scratch.masks.data() + groups_count * stride};
#pragma GCC ivdep
  for (int i = 0; i < width; ++i) absolute.valid[i] = finest.valid[i];
  if (plan.anchored) {
    order_from_prior(scratch.anchor, plan.max_residual_sigma, finest, width, absolute);
  } else if (!plan.unwrapping_levels.empty()) {
    for (size_t g = 0; g + 1 < groups_count; ++g) {
#pragma GCC ivdep
      for (int i = 0; i < width; ++i) absolute.valid[i] &= groups[g].valid[i];
    }
    float* phase = take();
    float* variance = take();
    float weights[kMaxGroups];
    for (size_t r = 0; r < plan.unwrapping_levels.size(); ++r) {
      const UnwrappingLevel& rung = plan.unwrapping_levels[r];
      const auto ratio = static_cast<float>(r == 0 ? 0 : plan.unwrapping_levels[r - 1].period_px / rung.period_px);
      for (size_t g = 0; g < groups_count; ++g) {
        const auto coarser = static_cast<float>(r == 0 ? 0 : plan.unwrapping_levels[r - 1].multiples[g]);
        weights[g] = ratio * coarser - static_cast<float>(rung.multiples[g]);
      }
      level_phase(rung, groups, width, phase);
      combined_variance(weights, groups_count, groups, width, variance);
      const auto gap_turns = static_cast<float>(1 - plan.length_px / rung.period_px);
      if (r == 0)
        unwrap_coarsest_level(-0.5f * gap_turns, phase, variance, width, absolute);
      else
        unwrap_level(ratio, plan.max_residual_sigma, phase, variance, width, absolute);
    }
  }
  const bool has_absolute = plan.anchored || !plan.unwrapping_levels.empty();
  write_row(plan, finest, finest.valid, has_absolute ? &absolute : nullptr, width, out);
}

}  // namespace

void decode_row(const RowPlan& plan, int width, RowScratch& scratch, const RowOutput& out, InstructionSet set) {
  Variants<decode_row_body>::of(set)(plan, width, scratch, out);
}

}  // namespace fringeslam
