// SPDX-License-Identifier: Apache-2.0
// Sources of fringe stacks: recorded datasets, imported images, and recording.

#include "core/import/import.h"
#include "core/io/staged.h"
#include "core/rig/dataset.h"
#include "core/types/error.h"
#include "python/src/bindings.h"
#include "python/src/python_objects.h"

namespace fringeslam::python {

namespace {

// Iterates over a recording.
class StackIterator {
 public:
  StackIterator(std::shared_ptr<Rig> rig, const PatternSequence& sequence)
      : rig_(std::move(rig)), sequence_(sequence) {}
  FringeStack next() {
    std::optional<FringeStack> stack;
    {
      const py::gil_scoped_release release;
      stack = rig_->capture(sequence_);
    }
    if (!stack) throw py::stop_iteration();
    return *std::move(stack);
  }

 private:
  std::shared_ptr<Rig> rig_;
  PatternSequence sequence_;
};

// Returns the rig. Throws Error if a recording in `folder` would replace files that the rig reads.
std::shared_ptr<Rig> rig_to_record(const py::object& rig, const std::filesystem::path& folder) {
  std::shared_ptr<Rig> inner = rig_of(rig);
  for (const std::filesystem::path& input : inner->inputs()) {
    if (is_replaced_with(input, folder))
      throw Error(folder.string() + ": contains the input " + input.string() +
                  ", which would be replaced; choose another folder");
  }
  return inner;
}

// RecordingRig, with a folder that appears only when complete.
class Recorder : public Rig {
 public:
  Recorder(const py::object& rig, const std::filesystem::path& folder)
      : inner_(rig_to_record(rig, folder)), folder_(folder, "dataset"), recording_(*inner_, folder_.path()) {}
  const RigModel& model() const override { return inner_->model(); }
  std::optional<FringeStack> capture(const PatternSequence& sequence) override { return recording_.capture(sequence); }
  bool can_change_patterns() const override { return false; }
  std::vector<std::filesystem::path> inputs() const override { return inner_->inputs(); }
  void finish(const std::string& name, uint64_t seed) {
    recording_.finish(name, seed, false);
    folder_.commit();
  }

 private:
  std::shared_ptr<Rig> inner_;
  StagedFolder folder_;
  RecordingRig recording_;
};

}  // namespace

void bind_rigs(py::module_& m) {
  py::class_<Rig, std::shared_ptr<Rig>>(
      m, "Rig",
      "A source of fringe stacks. A rig written in Python needs no base class: any object with an attribute `model` "
      "(RigModel) and a method `capture(patterns)` that returns a FringeStack, or None at the end.")
      .def_property_readonly(
          "model", [](const Rig& rig) { return rig.model(); }, "RigModel.")
      .def("capture", &Rig::capture, py::arg("patterns"), ReleaseGil(),
           "Captures one stack; returns None at the end of the recording or scene.");
  py::class_<StackIterator>(m, "_StackIterator")
      .def("__iter__", [](const py::object& self) { return self; })
      .def("__next__", &StackIterator::next);
  py::class_<ReplayRig, Rig, std::shared_ptr<ReplayRig>>(
      m, "ReplayRig", "Replays a recorded dataset. Iterating over it yields its remaining stacks.")
      .def(py::init<std::filesystem::path>(), py::arg("folder"))
      .def_property_readonly("patterns", &ReplayRig::sequence, "The recorded pattern sequence.")
      .def_property_readonly("name", [](const ReplayRig& rig) { return rig.info().name; })
      .def_property_readonly("has_truth", [](const ReplayRig& rig) { return rig.info().has_truth; })
      .def("__len__", [](const ReplayRig& rig) { return rig.info().stacks; })
      .def("recalibrate", &ReplayRig::recalibrate, py::arg("calibration"),
           "Replaces lenses and relative pose by those of a calibration.")
      .def("__iter__", [](const std::shared_ptr<ReplayRig>& rig) { return StackIterator(rig, rig->sequence()); });
  py::class_<ImportedRig, Rig, std::shared_ptr<ImportedRig>>(
      m, "ImportedRig",
      "Images of any structured-light rig, described by import.yaml (docs/tutorials/use-your-captures.md). Iterating "
      "over it yields its remaining stacks.")
      .def(py::init([](const std::filesystem::path& folder, const std::optional<std::filesystem::path>& config) {
             return std::make_shared<ImportedRig>(read_import(config.value_or(folder / "import.yaml"), folder));
           }),
           py::arg("folder"), py::arg("config") = py::none())
      .def_property_readonly("patterns", &ImportedRig::sequence, "The pattern sequence of a stack.")
      .def("recalibrate", &ImportedRig::recalibrate, py::arg("calibration"))
      .def("__iter__", [](const std::shared_ptr<ImportedRig>& rig) { return StackIterator(rig, rig->sequence()); });
  py::class_<Recorder, Rig, std::shared_ptr<Recorder>>(
      m, "RecordingRig",
      "Forwards the captures of another rig and records them in `folder`, which appears when finish() is called.")
      .def(py::init<const py::object&, const std::filesystem::path&>(), py::arg("rig"), py::arg("folder"))
      .def("finish", &Recorder::finish, py::arg("name"), py::arg("seed") = 0, ReleaseGil(), "Completes the dataset.");
}

}  // namespace fringeslam::python
