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
#include <csignal>
#include <cstring>
#include <exception>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>

#include "core/types/error.h"
#include "core/types/options.h"

namespace fringeslam::studies {

namespace {

using Clock = std::chrono::steady_clock;

const std::string kFailed = R"({"failed":)";  // start of an answer about the machine instead of a result

class Worker {
 public:
  explicit Worker(const std::vector<std::string>& command) {
    int to[2], from[2];
    if (pipe2(to, O_CLOEXEC) != 0 || pipe2(from, O_CLOEXEC) != 0) throw Error("workers: no pipe to a worker");
    std::vector<char*> words;
    for (const std::string& word : command) words.push_back(const_cast<char*>(word.c_str()));
    words.push_back(nullptr);
    const pid_t parent = getpid();
    pid_ = fork();
    if (pid_ < 0) throw Error("workers: cannot start a worker");
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
  std::optional<int> task() const { return task_; }
  double busy_s() const { return std::chrono::duration<double>(Clock::now() - since_).count(); }

  void give(int task) {
    const std::string line = std::to_string(task) + "\n";
    (void)!write(to_, line.data(), line.size());  // a dead worker is noticed when its answer is read
    task_ = task;
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
    task_.reset();
    return true;
  }

  void stop() { kill(pid_, SIGKILL); }

  // Waits for the process and returns how it ended.
  WorkerEnd reap() {
    int status = 0;
    rusage usage{};
    wait4(pid_, &status, 0, &usage);
    pid_ = -1;
    largest_mib_ = static_cast<double>(usage.ru_maxrss) / 1024;
    if (WIFSIGNALED(status)) return {false, {}, std::string("killed by signal ") + strsignal(WTERMSIG(status))};
    return {false, WEXITSTATUS(status), "ended with " + std::to_string(WEXITSTATUS(status))};
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
  std::optional<int> task_;
  Clock::time_point since_;
  double largest_mib_ = 0;
};

}  // namespace

WorkersReport run_tasks(const std::vector<int>& tasks, const WorkerOptions& options, double timeout_s,
                        const TaskEvents& events) {
  signal(SIGPIPE, SIG_IGN);
  WorkersReport report;
  size_t next = 0, ended = 0;
  std::vector<std::unique_ptr<Worker>> workers(std::min(static_cast<size_t>(options.jobs), tasks.size()));
  const auto replace = [&](std::unique_ptr<Worker>& worker, const WorkerEnd& end) {
    const int task = *worker->task();
    report.largest_mib = std::max(report.largest_mib, worker->largest_mib());
    worker.reset();
    ++report.restarted;
    events.failed(task, end);
    ++ended;
  };
  while (ended < tasks.size() && !events.stop()) {
    std::vector<pollfd> waits;
    for (auto& worker : workers) {
      if (!worker && next < tasks.size()) worker = std::make_unique<Worker>(options.command);
      if (worker && !worker->task() && next < tasks.size()) worker->give(tasks[next++]);
      waits.push_back({worker ? worker->output() : -1, POLLIN, 0});
    }
    constexpr int kLookMs = 100;
    if (poll(waits.data(), waits.size(), kLookMs) < 0 && errno != EINTR)
      throw Error("workers: waiting for workers failed");
    for (size_t i = 0; i < workers.size(); ++i) {
      std::unique_ptr<Worker>& worker = workers[i];
      if (!worker || !worker->task()) continue;
      const int task = *worker->task();
      if (waits[i].revents != 0) {
        std::optional<std::string> line;
        if (!worker->read_some(line)) {
          const WorkerEnd end = worker->reap();
          replace(worker, end);
        } else if (line) {
          events.answered(task, *line);
          ++ended;
        }
      } else if (worker->busy_s() > timeout_s) {
        worker->stop();
        (void)worker->reap();
        replace(worker, {true, {}, "took longer than " + to_text(timeout_s) + " s"});
      }
    }
  }
  if (ended < tasks.size()) return report;  // workers still busy are killed
  for (auto& worker : workers) {
    if (!worker) continue;
    worker->finish();
    report.largest_mib = std::max(report.largest_mib, worker->largest_mib());
  }
  return report;
}

WorkersReport run_trials(const Study& study, const std::vector<int>& trials, const WorkerOptions& options,
                         const std::function<void(int, const std::string&)>& tell, const std::function<bool()>& stop) {
  std::string failure;  // of the machine
  const auto failed = [&](int trial, const WorkerEnd& end) {
    if (end.exit_code == 2 || end.exit_code == 127) {
      failure = "trial " + std::to_string(trial) + ": its worker could not start or read the study";
      return;
    }
    TrialResult result;
    result.index = trial;
    result.outcome = end.timed_out ? Outcome::timed_out : Outcome::crashed;
    result.cause = to_string(result.outcome);
    result.message = end.message;
    tell(trial, to_line(study, trial_of(study, trial), result));
  };
  const auto answered = [&](int trial, const std::string& line) {
    if (!line.starts_with(kFailed)) return tell(trial, line);
    const auto answer = nlohmann::json::parse(line, nullptr, false);
    failure = answer.is_object() ? answer.value("failed", "") : "a worker gave no valid answer";
    failure = "trial " + std::to_string(trial) + ": " + failure;
  };
  const WorkersReport report =
      run_tasks(trials, options, study.timeout_s, {answered, failed, [&] { return !failure.empty() || stop(); }});
  if (!failure.empty()) throw Error(failure);
  return report;
}

void work(int tasks, const std::function<std::string(int)>& answer) {
  std::signal(SIGBUS, SIG_DFL);  // a worker that dies costs one trial, unlike one that reports an error
  for (int task = 0; std::cin >> task;) {
    if (task < 0 || task >= tasks) throw Error("worker: there is no trial " + std::to_string(task));
    const std::string line = answer(task) + "\n";
    std::cout << line << std::flush;
  }
}

void work(const Study& study, const std::function<std::string(const Trial&)>& answer) {
  work(study.trials, [&](int trial) {
    try {
      return answer(trial_of(study, trial));
    } catch (const std::exception& e) {
      return kFailed + nlohmann::json(e.what()).dump(-1, ' ', false, nlohmann::json::error_handler_t::replace) + "}";
    }
  });
}

}  // namespace fringeslam::studies
