// SPDX-License-Identifier: Apache-2.0
// The parts of the Python module, one function per file.
#pragma once

#include <pybind11/pybind11.h>

namespace fringeslam::python {

namespace py = pybind11;

void bind_options(py::module_& m);
void bind_types(py::module_& m);
void bind_rigs(py::module_& m);
void bind_scenes(py::module_& m);
void bind_stages(py::module_& m);
void bind_mapping(py::module_& m);
void bind_scores(py::module_& m);
void bind_calibration(py::module_& m);
void bind_datasets(py::module_& m);
void bind_studies(py::module_& m);
void bind_evaluation(py::module_& m);

// Heavy functions release Python's lock, so that other threads, and rigs and decoders written in Python, can run.
using ReleaseGil = py::call_guard<py::gil_scoped_release>;

}  // namespace fringeslam::python
