// SPDX-License-Identifier: Apache-2.0
// Calibration of camera and projector from views of a board.
#include "core/calibrate/rig_calibration.h"
#include "core/decode/decode.h"
#include "python/src/bindings.h"
#include "python/src/options.h"

namespace fringeslam::python {

namespace {

BoardView observe(const FringeStack& stack, const RigModel& rig, const Board& board,
                  const RigCalibrationOptions& options) {
  const DecodedStack columns = decode(stack, rig, {}, {Axis::columns});
  const DecodedStack rows = decode(stack, rig, {}, {Axis::rows});
  cv::Mat1f texture;
  cv::addWeighted(columns.mean, 0.5, rows.mean, 0.5, 0, texture);
  return observe_board("view " + std::to_string(stack.index), texture,
                       {columns.coordinate_px, rows.coordinate_px, columns.sigma_px, rows.sigma_px}, board, options);
}

}  // namespace

void bind_calibration(py::module_& m) {
  bind_options<RigCalibrationOptions>(m, "CalibrationOptions", "calibration", "Options of the rig's calibration.");
  py::class_<Board>(m, "Board", "A planar calibration board; the board frame has z = 0 and its origin at the centre.")
      .def(py::init([](BoardKind kind, int columns, int rows, double spacing_m, double diameter_m, double marker_m) {
             Board board;
             board.kind = kind;
             board.columns = columns;
             board.rows = rows;
             board.spacing_m = spacing_m;
             board.diameter_m = diameter_m;
             board.marker_m = marker_m;
             return board;
           }),
           py::arg("kind") = "checkerboard", py::arg("columns") = 9, py::arg("rows") = 6, py::arg("spacing_m") = 0.02,
           py::arg("diameter_m") = 0, py::arg("marker_m") = 0,
           "`columns` and `rows` are numbers of inner corners or circles; `kind` is 'checkerboard', 'circles', "
           "'asymmetric_circles' or 'charuco'.")
      .def_readonly("columns", &Board::columns)
      .def_readonly("rows", &Board::rows)
      .def_readonly("spacing_m", &Board::spacing_m);
  py::class_<BoardView>(m, "BoardView", "Corners of a board in the images of camera and projector.")
      .def_property_readonly("found", [](const BoardView& view) { return !view.corners_px.empty(); })
      .def_property_readonly(
          "corners_px",
          [](const BoardView& view) {
            Eigen::Matrix<float, Eigen::Dynamic, 2, Eigen::RowMajor> corners(
                static_cast<Eigen::Index>(view.corners_px.size()), 2);
            for (size_t i = 0; i < view.corners_px.size(); ++i)
              corners.row(static_cast<Eigen::Index>(i)) << view.corners_px[i].x, view.corners_px[i].y;
            return corners;
          },
          "(N, 2), camera, px.");
  py::class_<LensSigmas>(m, "LensSigmas", "Standard deviations of a lens's parameters.")
      .def_readonly("fx", &LensSigmas::fx)
      .def_readonly("fy", &LensSigmas::fy)
      .def_readonly("cx", &LensSigmas::cx)
      .def_readonly("cy", &LensSigmas::cy)
      .def_readonly("distortion", &LensSigmas::distortion);
  py::class_<RigCalibration>(m, "RigCalibration", "A calibrated rig and its uncertainty.")
      .def_readonly("rig", &RigCalibration::rig)
      .def_readonly("camera_sigma", &RigCalibration::camera_sigma)
      .def_readonly("projector_sigma", &RigCalibration::projector_sigma)
      .def_readonly("rotation_sigma_rad", &RigCalibration::rotation_sigma_rad, "(3,), of projector_from_camera.")
      .def_readonly("translation_sigma_m", &RigCalibration::translation_sigma_m, "(3,), of projector_from_camera.")
      .def_readonly("covariance", &RigCalibration::covariance,
                    "24 x 24: camera (fx fy cx cy k1 k2 p1 p2 k3), projector (the same), projector_from_camera "
                    "(rotation, translation).")
      .def_readonly("camera_rms_px", &RigCalibration::camera_rms_px)
      .def_readonly("projector_rms_px", &RigCalibration::projector_rms_px)
      .def_readonly("warnings", &RigCalibration::warnings, "Reasons to doubt the calibration.");
  m.def(
      "observe_board",
      [](const FringeStack& stack, const RigModel& rig, const Board& board, const py::object& options) {
        const auto calibration = options_of<RigCalibrationOptions>("calibration", options);
        const py::gil_scoped_release release;
        return observe(stack, rig, board, calibration);
      },
      py::arg("stack"), py::arg("rig"), py::arg("board"), py::arg("options") = py::none(),
      "Finds a board in a stack with fringes along both axes. Options: CalibrationOptions.");
  m.def(
      "calibrate_rig",
      [](const std::vector<BoardView>& views, const Board& board, const RigModel& rig, const py::object& options) {
        const auto calibration = options_of<RigCalibrationOptions>("calibration", options);
        const py::gil_scoped_release release;
        return calibrate_rig(views, board, rig, calibration);
      },
      py::arg("views"), py::arg("board"), py::arg("rig"), py::arg("options") = py::none(),
      "Calibrates lenses and relative pose from views of a board (docs/method.md, section 11.1); image sizes, sensor "
      "and mount are those of `rig`. Raises Error if the views do not determine the rig. Options: CalibrationOptions.");
}

}  // namespace fringeslam::python
