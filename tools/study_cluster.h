// SPDX-License-Identifier: Apache-2.0
// Runs a study on a cluster as one job array, one shard per task, in a folder shared by all nodes.
#pragma once

#include <filesystem>
#include <string>

#include "bench/studies/study.h"

namespace fringeslam::tools {

// Writes FOLDER/slurm.sh, submits it and returns the job's id. Throws Error with Slurm's message.
std::string submit_to_slurm(const studies::Study& study, const std::filesystem::path& folder, int tasks, int cpus);

// Waits until the job has left the queue. Throws Error on Ctrl-C or if the controller is unreachable for long.
void wait_for_slurm(const std::string& job);

}  // namespace fringeslam::tools
