// SPDX-License-Identifier: Apache-2.0
// A study on a cluster: one job array, a shard each task, on a folder that all nodes share.
#pragma once

#include <filesystem>
#include <string>

#include "bench/studies/study.h"

namespace fringeslam::tools {

// Writes FOLDER/slurm.sh and submits it: the job's number. Throws Error with what Slurm says.
std::string submit_to_slurm(const studies::Study& study, const std::filesystem::path& folder, int tasks, int cpus);

// Until the job has left the queue. Throws Error when the controller is away for long, or on Ctrl-C.
void wait_for_slurm(const std::string& job);

}  // namespace fringeslam::tools
