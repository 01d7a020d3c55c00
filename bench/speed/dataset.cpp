// SPDX-License-Identifier: Apache-2.0
// Throughput of a dataset relative to rendering its samples alone.
#include <unistd.h>

#include <cstdio>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <opencv2/core/utility.hpp>

#include "bench/datasets/spec.h"
#include "bench/row.h"
#include "bench/script.h"
#include "bench/speed/interleaving.h"
#include "core/io/files.h"

namespace fringeslam::bench {

namespace {

namespace fs = std::filesystem;

// Returns samples per second of one worker: worlds, rendering, ground truth, encoding, and joined tar files.
double generated_per_s(const fs::path& spec, const fs::path& out) {
  const std::string answer = out.string() + ".json";
  run_program("dataset '" + spec.string() + "' --out '" + out.string() + "' --jobs 1", answer);
  const double rate = nlohmann::json::parse(std::ifstream(answer))["samples_a_second"];
  fs::remove_all(out);
  return rate;
}

// Returns samples per second of the renderer in one thread, with ground truth. The worlds are prepared outside the
// measured time, and nothing is kept.
double rendered_per_s(const datasets::Spec& spec) {
  const int threads = cv::getNumThreads();
  cv::setNumThreads(1);
  double seconds = 0;
  for (int trial = 0; trial < spec.trials(); ++trial) {
    const sim::Scene scene = datasets::scene_of(spec, studies::trial_of(spec, trial));
    sim::VirtualRig rig(scene, {});
    seconds += seconds_of([&] {
      for (int view = 0; view < spec.views; ++view) (void)rig.simulate(scene.patterns);
    });
  }
  cv::setNumThreads(threads);
  return spec.samples / seconds;
}

// Interleaved, so that other load on the machine affects both alike.
std::vector<Row> dataset_rows(const Context& context) {
  const fs::path folder = fs::temp_directory_path() / ("fringeslam-dataset-" + std::to_string(::getpid()));
  fs::create_directories(folder);
  const fs::path file = folder / "dataset.yaml";
  write_text(file, std::string("name: speed\nscenes: [") + FRINGESLAM_SCENES + "/boxes_and_foam]\nviews: 4\nsamples: " +
                       (context.quick ? "8" : "32") + "\nsplit: {train: 1}\nsamples_per_tar: 8\nparameters:\n" +
                       "  light.ambient_lux: {log_uniform: [10, 1000]}\n");
  const datasets::Spec spec = datasets::read_spec(file);
  std::vector<double> ratio, rate;
  for (int turn = 0; turn < (context.quick ? 2 : 5); ++turn) {
    const double bare = rendered_per_s(spec);
    rate.push_back(generated_per_s(file, folder / std::to_string(turn)));
    ratio.push_back(rate.back() / bare);
  }
  fs::remove_all(folder);
  std::fprintf(stderr, "  one worker: %.2f samples of nine images per second\n", median(rate));
  return {median_row("speed.dataset", ratio, "of bare rendering", 0.7, Limit::least)};
}

}  // namespace

std::vector<Item> dataset_items() {
  return {{{"speed.dataset"}, "a dataset with one worker, throughput relative to bare rendering", dataset_rows}};
}

}  // namespace fringeslam::bench
