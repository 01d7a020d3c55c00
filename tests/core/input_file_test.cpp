// SPDX-License-Identifier: Apache-2.0
#include "core/io/input_file.h"

#include <gmock/gmock.h>
#include <sys/stat.h>

#include <filesystem>

#include "core/io/files.h"
#include "tests/support/matchers.h"
#include "tests/support/temp_folder.h"

namespace fringeslam {
namespace {

namespace fs = std::filesystem;

using support::error_of;
using test::TempFolder;
using testing::HasSubstr;

TEST(InputFile, LinksTakeNoSpaceWithinAFileSystem) {
  const TempFolder folder;
  fs::create_directories(folder / "from/inner");
  write_text(folder / "from/a", "one");
  write_text(folder / "from/inner/b", "two");
  fs::create_symlink(folder / "from/a", folder / "from/link");
  link_input_folder(folder / "from", folder / "to");
  for (const char* name : {"a", "inner/b"}) EXPECT_TRUE(fs::equivalent(folder / "from" / name, folder / "to" / name));
  // The file, not its name: the link may lead out of the folder.
  EXPECT_TRUE(fs::is_regular_file(fs::symlink_status(folder / "to/link")));
  EXPECT_EQ(read_input(folder / "to/link"), "one");
  // Files are replaced, not changed: the other name keeps its content.
  write_text(folder / "to/a", "three");
  EXPECT_EQ(read_input(folder / "from/a"), "one");
}

TEST(InputFile, LinksToAnotherFileSystemAreCopies) {
  const TempFolder folder;
  struct stat here = {}, other = {};
  if (::stat(folder.path().c_str(), &here) != 0 || ::stat("/dev/shm", &other) != 0 || here.st_dev == other.st_dev)
    GTEST_SKIP() << "needs a second file system at /dev/shm";
  write_text(folder / "a", std::string(3'000'000, 'x'));
  const fs::path to = "/dev/shm/" + folder.path().filename().string();
  link_input(folder / "a", to);
  EXPECT_EQ(read_bytes(to), read_bytes(folder / "a"));
  fs::remove(to);
}

TEST(InputFile, OnlyRegularFilesOfBoundedSizeAreLinked) {
  const TempFolder folder;
  ASSERT_EQ(::mkfifo((folder / "pipe").c_str(), 0600), 0);
  write_text(folder / "large", std::string(1000, 'x'));
  EXPECT_THAT(error_of([&] { link_input(folder / "pipe", folder / "to"); }), HasSubstr("is not a regular file"));
  EXPECT_THAT(error_of([&] { link_input(folder / "large", folder / "to", 999); }), HasSubstr("large: "));
  EXPECT_THAT(error_of([&] { link_input(folder / "none", folder / "to"); }), HasSubstr("none: "));
  EXPECT_FALSE(fs::exists(folder / "to"));
}

}  // namespace
}  // namespace fringeslam
