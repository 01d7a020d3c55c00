// SPDX-License-Identifier: Apache-2.0
// fringeslam capture --rig RIG.yaml --out DATASET: captures a dataset with a camera and a projector.
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "core/io/files.h"
#include "core/patterns/design.h"
#include "core/rig/dataset.h"
#include "core/rig/rig_file.h"
#include "core/types/error.h"
#include "hw/rig_hardware.h"
#include "tools/advise.h"
#include "tools/bag/bag_dataset.h"
#include "tools/interrupt.h"
#include "tools/live/live_mapper.h"
#include "tools/live/live_option.h"
#include "tools/mappable.h"
#include "tools/progress.h"
#include "tools/settings.h"
#include "tools/verbs.h"

namespace fringeslam::tools {

namespace fs = std::filesystem;

namespace {

struct CaptureArguments {
  std::string rig, out, patterns, format = "fringes";
  int count = 1;
  double interval_s = 0;
  std::string before;
  bool auto_exposure = false;
  LiveOption live;
  std::vector<std::string> sets;
};

// Waits for a child process and returns its status, as waitpid(). After an interrupt, the child is asked to end soon, and is left
// to itself if it does not; 0 then.
int status_when_ended(pid_t child) {
  using Clock = std::chrono::steady_clock;
  constexpr std::chrono::milliseconds kLook(10), kAsk(500), kLeave(2500);  // Ctrl-C may have reached the child, too
  std::optional<Clock::time_point> interrupted_at;
  bool asked = false;
  int status = 0;
  for (pid_t ended; (ended = waitpid(child, &status, WNOHANG)) == 0 || (ended < 0 && errno == EINTR);) {
    std::this_thread::sleep_for(kLook);
    if (!interrupted()) continue;
    if (!interrupted_at) interrupted_at = Clock::now();
    const auto since = Clock::now() - *interrupted_at;
    if (since >= kLeave) return 0;
    if (since >= kAsk && !std::exchange(asked, true)) kill(child, SIGTERM);
  }
  return status;
}

// Returns the exit status of a shell command, as waitpid(). Unlike with std::system(), signals reach this process
// meanwhile.
int status_of(const std::string& command) {
  const char* const arguments[] = {"sh", "-c", command.c_str(), nullptr};
  pid_t child = 0;
  // A program that stays in the background must not keep the live page's port and connections.
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_addclosefrom_np(&actions, STDERR_FILENO + 1);
  posix_spawnattr_t attributes;
  posix_spawnattr_init(&attributes);
  sigset_t ignored;  // by the live page's server, which the command must not inherit
  sigemptyset(&ignored);
  sigaddset(&ignored, SIGPIPE);
  posix_spawnattr_setsigdefault(&attributes, &ignored);
  posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSIGDEF);
  const int error = posix_spawn(&child, "/bin/sh", &actions, &attributes, const_cast<char**>(arguments), environ);
  posix_spawnattr_destroy(&attributes);
  posix_spawn_file_actions_destroy(&actions);
  if (error != 0) throw Error("--before " + command + ": cannot be started: " + std::strerror(error));
  return status_when_ended(child);
}

// Runs the command that moves the sensor between views: a stage, a robot, or a prompt to a person.
void run_before(const std::string& command, int stack) {
  if (command.empty()) return;
  setenv("FRINGESLAM_STACK", std::to_string(stack).c_str(), 1);
  const int status = status_of(command);
  // Ctrl-C may reach the command alone.
  if ((WIFSIGNALED(status) && WTERMSIG(status) == SIGINT) || (WIFEXITED(status) && WEXITSTATUS(status) == 128 + SIGINT))
    std::raise(SIGINT);
  else if (status != 0 && !interrupted())
    throw Error("--before " + command + ": failed before stack " + std::to_string(stack));
}

PatternSequence sequence_of(const CaptureArguments& arguments, const RigModel& rig) {
  if (arguments.patterns.empty()) return default_sequence(rig.projector.width, rig.projector.height);
  const fs::path path = arguments.patterns;
  return read_patterns(fs::is_directory(path) ? path / "patterns.yaml" : path);
}

std::string list_of(const std::vector<double>& values) {
  std::string text;
  for (const double value : values) text += (text.empty() ? "" : ", ") + to_text(value);
  return text;
}

// Looks at the scene and sets the exposure that it needs. Returns the patterns, at several exposures if one is not enough.
PatternSequence exposed(const PatternSequence& sequence, HardwareRig& rig, const CaptureArguments& arguments,
                        ExposureChoice& choice) {
  if (!rig.takes_exposures())
    throw Error(arguments.rig +
                ": packed patterns are taken at one exposure; leave out --auto-exposure, or remove `packing`");
  const auto throw_if_interrupted = [] {
    if (interrupted()) throw Error("capture: interrupted before the first stack");
  };
  const auto look = [&](const PatternSequence& patterns) -> std::optional<FringeStack> {
    throw_if_interrupted();
    try {
      return rig.capture(patterns);
    } catch (const SequenceRejected&) {
      return std::nullopt;  // too little is visible at this exposure
    } catch (const UnsupportedExposure&) {
      return std::nullopt;
    }
  };
  // At an unsuitable exposure, the images do not show that the patterns were projected.
  constexpr double kFactors[] = {1, 1.0 / 4, 1.0 / 16, 1.0 / 64, 4, 16};
  double current = 1;
  std::exception_ptr reason;
  for (const double factor : kFactors) {
    throw_if_interrupted();
    try {
      if (factor != current) rig.scale_exposure(factor / current);
      current = factor;
      choice = exposures_for(rig, look, sequence, arguments.rig);
      reason = nullptr;
      break;
    } catch (const SequenceRejected&) {
      reason = std::current_exception();
    } catch (const UnsupportedExposure&) {
      if (!reason) reason = std::current_exception();
    }
  }
  if (reason) std::rethrow_exception(reason);
  std::fprintf(stderr, "exposures: %s times %s s, which should decode %.0f %% of the pixels with fringes\n",
               list_of(choice.exposures).c_str(), to_text(rig.camera().exposure_s()).c_str(), 100 * choice.covered);
  PatternSequence result = sequence;
  if (choice.exposures.size() == 1)
    rig.scale_exposure(choice.exposures.front());
  else
    result.patterns = at_exposures(sequence.patterns, choice.exposures);
  return result;
}

// True if the live page can show a map; otherwise prints why not.
bool can_map(const RigModel& rig, const PatternSequence& sequence, const PipelineOptions& options) {
  try {
    check_mappable(rig, sequence, options.decode);
    return true;
  } catch (const Error& e) {
    std::fprintf(stderr, "live: images, but no map: %s\n", e.what());
    return false;
  }
}

// Records stacks in a folder, which is a valid dataset after every stack, or in a bag, which appears at the end.
class Recorder {
 public:
  Recorder(const CaptureArguments& arguments, HardwareRig& rig, const PatternSequence& sequence,
           const Settings& settings)
      : rig_(rig), sequence_(sequence) {
    const RigModel& model = rig.model();
    if (arguments.format == "fringes") {
      fs::create_directories(arguments.out);
      folder_.emplace(rig, arguments.out, Durable::yes);
      return;
    }
    DatasetInfo info;
    info.name = model.name;
    bag_.emplace(arguments.out, model, sequence, info, "");
    try {
      check_mappable(model, sequence, settings.pipeline.decode);
      sensor_.emplace(model, sequence, settings, model.name);
    } catch (const Error& e) {
      std::fprintf(stderr, "bag: fringe images, but no depth: %s\n", e.what());
    }
  }
  std::optional<FringeStack> capture() {
    if (folder_) {
      auto stack = folder_->capture(sequence_);
      folder_->finish(rig_.model().name, 0, false);
      return stack;
    }
    auto stack = rig_.capture(sequence_);
    if (stack && sensor_)
      bag_->add(sensor_->see(*stack));
    else if (stack)
      bag_->add(*stack);
    return stack;
  }
  // Keeps what was recorded.
  void finish() {
    if (!bag_) return;
    try {
      bag_->finish({});
    } catch (const Error& e) {
      throw Error(std::string(e.what()) + "; what was recorded is in " + bag_->keep_unfinished().string() +
                  ", a bag without an index: make room, then repair it with `rosbag reindex`");
    }
  }

