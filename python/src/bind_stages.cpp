// SPDX-License-Identifier: Apache-2.0
// The stages as functions: decode, reconstruct, register.
#include "core/decode/decode.h"
#include "core/depth/depth.h"
#include "core/io/files.h"
#include "core/io/ply.h"
#include "core/map/mesh.h"
#include "core/mapper/front_end.h"
#include "core/registration/icp.h"
#include "core/types/linear_algebra.h"
#include "python/src/bindings.h"
#include "python/src/options.h"

namespace fringeslam::python {

namespace {

Frame reconstruct_frame(const DecodedStack& decoded, const RigModel& rig, const py::object& options,
                        const py::kwargs& changes) {
  const auto depth = options_of<DepthOptions>("depth", options, changes);
  const py::gil_scoped_release release;
  return reconstruct(decoded, rig, pixel_rays(rig.camera), depth);
}

// Covariance from an information matrix; NaN where the surfaces do not determine the pose.
Matrix6d covariance_of(const IcpResult& result) {
  constexpr double kLeastRcond = 1e-15;
  const auto covariance = inverse_if_well_conditioned(result.information, kLeastRcond);
  return covariance ? *covariance : Matrix6d::Constant(std::numeric_limits<double>::quiet_NaN());
}

// Throws Error unless a frame has all images; frames of users may lack some.
void require_images(const Frame& frame, const char* name) {
  const cv::Size size = frame.points_m.size();
  if (size.area() == 0 || frame.sigma_m.size() != size || frame.normals.size() != size || frame.texture.size() != size)
    throw Error(std::string(name) + ": needs points_m, sigma_m, normals and texture of the same size");
}

void bind_registration(py::module_& m) {
  py::class_<IcpResult>(m, "IcpResult", "Registration of two frames.")
      .def_readonly("target_from_source", &IcpResult::target_from_source, "4 x 4.")
      .def_readonly("converged", &IcpResult::converged)
      .def_readonly("iterations", &IcpResult::iterations)
      .def_readonly("pairs", &IcpResult::pairs)
      .def_readonly("overlap", &IcpResult::overlap, "Pairs / source points with a normal.")
      .def_readonly("consistency", &IcpResult::consistency, "Pairs / source points that fall on a target surface.")
      .def_readonly("rms_m", &IcpResult::rms_m)
      .def_readonly("rms_sigma", &IcpResult::rms_sigma, "RMS residual in sigmas; 1 if the sigmas are correct.")
      .def_readonly("information", &IcpResult::information,
                    "6 x 6, of (rotation, rad; translation, m), both applied from the left (core/types/pose.h).")
      .def_property_readonly("covariance", &covariance_of, "Inverse of `information`; NaN if it is singular.");
  m.def(
      "register_frames",
      [](const Frame& target, const Frame& source, const Pinhole& camera, const std::optional<Pose>& initial,
         const py::object& options, const py::kwargs& changes) {
        const auto icp = options_of<IcpOptions>("icp", options, changes);
        require_images(target, "target");
        require_images(source, "source");
        const py::gil_scoped_release release;
        return initial ? point_to_plane_icp(target, source, camera, *initial, icp)
                       : register_frames(target, source, camera, icp);
      },
      py::arg("target"), py::arg("source"), py::arg("camera"), py::arg("initial") = py::none(),
      py::arg("options") = py::none(),
      "Registers two frames of the same camera by point-to-plane ICP (docs/method.md, section 7.1), from the pose "
      "`initial` of the source in the target's frame; without one, rotations up to about 20 degrees and translations "
      "up "
      "to 15 cm are searched. Options: IcpOptions.");
}

}  // namespace

void bind_stages(py::module_& m) {
  m.def(
      "decode",
      [](const FringeStack& stack, const RigModel& rig, const py::object& options, Axis axis,
         const py::kwargs& changes) {
        const auto decode_options = options_of<DecodeOptions>("decode", options, changes);
        const py::gil_scoped_release release;
        DecodeContext context;
        context.axis = axis;
        return decode(stack, rig, decode_options, context);
      },
      py::arg("stack"), py::arg("rig"), py::arg("options") = py::none(), py::arg("axis") = "columns",
      "Decodes a stack of a camera at rest to projector coordinates (docs/method.md, section 3). Options: "
      "DecodeOptions. Raises Error if the patterns do not support the unwrapping method.");
  m.def("reconstruct", &reconstruct_frame, py::arg("decoded"), py::arg("rig"), py::arg("options") = py::none(),
        "Triangulates decoded coordinates to a Frame (docs/method.md, section 4). Options: DepthOptions.");
  m.def(
      "reconstruct_coordinates",
      [](const cv::Mat1f& coordinate_px, const cv::Mat1f& sigma_px, const RigModel& rig, const cv::Mat1f& texture,
         const py::object& options, const py::kwargs& changes) {
        DecodedStack decoded;
        decoded.coordinate_px = coordinate_px;
        decoded.sigma_px = sigma_px;
        decoded.full_scale_dn = rig.sensor.max_dn();
        decoded.mean = texture.empty() ? cv::Mat1f(coordinate_px.size(), 0.f) : texture;
        return reconstruct_frame(decoded, rig, options, changes);
      },
      py::arg("coordinate_px"), py::arg("sigma_px"), py::arg("rig"), py::arg("texture") = py::none(),
      py::arg("options") = py::none(),
      "Triangulates coordinates of any decoder to a Frame: projector columns and their standard deviations, (H, W), "
      "NaN "
      "where unknown. Options: DepthOptions.");
  py::class_<FrontEnd, std::shared_ptr<FrontEnd>>(m, "FrontEnd", "Reconstructs stacks without a map.")
      .def(
          "reconstruct",
          [](const FrontEnd& front_end, const FringeStack& stack) { return front_end.reconstruct(stack, {}).frame; },
          py::arg("stack"), ReleaseGil(), "Reconstructs a stack of a camera at rest to a Frame.")
      .def(
          "reconstruct_moving",
          [](const FrontEnd& front_end, const FringeStack& stack) {
            ReconstructionPrior prior;
            prior.motion = unknown_motion({});
            ReconstructedView view = front_end.reconstruct(stack, prior);
            return std::pair(std::move(view.frame), std::move(view.motion));
          },
          py::arg("stack"), ReleaseGil(),
          "Estimates the motion during a stack from its own images (docs/method.md, section 9) and compensates it; "
          "returns (Frame, StackMotion).");
  py::class_<FringeFrontEnd, FrontEnd, std::shared_ptr<FringeFrontEnd>>(
      m, "FringeFrontEnd", "Decodes and triangulates fringes; rays and triangulation are prepared once per rig.")
      .def(py::init([](const RigModel& rig, const PatternSequence& patterns, const py::object& decode,
                       const py::object& depth, bool at_rest) {
             return std::make_shared<FringeFrontEnd>(
                 rig, patterns,
                 FrontEndOptions{options_of<DecodeOptions>("decode", decode), options_of<DepthOptions>("depth", depth),
                                 at_rest});
           }),
           py::arg("rig"), py::arg("patterns"), py::arg("decode") = py::none(), py::arg("depth") = py::none(),
           py::arg("at_rest") = false);
  m.def(
      "write_ply",
      [](const std::filesystem::path& file, const Frame& frame, const py::object& options) {
        const auto mesh = options_of<MeshOptions>("mesh", options);
        require_images(frame, "frame");
        const py::gil_scoped_release release;
        StagedFile staged(file);
        write_text(staged.path(), to_ply(frame_mesh(frame, mesh), "camera"));
        staged.commit();
      },
      py::arg("file"), py::arg("frame"), py::arg("options") = py::none(),
      "Writes a frame's surface as a PLY mesh in the camera frame. Options: MeshOptions.");
  bind_registration(m);
}

}  // namespace fringeslam::python
