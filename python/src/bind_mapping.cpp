// SPDX-License-Identifier: Apache-2.0
// Mapper, pipeline, driver and map.
#include "core/io/files.h"
#include "core/io/ply.h"
#include "core/map/map_cloud.h"
#include "core/mapper/driver.h"
#include "core/mapper/map_merge.h"
#include "core/mapper/pipeline.h"
#include "core/storage/map_file.h"
#include "python/src/bindings.h"
#include "python/src/options.h"
#include "python/src/pipeline_options.h"
#include "python/src/python_objects.h"

namespace fringeslam::python {

namespace {

// Driver that keeps rig and pipeline alive. Its threads may need Python's lock to end.
class Drive {
 public:
  Drive(const py::object& rig, py::object pipeline, int ahead)
      : rig_(rig_of(rig)),
        pipeline_(std::move(pipeline)),
        driver_(std::make_unique<Driver>(*rig_, pipeline_.cast<Pipeline&>(), ahead)) {}
  ~Drive() {
    const py::gil_scoped_release release;
    driver_.reset();
  }
  std::shared_ptr<MappedView> next() {
    std::optional<MappedView> view;
    {
      const py::gil_scoped_release release;
      view = driver_->next();
    }
    if (!view) throw py::stop_iteration();
    return std::make_shared<MappedView>(*std::move(view));
  }

