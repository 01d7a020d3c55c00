// SPDX-License-Identifier: Apache-2.0
#include "core/decode/ensemble.h"

#include <algorithm>
#include <cmath>

#include "core/base/constants.h"
#include "core/base/parallel.h"
#include "core/types/error.h"

namespace fringeslam {

namespace {

// The coordinate of a member at one pixel.
struct Vote {
  float coordinate_px = 0, sigma_px = 0;
  size_t member = 0;
};

// The most accurate of the largest group of votes that agree with it, and by how much they exceed their noise.
struct Verdict {
  size_t vote = 0;
  int agreeing = 0;
  float excess_px = 0;
};

class Jury {
 public:
  Jury(float most_sigmas, float tolerance_px) : most_sigmas_(most_sigmas), tolerance_px_(tolerance_px) {}

  // Orders the votes by accuracy. No votes agree if the verdict's `agreeing` is less than two.
  Verdict decide(std::vector<Vote>& votes) const {
    std::sort(votes.begin(), votes.end(), [](const Vote& a, const Vote& b) {
      return a.sigma_px != b.sigma_px ? a.sigma_px < b.sigma_px : a.member < b.member;
    });
    Verdict best;
    bool contradicted = false;
    for (size_t i = 0; i < votes.size(); ++i) {
      Verdict verdict{i, 0, 0};
      for (const Vote& other : votes) {
        if (!agree(votes[i], other)) continue;
        ++verdict.agreeing;
        constexpr float kNoise_sigmas = 3;
        const float difference = std::abs(votes[i].coordinate_px - other.coordinate_px),
                    noise = kNoise_sigmas * std::hypot(votes[i].sigma_px, other.sigma_px);
        verdict.excess_px = std::max(verdict.excess_px, difference - noise);
      }
      if (verdict.agreeing > best.agreeing) {
        best = verdict;
        contradicted = false;
      } else if (verdict.agreeing == best.agreeing && !agree(votes[i], votes[best.vote])) {
        contradicted = true;
      }
    }
    if (contradicted) best.agreeing = 0;
    return best;
  }

 private:
  bool agree(const Vote& a, const Vote& b) const {
    return std::abs(a.coordinate_px - b.coordinate_px) <=
           std::max(tolerance_px_, most_sigmas_ * std::hypot(a.sigma_px, b.sigma_px));
  }

  float most_sigmas_, tolerance_px_;
};

}  // namespace

std::vector<EnsembleMember> possible_members(const PatternSequence& sequence, Axis axis) {
  const size_t count = sequence.patterns.size();
  const auto with = [&](Unwrapping method, auto&& uses) {
    EnsembleMember member{method, std::vector<bool>(count)};
    for (size_t i = 0; i < count; ++i) {
      const Pattern& pattern = sequence.patterns[i];
      member.images[i] = pattern.coding == Coding::flat || (pattern.axis == axis && uses(pattern, i));
    }
    return member;
  };
  const auto of_codings = [&](Unwrapping method, Coding one, Coding other) {
    return with(method, [=](const Pattern& p, size_t) { return p.coding == one || p.coding == other; });
  };
  std::vector<EnsembleMember> members = {
      of_codings(Unwrapping::micro, Coding::fringe, Coding::extra),
      of_codings(Unwrapping::modulated, Coding::fringe, Coding::product),
      of_codings(Unwrapping::multifrequency, Coding::fringe, Coding::fringe),
      of_codings(Unwrapping::heterodyne, Coding::fringe, Coding::fringe),
  };
  for (const std::vector<GrayBit>& code : gray_codes(sequence, axis)) {
    members.push_back(with(Unwrapping::gray, [&](const Pattern& p, size_t i) {
      const auto index = static_cast<int>(i);
      return p.coding == Coding::fringe || std::any_of(code.begin(), code.end(), [&](const GrayBit& bit) {
               return bit.image == index || bit.inverted_image == index;
             });
    }));
  }
  return members;
}

DecodedStack agreement_of(const std::vector<DecodedStack>& members, double most_sigmas) {
  const DecodedStack& first = members.front();
  DecodedStack out = first;
  for (cv::Mat1f* image :
       {&out.mean, &out.modulation, &out.wrapped_phase, &out.coordinate_px, &out.sigma_px, &out.confidence})
    *image = image->clone();
  out.fringe_order = out.fringe_order.clone();
  out.unwrapping = Unwrapping::ensemble;
  const Jury jury(static_cast<float>(most_sigmas), static_cast<float>(0.25 * first.finest_period_px));
  const auto period = static_cast<float>(first.finest_period_px);
  for_each_range(first.mean.rows, [&](int begin, int end) {
    std::vector<Vote> votes;
    for (int row = begin; row < end; ++row) {
      for (int col = 0; col < first.mean.cols; ++col) {
        votes.clear();
        for (size_t m = 0; m < members.size(); ++m) {
          if (members[m].fringe_order(row, col) >= 0)
            votes.push_back({members[m].coordinate_px(row, col), members[m].sigma_px(row, col), m});
        }
        const Verdict verdict = jury.decide(votes);
        if (verdict.agreeing < 2) {
          out.coordinate_px(row, col) = out.confidence(row, col) = kNaN;
          out.fringe_order(row, col) = -1;
          continue;
        }
        const Vote& vote = votes[verdict.vote];
        const DecodedStack& chosen = members[vote.member];
        out.coordinate_px(row, col) = vote.coordinate_px;
        out.confidence(row, col) = chosen.confidence(row, col);
        out.fringe_order(row, col) = chosen.fringe_order(row, col);
        if (vote.member != 0) {
          out.mean(row, col) = chosen.mean(row, col);
          out.modulation(row, col) = chosen.modulation(row, col);
          out.wrapped_phase(row, col) = chosen.wrapped_phase(row, col);
        }
        if (period > 0 && chosen.finest_period_px != first.finest_period_px) {
          const float turns = (vote.coordinate_px + 0.5f) / period, order = std::floor(turns + 0.5f);
          out.wrapped_phase(row, col) = static_cast<float>(kTwoPi) * (turns - order);
          out.fringe_order(row, col) = std::max(0, static_cast<int>(order));
        }
        out.sigma_px(row, col) = std::hypot(vote.sigma_px, verdict.excess_px);
      }
    }
  });
  return out;
}

}  // namespace fringeslam
