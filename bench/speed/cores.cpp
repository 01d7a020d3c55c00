// SPDX-License-Identifier: Apache-2.0
// How the pipeline scales with the number of cores: a run on one core measures the serial and the parallel part of each
// stage, which predict the frame rate on more cores; measurements on two cores check the prediction.
#include <sched.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <memory>
#include <opencv2/core/parallel/parallel_backend.hpp>
#include <string>

#include "bench/row.h"
#include "bench/speed/interleaving.h"
#include "bench/speed/loop_rig.h"
#include "core/base/stage_clock.h"
#include "core/mapper/driver.h"
#include "core/score/score.h"

namespace fringeslam::bench {

namespace {

// Runs parallel loops serially and adds up their time, by stage.
class CountedLoops : public cv::parallel::ParallelForAPI {
 public:
  void parallel_for(int tasks, FN_parallel_for_body_cb_t body, void* data) override {
    const double seconds = seconds_of([&] { body(0, tasks, data); });
    if (const StageClock* clock = StageClock::of_thread()) seconds_[clock->stage()] += seconds;
  }
  int getThreadNum() const override { return 0; }
  int getNumThreads() const override { return 2; }  // with one, OpenCV would not call this class
  int setNumThreads(int) override { return 2; }
  const char* getName() const override { return "counted"; }

  const std::map<std::string, double>& seconds() const { return seconds_; }

 private:
  std::map<std::string, double> seconds_;
};

// While it exists, this thread and those that it starts run on one core, and parallel loops are counted.
class OneCore {
 public:
  OneCore() : loops_(std::make_shared<CountedLoops>()) {
    CPU_ZERO(&before_);
    sched_getaffinity(0, sizeof before_, &before_);
    cpu_set_t one;
    CPU_ZERO(&one);
    CPU_SET(sched_getcpu(), &one);
    sched_setaffinity(0, sizeof one, &one);
    cv::parallel::setParallelForBackend(loops_, false);
  }
  ~OneCore() {
    cv::parallel::setParallelForBackend(std::shared_ptr<cv::parallel::ParallelForAPI>(), false);
    sched_setaffinity(0, sizeof before_, &before_);
  }
  OneCore(const OneCore&) = delete;
  OneCore& operator=(const OneCore&) = delete;

  const CountedLoops& loops() const { return *loops_; }

 private:
  std::shared_ptr<CountedLoops> loops_;
  cpu_set_t before_;
};

struct Part {
  double serial_s = 0, parallel_s = 0;

  double on(double cores) const { return serial_s + parallel_s / cores; }
};

// Per view.
struct Profile {
  std::map<std::string, Part> stages;
  Part preprocessing, mapping;  // the former runs ahead, in two threads

