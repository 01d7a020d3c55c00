// SPDX-License-Identifier: Apache-2.0
#include "core/decode/spatial.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <numbers>

namespace fringeslam {

namespace {

constexpr float kTurn = 2 * std::numbers::pi_v<float>;

// Difference of the orders of neighbours: phase_b + 2 pi k lies within half a turn of phase_a.
inline int order_step(float phase_a, float phase_b) {
  const float difference = phase_a - phase_b;
  return difference > 0.5f * kTurn ? 1 : difference < -0.5f * kTurn ? -1 : 0;
}

inline bool joined(float phase_a, float phase_b, float max_step) {
  const float step = phase_a - phase_b - kTurn * static_cast<float>(order_step(phase_a, phase_b));
  return std::abs(step) <= max_step;  // false for NaN
}

// A key that grows with a positive float, a few per cent a step: exponent and three bits of the mantissa.
inline unsigned log_key(float value) {
  uint32_t bits;
  std::memcpy(&bits, &value, sizeof bits);
  return bits >> 20;
}
constexpr size_t kKeys = 2048;

// Components are numbered by their first pixel in reading order, whatever order the joints were made in.
void number_components(SpatialOrders& orders) {
  std::vector<int> number(orders.component.total(), -1);
  for (int& component : orders.component) {
    if (component < 0) continue;
    int& n = number[static_cast<size_t>(component)];
    if (n < 0) n = orders.components++;
    component = n;
  }
}

// Indices sorted by key, smallest first, those of equal keys in their own order.
std::vector<int> counting_sort(const std::vector<uint16_t>& keys) {
  std::vector<int> start(kKeys + 1, 0);
  for (const uint16_t key : keys) ++start[key + 1U];
  for (size_t k = 0; k < kKeys; ++k) start[k + 1] += start[k];
  std::vector<int> sorted(keys.size());
  for (size_t i = 0; i < keys.size(); ++i) sorted[static_cast<size_t>(start[keys[i]]++)] = static_cast<int>(i);
  return sorted;
}

}  // namespace

SpatialOrders unwrap_by_quality(const cv::Mat1f& wrapped_phase, const cv::Mat1f& sigma, double max_step_rad) {
  const int rows = wrapped_phase.rows, cols = wrapped_phase.cols, total = rows * cols;
  const auto max_step = static_cast<float>(max_step_rad);
  SpatialOrders orders{cv::Mat1i(wrapped_phase.size(), 0), cv::Mat1i(wrapped_phase.size(), -1), 0};
  const float* phase = wrapped_phase[0];
  const float* spread = sigma[0];
  int* order = orders.order[0];
  int* component = orders.component[0];

  // Seeds and rim both go by sigma, a bucket a key. The rim of one component is empty before the next is begun.
  std::vector<uint16_t> keys(static_cast<size_t>(total));
  for (int i = 0; i < total; ++i)
    keys[static_cast<size_t>(i)] = static_cast<uint16_t>(log_key(spread[i]) & (kKeys - 1));
  const std::vector<int> seeds = counting_sort(keys);
  std::array<std::vector<int>, kKeys> rim;
  for (const int seed : seeds) {
    if (component[seed] >= 0 || std::isnan(phase[seed])) continue;
    component[seed] = seed;
    size_t best = keys[static_cast<size_t>(seed)];
    rim[best].push_back(seed);
    int waiting = 1;
    while (waiting > 0) {
      while (rim[best].empty()) ++best;
      const int pixel = rim[best].back();
      rim[best].pop_back();
      --waiting;
      const int col = pixel % cols;
      const auto visit = [&](int neighbour) {
        if (component[neighbour] >= 0 || !joined(phase[pixel], phase[neighbour], max_step)) return;
        component[neighbour] = seed;
        order[neighbour] = order[pixel] + order_step(phase[pixel], phase[neighbour]);
        const size_t key = keys[static_cast<size_t>(neighbour)];
        rim[key].push_back(neighbour);
        best = std::min(best, key);
        ++waiting;
      };
      if (col > 0) visit(pixel - 1);
      if (col + 1 < cols) visit(pixel + 1);
      if (pixel >= cols) visit(pixel - cols);
      if (pixel + cols < total) visit(pixel + cols);
    }
  }
  number_components(orders);
  return orders;
}

namespace {

// Sum of the squared second differences of the phase over the four lines through a pixel (Herraez eq. 1-3), as a key:
// the smaller the more reliable. Pixels without eight neighbours are the least reliable.
std::vector<uint16_t> unreliability(const cv::Mat1f& phase) {
  std::vector<uint16_t> keys(phase.total(), kKeys / 2 - 1);
  const auto wrap = [](float x) { return x > 0.5f * kTurn ? x - kTurn : x < -0.5f * kTurn ? x + kTurn : x; };
  cv::parallel_for_(cv::Range(1, phase.rows - 1), [&](const cv::Range& range) {
    for (int row = range.start; row < range.end; ++row) {
      const float *above = phase[row - 1], *here = phase[row], *below = phase[row + 1];
      for (int col = 1; col + 1 < phase.cols; ++col) {
        const auto second = [&](float a, float b) {
          const float d = wrap(a - here[col]) - wrap(here[col] - b);
          return d * d;
        };
        const float sum = second(here[col - 1], here[col + 1]) + second(above[col], below[col]) +
                          second(above[col - 1], below[col + 1]) + second(above[col + 1], below[col - 1]);
        // From 2^-24 to 2^8 in steps of an eighth of an octave.
        if (!std::isnan(sum))
          keys[static_cast<size_t>(row * phase.cols + col)] = static_cast<uint16_t>(
              std::clamp<int>(static_cast<int>(log_key(sum)) - 8 * (127 - 24), 0, static_cast<int>(kKeys) / 2 - 2));
      }
    }
  });
  return keys;
}

// Union-find whose nodes carry their order relative to their parent.
class OrderForest {
 public:
  explicit OrderForest(int size)
      : parent_(static_cast<size_t>(size)), offset_(parent_.size(), 0), size_(parent_.size(), 1) {
    for (int i = 0; i < size; ++i) parent_[static_cast<size_t>(i)] = i;
  }

