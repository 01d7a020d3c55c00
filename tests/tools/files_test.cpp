// SPDX-License-Identifier: Apache-2.0
// Folders are written completely or not at all, and the same content gives the same bytes.
#include "core/io/files.h"

#include <fcntl.h>
#include <gmock/gmock.h>
#include <signal.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
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
    EXPECT_FALSE(exists(temp / "out"));
    EXPECT_FALSE(test::listing(temp.path()).empty());
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
  {
    StagedFolder staged(temp / "out", kKind);
    write_text(staged.path() / kFile, "old");
    test::write_bytes(staged.path() / "frames/0.png", "of the old result alone");
    staged.commit();
  }
  write_ours(temp / "out", "new");
  EXPECT_EQ(test::read_bytes(temp / "out/config.yaml"), "new");
  EXPECT_EQ(test::listing(temp.path()), (std::set<std::string>{"out", "out/.fringeslam", "out/config.yaml"}));
}

TEST(StagedFolder, KeepsFilesThatItDidNotWrite) {
  const test::TempFolder temp;
  write_ours(temp / "out", "old");
  test::write_bytes(temp / "out/notes.txt", "precious");
  test::write_bytes(temp / "out/frames/mine/photo.jpg", "precious too");
  test::write_bytes(temp / "out/report.html", "by the user");
  test::fs::create_symlink("/nowhere", temp / "out/link");
  for (const std::string content : {"new", "newer"}) {
    StagedFolder staged(temp / "out", kKind);
    write_text(staged.path() / kFile, content);
    write_text(staged.path() / "report.html", "by the program");
    staged.commit();
    EXPECT_EQ(test::read_bytes(temp / "out/config.yaml"), content);
    EXPECT_EQ(test::read_bytes(temp / "out/notes.txt"), "precious");
    EXPECT_EQ(test::read_bytes(temp / "out/frames/mine/photo.jpg"), "precious too");
    EXPECT_EQ(test::read_bytes(temp / "out/report.html"), "by the program");
    EXPECT_EQ(test::read_bytes(temp / "out/report.html.kept"), "by the user");
    EXPECT_EQ(test::fs::read_symlink(temp / "out/link"), "/nowhere");
  }
  EXPECT_EQ(test::listing(temp.path()),
            (std::set<std::string>{"out", "out/.fringeslam", "out/config.yaml", "out/frames", "out/frames/mine",
                                   "out/frames/mine/photo.jpg", "out/link", "out/notes.txt", "out/report.html",
                                   "out/report.html.kept"}));
}

TEST(StagedFolder, KeepsFoldersThatItDidNotWrite) {
  const test::TempFolder temp;
  {
    StagedFolder staged(temp / "out", kKind);
    test::write_bytes(staged.path() / "old/file", "old");
    staged.commit();
  }
  test::fs::create_directories(temp / "out/empty/inner");
  test::write_bytes(temp / "out/private/notes.txt", "precious");
  test::fs::permissions(temp / "out/private", test::fs::perms::owner_all);
  for (const std::string content : {"new", "newer"}) {
    write_ours(temp / "out", content);
    EXPECT_EQ(test::listing(temp / "out"), (std::set<std::string>{".fringeslam", "config.yaml", "empty", "empty/inner",
                                                                  "private", "private/notes.txt"}));
    EXPECT_EQ(test::fs::status(temp / "out/private").permissions(), test::fs::perms::owner_all);
  }
}

TEST(StagedFolder, APreservedFileSurvivesUntilItIsReplaced) {
  const test::TempFolder temp;
  const auto write = [&](const std::string& map) {
    StagedFolder staged(temp / "out", kKind, {"saved.map"});
    write_text(staged.path() / kFile, "run");
    if (!map.empty()) write_text(staged.path() / "saved.map", map);
    staged.commit();
    return test::read_bytes(temp / "out/saved.map");
  };
  EXPECT_EQ(write("first"), "first");
  EXPECT_EQ(write(""), "first");
  EXPECT_EQ(write(""), "first");
  EXPECT_EQ(write("second"), "second");
  EXPECT_EQ(test::listing(temp.path()).size(), 4u);
}

