// SPDX-License-Identifier: Apache-2.0
// The motion between two views, by what both are known to show: S20 from matched keypoints, then S22 from all depth;
// or S22 alone, from a predicted motion. And when to believe it: a motion that may be wrong is no motion.
#pragma once

#include <array>
#include <functional>
#include <vector>

#include "core/landmarks/keypoints.h"
#include "core/motion/ego_motion.h"
#include "core/motion/observability.h"
#include "core/registration/engines.h"
#include "core/registration/icp.h"
#include "core/types/frame.h"
#include "core/types/landmark.h"
#include "core/types/options.h"

namespace fringeslam {

// Keypoints that tell the motion where it is not predicted: those of recognised landmarks first, or all at once.
enum class Correspondences { landmarks, keypoints };

constexpr auto choices(Correspondences) {
  using enum Correspondences;
  return std::to_array<Choice<Correspondences>>({{landmarks, "landmarks"}, {keypoints, "keypoints"}});
}

// Views that are searched for landmarks.
enum class LandmarkViews { keyframes, every_frame };

constexpr auto choices(LandmarkViews) {
  using enum LandmarkViews;
  return std::to_array<Choice<LandmarkViews>>({{keyframes, "keyframes"}, {every_frame, "every_frame"}});
}

struct TrackingOptions {
  bool predict = true;
  double max_prediction_error_m = 0.03;
  Correspondences correspondences = Correspondences::landmarks;
  LandmarkViews landmarks = LandmarkViews::keyframes;
  RegistrationEngine engine = RegistrationEngine::point_to_plane;
  double min_overlap = 0.25;
  double min_consistency = 0.8;
  double max_rms_sigma = 2;
  double max_reopened_sigma = 8;
  double max_displacement_sigma_m = 1e-3;
  double min_predicted = 0.75;
  int stride = 2;
  bool moving = false;

  template <class Visitor>
  void describe(Visitor& v) {
    v.field("predict", predict, "views are registered from where constant velocity lets expect them");
    v.field("max_prediction_error_m", max_prediction_error_m, {1e-6, 10}, "by how much surfaces may be off there, m");
    v.field("correspondences", correspondences,
            "whose keypoints tell the motion where it is not predicted: of landmarks that are recognised, and of all "
            "where those do not suffice, or of all at once");
    v.field("landmarks", landmarks, "which views are searched for landmarks");
    v.field("engine", engine, "registration that refines the landmarks' motion");
    v.field("min_overlap", min_overlap, {0, 1}, "least share of a view that is followed without landmarks");
    v.field("min_consistency", min_consistency, {0, 1},
            "least share of points that agree with the surface where they fall on one");
    v.field("max_rms_sigma", max_rms_sigma, {0.1, 1000}, "largest RMS residual of a followed view, sigmas");
    v.field("max_reopened_sigma", max_reopened_sigma, {0.1, 1e6},
            "by how much a followed view may still move if partners that were given up count again, sigmas");
    v.field("max_displacement_sigma_m", max_displacement_sigma_m, {1e-9, 10},
            "largest sigma of where surfaces come to lie, m");
    v.field("min_predicted", min_predicted, {0, 1},
            "share of the fringes whose order is predicted, below which the next view takes all patterns");
    v.field("stride", stride, {1, 16},
            "icp.stride of views that are followed; keyframes are registered by icp.stride itself");
    v.field("moving", moving, "the robot moves while a sequence is taken: its velocity corrects the phase");
  }
};

struct ViewRegistration {
  bool found = false;    // the motion is known
  bool refined = false;  // by all depth
  Pose earlier_from_current;
  Matrix6d covariance = Matrix6d::Zero();  // of the tangent of retract()
  MotionEstimate motion;                   // by keypoints
  IcpResult icp;
  std::vector<UnobservableDirection> undetermined;  // why surfaces alone did not do, in the earlier camera's frame
};

struct RegistrationOptions {
  MatchOptions matching;
  MotionOptions motion;
  IcpOptions icp;
  TrackingOptions tracking;
};

// Keypoints of the current view that are known from an earlier one.
struct ViewMatches {
  int earlier = 0;  // its number
  std::vector<KeypointMatch> matches;
};

// Of all recognised landmarks, the view of most matches first.
std::vector<ViewMatches> matches_by_view(const std::vector<Recognition>& recognitions);

std::vector<PointPair> point_pairs(const Keypoints& earlier, const Keypoints& current,
                                   const std::vector<KeypointMatch>& matches);

// From matched keypoints; both frames by one camera, surfaces about `distance_m` away.
ViewRegistration register_views(const Frame& earlier, const Frame& current, const std::vector<PointPair>& pairs,
                                const Pinhole& camera, double distance_m, const RegistrationOptions& options);

// `prior`: information of `predicted`, as in icp.h. From a motion that may be off by up to max_prediction_error_m at
// the surfaces. Found only if the surfaces alone determine the motion, and agree wherever both views see one.
ViewRegistration follow_view(const Frame& earlier, const Frame& current, const Pose& predicted, const Pinhole& camera,
                             double distance_m, const RegistrationOptions& options,
                             const Matrix6d& prior = Matrix6d::Zero());

// What is known of a view.
struct SeenView {
  const Frame& frame;
  const Keypoints& keypoints;
};

struct LocatedView {
  ViewMatches with;  // the view that it was registered with last, or for good
  ViewRegistration registration;
};

// By landmarks, in the views where most of their keypoints were seen; where depth confirms none of those motions, by
// all keypoints of the view `last`. `earlier` gives the views by their numbers, each until the next is asked for.
LocatedView locate_view(const std::function<SeenView(int)>& earlier, int last, const SeenView& current,
                        const std::vector<Recognition>& recognitions, const Pinhole& camera, double distance_m,
                        const RegistrationOptions& options);

}  // namespace fringeslam
