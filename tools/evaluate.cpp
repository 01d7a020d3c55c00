// SPDX-License-Identifier: Apache-2.0
// fringeslam evaluate SUITE --with 'COMMAND {dataset} {out}'
#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>

#include "bench/evaluation/leaderboard.h"
#include "bench/evaluation/limited_process.h"
#include "core/io/staged.h"
#include "core/score/trajectory_file.h"
#include "core/score/trajectory_score.h"
#include "sim/scene/data_folder.h"
#include "sim/scene/scene_files.h"
#include "tools/bag/bag.h"
#include "tools/evaluation_dataset.h"
#include "tools/interrupt.h"
#include "tools/map_truth.h"
#include "tools/output_file.h"
#include "tools/progress.h"
#include "tools/shell.h"
#include "tools/verbs.h"

namespace fringeslam::tools {

namespace fs = std::filesystem;
using evaluation::ProcessEnd;
using evaluation::Result;

namespace {

struct EvaluateArguments {
  std::vector<std::string> suites;
  std::string command, name, out = "evaluation";
  DatasetFormat format = DatasetFormat::fringes;
  double timeout_s = 0, memory_mib = 0;  // 0: those of the suite
  double threshold_m = 1e-3;
  bool again = false;
};

// Replaces {dataset} and {out} by quoted paths.
std::string filled_in(std::string command, const fs::path& dataset, const fs::path& out) {
  const std::pair<std::string, fs::path> values[] = {{"{dataset}", dataset}, {"{out}", out}};
  for (const auto& [key, path] : values) {
    for (size_t at = 0; (at = command.find(key, at)) != std::string::npos;) {
      const std::string text = quoted(path.string());
      command.replace(at, key.size(), text);
      at += text.size();
    }
  }
  return command;
}

void require_placeholders(const std::string& command) {
  for (const std::string key : {"{dataset}", "{out}"}) {
    if (command.find(key) == std::string::npos)
      throw Error("evaluate: the command needs " + key + ", as in --with 'my_slam {dataset} {out}'");
  }
}

// Returns the last line of a log, for messages. The system may have replaced its log by anything.
std::string last_line(const fs::path& log) {
  constexpr size_t kMost = 200, kRead = 1 << 16;
  const int file = open(log.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOFOLLOW);
  struct stat status {};
  std::string text;
  if (file >= 0 && fstat(file, &status) == 0 && S_ISREG(status.st_mode)) {
    text.resize(std::min(kRead, static_cast<size_t>(status.st_size)));
    const ssize_t count = pread(file, text.data(), text.size(), status.st_size - static_cast<off_t>(text.size()));
    text.resize(static_cast<size_t>(std::max<ssize_t>(0, count)));
  }
  if (file >= 0) close(file);
  const size_t end = text.find_last_not_of(" \t\r\n");
  if (end == std::string::npos) return "";
  const size_t before = text.find_last_of("\r\n", end), begin = before == std::string::npos ? 0 : before + 1;
  return text.substr(begin, std::min(kMost, end + 1 - begin));
}

// Lets the folder in which a system ran be committed, whatever the system has done to it.
void make_usable(const fs::path& folder) {
  fs::create_directories(folder);
  fs::permissions(folder, fs::perms::owner_all, fs::perm_options::add);
  std::error_code failed;
  for (fs::recursive_directory_iterator entry(folder, fs::directory_options::skip_permission_denied, failed), end;
       !failed && entry != end; entry.increment(failed)) {
    if (entry->symlink_status(failed).type() == fs::file_type::directory)
      fs::permissions(entry->path(), fs::perms::owner_all, fs::perm_options::add, failed);
  }
  fs::remove_all(folder / ".fringeslam", failed);  // the list of the result's files
}

std::optional<fs::path> first_of(const fs::path& folder, std::initializer_list<const char*> names) {
  std::error_code ignored;
  for (const char* name : names) {
    if (fs::is_regular_file(folder / name, ignored)) return folder / name;
  }
  return std::nullopt;
}

// A map is in the frame of its trajectory, which is aligned with the true one.
void score_surface(Result& result, const fs::path& file, const Trajectory& estimate, const EvaluationDataset& dataset,
                   double threshold_m, const Common& common) {
  PlyMap map = read_ply(file);
  if (map.vertices.empty()) throw Error(file.filename().string() + ": contains no finite vertex");
  TrajectoryOptions options;
  options.align = Alignment::se3;
  Similarity world_from_map;
  try {
    world_from_map = align_trajectory(estimate, dataset.poses, options);
  } catch (const Error&) {  // positions on a line do not determine the rotation
    options.align = Alignment::origin;
    world_from_map = align_trajectory(estimate, dataset.poses, options);
  }
  for (Eigen::Vector3d& vertex : map.vertices) vertex = world_from_map * vertex;
  Common quiet = common;
  quiet.quiet = true;
  const MapScore score = score_map(map, read_map_truth(dataset.truth, std::nullopt, quiet), threshold_m);
  result.precision = score.precision;
  result.recall = score.recall;
  result.f_score = score.f_score();
  result.threshold_m = threshold_m;
}

void score_output(Result& result, const fs::path& out, const EvaluationDataset& dataset, double threshold_m,
                  const Common& common) {
  const auto trajectory = first_of(out, {"trajectory.tum", "trajectory.txt", "trajectory.csv"});
  if (!trajectory) {
    result.end = "no_trajectory";
    result.message = "wrote no trajectory.tum, trajectory.txt or trajectory.csv";
    return;
  }
  try {
    const Trajectory estimate = read_trajectory(*trajectory);
    set_score(result, score_trajectory(estimate, dataset.poses));
    const auto map = first_of(out, {"map.ply", "mesh.ply"});
    if (map) score_surface(result, *map, estimate, dataset, threshold_m, common);
  } catch (const Error& e) {
    result.message = e.what();
    if (!result.has_trajectory()) result.end = "no_trajectory";
  }
}

class Evaluation {
 public:
  Evaluation(const EvaluateArguments& arguments, const Common& common)
      : arguments_(arguments),
        common_(common),
        out_(fs::absolute(arguments.out)),
        results_(evaluation::open_results(out_)) {}

