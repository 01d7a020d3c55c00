// SPDX-License-Identifier: Apache-2.0
#include "python/src/casters.h"

#include <algorithm>
#include <cmath>

#include "core/types/error.h"

namespace fringeslam::python {

namespace {

// Releases NumPy arrays whose memory images use. OpenCV frees an image in whichever thread drops it last.
class ArrayAllocator : public cv::MatAllocator {
 public:
  // Keeps `array` alive as long as any image shares `image`'s memory.
  void adopt(cv::Mat& image, py::array array) const {
    auto* data = new cv::UMatData(this);
    data->data = data->origdata = image.data;
    data->size = image.dataend - image.datastart;
    data->flags |= cv::UMatData::USER_ALLOCATED;
    data->userdata = array.release().ptr();
    data->refcount = 1;
    image.u = data;
  }
  cv::UMatData* allocate(int dims, const int* sizes, int type, void* data, size_t* step, cv::AccessFlag flags,
                         cv::UMatUsageFlags usage) const override {
    return cv::Mat::getStdAllocator()->allocate(dims, sizes, type, data, step, flags, usage);
  }
  bool allocate(cv::UMatData* data, cv::AccessFlag flags, cv::UMatUsageFlags usage) const override {
    return cv::Mat::getStdAllocator()->allocate(data, flags, usage);
  }
  void deallocate(cv::UMatData* data) const override {
    {
      const py::gil_scoped_acquire gil;
      Py_DECREF(static_cast<PyObject*>(data->userdata));
    }
    delete data;
  }
};

const ArrayAllocator& allocator() {
  static const auto* one = new ArrayAllocator;  // images may outlive the statics
  return *one;
}

py::dtype dtype_of(int depth) {
  switch (depth) {
    case CV_8U:
      return py::dtype::of<uint8_t>();
    case CV_16U:
      return py::dtype::of<uint16_t>();
    case CV_32S:
      return py::dtype::of<int32_t>();
    case CV_32F:
      return py::dtype::of<float>();
    default:
      return py::dtype::of<double>();
  }
}

std::string shape_text(int channels) {
  return channels == 1 ? "shape (H, W)" : "shape (H, W, " + std::to_string(channels) + ")";
}

std::string describe_types(const std::vector<int>& types) {
  std::string text;
  for (size_t i = 0; i < types.size(); ++i) {
    if (i > 0) text += i + 1 == types.size() ? " or " : ", ";
    text += std::string(py::str(dtype_of(CV_MAT_DEPTH(types[i]))));
  }
  return text + " array of " + shape_text(CV_MAT_CN(types.front()));
}

std::string describe_array(const py::array& array) {
  return std::string(py::str(array.dtype())) + " of shape " + std::string(py::str(array.attr("shape")));
}

bool has_shape(const py::array& array, int channels) {
  return channels == 1 ? array.ndim() == 2 : array.ndim() == 3 && array.shape(2) == channels;
}

// True if OpenCV can address the pixels: contiguous within a row, rows in ascending order.
bool has_rows(const py::array& array, int channels) {
  const py::ssize_t item = array.itemsize();
  return (channels == 1 || array.strides(2) == item) && array.strides(1) == item * channels &&
         array.strides(0) >= array.strides(1) * array.shape(1);
}

}  // namespace

std::string type_name(py::handle object) { return std::string(py::str(py::type::of(object).attr("__name__"))); }

py::object array_of(const cv::Mat& image) {
  if (image.empty()) return py::none();
  std::vector<py::ssize_t> shape{image.rows, image.cols};
  std::vector<py::ssize_t> strides{static_cast<py::ssize_t>(image.step[0]), static_cast<py::ssize_t>(image.elemSize())};
  if (image.channels() > 1) {
    shape.push_back(image.channels());
    strides.push_back(static_cast<py::ssize_t>(image.elemSize1()));
  }
  const py::capsule owner(new cv::Mat(image), [](void* mat) { delete static_cast<cv::Mat*>(mat); });
  py::array array(dtype_of(image.depth()), shape, strides, image.data, owner);
  array.attr("flags").attr("writeable") = false;
  return array;
}

cv::Mat image_of(py::handle object, const std::vector<int>& types, bool convert) {
  if (!py::isinstance<py::array>(object))
    throw py::type_error("expected a " + describe_types(types) + ", not " + type_name(object));
  auto array = py::reinterpret_borrow<py::array>(object);
  const int channels = CV_MAT_CN(types.front());
  if (!has_shape(array, channels))
    throw py::type_error("expected a " + describe_types(types) + ", not " + describe_array(array));
  const auto type =
      std::find_if(types.begin(), types.end(), [&](int t) { return array.dtype().equal(dtype_of(CV_MAT_DEPTH(t))); });
  if (type == types.end() || !has_rows(array, channels)) {
    if (!convert)
      throw py::type_error("expected a " + describe_types(types) + " in C order, not " + describe_array(array) +
                           "; convert it with numpy.ascontiguousarray");
    array = py::module_::import("numpy").attr("ascontiguousarray")(array, dtype_of(CV_MAT_DEPTH(types.front())));
  }
  cv::Mat image(static_cast<int>(array.shape(0)), static_cast<int>(array.shape(1)),
                type == types.end() ? types.front() : *type, const_cast<void*>(array.data()),
                static_cast<size_t>(array.strides(0)));
  allocator().adopt(image, array);
  return image;
}

py::array_t<double> matrix_of(const Pose& pose) {
  py::array_t<double> matrix({4, 4});
  auto m = matrix.mutable_unchecked<2>();
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) m(i, j) = pose.rotation(i, j);
    m(i, 3) = pose.translation[i];
    m(3, i) = 0;
  }
  m(3, 3) = 1;
  return matrix;
}

Pose pose_of(py::handle object) {
  const auto matrix = py::array_t<double, py::array::c_style | py::array::forcecast>::ensure(object);
  if (!matrix || matrix.ndim() != 2 || matrix.shape(0) != 4 || matrix.shape(1) != 4) {
    PyErr_Clear();
    throw py::type_error("expected a pose as a 4 x 4 matrix");
  }
  const auto m = matrix.unchecked<2>();
  Pose pose;
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) pose.rotation(i, j) = m(i, j);
    pose.translation[i] = m(i, 3);
  }
  constexpr double kTolerance = 1e-6;
  const bool rigid = pose.is_finite() && m(3, 0) == 0 && m(3, 1) == 0 && m(3, 2) == 0 && m(3, 3) == 1 &&
                     (pose.rotation * pose.rotation.transpose()).isIdentity(kTolerance) &&
                     pose.rotation.row(0).cross(pose.rotation.row(1)).dot(pose.rotation.row(2)) > 0;
  if (!rigid)
    throw Error("a pose must be a rigid transform: a rotation, a finite translation and the last row 0 0 0 1");
  return pose;
}

}  // namespace fringeslam::python
