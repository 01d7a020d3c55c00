// SPDX-License-Identifier: Apache-2.0
// Studies on the command line: shards, kills, crashes, timeouts.
#include <gmock/gmock.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <nlohmann/json.hpp>
#include <sstream>
#include <thread>

#include "bench/studies/results.h"
#include "core/io/files.h"
#include "tests/studies/study_files.h"
#include "tests/support/random.h"

namespace fringeslam::studies {
namespace {

namespace fs = std::filesystem;
using test::replaced;
using test::run_program;
using test::run_successfully;
using testing::HasSubstr;
using Json = nlohmann::json;

class StudyVerb : public testing::Test {
 protected:
  std::string study(const std::string& text = test::kSmallStudy) const {
    return test::write_study(temp_.path(), text).string();
  }
  std::string at(const std::string& name) const { return (temp_ / name).string(); }
  std::string results(const std::string& folder) const { return read_bytes(temp_ / folder / "results.jsonl"); }

  // Starts a run and returns its process id.
  pid_t started(const std::string& file, const std::string& out) const {
    const pid_t pid = fork();
    if (pid == 0) {
      execl(FRINGESLAM_PROGRAM, FRINGESLAM_PROGRAM, "--quiet", "study", "run", file.c_str(), "--out", out.c_str(),
            "--jobs", "2", nullptr);
      _exit(127);
    }
    return pid;
  }
  // Returns a process in which a study runs trials, or -1 if there is none: it has another command line. The other processes
  // that the program starts are forked only.
  static pid_t worker_of(pid_t study) {
    const auto command = [](pid_t pid) { return read_bytes("/proc/" + std::to_string(pid) + "/cmdline"); };
    const std::string task = std::to_string(study);
    std::istringstream children(read_bytes("/proc/" + task + "/task/" + task + "/children"));
    for (pid_t child = 0; children >> child;) {
      if (const std::string own = command(child); !own.empty() && own != command(study)) return child;
    }
    return -1;
  }
  size_t lines_in(const std::string& folder) const {
    size_t count = 0;
    std::error_code none;
    for (const auto& file : fs::directory_iterator(temp_ / folder / "shards", none)) {
      const std::string text = read_bytes(file);
      count += static_cast<size_t>(std::count(text.begin(), text.end(), '\n'));
    }
    return count;
  }