 private:
  HardwareRig& rig_;
  const PatternSequence& sequence_;
  std::optional<RecordingRig> folder_;
  std::optional<BagRecorder> bag_;
  std::optional<DepthSensor> sensor_;
};

// Removes what a recording without a complete stack has written, also a first stack that dataset.yaml does not list; files of
// others, and then the folder, remain. Returns true if there was such a stack.
bool remove_empty_recording(const fs::path& folder) {
  std::error_code ignored, failed;
  for (const char* file : {"rig.yaml", "patterns.yaml", kDatasetFile}) fs::remove(folder / file, ignored);
  const bool had_stack = fs::remove_all(folder / "stacks" / stack_name(0), failed) > 0 && !failed;
  fs::remove(folder / "stacks", ignored);
  fs::remove(folder, ignored);  // fails unless empty
  return had_stack;
}

int capture(const CaptureArguments& arguments, const Common& common) {
  if (fs::exists(arguments.out) && !(fs::is_directory(arguments.out) && fs::is_empty(arguments.out)))
    throw Error(arguments.out + ": exists; choose another --out or remove it");
  const RigModel model = read_rig(arguments.rig);
  PatternSequence sequence = sequence_of(arguments, model);
  ExposureChoice exposures{{1}, 0};
  std::unique_ptr<HardwareRig> rig;
  catch_interrupts();  // from now on, the devices are released in an orderly way
  if (arguments.auto_exposure) {
    rig = open_hardware(arguments.rig);
    run_before(arguments.before, 0);
    sequence = exposed(sequence, *rig, arguments, exposures);
  }
  const Settings settings = parse_settings(arguments.sets);
  const bool maps = arguments.live.port && can_map(model, sequence, settings.pipeline);
  const std::unique_ptr<LivePage> page = open_live_page(arguments.live, {.verb = "capture",
                                                                         .name = arguments.out,
                                                                         .rig = model,
                                                                         .sequence = sequence,
                                                                         .stacks = arguments.count,
                                                                         .maps = maps});
  std::optional<LiveMapper> mapper;
  if (maps) mapper.emplace(model, sequence, settings.pipeline, page->feed());
  if (!rig) rig = open_hardware(arguments.rig);
  Recorder recorder(arguments, *rig, sequence, settings);

  int stacks = 0;
  double capturing_s = 0;
  const auto kept = [&] { return std::to_string(stacks) + (stacks == 1 ? " stack" : " stacks"); };
  {
    Progress progress("capturing", arguments.count, common.quiet || common.json);
    try {
      while (stacks < arguments.count && !interrupted()) {
        if (stacks > 0) wait_s(arguments.interval_s);
        const bool is_there = arguments.auto_exposure && stacks == 0;
        if (!interrupted() && !is_there) run_before(arguments.before, stacks);
        if (interrupted()) break;
        const auto start = std::chrono::steady_clock::now();
        const auto stack = recorder.capture();
        ++stacks;  // what follows may fail, but the stack is recorded
        capturing_s += std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
        if (mapper)
          mapper->offer(*stack);
        else if (page)
          page->feed().show(*stack);
        progress.step();
      }
    } catch (const std::exception& e) {
      if (stacks == 0) {
        if (!remove_empty_recording(arguments.out)) throw;
        throw Error(std::string(e.what()) + "; the stack captured before is removed, because it is not complete");
      }
      try {
        recorder.finish();
      } catch (const std::exception& f) {
        throw Error(std::string(e.what()) + "; the " + kept() + " captured before could not be finished: " + f.what());
      }
      throw Error(std::string(e.what()) + "; " + kept() + " captured before are in " + arguments.out);
    }
  }
  if (stacks == 0)
    remove_empty_recording(arguments.out);
  else
    recorder.finish();
  if (mapper) mapper->finish();
  if (page) page->feed().finish();
  const CameraStatistics camera = rig->camera().statistics();
  print_result(common,
               {{"dataset", arguments.out},
                {"stacks", stacks},
                {"interrupted", interrupted()},
                {"exposures", exposures.exposures},
                {"stack_s", stacks > 0 ? capturing_s / stacks : 0},
                {"sequences_retaken", rig->retaken()},
                {"images", camera.images},
                {"images_refused", camera.refused},
                {"packets_resent", camera.resent_packets},
                {"packets_missing", camera.missing_packets},
                {"camera_reopened", camera.reopened}},
               "dataset: " + arguments.out + " (" + kept() + (interrupted() ? ", interrupted" : "") +
                   (rig->retaken() ? ", " + std::to_string(rig->retaken()) + " sequences retaken" : "") +
                   (camera.refused ? ", " + std::to_string(camera.refused) + " images retaken" : "") + ")");
  return interrupted() && stacks == 0 ? 2 : 0;
}

}  // namespace

