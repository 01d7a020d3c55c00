// SPDX-License-Identifier: Apache-2.0
// The verb `dataset`: shards, kills, damaged parts, refused trials.
#include <gmock/gmock.h>
#include <signal.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <functional>
#include <nlohmann/json.hpp>
#include <thread>

#include "bench/datasets/sha256.h"
#include "core/io/files.h"
#include "tests/datasets/dataset_files.h"
#include "tests/support/random.h"

namespace fringeslam::datasets {
namespace {

namespace fs = std::filesystem;
using test::replaced;
using test::run_program;
using test::run_successfully;
using testing::HasSubstr;
using Json = nlohmann::json;

class DatasetVerb : public testing::Test {
 protected:
  std::string spec(const std::string& text = test::kSmallDataset) const {
    return test::write_dataset(temp_.path(), text).string();
  }
  std::string at(const std::string& name) const { return (temp_ / name).string(); }
  Json rendered(const std::string& file, const std::string& out, const std::string& shard = "0/1") const {
    return Json::parse(
        run_successfully({"--json", "dataset", file, "--out", at(out), "--jobs", "2", "--shard", shard}).out);
  }
  // Contents of all files, by name.
  std::map<std::string, std::string> contents(const std::string& folder) const {
    std::map<std::string, std::string> files;
    for (const std::string& name : test::listing(temp_ / folder)) {
      const fs::path file = temp_ / folder / name;
      files[name] = fs::is_directory(file) ? "folder" : sha256_hex(test::read_bytes(file));
    }
    return files;
  }
  // The same without pipes, which cannot be read, and without the folder of parts.
  std::map<std::string, std::string> readable(const std::string& folder) const {
    std::map<std::string, std::string> files;
    for (const std::string& name : test::listing(temp_ / folder)) {
      if (fs::is_regular_file(temp_ / folder / name)) files[name] = sha256_hex(test::read_bytes(temp_ / folder / name));
    }
    return files;
  }
  // Starts a run and returns its process id.
  pid_t started(const std::string& file, const std::string& out, const std::string& shard) const {
    const std::string folder = at(out);
    const pid_t pid = fork();
    if (pid == 0) {
      execl(FRINGESLAM_PROGRAM, FRINGESLAM_PROGRAM, "--quiet", "dataset", file.c_str(), "--out", folder.c_str(),
            "--jobs", "2", "--shard", shard.c_str(), nullptr);
      _exit(127);
    }
    return pid;
  }

