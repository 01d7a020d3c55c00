// SPDX-License-Identifier: Apache-2.0
// The simulator: scenes and the virtual rig.
#include "core/rig/dataset.h"
#include "core/score/map_score.h"
#include "core/score/truth_files.h"
#include "python/src/bindings.h"
#include "python/src/options.h"
#include "sim/nearest_surface.h"
#include "sim/preview.h"
#include "sim/scene/data_folder.h"
#include "sim/scene/scene.h"
#include "sim/virtual_rig.h"

namespace fringeslam::python {

namespace {

using sim::Scene;
using SharedScene = std::shared_ptr<Scene>;

// A virtual rig that keeps its scene alive.
class SceneRig : public Rig {
 public:
  SceneRig(SharedScene scene, const sim::RenderOptions& options) : scene_(std::move(scene)), rig_(*scene_, options) {}
  const RigModel& model() const override { return rig_.model(); }
  std::optional<FringeStack> capture(const PatternSequence& sequence) override { return rig_.capture(sequence); }
  std::optional<sim::SimulatedView> simulate(const std::optional<PatternSequence>& sequence) {
    return rig_.simulate(sequence.value_or(scene_->patterns));
  }
  TruthFrame truth_of(size_t pose) const {
    if (pose >= scene_->trajectory.size())
      throw Error("the trajectory has " + std::to_string(scene_->trajectory.size()) + " poses; there is no pose " +
                  std::to_string(pose));
    return rig_.truth_of(pose);
  }
  SharedScene scene() const { return scene_; }

