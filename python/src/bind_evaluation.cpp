// SPDX-License-Identifier: Apache-2.0
// Suites and leaderboards of `fringeslam evaluate`.
#include "bench/evaluation/leaderboard.h"
#include "bench/evaluation/suite_file.h"
#include "python/src/bindings.h"
#include "python/src/casters.h"
#include "sim/scene/data_folder.h"

namespace fringeslam::python {

namespace {

using evaluation::Result;
using evaluation::Standing;

std::tuple<double, double, double> tuple_of(const MedianInterval& q) { return {q.median, q.low, q.high}; }

}  // namespace

void bind_evaluation(py::module_& m) {
  py::class_<evaluation::SuiteDataset>(m, "SuiteDataset", "A scene of a suite.")
      .def_readonly("name", &evaluation::SuiteDataset::name)
      .def_readonly("scene", &evaluation::SuiteDataset::scene)
      .def_readonly("seed", &evaluation::SuiteDataset::seed)
      .def_readonly("changes", &evaluation::SuiteDataset::with, "Changes to the scene, such as 'light.ambient_lux=0'.");
  py::class_<evaluation::Suite>(m, "Suite", "Scenes on which systems are compared.")
      .def_readonly("name", &evaluation::Suite::name)
      .def_readonly("description", &evaluation::Suite::description)
      .def_readonly("datasets", &evaluation::Suite::datasets, "One for each seed.");
  m.def(
      "read_suite",
      [](const std::string& suite, const std::optional<std::filesystem::path>& folder) {
        return evaluation::read_suite(suite, folder.value_or(sim::data_folder() / "scenes/suites"));
      },
      py::arg("suite"), py::arg("folder") = py::none(),
      "Reads a suite: a file, or the name of one in `folder` (scenes/suites). Raises Error with file:line.");
  py::class_<Result>(m, "EvaluationResult", "One system on one dataset; NaN: not measured.")
      .def(py::init<>())
      .def_readwrite("suite", &Result::suite)
      .def_readwrite("dataset", &Result::dataset)
      .def_readwrite("system", &Result::system)
      .def_readwrite("command", &Result::command)
      .def_readwrite("end", &Result::end,
                     "'finished', 'failed', 'timed_out', 'out_of_memory', 'interrupted' or 'no_trajectory'.")
      .def_readwrite("message", &Result::message)
      .def_readwrite("views", &Result::views)
      .def_readwrite("poses", &Result::poses)
      .def_readwrite("ate_m", &Result::ate_m, "Translation, best rigid alignment.")
      .def_readwrite("ate_origin_m", &Result::ate_origin_m, "Translation, first poses aligned.")
      .def_readwrite("rpe_m", &Result::rpe_m)
      .def_readwrite("rpe_rad", &Result::rpe_rad)
      .def_readwrite("f_score", &Result::f_score)
      .def_readwrite("seconds", &Result::seconds)
      .def_readwrite("peak_mib", &Result::peak_mib);
  m.def("set_score", &evaluation::set_score, py::arg("result"), py::arg("score"),
        "Sets a result's numbers that a TrajectoryScore contains.");
  py::class_<Standing>(m, "Standing",
                       "A system on a suite. Quantities are (median, low, high) over its datasets with 95 % intervals.")
      .def_readonly("suite", &Standing::suite)
      .def_readonly("system", &Standing::system)
      .def_readonly("datasets", &Standing::datasets)
      .def_readonly("scored", &Standing::scored, "Datasets with a trajectory.")
      .def_readonly("tracked", &Standing::tracked, "Share of views with a pose, over all datasets.")
      .def_property_readonly("ate_m", [](const Standing& s) { return tuple_of(s.ate_m); })
      .def_property_readonly("rpe_m", [](const Standing& s) { return tuple_of(s.rpe_m); })
      .def_property_readonly("rpe_rad", [](const Standing& s) { return tuple_of(s.rpe_rad); })
      .def_property_readonly("f_score", [](const Standing& s) { return tuple_of(s.f_score); })
      .def_property_readonly("seconds_per_view", [](const Standing& s) { return tuple_of(s.seconds_per_view); });
  m.def("standings", &evaluation::standings_of, py::arg("results"), "Ranks systems by suite.");
  m.def("read_results", &evaluation::results_in, py::arg("folder"), "Reads the results in a leaderboard's folder.");
  m.def(
      "add_result",
      [](const std::filesystem::path& folder, const Result& result) { evaluation::add_result(folder, result); },
      py::arg("folder"), py::arg("result"), ReleaseGil(),
      "Adds a result to a leaderboard's folder and writes results.jsonl, leaderboard.csv and leaderboard.html.");
}

}  // namespace fringeslam::python
