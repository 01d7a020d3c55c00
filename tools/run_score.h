// SPDX-License-Identifier: Apache-2.0
// Scores a run folder from its own files and its ground-truth files alone (docs/method.md, section 13).
#pragma once

#include <filesystem>
#include <functional>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "core/score/score.h"
#include "core/score/victim_score.h"

namespace fringeslam::tools {

struct FrameScore {
  int index = 0;
  DepthScore depth;
};

struct PairScore {
  int previous = 0, current = 0;
  MotionScore motion;
  double error_over_bound = 0;  // motion error over its Cramér-Rao bound
};

struct RunScore {
  std::string name;
  uint64_t seed = 0;
  int stacks = 0, tracked = 0;
  std::vector<FrameScore> frames;
  std::vector<PairScore> pairs;
  std::optional<TrajectoryScore> trajectory;  // only for runs with two poses or more
  std::optional<TrajectoryScore> images;      // only for runs with poses of single images
  std::optional<VictimScore> victims;         // only for rigs with a thermal camera
};

// Receives the views from several threads at a time; empty functions are not called.
struct ScoreObserver {
  std::function<void(int index, const DepthEstimate&, const TruthFrame&)> view;  // each scored view once
  std::function<void(size_t done, size_t all)> progress;                         // numbers of views
};

// Scores the folder, which contains config.yaml, rig.yaml, patterns.yaml, frames/, trajectory.tum, truth/, for a rig
// with a thermal camera victims.json, and for a run with poses of single images images.tum. Throws Error on missing or
// invalid files. The truth is read from `truth_folder` instead of truth/ unless that is empty.
RunScore score_run(const std::filesystem::path& folder, const TrajectoryOptions& options = {},
                   const ScoreObserver& observer = {}, std::filesystem::path truth_folder = {});

nlohmann::ordered_json to_json(const RunScore& score);
nlohmann::ordered_json to_json(const TrajectoryScore& score);

// Returns the papers' motion table, then depth and trajectory figures, as plain text.
std::string to_table(const RunScore& score);
std::string to_table(const TrajectoryScore& score);
// Returns the statistics that evo prints and to_table() leaves out.
std::string statistics_table(const TrajectoryScore& score);

}  // namespace fringeslam::tools
