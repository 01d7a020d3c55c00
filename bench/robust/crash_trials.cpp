// SPDX-License-Identifier: Apache-2.0
#include "bench/robust/crash_trials.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <sstream>

#include "bench/robust/child_runs.h"
#include "core/io/files.h"
#include "core/io/input_file.h"
#include "core/rig/dataset.h"
#include "core/storage/map_file.h"
#include "core/storage/map_journal.h"
#include "core/types/error.h"

namespace fringeslam::robust {

namespace fs = std::filesystem;

const std::vector<std::string> kCrashTasks = {"patterns", "render", "import",  "run",
                                              "save_map", "study",  "capture", "export"};

namespace {

constexpr const char* kStudy =
    "name: crash\nscene: scene/scene.yaml\ntrials: 3\nparameters:\n  light.ambient_lux: {log_uniform: [10, 1000]}\n";
constexpr const char* kUsersFile = "notes of mine.txt";

struct Task {
  std::string name;
  std::vector<std::string> command, before;  // the command, and one whose result it replaces; words may contain OUT
};

constexpr std::array<const char*, 5> kFaults = {"KILL", "ENOSPC", "EIO", "EINTR", "EDQUOT"};
constexpr int kErrors = kFaults.size() - 1;

// A task, the result that exists before it, and both results' content.
struct State {
  Task task;
  fs::path before;
  std::map<std::string, uint64_t> old_content, new_content;
  std::array<int, kFaults.size()> calls{};
};

// Permutes 0 to parts - 1 so that any beginning of the sequence is spread over the whole range.
int place_of(int i, int parts) {
  constexpr int kStride = 7919;  // a prime larger than any number of parts
  return static_cast<int>(int64_t{i} * kStride % parts);
}

class Trials {
 public:
  Trials(const CrashPrograms& programs, const fs::path& folder, const CrashOptions& options)
      : programs_(programs), folder_(fs::canonical(folder)), options_(options), random_(options.seed) {
    // Small images: the calls are the same, and reached sooner.
    write_small_scene(folder_ / "scene", 6);
    write_text(folder_ / "study.yaml", kStudy);
    fs::create_directory(folder_ / "trial");
    setenv("FRINGESLAM_CACHE", (folder_ / "cache").c_str(), 1);
  }

  CrashReport report() {
    std::vector<State> states;
    for (const Task& task : tasks()) {
      const bool wanted = options_.tasks.empty() ||
                          std::find(options_.tasks.begin(), options_.tasks.end(), task.name) != options_.tasks.end();
      if (wanted && report_.possible) states.push_back(prepared(task));
    }
    const auto start = std::chrono::steady_clock::now();
    // Every task and fault in turn, so that a limit of time affects all alike. The kills and failures of a task are spread
    // over its calls.
    const int failures = (options_.failures_per_task + kErrors - 1) / kErrors;
    for (int i = 0; report_.possible && i < std::max(options_.kills_per_task, failures); ++i) {
      for (const State& state : states) {
        for (size_t fault = 0; fault < kFaults.size(); ++fault) {
          const int parts = std::min(state.calls[fault], fault == 0 ? options_.kills_per_task : failures);
          const double minutes = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count() / 60;
          if (options_.minutes > 0 && minutes > options_.minutes) return report_;
          if (i < parts) run_trial(state, fault, place_of(i, parts), parts);
        }
      }
    }
    return report_;
  }

 private:
  std::vector<Task> tasks() const {
    const std::string program = programs_.fringeslam.string(), scene = (folder_ / "scene").string();
    const std::string data = (folder_ / "data").string(), images = (folder_ / "images").string();
    const std::vector<std::string> fast = {"--quiet", "--set", "render.samples_per_pixel=1"};
    const auto words = [&](std::vector<std::string> some, const std::vector<std::string>& more) {
      some.insert(some.begin(), program);
      some.insert(some.end(), more.begin(), more.end());
      return some;
    };
    const std::vector<std::string> patterns = {"patterns", "--out",     "OUT", "--size", "96x64",
                                               "--quiet",  "--periods", "100", "25"};
    const std::vector<std::string> run = {"run", data, "--out", "OUT", "--quiet", "--no-report"};
    return {{"patterns", words(patterns, {}), words(patterns, {"--steps", "4"})},
            {"render", words({"render", scene, "--out", "OUT"}, fast),
             words({"render", scene, "--out", "OUT", "--seed", "4"}, fast)},
            {"import", words({"import", images, "--out", "OUT", "--quiet", "--no-check"}, {}),
             words({"render", scene, "--out", "OUT"}, fast)},
            {"run", words(run, {}), words(run, {"--save-map", "--set", "depth.far_m=2.4"})},
            {"save_map", words(run, {"--save-map", "--map", "OUT/saved.map"}), words(run, {"--save-map"})},
            {"study",
             words({"study", "run", (folder_ / "study.yaml").string(), "--out", "OUT", "--quiet", "--worst", "0",
                    "--jobs", "1"},
                   {}),
             {}},
            {"capture", {programs_.record_stacks.string(), scene + "/rig.yaml", "OUT", "4"}, {}},
            // The mesh is written into a folder of the user.
            {"export", words({"scene", "export", scene, "--out", "OUT/mesh.glb", "--quiet"}, {}),
             words({"scene", "export", scene, "--out", "OUT/mesh.glb", "--quiet", "--seed", "4"}, {})}};
  }