  struct Place {
    int root, order;
  };
  // Halves the path on the way.
  Place find(int node) {
    int order = 0;
    while (true) {
      const auto n = static_cast<size_t>(node);
      const int up = parent_[n];
      if (up == node) return {node, order};
      const auto u = static_cast<size_t>(up);
      if (parent_[u] != up) {
        offset_[n] += offset_[u];
        parent_[n] = parent_[u];
      }
      order += offset_[n];
      node = parent_[n];
    }
  }

  // order(b) = order(a) + step from now on, unless the two are joined already.
  void join(int a, int b, int step) {
    const Place pa = find(a), pb = find(b);
    if (pa.root == pb.root) return;
    // order of b's root relative to a's: order(a) + step - order(b).
    const int shift = pa.order + step - pb.order;
    const auto ra = static_cast<size_t>(pa.root), rb = static_cast<size_t>(pb.root);
    if (size_[ra] >= size_[rb]) {
      parent_[rb] = pa.root, offset_[rb] = shift, size_[ra] += size_[rb];
    } else {
      parent_[ra] = pb.root, offset_[ra] = -shift, size_[rb] += size_[ra];
    }
  }

 private:
  std::vector<int> parent_, offset_, size_;
};

}  // namespace

SpatialOrders unwrap_by_reliability(const cv::Mat1f& wrapped_phase, double max_step_rad) {
  const int rows = wrapped_phase.rows, cols = wrapped_phase.cols, total = rows * cols;
  const auto max_step = static_cast<float>(max_step_rad);
  const float* phase = wrapped_phase[0];
  const std::vector<uint16_t> pixel_keys = unreliability(wrapped_phase);

  // Joint 2 i goes from pixel i to the right, 2 i + 1 down.
  std::vector<uint16_t> keys;
  std::vector<int> joints;
  keys.reserve(2 * pixel_keys.size());
  joints.reserve(2 * pixel_keys.size());
  for (int i = 0; i < total; ++i) {
    const auto add = [&](int joint, int neighbour) {
      if (!joined(phase[i], phase[neighbour], max_step)) return;
      joints.push_back(joint);
      keys.push_back(
          static_cast<uint16_t>(pixel_keys[static_cast<size_t>(i)] + pixel_keys[static_cast<size_t>(neighbour)]));
    };
    if (i % cols + 1 < cols) add(2 * i, i + 1);
    if (i + cols < total) add(2 * i + 1, i + cols);
  }
  OrderForest forest(total);
  for (const int index : counting_sort(keys)) {
    const int joint = joints[static_cast<size_t>(index)], a = joint / 2, b = joint % 2 == 0 ? a + 1 : a + cols;
    forest.join(a, b, order_step(phase[a], phase[b]));
  }

  SpatialOrders orders{cv::Mat1i(wrapped_phase.size(), 0), cv::Mat1i(wrapped_phase.size(), -1), 0};
  for (int i = 0; i < total; ++i) {
    if (std::isnan(phase[i])) continue;
    const OrderForest::Place place = forest.find(i);
    orders.order[0][i] = place.order;
    orders.component[0][i] = place.root;
  }
  number_components(orders);
  return orders;
}

std::vector<ComponentOrder> vote(const SpatialOrders& orders, const cv::Mat1i& reference, double min_agreement) {
  struct Tally {
    int shift = 0, count = 0;
  };
  const auto size = static_cast<size_t>(orders.components);
  std::vector<std::vector<Tally>> tallies(size);
  std::vector<ComponentOrder> result(size);
  for (int row = 0; row < orders.order.rows; ++row) {
    for (int col = 0; col < orders.order.cols; ++col) {
      const int component = orders.component(row, col);
      if (component < 0) continue;
      ++result[static_cast<size_t>(component)].summary.pixels;
      if (reference(row, col) < 0) continue;
      std::vector<Tally>& tally = tallies[static_cast<size_t>(component)];
      const int shift = reference(row, col) - orders.order(row, col);
      auto entry = std::find_if(tally.begin(), tally.end(), [&](const Tally& t) { return t.shift == shift; });
      if (entry == tally.end()) entry = tally.insert(tally.end(), Tally{shift});
      ++entry->count;
    }
  }
  for (size_t c = 0; c < size; ++c) {
    PhaseComponent& summary = result[c].summary;
    Tally best;
    for (const Tally& tally : tallies[c]) {
      summary.votes += tally.count;
      if (tally.count > best.count) best = tally;
    }
    if (summary.votes == 0) continue;
    result[c].shift = best.shift;
    summary.agreement = static_cast<double>(best.count) / summary.votes;
    summary.absolute = summary.agreement >= min_agreement;
  }
  return result;
}

}  // namespace fringeslam
