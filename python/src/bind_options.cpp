// SPDX-License-Identifier: Apache-2.0
// Options of all stages.
#include "core/map/mesh.h"
#include "core/mapper/pipeline.h"
#include "core/score/trajectory_score.h"
#include "python/src/bindings.h"
#include "python/src/options.h"
#include "python/src/pipeline_options.h"
#include "sim/virtual_rig.h"

namespace fringeslam::python {

namespace {

// "pose_graph" -> "PoseGraphOptions"
std::string class_name(const std::string& stage) {
  std::string name;
  bool upper = true;
  for (const char c : stage) {
    if (c == '_') {
      upper = true;
      continue;
    }
    name += upper ? static_cast<char>(std::toupper(static_cast<unsigned char>(c))) : c;
    upper = false;
  }
  return name + "Options";
}

}  // namespace

PipelineOptions pipeline_options_of(const py::object& given, const py::dict& changes) {
  PipelineOptions options;
  const auto apply = [&](const py::dict& stages) {
    for (const std::pair<py::handle, py::handle> item : stages) {
      const std::string name = py::str(item.first);
      const auto value = py::reinterpret_borrow<py::object>(item.second);
      std::vector<std::string> names;
      bool known = false;
      options.for_each_stage([&](const char* stage, auto& stage_options) {
        names.emplace_back(stage);
        if (name != stage) return;
        known = true;
        if (py::isinstance<py::dict>(value))
          assign(stage_options, stage, py::dict(value));
        else
          stage_options = options_of<std::remove_reference_t<decltype(stage_options)>>(stage, value);
      });
      const std::string nearest = nearest_name(name, names);
      if (!known)
        throw Error("unknown stage '" + name + "'" + (nearest.empty() ? "" : "; did you mean '" + nearest + "'?"));
    }
  };
  if (py::isinstance<PipelineOptions>(given)) {
    options = given.cast<PipelineOptions>();
  } else if (py::isinstance<py::dict>(given)) {
    apply(given.cast<py::dict>());
  } else if (!given.is_none()) {
    throw py::type_error("expected PipelineOptions, a dict or None, not " + type_name(given));
  }
  apply(changes);
  return options;
}

void bind_options(py::module_& m) {
  PipelineOptions defaults;
  defaults.for_each_stage([&](const char* stage, auto& options) {
    using Options = std::remove_reference_t<decltype(options)>;
    bind_options<Options>(m, class_name(stage).c_str(), stage, std::string("Options of the stage ") + stage + ".");
  });
  bind_options<sim::RenderOptions>(m, "RenderOptions", "render", "Options of the renderer.");
  bind_options<TrajectoryOptions>(m, "TrajectoryOptions", "trajectory", "Options of the trajectory's score.");
  bind_options<MeshOptions>(m, "MeshOptions", "mesh", "Options of a frame's mesh.");

  py::class_<PipelineOptions> cls(
      m, "PipelineOptions", "Options of all stages: one attribute for each, named as in settings and config.yaml.");
  cls.def(py::init([](const py::kwargs& stages) { return pipeline_options_of(py::none(), stages); }));
  defaults.for_each_stage([&](const char* stage, auto& options) {
    using Options = std::remove_reference_t<decltype(options)>;
    const auto member = [name = std::string(stage)](PipelineOptions& all) -> Options& {
      Options* found = nullptr;
      all.for_each_stage([&](const char* other, auto& its_options) {
        if constexpr (std::is_same_v<std::remove_reference_t<decltype(its_options)>, Options>) {
          if (name == other) found = &its_options;
        }
      });
      return *found;
    };
    cls.def_property(
        stage, py::cpp_function(member, py::return_value_policy::reference_internal),
        py::cpp_function([member, name = std::string(stage)](PipelineOptions& all, const py::object& value) {
          member(all) = options_of<Options>(name, value);
        }));
  });
  const auto to_dict = [](const PipelineOptions& options) {
    py::dict stages;
    const_cast<PipelineOptions&>(options).for_each_stage(
        [&](const char* stage, auto& stage_options) { stages[stage] = dict_of(stage_options); });
    return stages;
  };
  cls.def("to_dict", to_dict, "Returns the options of each stage as a dict.");
  cls.def("__eq__",
          [to_dict](const PipelineOptions& a, const PipelineOptions& b) { return to_dict(a).equal(to_dict(b)); });
  cls.def(py::pickle(to_dict, [](const py::dict& stages) { return pipeline_options_of(stages); }));
}

}  // namespace fringeslam::python
