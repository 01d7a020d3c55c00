// SPDX-License-Identifier: Apache-2.0
#include "bench/studies/results.h"

#include <gmock/gmock.h>

#include <nlohmann/json.hpp>
#include <set>

#include "bench/studies/tables.h"
#include "bench/studies/trial_run.h"
#include "core/types/error.h"
#include "tests/studies/study_files.h"
#include "tests/support/matchers.h"

namespace fringeslam::studies {
namespace {

namespace fs = std::filesystem;
using support::error_of;
using testing::ElementsAre;
using testing::HasSubstr;

class Results : public testing::Test {
 protected:
  Results() : study_(read_study(test::write_study(temp_.path()))), folder_(temp_ / "results") {}

  std::string line(int trial, double error_mm = 0.5) const {
    TrialResult result;
    result.index = trial;
    result.outcome = Outcome::success;
    result.metrics = {{"translation_mm", error_mm}};
    return to_line(study_, trial_of(study_, trial), result);
  }

  test::TempFolder temp_;
  Study study_;
  fs::path folder_;
};

TEST_F(Results, AreFoundAgainExceptATornLine) {
  {
    ShardFile file(folder_, study_, {0, 2});
    EXPECT_THAT(file.missing(), ElementsAre(0, 2, 4));
    file.add(4, line(4));
    file.add(0, line(0));
  }
  const fs::path partial = fs::directory_iterator(folder_ / "shards")->path();
  test::write_bytes(partial, read_bytes(partial) + line(2).substr(0, 40));  // killed while writing it
  ShardFile again(folder_, study_, {0, 2});
  EXPECT_THAT(again.missing(), ElementsAre(2));
  again.add(2, line(2));
  again.finish();
  EXPECT_EQ(read_bytes(folder_ / "shards/0-of-2.jsonl"), line(0) + "\n" + line(2) + "\n" + line(4) + "\n");
  EXPECT_EQ(std::distance(fs::directory_iterator(folder_ / "shards"), fs::directory_iterator()), 1);
  EXPECT_TRUE(ShardFile(folder_, study_, {0, 2}).missing().empty());
}

// A damaged line is removed, and its trial run again.
TEST_F(Results, TrialsAreAddedToAFinishedShard) {
  fs::create_directories(folder_ / "shards");
  const fs::path shard = folder_ / "shards/0-of-2.jsonl";
  const std::string whole = line(0) + "\n" + line(2) + "\n" + line(4) + "\n";
  for (const std::string& rest :
       {line(0) + "\n" + line(4) + "\n", line(0) + "\n" + line(2) + "\n" + line(4).substr(0, 30), std::string()}) {
    test::write_bytes(shard, rest);
    ShardFile file(folder_, study_, {0, 2});
    for (const int trial : file.missing()) file.add(trial, line(trial));
    file.finish();
    EXPECT_EQ(read_bytes(shard), whole);
    EXPECT_EQ(std::distance(fs::directory_iterator(folder_ / "shards"), fs::directory_iterator()), 1);
  }
}

TEST_F(Results, DoNotReplaceAReportBesideAnotherFolderOfShards) {
  fs::create_directories(folder_ / "shards");
  test::write_bytes(folder_ / "report.html", "mine");
  EXPECT_THAT(error_of([&] { ShardFile(folder_, study_, {0, 1}); }), HasSubstr("was not written by a study"));
}

TEST_F(Results, OfTwoWhoDidTheSameAreOne) {
  fs::create_directories(folder_ / "shards");
  test::write_bytes(folder_ / "shards/0-of-1.jsonl", line(0) + "\n" + line(1) + "\n");
  test::write_bytes(folder_ / "shards/0-of-3.other.7.partial", line(0) + "\n" + line(3) + "\n");
  EXPECT_EQ(merged_lines(folder_, study_).size(), 3u);
  test::write_bytes(folder_ / "shards/1-of-3.jsonl", line(1, 0.6) + "\n");
  EXPECT_THAT(error_of([&] { merged_lines(folder_, study_); }),
              HasSubstr("1-of-3.jsonl:1: trial 1 has a different result elsewhere"));
}

// A busy machine may exceed the time limit, or the memory, where another one does not.
TEST_F(Results, ATimeoutYieldsToAResult) {
  fs::create_directories(folder_ / "shards");
  const std::string timed_out = test::replaced(line(1), "\"outcome\":\"success\"", "\"outcome\":\"timed_out\"");
  ASSERT_NE(timed_out, line(1));
  for (const bool first : {true, false}) {
    test::write_bytes(folder_ / "shards/0-of-1.jsonl", (first ? timed_out : line(1)) + "\n");
    test::write_bytes(folder_ / "shards/1-of-3.jsonl", (first ? line(1) : timed_out) + "\n");
    EXPECT_EQ(merged_lines(folder_, study_), (decltype(merged_lines(folder_, study_)){{1, line(1)}}));
  }
}

TEST_F(Results, OfAnotherStudyAreRefused) {
  ShardFile(folder_, study_, {0, 1}).add(0, line(0));
  Study other = study_;
  other.hash ^= 1;
  EXPECT_THAT(error_of([&] { ShardFile(folder_, other, {0, 1}); }), HasSubstr(":1: belongs to another study"));
  test::write_bytes(folder_ / "shards/0-of-1.jsonl", "what is this?\n");
  EXPECT_THAT(error_of([&] { ShardFile(folder_, study_, {0, 1}); }), HasSubstr(":1: is not a trial's result"));
}

TEST_F(Results, BelongToTheFilesThatTheSceneNames) {
  const auto current = [&] {
    Study study = read_study(study_.file);
    hash_files(study);
    return study;
  };
  const auto hash = [&] { return current().files_hash; };
  hash_files(study_);
  EXPECT_EQ(hash(), study_.files_hash);
  std::set<std::string> hashes = {study_.files_hash};
  const auto expect_another = [&] { EXPECT_TRUE(hashes.insert(hash()).second); };
  RigModel rig = test::thesis_rig_reduced(4);
  rig.projector_from_camera.translation.x() += 1e-3;
  test::write_bytes(temp_ / "rig.yaml", to_yaml(rig));
  expect_another();
  // They are not continued, but reported.
  ShardFile(folder_, study_, {0, 1}).add(0, line(0));
  const Study changed = current();
  EXPECT_THAT(error_of([&] {
                ShardFile(folder_, changed, {0, 1});
              }),
              HasSubstr("trial 0 was run before a file that the scene uses changed"));
  EXPECT_EQ(merged_lines(folder_, changed).size(), 1U);
  const std::string scene = test::read_bytes(study_.scene);
  test::write_bytes(study_.scene, "include: part.yaml\n" + scene);
  const std::string object = "  - {shape: mesh, file: mesh.obj, unit_m: 0.1, up: z}\n";
  test::write_bytes(temp_ / "part.yaml", "objects:\n" + object);
  expect_another();
  test::write_bytes(temp_ / "mesh.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
  expect_another();
  test::write_bytes(temp_ / "mesh.obj", "v 0 0 0\nv 2 0 0\nv 0 1 0\nf 1 2 3\n");
  expect_another();
  test::write_bytes(temp_ / "part.yaml", "objects:\n" + object + object);
  expect_another();
  // Files that a mesh refers to, here the color of its surface.
  const auto write_color = [&](const std::string& color) {
    test::write_bytes(temp_ / "colors.mtl", "newmtl paint\nKd " + color + "\n");
  };
  write_color("0.2 0.2 0.2");
  test::write_bytes(temp_ / "mesh.obj", "mtllib colors.mtl\nv 0 0 0\nv 2 0 0\nv 0 1 0\nusemtl paint\nf 1 2 3\n");
  expect_another();
  const std::string dark = hash();
  write_color("0.8 0.8 0.8");
  expect_another();
  write_color("0.2 0.2 0.2");
  EXPECT_EQ(hash(), dark);
}

// The first trial uses one of the meshes only.
TEST_F(Results, BelongToTheFilesOfAllTrials) {
  const auto write_mesh = [&](const std::string& name, const std::string& width) {
    test::write_bytes(temp_ / name, "v 0 0 0\nv " + width + " 0 0\nv 0 1 0\nf 1 2 3\n");
  };
  write_mesh("a.obj", "1");
  write_mesh("b.obj", "2");
  test::write_bytes(study_.scene, test::replaced(test::read_bytes(study_.scene), "objects:\n",
                                                 "objects:\n  - {shape: mesh, file: a.obj, unit_m: 0.1, up: z}\n"));
  const std::string counted = test::replaced(test::kSmallStudy, "objects.1.count", "objects.2.count");
  test::write_bytes(study_.file, test::replaced(counted, "decode.min_modulation_dn: {grid: [2, 4]}",
                                                "objects.0.file: {grid: [a.obj, b.obj]}"));
  const auto hash = [&] {
    Study study = read_study(study_.file);
    hash_files(study);
    return study.files_hash;
  };
  const std::string before = hash();
  write_mesh("b.obj", "3");
  EXPECT_NE(hash(), before);
}

TEST_F(Results, DamagedOnesAreRefused) {
  const auto error = [&](const std::string& text) {
    fs::create_directories(folder_ / "shards");
    test::write_bytes(folder_ / "shards/0-of-1.jsonl", line(0) + "\n" + text + "\n");
    return error_of([&] { merged_lines(folder_, study_); });
  };
  const nlohmann::json good = nlohmann::json::parse(line(1));
  ASSERT_EQ(error(good.dump()), "no Error was thrown");
  for (const char* change : {R"({"outcome": null})", R"({"outcome": 3})", R"({"cause": 3})", R"({"message": []})",
                             R"({"metrics": 3})", R"({"values": 3})", R"({"values": {"light.ambient_lux": 3}})",
                             R"({"values": {"light.ambient_lux": null}})", R"({"seed": []})", R"({"seed": true})",
                             R"({"metrics": {"translation_mm": [1]}})", R"({"metrics": {"translation_mm": false}})"}) {
    nlohmann::json damaged = good;
    damaged.merge_patch(nlohmann::json::parse(change));
    EXPECT_THAT(error(damaged.dump()), HasSubstr("0-of-1.jsonl:2: is a damaged result")) << change;
  }
  nlohmann::json beyond = good;
  beyond["trial"] = 4294967297;
  EXPECT_THAT(error(beyond.dump()), HasSubstr("there is no trial 4294967297"));
}

TEST_F(Results, MakeTheSameTablesEveryTime) {
  std::map<int, std::string> lines = {{0, line(0)}, {1, line(1, 0.25)}};
  TrialResult crash;
  crash.index = 2;
  crash.outcome = Outcome::crashed;
  crash.cause = "crashed";
  crash.message = "killed, \"they say\"";
  lines[2] = to_line(study_, trial_of(study_, 2), crash);
  fs::create_directories(folder_);
  write_tables(folder_, study_, lines);
  const std::string csv = read_bytes(folder_ / "results.csv"), sqlite = read_bytes(folder_ / "results.sqlite");
  const Trial third = trial_of(study_, 2);
  EXPECT_THAT(
      csv, HasSubstr("trial,seed,outcome,cause,message,light.ambient_lux,decode.min_modulation_dn,translation_mm\n"));
  EXPECT_THAT(csv,
              HasSubstr("2," + std::to_string(third.world_seed) + ",crashed,crashed,\"killed, \"\"they say\"\"\"," +
                        third.values[0] + "," + third.values[1] + ",\n"));
  EXPECT_TRUE(sqlite.starts_with("SQLite format 3"));
  write_tables(folder_, study_, lines);
  EXPECT_EQ(read_bytes(folder_ / "results.csv"), csv);
  EXPECT_EQ(read_bytes(folder_ / "results.sqlite"), sqlite);
}

TEST(Shards, AreSaidAsIOfN) {
  EXPECT_EQ(shard_of("2/8").index, 2);
  EXPECT_EQ(shard_of("2/8").count, 8);
  for (const char* wrong : {"", "8", "8/8", "-1/8", "1/0", "1/8x", "1 /8", "a/b"})
    EXPECT_THAT(error_of([&] { shard_of(wrong); }), HasSubstr("from 0/8 to 7/8")) << wrong;
}

}  // namespace
}  // namespace fringeslam::studies
