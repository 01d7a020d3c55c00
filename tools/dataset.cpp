// SPDX-License-Identifier: Apache-2.0
// fringeslam dataset SPEC --out DIR, fringeslam dataset check|submit: datasets for training (bench/datasets).
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <thread>

#include "bench/datasets/dataset_folder.h"
#include "bench/datasets/trial_part.h"
#include "bench/studies/results.h"
#include "bench/studies/workers.h"
#include "core/base/bounded_queue.h"
#include "core/io/image_library.h"
#include "core/types/error.h"
#include "sim/scene/scene_files.h"
#include "tools/cluster_job.h"
#include "tools/interrupt.h"
#include "tools/output_file.h"
#include "tools/progress.h"
#include "tools/verbs.h"

namespace fringeslam::tools {

namespace fs = std::filesystem;

namespace {

using namespace fringeslam::datasets;
using Json = nlohmann::ordered_json;

struct DatasetArguments {
  std::string spec, out, shard = "0/1", cluster = "slurm";
  int jobs = 0, tasks = 0, cpus = 1;
  bool wait = false;

  int jobs_or_processors() const {
    return jobs > 0 ? jobs : static_cast<int>(std::max(1L, sysconf(_SC_NPROCESSORS_ONLN)));
  }
};

// Joins the trials of finished tar files in a thread of its own, so that the workers are not kept waiting.
class Joiner {
 public:
  explicit Joiner(const DatasetFolder& folder) : folder_(folder), thread_([this] { run(); }) {}
  ~Joiner() {
    queue_.cancel();
    if (thread_.joinable()) thread_.join();
  }
  Joiner(const Joiner&) = delete;
  Joiner& operator=(const Joiner&) = delete;

  void add(size_t tar) { queue_.push(tar); }
  bool failed() const { return failed_; }
  // Waits until all tar files are joined. Throws the first error.
  void finish() {
    queue_.close();
    thread_.join();
    if (failure_) std::rethrow_exception(failure_);
  }

 private:
  void run() {
    while (const std::optional<size_t> tar = queue_.pop()) {
      try {
        folder_.join(*tar);
      } catch (...) {
        failure_ = std::current_exception();
        failed_ = true;
        return queue_.cancel();
      }
    }
  }

