// SPDX-License-Identifier: Apache-2.0
// Runs a verb on a cluster as one job array, one shard per task, in a folder shared by all nodes.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace fringeslam::tools {

struct ClusterJob {
  std::vector<std::string> arguments;  // of this program, such as study run FILE; --out, --jobs and --shard are added
  std::filesystem::path folder;        // --out
  int tasks = 1, cpus = 1;
};

// Writes FOLDER/slurm.sh, submits it and returns the job's id. Throws Error with Slurm's message.
std::string submit_to_slurm(const ClusterJob& job);

// Waits until the job has left the queue. Throws Error on Ctrl-C or if the controller is unreachable for long.
void wait_for_slurm(const std::string& job);

}  // namespace fringeslam::tools
