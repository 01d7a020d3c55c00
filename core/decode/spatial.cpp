// SPDX-License-Identifier: Apache-2.0
#include "core/decode/spatial.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <numbers>

#include "core/base/constants.h"
#include "core/base/parallel.h"

namespace fringeslam {

namespace {

// A joint of two neighbours stores the order of the second minus that of the first, -1, 0 or 1; kCut: not joined.
constexpr int8_t kCut = 2;

struct Joints {
  std::vector<int8_t> right, down;  // from each pixel; kCut at the image border
};

inline int8_t joint(float phase_a, float phase_b, float max_step) {
  const float difference = phase_a - phase_b;
  const int step = (difference > 0.5f * kTwoPiFloat) - (difference < -0.5f * kTwoPiFloat);
  const bool near = std::abs(difference - kTwoPiFloat * static_cast<float>(step)) <= max_step;  // false for NaN
  return near ? static_cast<int8_t>(step) : kCut;
}

Joints make_joints(const cv::Mat1f& phase, double max_step_rad) {
  const auto max_step = static_cast<float>(max_step_rad);
  Joints joints{std::vector<int8_t>(phase.total(), kCut), std::vector<int8_t>(phase.total(), kCut)};
  for_each_row(phase.rows, [&](int row) {
    const float* here = phase[row];
    int8_t* right = joints.right.data() + static_cast<ptrdiff_t>(row) * phase.cols;
    for (int col = 0; col + 1 < phase.cols; ++col) right[col] = joint(here[col], here[col + 1], max_step);
    if (row + 1 == phase.rows) return;
    const float* below = phase[row + 1];
    int8_t* down = joints.down.data() + static_cast<ptrdiff_t>(row) * phase.cols;
    for (int col = 0; col < phase.cols; ++col) down[col] = joint(here[col], below[col], max_step);
  });
  return joints;
}

// Marks components without a pixel of known order.
constexpr int kUnknown = std::numeric_limits<int>::min();

// Returns the known order of a pixel, or -1.
struct Reference {
  const int* known;
  explicit Reference(const cv::Mat1i& reference) : known(reference.empty() ? nullptr : reference[0]) {}
  int operator()(int pixel) const { return known ? known[pixel] : -1; }
};

// Monotonic key of a positive float with steps of an eighth of an octave: exponent and three bits of the mantissa.
inline unsigned log_key(float value) {
  uint32_t bits;
  std::memcpy(&bits, &value, sizeof bits);
  return bits >> 20;
}
constexpr size_t kKeys = 2048;

// Renumbers components by their first pixel in reading order, independent of the order in which they were formed.
void number_components(SpatialOrders& orders) {
  std::vector<int> number(orders.component.total(), -1);
  for (int& component : orders.component) {
    if (component < 0) continue;
    int& n = number[static_cast<size_t>(component)];
    if (n < 0) n = orders.components++;
    component = n;
  }
}

// Returns indices sorted by key in ascending order (stable).
std::vector<int> counting_sort(const std::vector<uint16_t>& keys) {
  std::vector<int> start(kKeys + 1, 0);
  for (const uint16_t key : keys) ++start[key + 1U];
  for (size_t k = 0; k < kKeys; ++k) start[k + 1] += start[k];
  std::vector<int> sorted(keys.size());
  for (size_t i = 0; i < keys.size(); ++i) sorted[static_cast<size_t>(start[keys[i]]++)] = static_cast<int>(i);
  return sorted;
}

}  // namespace

SpatialOrders unwrap_by_quality(const cv::Mat1f& wrapped_phase, const cv::Mat1f& sigma, double max_step_rad,
                                const cv::Mat1i& reference) {
  const int cols = wrapped_phase.cols, total = static_cast<int>(wrapped_phase.total());
  const Joints joints = make_joints(wrapped_phase, max_step_rad);
  SpatialOrders orders{cv::Mat1i(wrapped_phase.size(), 0), cv::Mat1i(wrapped_phase.size(), -1), 0};
  const float* phase = wrapped_phase[0];
  int* order = orders.order[0];
  int* component = orders.component[0];
  const Reference known(reference);

  // Seeds and the flood boundary are ordered by sigma, one bucket per key. The boundary of one component is empty
  // before the next component starts.
  std::vector<uint16_t> keys(wrapped_phase.total());
  for (int i = 0; i < total; ++i) keys[static_cast<size_t>(i)] = static_cast<uint16_t>(log_key(sigma[0][i]) % kKeys);
  const std::vector<int> seeds = counting_sort(keys);
  // Each bucket is a linked list through `next`, last in, first out.
  std::vector<int> rim(kKeys, -1), next(wrapped_phase.total());
  const auto push = [&](size_t key, int pixel) {
    next[static_cast<size_t>(pixel)] = rim[key];
    rim[key] = pixel;
  };
  for (const int seed : seeds) {
    if (component[seed] >= 0 || std::isnan(phase[seed])) continue;
    component[seed] = seed;
    int shift = known(seed) >= 0 ? known(seed) : kUnknown;
    size_t best = keys[static_cast<size_t>(seed)];
    push(best, seed);
    for (int waiting = 1; waiting > 0; --waiting) {
      while (rim[best] < 0) ++best;
      const int pixel = rim[best];
      rim[best] = next[static_cast<size_t>(pixel)];
      const int own = order[pixel];
      const auto visit = [&](int neighbour, int step) {
        if (component[neighbour] >= 0) return;
        if (known(neighbour) >= 0) {
          const int says = known(neighbour) - own - step;
          if (shift == kUnknown) shift = says;
          if (says != shift) return;
        }
        component[neighbour] = seed;
        order[neighbour] = own + step;
        const size_t key = keys[static_cast<size_t>(neighbour)];
        push(key, neighbour);
        best = std::min(best, key);
        ++waiting;
      };
      const auto p = static_cast<size_t>(pixel), c = static_cast<size_t>(cols);
      if (joints.right[p] != kCut) visit(pixel + 1, joints.right[p]);
      if (joints.down[p] != kCut) visit(pixel + cols, joints.down[p]);
      if (p >= 1 && joints.right[p - 1] != kCut) visit(pixel - 1, -joints.right[p - 1]);
      if (p >= c && joints.down[p - c] != kCut) visit(pixel - cols, -joints.down[p - c]);
    }
  }
  number_components(orders);
  return orders;
}

namespace {

// Sum of the squared second differences of the phase along the four lines through a pixel (Herraez eq. 1-3), as a key:
// smaller is more reliable. Pixels without eight neighbours are least reliable.
std::vector<uint16_t> unreliability(const cv::Mat1f& phase) {
  std::vector<uint16_t> keys(phase.total(), kKeys / 2 - 1);
  const auto wrap = [](float x) {
    return x > 0.5f * kTwoPiFloat ? x - kTwoPiFloat : x < -0.5f * kTwoPiFloat ? x + kTwoPiFloat : x;
  };
  for_each_row(phase.rows - 2, [&](int inner) {
    const int row = inner + 1;
    const float *above = phase[row - 1], *here = phase[row], *below = phase[row + 1];
    for (int col = 1; col + 1 < phase.cols; ++col) {
      const auto second = [&](float a, float b) {
        const float d = wrap(a - here[col]) - wrap(here[col] - b);
        return d * d;
      };
      const float sum = second(here[col - 1], here[col + 1]) + second(above[col], below[col]) +
                        second(above[col - 1], below[col + 1]) + second(above[col + 1], below[col - 1]);
      // From 2^-24 to 2^8 in steps of 1/8 octave.
      if (!std::isnan(sum))
        keys[static_cast<size_t>(row * phase.cols + col)] = static_cast<uint16_t>(
            std::clamp<int>(static_cast<int>(log_key(sum)) - 8 * (127 - 24), 0, static_cast<int>(kKeys) / 2 - 2));
    }
  });
  return keys;
}

// Union-find. Nodes store their order relative to their parent; roots store the known absolute order offset.
class OrderForest {
 public:
  OrderForest(int size, const Reference& known) : nodes_(static_cast<size_t>(size)), roots_(nodes_.size()) {
    for (int i = 0; i < size; ++i) {
      nodes_[static_cast<size_t>(i)].parent = i;
      if (known(i) >= 0) roots_[static_cast<size_t>(i)].shift = known(i);
    }
  }

