// SPDX-License-Identifier: Apache-2.0
// Values that stages exchange: lenses, rigs, patterns, stacks, frames, trajectories, ground truth.
#include "core/io/files.h"
#include "core/patterns/design.h"
#include "core/patterns/patterns.h"
#include "core/rig/rig_file.h"
#include "core/score/trajectory_file.h"
#include "core/types/camera_motion.h"
#include "core/types/decoded_stack.h"
#include "core/types/frame.h"
#include "core/types/fringe_stack.h"
#include "core/types/rig_model.h"
#include "core/types/trajectory.h"
#include "core/types/truth.h"
#include "python/src/bindings.h"
#include "python/src/casters.h"

namespace fringeslam::python {

namespace {

void bind_lenses(py::module_& m) {
  py::class_<Distortion>(m, "Distortion", "Brown-Conrady distortion, dimensionless; OpenCV's order k1 k2 p1 p2 k3.")
      .def(py::init([](double k1, double k2, double p1, double p2, double k3) {
             return Distortion{k1, k2, p1, p2, k3};
           }),
           py::arg("k1") = 0, py::arg("k2") = 0, py::arg("p1") = 0, py::arg("p2") = 0, py::arg("k3") = 0)
      .def_readwrite("k1", &Distortion::k1)
      .def_readwrite("k2", &Distortion::k2)
      .def_readwrite("p1", &Distortion::p1)
      .def_readwrite("p2", &Distortion::p2)
      .def_readwrite("k3", &Distortion::k3);
  py::class_<Pinhole>(m, "Pinhole",
                      "Pinhole camera or projector, px. Integer pixel coordinates are pixel centres, as in OpenCV.")
      .def(py::init([](int width, int height, double fx, double fy, double cx, double cy, const Distortion& d) {
             return Pinhole{width, height, fx, fy, cx, cy, d};
           }),
           py::arg("width"), py::arg("height"), py::arg("fx"), py::arg("fy"), py::arg("cx"), py::arg("cy"),
           py::arg("distortion") = Distortion{})
      .def_readwrite("width", &Pinhole::width)
      .def_readwrite("height", &Pinhole::height)
      .def_readwrite("fx", &Pinhole::fx)
      .def_readwrite("fy", &Pinhole::fy)
      .def_readwrite("cx", &Pinhole::cx)
      .def_readwrite("cy", &Pinhole::cy)
      .def_readwrite("distortion", &Pinhole::distortion)
      .def_property_readonly(
          "matrix",
          [](const Pinhole& p) {
            Eigen::Matrix3d k;
            k << p.fx, 0, p.cx, 0, p.fy, p.cy, 0, 0, 1;
            return k;
          },
          "Camera matrix K, 3 x 3, px.")
      .def("project", &Pinhole::project, py::arg("point"),
           "Projects a point (3,) in the device frame, m, to a pixel (2,).")
      .def("undistort", &Pinhole::undistort, py::arg("pixel"),
           "Returns the normalised image coordinates (x/z, y/z) of a pixel; NaN where the distortion cannot be "
           "inverted.")
      .def("rays", &pixel_rays, ReleaseGil(), "Returns the viewing rays (x/z, y/z) of all pixels, float32 (H, W, 2).");
}

void bind_rig_model(py::module_& m) {
  py::class_<SensorModel>(m, "SensorModel", "Noise parameters of the camera as defined by EMVA 1288.")
      .def(py::init<>())
      .def_readwrite("bits", &SensorModel::bits)
      .def_readwrite("gain_dn_per_electron", &SensorModel::gain_dn_per_electron, "EMVA's overall system gain K.")
      .def_readwrite("dark_noise_electrons", &SensorModel::dark_noise_electrons, "Temporal, standard deviation.")
      .def_readwrite("full_well_electrons", &SensorModel::full_well_electrons)
      .def_readwrite("offset_dn", &SensorModel::offset_dn, "Black level.")
      .def_readwrite("quantum_efficiency", &SensorModel::quantum_efficiency)
      .def_readwrite("dark_current_electrons_s", &SensorModel::dark_current_electrons_s)
      .def_readwrite("dsnu_electrons", &SensorModel::dsnu_electrons)
      .def_readwrite("prnu", &SensorModel::prnu)
      .def_property_readonly("max_dn", &SensorModel::max_dn, "Largest grey value, DN.")
      .def("variance_dn2", &SensorModel::variance_dn2, py::arg("grey_dn"),
           "Returns the temporal variance of a grey value, DN^2 (EMVA 1288 eq. 9).");
  py::class_<Timing>(m, "Timing", "Clock of the rig.")
      .def(py::init<>())
      .def_readwrite("pattern_rate_hz", &Timing::pattern_rate_hz)
      .def_readwrite("camera_rate_hz", &Timing::camera_rate_hz)
      .def_readwrite("exposure_s", &Timing::exposure_s);
  py::class_<RigModel>(m, "RigModel",
                       "A calibrated rig: camera, projector, their relative pose and the camera's noise.")
      .def(py::init<>())
      .def_readwrite("name", &RigModel::name)
      .def_readwrite("calibrated", &RigModel::calibrated, "False: nominal values, not usable for measurement.")
      .def_readwrite("camera", &RigModel::camera)
      .def_readwrite("projector", &RigModel::projector)
      .def_readwrite("projector_from_camera", &RigModel::projector_from_camera, "4 x 4.")
      .def_readwrite("robot_from_camera", &RigModel::robot_from_camera, "4 x 4.")
      .def_readwrite("sensor", &RigModel::sensor)
      .def_readwrite("timing", &RigModel::timing)
      .def_readwrite("near_m", &RigModel::near_m, "Near end of the working range along the camera's z axis, m.")
      .def_readwrite("far_m", &RigModel::far_m, "Far end of the working range, m.")
      .def(
          "to_yaml", [](const RigModel& rig) { return to_yaml(rig); }, "Returns the content of a rig file.")
      .def("__repr__", [](const RigModel& rig) {
        return "RigModel('" + rig.name + "', camera " + std::to_string(rig.camera.width) + " x " +
               std::to_string(rig.camera.height) + ", projector " + std::to_string(rig.projector.width) + " x " +
               std::to_string(rig.projector.height) + ")";
      });
  m.def("read_rig", py::overload_cast<const std::filesystem::path&>(&read_rig), py::arg("file"),
        "Reads rig.yaml. Raises Error with file:line.");
}

void bind_patterns(py::module_& m) {
  py::class_<Pattern>(m, "Pattern", "One projected image; intensities are defined in docs/method.md, section 2.")
      .def(py::init([](double period_px, double shift_rad, Axis axis, Coding coding, int bits, bool inverted,
                       double level, double carrier_px) {
             Pattern pattern;
             pattern.period_px = period_px;
             pattern.shift_rad = shift_rad;
             pattern.axis = axis;
             pattern.coding = coding;
             pattern.bits = bits;
             pattern.inverted = inverted;
             pattern.level = level;
             pattern.carrier_px = carrier_px;
             return pattern;
           }),
           py::arg("period_px") = 0, py::arg("shift_rad") = 0, py::arg("axis") = "columns",
           py::arg("coding") = "fringe", py::arg("bits") = 8, py::arg("inverted") = false, py::arg("level") = 0,
           py::arg("carrier_px") = 0)
      .def_readwrite("axis", &Pattern::axis, "'columns' or 'rows': the coded projector coordinate.")
      .def_readwrite("coding", &Pattern::coding, "'fringe', 'gray', 'flat', 'extra' or 'product'.")
      .def_readwrite("period_px", &Pattern::period_px, "Fringe period, or width of a Gray code's cells, px.")
      .def_readwrite("shift_rad", &Pattern::shift_rad, "Phase shift.")
      .def_readwrite("bits", &Pattern::bits, "Bit depth of the projector.")
      .def_readwrite("inverted", &Pattern::inverted, "gray: 1 - bit.")
      .def_readwrite("level", &Pattern::level, "flat: 0 black to 1 white.")
      .def_readwrite("carrier_px", &Pattern::carrier_px,
                     "product: period of the second cosine; gray: cells of the bit combined by XOR, 0: none.")
      .def("__eq__", [](const Pattern& a, const Pattern& b) { return a == b; })
      .def("__repr__", [](const Pattern& p) {
        return std::string("Pattern(period_px=") + to_text(p.period_px) + ", shift_rad=" + to_text(p.shift_rad) +
               ", axis='" + to_string(p.axis) + "', coding='" + to_string(p.coding) + "')";
      });
  py::class_<PatternSequence>(m, "PatternSequence", "The images that the projector shows for one stack.")
      .def(py::init([](int width, int height, std::vector<Pattern> patterns) {
             return PatternSequence{width, height, std::move(patterns), {}};
           }),
           py::arg("width"), py::arg("height"), py::arg("patterns"))
      .def_readonly("width", &PatternSequence::width, "Projector image, px.")
      .def_readonly("height", &PatternSequence::height)
      .def_readonly("patterns", &PatternSequence::patterns)
      .def("__len__", [](const PatternSequence& s) { return s.patterns.size(); })
      .def("__getitem__",
           [](const PatternSequence& s, size_t i) {
             if (i >= s.patterns.size()) throw py::index_error("the sequence has fewer patterns");
             return s.patterns[i];
           })
      .def("__eq__", [](const PatternSequence& a, const PatternSequence& b) { return a == b; })
      .def(
          "images",
          [](const PatternSequence& sequence) {
            std::vector<cv::Mat> images;
            for (const Pattern& pattern : sequence.patterns) images.push_back(pattern_image(pattern, sequence));
            return images;
          },
          "Returns the images for the projector, uint8 (height, width), uint16 for patterns of more than 8 bits.")
      .def(
          "finest", [](const PatternSequence& s) { return finest_patterns(s, Axis::columns); },
          "Returns the sequence reduced to its finest period along the columns.")
      .def(
          "to_yaml", [](const PatternSequence& s) { return to_yaml(s); }, "Returns the content of patterns.yaml.");
  m.def(
      "read_image", [](const std::filesystem::path& file) { return read_as_grey(file, GreyFrom::luminance); },
      py::arg("file"), "Reads an image as grey values: uint8, uint16 or float32 (H, W).");
  m.def(
      "write_image",
      [](const std::filesystem::path& file, const cv::Mat& image) {
        StagedFile staged(file);
        write_png(staged.path(), image);
        staged.commit();
      },
      py::arg("file"), py::arg("image"), "Writes a PNG file of a grey image, uint8 or uint16 (H, W).");
  m.def("read_patterns", py::overload_cast<const std::filesystem::path&>(&read_patterns), py::arg("file"),
        "Reads patterns.yaml. Raises Error with file:line.");
  m.def(
      "design_patterns",
      [](int width, int height, std::vector<double> periods_px, int steps, bool columns, bool rows, GrayCode gray,
         bool gray_inverted, std::vector<double> gray_xor_px, bool white_black, int ramp_levels, int bits,
         bool dithered, double gray_cell_px, double micro_period_px, int micro_images, double modulated_period_px,
         bool gray_long_runs) {
        SequenceDesign design;
        design.width = width;
        design.height = height;
        design.periods_px = std::move(periods_px);
        design.steps = steps;
        design.columns = columns;
        design.rows = rows;
        design.gray = gray;
        design.gray_inverted = gray_inverted;
        design.gray_xor_px = std::move(gray_xor_px);
        design.gray_long_runs = gray_long_runs;
        design.white_black = white_black;
        design.ramp_levels = ramp_levels;
        design.bits = bits;
        design.dithered = dithered;
        design.gray_cell_px = gray_cell_px;
        design.micro_period_px = micro_period_px;
        design.modulated_period_px = modulated_period_px;
        design.micro_images = micro_images;
        return design_sequence(design);
      },
      py::arg("width"), py::arg("height"), py::arg("periods_px") = std::vector<double>{}, py::kw_only(),
      py::arg("steps") = 3, py::arg("columns") = true, py::arg("rows") = false, py::arg("gray") = "none",
      py::arg("gray_inverted") = false, py::arg("gray_xor_px") = std::vector<double>{}, py::arg("white_black") = false,
      py::arg("ramp_levels") = 0, py::arg("bits") = 8, py::arg("dithered") = false, py::arg("gray_cell_px") = 0,
      py::arg("micro_period_px") = 0, py::arg("micro_images") = 0, py::arg("modulated_period_px") = 0,
      py::arg("gray_long_runs") = false,
      "Builds a pattern sequence: micro and modulated phase shifting, fringes period by period, then the Gray code "
      "('none', 'plain' "
      "or "
      "'complementary'), flat images last; columns before rows.");
}

void bind_stacks(py::module_& m) {
  py::class_<FringeStack>(m, "FringeStack", "The camera images of one pattern sequence. Contains no ground truth.")
      .def(py::init([](std::vector<cv::Mat> images, const PatternSequence& patterns, int index, double timestamp_s,
                       std::optional<std::vector<double>> exposure_time_s, double exposure_s) {
             FringeStack stack;
             stack.index = index;
             stack.timestamp_s = timestamp_s;
             stack.patterns = patterns;
             stack.exposure_s.assign(images.size(), exposure_s);
             stack.exposure_time_s =
                 exposure_time_s ? *exposure_time_s : fringeslam::exposure_times_s(timestamp_s, images.size(), {});
             stack.images = std::move(images);
             check_stack(stack);
             return stack;
           }),
           py::arg("images"), py::arg("patterns"), py::arg("index") = 0, py::arg("timestamp_s") = 0,
           py::arg("exposure_time_s") = py::none(), py::arg("exposure_s") = 1.0 / 360,
           "Raises Error unless there is one grey image per pattern, all of the same size and type. Without "
           "exposure_time_s, the images were taken at 90 Hz around timestamp_s.")
      .def_readwrite("index", &FringeStack::index, "Position in the recording, from 0.")
      .def_readwrite("timestamp_s", &FringeStack::timestamp_s, "Time of the view's pose and depth.")
      .def_readwrite("patterns", &FringeStack::patterns, "One pattern per image.")
      .def_readwrite("images", &FringeStack::images,
                     "List of grey images (H, W), DN: uint8, uint16, or float32 if unquantised.")
      .def_readwrite("exposure_s", &FringeStack::exposure_s, "Duration, one per image.")
      .def_readwrite("exposure_time_s", &FringeStack::exposure_time_s, "Middle of each exposure.")
      .def_readwrite("thermal_c", &FringeStack::thermal_c,
                     "Apparent temperature in the thermal camera's pixels; None without a thermal camera.")
      .def("__len__", [](const FringeStack& stack) { return stack.images.size(); });
  py::class_<DecodedStack>(m, "DecodedStack", "Projector coordinates of the camera's pixels. All images are (H, W).")
      .def(py::init<>())
      .def_readwrite("index", &DecodedStack::index)
      .def_readwrite("timestamp_s", &DecodedStack::timestamp_s)
      .def_readonly("unwrapping", &DecodedStack::unwrapping, "Method used, or None.")
      .def_readwrite("mean", &DecodedStack::mean, "I', DN.")
      .def_readwrite("modulation", &DecodedStack::modulation, "I'' of the finest period, DN.")
      .def_readwrite("wrapped_phase", &DecodedStack::wrapped_phase, "Finest period, rad, (-pi, pi]; NaN: no fringes.")
      .def_readwrite("fringe_order", &DecodedStack::fringe_order, "Number of whole periods; -1: unknown.")
      .def_readwrite("coordinate_px", &DecodedStack::coordinate_px,
                     "Projector column (or row), integer at pixel centres; NaN: unknown.")
      .def_readwrite("sigma_px", &DecodedStack::sigma_px, "Standard deviation of coordinate_px.")
      .def_readwrite("confidence", &DecodedStack::confidence, "Probability that the fringe order is correct.")
      .def_readonly("finest_period_px", &DecodedStack::finest_period_px);
  py::class_<Frame>(m, "Frame", "One reconstructed view. All images are (H, W) in the camera's pixels; NaN: no depth.")
      .def(py::init<>())
      .def_readwrite("index", &Frame::index)
      .def_readwrite("timestamp_s", &Frame::timestamp_s)
      .def_readwrite("texture", &Frame::texture, "Fringe-free intensity, uint8.")
      .def_readwrite("depth_image", &Frame::depth_image, "uint8; near is bright, 0: no depth.")
      .def_readwrite("points_m", &Frame::points_m, "Points in the camera frame, float32 (H, W, 3); z is the depth.")
      .def_readwrite("sigma_m", &Frame::sigma_m, "Standard deviation of the depth z.")
      .def_readwrite("normals", &Frame::normals, "Unit normals in the camera frame, facing the camera, (H, W, 3).")
      .def_property_readonly(
          "depth_m",
          [](const Frame& frame) -> py::object {
            if (frame.points_m.empty()) return py::none();
            return py::cast(frame.points_m)[py::make_tuple(py::ellipsis(), 2)];
          },
          "Depth z, m: a view of points_m.");
}

Trajectory trajectory_of(const std::vector<double>& timestamps_s, const std::vector<Pose>& poses) {
  if (timestamps_s.size() != poses.size()) throw Error("a trajectory needs as many timestamps as poses");
  Trajectory trajectory;
  for (size_t i = 0; i < poses.size(); ++i) trajectory.push_back({timestamps_s[i], poses[i]});
  return trajectory;
}

void bind_trajectories(py::module_& m) {
  py::class_<Trajectory>(m, "Trajectory", "Timed poses of the robot in the world frame.")
      .def(py::init(&trajectory_of), py::arg("timestamps_s"), py::arg("world_from_robot"))
      .def("__len__", [](const Trajectory& t) { return t.size(); })
      .def(
          "__getitem__",
          [](const Trajectory& t, py::ssize_t i) {
            const auto size = static_cast<py::ssize_t>(t.size());
            if (i < 0) i += size;
            if (i < 0 || i >= size) throw py::index_error("the trajectory has fewer poses");
            const TimedPose& pose = t[static_cast<size_t>(i)];
            return std::pair(pose.timestamp_s, pose.world_from_robot);
          },
          "Returns (timestamp_s, world_from_robot).")
      .def_property_readonly(
          "timestamps_s",
          [](const Trajectory& t) {
            Eigen::VectorXd times(static_cast<Eigen::Index>(t.size()));
            for (size_t i = 0; i < t.size(); ++i) times[static_cast<Eigen::Index>(i)] = t[i].timestamp_s;
            return times;
          },
          "(N,)")
      .def_property_readonly(
          "world_from_robot",
          [](const Trajectory& t) {
            py::array_t<double> poses({static_cast<py::ssize_t>(t.size()), py::ssize_t{4}, py::ssize_t{4}});
            for (size_t i = 0; i < t.size(); ++i) poses[py::int_(i)] = matrix_of(t[i].world_from_robot);
            return poses;
          },
          "(N, 4, 4)")
      .def("to_tum", &to_tum, "Returns the trajectory in TUM RGB-D format.");
  m.def("read_trajectory", &read_trajectory, py::arg("file"),
        "Reads a trajectory in TUM or EuRoC format. Raises Error with file:line.");
}

void bind_truth(py::module_& m) {
  m.attr("TRUTH_SURFACE") = static_cast<int>(kTruthSurface);
  m.attr("TRUTH_IN_BEAM") = static_cast<int>(kTruthInBeam);
  m.attr("TRUTH_IN_SHADOW") = static_cast<int>(kTruthInShadow);
  m.attr("TRUTH_MIXED") = static_cast<int>(kTruthMixed);
  m.attr("TRUTH_VICTIM") = static_cast<int>(kTruthVictim);
  m.attr("TRUTH_THERMAL") = static_cast<int>(kTruthThermal);
  py::class_<TruthFrame>(m, "TruthFrame", "Exact ground truth of one view, on the rays through the pixel centres.")
      .def_readonly("index", &TruthFrame::index)
      .def_readonly("timestamp_s", &TruthFrame::timestamp_s)
      .def_readonly("world_from_robot", &TruthFrame::world_from_robot, "4 x 4.")
      .def_readonly("exposures", &TruthFrame::exposures, "Robot poses at the middle of each exposure.")
      .def_readonly("depth_m", &TruthFrame::depth_m, "Camera z; NaN: no surface.")
      .def_readonly("position_m", &TruthFrame::position_m, "World frame, (H, W, 3).")
      .def_readonly("normals", &TruthFrame::normals, "Unit, camera frame, (H, W, 3).")
      .def_readonly("object_id", &TruthFrame::object_id, "From 1, in the scene's order; 0: none.")
      .def_readonly("projector_column", &TruthFrame::projector_column, "px; NaN outside the projector's field.")
      .def_readonly("projector_row", &TruthFrame::projector_row)
      .def_readonly("temperature_c", &TruthFrame::temperature_c)
      .def_readonly("indirect_share", &TruthFrame::indirect_share,
                    "Share of the projector's light that other surfaces sent or that came from below this one; None if "
                    "no such light was simulated, and in motion.")
      .def_readonly("mask", &TruthFrame::mask, "Sum of the TRUTH_ bits, float32.");
}

void bind_motion(py::module_& m) {
  py::class_<StackMotion>(m, "StackMotion", "Motion of the camera during a stack.")
      .def_readonly("converged", &StackMotion::converged, "False: the motion is unknown.")
      .def_property_readonly(
          "velocity_m_s", [](const StackMotion& s) { return s.motion.velocity_m_s; }, "(3,), camera frame.")
      .def_property_readonly(
          "angular_rad_s", [](const StackMotion& s) { return s.motion.angular_rad_s; }, "(3,), camera frame.")
      .def_readonly("covariance", &StackMotion::covariance,
                    "12 x 12, of (angular rate, velocity, angular acceleration, acceleration).");
}

}  // namespace

void bind_types(py::module_& m) {
  bind_lenses(m);
  bind_rig_model(m);
  bind_patterns(m);
  bind_trajectories(m);
  bind_stacks(m);
  bind_truth(m);
  bind_motion(m);
}

}  // namespace fringeslam::python
