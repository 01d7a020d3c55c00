// SPDX-License-Identifier: Apache-2.0
// The module fringeslam._fringeslam; the package python/fringeslam re-exports its names.
#include "core/base/opencv_config.h"
#include "core/types/error.h"
#include "python/src/bindings.h"
#include "python/src/python_objects.h"

PYBIND11_MODULE(_fringeslam, m) {
  namespace py = pybind11;
  m.doc() = "C++ part of fringeslam.";
  fringeslam::use_portable_opencv();
  py::register_exception<fringeslam::Error>(m, "Error", PyExc_ValueError).doc() =
      "Bad files, options or data. The message is one line: what is wrong, where, and what to do.";
  py::register_exception_translator([](std::exception_ptr error) {
    try {
      if (error) std::rethrow_exception(error);
    } catch (const fringeslam::python::PythonError& e) {
      e.raise_again();
    }
  });
  m.attr("__version__") = FRINGESLAM_VERSION;
  using namespace fringeslam::python;
  bind_options(m);
  bind_types(m);
  bind_rigs(m);
  bind_scenes(m);
  bind_stages(m);
  bind_mapping(m);
  bind_scores(m);
  bind_calibration(m);
  bind_datasets(m);
  bind_studies(m);
  bind_evaluation(m);
}