  struct Place {
    int root, order;
  };
  // Finds the root with path halving.
  Place find(int node) {
    int order = 0;
    while (true) {
      Node& n = nodes_[static_cast<size_t>(node)];
      if (n.parent == node) return {node, order};
      const Node& up = nodes_[static_cast<size_t>(n.parent)];
      if (up.parent != n.parent) {
        n.offset += up.offset;
        n.parent = up.parent;
      }
      order += n.offset;
      node = n.parent;
    }
  }

  // Joins with order(b) = order(a) + step, unless a and b are already joined or their known orders contradict it.
  void join(int a, int b, int step) {
    const Place pa = find(a), pb = find(b);
    if (pa.root == pb.root) return;
    Root &ra = roots_[static_cast<size_t>(pa.root)], &rb = roots_[static_cast<size_t>(pb.root)];
    // Order of b's root relative to a's root.
    const int offset = pa.order + step - pb.order;
    if (ra.shift != kUnknown && rb.shift != kUnknown && rb.shift != ra.shift + offset) return;
    if (ra.size >= rb.size) {
      nodes_[static_cast<size_t>(pb.root)] = {pa.root, offset};
      ra.size += rb.size;
      if (ra.shift == kUnknown && rb.shift != kUnknown) ra.shift = rb.shift - offset;
    } else {
      nodes_[static_cast<size_t>(pa.root)] = {pb.root, -offset};
      rb.size += ra.size;
      if (rb.shift == kUnknown && ra.shift != kUnknown) rb.shift = ra.shift + offset;
    }
  }

