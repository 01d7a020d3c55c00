// SPDX-License-Identifier: Apache-2.0
#include "bench/studies/workers.h"

#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstring>
#include <iostream>
#include <memory>
#include <optional>

#include "core/types/error.h"
#include "core/types/options.h"

namespace fringeslam::studies {

namespace {

using Clock = std::chrono::steady_clock;

class Worker {
 public:
  explicit Worker(const std::vector<std::string>& command) {
    int to[2], from[2];
    if (pipe2(to, O_CLOEXEC) != 0 || pipe2(from, O_CLOEXEC) != 0) throw Error("study: no pipe to a worker");
    std::vector<char*> words;
    for (const std::string& word : command) words.push_back(const_cast<char*>(word.c_str()));
    words.push_back(nullptr);
    const pid_t parent = getpid();
    pid_ = fork();
    if (pid_ < 0) throw Error("study: cannot start a worker");
    if (pid_ == 0) {
      prctl(PR_SET_PDEATHSIG, SIGKILL);  // without the parent nobody would read its answers
      if (getppid() != parent) _exit(1);
      setpgid(0, 0);  // Ctrl-C is handled by the parent
      dup2(to[0], 0);
      dup2(from[1], 1);
      execvp(words[0], words.data());
      _exit(127);
    }
    close(to[0]);
    close(from[1]);
    to_ = to[1];
    from_ = from[0];
  }

  ~Worker() {
    if (pid_ > 0) {
      kill(pid_, SIGKILL);
      (void)reap();
    }
    close(to_);
    close(from_);
  }
  Worker(const Worker&) = delete;
  Worker& operator=(const Worker&) = delete;

  int output() const { return from_; }
  std::optional<int> trial() const { return trial_; }
  double busy_s() const { return std::chrono::duration<double>(Clock::now() - since_).count(); }

  void give(int trial) {
    const std::string line = std::to_string(trial) + "\n";
    (void)!write(to_, line.data(), line.size());  // a dead worker is noticed when its answer is read
    trial_ = trial;
    since_ = Clock::now();
  }

  // Reads available bytes; `line` is set if they complete a line. Returns false at the end of the output.
  bool read_some(std::optional<std::string>& line) {
    char bytes[4096];
    const ssize_t count = read(from_, bytes, sizeof bytes);
    if (count <= 0) return count < 0 && errno == EINTR;
    text_.append(bytes, static_cast<size_t>(count));
    const size_t end = text_.find('\n');
    if (end == std::string::npos) return true;
    line = text_.substr(0, end);
    text_.erase(0, end + 1);
    trial_.reset();
    return true;
  }

  void stop() { kill(pid_, SIGKILL); }

  // Waits for the process and returns how it ended, as text.
  std::string reap() {
    int status = 0;
    rusage usage{};
    wait4(pid_, &status, 0, &usage);
    pid_ = -1;
    largest_mib_ = static_cast<double>(usage.ru_maxrss) / 1024;
    return WIFSIGNALED(status) ? std::string("killed by signal ") + strsignal(WTERMSIG(status))
                               : "ended with " + std::to_string(WEXITSTATUS(status));
  }
  void finish() {
    close(to_);
    to_ = -1;
    (void)reap();
  }
  double largest_mib() const { return largest_mib_; }

 private:
  pid_t pid_ = -1;
  int to_ = -1, from_ = -1;
  std::string text_;
  std::optional<int> trial_;
  Clock::time_point since_;
  double largest_mib_ = 0;
};

}  // namespace

WorkersReport run_trials(const Study& study, const std::vector<int>& trials, const WorkerOptions& options,
                         const std::function<void(int, const std::string&)>& tell, const std::function<bool()>& stop) {
  signal(SIGPIPE, SIG_IGN);
  WorkersReport report;
  size_t next = 0, told = 0;
  std::vector<std::unique_ptr<Worker>> workers(std::min(static_cast<size_t>(options.jobs), trials.size()));
  const auto failed = [&](int trial, Outcome outcome, const std::string& message) {
    TrialResult result;
    result.index = trial;
    result.outcome = outcome;
    result.cause = to_string(outcome);
    result.message = message;
    tell(trial, to_line(study, trial_of(study, trial), result));
    ++told;
  };
  const auto end = [&](std::unique_ptr<Worker>& worker) {
    report.largest_mib = std::max(report.largest_mib, worker->largest_mib());
    worker.reset();
    ++report.restarted;
  };
  while (told < trials.size() && !stop()) {
    std::vector<pollfd> waits;
    for (auto& worker : workers) {
      if (!worker && next < trials.size()) worker = std::make_unique<Worker>(options.command);
      if (worker && !worker->trial() && next < trials.size()) worker->give(trials[next++]);
      waits.push_back({worker ? worker->output() : -1, POLLIN, 0});
    }
    constexpr int kLookMs = 100;
    if (poll(waits.data(), waits.size(), kLookMs) < 0 && errno != EINTR)
      throw Error("study: waiting for workers failed");
    for (size_t i = 0; i < workers.size(); ++i) {
      std::unique_ptr<Worker>& worker = workers[i];
      if (!worker || !worker->trial()) continue;
      const int trial = *worker->trial();
      if (waits[i].revents != 0) {
        std::optional<std::string> line;
        if (!worker->read_some(line)) {
          const std::string how = worker->reap();
          end(worker);
          failed(trial, Outcome::crashed, how);
        } else if (line) {
          tell(trial, *line);
          ++told;
        }
      } else if (worker->busy_s() > study.timeout_s) {
        worker->stop();
        (void)worker->reap();
        end(worker);
        failed(trial, Outcome::timed_out, "took longer than " + to_text(study.timeout_s) + " s");
      }
    }
  }
  if (told < trials.size()) return report;  // workers still busy are killed
  for (auto& worker : workers) {
    if (!worker) continue;
    worker->finish();
    report.largest_mib = std::max(report.largest_mib, worker->largest_mib());
  }
  return report;
}

void work(const Study& study, const std::function<std::string(const Trial&)>& answer) {
  for (int index = 0; std::cin >> index;) {
    if (index < 0 || index >= study.trials) throw Error("study: there is no trial " + std::to_string(index));
    const std::string line = answer(trial_of(study, index)) + "\n";
    std::cout << line << std::flush;
  }
}

}  // namespace fringeslam::studies
