// SPDX-License-Identifier: Apache-2.0
#include "core/landmarks/descriptor_tree.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "core/base/parallel.h"
#include "core/types/error.h"
#include "core/types/selected_instruction_set.h"

namespace fringeslam {

namespace {

constexpr int kLeafSize = 8;
constexpr int kSampled = 128;     // descriptors sampled per node to compute variances
constexpr int kParallel = 16384;  // descriptors from which children are built in parallel

FRINGESLAM_INLINE int distance_body(const uchar* a, const uchar* b) {
  int sum = 0;
  for (int i = 0; i < kDescriptorSize; ++i) {
    const int difference = static_cast<int>(a[i]) - static_cast<int>(b[i]);
    sum += difference * difference;
  }
  return sum;
}

constexpr size_t kDimensions = kDescriptorSize;

// Adds up each dimension of `count` descriptors, fewer than 256, and its squares. All sums fit in their types.
FRINGESLAM_INLINE void moments_body(const uchar* const* descriptors, int count, uint16_t* __restrict sums,
                                    uint32_t* __restrict squares) {
  for (int i = 0; i < count; ++i) {
    const uchar* d = descriptors[i];
    for (size_t k = 0; k < kDimensions; ++k) {
      const uint16_t value = d[k];
      sums[k] = static_cast<uint16_t>(sums[k] + value);
      squares[k] += static_cast<uint16_t>(value * value);
    }
  }
}

// Returns the dimension of largest variance among [first, last), and its mean.
std::pair<int, int> split_of(const cv::Mat1b& descriptors, const std::vector<int>& order, int first, int last) {
  static const auto moments = Variants<moments_body>::of(selected_instruction_set());
  const int step = std::max(1, (last - first) / kSampled);
  std::array<const uchar*, 2 * kSampled> sampled;
  int count = 0;
  for (int i = first; i < last; i += step)
    sampled[static_cast<size_t>(count++)] = descriptors[order[static_cast<size_t>(i)]];
  std::array<uint16_t, kDimensions> sums{};
  std::array<uint32_t, kDimensions> squares{};
  moments(sampled.data(), count, sums.data(), squares.data());
  size_t best = 0;
  int64_t best_spread = -1;
  for (size_t k = 0; k < kDimensions; ++k) {
    const int64_t spread = int64_t{count} * squares[k] - int64_t{sums[k]} * sums[k];
    if (spread > best_spread) best_spread = spread, best = k;
  }
  return {static_cast<int>(best), (sums[best] + count - 1) / count};
}

}  // namespace

cv::Mat1b quantised(const cv::Mat1f& descriptors) {
  cv::Mat1b bytes;
  descriptors.convertTo(bytes, CV_8U, 510);
  return bytes;
}

int squared_distance(const uchar* a, const uchar* b) {
  static const auto distance = Variants<distance_body>::of(selected_instruction_set());
  return distance(a, b);
}

DescriptorTree::DescriptorTree(const cv::Mat1b& descriptors) {
  if (descriptors.empty()) return;
  if (descriptors.cols != kDescriptorSize) throw Error("descriptors: must have 128 values each");
  std::vector<int> order(static_cast<size_t>(descriptors.rows));
  std::iota(order.begin(), order.end(), 0);
  nodes_.push_back({-1, 0, 0, 0, descriptors.rows});
  build(nodes_, 0, order, descriptors);
  descriptors_.create(descriptors.rows, kDescriptorSize);
  for_each_row(descriptors.rows, [&](int i) {
    std::copy_n(descriptors[order[static_cast<size_t>(i)]], kDescriptorSize, descriptors_[i]);
  });
  index_ = std::move(order);
}

// The nodes have the same order whether the children are built in parallel or one after the other.
void DescriptorTree::build(std::vector<Node>& nodes, int node, std::vector<int>& order, const cv::Mat1b& descriptors) {
  const auto [first, last] = std::pair(nodes[static_cast<size_t>(node)].first, nodes[static_cast<size_t>(node)].last);
  if (last - first <= kLeafSize) return;
  const auto [dimension, split] = split_of(descriptors, order, first, last);
  const auto middle = std::stable_partition(order.begin() + first, order.begin() + last,
                                            [&, d = dimension, s = split](int i) { return descriptors(i, d) < s; });
  const int between = static_cast<int>(middle - order.begin());
  if (between == first || between == last) return;  // all equal in this dimension
  const int child = static_cast<int>(nodes.size());
  nodes[static_cast<size_t>(node)].dimension = dimension;
  nodes[static_cast<size_t>(node)].split = split;
  nodes[static_cast<size_t>(node)].child = child;
  nodes.push_back({-1, 0, 0, first, between});
  nodes.push_back({-1, 0, 0, between, last});
  if (last - first < kParallel) {
    build(nodes, child, order, descriptors);
    build(nodes, child + 1, order, descriptors);
    return;
  }
  std::array<std::vector<Node>, 2> parts;
  for_each_row(2, [&](int i) {
    std::vector<Node>& part = parts[static_cast<size_t>(i)];
    part.push_back(nodes[static_cast<size_t>(child + i)]);
    build(part, 0, order, descriptors);
  });
  for (size_t i = 0; i < parts.size(); ++i) {
    // Node k of the part, except its root, becomes node k + shift.
    const int shift = static_cast<int>(nodes.size()) - 1;
    for (Node& moved : parts[i]) {
      if (moved.dimension >= 0) moved.child += shift;
    }
    nodes[static_cast<size_t>(child) + i] = parts[i].front();
    nodes.insert(nodes.end(), parts[i].begin() + 1, parts[i].end());
  }
}

}  // namespace fringeslam