 private:
  struct Node {
    int parent = 0, offset = 0;
  };
  struct Root {
    int size = 1, shift = kUnknown;
  };
  std::vector<Node> nodes_;
  std::vector<Root> roots_;
};

}  // namespace

SpatialOrders unwrap_by_reliability(const cv::Mat1f& wrapped_phase, double max_step_rad, const cv::Mat1i& reference) {
  const int cols = wrapped_phase.cols, total = static_cast<int>(wrapped_phase.total());
  const Joints joints = make_joints(wrapped_phase, max_step_rad);
  const std::vector<uint16_t> pixel_keys = unreliability(wrapped_phase);

  // Joint 2 i connects pixel i to its right neighbour, 2 i + 1 to the one below.
  std::vector<uint16_t> keys;
  std::vector<int> indices;
  keys.reserve(2 * pixel_keys.size());
  indices.reserve(2 * pixel_keys.size());
  for (size_t i = 0; i < pixel_keys.size(); ++i) {
    const auto add = [&](size_t index, size_t neighbour) {
      indices.push_back(static_cast<int>(index));
      keys.push_back(static_cast<uint16_t>(pixel_keys[i] + pixel_keys[neighbour]));
    };
    if (joints.right[i] != kCut) add(2 * i, i + 1);
    if (joints.down[i] != kCut) add(2 * i + 1, i + static_cast<size_t>(cols));
  }
  OrderForest forest(total, Reference(reference));
  for (const int sorted : counting_sort(keys)) {
    const int index = indices[static_cast<size_t>(sorted)], a = index / 2;
    const auto pixel = static_cast<size_t>(a);
    if (index % 2 == 0)
      forest.join(a, a + 1, joints.right[pixel]);
    else
      forest.join(a, a + cols, joints.down[pixel]);
  }

  SpatialOrders orders{cv::Mat1i(wrapped_phase.size(), 0), cv::Mat1i(wrapped_phase.size(), -1), 0};
  for (int i = 0; i < total; ++i) {
    if (std::isnan(wrapped_phase[0][i])) continue;
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
