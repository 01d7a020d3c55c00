// SPDX-License-Identifier: Apache-2.0
#include "bench/evaluation/limited_process.h"

#include <fcntl.h>
#include <signal.h>
#include <spawn.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstring>
#include <fstream>
#include <map>
#include <sstream>
#include <thread>
#include <vector>

#include "core/types/error.h"

namespace fringeslam::evaluation {

namespace {

using Clock = std::chrono::steady_clock;

struct Process {
  pid_t parent = 0;
  double mib = 0;
};

// Reads /proc: parent and resident memory of every process.
std::map<pid_t, Process> all_processes() {
  std::map<pid_t, Process> all;
  const double page_mib = static_cast<double>(sysconf(_SC_PAGESIZE)) / (1 << 20);
  std::error_code ignored;
  for (const auto& entry : std::filesystem::directory_iterator("/proc", ignored)) {
    const std::string name = entry.path().filename();
    if (name.find_first_not_of("0123456789") != std::string::npos) continue;
    std::stringstream stat;
    stat << std::ifstream(entry.path() / "stat").rdbuf();
    const std::string text = stat.str();
    // The second field, the program's name in parentheses, may contain anything.
    const size_t end = text.rfind(')');
    if (end == std::string::npos) continue;
    std::istringstream fields(text.substr(end + 1));
    std::vector<std::string> values(22);
    for (std::string& value : values) fields >> value;
    if (!fields) continue;
    Process process;
    process.parent = static_cast<pid_t>(std::stol(values[1]));
    process.mib = static_cast<double>(std::stol(values[21])) * page_mib;
    all[static_cast<pid_t>(std::stol(name))] = process;
  }
  return all;
}

// Returns this process's descendants and their memory, without those that it had before it started the system: its image
// decoders.
std::map<pid_t, double> descendants(const std::map<pid_t, double>& own = {}) {
  const std::map<pid_t, Process> all = all_processes();
  std::map<pid_t, double> found;
  for (const auto& [pid, process] : all) {
    pid_t ancestor = process.parent;
    while (ancestor > 1 && ancestor != getpid()) {
      const auto parent = all.find(ancestor);
      ancestor = parent == all.end() ? 0 : parent->second.parent;
    }
    if (ancestor == getpid() && !own.contains(pid)) found[pid] = process.mib;
  }
  return found;
}

// Detached processes become children of this one; returns whether there were any descendants.
bool kill_all(const std::map<pid_t, double>& own) {
  bool any = false;
  for (int attempt = 0; attempt < 1000; ++attempt) {
    const std::map<pid_t, double> alive = descendants(own);
    for (const auto& [pid, mib] : alive) kill(pid, SIGKILL);
    bool reaped = false;
    while (waitpid(-1, nullptr, WNOHANG) > 0) reaped = true;
    if (alive.empty() && !reaped) return any;
    any = true;
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  throw Error("evaluate: a process of the system cannot be killed");
}

pid_t start(const std::string& command, const std::filesystem::path& folder, const std::filesystem::path& log) {
  posix_spawn_file_actions_t files;
  posix_spawn_file_actions_init(&files);
  posix_spawn_file_actions_addchdir_np(&files, folder.c_str());
  posix_spawn_file_actions_addopen(&files, 0, "/dev/null", O_RDONLY, 0);
  posix_spawn_file_actions_addopen(&files, 1, log.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0644);
  posix_spawn_file_actions_adddup2(&files, 1, 2);
  posix_spawnattr_t attributes;
  posix_spawnattr_init(&attributes);
  posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSID);
  std::string shell = "sh", flag = "-c", text = command;
  char* words[] = {shell.data(), flag.data(), text.data(), nullptr};
  pid_t pid = -1;
  const int failure = posix_spawn(&pid, "/bin/sh", &files, &attributes, words, environ);
  posix_spawn_file_actions_destroy(&files);
  posix_spawnattr_destroy(&attributes);
  if (failure != 0)
    throw Error("evaluate: cannot start a process in " + folder.string() + ": " + std::strerror(failure));
  return pid;
}

}  // namespace

std::string to_string(ProcessEnd end) {
  switch (end) {
    case ProcessEnd::finished:
      return "finished";
    case ProcessEnd::failed:
      return "failed";
    case ProcessEnd::timed_out:
      return "timed_out";
    case ProcessEnd::out_of_memory:
      return "out_of_memory";
    case ProcessEnd::interrupted:
      return "interrupted";
  }
  return "";
}

ProcessReport run_limited(const std::string& command, const std::filesystem::path& folder,
                          const std::filesystem::path& log, const ProcessLimits& limits,
                          const std::function<bool()>& stop) {
  prctl(PR_SET_CHILD_SUBREAPER, 1);
  const std::map<pid_t, double> own = descendants();
  const auto begin = Clock::now();
  const pid_t pid = start(command, folder, log);
  ProcessReport report;
  for (;;) {
    int status = 0;
    const pid_t ended = waitpid(pid, &status, WNOHANG);
    report.seconds = std::chrono::duration<double>(Clock::now() - begin).count();
    if (ended == pid) {
      report.exit_code = WIFSIGNALED(status) ? 128 + WTERMSIG(status) : WEXITSTATUS(status);
      report.end = report.exit_code == 0 ? ProcessEnd::finished : ProcessEnd::failed;
      break;
    }
    double mib = 0;
    for (const auto& [process, its_mib] : descendants(own)) mib += its_mib;
    report.peak_mib = std::max(report.peak_mib, mib);
    if (stop())
      report.end = ProcessEnd::interrupted;
    else if (report.seconds > limits.timeout_s)
      report.end = ProcessEnd::timed_out;
    else if (mib > limits.memory_mib)
      report.end = ProcessEnd::out_of_memory;
    else {
      std::this_thread::sleep_for(std::chrono::milliseconds(report.seconds < 1 ? 10 : 50));
      continue;
    }
    break;
  }
  const bool running = kill_all(own);
  report.left_processes = running && (report.end == ProcessEnd::finished || report.end == ProcessEnd::failed);
  prctl(PR_SET_CHILD_SUBREAPER, 0);
  return report;
}

}  // namespace fringeslam::evaluation