 private:
  std::shared_ptr<Rig> rig_;
  py::object pipeline_;
  std::unique_ptr<Driver> driver_;
};

// Array over one member of a vector's elements, which `owner` keeps alive.
template <class Element, class Member>
py::array member_array(const std::vector<Element>& elements, Member Element::*member, const py::object& owner) {
  constexpr bool kVector = std::is_same_v<Member, Eigen::Vector3f>;
  using Scalar = std::conditional_t<kVector, float, Member>;
  std::vector<py::ssize_t> shape{static_cast<py::ssize_t>(elements.size())}, strides{sizeof(Element)};
  if (kVector) {
    shape.push_back(3);
    strides.push_back(sizeof(float));
  }
  const void* data = elements.empty() ? nullptr : &(elements.front().*member);
  py::array array(py::dtype::of<Scalar>(), shape, strides, data, owner);
  array.attr("flags").attr("writeable") = false;
  return array;
}

struct Cloud {
  std::vector<CloudPoint> points;
};

template <class Points>
void write_ply_file(const std::filesystem::path& file, const Points& points) {
  StagedFile staged(file);
  write_text(staged.path(), to_ply(points, "world"));
  staged.commit();
}

// Adds the arrays of points to a class; `points` returns its vector.
template <class Class, class Get>
void bind_points(py::class_<Class>& cls, const Get& points) {
  cls.def("__len__", [points](const Class& self) { return points(self).size(); })
      .def_property_readonly(
          "points_m",
          [points](const py::object& self) {
            return member_array(points(self.cast<const Class&>()), &CloudPoint::position_m, self);
          },
          "(N, 3), world frame.")
      .def_property_readonly(
          "normals",
          [points](const py::object& self) {
            return member_array(points(self.cast<const Class&>()), &CloudPoint::normal, self);
          },
          "(N, 3), unit, outwards.")
      .def_property_readonly(
          "grey",
          [points](const py::object& self) {
            return member_array(points(self.cast<const Class&>()), &CloudPoint::grey, self);
          },
          "(N,), uint8.")
      .def_property_readonly(
          "sigma_m",
          [points](const py::object& self) {
            return member_array(points(self.cast<const Class&>()), &CloudPoint::sigma_m, self);
          },
          "(N,), standard deviation along the normal.");
}

void bind_map(py::module_& m) {
  py::class_<Cloud> cloud(m, "Cloud", "A map's point cloud. The arrays share its memory.");
  bind_points(cloud, [](const Cloud& c) -> const std::vector<CloudPoint>& { return c.points; });
  cloud.def(
      "write_ply", [](const Cloud& c, const std::filesystem::path& file) { write_ply_file(file, c.points); },
      py::arg("file"), ReleaseGil(), "Writes a binary PLY file.");
  py::class_<SurfaceMesh> mesh(m, "SurfaceMesh", "A map's fused surface as triangles. The arrays share its memory.");
  bind_points(mesh, [](const SurfaceMesh& s) -> const std::vector<CloudPoint>& { return s.vertices; });
  mesh.def_property_readonly(
          "triangles",
          [](const py::object& self) {
            const auto& triangles = self.cast<const SurfaceMesh&>().triangles;
            py::array array(py::dtype::of<uint32_t>(),
                            std::vector<py::ssize_t>{static_cast<py::ssize_t>(triangles.size()), 3},
                            std::vector<py::ssize_t>{3 * sizeof(uint32_t), sizeof(uint32_t)},
                            triangles.empty() ? nullptr : triangles.data(), self);
            array.attr("flags").attr("writeable") = false;
            return array;
          },
          "(M, 3), indices of points, counter-clockwise seen from outside.")
      .def(
          "write_ply", [](const SurfaceMesh& s, const std::filesystem::path& file) { write_ply_file(file, s); },
          py::arg("file"), ReleaseGil(), "Writes a binary PLY file.");
  py::class_<Keyframe>(m, "Keyframe", "A keyframe of the map.")
      .def_readonly("index", &Keyframe::index, "Index of its stack.")
      .def_readonly("timestamp_s", &Keyframe::timestamp_s)
      .def_readonly("world_from_camera", &Keyframe::world_from_camera, "4 x 4, at the time of the call.")
      .def_property_readonly(
          "landmarks", [](const Keyframe& k) { return k.landmarks.count(); }, "Number of landmarks.");
  py::class_<KeyframeMap>(m, "KeyframeMap", "Keyframes, joined by measured motions into a pose graph.")
      // Copies: the map's own move as it grows.
      .def_property_readonly("keyframes", [](const KeyframeMap& map) { return std::vector<Keyframe>(map.keyframes()); })
      .def_property_readonly(
          "frames", [](const KeyframeMap& map) { return map.frames().size(); },
          "Number of frames that contribute points, keyframes included.")
      .def_property_readonly(
          "links", [](const KeyframeMap& map) { return map.links().size(); },
          "Number of measured motions between keyframes.")
      .def(
          "cloud",
          [](const KeyframeMap& map, const py::object& options) {
            const auto cloud_options = options_of<CloudOptions>("cloud", options);
            const py::gil_scoped_release release;
            return Cloud{cloud_of(map, cloud_options)};
          },
          py::arg("options") = py::none(), "Merges all frames to a point cloud. Options: CloudOptions.")
      .def(
          "surface",
          [](const KeyframeMap& map, const py::object& options) {
            const auto surface_options = options_of<SurfaceOptions>("surface", options);
            const py::gil_scoped_release release;
            return surface_of(map, surface_options).mesh();
          },
          py::arg("options") = py::none(),
          "Fuses all frames to a surface (docs/method.md, section 8.2). Options: SurfaceOptions.")
      .def(
          "save",
          [](const KeyframeMap& map, const std::filesystem::path& file) {
            StagedFile staged(file);
            write_map(staged.path(), map);
            staged.commit();
          },
          py::arg("file"), ReleaseGil(), "Writes the map, to be continued later.");
  m.def(
      "load_map",
      [](const std::filesystem::path& file, const RigModel& rig, const py::object& options) {
        const auto mapping = options_of<MappingOptions>("mapping", options);
        const py::gil_scoped_release release;
        return open_map(file, rig, mapping);
      },
      py::arg("file"), py::arg("rig"), py::arg("options") = py::none(),
      "Opens a saved map, whose images stay in the file. Raises Error if it is damaged or was made with another "
      "camera.");
  py::class_<CrossLink>(m, "CrossLink", "A measured motion between a keyframe of one map and a keyframe of the other.")
      .def_readonly("a", &CrossLink::a, "Number of the keyframe in A.")
      .def_readonly("b", &CrossLink::b, "Number of the keyframe in B.")
      .def_readonly("a_from_b", &CrossLink::a_from_b, "4 x 4, of the cameras.")
      .def_readonly("covariance", &CrossLink::covariance, "6 x 6, (rotation, rad; translation, m), from the left.")
      .def_readonly("by_landmarks", &CrossLink::by_landmarks)
      .def_readonly("accepted", &CrossLink::accepted);
  py::class_<MergedMap>(m, "MergedMap", "Two maps in the world of the first one.")
      .def_property_readonly(
          "map", [](const MergedMap& merged) -> const KeyframeMap& { return merged.map; },
          py::return_value_policy::reference_internal, "The keyframes of A, then those of B.")
      .def_readonly("a_from_b", &MergedMap::a_from_b, "4 x 4, world of A from that of B.")
      .def_readonly("covariance", &MergedMap::covariance, "6 x 6, (rotation, rad; translation, m), from the left.")
      .def_readonly("contradicting", &MergedMap::contradicting,
                    "Pairs of keyframes whose depths contradict the result.")
      .def_property_readonly("links", [](const MergedMap& merged) { return merged.links; });
  m.def(
      "merge_maps",
      [](const KeyframeMap& a, const KeyframeMap& b, const py::object& options) {
        const MapperOptions mapper = pipeline_options_of(options).mapper();
        const py::gil_scoped_release release;
        return std::make_unique<MergedMap>(merge_maps(a, b, mapper, "b"));
      },
      py::arg("a"), py::arg("b"), py::arg("options") = py::none(),
      "Merges the maps of two missions (docs/method.md, section 8.4). Options: PipelineOptions. Raises Error without "
      "common evidence.");
}

void bind_results(py::module_& m) {
  py::class_<FrameResult>(m, "FrameResult", "What the mapper made of one view.")
      .def_readonly("frame", &FrameResult::frame)
      .def_readonly("decoded", &FrameResult::decoded)
      .def_property_readonly(
          "tracking", [](const FrameResult& r) { return to_string(r.tracking); },
          "'first', 'followed', 'refined', 'landmarks', 'ambiguous' or 'lost'.")
      .def_property_readonly("has_pose", [](const FrameResult& r) { return has_pose(r.tracking); })
      .def_readonly("world_from_robot", &FrameResult::world_from_robot,
                    "4 x 4, as estimated when the view was processed; Pipeline.trajectory contains later corrections.")
      .def_property_readonly(
          "reference_from_current", [](const FrameResult& r) { return r.registration.earlier_from_current; },
          "4 x 4: pose of the camera relative to that of the keyframe `reference`.")
      .def_readonly("covariance", &FrameResult::covariance,
                    "6 x 6, of reference_from_current: (rotation, rad; translation, m), applied from the left.")
      .def_readonly("previous_from_current", &FrameResult::previous_from_current, "4 x 4, since the last tracked view.")
      .def_readonly("motion", &FrameResult::motion, "StackMotion during the stack; None: not estimated.")
      .def_readonly("view", &FrameResult::view, "Position among the tracked views; -1: no pose.")
      .def_readonly("reference", &FrameResult::reference, "Keyframe that it was registered with; -1: none.")
      .def_readonly("keyframe", &FrameResult::keyframe, "Its own number if it became one, otherwise -1.")
      .def_readonly("in_map", &FrameResult::in_map)
      .def_readonly("unlinked", &FrameResult::unlinked,
                    "Earlier reference that no short path of links joins with this one: a loop to close; -1: none.")
      .def_readonly("loops", &FrameResult::loops, "Earlier keyframes linked with it, besides the reference.")
      .def_readonly("corrected", &FrameResult::corrected, "True if closing loops moved the map.")
      .def_property_readonly(
          "recovered",
          [](const FrameResult& r) {
            py::list views;
            for (const std::shared_ptr<const FrameResult>& view : r.recovered)
              views.append(py::cast(FrameResult(*view)));
            return views;
          },
          "FrameResults of earlier views that had no pose when they were processed and are registered now.");
  py::class_<MappedView, std::shared_ptr<MappedView>>(m, "MappedView", "A stack and its result.")
      .def_readonly("stack", &MappedView::stack)
      .def_readonly("result", &MappedView::result);
}

}  // namespace

void bind_mapping(py::module_& m) {
  bind_map(m);
  bind_results(m);
  py::class_<Pipeline>(m, "Pipeline",
                       "Front end and mapper: fringe stacks in, poses and map out (docs/architecture.md).")
      .def(py::init([](const RigModel& rig, const PatternSequence& patterns, const py::object& options,
                       const py::object& front_end, const std::optional<Pose>& world_from_robot,
                       const py::kwargs& stages) {
             const PipelineOptions all = pipeline_options_of(options, stages);
             const Pose start = world_from_robot.value_or(Pose{});
             if (front_end.is_none()) return std::make_unique<Pipeline>(rig, patterns, all, start);
             return std::make_unique<Pipeline>(front_end_of(front_end, rig, all.depth),
                                               Mapper(rig, all.mapper(), start), patterns, all);
           }),
           py::arg("rig"), py::arg("patterns"), py::arg("options") = py::none(), py::arg("front_end") = py::none(),
           py::arg("world_from_robot") = py::none(),
           "`world_from_robot` is the robot's pose at the first stack. `front_end` replaces ours: a function of a "
           "FringeStack that returns a Frame, or projector columns and their standard deviations. Keyword arguments "
           "change the options of a stage, as in Pipeline(rig, patterns, icp={'stride': 2}).")
      .def_static(
          "continue_map",
          [](const KeyframeMap& map, const PatternSequence& patterns, const py::object& options,
             const py::kwargs& stages) {
            return std::make_unique<Pipeline>(map, patterns, pipeline_options_of(options, stages));
          },
          py::arg("map"), py::arg("patterns"), py::arg("options") = py::none(),
          "Continues a map, in which the robot is relocalized first.")
      .def_property_readonly(
          "next_patterns", [](const Pipeline& pipeline) { return PatternSequence(pipeline.next_patterns()); },
          "Patterns to project for the next stack.")
      .def(
          "process",
          [](Pipeline& pipeline, const FringeStack& stack) {
            return std::make_unique<FrameResult>(pipeline.process(FringeStack(stack)));
          },
          py::arg("stack"), ReleaseGil(), "Maps one stack. Raises Error if it cannot be decoded.")
      .def_property_readonly("trajectory", &Pipeline::trajectory, "Poses of all tracked views in the current map.")
      .def_property_readonly("map", &Pipeline::map, py::return_value_policy::reference_internal);
  py::class_<Drive>(m, "Driver",
                    "Iterator that captures stacks with a rig and maps them with a pipeline, several at a time; yields "
                    "a MappedView for each, in the order of capture.")
      .def(py::init<const py::object&, py::object, int>(), py::arg("rig"), py::arg("pipeline"),
           py::arg("ahead") = Driver::kAhead)
      .def("__iter__", [](const py::object& self) { return self; })
      .def("__next__", &Drive::next);
}

}  // namespace fringeslam::python
