// SPDX-License-Identifier: Apache-2.0
// Re-identification of landmarks (docs/method.md, section 5.4; thesis 3.2.4): the descriptors of a landmark's
// keypoints are looked up among those of earlier frames' landmarks by best-bin-first search; a landmark is
// re-identified if at least `min_matches` matches are consistent with one rigid motion of their 3D points.
#pragma once

#include <array>
#include <functional>
#include <memory>
#include <mutex>
#include <span>
#include <vector>

#include "core/landmarks/descriptor_tree.h"
#include "core/landmarks/rigid_consensus.h"
#include "core/types/known_landmarks.h"
#include "core/types/landmark.h"
#include "core/types/options.h"
#include "core/types/pinhole.h"

namespace fringeslam {

enum class DescriptorSearch { best_bin_first, brute_force };

constexpr auto choices(DescriptorSearch) {
  using enum DescriptorSearch;
  return std::to_array<Choice<DescriptorSearch>>({{best_bin_first, "best_bin_first"}, {brute_force, "brute_force"}});
}

struct RecognitionOptions {
  DescriptorSearch search = DescriptorSearch::best_bin_first;
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
    v.field("search", search, "search for the nearest descriptors");
    v.field("max_leaves", max_leaves, {1, 1000000},
            "kd-tree leaves visited per keypoint; to relocalize, up to 128 times as many while no view is recognized");
    v.field("strongest", strongest, {2, 100000},
            "strongest keypoints of a landmark that are searched; half as many are queried, the rest matched guided");
    v.field("max_ratio", max_ratio, {0.1, 1},
            "largest ratio of nearest to second-nearest descriptor distance in a frame");
    v.field("min_matches", min_matches, {3, 1000}, "least number of matches of a re-identified landmark");
    v.field("inlier_sigma", inlier_sigma, {0.1, 100},
            "largest deviation of a match from the landmark's motion, sigmas");
    v.field("max_candidates", max_candidates, {1, 1000}, "earlier landmarks verified per landmark");
    v.field(
        "max_views", max_views, {1, 1000},
        "earlier views, those with most matches, that are searched guided; to relocalize, up to eight times as many");
    v.field("guided", guided, "use the motion since a view, estimated from some landmarks, to search for the others");
    v.field("guided_distance_px", guided_distance_px, {0.1, 100}, "search radius of a keypoint, pixel footprints");
    v.field("viewpoint_px", viewpoint_px, {0, 10},
            "sigma of a keypoint's displacement between viewpoints, pixel footprints");
    v.field("max_guided_ratio", max_guided_ratio, {0.1, 2},
            "largest descriptor distance in guided search; 1.4: orthogonal");
    v.field("min_consensus", min_consensus, {3, 10000},
            "least number of matches that agree on the motion since a view");
  }
};

// Returns the digest of a view's landmarks.
LandmarkDigest digest_of(const Landmarks& landmarks);

// Stores the landmarks of many frames and re-identifies them in later ones.
class LandmarkDatabase {
 public:
  // `camera` is the camera of all views. Throws Error for options out of range.
  LandmarkDatabase(const Pinhole& camera, const RecognitionOptions& options);

  // Adds a frame's landmarks under its frame number. Landmarks in memory are shared, not copied.
  void add(int frame, const KnownLandmarks& landmarks);
  // Adds those of `count` frames from number `first` on. Equals adding one after another, but each tree is built only once,
  // and landmarks in a file are read only when they are needed.
  void add(int first, int count, const std::function<const KnownLandmarks&(int frame)>& landmarks_of);

  // Returns the re-identified landmarks of the current frame, in their order; searches `longer`, up to some tenths of a second,
  // if no view is recognized. Each is matched with one earlier
  // landmark and each keypoint at most once; two current landmarks may be parts of the same earlier one. Throws Error if
  // landmarks in a file are damaged.
  std::vector<Recognition> reidentify(const Landmarks& current, bool longer = false) const;

  int landmarks() const { return landmark_count_; }
  int keypoints() const { return static_cast<int>(entries_.size()); }

 private:
  // All keypoints of a view, prepared for searching.
  struct Details {
    std::shared_ptr<const std::vector<Keypoint>> keypoints;  // often a keyframe's own
    cv::Mat1b descriptors;
    // Landmarks of keypoint k: numbers [starts[k], starts[k + 1]) of owners.
    std::vector<int> starts, owners;
    std::vector<int> place;  // position index, common to all orientations at a position
    std::vector<int> owned;  // keypoints that belong to landmarks, sorted by the x of their points
  };
  // A frame's landmarks.
  struct View {
    int frame = 0;
    size_t landmarks = 0, keypoints = 0;
    std::vector<int> strongest;  // strongest keypoints of all landmarks, ascending
    std::vector<int> queried;    // the stronger half of each landmark's strongest
    // The digest of landmarks in a file is in memory, and all keypoints once they were needed.
    std::shared_ptr<const LandmarkDigest> digest;
    struct Loaded {
      std::once_flag once;
      Details details;
    };
    std::shared_ptr<Loaded> loaded = std::make_shared<Loaded>();
    std::function<Details()> load;

    const Details& details() const {
      std::call_once(loaded->once, [&] { loaded->details = load(); });
      return loaded->details;
    }
    // Position of a keypoint in the digest; -1: it is not in it, or there is none.
    int in_digest(int keypoint) const;
    const Keypoint& keypoint(int keypoint) const;
    int place(int keypoint) const;
    const uchar* descriptor(int keypoint) const;
    std::span<const int> landmarks_of(int keypoint) const;
  };
  struct Entry {
    int view = 0, keypoint = 0;
  };
  using Matches = std::vector<KeypointMatch>;

  // `keypoints` are those of the landmarks.
  static Details details_of(const Landmarks& landmarks, std::shared_ptr<const std::vector<Keypoint>> keypoints);
  // Returns a view that refers to the keypoints of `landmarks` while it exists.
  View view_of(int frame, std::shared_ptr<const Landmarks> landmarks) const;
  View view_of(int frame, const KnownLandmarks& known) const;
  void select(View& view, const std::vector<std::vector<int>>& by_strength) const;
  void add(std::vector<View> added);
  const uchar* descriptor_of(int entry) const;
  std::vector<Matches> matches_by_view(const View& current, int max_leaves) const;
  Matches one_to_one(Matches matches, const View& earlier, const View& current) const;
  RigidConsensus consensus(const View& earlier, const View& current, const Matches& matches, double spread_px,
                           int random_triples) const;
  Matches guided_matches(const View& earlier, const View& current, const Pose& earlier_from_current,
                         double distance_px) const;
  Matches all_matches(const View& earlier, const View& current) const;
  bool search_guided(const View& earlier, const View& current, Matches& matches) const;
  bool search_views(const View& current, int max_views, std::vector<Matches>& matches) const;
  bool search_longer(const View& current, std::vector<Matches>& matches) const;
  std::vector<Recognition> candidates_of(int landmark, const std::vector<Matches>& matches, const View& current) const;

  Pinhole camera_;
  RecognitionOptions options_;
  std::vector<View> views_;
  std::vector<Entry> entries_;  // one per descriptor
  // Trees over consecutive runs of descriptors, each run less than half as long as the previous one: a new frame's
  // descriptors are merged with the last runs, so each is rebuilt only as often as the database doubles (Bentley and
  // Saxe 1980).
  struct Run {
    int first = 0, end = 0;  // entries
    DescriptorTree tree;
  };
  std::vector<Run> runs_;
  int landmark_count_ = 0;
};

}  // namespace fringeslam