  test::TempFolder temp_;
};

TEST_F(DatasetVerb, ReplacesNoFilesOfOthers) {
  for (const char* name : {"parts/mine.txt", "README.md"}) {
    const std::string out = std::string("of_others_") + name[0];
    test::write_bytes(temp_ / out / name, "mine");
    fs::create_directories(temp_ / out / "parts");
    const auto before = contents(out);
    const auto refused = run_program({"dataset", spec(), "--out", at(out)});
    EXPECT_EQ(refused.exit_code, 2);
    EXPECT_THAT(refused.err, HasSubstr("exists and is not a dataset"));
    EXPECT_EQ(contents(out), before);
  }
}

TEST_F(DatasetVerb, ShardsMakeTheBytesOfOneRun) {
  const std::string file = spec();
  const Json whole = rendered(file, "whole");
  EXPECT_EQ(whole["samples"], 12);
  EXPECT_EQ(whole["complete"], true);
  EXPECT_EQ(rendered(file, "parts", "1/2")["complete"], false);
  EXPECT_FALSE(fs::exists(temp_ / "parts/index.csv"));
  EXPECT_EQ(rendered(file, "parts", "0/2")["complete"], true);
  const auto expected = contents("whole");
  EXPECT_EQ(contents("parts"), expected);
  EXPECT_EQ(expected.size(), 9u);  // three tar files, index, datasheet, metadata, dataset.json, dataset.yaml, checksums
  // A repeated run has nothing left to do and changes nothing.
  EXPECT_EQ(rendered(file, "whole")["samples"], 0);
  EXPECT_EQ(contents("whole"), expected);
  // The checksums are those of sha256sum.
  EXPECT_EQ(std::system(("cd '" + at("whole") + "' && sha256sum --quiet -c SHA256SUMS").c_str()), 0);
}

TEST_F(DatasetVerb, KilledAtAnyMomentItContinues) {
  const std::string file = spec(replaced(replaced(test::kSmallDataset, "samples: 12", "samples: 120"),
                                         "samples_per_tar: 4", "samples_per_tar: 16"));
  const auto start = std::chrono::steady_clock::now();
  rendered(file, "whole");
  // Each of two shards is killed seven times, after a fourteenth of its duration on average.
  const std::chrono::duration<double> longest = 0.14 * (std::chrono::steady_clock::now() - start);
  support::Random random(20);
  int in_mid_run = 0;
  for (int i = 0; i < 14; ++i) {
    const pid_t run = started(file, "killed", std::to_string(i % 2) + "/2");
    std::this_thread::sleep_for(random.uniform(0, 1) * longest);
    kill(run, SIGKILL);
    int status = 0;
    waitpid(run, &status, 0);
    in_mid_run += WIFSIGNALED(status);
    // A file with its final name is complete at all times.
    for (const auto& [name, sum] : contents("killed")) {
      if (name.ends_with(".tar") && !name.starts_with("parts")) {
        EXPECT_EQ(sum, contents("whole").at(name)) << name;
      }
    }
  }
  EXPECT_GE(in_mid_run, 7);  // the last ones may find nothing left to do
  rendered(file, "killed", "0/2");
  rendered(file, "killed", "1/2");
  EXPECT_EQ(contents("killed"), contents("whole"));
}

TEST_F(DatasetVerb, DamagedPartsAreRenderedAgain) {
  const std::string file = spec(replaced(test::kSmallDataset, "samples_per_tar: 4", "samples_per_tar: 12"));
  rendered(file, "whole");
  // A part as a power loss may leave it: the right size, the wrong bytes; another one is cut off.
  const pid_t run = started(file, "damaged", "0/1");
  const fs::path parts = temp_ / "damaged/parts/train-000000";
  for (int i = 0; i < 2000 && !fs::exists(parts / "trial-1.json"); ++i)
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  kill(run, SIGKILL);
  waitpid(run, nullptr, 0);
  if (!fs::exists(parts / "trial-1.part")) GTEST_SKIP() << "the run ended before it was killed";
  std::string bytes = test::read_bytes(parts / "trial-1.part");
  bytes[bytes.size() / 2] = static_cast<char>(~bytes[bytes.size() / 2]);
  test::write_bytes(parts / "trial-1.part", bytes);
  if (fs::exists(parts / "trial-0.part")) test::truncate_file(parts / "trial-0.part", 0.5);
  const auto first = run_program({"--quiet", "dataset", file, "--out", at("damaged"), "--jobs", "2"});
  EXPECT_EQ(first.exit_code, 2);
  EXPECT_THAT(first.err, HasSubstr("was damaged and has been removed; run the command again"));
  rendered(file, "damaged");
  EXPECT_EQ(contents("damaged"), contents("whole"));
}

TEST_F(DatasetVerb, DamagedRecordsAreReported) {
  const std::string file = spec();
  rendered(file, "half", "1/2");
  const auto is_record = [](const fs::path& each) { return each.extension() == ".jsonl"; };
  const auto record = std::find_if(fs::directory_iterator(temp_ / "half/parts"), {}, is_record);
  ASSERT_NE(record, fs::directory_iterator());
  const std::string bytes = test::read_bytes(record->path());
  const std::string sums = bytes.substr(0, bytes.find('\n') + 1);
  int number = 0;
  for (const std::string& damaged : {std::string(), "{}\n" + bytes.substr(sums.size()), sums + "{}\n",
                                     sums + R"({"trial":99,"scene":"x","rig":"x","samples":[]})" + "\n"}) {
    const std::string out = "half" + std::to_string(number++);
    fs::copy(temp_ / "half", temp_ / out, fs::copy_options::recursive);
    test::write_bytes(temp_ / out / "parts" / record->path().filename(), damaged);
    const auto result = run_program({"--quiet", "dataset", file, "--out", at(out), "--jobs", "2", "--shard", "0/2"});
    EXPECT_EQ(result.exit_code, 2) << damaged;
    EXPECT_THAT(result.err, HasSubstr("run the command again"));
    EXPECT_EQ(std::count(result.err.begin(), result.err.end(), '\n'), 1) << result.err;
  }
}

TEST_F(DatasetVerb, DamageToACompleteDatasetIsReportedAndNothingIsReplaced) {
  const std::string file = spec();
  rendered(file, "whole");
  const auto expected = contents("whole");
  const std::string index = test::read_bytes(temp_ / "whole/index.csv");
  const auto pipe = [](const fs::path& at) {
    fs::remove(at);
    ASSERT_EQ(mkfifo(at.c_str(), 0600), 0);
  };
  struct Damage {
    const char* name;
    std::function<void(const fs::path&)> make;
    std::string message;
  };
  const std::vector<Damage> damages = {
      {"no_index", [](const fs::path& at) { fs::remove(at / "index.csv"); }, "index.csv: is missing; restore it"},
      {"index_cut",
       [&](const fs::path& at) { test::write_bytes(at / "index.csv", index.substr(0, index.rfind("train-"))); },
       "index.csv: is damaged; restore it"},
      {"sample_lost",
       [&](const fs::path& at) {
         test::write_bytes(at / "index.csv", index.substr(0, index.rfind('\n', index.size() - 2) + 1));
       },
       "index.csv: differs from its checksum in SHA256SUMS; restore it"},
      {"index_pipe", [&](const fs::path& at) { pipe(at / "index.csv"); }, "index.csv: is not a regular file"},
      {"sums_pipe", [&](const fs::path& at) { pipe(at / "SHA256SUMS"); }, "SHA256SUMS: is not a regular file"},
      {"sums_empty", [](const fs::path& at) { test::write_bytes(at / "SHA256SUMS", ""); }, "SHA256SUMS: is damaged"},
      {"tar_cut", [](const fs::path& at) { test::truncate_file(at / "train-000000.tar", 0.5); },
       "train-000000.tar: has "},
  };
  for (const Damage& damage : damages) {
    fs::copy(temp_ / "whole", temp_ / damage.name, fs::copy_options::recursive);
    damage.make(temp_ / damage.name);
    const auto before = readable(damage.name);
    const auto result = run_program({"--quiet", "dataset", file, "--out", at(damage.name), "--jobs", "1"});
    EXPECT_EQ(result.exit_code, 2) << damage.name;
    EXPECT_THAT(result.err, HasSubstr(damage.message)) << damage.name;
    EXPECT_EQ(std::count(result.err.begin(), result.err.end(), '\n'), 1) << result.err;
    EXPECT_EQ(readable(damage.name), before) << damage.name;
  }
  // A file that was written again and differs is refused until it is restored.
  fs::copy(temp_ / "whole", temp_ / "changed", fs::copy_options::recursive);
  test::write_bytes(temp_ / "changed/parts/train-000000.jsonl", "{}\n");
  std::string bytes = test::read_bytes(temp_ / "whole/train-000000.tar");
  bytes[1000] = static_cast<char>(~bytes[1000]);
  test::write_bytes(temp_ / "changed/train-000000.tar", bytes);
  EXPECT_THAT(run_program({"--quiet", "dataset", file, "--out", at("changed"), "--jobs", "1"}).err,
              HasSubstr("train-000000.tar: was written again and differs from its checksum"));
  fs::copy_file(temp_ / "whole/train-000000.tar", temp_ / "changed/train-000000.tar",
                fs::copy_options::overwrite_existing);
  rendered(file, "changed");
  EXPECT_EQ(contents("changed"), expected);
  // The remedy of the message about a file that was cut off.
  fs::remove(temp_ / "tar_cut/train-000000.tar");
  EXPECT_EQ(rendered(file, "tar_cut")["samples"], 4);
  EXPECT_EQ(contents("tar_cut"), expected);
}

TEST_F(DatasetVerb, RefusedTrialsAreListed) {
  // In every second trial far_m is below near_m, which is rejected.
  const std::string file = spec(
      replaced(test::kSmallDataset, "light.ambient_lux: {log_uniform: [10, 1000]}", "rig.far_m: {grid: [1.4, 0.1]}"));
  const Json result = rendered(file, "out");
  EXPECT_EQ(result["samples"], 6);
  EXPECT_EQ(result["refused_trials"], 3);
  const std::string refused = test::read_bytes(temp_ / "out/refused.csv");
  EXPECT_EQ(std::count(refused.begin(), refused.end(), '\n'), 4);
  EXPECT_THAT(refused, HasSubstr("far_m must be larger than near_m"));
  EXPECT_THAT(refused, testing::Not(HasSubstr(temp_.path().string())));
  EXPECT_THAT(test::read_bytes(temp_ / "out/README.md"), HasSubstr("3 of 6 trials have no samples"));
  EXPECT_THAT(test::read_bytes(temp_ / "out/SHA256SUMS"), HasSubstr("refused.csv"));
}

TEST_F(DatasetVerb, ATrialThatTakesTooLongIsReported) {
  const std::string file = spec(replaced(test::kSmallDataset, "fixed:\n",
                                         "timeout_s: 2\nfixed:\n  render.samples_per_pixel: 256\n"
                                         "  render.bounce_paths: 4096\n  light.bounces: 4\n"));
  const auto finished = run_program({"--quiet", "dataset", file, "--out", at("slow"), "--jobs", "2", "--shard", "0/3"});
  EXPECT_EQ(finished.exit_code, 2);
  EXPECT_THAT(finished.err, HasSubstr("took longer than 2 s"));
  EXPECT_EQ(std::count(finished.err.begin(), finished.err.end(), '\n'), 1) << finished.err;
}

TEST_F(DatasetVerb, AnotherDatasetIsNotOverwritten) {
  const std::string file = spec();
  rendered(file, "out");
  const auto before = contents("out");
  spec(replaced(test::kSmallDataset, "seed: 5", "seed: 6"));
  const auto other = run_program({"dataset", file, "--out", at("out")});
  EXPECT_EQ(other.exit_code, 2);
  EXPECT_THAT(other.err, HasSubstr("contains another dataset"));
  EXPECT_EQ(contents("out"), before);
  // Texts for readers may change afterwards; samples and index stay.
  spec(replaced(test::kSmallDataset, "Boxes, for tests", "A better description"));
  rendered(file, "out");
  EXPECT_THAT(test::read_bytes(temp_ / "out/README.md"), HasSubstr("A better description"));
  EXPECT_EQ(contents("out").at("index.csv"), before.at("index.csv"));
  EXPECT_EQ(std::system(("cd '" + at("out") + "' && sha256sum --quiet -c SHA256SUMS").c_str()), 0);
}

TEST_F(DatasetVerb, WrongUseIsReportedInOneLine) {
  const std::string file = spec();
  test::write_bytes(temp_ / "other/file", "");
  for (const std::vector<std::string>& wrong : {std::vector<std::string>{"dataset"},
                                                {"dataset", file},
                                                {"dataset", at("nothing.yaml"), "--out", at("x")},
                                                {"dataset", file, "--out", at("x"), "--shard", "2/2"},
                                                {"dataset", file, "--out", at("other")},
                                                {"dataset", "check", file, "--jobs", "9"},
                                                {"dataset", "check", file, "--shard", "7/3"},
                                                {"dataset", "check", file, file},
                                                {"dataset", "check", at("nothing.yaml")}}) {
    const auto finished = run_program(wrong);
    EXPECT_EQ(finished.exit_code, 2) << finished.out;
    EXPECT_EQ(std::count(finished.err.begin(), finished.err.end(), '\n'), 1) << finished.err;
  }
  EXPECT_FALSE(fs::exists(temp_ / "x"));
}

}  // namespace
}  // namespace fringeslam::datasets
