// SPDX-License-Identifier: Apache-2.0
// Sampling and statistics of studies (bench/studies/README.md).
#include "bench/studies/statistics.h"
#include "bench/studies/study.h"
#include "core/types/error.h"
#include "python/src/bindings.h"
#include "python/src/casters.h"

namespace fringeslam::python {

namespace {

using studies::Parameter;

double number_of(const std::string& name, const py::handle& value) {
  if (!py::isinstance<py::int_>(value) && !py::isinstance<py::float_>(value))
    throw Error("parameter '" + name + "': " + std::string(py::repr(value)) + " is not a number");
  const double number = py::float_(py::reinterpret_borrow<py::object>(value));
  if (!std::isfinite(number)) throw Error("parameter '" + name + "': the bounds must be finite");
  return number;
}

// The law of a parameter; the values of `choice` and `grid` are indices of the Python list.
Parameter parameter_of(const std::string& name, const py::dict& law) {
  Parameter parameter;
  parameter.name = name;
  if (law.contains("whole")) parameter.whole = law["whole"].cast<bool>();
  const std::pair<const char*, Parameter::Law> laws[] = {{"uniform", Parameter::Law::uniform},
                                                         {"log_uniform", Parameter::Law::log_uniform},
                                                         {"normal", Parameter::Law::normal},
                                                         {"choice", Parameter::Law::choice},
                                                         {"grid", Parameter::Law::grid}};
  int found = 0;
  for (const auto& [key, value] : laws) {
    if (!law.contains(key)) continue;
    ++found;
    parameter.law = value;
    const py::list values(law[key]);
    if (value == Parameter::Law::choice || value == Parameter::Law::grid) {
      if (values.empty()) throw Error("parameter '" + name + "': " + key + " needs at least one value");
      for (size_t i = 0; i < values.size(); ++i) parameter.values.push_back(std::to_string(i));
      continue;
    }
    if (values.size() != 2) throw Error("parameter '" + name + "': " + key + " needs two numbers");
    parameter.a = number_of(name, values[0]);
    parameter.b = number_of(name, values[1]);
    const bool ordered = value == Parameter::Law::normal ? parameter.b >= 0 : parameter.a <= parameter.b;
    if (!ordered || (value == Parameter::Law::log_uniform && parameter.a <= 0))
      throw Error("parameter '" + name + "': " + key + " needs ordered bounds, greater than 0 for log_uniform");
  }
  if (found != 1 || law.size() != (law.contains("whole") ? 2 : 1))
    throw Error("parameter '" + name + "' needs one of uniform, log_uniform, normal, choice and grid");
  return parameter;
}

py::object value_of(const Parameter& parameter, const py::dict& law, const std::string& text) {
  if (parameter.law == Parameter::Law::choice) return py::list(law["choice"])[std::stoul(text)];
  if (parameter.law == Parameter::Law::grid) return py::list(law["grid"])[std::stoul(text)];
  if (parameter.whole) return py::int_(std::stoll(text));
  return py::float_(std::stod(text));
}

}  // namespace

void bind_studies(py::module_& m) {
  m.def(
      "draw_trials",
      [](const py::dict& parameters, int trials, uint64_t seed, int worlds) {
        studies::Study study;
        study.seed = seed;
        study.worlds = worlds;
        study.trials = trials;
        std::vector<py::dict> laws;
        for (const std::pair<py::handle, py::handle> item : parameters) {
          if (!py::isinstance<py::dict>(item.second))
            throw Error("parameter '" + std::string(py::str(item.first)) +
                        "' needs a dict, such as {'uniform': [0, 1]}");
          laws.push_back(py::reinterpret_borrow<py::dict>(item.second));
          study.parameters.push_back(parameter_of(py::str(item.first), laws.back()));
        }
        py::list drawn;
        for (int i = 0; i < trials; ++i) {
          const studies::Trial trial = studies::trial_of(study, i);
          py::dict values;
          values["seed"] = trial.world_seed;
          for (size_t p = 0; p < laws.size(); ++p)
            values[py::str(study.parameters[p].name)] = value_of(study.parameters[p], laws[p], trial.values[p]);
          drawn.append(values);
        }
        return drawn;
      },
      py::arg("parameters"), py::arg("trials"), py::arg("seed") = 1, py::arg("worlds") = 0,
      "Draws the parameters of trials as studies do: {'uniform': [a, b]}, log_uniform, normal: [mean, sigma], 'whole': "
      "True to round; {'choice': [...]} sampled, {'grid': [...]} cycled through. Returns a dict for each trial, with "
      "the scene's 'seed' (`worlds` of them in turn; 0: each trial has its own). Values depend on seed, trial and name "
      "only.");
  m.def(
      "wilson_interval",
      [](int successes, int trials) {
        const studies::Interval interval = studies::wilson(successes, trials);
        return std::pair(interval.low, interval.high);
      },
      py::arg("successes"), py::arg("trials"), "Returns the 95 % interval of a probability (Wilson 1927).");
}

}  // namespace fringeslam::python
