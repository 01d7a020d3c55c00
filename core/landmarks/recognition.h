// SPDX-License-Identifier: Apache-2.0
// Landmarks that were seen before (METHOD S18; thesis 3.2.4): the descriptors of a landmark's keypoints are looked up
// among those of the landmarks of earlier frames, best bin first; a landmark is recognised by more than three matches
// that one rigid motion of its 3D points explains.
#pragma once

#include <string>
#include <vector>

#include "core/landmarks/descriptor_tree.h"
#include "core/landmarks/rigid_consensus.h"
#include "core/types/landmark.h"
#include "core/types/options.h"
#include "core/types/pinhole.h"

namespace fringeslam {

struct RecognitionOptions {
  std::string search = "best_bin_first";
  int max_leaves = 16;
  int strongest = 40;
  double max_ratio = 0.85;
  int min_matches = 4;
  double inlier_sigma = 4;
  int max_candidates = 4;
  int max_views = 4;
  bool guided = true;
  double guided_distance_px = 4;
  double viewpoint_px = 0.4;
  double max_guided_ratio = 0.75;
  int min_consensus = 8;

  template <class Visitor>
  void describe(Visitor& v) {
    v.field("search", search, {"best_bin_first", "brute_force"}, "how the nearest descriptors are found");
    v.field("max_leaves", max_leaves, {1, 1000000}, "bins of the trees that are looked at for a keypoint");
    v.field("strongest", strongest, {2, 100000},
            "keypoints of a landmark that others are compared with; half as many are looked up, the rest found guided");
    v.field("max_ratio", max_ratio, {0.1, 1}, "largest ratio of nearest to second nearest descriptor of a frame");
    v.field("min_matches", min_matches, {3, 1000}, "matches by which a landmark is recognised");
    v.field("inlier_sigma", inlier_sigma, {0.1, 100}, "sigmas by which a match may miss the landmark's motion");
    v.field("max_candidates", max_candidates, {1, 1000}, "earlier landmarks that are tried for a landmark");
    v.field("max_views", max_views, {1, 1000}, "earlier views, of most matches, that are searched guided");
    v.field("guided", guided, "where the motion since a view is known from some landmarks, look for the others by it");
    v.field("guided_distance_px", guided_distance_px, {0.1, 100}, "how far off a keypoint is looked for, footprints");
    v.field("viewpoint_px", viewpoint_px, {0, 10},
            "by how much a keypoint may sit elsewhere when seen from another place, footprints of a pixel");
    v.field("max_guided_ratio", max_guided_ratio, {0.1, 2}, "largest distance of descriptors there; 1.4: orthogonal");
    v.field("min_consensus", min_consensus, {3, 10000}, "matches that must agree on the motion since a view");
  }
};

// The landmarks of many frames, to be recognised in later ones.
class LandmarkDatabase {
 public:
  // `camera`: of all views.
  LandmarkDatabase(const Pinhole& camera, const RecognitionOptions& options);

  // Remembers a frame's landmarks under its number.
  void add(int frame, const Landmarks& landmarks);

  // Those of the current frame that are known: each as one earlier landmark, each keypoint matched once. Two may be
  // parts of one earlier landmark. In the order of the current landmarks.
  std::vector<Recognition> recognise(const Landmarks& current) const;

  int landmarks() const { return landmark_count_; }
  int keypoints() const { return static_cast<int>(entries_.size()); }

 private:
  // A frame's landmarks, made ready to be searched.
  struct View {
    int frame = 0;
    size_t landmarks = 0;
    std::vector<Keypoint> keypoints;
    cv::Mat1b descriptors;
    std::vector<std::vector<int>> landmarks_of;  // each keypoint
    std::vector<int> place;                      // the same for a place's keypoints of several orientations
    std::vector<int> owned;                      // keypoints of landmarks, by the x of their points
    std::vector<int> strongest;                  // of each landmark, together, ascending
    std::vector<int> queried;                    // the stronger half of them
  };
  struct Entry {
    int view = 0, keypoint = 0;
  };
  using Matches = std::vector<KeypointMatch>;

  View view_of(int frame, const Landmarks& landmarks) const;
  std::vector<Matches> matches_by_view(const View& current) const;
  Matches one_to_one(Matches matches, const View& earlier, const View& current) const;
  RigidConsensus consensus(const View& earlier, const View& current, const Matches& matches, double spread_px,
                           int random_triples) const;
  Matches guided_matches(const View& earlier, const View& current, const Pose& earlier_from_current,
                         double distance_px) const;
  Matches all_matches(const View& earlier, const View& current) const;
  bool search_guided(const View& earlier, const View& current, Matches& matches) const;
  std::vector<Recognition> candidates_of(int landmark, const std::vector<Matches>& matches, const View& current) const;

  Pinhole camera_;
  RecognitionOptions options_;
  std::vector<View> views_;
  std::vector<Entry> entries_;  // of each descriptor
  cv::Mat1b descriptors_;
  // Trees over consecutive runs of descriptors, each less than half the one before: a new frame's descriptors are
  // merged with the last runs, so that one is built anew only as often as the database doubles (Bentley and Saxe 1980).
  struct Run {
    int first = 0;
    DescriptorTree tree;
  };
  std::vector<Run> runs_;
  int landmark_count_ = 0;
};

}  // namespace fringeslam
