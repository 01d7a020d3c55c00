// SPDX-License-Identifier: Apache-2.0
#include "python/src/python_objects.h"

#include "core/depth/triangulation.h"

namespace fringeslam::python {

namespace {

class PythonRig : public Rig {
 public:
  explicit PythonRig(py::object rig) : model_(rig.attr("model").cast<RigModel>()), rig_(std::move(rig)) {}
  const RigModel& model() const override { return model_; }
  std::optional<FringeStack> capture(const PatternSequence& sequence) override {
    return call_python([&]() -> std::optional<FringeStack> {
      const py::object stack = (*rig_).attr("capture")(sequence);
      if (stack.is_none()) return std::nullopt;
      if (!py::isinstance<FringeStack>(stack))
        throw Error("capture() must return a FringeStack or None, not " + type_name(stack));
      return stack.cast<FringeStack>();
    });
  }
  // A recording cannot show other patterns; a rig that can says so.
  bool can_change_patterns() const override {
    return call_python([&] { return py::getattr(*rig_, "can_change_patterns", py::bool_(false)).cast<bool>(); });
  }

 private:
  RigModel model_;
  Held rig_;
};

// Mean of the images, as texture for a decoder that returns coordinates only.
cv::Mat1f mean_image(const FringeStack& stack) {
  cv::Mat1f mean(stack.images.front().size(), 0.f);
  for (const cv::Mat& image : stack.images) {
    cv::Mat1f grey;
    image.convertTo(grey, CV_32F, 1.0 / static_cast<double>(stack.images.size()));
    mean += grey;
  }
  return mean;
}

class PythonFrontEnd : public FrontEnd {
 public:
  PythonFrontEnd(py::object decode, const RigModel& rig, const DepthOptions& depth)
      : decode_(std::move(decode)),
        rig_(rig),
        depth_(depth),
        triangulation_(rig, pixel_rays(rig.camera), depth.near_m, depth.far_m) {}

  ReconstructedView reconstruct(const FringeStack& stack, const ReconstructionPrior&) const override {
    ReconstructedView view = call_python([&] { return result_of(stack); });
    if (view.decoded.coordinate_px.empty()) {
      view.frame.index = stack.index;
      view.frame.timestamp_s = stack.timestamp_s;
      require_size(view.frame.points_m, "points_m");
      require_size(view.frame.sigma_m, "sigma_m");
      require_size(view.frame.normals, "normals");
      require_size(view.frame.texture, "texture");
      view.frame.depth_image = depth_image(view.frame.points_m, depth_.near_m, depth_.far_m);
      return view;
    }
    require_size(view.decoded.coordinate_px, "coordinate_px");
    require_size(view.decoded.sigma_px, "sigma_px");
    view.decoded.index = stack.index;
    view.decoded.timestamp_s = stack.timestamp_s;
    view.decoded.full_scale_dn = rig_.sensor.max_dn();
    view.decoded.mean = mean_image(stack);
    view.frame = fringeslam::reconstruct(view.decoded, rig_, triangulation_, depth_);
    return view;
  }

 private:
  // Calls the function; the view has either a frame or coordinates.
  ReconstructedView result_of(const FringeStack& stack) const {
    ReconstructedView view;
    const py::object result = (*decode_)(FringeStack(stack));  // a copy, which shares the images
    if (py::isinstance<Frame>(result)) {
      view.frame = result.cast<Frame>();
      return view;
    }
    if (!py::isinstance<py::tuple>(result) || py::len(result) != 2)
      throw Error("a decoder must return a Frame or (coordinate_px, sigma_px), not " + type_name(result));
    const auto images = result.cast<py::tuple>();
    view.decoded.coordinate_px = image_of(images[0], {CV_32FC1}, true);
    view.decoded.sigma_px = image_of(images[1], {CV_32FC1}, true);
    return view;
  }

  void require_size(const cv::Mat& image, const std::string& name) const {
    const cv::Size size(rig_.camera.width, rig_.camera.height);
    if (image.size() == size) return;
    throw Error("the decoder's " + name + " has " + std::to_string(image.rows) + " x " + std::to_string(image.cols) +
                " pixels (H x W), the camera " + std::to_string(size.height) + " x " + std::to_string(size.width));
  }

  Held decode_;
  RigModel rig_;
  DepthOptions depth_;
  Triangulation triangulation_;
};

}  // namespace

std::shared_ptr<Rig> rig_of(const py::object& rig) {
  if (py::isinstance<Rig>(rig)) return rig.cast<std::shared_ptr<Rig>>();
  if (py::hasattr(rig, "model") && py::hasattr(rig, "capture")) return std::make_shared<PythonRig>(rig);
  throw py::type_error("expected a rig with 'model' and 'capture(patterns)', not " + type_name(rig));
}

std::shared_ptr<const FrontEnd> front_end_of(const py::object& object, const RigModel& rig, const DepthOptions& depth) {
  if (py::isinstance<FrontEnd>(object)) return object.cast<std::shared_ptr<FrontEnd>>();
  if (PyCallable_Check(object.ptr())) return std::make_shared<PythonFrontEnd>(object, rig, depth);
  throw py::type_error("expected a front end or a function of a FringeStack, not " + type_name(object));
}

}  // namespace fringeslam::python