  fs::path trial() const { return folder_ / "trial"; }
  fs::path out() const { return trial() / "out"; }

  std::string line_of(std::vector<std::string> words) const {
    for (std::string& word : words) {
      if (const size_t at = word.find("OUT"); at != std::string::npos) word.replace(at, 3, out().string());
    }
    return shell_line(words);
  }

  Ended execute(const std::string& line) const { return robust::execute(folder_, line); }
  void execute_well(const std::vector<std::string>& words) const { robust::execute_well(folder_, line_of(words)); }

  // Hash of each file of a folder but the user's, by name.
  static std::map<std::string, uint64_t> content(const fs::path& folder) {
    auto files = robust::content(folder);
    files.erase(kUsersFile);
    // Leftovers of a file's command are looked for separately.
    std::erase_if(files, [](const auto& file) { return file.first.find(".partial-") != std::string::npos; });
    return files;
  }

  void prepare_inputs() {
    if (fs::exists(folder_ / "data")) return;
    execute_well({programs_.fringeslam.string(), "render", (folder_ / "scene").string(), "--out",
                  (folder_ / "data").string(), "--quiet", "--set", "render.samples_per_pixel=1"});
    // The images of a view, as those of another rig.
    std::string description =
        "name: other\nnear_m: 0.7\nfar_m: 1.4\nstacks: view*\nprojector: {width_px: 1024, height_px: 768}\npatterns:\n";
    fs::create_directories(folder_ / "images/view0");
    int image = 0;
    for (const char* period : {"1040", "131", "16.5"}) {
      description += "  - {files: \"{}.png\", first: " + std::to_string(image) +
                     ", fringe: {axis: columns, steps: 3, period_px: " + period + "}}\n";
      for (const int end = image + 3; image < end; ++image)
        fs::copy_file(folder_ / ("data/stacks/000000/0" + std::to_string(image) + ".png"),
                      folder_ / ("images/view0/" + std::to_string(image) + ".png"));
    }
    write_text(folder_ / "images/import.yaml", description);
  }

  // Produces the old and the new result, and counts the calls at which each fault can happen.
  State prepared(const Task& task) {
    prepare_inputs();
    State state;
    state.task = task;
    state.before = folder_ / ("before_" + task.name);
    start_from("");
    if (task.name == "export") fs::create_directory(out());
    if (!task.before.empty()) {
      execute_well(task.before);
      write_text(out() / kUsersFile, "precious");
      fs::rename(out(), state.before);
    }
    state.old_content = content(state.before);
    start_from(state.before);
    execute_well(task.command);
    state.new_content = content(out());
    for (size_t i = 0; i < kFaults.size() && report_.possible; ++i) {
      start_from(state.before);
      const Ended counted = execute(injected(kFaults[i], 0, task));
      state.calls[i] = calls_of(counted);
      if (counted.exit_code == 125 || state.calls[i] < 0) report_.possible = false;
    }
    return state;
  }

  std::string injected(const char* fault, int at, const Task& task) const {
    return shell_line({programs_.inject_fault.string(), trial().string(), fault, std::to_string(at)}) + " " +
           line_of(task.command);
  }

  // Returns the number of calls that were counted, or -1.
  static int calls_of(const Ended& ended) {
    const size_t place = ended.err.rfind("calls: ");
    return place == std::string::npos ? -1 : std::atoi(ended.err.c_str() + place + 7);
  }

  // Injects the fault into one of the calls of part `i` of `parts` equal parts.
  void run_trial(const State& state, size_t fault, int i, int parts) {
    const int calls = state.calls[fault];
    const int first = static_cast<int>(int64_t{calls} * i / parts),
              end = static_cast<int>(int64_t{calls} * (i + 1) / parts);
    const int at = 1 + random_.uniform(first, std::max(first + 1, end));
    start_from(state.before);
    const Ended ended = execute(injected(kFaults[fault], at, state.task));
    fault == 0 ? ++report_.kills : ++report_.failures;
    if (calls_of(ended) >= at) ++report_.hit;
    std::string what = loss(state, ended);
    if (what.empty()) return;
    what = state.task.name + ", " + kFaults[fault] + " at call " + std::to_string(at) + " of " + std::to_string(calls) +
           ": " + what;
    std::fprintf(stderr, "  %s\n", what.c_str());
    report_.losses.push_back(what);
  }

  void start_from(const fs::path& before) const {
    fs::remove_all(trial());
    fs::create_directory(trial());
    if (!before.empty() && fs::exists(before)) fs::copy(before, out(), fs::copy_options::recursive);
  }