// Earlier versions did not list their files.
TEST(StagedFolder, KeepsLaterFilesOfAFolderWithoutAList) {
  const test::TempFolder temp;
  test::write_bytes(temp / "out/config.yaml", "old");
  test::write_bytes(temp / "out/frames/old.png", "old");
  test::write_bytes(temp / "out/.fringeslam", "run\n");
  std::this_thread::sleep_for(std::chrono::milliseconds(20));
  test::write_bytes(temp / "out/notes.txt", "precious");
  write_ours(temp / "out", "new");
  EXPECT_EQ(test::read_bytes(temp / "out/notes.txt"), "precious");
  EXPECT_EQ(test::listing(temp.path()),
            (std::set<std::string>{"out", "out/.fringeslam", "out/config.yaml", "out/notes.txt"}));
}

// Runs `action` in a process that then dies without cleaning up.
template <class Action>
void die_after(const Action& action) {
  const pid_t child = fork();
  ASSERT_GE(child, 0);
  if (child == 0) {
    action();
    kill(getpid(), SIGKILL);
  }
  int status = 0;
  waitpid(child, &status, 0);
  ASSERT_TRUE(WIFSIGNALED(status));
}

TEST(StagedFolder, RemovesTheLeftoversOfDeadProcesses) {
  const test::TempFolder temp;
  write_ours(temp / "out", "old");
  die_after([&] {
    auto* staged = new StagedFolder(temp / "out", kKind);
    write_text(staged->path() / "half", "a");
  });
  die_after([&] { write_text((new StagedFile(temp / "table.csv"))->path(), "half"); });
  EXPECT_EQ(test::read_bytes(temp / "out/config.yaml"), "old");
  EXPECT_GT(test::listing(temp.path()).size(), 3u);
  write_ours(temp / "other", "new");
  EXPECT_EQ(test::listing(temp.path()), (std::set<std::string>{"other", "other/.fringeslam", "other/config.yaml", "out",
                                                               "out/.fringeslam", "out/config.yaml"}));
}

TEST(StagedFolder, LeavesTheFoldersOfLivingProcessesAlone) {
  const test::TempFolder temp;
  int started[2], finish[2];
  ASSERT_EQ(pipe(started) + pipe(finish), 0);
  const pid_t child = fork();
  if (child == 0) {
    StagedFolder staged(temp / "out", kKind);
    write_text(staged.path() / kFile, "of the child");
    char byte = 0;
    (void)!write(started[1], &byte, 1);
    (void)!read(finish[0], &byte, 1);
    staged.commit();
    _exit(0);
  }
  char byte = 0;
  ASSERT_EQ(read(started[0], &byte, 1), 1);
  write_ours(temp / "out", "of the parent");
  write_ours(temp / "other", "of the parent");
  ASSERT_EQ(write(finish[1], &byte, 1), 1);
  int status = 0;
  waitpid(child, &status, 0);
  EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0);
  EXPECT_EQ(test::read_bytes(temp / "out/config.yaml"), "of the child");
}

// A user may choose such names.
TEST(StagedFolder, LeavesFoldersAloneThatOnlyLookLikeLeftovers) {
  const test::TempFolder temp;
  test::write_bytes(temp / "out.partial-backup/thesis.txt", "precious");
  write_ours(temp / "runs.partial-result", "precious");
  write_ours(temp / "out", "new");
  EXPECT_EQ(test::read_bytes(temp / "out.partial-backup/thesis.txt"), "precious");
  EXPECT_EQ(test::read_bytes(temp / "runs.partial-result/config.yaml"), "precious");
}

// A process may die between creating a temporary folder and marking it; its mode distinguishes it from the user's.
TEST(StagedFolder, RemovesAnEmptyFolderOnlyIfAProcessLeftIt) {
  const test::TempFolder temp;
  for (const std::string name : {"out.partial-backup", "x.partial-backup", "out.partial-a1B2c3"})
    test::fs::create_directory(temp / name);
  ASSERT_EQ(chmod((temp / "out.partial-a1B2c3").c_str(), 01700), 0);
  write_ours(temp / "out", "new");
  EXPECT_EQ(test::listing(temp.path()), (std::set<std::string>{"out", "out/.fringeslam", "out/config.yaml",
                                                               "out.partial-backup", "x.partial-backup"}));
}