  const DatasetFolder& folder_;
  BoundedQueue<size_t> queue_{1'000'000, WhenFull::keep_all};
  std::exception_ptr failure_;
  std::atomic<bool> failed_ = false;
  std::thread thread_;  // last: it uses the other members
};

// The work of a shard: every count-th tar file.
struct ShardWork {
  std::vector<int> trials;        // to render, in the order of the tar files
  std::map<int, size_t> tar_of;   // of each of these trials
  std::map<size_t, size_t> left;  // of each tar file: number of trials to render
  std::vector<size_t> ready;      // tar files whose trials are all rendered
  size_t tars = 0, found = 0;     // in the shard; finished before
};

ShardWork work_of(const DatasetFolder& folder, studies::Shard shard) {
  ShardWork work;
  for (size_t tar = 0; tar < folder.tars().size(); ++tar) {
    if (static_cast<int>(tar % static_cast<size_t>(shard.count)) != shard.index) continue;
    ++work.tars;
    if (folder.has(tar)) {
      ++work.found;
      continue;
    }
    const std::vector<int> missing = folder.missing(tar);
    if (missing.empty()) work.ready.push_back(tar);
    if (!missing.empty()) work.left[tar] = missing.size();
    for (const int trial : missing) {
      work.trials.push_back(trial);
      work.tar_of[trial] = tar;
    }
  }
  return work;
}

std::vector<std::string> worker_command(const Spec& spec, const DatasetArguments& arguments) {
  return {fs::read_symlink("/proc/self/exe").string(),
          "--threads",
          "1",
          "dataset",
          "worker",
          fs::absolute(spec.file).string(),
          "--out",
          fs::absolute(arguments.out).string()};
}

// Renders trials on request; answers with what became of each.
int work(const DatasetArguments& arguments) {
  use_no_image_threads();
  const Spec spec = read_spec(arguments.spec);
  std::map<int, std::string> tar_of;
  for (const Tar& tar : tars_of(spec)) {
    for (const int trial : tar.trials) tar_of[trial] = tar.name;
  }
  studies::work(spec.trials(), [&](int trial) {
    try {
      const TrialIndex index =
          write_trial(spec, studies::trial_of(spec, trial), fs::path(arguments.out) / kParts / tar_of.at(trial));
      return Json{{"trial", trial}, {"samples", index.samples.size()}}.dump();
    } catch (const std::exception& e) {
      // Another process that writes the same dataset may have finished the file and removed its parts.
      std::error_code unknown;
      if (fs::exists(fs::path(arguments.out) / (tar_of.at(trial) + ".tar"), unknown))
        return Json{{"trial", trial}, {"samples", spec.views}}.dump();
      return Json{{"trial", trial}, {"failed", e.what()}}.dump();
    }
  });
  return 0;
}

// Opens the dataset's folder. Throws Error like DatasetFolder, or if files that are written again in it belong to the
// specification. A copy of the specification is written to dataset.yaml, which may be the specification itself.
DatasetFolder opened_folder(const DatasetArguments& arguments, const Spec& spec) {
  const std::string identity = check_spec(spec);
  std::vector<fs::path> inputs = spec.rigs;
  inputs.push_back(spec.file);
  for (const fs::path& scene : spec.scenes) {
    const std::vector<fs::path> files = sim::named_files(scene);
    inputs.insert(inputs.end(), files.begin(), files.end());
  }
  for (const char* name : {"dataset.json", "index.csv", "refused.csv", "README.md", "croissant.json", "SHA256SUMS"})
    require_not_an_input(fs::path(arguments.out) / name, inputs);
  return {arguments.out, spec, identity, FRINGESLAM_VERSION};
}

struct Outcome {
  size_t samples = 0, refused = 0;
  std::string failure;                // of the machine, such as a full disk: rendering stops
  std::vector<std::string> failures;  // of single trials
  studies::WorkersReport workers;
};

Outcome render(const Spec& spec, const DatasetFolder& folder, ShardWork& work, const DatasetArguments& arguments,
               const Common& common) {
  Outcome outcome;
  Joiner joiner(folder);
  for (const size_t tar : work.ready) joiner.add(tar);
  Progress progress("samples", static_cast<int>(work.trials.size()) * spec.views, common.quiet || common.json);
  const auto answered = [&](int trial, const std::string& line) {
    const Json answer = Json::parse(line, nullptr, false);
    if (!answer.is_object() || !answer.contains("samples")) {
      outcome.failure = answer.is_object() ? answer.value("failed", "") : "a worker gave no valid answer";
      return;
    }
    const auto samples = answer["samples"].get<size_t>();
    outcome.samples += samples;
    outcome.refused += samples == 0;
    const std::string note = outcome.refused > 0 ? "  " + std::to_string(outcome.refused) + " trials refused" : "";
    for (int view = 0; view < spec.views; ++view) progress.step(note);
    const size_t tar = work.tar_of.at(trial);
    if (--work.left.at(tar) == 0) joiner.add(tar);
  };
  const auto failed = [&](int trial, const studies::WorkerEnd& end) {
    outcome.failures.push_back("trial " + std::to_string(trial) + ": " + end.message);
  };
  const auto stop = [&] { return interrupted() || !outcome.failure.empty() || joiner.failed(); };
  const studies::WorkerOptions options{arguments.jobs_or_processors(), worker_command(spec, arguments)};
  outcome.workers = studies::run_tasks(work.trials, options, spec.timeout_s, {answered, failed, stop});
  if (!interrupted()) joiner.finish();
  return outcome;
}

int generate(const DatasetArguments& arguments, const Common& common) {
  const Spec spec = read_spec(arguments.spec);
  const studies::Shard shard = studies::shard_of(arguments.shard);
  const DatasetFolder folder = opened_folder(arguments, spec);
  catch_interrupts();
  ShardWork work = work_of(folder, shard);
  const auto start = std::chrono::steady_clock::now();
  const Outcome outcome = render(spec, folder, work, arguments, common);
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  const std::string again = "; run the same command to continue";
  if (interrupted()) throw Error("interrupted; what is finished is kept in " + arguments.out + again);
  if (!outcome.failure.empty()) throw Error(outcome.failure + again);
  if (!outcome.failures.empty())
    throw Error(std::to_string(outcome.failures.size()) + " trials failed, the first: " + outcome.failures.front() +
                again);
  const bool complete = folder.finish();
  const double rate = outcome.samples > 0 ? static_cast<double>(outcome.samples) / seconds : 0;
  char figures[160];
  std::snprintf(figures, sizeof figures, "%zu samples in %.0f s, %.2f/s; largest worker %.0f MiB", outcome.samples,
                seconds, rate, outcome.workers.largest_mib);
  std::string line = figures;
  if (work.found > 0) line += " (" + std::to_string(work.found) + " tar files existed already)";
  if (outcome.refused > 0) line += "; " + std::to_string(outcome.refused) + " trials refused, see refused.csv";
  line += complete ? "\ndataset: " + arguments.out : "\nthe dataset is complete when all shards have ended";
  if (complete && !spec.publication)
    line += "\ncroissant.json lacks license, url, creator and date: add 'publication' to " + arguments.spec +
            " and run the same command to publish the dataset";
  print_result(common,
               {{"folder", arguments.out},
                {"shard", arguments.shard},
                {"samples", outcome.samples},
                {"refused_trials", outcome.refused},
                {"tars", work.tars},
                {"tars_found", work.found},
                {"complete", complete},
                {"seconds", seconds},
                {"samples_a_second", rate},
                {"largest_worker_mib", outcome.workers.largest_mib}},
               line);
  return 0;
}

int check(const DatasetArguments& arguments, const Common& common) {
  const Spec spec = read_spec(arguments.spec);
  (void)check_spec(spec);
  const std::vector<Tar> tars = tars_of(spec);
  print_result(
      common, {{"dataset", spec.name}, {"samples", spec.samples}, {"worlds", spec.worlds}, {"tars", tars.size()}},
      single_line(spec.name) + ": " + std::to_string(spec.samples) + " samples of " + std::to_string(spec.worlds) +
          " worlds in " + std::to_string(tars.size()) + " tar files; the specification is valid");
  return 0;
}

int submit(const DatasetArguments& arguments, const Common& common) {
  const Spec spec = read_spec(arguments.spec);
  const DatasetFolder folder = opened_folder(arguments, spec);
  const std::string job = submit_to_slurm({{"dataset", fs::absolute(spec.file).string()},
                                           arguments.out,
                                           std::min(arguments.tasks, static_cast<int>(folder.tars().size())),
                                           arguments.cpus});
  if (!arguments.wait) {
    print_result(common, {{"job", job}, {"folder", arguments.out}},
                 "job " + job + ": squeue -j " + job + " shows its state; the last task completes " + arguments.out);
    return 0;
  }
  wait_for_slurm(job);
  if (!folder.finish())
    throw Error("dataset submit: job " + job + " ended without completing " + arguments.out + "; see its logs there, " +
                "and submit again to continue");
  print_result(common, {{"job", job}, {"folder", arguments.out}}, "dataset: " + arguments.out);
  return 0;
}

}  // namespace

Verb add_dataset(Command app, const Common& common) {
  const Command verb =
      app.add_subcommand("dataset", "Render a dataset for training: samples in tar files with ground truth");
  auto a = std::make_shared<DatasetArguments>();
  const Option spec = verb.add_option("spec", a->spec, "Specification of the dataset");
  const Command check_verb = verb.add_subcommand("check", "Check a specification for errors");
  const Command submit_verb = verb.add_subcommand("submit", "Render the dataset on a cluster, as a job array");
  const Command worker_verb = verb.add_subcommand("worker", "").group("");
  for (const Command& other : {check_verb, submit_verb, worker_verb})
    other.add_option("spec", a->spec, "Specification of the dataset").required().check_existing_file();
  const Option out = verb.add_option("--out", a->out, "Dataset folder");
  for (const Command& with_folder : {submit_verb, worker_verb})
    with_folder.add_option("--out", a->out, "Dataset folder").required();
  const Option jobs =
      verb.add_option("--jobs", a->jobs, "Trials in parallel (default: one per processor)").check_range(1, 4096);
  const Option shard =
      verb.add_option("--shard", a->shard, "Write only every N-th tar file, starting with tar file I: I/N, I from 0");
  submit_verb.add_option("--cluster", a->cluster, "Scheduler of the cluster").check_one_of({"slurm"});
  submit_verb.add_option("--tasks", a->tasks, "Number of tasks in the array, one shard each")
      .required()
      .check_range(1, 1000000);
  submit_verb.add_option("--cpus", a->cpus, "Processors per task, and trials in parallel").check_range(1, 4096);
  submit_verb.add_flag("--wait", a->wait, "Wait until the job has ended");
  return [=, &common] {
    // Options and arguments of `dataset` itself are accepted behind the name of an action too.
    if (check_verb.parsed() || submit_verb.parsed() || worker_verb.parsed()) {
      for (const Option& other : {out, jobs, shard}) {
        if (other.count() > 0)
          throw Error("dataset: " + other.get_name() + " has no effect here; see `fringeslam dataset --help`");
      }
      if (spec.count() > 0) throw Error("dataset: give one specification");
    }
    if (check_verb.parsed()) return check(*a, common);
    if (submit_verb.parsed()) return submit(*a, common);
    if (worker_verb.parsed()) return work(*a);
    if (spec.count() == 0) throw Error("dataset: give a specification, as in fringeslam dataset SPEC --out DIR");
    if (out.count() == 0) throw Error("dataset: --out is missing: the folder to write");
    return generate(*a, common);
  };
}

}  // namespace fringeslam::tools
