// SPDX-License-Identifier: Apache-2.0
// fringeslam import FOLDER --out DATASET: converts another rig's images to a dataset.
#include "core/import/import.h"

#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>

#include "core/rig/dataset.h"
#include "tools/progress.h"
#include "tools/verbs.h"

namespace fringeslam::tools {

namespace fs = std::filesystem;

namespace {

constexpr const char* kImportFile = "import.yaml";

int import_folder(const fs::path& source, const fs::path& config, const std::string& out, const Common& common) {
  ImportPlan plan = read_import(config, source);
  const size_t stacks = plan.stacks.size(), images = plan.sequence.patterns.size();
  const std::string name = plan.rig.name, board_yaml = plan.board_yaml;
  ImportedRig rig(std::move(plan));
  StagedFolder folder(out, "dataset");
  RecordingRig recording(rig, folder.path());
  {
    Progress progress("importing", static_cast<int>(stacks), common.quiet || common.json);
    while (recording.capture(rig.sequence())) progress.step();
  }
  if (!board_yaml.empty()) write_text(folder.path() / "board.yaml", board_yaml);
  recording.finish(name, 0, false);
  folder.commit();
  const RigModel& model = rig.model();
  if (common.json) {
    const nlohmann::ordered_json json = {
        {"dataset", out}, {"stacks", stacks}, {"images_per_stack", images}, {"calibrated", model.calibrated}};
    std::printf("%s\n", json.dump().c_str());
  } else if (!common.quiet) {
    std::printf("dataset: %s (%zu x %zu images, %dx%d px%s)\n", out.c_str(), stacks, images, model.camera.width,
                model.camera.height, model.calibrated ? "" : "; not calibrated: run fringeslam calibrate rig");
  }
  return 0;
}

}  // namespace

Verb add_import(Command app, const Common& common) {
  struct ImportArguments {
    std::string folder, config, out;
  };
  auto a = std::make_shared<ImportArguments>();
  const Command verb = app.add_subcommand("import", "Convert the images of any structured-light rig to a dataset");
  verb.add_option("folder", a->folder, "Folder with the images").required();
  verb.add_option("--config", a->config, "Description of the images (default: FOLDER/import.yaml)");
  verb.add_option("--out", a->out, "Dataset folder to write").required();
  return [a, &common] {
    const fs::path folder(a->folder);
    return import_folder(folder, a->config.empty() ? folder / kImportFile : fs::path(a->config), a->out, common);
  };
}

}  // namespace fringeslam::tools
