// SPDX-License-Identifier: Apache-2.0
// Folders are written completely or not at all, and the same content gives the same bytes.
#include "core/io/files.h"

#include <gmock/gmock.h>

#include <chrono>
#include <opencv2/core.hpp>
#include <thread>

#include "tests/support/temp_folder.h"

namespace fringeslam {
namespace {

using test::message_of;
using test::fs::exists;
using testing::StartsWith;

constexpr const char* kKind = "run";
constexpr const char* kFile = "config.yaml";

// Writes a folder as a run does.
void write_ours(const test::fs::path& folder, const std::string& content) {
  StagedFolder staged(folder, kKind);
  write_text(staged.path() / kFile, content);
  staged.commit();
}

TEST(StagedFolder, AppearsWholeOnCommit) {
  const test::TempFolder temp;
  const test::fs::path target = temp / "deep/er/out";
  StagedFolder staged(target, kKind);
  write_text(staged.path() / kFile, "a");
  EXPECT_FALSE(exists(target));
  staged.commit();
  EXPECT_EQ(test::read_bytes(target / kFile), "a");
  EXPECT_EQ(test::listing(temp / "deep/er"), (std::set<std::string>{"out", "out/.fringeslam", "out/config.yaml"}));
}

TEST(StagedFolder, LeavesNothingBehindWithoutCommit) {
  const test::TempFolder temp;
  {
    const StagedFolder staged(temp / "out", kKind);
    write_text(staged.path() / "half", "a");
    EXPECT_EQ(test::listing(temp.path()).size(), 2u);
  }
  EXPECT_EQ(test::listing(temp.path()), std::set<std::string>{});
}

TEST(StagedFolder, KeepsTheOldResultUntilCommit) {
  const test::TempFolder temp;
  write_ours(temp / "out", "old");
  {
    const StagedFolder staged(temp / "out", kKind);
    write_text(staged.path() / kFile, "new");
  }
  EXPECT_EQ(test::read_bytes(temp / "out/config.yaml"), "old");
}

TEST(StagedFolder, ReplacesOurs) {
  const test::TempFolder temp;
  write_ours(temp / "out", "old");
  write_text(temp / "out/left over", "old");
  write_ours(temp / "out", "new");
  EXPECT_EQ(test::read_bytes(temp / "out/config.yaml"), "new");
  EXPECT_EQ(test::listing(temp.path()), (std::set<std::string>{"out", "out/.fringeslam", "out/config.yaml"}));
}

TEST(StagedFolder, FillsAnEmptyFolder) {
  const test::TempFolder temp;
  test::fs::create_directory(temp / "out");
  write_ours(temp / "out", "new");
  EXPECT_EQ(test::read_bytes(temp / "out/config.yaml"), "new");
}

TEST(StagedFolder, ATrailingSlashIsTheSameFolder) {
  const test::TempFolder temp;
  write_ours(temp / "out/", "new");
  EXPECT_EQ(test::listing(temp.path()), (std::set<std::string>{"out", "out/.fringeslam", "out/config.yaml"}));
}

TEST(StagedFolder, RefusesAFolderThatIsNotOurs) {
  const test::TempFolder temp;
  test::write_bytes(temp / "out/thesis.txt", "precious");
  const std::string out = (temp / "out").string();
  EXPECT_THAT(message_of([&] { StagedFolder(out, kKind); }), StartsWith(out + ": exists and was not written by"));
  EXPECT_EQ(test::read_bytes(temp / "out/thesis.txt"), "precious");
  EXPECT_EQ(test::listing(temp.path()), (std::set<std::string>{"out", "out/thesis.txt"}));
}

TEST(StagedFolder, RefusesAFolderOfOursOfAnotherKind) {
  const test::TempFolder temp;
  write_ours(temp / "out", "a run");
  const std::string out = (temp / "out").string();
  EXPECT_THAT(message_of([&] { StagedFolder(out, "dataset"); }), StartsWith(out + ": exists and was not written by"));
  EXPECT_EQ(test::read_bytes(temp / "out/config.yaml"), "a run");
}

TEST(StagedFolder, RefusesAFile) {
  const test::TempFolder temp;
  test::write_bytes(temp / "out", "precious");
  const std::string out = (temp / "out").string();
  EXPECT_THAT(message_of([&] { StagedFolder(out, kKind); }), StartsWith(out + ": "));
  EXPECT_EQ(test::listing(temp.path()), std::set<std::string>{"out"});
}

// Users keep copies of results under such names.
TEST(StagedFolder, LeavesNeighboursAlone) {
  const test::TempFolder temp;
  write_ours(temp / "out", "first");
  test::write_bytes(temp / "out.old/thesis.txt", "precious");
  write_ours(temp / "out", "second");
  EXPECT_TRUE(exists(temp / "out.old/thesis.txt")) << "the user's folder out.old was removed";
  EXPECT_EQ(test::read_bytes(temp / "out/config.yaml"), "second");
}

TEST(StagedFolder, SaysWhereItCannotBeMade) {
  const test::TempFolder temp;
  test::write_bytes(temp / "file", "");
  const std::string out = (temp / "file/out").string();
  EXPECT_THAT(message_of([&] { StagedFolder(out, kKind); }), StartsWith(out));
}

TEST(Files, SayWhatCannotBeWritten) {
  const test::TempFolder temp;
  const std::string file = (temp / "none/a").string();
  EXPECT_THAT(message_of([&] { write_text(file, "a"); }), StartsWith(file + ": cannot be written"));
  const cv::Mat1b image(4, 4, uchar{1});
  EXPECT_THAT(message_of([&] { write_png(file + ".png", image); }), StartsWith(file + ".png: cannot be written"));
  const std::string exr = file + ".exr";
  EXPECT_THAT(message_of([&] { write_exr(exr, {{"Y", cv::Mat1f(4, 4, 1.f)}}); }), StartsWith(exr + ": cannot be"));
}

TEST(Files, ThatCannotBePutInPlaceLeaveNothingBehind) {
  const test::TempFolder temp;
  test::fs::create_directory(temp / "a.png");
  const std::string file = (temp / "a.png").string();
  EXPECT_THAT(message_of([&] { write_png(file, cv::Mat1b(4, 4, uchar{1})); }),
              StartsWith(file + ": cannot be written"));
  EXPECT_EQ(test::listing(temp.path()), std::set<std::string>{"a.png"});
  {
    StagedFile staged(temp / "b.obj");
    write_text(staged.path(), "o");
    write_text(staged.path().parent_path() / "b.mtl", "m");
  }
  EXPECT_EQ(test::listing(temp.path()), std::set<std::string>{"a.png"});
  StagedFile staged(temp / "b.obj");
  write_text(staged.path(), "o");
  write_text(staged.path().parent_path() / "b.mtl", "m");
  staged.commit();
  EXPECT_EQ(test::read_bytes(temp / "b.obj"), "o");
  EXPECT_EQ(test::read_bytes(temp / "b.mtl"), "m");
}

// File formats that store the time of writing would make equal results differ.
TEST(Files, SameContentGivesTheSameBytesLater) {
  const test::TempFolder temp;
  const cv::Mat1f image(40, 30, 0.5f);
  const cv::Mat1b grey(40, 30, uchar{7});
  for (const std::string name : {"a", "b"}) {
    write_exr(temp / (name + ".exr"), {{"depth_m", image}, {"sigma_m", image}});
    write_png(temp / (name + ".png"), grey);
    std::this_thread::sleep_for(std::chrono::milliseconds(1100));
  }
  EXPECT_TRUE(test::read_bytes(temp / "a.png") == test::read_bytes(temp / "b.png")) << "PNG";
  EXPECT_TRUE(test::read_bytes(temp / "a.exr") == test::read_bytes(temp / "b.exr")) << "EXR";
}

}  // namespace
}  // namespace fringeslam
