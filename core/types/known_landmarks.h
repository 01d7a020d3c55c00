// SPDX-License-Identifier: Apache-2.0
// Landmarks of a keyframe that are in memory, or in a file from which they are read when they are needed. Of those in a file,
// a digest is in memory: the landmarks of a view take a megabyte, its digest a tenth.
#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <utility>
#include <vector>

#include "core/types/landmark.h"

namespace fringeslam {

// The strongest keypoints of a view, for the search among many views.
struct LandmarkDigest {
  int keypoints = 0;                        // number of all keypoints of the view
  std::vector<std::vector<int>> strongest;  // of each landmark, in descending order of strength, at most kMost
  std::vector<int> indices;                 // all of these keypoints, ascending
  std::vector<Keypoint> details;            // of indices[i]
  std::vector<int> place;                   // of indices[i]: the lowest index of the keypoints at its position
  std::vector<int> starts, owners;          // landmarks of indices[i]: owners[starts[i]] to owners[starts[i + 1] - 1]
  cv::Mat1b descriptors;                    // of indices[i], quantised (core/landmarks/descriptor_tree.h)

  static constexpr int kMost = 40;
};

class KnownLandmarks {
 public:
  KnownLandmarks() : KnownLandmarks(Landmarks{}) {}
  KnownLandmarks(Landmarks landmarks) : in_memory_(std::make_shared<const Landmarks>(std::move(landmarks))) {}
  // `load` may throw Error.
  KnownLandmarks(LandmarkDigest digest, std::function<Landmarks()> load)
      : digest_(std::make_shared<const LandmarkDigest>(std::move(digest))), load_(std::move(load)) {}

  // Returns the landmarks; reads them each time if they are in a file.
  std::shared_ptr<const Landmarks> get() const {
    return in_memory_ ? in_memory_ : std::make_shared<const Landmarks>(load_());
  }
  // The digest of landmarks in a file; null for those in memory.
  const std::shared_ptr<const LandmarkDigest>& digest() const { return digest_; }

  // Number of landmarks, and memory that they take.
  size_t count() const { return digest_ ? digest_->strongest.size() : in_memory_->landmarks.size(); }
  size_t memory_bytes() const {
    if (digest_) return digest_->indices.size() * (sizeof(Keypoint) + 128);
    return in_memory_->keypoints.descriptors.total() * sizeof(float) +
           in_memory_->keypoints.keypoints.size() * sizeof(Keypoint);
  }

 private:
  std::shared_ptr<const Landmarks> in_memory_;
  std::shared_ptr<const LandmarkDigest> digest_;
  std::function<Landmarks()> load_;
};

}  // namespace fringeslam