// Only what the result wrote goes with it, by whatever name it is called.
TEST(StagedFolder, ListsTheFilesItReplaces) {
  const test::TempFolder temp;
  const test::fs::path out = temp / "out";
  EXPECT_FALSE(is_replaced_with(out / kFile, out));
  {
    StagedFolder staged(out, kKind);
    for (const std::string name : {"saved.map", "frames/0.png"}) test::write_bytes(staged.path() / name, "old");
    write_text(staged.path() / kFile, "old");
    staged.commit();
  }
  test::write_bytes(out / "mine/notes.txt", "precious");
  test::write_bytes(temp / "outside/config.yaml", "precious");
  test::fs::create_symlink(out / kFile, temp / "link");
  test::fs::create_directory_symlink(out, temp / "result");
  for (const test::fs::path& input : {out / kFile, out / "saved.map", out / "frames", out / "frames/../frames/0.png",
                                      temp / "link", temp / "result/frames", out})
    EXPECT_TRUE(is_replaced_with(input, out)) << input;
  EXPECT_TRUE(is_replaced_with(out / kFile, temp / "result/"));
  for (const test::fs::path& input : {out / "mine", out / "mine/notes.txt", out / "none", temp / "outside/config.yaml",
                                      temp.path(), test::fs::path()})
    EXPECT_FALSE(is_replaced_with(input, out)) << input;
  EXPECT_FALSE(is_replaced_with(out / "saved.map", out, {"saved.map"}));
}

TEST(StagedFolder, ADotAfterTheNameIsTheSameFolder) {
  const test::TempFolder temp;
  for (const std::string name : {"out/.", "out/./", "out//."}) {
    write_ours(temp / name, name);
    EXPECT_EQ(test::read_bytes(temp / "out/config.yaml"), name);
  }
}

TEST(StagedFolder, FollowsALinkToAFolder) {
  const test::TempFolder temp;
  test::fs::create_directory(temp / "disk");
  test::fs::create_directory_symlink(temp / "disk", temp / "out");
  write_ours(temp / "out", "new");
  EXPECT_TRUE(test::fs::is_symlink(temp / "out"));
  EXPECT_EQ(test::read_bytes(temp / "disk/config.yaml"), "new");
  test::fs::create_directory_symlink(temp / "nowhere", temp / "broken");
  const std::string broken = (temp / "broken").string();
  EXPECT_THAT(message_of([&] { StagedFolder(broken, kKind); }),
              StartsWith(broken + ": is a link to a folder that does"));
}

// Anything that would make the final renaming fail is refused before the work.
TEST(StagedFolder, RefusesTheCurrentFolderAndAMountPoint) {
  const test::TempFolder temp;
  const test::fs::path here = test::fs::current_path();
  test::fs::create_directory(temp / "empty");
  test::fs::current_path(temp / "empty");
  EXPECT_THAT(message_of([&] { StagedFolder(".", kKind); }), testing::HasSubstr("is the current folder"));
  test::fs::current_path(here);
  EXPECT_THAT(message_of([&] { StagedFolder("/proc", ""); }), StartsWith("/proc: "));
}

// A folder that appears in the target's place while the result is computed is not replaced.
TEST(StagedFolder, DoesNotReplaceAForeignFolderThatAppearsMeanwhile) {
  const test::TempFolder temp;
  std::string message;
  {
    StagedFolder staged(temp / "out", kKind);
    write_text(staged.path() / kFile, "hours of work");
    test::write_bytes(temp / "out/thesis.txt", "precious");
    message = message_of([&] { staged.commit(); });
  }
  EXPECT_THAT(message, testing::HasSubstr("exists and was not written by"));
  EXPECT_EQ(test::read_bytes(temp / "out/thesis.txt"), "precious");
  constexpr std::string_view kPlace = "the new result is complete in ";
  ASSERT_THAT(message, testing::HasSubstr(kPlace));
  const test::fs::path kept = message.substr(message.find(kPlace) + kPlace.size());
  EXPECT_EQ(test::read_bytes(kept / kFile), "hours of work");
  write_ours(temp / "other", "new");
  EXPECT_TRUE(exists(kept / kFile)) << "later processes leave it alone";
}

