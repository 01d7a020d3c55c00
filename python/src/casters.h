// SPDX-License-Identifier: Apache-2.0
// Conversions between C++ values and Python objects:
//
//   cv::Mat            NumPy array of shape (H, W) or (H, W, channels); empty: None
//   Pose               NumPy array 4 x 4, homogeneous
//   an options enum    its name in YAML files
//
// Images are never copied. An array that comes from C++ is read-only, because the mapper keeps the same image; an array
// that goes to C++ must stay unchanged as long as the stack or view that it was given to.
#pragma once

#include <pybind11/eigen.h>
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <opencv2/core.hpp>
#include <string>

#include "core/types/options.h"
#include "core/types/pose.h"
#include "core/types/trajectory.h"

// A class of its own in Python, not a list.
PYBIND11_MAKE_OPAQUE(fringeslam::Trajectory)

namespace fringeslam::python {

namespace py = pybind11;

// Name of an object's type, for messages.
std::string type_name(py::handle object);

// Returns a read-only array that shares the image's memory; None for an empty image.
py::object array_of(const cv::Mat& image);

// Returns an image that shares the array's memory and keeps the array alive. Throws py::type_error unless the array's
// type is one of `types` (OpenCV's, such as CV_8UC1) and its pixels are contiguous within a row; with `convert`, an
// array of another type or layout is converted to the first of `types`.
cv::Mat image_of(py::handle object, const std::vector<int>& types, bool convert);

py::array_t<double> matrix_of(const Pose& pose);

// Throws py::type_error unless the matrix is 4 x 4, and Error unless it is a rigid transform.
Pose pose_of(py::handle object);

}  // namespace fringeslam::python

namespace pybind11::detail {

template <>
struct type_caster<cv::Mat> {
  PYBIND11_TYPE_CASTER(cv::Mat, const_name("numpy.ndarray"));
  bool load(handle source, bool) {
    if (!source.is_none()) value = fringeslam::python::image_of(source, {CV_8UC1, CV_16UC1, CV_32FC1}, false);
    return true;
  }
  static handle cast(const cv::Mat& image, return_value_policy, handle) {
    return fringeslam::python::array_of(image).release();
  }
};

template <class Pixel>
struct type_caster<cv::Mat_<Pixel>> {
  PYBIND11_TYPE_CASTER(cv::Mat_<Pixel>, const_name("numpy.ndarray"));
  bool load(handle source, bool convert) {
    if (!source.is_none()) value = fringeslam::python::image_of(source, {cv::traits::Type<Pixel>::value}, convert);
    return true;
  }
  static handle cast(const cv::Mat_<Pixel>& image, return_value_policy, handle) {
    return fringeslam::python::array_of(image).release();
  }
};

template <>
struct type_caster<fringeslam::Pose> {
  PYBIND11_TYPE_CASTER(fringeslam::Pose, const_name("numpy.ndarray"));
  bool load(handle source, bool) {
    value = fringeslam::python::pose_of(source);
    return true;
  }
  static handle cast(const fringeslam::Pose& pose, return_value_policy, handle) {
    return fringeslam::python::matrix_of(pose).release();
  }
};

template <fringeslam::NamedEnum Enum>
struct type_caster<Enum> {
  PYBIND11_TYPE_CASTER(Enum, const_name("str"));
  bool load(handle source, bool) {
    if (!isinstance<str>(source)) return false;
    const auto text = source.cast<std::string>();
    for (const fringeslam::Choice<Enum>& choice : choices(Enum())) {
      if (choice.name == text) {
        value = choice.value;
        return true;
      }
    }
    std::string message = "'" + text + "' is not one of";
    for (const std::string& known : fringeslam::choice_names<Enum>()) message += " " + known;
    throw fringeslam::Error(message);
  }
  static handle cast(const Enum& choice, return_value_policy, handle) {
    return str(fringeslam::to_string(choice)).release();
  }
};

}  // namespace pybind11::detail