 private:
  SharedScene scene_;
  sim::VirtualRig rig_;
};

// Formats a Python value as YAML: JSON is a subset of it.
std::string yaml_of(const py::handle& value) {
  return py::module_::import("json").attr("dumps")(value).cast<std::string>();
}

sim::SceneLoadOptions reading_of(const std::optional<uint64_t>& seed, const py::dict& changes,
                                 const std::optional<std::filesystem::path>& rig) {
  sim::SceneLoadOptions reading;
  reading.seed = seed;
  if (rig) reading.rig_file = *rig;
  for (const auto& [key, value] : changes) {
    const bool text = py::isinstance<py::str>(value);
    reading.changes.emplace_back(key.cast<std::string>(), text ? value.cast<std::string>() : yaml_of(value));
  }
  return reading;
}

SharedScene load(const std::filesystem::path& path, const sim::SceneLoadOptions& reading) {
  const py::gil_scoped_release release;
  return std::make_shared<Scene>(sim::load_scene(sim::scene_file(path), reading));
}

Pose pose_at(const Scene& scene, double time_s) {
  if (scene.path && std::isfinite(time_s)) return scene.path->at(time_s);
  constexpr double kTolerance_s = 1e-6;
  for (const TimedPose& pose : scene.trajectory) {
    if (std::abs(pose.timestamp_s - time_s) < kTolerance_s) return pose.world_from_robot;
  }
  throw Error("the scene '" + scene.name + "' has no view at " + to_text(time_s) + " s");
}

using Points = Eigen::Matrix<double, Eigen::Dynamic, 3, Eigen::RowMajor>;

std::vector<Eigen::Vector3d> vectors_of(const Eigen::Ref<const Points>& points) {
  std::vector<Eigen::Vector3d> vectors;
  vectors.reserve(static_cast<size_t>(points.rows()));
  for (Eigen::Index i = 0; i < points.rows(); ++i) vectors.emplace_back(points.row(i));
  return vectors;
}

Points matrix_of_points(const std::vector<Eigen::Vector3d>& vectors) {
  Points points(static_cast<Eigen::Index>(vectors.size()), 3);
  for (size_t i = 0; i < vectors.size(); ++i) points.row(static_cast<Eigen::Index>(i)) = vectors[i];
  return points;
}

void bind_scene(py::module_& m) {
  using Triangles = Eigen::Matrix<int, Eigen::Dynamic, 3, Eigen::RowMajor>;
  py::class_<sim::Object>(m, "SceneObject", "An object of a scene.")
      .def_readonly("name", &sim::Object::name)
      .def_readonly("world_from_object", &sim::Object::world_from_object, "4 x 4.")
      .def_property_readonly(
          "vertices_m", [](const sim::Object& object) { return matrix_of_points(object.mesh->vertices); },
          "(N, 3), object frame.")
      .def_property_readonly(
          "triangles",
          [](const sim::Object& object) {
            Triangles triangles(static_cast<Eigen::Index>(object.mesh->triangles.size()), 3);
            for (size_t i = 0; i < object.mesh->triangles.size(); ++i)
              triangles.row(static_cast<Eigen::Index>(i)) = object.mesh->triangles[i];
            return triangles;
          },
          "(N, 3), indices of vertices, counter-clockwise seen from outside.");
  py::class_<Scene, SharedScene>(m, "Scene", "Objects, light, rig and trajectory, with all random values drawn.")
      .def_readonly("name", &Scene::name)
      .def_readonly("seed", &Scene::seed)
      .def_readonly("objects", &Scene::objects)
      .def_readonly("rig", &Scene::rig, "The rig that renders; VirtualRig.model is the calibration to decode with.")
      .def_readonly("patterns", &Scene::patterns)
      .def_readonly("trajectory", &Scene::trajectory, "True poses of the robot.")
      .def_property_readonly("moves_continuously", &Scene::moves_while_capturing,
                             "True if the robot moves while the rig captures.")
      .def("pose_at", &pose_at, py::arg("time_s"),
           "Returns the true pose of the robot, 4 x 4, at any time of a continuous path; otherwise at the time of a "
           "view. Raises Error if there is none.")
      .def_readonly("resolved", &Scene::resolved, "Equivalent scene file (YAML) with all values drawn.")
      .def(
          "preview",
          [](const Scene& scene, int width, int height) -> py::object {
            cv::Mat3b picture;
            {
              const py::gil_scoped_release release;
              picture = sim::preview_picture(scene, {width, height});
            }
            return py::cast(picture)[py::make_tuple(py::ellipsis(), py::slice(py::none(), py::none(), py::int_(-1)))];
          },
          py::arg("width") = 1200, py::arg("height") = 800,
          "Renders an overview of the scene and its first view, uint8 (height, width, 3), RGB.")
      .def("__repr__", [](const Scene& scene) {
        return "Scene('" + scene.name + "', seed " + std::to_string(scene.seed) + ", " +
               std::to_string(scene.objects.size()) + " objects, " + std::to_string(scene.trajectory.size()) +
               " views)";
      });
  m.def(
      "load_scene",
      [](const std::filesystem::path& path, const std::optional<uint64_t>& seed, const py::dict& changes,
         const std::optional<std::filesystem::path>& rig) { return load(path, reading_of(seed, changes, rig)); },
      py::arg("path"), py::arg("seed") = py::none(), py::arg("changes") = py::dict(), py::arg("rig") = py::none(),
      "Loads a scene file, scene.yaml in a folder, or an installed scene by its name. `changes` overrides values by "
      "key path, such as "
      "{'light.ambient_lux': 0}; `rig` is another rig file. Raises Error with file:line.");
  m.def(
      "make_scene",
      [](const py::dict& description, const std::filesystem::path& folder, const std::optional<uint64_t>& seed) {
        sim::SceneLoadOptions reading = reading_of(seed, {}, std::nullopt);
        reading.text = yaml_of(description);
        return load(folder / "scene from Python", reading);
      },
      py::arg("description"), py::arg("folder") = ".", py::arg("seed") = py::none(),
      "Makes a scene from a dict with the keys of scene files (scenes/README.md). Its paths are relative to `folder`.");
}

void bind_virtual_rig(py::module_& m) {
  py::class_<sim::SimulatedView>(m, "SimulatedView", "A rendered stack and its ground truth.")
      .def_readonly("stack", &sim::SimulatedView::stack)
      .def_readonly("truth", &sim::SimulatedView::truth);
  py::class_<SceneRig, Rig, std::shared_ptr<SceneRig>>(
      m, "VirtualRig",
      "Renders the fringe images of a scene. Each call of capture() or simulate() advances to the next pose; iterating "
      "yields the remaining views with ground truth.")
      .def(py::init([](SharedScene scene, const py::object& options, const py::kwargs& changes) {
             const auto render = options_of<sim::RenderOptions>("render", options, changes);
             render.check();
             const py::gil_scoped_release release;
             return std::make_shared<SceneRig>(std::move(scene), render);
           }),
           py::arg("scene"), py::arg("options") = py::none())
      .def_property_readonly("scene", &SceneRig::scene)
      .def("simulate", &SceneRig::simulate, py::arg("patterns") = py::none(), ReleaseGil(),
           "Renders the next view with ground truth; None at the end. Without `patterns`, those of the scene.")
      .def("truth_of", &SceneRig::truth_of, py::arg("pose"), ReleaseGil(),
           "Returns the ground truth at a pose of the trajectory, without fringe orders and images.")
      .def("__iter__", [](const py::object& self) { return self; })
      .def("__next__", [](SceneRig& rig) {
        std::optional<sim::SimulatedView> view;
        {
          const py::gil_scoped_release release;
          view = rig.simulate(std::nullopt);
        }
        if (!view) throw py::stop_iteration();
        return *std::move(view);
      });
}

}  // namespace

void bind_scenes(py::module_& m) {
  bind_scene(m);
  bind_virtual_rig(m);
  m.def(
      "read_truth", [](const std::filesystem::path& file) { return read_truth_frame(file); }, py::arg("file"),
      ReleaseGil(), "Reads truth/NNNNNN.exr of a dataset or run; its pose and time are those of truth.tum.");
  py::class_<sim::NearestSurface>(m, "NearestSurface", "Exact distances of points to a scene's surfaces.")
      .def(py::init<const Scene&>(), py::arg("scene"), ReleaseGil())
      .def(
          "distances_m",
          [](const sim::NearestSurface& surface, const Eigen::Ref<const Points>& points, double within_m) {
            const py::gil_scoped_release release;
            return surface.distances_m(vectors_of(points), within_m);
          },
          py::arg("points"), py::arg("within_m") = 1.0,
          "Returns the distances of points (N, 3) in the world frame to the nearest triangle; inf if none lies within "
          "within_m.");
  m.def(
      "visible_surface",
      [](const std::vector<const TruthFrame*>& views, const RigModel& rig) {
        std::vector<Eigen::Vector3d> seen;
        const PixelRays rays = pixel_rays(rig.camera);
        for (const TruthFrame* view : views) {
          if (!view) throw py::type_error("views: expected TruthFrames, not None");
          append_visible_surface(*view, rig, rays, seen);
        }
        return matrix_of_points(seen);
      },
      py::arg("views"), py::arg("rig"),
      "Returns points (N, 3) of the true surface that the sensor can see in these views, world frame, m.");
}

}  // namespace fringeslam::python
