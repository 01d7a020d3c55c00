// SPDX-License-Identifier: Apache-2.0
#include "bench/datasets/tar.h"

#include <gmock/gmock.h>

#include "bench/datasets/sha256.h"
#include "tests/tools/child.h"

namespace fringeslam::datasets {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

// Examples of FIPS 180-4 and of an empty message.
TEST(Sha256, EqualsThePublishedExamples) {
  EXPECT_EQ(sha256_hex("abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
  EXPECT_EQ(sha256_hex(""), "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
  Sha256 parts;
  parts.add("abcdbcdecdefdefgefghfghighijhijk");
  parts.add("ijkljklmklmnlmnomnopnopq");
  EXPECT_EQ(parts.hex(), "248d6a61d20638b8e5c026930c3e6039a33ce45964ff2167f6ecedd419db06c1");
}

TEST(Tar, IsReadByTheSystemsTar) {
  const test::TempFolder temp;
  const std::string exact(kTarBlock, 'x'), odd = std::string("a\0b", 3), longest(100, 'n');
  const std::string archive = tar_member("000000001.json", "{}\n") + tar_member("000000001.odd", odd) +
                              tar_member("000000001.exact", exact) + tar_member(longest, "") +
                              std::string(kTarEnd, '\0');
  test::write_bytes(temp / "a.tar", archive);
  ASSERT_EQ(
      std::system(("cd '" + temp.path().string() + "' && tar xf a.tar && tar tvf a.tar > list 2> errors").c_str()), 0);
  EXPECT_EQ(test::read_bytes(temp / "errors"), "");
  EXPECT_EQ(test::read_bytes(temp / "000000001.json"), "{}\n");
  EXPECT_EQ(test::read_bytes(temp / "000000001.odd"), odd);
  EXPECT_EQ(test::read_bytes(temp / "000000001.exact"), exact);
  EXPECT_EQ(fs::file_size(temp / longest), 0u);
  const std::string list = test::read_bytes(temp / "list");
  EXPECT_EQ(std::count(list.begin(), list.end(), '\n'), 4);
  EXPECT_THAT(list, HasSubstr("-rw-r--r-- 0/0"));
  // Each member is whole blocks: header and content.
  EXPECT_EQ(archive.size(), (2 + 2 + 2 + 1 + 2) * kTarBlock);
}

TEST(Tar, RefusesWhatTheFormatCannotRepresent) {
  EXPECT_THAT(test::message_of([] { (void)tar_member(std::string(101, 'n'), ""); }), HasSubstr("100 bytes"));
}

}  // namespace
}  // namespace fringeslam::datasets
