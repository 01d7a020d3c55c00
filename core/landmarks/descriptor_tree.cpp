// SPDX-License-Identifier: Apache-2.0
#include "core/landmarks/descriptor_tree.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "core/types/error.h"
#include "core/types/selected_instruction_set.h"

namespace fringeslam {

namespace {

constexpr int kLeafSize = 8;
constexpr int kSampled = 128;  // descriptors sampled per node to compute variances

FRINGESLAM_INLINE int distance_body(const uchar* a, const uchar* b) {
  int sum = 0;
  for (int i = 0; i < kDescriptorSize; ++i) {
    const int difference = static_cast<int>(a[i]) - static_cast<int>(b[i]);
    sum += difference * difference;
  }
  return sum;
}

// Returns the dimension of largest variance among [first, last), and its mean.
std::pair<int, int> split_of(const cv::Mat1b& descriptors, const std::vector<int>& order, int first, int last) {
  const int step = std::max(1, (last - first) / kSampled);
  std::array<int64_t, kDescriptorSize> sums{}, squares{};
  int64_t count = 0;
  for (int i = first; i < last; i += step, ++count) {
    const uchar* d = descriptors[order[static_cast<size_t>(i)]];
    for (size_t k = 0; k < kDescriptorSize; ++k) sums[k] += d[k], squares[k] += d[k] * d[k];
  }
  size_t best = 0;
  int64_t best_spread = -1;
  for (size_t k = 0; k < kDescriptorSize; ++k) {
    const int64_t spread = count * squares[k] - sums[k] * sums[k];
    if (spread > best_spread) best_spread = spread, best = k;
  }
  return {static_cast<int>(best), static_cast<int>((sums[best] + count - 1) / count)};
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
  build(0, order, descriptors);
  descriptors_.create(descriptors.rows, kDescriptorSize);
  for (int i = 0; i < descriptors.rows; ++i) descriptors.row(order[static_cast<size_t>(i)]).copyTo(descriptors_.row(i));
  index_ = std::move(order);
}

void DescriptorTree::build(int node, std::vector<int>& order, const cv::Mat1b& descriptors) {
  const auto [first, last] = std::pair(nodes_[static_cast<size_t>(node)].first, nodes_[static_cast<size_t>(node)].last);
  if (last - first <= kLeafSize) return;
  const auto [dimension, split] = split_of(descriptors, order, first, last);
  const auto middle = std::stable_partition(order.begin() + first, order.begin() + last,
                                            [&, d = dimension, s = split](int i) { return descriptors(i, d) < s; });
  const int between = static_cast<int>(middle - order.begin());
  if (between == first || between == last) return;  // all equal in this dimension
  const int child = static_cast<int>(nodes_.size());
  nodes_[static_cast<size_t>(node)].dimension = dimension;
  nodes_[static_cast<size_t>(node)].split = split;
  nodes_[static_cast<size_t>(node)].child = child;
  nodes_.push_back({-1, 0, 0, first, between});
  nodes_.push_back({-1, 0, 0, between, last});
  build(child, order, descriptors);
  build(child + 1, order, descriptors);
}

}  // namespace fringeslam