  double one_at_a_time_s(double cores) const { return preprocessing.on(cores) + mapping.on(cores); }
  // While the next view is preprocessed on one core, mapping has the others; then it has all of them.
  double pace_s(double cores) const {
    const double ahead_s = preprocessing.on(1);
    if (cores < 2) return ahead_s + mapping.on(1);
    const double mapped = ahead_s / mapping.on(cores - 1);
    return mapped < 1 ? ahead_s + (1 - mapped) * mapping.on(cores) : std::max(mapping.on(cores - 1), ahead_s / 2);
  }
};

Profile profile_of(const LoopScene& loop) {
  StageClock clock;
  Pipeline pipeline(loop.scene.rig, loop.scene.patterns, {}, loop.scene.trajectory[0].world_from_robot);
  const StageClock::Use use(clock);
  const OneCore one;
  const auto parallel_s = [&] {
    double sum = 0;
    for (const auto& [stage, seconds] : one.loops().seconds()) sum += seconds;
    return sum;
  };
  double preprocessing_s = 0, mapping_s = 0, preprocessing_parallel_s = 0;
  for (const FringeStack& stack : loop.stacks) {
    PreprocessedStack preprocessed;
    clock.begin_view();
    const double parallel_before_s = parallel_s();
    preprocessing_s += seconds_of([&] { preprocessed = pipeline.preprocess(stack); });
    preprocessing_parallel_s += parallel_s() - parallel_before_s;
    mapping_s += seconds_of([&] { pipeline.process(std::move(preprocessed)); });
  }
  clock.leave();
  const auto views = static_cast<double>(loop.stacks.size());
  const double mapping_parallel_s = parallel_s() - preprocessing_parallel_s;
  Profile profile;
  for (const auto& [stage, seconds] : clock.seconds()) {
    const auto found = one.loops().seconds().find(stage);
    const double parallel = found == one.loops().seconds().end() ? 0 : found->second;
    profile.stages[stage] = {(seconds - parallel) / views, parallel / views};
  }
  profile.preprocessing = {(preprocessing_s - preprocessing_parallel_s) / views, preprocessing_parallel_s / views};
  profile.mapping = {(mapping_s - mapping_parallel_s) / views, mapping_parallel_s / views};
  return profile;
}

void report(const Profile& profile) {
  std::fprintf(stderr, "  on one core, ms per view: serial + parallel\n");
  for (const auto& [stage, part] : profile.stages)
    std::fprintf(stderr, "  %-14s %6.2f + %6.2f\n", stage.c_str(), 1e3 * part.serial_s, 1e3 * part.parallel_s);
  std::fprintf(stderr, "  critical path (mapping) %.2f + %.2f, preprocessing %.2f + %.2f\n",
               1e3 * profile.mapping.serial_s, 1e3 * profile.mapping.parallel_s, 1e3 * profile.preprocessing.serial_s,
               1e3 * profile.preprocessing.parallel_s);
  std::fprintf(stderr, "  predicted frames/s into the map:");
  for (const int cores : {1, 2, 4, 8, 16}) std::fprintf(stderr, " %.1f on %d;", 1 / profile.pace_s(cores), cores);
  std::fprintf(stderr, "\n");
}

std::vector<Row> core_rows(const Context& context) {
  const int turns = context.quick ? 1 : 5;
  const LoopScene loop = rendered_loop();
  const auto views = static_cast<double>(loop.stacks.size());
  const auto cores = static_cast<double>(cv::getNumThreads());
  std::vector<double> view, pace;
  for (int turn = 0; turn < turns; ++turn) {
    const Profile profile = profile_of(loop);
    if (turn == 0) report(profile);
    Pipeline alone(loop.scene.rig, loop.scene.patterns, {}, loop.scene.trajectory[0].world_from_robot);
    const double alone_s = seconds_of([&] {
      for (const FringeStack& stack : loop.stacks) alone.process(alone.preprocess(stack));
    });
    LoopRig rig(loop, 1);
    Pipeline together(loop.scene.rig, loop.scene.patterns, {}, loop.scene.trajectory[0].world_from_robot);
    const double together_s = seconds_of([&] {
      Driver driver(rig, together);
      while (driver.next()) {
      }
    });
    view.push_back(alone_s / views / profile.one_at_a_time_s(cores));
    pace.push_back(together_s / views / profile.pace_s(cores));
    std::fprintf(stderr, "  one at a time %.1f ms, predicted %.1f; together %.1f ms, predicted %.1f\n",
                 1e3 * alone_s / views, 1e3 * profile.one_at_a_time_s(cores), 1e3 * together_s / views,
                 1e3 * profile.pace_s(cores));
  }
  return {median_row("speed.cores.view", view, "of predicted", 1.15),
          median_row("speed.cores.pace", pace, "of predicted", 1.15)};
}

}  // namespace

std::vector<Item> core_items() {
  return {{{"speed.cores.view", "speed.cores.pace"},
           "time per view on all cores, relative to the prediction from one core",
           core_rows}};
}

}  // namespace fringeslam::bench
