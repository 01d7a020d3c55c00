// SPDX-License-Identifier: Apache-2.0
// Scores against ground truth.
#include "core/score/map_score.h"
#include "core/score/score.h"
#include "core/types/decoded_stack.h"
#include "python/src/bindings.h"
#include "python/src/options.h"

namespace fringeslam::python {

namespace {

cv::Mat1f depth_of(const Frame& frame) {
  cv::Mat1f depth(frame.points_m.size());
  cv::extractChannel(frame.points_m, depth, 2);
  return depth;
}

void bind_trajectory_score(py::module_& m) {
  py::class_<ErrorStatistics>(m, "ErrorStatistics", "Summary of errors.")
      .def_readonly("rmse", &ErrorStatistics::rmse)
      .def_readonly("mean", &ErrorStatistics::mean)
      .def_readonly("median", &ErrorStatistics::median)
      .def_readonly("std", &ErrorStatistics::std)
      .def_readonly("min", &ErrorStatistics::min)
      .def_readonly("max", &ErrorStatistics::max);
  py::class_<TrajectoryScore>(m, "TrajectoryScore", "Errors of a trajectory by evo's definitions.")
      .def_readonly("poses", &TrajectoryScore::poses, "Number of associated poses.")
      .def_readonly("ate_rmse_m", &TrajectoryScore::ate_rmse_m, "Translation, first poses aligned.")
      .def_readonly("ate_umeyama_rmse_m", &TrajectoryScore::ate_umeyama_rmse_m, "Translation, best SE(3) alignment.")
      .def_readonly("rpe_translation_rmse_m", &TrajectoryScore::rpe_translation_rmse_m, "Consecutive poses.")
      .def_readonly("rpe_rotation_rmse_rad", &TrajectoryScore::rpe_rotation_rmse_rad)
      .def_readonly("ape", &TrajectoryScore::ape, "By the options: m, degrees, or dimensionless.")
      .def_readonly("rpe_translation_m", &TrajectoryScore::rpe_translation_m)
      .def_readonly("rpe_rotation_deg", &TrajectoryScore::rpe_rotation_deg);
  m.def(
      "score_trajectory",
      [](const Trajectory& estimate, const Trajectory& truth, const py::object& options, const py::kwargs& changes) {
        return score_trajectory(estimate, truth, options_of<TrajectoryOptions>("trajectory", options, changes));
      },
      py::arg("estimate"), py::arg("truth"), py::arg("options") = py::none(),
      "Scores a trajectory (core/score/trajectory_score.h). Options: TrajectoryOptions. Raises Error if fewer than two "
      "poses can be associated.");
}

void bind_depth_score(py::module_& m) {
  py::class_<DepthScore>(m, "DepthScore", "Depth errors of a view; NaN if no pixel could be compared.")
      .def_readonly("compared", &DepthScore::compared, "Directly lit pixels with an estimate.")
      .def_readonly("median_m", &DepthScore::median_m, "Of the absolute error.")
      .def_readonly("rms_m", &DepthScore::rms_m)
      .def_readonly("p99_m", &DepthScore::p99_m, "99th percentile of the absolute error.")
      .def_readonly("valid_fraction", &DepthScore::valid_fraction, "Share of the directly lit pixels with an estimate.")
      .def_readonly("wrong_order", &DepthScore::wrong_order,
                    "Share of compared pixels more than half a fringe period off; NaN without `decoded`.")
      .def_readonly("spurious", &DepthScore::spurious, "Estimates without a surface or without direct light.");
  m.def(
      "score_depth",
      [](const Frame& frame, const TruthFrame& truth, const std::optional<DecodedStack>& decoded) {
        const py::gil_scoped_release release;
        DepthEstimate estimate{depth_of(frame), frame.sigma_m, cv::Mat1f(frame.points_m.size(), NAN)};
        if (decoded && !decoded->coordinate_px.empty()) estimate.projector_column = decoded->coordinate_px;
        DepthScore score = score_depth(estimate, truth, decoded ? decoded->finest_period_px : 0);
        if (!decoded) score.wrong_order = NAN;
        return score;
      },
      py::arg("frame"), py::arg("truth"), py::arg("decoded") = py::none(),
      "Scores a frame's depth. With `decoded`, also counts wrong fringe orders.");
}

void bind_motion_score(py::module_& m) {
  py::class_<MotionScore>(m, "MotionScore", "Error of one motion.")
      .def_readonly("translation_error_m", &MotionScore::translation_error_m)
      .def_readonly("rotation_error_rad", &MotionScore::rotation_error_rad);
  m.def("score_motion", &score_motion, py::arg("estimate"), py::arg("truth"),
        "Scores an estimated rigid motion, 4 x 4, against the true one.");
  m.def(
      "pose_difference", &difference, py::arg("to"), py::arg("from_"),
      "Returns the tangent (rotation, rad; translation, m) that takes the pose `from_` to `to`, both applied from the "
      "left: the error that a pose's covariance describes.");
  m.def("retract", &retract, py::arg("pose"), py::arg("tangent"), "Inverse of pose_difference().");
}

void bind_map_score(py::module_& m) {
  py::class_<DistanceStatistics>(m, "DistanceStatistics", "Summary of distances, m.")
      .def_readonly("points", &DistanceStatistics::points)
      .def_readonly("mean_m", &DistanceStatistics::mean_m)
      .def_readonly("median_m", &DistanceStatistics::median_m)
      .def_readonly("p90_m", &DistanceStatistics::p90_m)
      .def_readonly("rms_m", &DistanceStatistics::rms_m);
  py::class_<MapScore>(m, "MapScore", "Score of a map (Knapitsch et al., Tanks and Temples, 2017).")
      .def_readonly("threshold_m", &MapScore::threshold_m)
      .def_readonly("accuracy", &MapScore::accuracy, "Distances of the map's points to the true surface.")
      .def_readonly("completeness", &MapScore::completeness, "Distances of seen surface points to the map.")
      .def_readonly("precision", &MapScore::precision)
      .def_readonly("recall", &MapScore::recall)
      .def_property_readonly("f_score", &MapScore::f_score);
  m.def("score_map", &score_map, py::arg("map_to_truth_m"), py::arg("truth_to_map_m"), py::arg("threshold_m"),
        "Scores a map from the distances of its points to the true surface (NearestSurface) and those of seen surface "
        "points (visible_surface) to the map.");
}

}  // namespace

void bind_scores(py::module_& m) {
  bind_trajectory_score(m);
  bind_depth_score(m);
  bind_motion_score(m);
  bind_map_score(m);
}

}  // namespace fringeslam::python