// A user's folder may have the name of a new file, and a user's file that of a new folder.
TEST(StagedFolder, KeepsWhatIsInTheWay) {
  const test::TempFolder temp;
  write_ours(temp / "out", "old");
  test::write_bytes(temp / "out/map.ply/a/notes.txt", "precious");
  test::write_bytes(temp / "out/map.ply/b.txt", "precious too");
  test::fs::create_directory(temp / "out/map.ply/empty");
  test::fs::permissions(temp / "out/map.ply", test::fs::perms::owner_all);
  test::write_bytes(temp / "out/frames", "by the user");
  for (const std::string content : {"new", "newer"}) {
    StagedFolder staged(temp / "out", kKind);
    write_text(staged.path() / kFile, content);
    write_text(staged.path() / "map.ply", content);
    test::write_bytes(staged.path() / "frames/0.png", content);
    staged.commit();
    EXPECT_EQ(test::listing(temp / "out"),
              (std::set<std::string>{".fringeslam", "config.yaml", "frames", "frames/0.png", "frames.kept", "map.ply",
                                     "map.ply.kept", "map.ply.kept/a", "map.ply.kept/a/notes.txt", "map.ply.kept/b.txt",
                                     "map.ply.kept/empty"}));
    EXPECT_EQ(test::fs::status(temp / "out/map.ply.kept").permissions(), test::fs::perms::owner_all);
    EXPECT_EQ(test::read_bytes(temp / "out/map.ply"), content);
    EXPECT_EQ(test::read_bytes(temp / "out/map.ply.kept/a/notes.txt"), "precious");
    EXPECT_EQ(test::read_bytes(temp / "out/frames.kept"), "by the user");
  }
}

TEST(Files, LinksToNothingAreNotReplaced) {
  const test::TempFolder temp;
  test::fs::create_symlink(temp / "none", temp / "link");
  EXPECT_THAT(message_of([&] { write_text(temp / "link", "a"); }), testing::HasSubstr("is a link to a file that does"));
  EXPECT_THAT(message_of([&] { StagedFile file(temp / "link"); }), testing::HasSubstr("is a link to a file that does"));
  EXPECT_EQ(test::fs::read_symlink(temp / "link"), temp / "none");
}

