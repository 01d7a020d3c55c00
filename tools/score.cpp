// SPDX-License-Identifier: Apache-2.0
// fringeslam score RUN | TRAJECTORY --truth TRUTH
#include <cstdio>
#include <memory>

#include "core/types/error.h"
#include "tools/run_score.h"
#include "tools/verbs.h"

namespace fringeslam::tools {

namespace fs = std::filesystem;

Verb add_score(CLI::App& app, const Common& common) {
  struct Arguments {
    std::string estimate, truth;
  };
  auto arguments = std::make_shared<Arguments>();
  CLI::App* verb = app.add_subcommand("score", "Score a run, or any TUM trajectory, against the truth");
  verb->add_option("estimate", arguments->estimate, "Run folder, or trajectory file (TUM format)")->required();
  verb->add_option("--truth", arguments->truth, "True trajectory (TUM format); a run folder brings its own");
  return [arguments, &common] {
    const fs::path path = arguments->estimate;
    if (fs::is_directory(path)) {
      if (!fs::exists(path / "truth" / "truth.tum"))
        throw Error(path.string() + ": holds no truth/truth.tum, so it cannot be scored");
      if (!arguments->truth.empty()) throw Error("score: a run folder is scored by its own truth; leave out --truth");
      const RunScore score = score_run(path);
      std::fputs(common.json ? (to_json(score).dump(2) + "\n").c_str() : to_table(score).c_str(), stdout);
      return 0;
    }
    if (arguments->truth.empty()) throw Error("score: a trajectory needs its true one: add --truth FILE");
    const TrajectoryScore score = score_trajectory(read_tum(path), read_tum(arguments->truth));
    std::fputs(common.json ? (to_json(score).dump(2) + "\n").c_str() : to_table(score).c_str(), stdout);
    return 0;
  };
}

}  // namespace fringeslam::tools
