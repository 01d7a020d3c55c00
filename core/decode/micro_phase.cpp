// SPDX-License-Identifier: Apache-2.0
#include "core/decode/micro_phase.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/base/constants.h"
#include "core/base/turns.h"
#include "core/patterns/micro_code.h"
#include "core/types/error.h"
#include "core/types/options.h"

namespace fringeslam {

namespace {

using Code = MicroDecoder::Code;

constexpr int kBlock = 64;           // pixels that are processed together
constexpr size_t kMostImages = 16;   // of further periods
constexpr double kWidestBand = 1.5;  // ratio of other periods to the first: indirect light and blur are the same in all
constexpr int kCandidates = 3;       // orders that are compared by their likelihood
// Error of the model relative to the modulation: the lenses blur the periods differently, and the projector has 256 levels.
constexpr float kModelError = 0.005f;

struct Estimates {
  float mean[kBlock], cosine[kBlock], sine[kBlock];  // I', I'' cos phi, I'' sin phi
  float modulation[kBlock], turns[kBlock];           // I'', phi
  bool clipped[kBlock];
};

FRINGESLAM_INLINE void estimate_body(const StepEstimator& e, const float* const* samples, int begin, int count,
                                     Estimates& out) {
  for (int i = 0; i < kBlock; ++i) out.mean[i] = out.cosine[i] = out.sine[i] = 0;
  const float* const first = samples[e.images[0]] + begin;
  for (size_t k = 0; k < e.images.size(); ++k) {
    const float* const grey = samples[e.images[k]] + begin;
    const float wm = e.mean[k], wc = e.cosine[k], ws = e.sine[k];
#pragma GCC ivdep
    for (int i = 0; i < count; ++i) {
      const float difference = grey[i] - first[i];
      out.mean[i] += wm * grey[i];
      out.cosine[i] += wc * difference;
      out.sine[i] += ws * difference;
    }
  }
#pragma GCC ivdep
  for (int i = 0; i < count; ++i) {
    out.modulation[i] = std::sqrt(out.cosine[i] * out.cosine[i] + out.sine[i] * out.sine[i]);
    out.turns[i] = atan2_turns(out.sine[i], out.cosine[i]);
  }
}

struct Candidates {
  float distance[kCandidates][kBlock];  // sum of squared differences from the predicted images, nearest first
  float order[kCandidates][kBlock];
};

// Compares the images of the other periods with what every order predicts, at the phases `turns`.
FRINGESLAM_INLINE void search_body(const Code& code, const float* const* samples, int begin, int count,
                                   const Estimates& pixels, Candidates& best) {
  const size_t images = code.images.size();
  float above[kMostImages][kBlock], cosine[kMostImages][kBlock], sine[kMostImages][kBlock];
  for (size_t f = 0; f < images; ++f) {
    const float* const grey = samples[code.images[f]] + begin;
    const float ratio = code.ratio[f];
#pragma GCC ivdep
    for (int i = 0; i < count; ++i) {
      float c, s;
      cosine_sine(ratio * pixels.turns[i], c, s);
      above[f][i] = grey[i] - pixels.mean[i];
      cosine[f][i] = pixels.modulation[i] * c;
      sine[f][i] = pixels.modulation[i] * s;
    }
  }
  for (int n = 0; n < kCandidates; ++n) {
    for (int i = 0; i < kBlock; ++i) {
      best.distance[n][i] = std::numeric_limits<float>::max();
      best.order[n][i] = 0;
    }
  }
  float distance[kBlock];
  for (int order = 0; order < code.orders; ++order) {
    for (int i = 0; i < kBlock; ++i) distance[i] = 0;
    const auto table = [&](size_t f) { return f * static_cast<size_t>(code.orders) + static_cast<size_t>(order); };
    // Two images at a time: the sums are stored half as often.
    for (size_t f = 0; f + 1 < images; f += 2) {
      const float c0 = code.cosine[table(f)], s0 = code.sine[table(f)], c1 = code.cosine[table(f + 1)],
                  s1 = code.sine[table(f + 1)];
#pragma GCC ivdep
      for (int i = 0; i < count; ++i) {
        const float r0 = above[f][i] - cosine[f][i] * c0 + sine[f][i] * s0,
                    r1 = above[f + 1][i] - cosine[f + 1][i] * c1 + sine[f + 1][i] * s1;
        distance[i] += r0 * r0 + r1 * r1;
      }
    }
    if (images % 2 == 1) {
      const size_t f = images - 1;
      const float c = code.cosine[table(f)], s = code.sine[table(f)];
#pragma GCC ivdep
      for (int i = 0; i < count; ++i) {
        const float residual = above[f][i] - cosine[f][i] * c + sine[f][i] * s;
        distance[i] += residual * residual;
      }
    }
    const auto here = static_cast<float>(order);
#pragma GCC ivdep
    for (int i = 0; i < count; ++i) {
      const float d = distance[i], d0 = best.distance[0][i], d1 = best.distance[1][i], d2 = best.distance[2][i];
      const float k0 = best.order[0][i], k1 = best.order[1][i], k2 = best.order[2][i];
      const bool first = d < d0, second = d < d1, third = d < d2;
      best.distance[2][i] = second ? d1 : (third ? d : d2);
      best.order[2][i] = second ? k1 : (third ? here : k2);
      best.distance[1][i] = first ? d0 : (second ? d : d1);
      best.order[1][i] = first ? k0 : (second ? here : k1);
      best.distance[0][i] = first ? d : d0;
      best.order[0][i] = first ? here : k0;
    }
  }
}

// Fit of I', I'' and phi to all images, for one candidate order.
struct Fit {
  float squares[kBlock];       // sum of squared residuals, sigmas
  float change_turns[kBlock];  // of the phase
  float sigma_ratio[kBlock];   // of the phase, relative to that of the phase steps alone
};

// Sums of the normal equations.
struct Normal {
  float aa[kBlock], ab[kBlock], ap[kBlock], bb[kBlock], bp[kBlock], pp[kBlock], a[kBlock], b[kBlock], p[kBlock],
      squares[kBlock];
};

FRINGESLAM_INLINE float grey_variance(const RowPlan& plan, float grey) {
  const float signal = grey - plan.offset_dn;
  return plan.noise_constant + plan.noise_per_dn * (signal > 0 ? signal : 0);
}

FRINGESLAM_INLINE void add_image(const RowPlan& plan, const float* grey, float ratio, float shift_turns,
                                 float model_error, const float* order, const Estimates& pixels, int count, Normal& n) {
#pragma GCC ivdep
  for (int i = 0; i < count; ++i) {
    float c, s;
    cosine_sine(ratio * (pixels.turns[i] + order[i]) + shift_turns, c, s);
    const float modulation = pixels.modulation[i], wrong = model_error * modulation;
    const float weight = 1 / (grey_variance(plan, grey[i]) + wrong * wrong);
    const float residual = grey[i] - pixels.mean[i] - modulation * c, slope = -ratio * modulation * s;
    n.aa[i] += weight;
    n.ab[i] += weight * c;
    n.ap[i] += weight * slope;
    n.bb[i] += weight * c * c;
    n.bp[i] += weight * c * slope;
    n.pp[i] += weight * slope * slope;
    n.a[i] += weight * residual;
    n.b[i] += weight * c * residual;
    n.p[i] += weight * slope * residual;
    n.squares[i] += weight * residual * residual;
  }
}

// Variance of the phase: the last element of the inverse.
FRINGESLAM_INLINE float phase_variance(const Normal& n, int i) {
  const float cofactor = n.aa[i] * n.bb[i] - n.ab[i] * n.ab[i];
  const float determinant = n.pp[i] * cofactor - n.ap[i] * (n.ap[i] * n.bb[i] - n.ab[i] * n.bp[i]) -
                            n.bp[i] * (n.aa[i] * n.bp[i] - n.ap[i] * n.ab[i]);
  return cofactor / determinant;
}

// The sums of the phase steps, which are the same for all orders, and the variance of the phase that they determine.
struct Steps {
  Normal sums;
  float variance[kBlock];
};

FRINGESLAM_INLINE void steps_body(const RowPlan& plan, const StepEstimator& e, const float* const* samples, int begin,
                                  int count, const Estimates& pixels, Steps& out) {
  Normal& n = out.sums;
  float none[kBlock];
  for (int i = 0; i < kBlock; ++i)
    none[i] = n.aa[i] = n.ab[i] = n.ap[i] = n.bb[i] = n.bp[i] = n.pp[i] = n.a[i] = n.b[i] = n.p[i] = n.squares[i] = 0;
  for (size_t k = 0; k < e.images.size(); ++k)
    add_image(plan, samples[e.images[k]] + begin, 1, e.shift_turns[k], 0, none, pixels, count, n);
#pragma GCC ivdep
  for (int i = 0; i < count; ++i) out.variance[i] = phase_variance(n, i);
}

FRINGESLAM_INLINE void fit_body(const RowPlan& plan, const Code& code, const float* const* samples, int begin,
                                int count, const float* order, const Estimates& pixels, const Steps& steps, Fit& out) {
  Normal n = steps.sums;
  for (size_t f = 0; f < code.images.size(); ++f)
    add_image(plan, samples[code.images[f]] + begin, code.ratio[f], code.shift_turns[f], kModelError, order, pixels,
              count, n);
#pragma GCC ivdep
  for (int i = 0; i < count; ++i) {
    // Schur complement of the phase, and its solution.
    const float inverse = 1 / (n.aa[i] * n.bb[i] - n.ab[i] * n.ab[i]);
    const float ya = inverse * (n.bb[i] * n.ap[i] - n.ab[i] * n.bp[i]),
                yb = inverse * (n.aa[i] * n.bp[i] - n.ab[i] * n.ap[i]);
    const float information = n.pp[i] - ya * n.ap[i] - yb * n.bp[i];
    const float phase = (n.p[i] - ya * n.a[i] - yb * n.b[i]) / information;
    const float a = inverse * (n.bb[i] * n.a[i] - n.ab[i] * n.b[i]) - ya * phase,
                b = inverse * (n.aa[i] * n.b[i] - n.ab[i] * n.a[i]) - yb * phase;
    out.squares[i] = n.squares[i] - a * n.a[i] - b * n.b[i] - phase * n.p[i];
    out.change_turns[i] = phase / kTwoPiFloat;
    out.sigma_ratio[i] = std::sqrt(1 / (information * steps.variance[i]));
  }
}

// Quantile of chi-square that is exceeded as rarely as `sigmas` by a normal variable (Wilson and Hilferty 1931).
float most_squares(int degrees, float sigmas) {
  const float ninth = 2.0f / (9 * static_cast<float>(degrees)), root = 1 - ninth + sigmas * std::sqrt(ninth);
  return static_cast<float>(degrees) * root * root * root;
}

}  // namespace

MicroDecoder::MicroDecoder(const PatternSequence& sequence, Axis axis, const StepEstimator& fringes, int length_px) {
  const auto period_px = static_cast<double>(fringes.period_px);
  code_.fringes = &fringes;
  std::vector<double> periods_px;
  for (size_t i = 0; i < sequence.patterns.size(); ++i) {
    const Pattern& pattern = sequence.patterns[i];
    if (pattern.coding != Coding::extra || pattern.axis != axis) continue;
    if (std::abs(std::log(pattern.period_px / period_px)) > std::log(kWidestBand)) continue;
    code_.images.push_back(static_cast<int>(i));
    code_.ratio.push_back(static_cast<float>(period_px / pattern.period_px));
    code_.shift_turns.push_back(static_cast<float>(pattern.shift_rad / kTwoPi));
    periods_px.push_back(pattern.period_px);
  }
  if (code_.images.size() < 2)
    throw Error("micro phase shifting needs two or more `extra` images of periods similar to that of the fringes, " +
                to_text(period_px) + " px; the sequence has " + std::to_string(code_.images.size()));
  if (code_.images.size() > kMostImages)
    throw Error("micro phase shifting supports at most " + std::to_string(kMostImages) + " `extra` images");
  constexpr double kLeastDistance = 0.01;
  const MicroCodeDistance nearest = micro_code_distance(period_px, periods_px, length_px);
  if (nearest.distance < kLeastDistance)
    throw Error("the `extra` periods do not distinguish projector coordinates " +
                std::to_string(std::lround(nearest.apart * period_px)) +
                " px apart; choose other periods with `fringeslam patterns --micro`");
  code_.orders = micro_orders(period_px, length_px);
  for (size_t f = 0; f < code_.images.size(); ++f) {
    for (int order = 0; order < code_.orders; ++order) {
      const double angle = kTwoPi * (period_px / periods_px[f] * order + static_cast<double>(code_.shift_turns[f]));
      code_.cosine.push_back(static_cast<float>(std::cos(angle)));
      code_.sine.push_back(static_cast<float>(std::sin(angle)));
    }
  }
}

void MicroDecoder::find_orders(const RowPlan& plan, const float* const* samples, int width, InstructionSet set,
                               Row& row) const {
  const auto estimate = Variants<estimate_body>::of(set);
  const auto search = Variants<search_body>::of(set);
  const auto add_steps = Variants<steps_body>::of(set);
  const auto fit = Variants<fit_body>::of(set);
  RowPrior& anchor = *row.anchor;
  row.change_turns.resize(static_cast<size_t>(width));
  row.sigma_ratio.resize(static_cast<size_t>(width));
  const int degrees = static_cast<int>(code_.fringes->images.size() + code_.images.size()) - 3;
  const float limit = most_squares(degrees, plan.max_residual_sigma);
  constexpr float kImpossible = 60;
  Estimates pixels;
  Candidates best;
  Steps steps;
  Fit fits[kCandidates];
  for (int begin = 0; begin < width; begin += kBlock) {
    const int count = std::min(kBlock, width - begin);
    estimate(*code_.fringes, samples, begin, count, pixels);
    for (int i = 0; i < count; ++i) {
      pixels.clipped[i] = false;
      for (const int image : code_.images) pixels.clipped[i] |= samples[image][begin + i] >= plan.clip_dn;
    }
    search(code_, samples, begin, count, pixels, best);
    add_steps(plan, *code_.fringes, samples, begin, count, pixels, steps);
    for (int n = 0; n < kCandidates; ++n)
      fit(plan, code_, samples, begin, count, best.order[n], pixels, steps, fits[n]);
    for (int i = 0; i < count; ++i) {
      const auto at = static_cast<size_t>(begin + i);
      int found = 0;
      for (int n = 1; n < kCandidates; ++n) {
        if (fits[n].squares[i] < fits[found].squares[i]) found = n;
      }
      const float squares = fits[found].squares[i];
      float odds = 0;  // of the other orders
      for (int n = 0; n < kCandidates; ++n) {
        const float farther = fits[n].squares[i] - squares;
        if (n != found && farther < kImpossible) odds += std::exp(-0.5f * farther);
      }
      const bool fitting = squares <= limit && !pixels.clipped[i];
      anchor.turns[at] = fitting ? pixels.turns[i] + best.order[found][i] : kNaN;
      anchor.half_width[at] = 0.25f;
      anchor.sigma[at] = 0;
      anchor.failure[at] = odds / (1 + odds);
      row.change_turns[at] = fits[found].change_turns[i];
      row.sigma_ratio[at] = fits[found].sigma_ratio[i];
    }
  }
}

void MicroDecoder::refine(const RowPlan& plan, int width, const Row& row, const RowOutput& out) const {
  // The correction for a projector's response holds for the phase steps alone.
  if (!code_.fringes->correction_turns.empty()) return;
  const auto period = static_cast<float>(plan.period_px);
  for (int i = 0; i < width; ++i) {
    if (std::isnan(out.coordinate[i])) continue;
    const auto at = static_cast<size_t>(i);
    const float change = row.change_turns[at];
    float turns = out.wrapped_phase[i] / kTwoPiFloat + change;
    const float wraps = std::floor(turns + 0.5f);
    turns -= wraps;
    out.order[i] += static_cast<int32_t>(wraps);
    out.wrapped_phase[i] = turns * kTwoPiFloat;
    out.coordinate[i] += change * period;
    out.sigma[i] *= row.sigma_ratio[at];
  }
}

}  // namespace fringeslam
