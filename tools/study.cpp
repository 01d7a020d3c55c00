// SPDX-License-Identifier: Apache-2.0
// fringeslam study check|run|submit|merge|report|replay: Monte Carlo studies (bench/studies).
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>

#include "bench/studies/results.h"
#include "bench/studies/summary.h"
#include "bench/studies/tables.h"
#include "bench/studies/workers.h"
#include "core/base/shell.h"
#include "core/io/files.h"
#include "core/io/json_text.h"
#include "core/types/error.h"
#include "sim/scene/scene_files.h"
#include "tools/cluster_job.h"
#include "tools/interrupt.h"
#include "tools/output_file.h"
#include "tools/progress.h"
#include "tools/verbs.h"
#if FRINGESLAM_REPORT
#include "tools/report/study_report.h"
#include "tools/report/trial_pictures.h"
#endif

namespace fringeslam::tools {

namespace fs = std::filesystem;

namespace {

using namespace fringeslam::studies;

struct StudyArguments {
  std::string study, out, shard = "0/1";
  int jobs = 0, trial = -1, tasks = 0, cpus = 1, worst = 6;
  std::string cluster = "slurm";
  bool wait = false, pictures = false;

  int jobs_or_processors() const {
    return jobs > 0 ? jobs : static_cast<int>(std::max(1L, sysconf(_SC_NPROCESSORS_ONLN)));
  }
};

// Copy of the study file in the results folder, which documents the results.
constexpr const char* kStudyFile = "study.yaml";
constexpr int kWorst = 10;  // minimum number of worst trials in summary.json; more if --worst is larger

// Throws Error if files that are written again in the results folder belong to the study.
void check_results_folder(const Study& study, const fs::path& folder) {
  std::vector<fs::path> inputs = sim::named_files(study.scene);
  inputs.push_back(study.file);
  for (const char* name : {"results.jsonl", "results.csv", "results.sqlite", "summary.json", "report.html"})
    require_not_an_input(folder / name, inputs);
}

// Returns the number of missing trials.
int merge(const Study& study, const fs::path& folder, const Common& common) {
  check_results_folder(study, folder);
  const auto lines = merged_lines(folder, study);
  write_tables(folder, study, lines);
  const int missing = study.trials - static_cast<int>(lines.size());
  print_result(common, {{"folder", folder.string()}, {"trials", lines.size()}, {"missing", missing}},
               "merged: " + folder.string() + "/results.jsonl, .csv, .sqlite (" + std::to_string(lines.size()) +
                   " trials" + (missing > 0 ? ", " + std::to_string(missing) + " missing" : "") + ")");
  return missing;
}

// Returns the command that runs this program as a single-threaded worker.
std::vector<std::string> worker_command(const Study& study) {
  return {fs::read_symlink("/proc/self/exe").string(),
          "--threads",
          "1",
          "study",
          "worker",
          fs::absolute(study.file).string()};
}

int work(Study& study, [[maybe_unused]] const StudyArguments& arguments) {
#if FRINGESLAM_REPORT
  if (arguments.pictures) {
    studies::work(study, [&](const Trial& trial) {
      try {
        return json_text(trial_pictures(study, trial));
      } catch (const Error& e) {
        return json_text(nlohmann::ordered_json{{"unpictured", std::string("It could not be run again: ") + e.what()}});
      }
    });
    return 0;
  }
#endif
  hash_files(study);
  studies::work(study, [&](const Trial& trial) { return to_line(study, trial, run_trial(study, trial)); });
  return 0;
}

// Writes report.html if this program was built with it; returns a line that reports the outcome.
std::string write_page([[maybe_unused]] const Study& study, [[maybe_unused]] const std::map<int, std::string>& lines,
                       [[maybe_unused]] const Summary& summary, [[maybe_unused]] const StudyArguments& arguments) {
#if FRINGESLAM_REPORT
  const fs::path file = fs::path(arguments.out) / "report.html";
  StudyReportOptions options;
  options.pictured = arguments.worst;
  options.workers = {arguments.jobs_or_processors(), worker_command(study)};
  options.workers.command.push_back("--pictures");
  options.stop = interrupted;
  write_study_report(study, lines, summary, options, file);
  return "written: " + file.string();
#else
  return "report.html was not written: this program was built without it (FRINGESLAM_REPORT=OFF)";
#endif
}

// Writes summary.json and report.html; if `print` is set, also prints the summary as text or JSON.
void tell(const Study& study, const std::map<int, std::string>& lines, const StudyArguments& arguments,
          const Common& common, bool print) {
  const Summary summary = summarise(study, lines, std::max(kWorst, arguments.worst));
  const nlohmann::ordered_json json = to_json(summary);
  StagedFile file(fs::path(arguments.out) / "summary.json");
  write_text(file.path(), json_text(json, 1) + "\n");
  file.commit();
  if (print) print_text(common.json ? json_text(json, 2) : to_text(summary));
  std::fflush(stdout);
  const std::string written = write_page(study, lines, summary, arguments);
  if (!common.json && !common.quiet) std::printf("%s\n", written.c_str());
}

int run(const StudyArguments& arguments, const Common& common) {
  Study study = read_study(arguments.study);
  check_study(study);
  hash_files(study);
  const Shard shard = shard_of(arguments.shard);
  const fs::path folder = arguments.out;
  check_results_folder(study, folder);
  ShardFile results(folder, study, shard);
  if (!fs::exists(folder / kStudyFile)) write_text(folder / kStudyFile, read_bytes(study.file));
  const std::vector<int> missing = results.missing();
  const size_t found = results.lines().size();
  catch_interrupts();
  WorkerOptions workers;
  workers.jobs = arguments.jobs_or_processors();
  workers.command = worker_command(study);
  WorkersReport report;
  const auto start = std::chrono::steady_clock::now();
  {
    Progress progress("trials", static_cast<int>(missing.size()), common.quiet || common.json);
    int finished = 0, successes = 0;
    try {
      report = run_trials(
          study, missing, workers,
          [&](int trial, const std::string& line) {
            results.add(trial, line);
            successes += line.find("\"outcome\":\"success\"") != std::string::npos;
            progress.step("  " + std::to_string(100 * successes / ++finished) + " % succeed");
          },
          interrupted);
    } catch (const Error& e) {
      throw Error(std::string(e.what()) + "; " + std::to_string(results.lines().size()) + " results are kept in " +
                  arguments.out + "; run the same command to continue");
    }
  }
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  const size_t done = results.lines().size() - found;
  if (interrupted())
    throw Error("interrupted; " + std::to_string(results.lines().size()) + " results are kept in " + arguments.out +
                "; run the same command to continue");
  results.finish();
  const double rate = done > 0 ? static_cast<double>(done) / seconds : 0;
  char figures[160];
  std::snprintf(figures, sizeof figures, "%zu trials in %.0f s, %.2f/s; largest worker %.0f MiB", done, seconds, rate,
                report.largest_mib);
  if (shard.count == 1) {
    const auto lines = merged_lines(folder, study);
    write_tables(folder, study, lines);
    tell(study, lines, arguments, common, !common.json && !common.quiet);
  }
  print_result(common,
               {{"folder", arguments.out},
                {"shard", arguments.shard},
                {"trials", done},
                {"found", found},
                {"seconds", seconds},
                {"trials_a_second", rate},
                {"largest_worker_mib", report.largest_mib},
                {"workers_restarted", report.restarted}},
               std::string(figures) + (found > 0 ? " (" + std::to_string(found) + " existed already)" : ""));
  return 0;
}

int report(const Study& study, const StudyArguments& arguments, const Common& common) {
  check_results_folder(study, arguments.out);
  catch_interrupts();
  tell(study, merged_lines(arguments.out, study), arguments, common, true);
  return 0;
}

int replay(const StudyArguments& arguments, const Common& common) {
  Study study = read_study(arguments.study);
  if (arguments.trial >= study.trials)
    throw Error("--trial " + std::to_string(arguments.trial) + ": the study has trials 0 to " +
                std::to_string(study.trials - 1));
  hash_files(study);
  const Trial trial = trial_of(study, arguments.trial);
  const std::string line = to_line(study, trial, run_trial(study, trial));
  if (common.json)
    std::printf("%s\n", line.c_str());
  else
    print_text(json_text(nlohmann::ordered_json::parse(line), 2) + "\n\nto run it with all output files:\n  " +
               command_of(study, trial) + " --out runs/trial-" + std::to_string(arguments.trial));
  return 0;
}

int submit(const StudyArguments& arguments, const Common& common) {
  const Study study = read_study(arguments.study);
  check_study(study);
  const std::string job = submit_to_slurm({{"study", "run", fs::absolute(study.file).string()},
                                           arguments.out,
                                           std::min(arguments.tasks, study.trials),
                                           arguments.cpus});
  if (!arguments.wait) {
    print_result(common, {{"job", job}, {"folder", arguments.out}},
                 "job " + job + ": squeue -j " + job + " shows its state; when it has ended: fringeslam study merge " +
                     shell_word(arguments.study) + " --out " + shell_word(arguments.out));
    return 0;
  }
  wait_for_slurm(job);
  if (const int missing = merge(study, arguments.out, common); missing > 0)
    throw Error("study submit: job " + job + " ended without " + std::to_string(missing) + " trials; see its logs in " +
                arguments.out + ", and submit again to continue");
  return 0;
}

int check(const Study& study, const Common& common) {
  check_study(study);
  print_result(common, {{"study", study.name}, {"trials", study.trials}, {"parameters", study.parameters.size()}},
               single_line(study.name) + ": " + std::to_string(study.trials) + " trials of " + study.scene.string() +
                   ", " + std::to_string(study.parameters.size()) + " parameters; the study file is valid");
  return 0;
}

}  // namespace

Verb add_study(Command app, const Common& common) {
  const Command group = app.add_subcommand("study", "Monte Carlo studies: under which conditions does mapping fail?");
  group.require_subcommand(1);
  auto a = std::make_shared<StudyArguments>();
  const auto verb = [&](const char* name, const char* help) {
    const Command added = group.add_subcommand(name, help);
    added.add_option("study", a->study, "Study file").required().check_existing_file();
    return added;
  };
  const Command check_verb = verb("check", "Check a study file for errors");
  const Command run_verb = verb("run", "Run the trials, or those that are missing");
  const Command submit_verb = verb("submit", "Run the trials on a cluster, as a job array");
  const Command merge_verb = verb("merge", "Merge the shards to one table: JSON Lines, CSV, SQLite");
  const Command report_verb = verb("report", "Summarize the results: text, summary.json, report.html");
  const Command replay_verb = verb("replay", "Run one trial again, and print the command that keeps its output");
  const Command worker_verb = verb("worker", "").group("");
  for (const Command& with_folder : {run_verb, submit_verb, merge_verb, report_verb})
    with_folder.add_option("--out", a->out, "Results folder").required();
  for (const Command& with_page : {run_verb, report_verb}) {
    with_page.add_option("--jobs", a->jobs, "Trials in parallel (default: one per processor)").check_range(1, 4096);
    with_page.add_option("--worst", a->worst, "Number of worst trials to run again for their images in report.html (6)")
        .check_range(0, 1000);
  }
  worker_verb.add_flag("--pictures", a->pictures, "");
  run_verb.add_option("--shard", a->shard, "Run only every N-th trial, starting with trial I: I/N, I from 0");
  submit_verb.add_option("--cluster", a->cluster, "Scheduler of the cluster").check_one_of({"slurm"});
  submit_verb.add_option("--tasks", a->tasks, "Number of tasks in the array, one shard each")
      .required()
      .check_range(1, 1000000);
  submit_verb.add_option("--cpus", a->cpus, "Processors per task, and trials in parallel").check_range(1, 4096);
  submit_verb.add_flag("--wait", a->wait, "Wait until the job has ended, then merge");
  replay_verb.add_option("--trial", a->trial, "Number of the trial, from 0").required().check_non_negative();
  return [=, &common] {
    if (replay_verb.parsed()) return replay(*a, common);
    if (run_verb.parsed()) return run(*a, common);
    if (submit_verb.parsed()) return submit(*a, common);
    Study study = read_study(a->study);
    if (check_verb.parsed()) return check(study, common);
    if (merge_verb.parsed()) {
      (void)merge(study, a->out, common);
      return 0;
    }
    if (worker_verb.parsed()) return work(study, *a);
    return report(study, *a, common);
  };
}

}  // namespace fringeslam::tools