Verb add_capture(Command app, const Common& common) {
  auto arguments = std::make_shared<CaptureArguments>();
  const Command verb = app.add_subcommand("capture", "Capture a dataset with a camera and a projector");
  verb.add_option("--rig", arguments->rig, "Rig file with a hardware: section").required();
  verb.add_option("--out", arguments->out, "Dataset folder to write; a file with --format rosbag").required();
  verb.add_option("--format", arguments->format,
                  "fringes: a dataset folder; rosbag: a ROS 1 bag with fringe images and what is measured from them")
      .check_one_of({"fringes", "rosbag"});
  verb.add_option("--count", arguments->count, "Number of stacks to capture").check_range(1, 1000000);
  verb.add_flag("--auto-exposure", arguments->auto_exposure,
                "Look at the scene first and take the patterns at the exposures that it needs: one, or several if its "
                "contrast is high");
  verb.add_option("--interval", arguments->interval_s, "Seconds between stacks").check_range(0.0, 86400.0);
  verb.add_option("--before", arguments->before,
                  "Command to run before each stack, for example to move the sensor; FRINGESLAM_STACK is the stack's "
                  "number; 'read _' waits for Enter");
  verb.add_option("--patterns", arguments->patterns, "patterns.yaml, or a folder written by `fringeslam patterns`");
  add_live_option(verb, arguments->live);
  verb.add_option("--set", arguments->sets,
                  "Setting of the live page's map or of the bag's depth: stage.key=value (repeatable; `fringeslam run "
                  "--help` lists them)");
  return [arguments, &common] {
    if (arguments->format == "rosbag")
      require_bags("capture --format rosbag");
    else if (!arguments->sets.empty() && !arguments->live.port)
      throw Error("capture: --set has no effect without --live or --format rosbag");
    return capture(*arguments, common);
  };
}

}  // namespace fringeslam::tools