// A pipe is written like a file if a program reads it, and does not wait for one for ever.
TEST(Files, PipesAreWrittenIfTheyAreRead) {
  const test::TempFolder temp;
  const test::fs::path pipe = temp / "pipe";
  ASSERT_EQ(mkfifo(pipe.c_str(), 0600), 0);
  EXPECT_THAT(message_of([&] { write_text(pipe, "a"); }), testing::HasSubstr("is a pipe that no program reads"));
  const std::string content(300000, 'x');  // more than a pipe holds
  const int reading = open(pipe.c_str(), O_RDONLY | O_NONBLOCK);
  ASSERT_GE(reading, 0);
  std::string read;
  std::atomic<bool> written = false;
  std::thread reader([&] {
    std::string block(4096, '\0');
    for (;;) {
      const bool last = written;
      const ssize_t count = ::read(reading, block.data(), block.size());
      if (count > 0) read.append(block, 0, static_cast<size_t>(count));
      if (count <= 0 && last) break;
      if (count <= 0) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
  });
  EXPECT_NO_THROW(write_text(pipe, content));
  written = true;
  reader.join();
  close(reading);
  EXPECT_EQ(read, content);
}

TEST(Files, AreReplacedAsAWholeAndKeepTheirMode) {
  const test::TempFolder temp;
  const test::fs::path file = temp / "a.json", link = temp / "link";
  write_text(file, "old");
  test::fs::permissions(file, test::fs::perms(0640));
  test::fs::create_symlink(file, link);
  write_text(link, "new");
  EXPECT_TRUE(test::fs::is_symlink(link));
  EXPECT_EQ(test::read_bytes(file), "new");
  EXPECT_EQ(test::fs::status(file).permissions(), test::fs::perms(0640));
  EXPECT_EQ(std::distance(test::fs::directory_iterator(temp.path()), test::fs::directory_iterator()), 2);
  EXPECT_NO_THROW(write_text("/dev/null", "gone"));
  EXPECT_THAT(message_of([] { write_text("/dev/full", "a"); }), StartsWith("/dev/full: cannot be written: No space"));
}

TEST(StagedFolder, SaysThatANameIsTooLong) {
  const test::TempFolder temp;
  EXPECT_THAT(message_of([&] { StagedFolder folder(temp / std::string(250, 'a'), kKind); }),
              testing::HasSubstr("the name is too long"));
}

TEST(Files, DevicesAndPipesAreNotReplaced) {
  const test::TempFolder temp;
  ASSERT_EQ(mkfifo((temp / "pipe").c_str(), 0600), 0);
  EXPECT_THAT(message_of([&] { StagedFile file(temp / "pipe"); }), testing::HasSubstr("is a device or a pipe"));
  EXPECT_TRUE(test::fs::is_fifo(temp / "pipe"));
}

// For files that no user names, such as those of the cache: writing to a pipe would wait for its reader.
TEST(Files, ThatNobodyNamesReplaceDevicesAndPipes) {
  const test::TempFolder temp;
  const test::fs::path pipe = temp / "pipe", link = temp / "link";
  ASSERT_EQ(mkfifo(pipe.c_str(), 0600), 0);
  test::write_bytes(temp / "else/where", "precious");
  test::fs::create_symlink(temp / "else/where", link);
  for (const test::fs::path& file : {pipe, link, temp / "new", temp / "new"}) {
    write_regular_file(file, "content");
    EXPECT_EQ(test::fs::symlink_status(file).type(), test::fs::file_type::regular) << file;
    EXPECT_EQ(test::read_bytes(file), "content");
  }
  EXPECT_EQ(test::read_bytes(temp / "else/where"), "precious");
  EXPECT_EQ(test::listing(temp.path()), (std::set<std::string>{"else", "else/where", "link", "new", "pipe"}));
  EXPECT_THROW(write_regular_file(temp / "else", "content"), Error);
}

TEST(Files, MessagesNameTheFinalFiles) {
  EXPECT_EQ(with_final_names("/a/out.partial-aB3dE6/out/map.ply: full"), "/a/out/map.ply: full");
  EXPECT_EQ(with_final_names("my out.partial-aB3dE6/my out/map.ply: full"), "my out/map.ply: full");
  EXPECT_EQ(with_final_names("in out.partial-aB3dE6/out: x, b.obj.partial-000000/b.mtl: y"), "in out: x, b.mtl: y");
  EXPECT_EQ(with_final_names("out.partial-aB3dE6: x"), "out: x");
  EXPECT_EQ(with_final_names("out.partial-aB3: the user's"), "out.partial-aB3: the user's");
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

TEST(Files, BesideAnotherAreReplacedOnlyIfTheyBelongToIt) {
  const test::TempFolder temp;
  const auto write = [&](const std::string& text, const std::set<std::string>& replaceable) {
    StagedFile staged(temp / "b.obj");
    for (const std::string name : {"b.obj", "b.mtl", "b.png"}) write_text(staged.path().parent_path() / name, text);
    EXPECT_EQ(staged.companions(), (std::vector<std::string>{"b.mtl", "b.png"}));
    staged.commit(replaceable);
  };
  test::write_bytes(temp / "b.png", "precious");
  EXPECT_THAT(message_of([&] { write("new", {"b.mtl"}); }),
              StartsWith((temp / "b.png").string() + ": exists and was not written with b.obj"));
  EXPECT_EQ(test::read_bytes(temp / "b.png"), "precious");
  EXPECT_EQ(test::listing(temp.path()), std::set<std::string>{"b.png"});
  write("new", {"b.png"});
  for (const std::string name : {"b.obj", "b.mtl", "b.png"}) EXPECT_EQ(test::read_bytes(temp / name), "new");
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
