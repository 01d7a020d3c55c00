// SPDX-License-Identifier: Apache-2.0
// Assesses the views of a watched scene in the background, with the lowest priority and on one core. A newer scene
// cancels the assessment of its predecessor.
#pragma once

#include <chrono>
#include <condition_variable>
#include <functional>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "tools/authoring/difficulty.h"
#include "tools/authoring/watched_scene.h"

namespace fringeslam::tools {

class DifficultyRun {
 public:
  static constexpr size_t kMost = 100;  // views assessed

  struct State {
    uint64_t scene_number = 0;          // of the scene assessed
    std::vector<ViewDifficulty> views;  // so far
    bool done = false;
    std::string error = {};  // why nothing more can be assessed
  };

  // `scene` must outlive this.
  explicit DifficultyRun(const WatchedScene& scene);
  ~DifficultyRun();
  DifficultyRun(const DifficultyRun&) = delete;
  DifficultyRun& operator=(const DifficultyRun&) = delete;

  // Waits for more than `known` views of a scene, or for all, at most `longest` or until `given_up` returns true.
  State await_more(uint64_t scene_number, size_t known, std::chrono::milliseconds longest,
                   const std::function<bool()>& given_up) const;

 private:
  void run();
  void assess(const WatchedScene::State& now);

  const WatchedScene& scene_;
  mutable std::mutex mutex_;  // guards the members below
  mutable std::condition_variable changed_;
  State state_;
  bool stopping_ = false;

  std::thread thread_;  // last: uses the other members
};

}  // namespace fringeslam::tools
