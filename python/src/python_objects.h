// SPDX-License-Identifier: Apache-2.0
// Rigs and decoders written in Python, as C++ objects. Any object with the right methods will do; it needs no base
// class. The pipeline calls them from its own threads.
#pragma once

#include <memory>
#include <optional>

#include "core/mapper/front_end.h"
#include "core/rig/rig.h"
#include "python/src/casters.h"

namespace fringeslam::python {

// Holds a Python object in C++ code that does not hold Python's lock.
class Held {
 public:
  explicit Held(py::object object) : object_(std::move(object)) {}
  ~Held() {
    const py::gil_scoped_acquire gil;
    object_ = py::object();
  }
  Held(const Held&) = delete;
  Held& operator=(const Held&) = delete;
  const py::object& operator*() const { return object_; }

 private:
  py::object object_;
};

// A Python exception on its way through the pipeline's threads. Only raise_again() and the last copy touch the Python
// object: its traceback refers to frames, and through them to the driver, which must not be destroyed by its own threads.
class PythonError : public std::exception {
 public:
  explicit PythonError(py::error_already_set&& error)
      : error_(std::make_shared<std::optional<py::error_already_set>>(std::move(error))) {}
  const char* what() const noexcept override { return "exception in Python code"; }
  // Makes it Python's current exception. Requires Python's lock.
  void raise_again() const {
    (*error_)->restore();
    error_->reset();
  }

 private:
  std::shared_ptr<std::optional<py::error_already_set>> error_;
};

// Calls a function that runs Python code, and throws PythonError where that raises an exception.
template <class Function>
auto call_python(const Function& function) {
  const py::gil_scoped_acquire gil;
  try {
    return function();
  } catch (py::error_already_set& error) {
    throw PythonError(std::move(error));
  }
}

// Returns the C++ rig of `rig`: the rig itself, or an adapter of an object with `model` and `capture(patterns)`. Throws
// py::type_error for anything else.
std::shared_ptr<Rig> rig_of(const py::object& rig);

// Returns the front end of `object`: the front end itself, or an adapter of a function (FringeStack) -> Frame or
// (FringeStack) -> (coordinate_px, sigma_px), whose coordinates are triangulated with `depth`. Throws py::type_error for
// anything else.
std::shared_ptr<const FrontEnd> front_end_of(const py::object& object, const RigModel& rig, const DepthOptions& depth);

}  // namespace fringeslam::python
