// SPDX-License-Identifier: Apache-2.0
// Cost of decoding the images of a dataset in other processes, relative to decoding them in the program.
#include <unistd.h>

#include <cstdio>
#include <filesystem>

#include "bench/row.h"
#include "bench/speed/interleaving.h"
#include "core/io/files.h"
#include "core/io/image_worker.h"
#include "core/rig/dataset.h"
#include "core/types/error.h"
#include "sim/scene/scene.h"
#include "sim/virtual_rig.h"

namespace fringeslam::bench {

namespace {

namespace fs = std::filesystem;

// The views of boxes_and_foam as a dataset, with a depth image of each as EXR.
void record(const fs::path& folder) {
  const sim::Scene scene = sim::load_scene(std::string(FRINGESLAM_SCENES) + "/boxes_and_foam/scene.yaml");
  sim::VirtualRig rig(scene, {});
  RecordingRig recording(rig, folder);
  int view = 0;
  while (recording.capture(scene.patterns)) ++view;
  recording.finish("load", 1, false);
  const cv::Mat1f depth(scene.rig.camera.height, scene.rig.camera.width, 0.5f);
  for (int i = 0; i < view; ++i) write_exr(folder / ("depth" + std::to_string(i) + ".exr"), {{"depth", depth}});
}

void load(const fs::path& folder) {
  ReplayRig rig(folder);
  for (int view = 0; rig.capture(rig.sequence()); ++view)
    (void)read_exr(folder / ("depth" + std::to_string(view) + ".exr"));
}

std::vector<Row> load_rows(const Context& context) {
  const fs::path folder = fs::temp_directory_path() / ("fringeslam-load-" + std::to_string(::getpid()));
  fs::create_directories(folder);
  record(folder);
  const auto times = interleaved_times({[&] { load(folder); },
                                        [&] {
                                          decode_in_this_process(true);
                                          load(folder);
                                          decode_in_this_process(false);
                                        }},
                                       context.quick ? 9 : 41);
  fs::remove_all(folder);
  std::fprintf(stderr, "  %.1f ms in workers, %.1f ms in the program\n", 1e3 * median(times[0]),
               1e3 * median(times[1]));
  return {median_row("speed.load", ratios(times[0], times[1]), "of direct", 1.1)};
}

}  // namespace

std::vector<Item> load_items() {
  return {{{"speed.load"}, "loading a dataset whose images are decoded in sandboxed processes", load_rows}};
}

}  // namespace fringeslam::bench
