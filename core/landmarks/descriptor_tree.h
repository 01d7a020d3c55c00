// SPDX-License-Identifier: Apache-2.0
// Best-bin-first search of descriptors (docs/method.md, section 5.4; Beis and Lowe, CVPR 1997): a kd-tree whose leaves
// are visited in the order of their smallest possible distance, up to a limit. Descriptors are 128 unsigned bytes, so
// distances are integers and identical on every machine. Callers break ties by the lower index.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "core/landmarks/sift_descriptor.h"

namespace fringeslam {

// Quantises unit vectors to bytes: 255 stands for 0.5 and above.
cv::Mat1b quantised(const cv::Mat1f& descriptors);

// Squared Euclidean distance of two descriptors of kDescriptorSize bytes.
int squared_distance(const uchar* a, const uchar* b);

class DescriptorTree {
 public:
  DescriptorTree() = default;
  // Builds the tree from N x 128 descriptors, which are copied in leaf order. Throws Error for other widths.
  explicit DescriptorTree(const cv::Mat1b& descriptors);

  int size() const { return descriptors_.rows; }

  // Calls visit(index, squared distance) for the descriptors of the `most_leaves` nearest leaves.
  template <class Visit>
  void visit_nearest_leaves(const uchar* query, int most_leaves, const Visit& visit) const;

 private:
  struct Node {
    int dimension = -1;  // -1 for a leaf
    int split = 0;       // values >= split go to the second child
    int child = 0;       // index of the first child; the second follows it
    int first = 0, last = 0;
  };
  struct Bin {
    int distance, node;
    bool operator>(const Bin& other) const {
      return distance != other.distance ? distance > other.distance : node > other.node;
    }
  };
  static void build(std::vector<Node>& nodes, int node, std::vector<int>& order, const cv::Mat1b& descriptors);

  cv::Mat1b descriptors_;
  std::vector<int> index_;  // original index of each row
  std::vector<Node> nodes_;
};

template <class Visit>
void DescriptorTree::visit_nearest_leaves(const uchar* query, int most_leaves, const Visit& visit) const {
  if (nodes_.empty()) return;
  // A heap of unvisited branches, nearest first. The distance is a lower bound unless a dimension was split more than
  // once on the path, since every split then adds to it.
  std::vector<Bin> heap = {{0, 0}};
  const auto later = [](const Bin& a, const Bin& b) { return a > b; };
  for (int leaves = 0; leaves < most_leaves && !heap.empty(); ++leaves) {
    std::pop_heap(heap.begin(), heap.end(), later);
    Bin bin = heap.back();
    heap.pop_back();
    const Node* node = &nodes_[static_cast<size_t>(bin.node)];
    while (node->dimension >= 0) {
      const int offset = query[node->dimension] - node->split;
      const int near = offset >= 0 ? 1 : 0;
      heap.push_back({bin.distance + offset * offset, node->child + 1 - near});
      std::push_heap(heap.begin(), heap.end(), later);
      node = &nodes_[static_cast<size_t>(node->child + near)];
    }
    for (int i = node->first; i < node->last; ++i)
      visit(index_[static_cast<size_t>(i)], squared_distance(query, descriptors_[i]));
  }
}

}  // namespace fringeslam