  test::TempFolder temp_;
};

TEST_F(StudyVerb, ReplacesNoFilesOfOthers) {
  for (const char* name : {"results.jsonl", "report.html"}) {
    const std::string out = std::string("of_others_") + name;
    test::write_bytes(temp_ / out / name, "mine");
    const auto refused = run_program({"study", "run", study(), "--out", at(out)});
    EXPECT_EQ(refused.exit_code, 2);
    EXPECT_THAT(refused.err, HasSubstr(std::string(name) + ": was not written by a study"));
    EXPECT_EQ(test::listing(temp_ / out), (std::set<std::string>{name}));
  }
}

TEST_F(StudyVerb, ParametersWithTheNameOfAColumnAreRefused) {
  const std::string file = study(replaced(test::kSmallStudy, "parameters:\n", "parameters:\n  seed: {grid: [1, 2]}\n"));
  for (const char* verb : {"check", "run"}) {
    std::vector<std::string> words = {"study", verb, file};
    if (words[1] == "run") words.insert(words.end(), {"--out", at("columns")});
    const auto refused = run_program(words);
    EXPECT_EQ(refused.exit_code, 2);
    EXPECT_THAT(refused.err, HasSubstr("'seed' is a column"));
  }
}

TEST_F(StudyVerb, ShardsMakeTheBytesOfOneRun) {
  const std::string file = study();
  const auto whole = run_successfully({"--json", "study", "run", file, "--out", at("whole"), "--jobs", "2"});
  EXPECT_EQ(Json::parse(whole.out)["trials"], 6);
  run_successfully({"--json", "study", "run", file, "--out", at("parts"), "--jobs", "1", "--shard", "1/3"});
  run_successfully({"--json", "study", "run", file, "--out", at("parts"), "--jobs", "1", "--shard", "0/3"});
  const auto early = run_successfully({"--json", "study", "merge", file, "--out", at("parts")});
  EXPECT_EQ(Json::parse(early.out)["missing"], 2);
  run_successfully({"--json", "study", "run", file, "--out", at("parts"), "--jobs", "1", "--shard", "2/3"});
  run_successfully({"--json", "study", "merge", file, "--out", at("parts")});
  EXPECT_EQ(results("parts"), results("whole"));
  EXPECT_EQ(read_bytes(temp_ / "parts/results.sqlite"), read_bytes(temp_ / "whole/results.sqlite"));
  // A repeated run has nothing left to do and changes nothing.
  const auto again = run_successfully({"--json", "study", "run", file, "--out", at("whole")});
  EXPECT_EQ(Json::parse(again.out)["trials"], 0);
  EXPECT_EQ(Json::parse(again.out)["found"], 6);
  EXPECT_EQ(results("parts"), results("whole"));
  EXPECT_THAT(run_successfully({"study", "report", file, "--out", at("whole")}).out, HasSubstr("small: 6 trials"));
  // Each trial on its own gives the same line.
  const std::string line = run_successfully({"--json", "study", "replay", file, "--trial", "2"}).out;
  EXPECT_THAT(results("whole"), HasSubstr(line));
}

TEST_F(StudyVerb, KilledAtAnyMomentItGoesOn) {
  const std::string file = study(replaced(test::kSmallStudy, "trials: 6", "trials: 40"));
  run_successfully({"--quiet", "study", "run", file, "--out", at("whole"), "--jobs", "2", "--worst", "0"});
  support::Random random(20);
  int in_mid_run = 0;
  for (int i = 0; i < 20; ++i) {
    const pid_t run = started(file, at("killed"));
    std::this_thread::sleep_for(std::chrono::duration<double>(random.uniform(0, 1.2)));
    kill(run, SIGKILL);
    int status = 0;
    waitpid(run, &status, 0);
    in_mid_run += WIFSIGNALED(status);
  }
  EXPECT_GE(in_mid_run, 10);  // on fast machines the last ones may find nothing left to do
  run_successfully({"--quiet", "study", "run", file, "--out", at("killed"), "--jobs", "2", "--worst", "0"});
  EXPECT_EQ(results("killed"), results("whole"));
}

TEST_F(StudyVerb, AWorkerThatDiesIsThatTrialsResult) {
  const std::string file = study();
  const pid_t run = started(file, at("crashed"));
  pid_t worker = -1;
  for (int i = 0; i < 500 && (worker = worker_of(run)) <= 0; ++i)
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  ASSERT_GT(worker, 0);
  kill(worker, SIGSEGV);
  int status = -1;
  waitpid(run, &status, 0);
  EXPECT_EQ(status, 0);
  const std::string text = results("crashed");
  EXPECT_EQ(std::count(text.begin(), text.end(), '\n'), 6);
  EXPECT_THAT(text,
              HasSubstr(R"("outcome":"crashed","cause":"crashed","message":"killed by signal Segmentation fault")"));
}

TEST_F(StudyVerb, ATrialThatTakesTooLongIsStopped) {
  // With this many rays per pixel it takes minutes.
  const std::string file = study(replaced(replaced(test::kSmallStudy, "trials: 6", "trials: 1\ntimeout_s: 2"),
                                          "fixed:", "fixed:\n  render.samples_per_pixel: 256\n  patterns.steps: 64"));
  run_successfully({"--quiet", "study", "run", file, "--out", at("slow")});
  EXPECT_THAT(results("slow"),
              HasSubstr(R"("outcome":"timed_out","cause":"timed_out","message":"took longer than 2 s")"));
}

TEST_F(StudyVerb, ATrialWithAnInvalidWorldIsAResult) {
  // In every second trial far_m is below near_m, which is rejected.
  const std::string file = study(
      replaced(test::kSmallStudy, "light.ambient_lux: {log_uniform: [10, 5000]}", "rig.far_m: {grid: [1.4, 0.1]}"));
  run_successfully({"--quiet", "study", "run", file, "--out", at("refused")});
  const std::string text = results("refused");
  EXPECT_THAT(text, HasSubstr(R"("outcome":"refused","cause":"refused","message":)"));
  EXPECT_THAT(text, HasSubstr("far_m must be larger than near_m"));
  EXPECT_THAT(text, HasSubstr(R"("outcome":"success")"));
}

#ifdef FRINGESLAM_REPORT
// Returns the data of a page.
Json page_data(const std::string& page) {
  const std::string start = "<script type=\"application/json\" id=\"data\">";
  const size_t first = page.find(start) + start.size();
  return Json::parse(page.substr(first, page.find("</script>", first) - first));
}

class StudyPage : public StudyVerb {
 protected:
  // A study whose trials all fail, because no error is as small as the limit.
  std::string failing(const std::string& name = "small") const {
    return study(replaced(replaced(test::kSmallStudy, "max_translation_mm: 5", "max_translation_mm: 1e-9"),
                          "name: small", "name: " + name));
  }
  Json report(const std::string& folder) const { return page_data(read_bytes(temp_ / folder / "report.html")); }
};

TEST_F(StudyPage, HasThePicturesOfTheWorst) {
  const std::string file = failing();
  run_successfully({"--quiet", "study", "run", file, "--out", at("out"), "--worst", "2"});
  const Json data = report("out");
  EXPECT_EQ(data["summary"], Json::parse(read_bytes(temp_ / "out/summary.json")));
  EXPECT_EQ(data["summary"]["successes"], 0);
  ASSERT_EQ(data["worst"].size(), 2u);
  for (const Json& worst : data["worst"]) {
    ASSERT_EQ(worst["views"].size(), 2u) << worst;
    for (const char* picture : {"texture", "error"})
      EXPECT_THAT(worst["views"][1][picture].get<std::string>(), testing::StartsWith("data:image/"));
    EXPECT_GT(worst["limit_mm"], 0);
  }
  // Reporting again gives the same page; --worst 0 gives no pictures.
  const std::string page = read_bytes(temp_ / "out/report.html");
  EXPECT_THAT(run_successfully({"study", "report", file, "--out", at("out"), "--worst", "2"}).out,
              HasSubstr("written: " + at("out/report.html")));
  EXPECT_TRUE(read_bytes(temp_ / "out/report.html") == page);
  run_successfully({"--json", "study", "report", file, "--out", at("out"), "--worst", "0"});
  EXPECT_TRUE(report("out")["worst"].empty());
}

TEST_F(StudyPage, SaysWhatATrialDidInsteadOfBeingPictured) {
  // Its results exist, but the sensor file does not.
  const std::string file = failing();
  run_successfully({"--quiet", "study", "run", file, "--out", at("out"), "--worst", "0"});
  fs::remove(temp_ / "rig.yaml");
  run_successfully({"--quiet", "study", "report", file, "--out", at("out"), "--worst", "1"});
  EXPECT_THAT(report("out")["worst"][0]["unpictured"].get<std::string>(), HasSubstr("rig.yaml"));
}

TEST_F(StudyPage, EscapesNames) {
  const std::string file = failing("\"</script><!--<script>&\"");
  run_successfully({"--quiet", "study", "run", file, "--out", at("out"), "--worst", "0"});
  const std::string page = read_bytes(temp_ / "out/report.html");
  EXPECT_THAT(page, HasSubstr("<title>&lt;/script&gt;&lt;!--&lt;script&gt;&amp;"));
  EXPECT_THAT(page, testing::Not(HasSubstr("</script><!--")));
  EXPECT_EQ(report("out")["name"], "</script><!--<script>&");
}
#endif

TEST_F(StudyVerb, NamesSendNoCommandsToTheTerminal) {
  const std::string file = study(replaced(test::kSmallStudy, "name: small", "name: \"a\\e]0;\\nb\""));
  EXPECT_THAT(run_successfully({"study", "check", file}).out, testing::StartsWith("a ]0; b: 6 trials"));
}

TEST_F(StudyVerb, BadUseIsSaidInOneLine) {
  const std::string file = study();
  for (const std::vector<std::string>& wrong :
       {std::vector<std::string>{"study", "run", file, "--out", at("x"), "--shard", "3/3"},
        {"study", "run", at("nothing.yaml"), "--out", at("x")},
        {"study", "merge", file, "--out", at("nowhere")},
        {"study", "replay", file, "--trial", "6"}}) {
    const auto finished = run_program(wrong);
    EXPECT_EQ(finished.exit_code, 2) << finished.out;
    EXPECT_EQ(std::count(finished.err.begin(), finished.err.end(), '\n'), 1) << finished.err;
  }
}

}  // namespace
}  // namespace fringeslam::studies
