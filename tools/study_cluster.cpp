// SPDX-License-Identifier: Apache-2.0
// fringeslam study submit: runs a study as a Slurm job array.
#include "tools/study_cluster.h"

#include <sys/wait.h>

#include <array>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <thread>

#include "bench/studies/study.h"
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
  if (!pipe) throw Error("study submit: " + command + " cannot be started");
  std::string text;
  std::array<char, 4096> bytes;
  while (const size_t count = fread(bytes.data(), 1, bytes.size(), pipe.get())) text.append(bytes.data(), count);
  const int status = pclose(pipe.release());
  while (!text.empty() && text.back() == '\n') text.pop_back();
  if (WIFEXITED(status) && WEXITSTATUS(status) == 0) return text;
  const int code = WIFEXITED(status) ? WEXITSTATUS(status) : 0;
  throw Error("study submit: " + command + ": " +
              (code == 127   ? "command not found; is Slurm installed?"
               : code == 124 ? "no answer within " + std::to_string(timeout_s) + " s; is the controller running?"
                             : text));
}

void check_array(int tasks) {
  const std::string config = answer_of("scontrol show config");
  const size_t at = config.find("MaxArraySize");
  if (at == std::string::npos) return;
  const int most = std::atoi(config.c_str() + config.find('=', at) + 1);
  if (tasks > most - 1)
    throw Error("study submit: the cluster's job arrays have at most " + std::to_string(most - 1) +
                " tasks (MaxArraySize); "
                "give fewer --tasks, with more trials each");
}

}  // namespace

std::string submit_to_slurm(const studies::Study& study, const fs::path& folder, int tasks, int cpus) {
  check_array(tasks);
  const fs::path out = fs::absolute(folder), logs = out / "logs";
  fs::create_directories(logs);
  const std::string n = std::to_string(tasks);
  const std::string program = fs::read_symlink("/proc/self/exe").string();
  // Running a task twice is harmless, so it may be requeued if its node fails.
  write_text(out / "slurm.sh", "#!/bin/bash\n#SBATCH --job-name=fringeslam\n#SBATCH --array=0-" +
                                   std::to_string(tasks - 1) + "\n#SBATCH --cpus-per-task=" + std::to_string(cpus) +
                                   "\n#SBATCH --requeue\n#SBATCH --open-mode=append\n#SBATCH --output=" +
                                   (logs / "%a.log").string() + "\nexec " + quoted(program) + " --quiet study run " +
                                   quoted(fs::absolute(study.file).string()) + " --out " + quoted(out.string()) +
                                   " --jobs " + std::to_string(cpus) + " --shard $SLURM_ARRAY_TASK_ID/" + n + "\n");
  return answer_of("sbatch --parsable " + quoted((out / "slurm.sh").string()));
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