  // Returns false if interrupted.
  bool run(const evaluation::Suite& suite) {
    for (const evaluation::SuiteDataset& wanted : suite.datasets) {
      const auto dataset = evaluation_dataset(wanted, arguments_.format, common_);
      if (!dataset || interrupted()) return false;
      if (!arguments_.again && is_done(suite, wanted.name, dataset->hash)) continue;
      std::vector<fs::path> inputs = sim::named_files(sim::scene_file(wanted.scene));
      inputs.insert(inputs.end(), arguments_.suites.begin(), arguments_.suites.end());
      const Result result = run_on(suite, wanted.name, *dataset, inputs);
      if (result.end == evaluation::to_string(ProcessEnd::interrupted)) return false;
      evaluation::add_result(out_, result);
      if (!common_.quiet && !common_.json) print(result);
    }
    return true;
  }

  // Those of other processes included.
  std::vector<Result> results() const { return evaluation::results_in(out_); }
  int failures() const { return failures_; }

 private:
  evaluation::ProcessLimits limits_of(const evaluation::Suite& suite) const {
    return {arguments_.timeout_s > 0 ? arguments_.timeout_s : suite.timeout_s,
            arguments_.memory_mib > 0 ? arguments_.memory_mib : suite.memory_mib};
  }

  bool is_done(const evaluation::Suite& suite, const std::string& dataset, const std::string& hash) const {
    const evaluation::ProcessLimits limits = limits_of(suite);
    return std::any_of(results_.begin(), results_.end(), [&](const Result& r) {
      const bool same = r.suite == suite.name && r.dataset == dataset && r.system == arguments_.name &&
                        r.command == arguments_.command && r.dataset_hash == hash;
      // The limits may be higher now.
      const bool limited =
          (r.end == evaluation::to_string(ProcessEnd::timed_out) && r.timeout_s < limits.timeout_s) ||
          (r.end == evaluation::to_string(ProcessEnd::out_of_memory) && r.memory_mib < limits.memory_mib);
      const bool other_threshold = std::isfinite(r.threshold_m) && r.threshold_m != arguments_.threshold_m;
      return same && !limited && !other_threshold;
    });
  }

  Result run_on(const evaluation::Suite& suite, const std::string& name, const EvaluationDataset& dataset,
                const std::vector<fs::path>& inputs) {
    const fs::path output = out_ / "outputs" / arguments_.name / suite.name / name;
    require_not_an_input(output, inputs);
    StagedFolder staged(output, "system output");
    const fs::path folder = staged.path(), out = folder / "out";
    fs::create_directories(out);
    const evaluation::ProcessLimits limits = limits_of(suite);
    const evaluation::ProcessReport report = evaluation::run_limited(
        filled_in(arguments_.command, dataset.dataset, out), folder, folder / "log.txt", limits, interrupted);
    Result result;
    result.suite = suite.name;
    result.dataset = name;
    result.dataset_hash = dataset.hash;
    result.system = arguments_.name;
    result.command = arguments_.command;
    result.end = evaluation::to_string(report.end);
    result.views = static_cast<int>(dataset.poses.size());
    result.seconds = report.seconds;
    result.timeout_s = limits.timeout_s;
    result.memory_mib = limits.memory_mib;
    result.peak_mib = report.peak_mib;
    if (report.end == ProcessEnd::interrupted) return result;
    make_usable(folder);
    // Before files of the user, which may have any name, are added to the folder.
    if (report.end == ProcessEnd::finished)
      score_output(result, out, dataset, arguments_.threshold_m, common_);
    else if (report.end == ProcessEnd::failed)
      result.message = "exit code " + std::to_string(report.exit_code) + ": " + last_line(folder / "log.txt");
    else if (report.end == ProcessEnd::timed_out)
      result.message = "took longer than " + to_text(limits.timeout_s) + " s";
    else if (report.end == ProcessEnd::out_of_memory)
      result.message = "needed more than " + to_text(limits.memory_mib) + " MiB";
    result.message = with_final_names(result.message);
    failures_ += !result.has_trajectory();
    staged.commit();
    return result;
  }

