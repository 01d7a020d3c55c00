// SPDX-License-Identifier: Apache-2.0
#include "core/mapper/map_merge.h"

#include <algorithm>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>

#include "core/landmarks/recognition.h"
#include "core/map/pose_edges.h"
#include "core/types/linear_algebra.h"

namespace fringeslam {

namespace {

constexpr size_t kLeastViews = 2;  // of B, re-identified with the same placement

const Keyframe& keyframe(const KeyframeMap& map, int number) { return map.keyframes()[static_cast<size_t>(number)]; }

int count(const KeyframeMap& map) { return static_cast<int>(map.keyframes().size()); }

size_t views_of_b(const std::vector<CrossLink>& links) {
  std::set<int> views;
  for (const CrossLink& link : links) views.insert(link.b);
  return views.size();
}

// A motion with its covariance, tangent of retract().
struct Motion {
  Pose pose;
  Matrix6d covariance = Matrix6d::Zero();
};

Motion operator*(const Motion& one, const Motion& other) {
  const Matrix6d moved = tangent_of_product(one.pose.rotation * other.pose.translation);
  return {one.pose * other.pose,
          moved * one.covariance * moved.transpose() + rotated_covariance(one.pose.rotation, other.covariance)};
}

Motion inverse(const Motion& motion) {
  return {motion.pose.inverse(), covariance_of_inverse(motion.pose, motion.covariance)};
}

class Merger {
 public:
  Merger(const KeyframeMap& a, const KeyframeMap& b, const MapperOptions& options, const std::string& b_name)
      : a_(a), b_(b), options_(options), b_name_(b_name), database_(a.rig().camera, options.finder.recognition) {
    database_.add(0, count(a_), [&](int i) -> const KnownLandmarks& { return keyframe(a_, i).landmarks; });
  }

  MergedMap merged(const MergeProgress& progress) {
    for (int j = 0; j < count(b_); ++j) {
      reidentify(j);
      if (progress) progress(j + 1, count(b_));
    }
    std::vector<CrossLink> links = consensus();
    const CrossLink& first = links.front();
    const Pose a_from_b =
        keyframe(a_, first.a).world_from_camera * first.a_from_b * keyframe(b_, first.b).world_from_camera.inverse();
    MergedMap result{KeyframeMap(a_.rig(), options_.mapping), {}, {}, {}, 0};
    result.contradicting = verify(joined(links, a_from_b).poses, links);
    const Joint joint = joined(links, a_from_b);
    finish(result, joint, std::move(links));
    return result;
  }

 private:
  // Registers a keyframe of B with those of A that share most of its landmarks.
  void reidentify(int j) {
    constexpr size_t kMostViews = 3;
    const std::shared_ptr<const Landmarks> landmarks_of_b = keyframe(b_, j).landmarks.get();
    std::vector<ViewMatches> candidates = matches_by_view(database_.reidentify(*landmarks_of_b));
    candidates.resize(std::min(candidates.size(), kMostViews));
    if (candidates.empty()) return;
    const Frame image = b_.keyframe_image(j);
    for (const ViewMatches& with : candidates) {
      const ViewRegistration found = register_views(
          a_.keyframe_image(with.earlier), image,
          point_pairs(keyframe(a_, with.earlier).landmarks.get()->keypoints, landmarks_of_b->keypoints, with.matches),
          a_.rig().camera, a_.rig().middle_range_m(), options_.registration);
      ambiguous_ += found.ambiguous;
      if (!found.found || !found.refined) continue;
      candidates_.push_back(link_of(with.earlier, j, found, true));
      return;
    }
  }

  CrossLink link_of(int a, int b, const ViewRegistration& found, bool by_landmarks) const {
    const Pose& pose = found.earlier_from_current;
    // The registration takes the motions during both stacks as known.
    const Matrix6d covariance = found.covariance + covariance_by_motion(keyframe(a_, a), keyframe(b_, b), pose);
    // Maps do not record whether their points were corrected for texture.
    return {a,
            b,
            pose,
            kLinkVariance * with_parallax(covariance, pose, a_.rig().middle_range_m(), std::nullopt),
            by_landmarks,
            false};
  }

