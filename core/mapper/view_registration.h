// SPDX-License-Identifier: Apache-2.0
// Registration of two views (docs/method.md, sections 6 and 7): ego-motion from matched keypoints refined by all
// depth, or depth alone from a predicted motion; and the tests that a motion must pass to be accepted.
#pragma once

#include <array>
#include <functional>
#include <optional>
#include <vector>

#include "core/landmarks/keypoints.h"
#include "core/motion/ego_motion.h"
#include "core/motion/observability.h"
#include "core/registration/ambiguity.h"
#include "core/registration/icp.h"
#include "core/registration/reference/engines.h"
#include "core/types/camera_motion.h"
#include "core/types/frame.h"
#include "core/types/landmark.h"
#include "core/types/options.h"

namespace fringeslam {

// Keypoints that estimate the motion where no prediction exists: those of re-identified landmarks first, or all.
enum class Correspondences { landmarks, keypoints };

constexpr auto choices(Correspondences) {
  using enum Correspondences;
  return std::to_array<Choice<Correspondences>>({{landmarks, "landmarks"}, {keypoints, "keypoints"}});
}

// Views in which landmarks are detected.
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
  bool finest_in_motion = true;
  bool at_rest = false;
  int stride = 1;

  template <class Visitor>
  void describe(Visitor& v) {
    v.field("predict", predict, "start registration from the predicted pose");
    v.field("max_prediction_error_m", max_prediction_error_m, {1e-6, 10},
            "largest displacement of surfaces from that prediction, m");
    v.field(
        "correspondences", correspondences,
        "keypoints that estimate the motion without a prediction: those of re-identified landmarks, then all if these "
        "do not suffice; or all at once");
    v.field("landmarks", landmarks, "views in which landmarks are detected");
    v.field("engine", engine, "registration engine that refines the motion of the landmarks");
    v.field("min_overlap", min_overlap, {0, 1}, "least overlap of a view tracked by depth alone");
    v.field("min_consistency", min_consistency, {0, 1}, "least share of points on a target surface that agree with it");
    v.field("max_rms_sigma", max_rms_sigma, {0.1, 1000}, "largest RMS residual of a tracked view, sigmas");
    v.field("max_reopened_sigma", max_reopened_sigma, {0.1, 1e6},
            "largest displacement of a tracked view when rejected correspondences are admitted again, sigmas");
    v.field("max_displacement_sigma_m", max_displacement_sigma_m, {1e-9, 10},
            "largest sigma of the surfaces' positions, m");
    v.field("min_predicted", min_predicted, {0, 1},
            "least share of fringe orders predicted by the map; below it the next view captures the full sequence");
    v.field(
        "at_rest", at_rest,
        "the camera is at rest during each stack: motion is neither detected nor estimated; run sets it for imported "
        "datasets without image times");
    v.field("finest_in_motion", finest_in_motion,
            "capture the finest fringes alone while the robot moves and the map predicts their orders; "
            "decode.unwrapping=predicted does so at rest too");
    v.field("stride", stride, {1, 16}, "icp.stride of tracked views; keyframes use icp.stride");
  }
};

struct ViewRegistration {
  bool found = false;      // the motion was estimated, and is the only one that explains the views
  bool refined = false;    // by all depth
  bool ambiguous = false;  // not found, because the alternatives explain the views as well
  Pose earlier_from_current;
  Matrix6d covariance = Matrix6d::Zero();  // of the tangent of retract()
  MotionEstimate motion;                   // by keypoints
  IcpResult icp;
  std::vector<UnobservableDirection> undetermined;  // by surfaces alone, in the earlier camera's frame
  std::vector<AlternativePose> alternatives;        // to earlier_from_current, if ambiguous
};

struct RegistrationOptions {
  MatchOptions matching;
  MotionOptions motion;
  IcpOptions icp;
  TrackingOptions tracking;
  AmbiguityOptions ambiguity;
  MotionLimits motion_prior = {};
};

// True if a pose lies within the covariance of another (chi-square of six degrees of freedom, one false alarm in 10^7).
bool agree(const Pose& pose, const Pose& other, const Matrix6d& covariance);

// Returns the standard deviation of the position of a point on the optical axis at a distance, m.
double displacement_sigma_m(const Pose& earlier_from_current, const Matrix6d& covariance, double distance_m);

// Keypoints of the current view matched with those of an earlier view.
struct ViewMatches {
  int earlier = 0;  // number of the earlier view
  std::vector<KeypointMatch> matches;
};

// Groups the matches of all re-identified landmarks by view, most matches first.
std::vector<ViewMatches> matches_by_view(const std::vector<Recognition>& recognitions);

std::vector<PointPair> point_pairs(const Keypoints& earlier, const Keypoints& current,
                                   const std::vector<KeypointMatch>& matches);

// Estimates the motion from matched keypoints and refines it by depth. Both frames are of the same camera, with surfaces
// about `distance_m` away. Not found if depth contradicts the motion, ambiguous if another explains the views as well.
ViewRegistration register_views(const Frame& earlier, const Frame& current, const std::vector<PointPair>& pairs,
                                const Pinhole& camera, double distance_m, const RegistrationOptions& options);

// Registers by depth alone, from a prediction that displaces surfaces by at most max_prediction_error_m. `prior` is the
// information of `predicted`, as in icp.h. Found only if the surfaces determine the motion and agree where both views
// see one; ambiguous if another motion as close to the prediction explains the views as well. A prediction whose
// `predicted_covariance` is known (not zero) excludes motions that are more than three sigmas away, unless the result is
// one of them.
ViewRegistration follow_view(const Frame& earlier, const Frame& current, const Pose& predicted, const Pinhole& camera,
                             double distance_m, const RegistrationOptions& options,
                             const Matrix6d& prior = Matrix6d::Zero(),
                             const Matrix6d& predicted_covariance = Matrix6d::Zero());

// A view with its keypoints.
struct SeenView {
  const Frame& frame;
  const Keypoints& keypoints;
};

struct LocatedView {
  ViewMatches with;  // the view of the accepted or the last registration
  ViewRegistration registration;
};

// Registers by re-identified landmarks with the views that share most of their keypoints; if depth confirms none of these
// motions, by all keypoints of the view `last`. A registration that is ambiguous with one view may be unique with the
// next. `earlier` returns a view by its number; it stays valid until the next
// call.
LocatedView locate_view(const std::function<SeenView(int)>& earlier, int last, const SeenView& current,
                        const std::vector<Recognition>& recognitions, const Pinhole& camera, double distance_m,
                        const RegistrationOptions& options);

// Returns the covariance of a registration when its cameras may be far apart compared to the distance of the surfaces. Depth
// errors at edges, of texture under blur and of the surface's sampling depend on the viewing direction; they cancel only
// between views from nearly the same place (docs/method.md, section 8.1). `corrected_spread_px2`: that of both views,
// ReconstructedView::corrected_spread_px2.
Matrix6d with_parallax(const Matrix6d& covariance, const Pose& a_from_b, double distance_m,
                       std::optional<double> corrected_spread_px2);

// Factor of the covariances of links between keyframes: pose graphs take links as independent, but those of a keyframe share
// its errors (docs/method.md, section 8.1).
constexpr double kLinkVariance = 1.25;

}  // namespace fringeslam
