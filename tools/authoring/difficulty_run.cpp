// SPDX-License-Identifier: Apache-2.0
#include "tools/authoring/difficulty_run.h"

#include <sys/resource.h>

#include "core/base/parallel.h"

namespace fringeslam::tools {

namespace {

constexpr std::chrono::milliseconds kNextLook(100);  // between looks for a newer scene or whether a viewer left
constexpr int kLowestPriority = 19;

}  // namespace

DifficultyRun::DifficultyRun(const WatchedScene& scene) : scene_(scene) {
  thread_ = std::thread([this] { run(); });
}

DifficultyRun::~DifficultyRun() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  changed_.notify_all();
  thread_.join();
}

DifficultyRun::State DifficultyRun::await_more(uint64_t scene_number, size_t known, std::chrono::milliseconds longest,
                                               const std::function<bool()>& given_up) const {
  const auto end = std::chrono::steady_clock::now() + longest;
  std::unique_lock lock(mutex_);
  const auto has_more = [&] {
    return state_.scene_number > scene_number ||
           (state_.scene_number == scene_number && (state_.done || state_.views.size() > known));
  };
  while (!has_more() && std::chrono::steady_clock::now() < end && !given_up()) changed_.wait_for(lock, kNextLook);
  return state_;
}

void DifficultyRun::run() {
  setpriority(PRIO_PROCESS, 0, kLowestPriority);  // of this thread only
  const SerialLoops one_core;
  uint64_t last = 0;
  for (;;) {
    const WatchedScene::State now = scene_.state();
    if (now.scene_number != last) {
      last = now.scene_number;
      assess(now);
    }
    std::unique_lock lock(mutex_);
    if (changed_.wait_for(lock, kNextLook, [&] { return stopping_; })) return;
  }
}

void DifficultyRun::assess(const WatchedScene::State& now) {
  const auto change = [&](const auto& how) {
    {
      const std::lock_guard lock(mutex_);
      how(state_);
    }
    changed_.notify_all();
  };
  const auto is_old = [&] {
    {
      const std::lock_guard lock(mutex_);
      if (stopping_) return true;
    }
    return scene_.state().scene_number != now.scene_number;
  };
  change([&](State& state) { state = {.scene_number = now.scene_number, .views = {}}; });
  std::string error;
  try {
    assess_difficulty(
        now.scene->scene, now.scene->view, kMost,
        [&](ViewDifficulty view) { change([&](State& state) { state.views.push_back(std::move(view)); }); }, is_old);
  } catch (const std::exception& failure) {
    error = failure.what();
  }
  if (is_old()) return;
  change([&](State& state) { state.done = true, state.error = error; });
}

}  // namespace fringeslam::tools
