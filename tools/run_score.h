// SPDX-License-Identifier: Apache-2.0
// The score of a run folder: reads what the run wrote and what the truth files say, nothing else.
#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>
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
  double error_over_bound = 0;
};

struct RunScore {
  std::string name;
  uint64_t seed = 0;
  int stacks = 0, tracked = 0;
  std::vector<FrameScore> frames;
  std::vector<PairScore> pairs;
  TrajectoryScore trajectory;
  std::optional<VictimScore> victims;  // of a rig with a thermal camera
};

// `folder` holds config.yaml, rig.yaml, patterns.yaml, frames/, trajectory.tum, truth/ and, of a rig with a thermal
// camera, victims.json.
RunScore score_run(const std::filesystem::path& folder, const TrajectoryOptions& options = {});

nlohmann::ordered_json to_json(const RunScore& score);
nlohmann::ordered_json to_json(const TrajectoryScore& score);

// The papers' table, then depth and trajectory figures: plain text for people.
std::string to_table(const RunScore& score);
std::string to_table(const TrajectoryScore& score);
// What to_table() leaves out of a trajectory's score: evo's statistics.
std::string statistics_table(const TrajectoryScore& score);

}  // namespace fringeslam::tools