  // True if two links place the maps alike, to within the uncertainty of both and of the maps between them.
  bool consistent(const CrossLink& one, const CrossLink& other) const {
    constexpr double kMostSquare = 45;  // six degrees of freedom, one false alarm in 10^7
    const auto between = [](const KeyframeMap& map, int from, int to) {
      return Motion{keyframe(map, from).world_from_camera.inverse() * keyframe(map, to).world_from_camera,
                    map.covariance_between(from, to)};
    };
    const Motion in_a = between(a_, one.a, other.a), in_b = between(b_, one.b, other.b);
    const bool known =
        (one.a == other.a || !in_a.covariance.isZero(0)) && (one.b == other.b || !in_b.covariance.isZero(0));
    if (!known) return false;
    const Motion around =
        Motion{one.a_from_b, one.covariance} * in_b * inverse(Motion{other.a_from_b, other.covariance});
    const Vector6d off = difference(around.pose, in_a.pose);
    return off.dot(solve_symmetric(Matrix6d(around.covariance + in_a.covariance), off)) <= kMostSquare;
  }

  // Returns the links that agree with the one that most agree with. Those of similar places disagree.
  std::vector<CrossLink> consensus() const {
    const size_t n = candidates_.size();
    std::vector<std::vector<char>> agree(n, std::vector<char>(n, 1));
    for (size_t i = 0; i < n; ++i) {
      for (size_t k = 0; k < i; ++k) agree[i][k] = agree[k][i] = consistent(candidates_[i], candidates_[k]);
    }
    // The largest group of admissible links that agree with one of them, which comes first.
    const auto largest_group = [&](const auto& admissible) {
      std::vector<size_t> best;
      size_t most = 0;
      for (size_t i = 0; i < n; ++i) {
        if (!admissible(i)) continue;
        std::vector<size_t> group = {i};
        for (size_t k = 0; k < n; ++k) {
          if (k != i && admissible(k) && agree[i][k]) group.push_back(k);
        }
        if (const size_t views = views_of_b(chosen(group)); views > most) {
          best = std::move(group);
          most = views;
        }
      }
      return best;
    };
    const std::vector<size_t> group = largest_group([](size_t) { return true; });
    const std::vector<CrossLink> best = chosen(group);
    if (views_of_b(best) < kLeastViews) refuse_without_evidence();
    const std::vector<CrossLink> rival = chosen(largest_group([&](size_t i) { return !agree[group.front()][i]; }));
    if (views_of_b(rival) >= kLeastViews && 2 * views_of_b(rival) >= views_of_b(best))
      throw Error(b_name_ + ": fits the other map in more than one place (" + std::to_string(views_of_b(best)) +
                  " views fit one, " + std::to_string(views_of_b(rival)) +
                  " another); map something that does not repeat on both missions");
    return best;
  }

  std::vector<CrossLink> chosen(const std::vector<size_t>& numbers) const {
    std::vector<CrossLink> links;
    for (const size_t i : numbers) links.push_back(candidates_[i]);
    return links;
  }

  [[noreturn]] void refuse_without_evidence() const {
    std::string found = std::to_string(candidates_.size()) + " of " + std::to_string(count(b_)) +
                        " keyframes are re-identified in the other map";
    if (candidates_.size() >= kLeastViews) found += ", and no two of them with the same placement";
    if (ambiguous_ > 0) found += "; " + std::to_string(ambiguous_) + " are ambiguous";
    throw Error(b_name_ + ": " + found + "; merging takes at least two views of places that both missions saw");
  }

  struct Joint {
    std::vector<Pose> poses;  // of the keyframes of A, then of B, in the world of A
    std::vector<PoseEdge> edges;
    std::vector<char> use;
    size_t first_cross = 0;
  };

  // Optimises both maps together.
  Joint joined(const std::vector<CrossLink>& links, const Pose& a_from_b) const {
    Joint joint;
    std::vector<Pose> initial;
    for (const Keyframe& k : a_.keyframes()) initial.push_back(k.world_from_camera);
    for (const Keyframe& k : b_.keyframes()) initial.push_back(orthonormalised(a_from_b * k.world_from_camera));
    joint.edges = a_.links();
    for (PoseEdge edge : b_.links()) {
      edge.from += count(a_);
      edge.to += count(a_);
      joint.edges.push_back(edge);
    }
    joint.first_cross = joint.edges.size();
    // The depth errors of a view are common to all of its links, so these do not average out.
    std::map<int, int> links_of_a, links_of_b;
    for (const CrossLink& link : links) {
      ++links_of_a[link.a];
      ++links_of_b[link.b];
    }
    for (const CrossLink& link : links) {
      const double shared = std::max(links_of_a[link.a], links_of_b[link.b]);
      const Matrix6d information = fringeslam::inverse(Matrix6d(shared * link.covariance));
      joint.edges.push_back(
          {link.a, count(a_) + link.b, link.a_from_b, Matrix6d(0.5 * (information + information.transpose())), true});
    }
    const PoseGraphResult result = optimise_poses(initial, joint.edges, options_.pose_graph);
    joint.poses = result.poses;
    for (const double weight : result.weights) joint.use.push_back(weight > 0);
    return joint;
  }

