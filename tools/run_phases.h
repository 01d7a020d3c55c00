// SPDX-License-Identifier: Apache-2.0
// The phases of a run, with their times. After mapping, an interrupt ends the phase at its next step and skips the later
// ones; what is finished is kept. After an error, the later phases still run.
#pragma once

#include <sys/resource.h>

#include <chrono>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/base/malloc_config.h"
#include "core/types/error.h"
#include "tools/interrupt.h"
#include "tools/process.h"
#include "tools/progress.h"

namespace fringeslam::tools {

class RunPhases {
 public:
  RunPhases(std::filesystem::path folder, bool silent) : folder_(std::move(folder)), silent_(silent) {}

  // Runs a phase that writes `files` of the run folder. Unless it finishes, they are removed. Notes its error.
  void run(const std::string& name, const std::vector<std::string>& files, const std::function<void()>& phase) {
    if (!interrupted()) {
      run_always(name, files, phase);
      return;
    }
    note(name);
    leave_out(files);
  }

  // The same even after an interrupt. Returns true if the phase finished.
  bool run_always(const std::string& name, const std::vector<std::string>& files, const std::function<void()>& phase) {
    bool finished = false;
    try {
      phase();
      finished = true;
    } catch (const Stopped&) {
    } catch (const Error& error) {
      failures_.push_back(error.what());
    } catch (const std::exception& error) {
      failures_.push_back(message_of(error));
    }
    note(name);
    if (!finished) leave_out(files);
    return finished;
  }

  // Notes the end of a phase: the time since the last one, and the largest resident size of the process so far.
  void note(const std::string& name) {
    const auto now = Clock::now();
    rusage usage{};
    ::getrusage(RUSAGE_SELF, &usage);
    phases_.push_back(
        {name, std::chrono::duration<double>(now - begun_).count(), static_cast<double>(usage.ru_maxrss) / 1024});
    begun_ = now;
    release_freed_memory();
  }

  // Prints the progress of a phase over tiles or views; a few of them are not worth a line. Throws if interrupted.
  std::function<void(size_t done, size_t all)> progress(const std::string& what) const {
    constexpr size_t kFew = 8;
    auto progress = std::make_shared<std::optional<Progress>>();
    return [progress, what, silent = silent_](size_t, size_t all) {
      if (interrupted()) throw Stopped();
      if (!*progress) progress->emplace(what, static_cast<int>(all), silent || all < kFew);
      (*progress)->step();
    };
  }

  const std::vector<std::string>& left_out() const { return left_out_; }
  // Messages of the phases that failed.
  const std::vector<std::string>& failures() const { return failures_; }

  struct Phase {
    std::string name;
    double seconds = 0, peak_mib = 0;
  };
  const std::vector<Phase>& all() const { return phases_; }

 private:
  using Clock = std::chrono::steady_clock;
  struct Stopped {};

  void leave_out(const std::vector<std::string>& files) {
    for (const std::string& file : files) {
      std::error_code ignored;
      std::filesystem::remove(folder_ / file, ignored);
      left_out_.push_back(file);
    }
  }

  std::filesystem::path folder_;
  bool silent_;
  std::vector<std::string> left_out_, failures_;
  std::vector<Phase> phases_;
  Clock::time_point begun_ = Clock::now();
};

}  // namespace fringeslam::tools
