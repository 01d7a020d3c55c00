// SPDX-License-Identifier: Apache-2.0
// fringeslam landmarks SCENE|DATASET --out FOLDER: extracts landmarks in every view and re-identifies them in earlier
// keyframes.
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>

#include "core/io/files.h"
#include "core/io/json_text.h"
#include "core/mapper/driver.h"
#include "core/rig/dataset.h"
#include "tools/landmark_files.h"
#include "tools/output_file.h"
#include "tools/progress.h"
#include "tools/report/landmark_pictures.h"
#include "tools/source.h"
#include "tools/verbs.h"

namespace fringeslam::tools {

namespace fs = std::filesystem;

namespace {

struct LandmarksArguments {
  std::string source, out;
  std::vector<std::string> sets;
  SceneVariant variant;
};

void write_pictures(const fs::path& folder, const FrameResult& view, const LandmarkStages& stages) {
  const Conditioned& c = stages.conditioned;
  const std::pair<const char*, cv::Mat> pictures[] = {{"depth", stages.levels},
                                                      {"foreground", c.foreground},
                                                      {"edges", c.edges.mask()},
                                                      {"dilated", c.dilated.mask()},
                                                      {"thinned", c.thinned.mask()},
                                                      {"cleaned", c.cleaned},
                                                      {"texture_keypoints", texture_keypoints_picture(view)},
                                                      {"depth_keypoints", depth_keypoints_picture(view, stages)},
                                                      {"clusters", cluster_picture(view, stages)},
                                                      {"landmarks", landmark_picture(view)},
                                                      {"stages", landmark_sheet(view, stages)}};
  for (const auto& [name, picture] : pictures) write_png(folder / (std::string(name) + ".png"), picture);
}

int landmarks(const LandmarksArguments& arguments, const Common& common) {
  Settings settings = parse_settings(arguments.sets);
  settings.pipeline.tracking.landmarks = LandmarkViews::every_frame;
  settings.pipeline.mapping.every_view = true;
  const auto source = open_source(arguments.source, arguments.variant, settings, sets_any_of(arguments.sets, "render"));
  require_not_an_input(arguments.out, source->inputs());
  StagedFolder folder(arguments.out, "landmarks");
  const auto rig = source->open(folder.path());
  const PipelineOptions& options = settings.pipeline;
  Pipeline pipeline(rig->model(), source->sequence(), options, Pose{});
  ThermalObserver thermal(rig->model(), options.thermal);
  nlohmann::ordered_json frames = nlohmann::ordered_json::array();
  std::optional<FrameResult> before;
  int before_number = 0, found = 0, recognised = 0;
  {
    Progress progress("landmarks", source->stacks(), common.quiet || common.json);
    // All patterns for every view, whatever the map predicts: every view is to become a keyframe.
    const auto capture = [&](const PatternSequence&) { return rig->capture(source->sequence()); };
    Driver(Driver::Capture(capture), pipeline).run([&](const MappedView& mapped) {
      const FrameResult& view = mapped.result;
      const int index = mapped.stack.index;
      LandmarkStages stages;
      extract_landmarks(view.frame, view.keypoints, rig->model(), options.keypoints, options.conditioning,
                        options.clusters, options.landmarks, &stages);
      const fs::path here = folder.path() / "frames" / stack_name(index);
      fs::create_directories(here);
      write_pictures(here, view, stages);
      write_text(here / "keypoints.csv", keypoint_table(view.landmarks));
      if (before) write_png(here / "matches.png", recognition_picture(*before, before_number, view));
      frames.push_back(landmarks_json(index, view, thermal.observe(mapped.stack, view)));
      found += static_cast<int>(view.landmarks.landmarks.size());
      recognised += static_cast<int>(view.recognitions.size());
      if (view.keyframe >= 0) {
        before = view;
        before_number = before->keyframe;
      }
      progress.step();
    });
  }
  write_text(folder.path() / "landmarks.json", json_text(frames, 2) + "\n");
  folder.commit();
  print_result(common, {{"written", arguments.out}, {"landmarks", found}, {"recognised", recognised}},
               "written: " + arguments.out + ": " + std::to_string(found) + " landmarks in " +
                   std::to_string(frames.size()) + " views, " + std::to_string(recognised) +
                   " of them re-identified  (see frames/*/stages.png and matches.png)");
  return 0;
}

}  // namespace

Verb add_landmarks(Command app, const Common& common) {
  auto arguments = std::make_shared<LandmarksArguments>();
  const Command verb =
      app.add_subcommand("landmarks", "Write images and tables of landmark extraction and re-identification");
  verb.add_option("source", arguments->source, "Scene file, folder with scene.yaml, or dataset folder").required();
  verb.add_option("--out", arguments->out, "Folder to write").required();
  arguments->variant.add_to(verb);
  verb.add_option("--set", arguments->sets, "Setting: stage.key=value (repeatable; see `run --help`)");
  return [arguments, &common] { return landmarks(*arguments, common); };
}

}  // namespace fringeslam::tools