  // Registers keyframes that overlap according to the poses and are not linked yet by depth; adds the links found. Returns
  // the number of pairs whose depths contradict the poses.
  int verify(const std::vector<Pose>& poses, std::vector<CrossLink>& links) const {
    constexpr double kNear = 0.5, kLeastOverlap = 0.3, kLeastAgreement = 0.6;
    constexpr size_t kMostPairs = 2;  // per keyframe of B
    const Pinhole& camera = a_.rig().camera;
    int contradicting = 0, confirmed = static_cast<int>(links.size());
    for (int j = 0; j < count(b_); ++j) {
      const Pose& world_from_b = poses[static_cast<size_t>(count(a_) + j)];
      std::vector<std::pair<double, int>> near;
      for (int i = 0; i < count(a_); ++i) {
        const double change = a_.view_change(poses[static_cast<size_t>(i)].inverse() * world_from_b);
        if (change < kNear) near.emplace_back(change, i);
      }
      std::sort(near.begin(), near.end());
      near.resize(std::min(near.size(), kMostPairs));
      if (near.empty()) continue;
      const Frame of_b = b_.keyframe_image(j);
      for (const auto& [change, i] : near) {
        const auto is_linked = [i = i, j](const CrossLink& link) { return link.a == i && link.b == j; };
        if (std::any_of(links.begin(), links.end(), is_linked)) continue;
        const Frame of_a = a_.keyframe_image(i);
        const Pose predicted = poses[static_cast<size_t>(i)].inverse() * world_from_b;
        const ViewRegistration found =
            follow_view(of_a, of_b, predicted, camera, a_.rig().middle_range_m(), options_.registration);
        if (found.refined) {
          links.push_back(link_of(i, j, found, false));
          ++confirmed;
          continue;
        }
        const DepthAgreement depth =
            depth_agreement(of_a, of_b, camera, predicted, options_.registration.tracking.max_prediction_error_m);
        contradicting += depth.overlap >= kLeastOverlap && depth.agrees < kLeastAgreement;
      }
    }
    if (contradicting > confirmed)
      throw Error(b_name_ + ": fits the other map in " + std::to_string(confirmed) + " pairs of views, but " +
                  std::to_string(contradicting) +
                  " pairs contradict that placement; the missions saw different places that look alike, or the place "
                  "has changed");
    return contradicting;
  }

  void finish(MergedMap& result, const Joint& joint, std::vector<CrossLink> links) const {
    std::vector<PoseEdge> kept;
    std::vector<CrossLink> accepted;
    for (size_t i = 0; i < joint.edges.size(); ++i) {
      if (i < joint.first_cross) {
        kept.push_back(joint.edges[i]);
        continue;
      }
      CrossLink& link = links[i - joint.first_cross];
      link.accepted = joint.use[i] != 0;
      if (!link.accepted) continue;
      accepted.push_back(link);
      kept.push_back(joint.edges[i]);
    }
    if (views_of_b(accepted) < kLeastViews) refuse_without_evidence();

    std::vector<Keyframe> keyframes = a_.keyframes();
    keyframes.insert(keyframes.end(), b_.keyframes().begin(), b_.keyframes().end());
    for (size_t i = 0; i < keyframes.size(); ++i) keyframes[i].world_from_camera = joint.poses[i];
    std::vector<MapFrame> frames = a_.frames();
    for (MapFrame frame : b_.frames()) {
      frame.keyframe += count(a_);
      frames.push_back(std::move(frame));
    }
    result.map.restore(std::move(keyframes), std::move(frames), std::move(kept));
    result.links = std::move(links);

    const auto first_of_b = static_cast<size_t>(count(a_));
    const Pose b_world_from_first = keyframe(b_, 0).world_from_camera;
    result.a_from_b = orthonormalised(joint.poses[first_of_b] * b_world_from_first.inverse());
    const Motion first{joint.poses[first_of_b], covariance_of_node(joint.poses, joint.edges, joint.use, count(a_))};
    result.covariance = (first * Motion{b_world_from_first.inverse()}).covariance;
  }

  const KeyframeMap &a_, &b_;
  const MapperOptions& options_;
  const std::string& b_name_;
  LandmarkDatabase database_;
  std::vector<CrossLink> candidates_;
  int ambiguous_ = 0;
};

}  // namespace

MergedMap merge_maps(const KeyframeMap& a, const KeyframeMap& b, const MapperOptions& options,
                     const std::string& b_name, const MergeProgress& progress) {
  return Merger(a, b, options, b_name).merged(progress);
}

}  // namespace fringeslam