  static void print(const Result& r) {
    const std::string message = single_line(r.message);  // may quote the system's log
    if (r.has_trajectory())
      std::fprintf(stderr, "%s/%s: %d of %d views, ATE %.3g mm, %.1f s%s%s\n", r.suite.c_str(), r.dataset.c_str(),
                   r.poses, r.views, 1e3 * r.ate_m, r.seconds, message.empty() ? "" : "; ", message.c_str());
    else
      std::fprintf(stderr, "%s/%s: %s: %s\n", r.suite.c_str(), r.dataset.c_str(), r.end.c_str(), message.c_str());
  }

  const EvaluateArguments& arguments_;
  const Common& common_;
  fs::path out_;
  std::vector<Result> results_;
  int failures_ = 0;
};

int evaluate(EvaluateArguments arguments, const Common& common) {
  require_placeholders(arguments.command);
  if (arguments.format == DatasetFormat::rosbag) require_bags("evaluate --format rosbag");
  if (arguments.name.empty()) {
    arguments.name = fs::path(arguments.command.substr(0, arguments.command.find(' '))).filename();
  }
  const bool usable =
      !arguments.name.empty() && arguments.name.front() != '.' && arguments.name.find('/') == std::string::npos;
  if (!usable) throw Error("evaluate: '" + arguments.name + "' cannot name a folder; give the system a --name");
  std::vector<evaluation::Suite> suites;
  for (const std::string& suite : arguments.suites) {
    evaluation::Suite read = evaluation::read_suite(suite, sim::data_folder() / "scenes" / "suites");
    if (std::any_of(suites.begin(), suites.end(), [&](const auto& other) { return other.name == read.name; }))
      throw Error(suite + ": another suite is called '" + read.name +
                  "', too, and results are stored by that name; rename one of the files");
    suites.push_back(std::move(read));
  }
  Evaluation run(arguments, common);
  catch_interrupts();
  for (const evaluation::Suite& suite : suites) {
    if (!run.run(suite)) return kInterrupted;
  }
  const std::vector<Result> results = run.results();
  nlohmann::ordered_json document = {
      {"out", arguments.out}, {"failures", run.failures()}, {"results", nlohmann::json::array()}};
  for (const Result& result : results)
    document["results"].push_back(nlohmann::ordered_json::parse(evaluation::to_lines({result})));
  print_result(common, document,
               evaluation::to_table(evaluation::standings_of(results)) + "\nwritten: " + arguments.out +
                   "/leaderboard.html and .csv");
  return 0;
}

}  // namespace

Verb add_evaluate(Command app, const Common& common) {
  auto arguments = std::make_shared<EvaluateArguments>();
  const Command verb = app.add_subcommand(
      "evaluate", "Run any SLAM system on suites of scenes, score it, and compare systems in a leaderboard");
  verb.add_option("suite", arguments->suites, "Suites: stills, moving, smoke, repeating, arenas, loop, or YAML files")
      .required();
  verb.add_option("--with", arguments->command,
                  "The system's command; {dataset} is replaced by the dataset's folder (or bag), {out} by an empty "
                  "folder, into "
                  "which it writes trajectory.tum (or .txt, .csv) and, if it has one, map.ply")
      .required();
  verb.add_option("--name", arguments->name,
                  "The system's name in the leaderboard (default: the command's first word)");
  verb.add_option("--out", arguments->out,
                  "Folder of the leaderboard; results of other systems and suites in it are kept")
      .capture_default_str();
  add_choice(
      verb, "--format", arguments->format,
      "Datasets: fringes (for `run`; poses of the robot); or tum-rgbd, euroc (texture and depth) or rosbag (a ROS "
      "1 bag with fringe images, too), with poses of the camera")
      .default_str("fringes");
  verb.add_option("--timeout", arguments->timeout_s, "Most time per dataset, s; overrides the suite's")
      .check_range(0.1, 1e6);
  verb.add_option("--memory", arguments->memory_mib, "Most memory, MiB; overrides the suite's").check_range(1.0, 1e7);
  verb.add_option("--threshold", arguments->threshold_m, "Map: largest distance that counts as correct, m")
      .check_range(1e-9, 1e9)
      .capture_default_str();
  verb.add_flag("--again", arguments->again, "Repeat datasets that have a result of the same command");
  return [arguments, &common] { return evaluate(*arguments, common); };
}

}  // namespace fringeslam::tools