  // Returns a program's messages without those that work goes on in spite of something.
  static std::string without_warnings(const std::string& messages) {
    std::istringstream lines(messages);
    std::string others;
    for (std::string line; std::getline(lines, line);) {
      if (!line.starts_with("warning: ")) others += line + "\n";
    }
    return others;
  }

  // Returns what was lost; empty if nothing was.
  std::string loss(const State& state, const Ended& ended) const {
    const std::string message = without_warnings(ended.err.substr(0, ended.err.rfind("calls: ")));
    if (ended.exit_code != 0 && ended.exit_code != 2 && ended.exit_code != 128 + SIGKILL)
      return "exit code " + std::to_string(ended.exit_code) + ": " + message;
    if (ended.exit_code == 2) {
      if (std::count(message.begin(), message.end(), '\n') != 1 || !message.starts_with("fringeslam: "))
        return "not one line: " + message;
      if (message.find(".partial-") != std::string::npos) return "names a temporary file: " + message;
    }
    if (state.task.name == "capture") return loss_of_capture(ended);
    if (state.task.name == "study") return loss_of_study(state, ended);
    auto now = content(out());
    const uint64_t map = find(now, "saved.map"), old_map = find(state.old_content, "saved.map");
    if (old_map != 0 && map != old_map && map != find(state.new_content, "saved.map")) return "the saved map is lost";
    if (read_or_empty(out() / kUsersFile) != "precious") return "the user's file is lost";
    if (ended.exit_code == 0 && now != state.new_content) return "it succeeded, but the result is not the new one";
    if (now != state.old_content && now != state.new_content) return "the folder is neither the old nor the new result";
    if (const std::string lost = loss_of_journals(); !lost.empty()) return lost;
    // The next result next to it.
    {
      StagedFolder next(trial() / "next", "robust");
      next.commit();
      if (fs::exists(out())) StagedFile(out() / "next");
    }
    for (const auto& entry : fs::recursive_directory_iterator(trial())) {
      if (entry.path().filename().string().find(".partial-") != std::string::npos)
        return "a leftover remains: " + entry.path().lexically_relative(trial()).string();
    }
    const bool same = content(out()) == now && read_or_empty(out() / kUsersFile) == "precious";
    return same ? "" : "the next command changed the result";
  }

  // The map that a run left can be recovered.
  std::string loss_of_journals() const {
    try {
      for (const LeftMap& left : left_maps(out())) {
        if (left.keyframes == 0) return left.message;
        WorkFolder journal = WorkFolder::taken_over(left.folder);
        const RecoveredMap recovered = recover_map(journal, trial() / kMapFile);
        if (recovered.keyframes != left.keyframes || recovered.damaged > 0) return "keyframes of the journal are lost";
        verify_map(trial() / kMapFile);
        fs::remove(trial() / kMapFile);
        journal.remove();
      }
    } catch (const Error& e) {
      return e.what();
    }
    return "";
  }

  static uint64_t find(const std::map<std::string, uint64_t>& files, const std::string& name) {
    const auto found = files.find(name);
    return found == files.end() ? 0 : found->second;
  }

  static std::string read_or_empty(const fs::path& file) { return fs::exists(file) ? read_bytes(file) : ""; }

  // All stacks that were reported as recorded can be read.
  std::string loss_of_capture(const Ended& ended) const {
    const size_t line = ended.out.empty() ? std::string::npos : ended.out.rfind('\n', ended.out.size() - 2);
    const int reported =
        ended.out.empty() ? 0 : std::atoi(ended.out.c_str() + (line == std::string::npos ? 0 : line + 1));
    if (reported == 0 && !fs::exists(out() / kDatasetFile)) return "";
    try {
      ReplayRig rig(out());
      if (rig.info().stacks < reported)
        return "only " + std::to_string(rig.info().stacks) + " of " + std::to_string(reported) + " stacks";
      while (rig.capture(rig.sequence())) continue;
    } catch (const Error& e) {
      return e.what();
    }
    return "";
  }

  // If it succeeded, the study is complete; if not, the same command completes it, to the same result.
  std::string loss_of_study(const State& state, const Ended& ended) const {
    if (ended.exit_code == 0) {
      if (const std::string differing = differing_file(state); !differing.empty())
        return "it succeeded, but " + differing + " differs";
    }
    const Ended again = execute(line_of(state.task.command));
    if (again.exit_code != 0) return "cannot be continued: " + again.err;
    const std::string differing = differing_file(state);
    return differing.empty() ? "" : differing + " differs after continuing";
  }

  // Returns a file of the study, other than its report, that is not that of the new result; empty if there is none.
  std::string differing_file(const State& state) const {
    const auto now = content(out());
    for (const auto& [name, hash] : state.new_content) {
      if (name != "report.html" && find(now, name) != hash) return name;
    }
    return "";
  }

  const CrashPrograms& programs_;
  fs::path folder_;
  const CrashOptions& options_;
  cv::RNG random_;
  CrashReport report_;
};

}  // namespace

CrashReport crash_trials(const CrashPrograms& programs, const fs::path& folder, const CrashOptions& options) {
  return Trials(programs, folder, options).report();
}

}  // namespace fringeslam::robust
