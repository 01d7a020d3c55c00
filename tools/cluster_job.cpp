// SPDX-License-Identifier: Apache-2.0
// fringeslam study submit, fringeslam dataset submit.
#include "tools/cluster_job.h"

#include <sys/wait.h>

#include <array>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <sstream>
#include <thread>

#include "core/io/files.h"
#include "core/types/error.h"
#include "tools/interrupt.h"
#include "tools/shell.h"

namespace fringeslam::tools {

namespace fs = std::filesystem;

namespace {

// Returns a command's output. Throws Error if it fails or does not end within `timeout_s`.
std::string answer_of(const std::string& command, int timeout_s = 60) {
  const std::string bounded = "timeout " + std::to_string(timeout_s) + " " + command + " 2>&1";
  std::unique_ptr<FILE, int (*)(FILE*)> pipe(popen(bounded.c_str(), "r"), pclose);
  if (!pipe) throw Error("submit: " + command + " cannot be started");
  std::string text;
  std::array<char, 4096> bytes;
  while (const size_t count = fread(bytes.data(), 1, bytes.size(), pipe.get())) text.append(bytes.data(), count);
  const int status = pclose(pipe.release());
  while (!text.empty() && text.back() == '\n') text.pop_back();
  if (WIFEXITED(status) && WEXITSTATUS(status) == 0) return text;
  const int code = WIFEXITED(status) ? WEXITSTATUS(status) : 0;
  throw Error("submit: " + command + ": " +
              (code == 127   ? "command not found; is Slurm installed?"
               : code == 124 ? "no answer within " + std::to_string(timeout_s) + " s; is the controller running?"
                             : text));
}

// Returns the number in an answer of sbatch: a line of its own, perhaps with the cluster's name; other lines are messages.
std::string job_number(const std::string& answer) {
  std::istringstream lines(answer);
  std::string number;
  for (std::string line; std::getline(lines, line);) {
    line.resize(std::min(line.size(), line.find(';')));
    if (!line.empty() && line.find_first_not_of("0123456789") == std::string::npos) number = line;
  }
  if (number.empty()) throw Error("submit: sbatch does not answer with the number of a job: " + answer);
  return number;
}

void check_array(int tasks) {
  const std::string config = answer_of("scontrol show config");
  const size_t at = config.find("MaxArraySize");
  if (at == std::string::npos) return;
  const int most = std::atoi(config.c_str() + config.find('=', at) + 1);
  if (tasks > most - 1)
    throw Error("submit: the cluster's job arrays have at most " + std::to_string(most - 1) +
                " tasks (MaxArraySize); "
                "give fewer --tasks, with more trials each");
}

}  // namespace

std::string submit_to_slurm(const ClusterJob& job) {
  check_array(job.tasks);
  const fs::path out = fs::absolute(job.folder), logs = out / "logs";
  fs::create_directories(logs);
  const std::string cpus = std::to_string(job.cpus);
  std::string command = quoted(fs::read_symlink("/proc/self/exe").string()) + " --quiet";
  for (const std::string& argument : job.arguments) command += " " + quoted(argument);
  // Running a task twice is harmless, so it may be requeued if its node fails.
  StagedFile script(out / "slurm.sh");
  write_text(script.path(), "#!/bin/bash\n#SBATCH --job-name=fringeslam\n#SBATCH --array=0-" +
                                std::to_string(job.tasks - 1) + "\n#SBATCH --cpus-per-task=" + cpus +
                                "\n#SBATCH --requeue\n#SBATCH --open-mode=append\n#SBATCH --output=\"" +
                                (logs / "%a.log").string() + "\"\nexec " + command + " --out " + quoted(out.string()) +
                                " --jobs " + cpus + " --shard $SLURM_ARRAY_TASK_ID/" + std::to_string(job.tasks) +
                                "\n");
  script.commit();
  return job_number(answer_of("sbatch --parsable " + quoted((out / "slurm.sh").string())));
}

void wait_for_slurm(const std::string& job) {
  catch_interrupts();
  int unanswered = 0;
  while (!interrupted()) {
    try {
      if (answer_of("squeue --noheader --jobs=" + quoted(job)).empty()) return;
      unanswered = 0;
    } catch (const Error& e) {
      // Slurm forgets jobs some time after their end; the controller may be unreachable for a while.
      if (std::string(e.what()).find("Invalid job id") != std::string::npos) return;
      if (++unanswered == 10) throw;
    }
    wait_s(2);
  }
  throw Error("interrupted; job " + job + " continues; scancel " + job + " cancels it");
}

}  // namespace fringeslam::tools
