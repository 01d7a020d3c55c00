// SPDX-License-Identifier: Apache-2.0
// Access control of the live page.
#include "tools/live/access.h"

#include <gmock/gmock.h>

#include <set>

#include "tests/support/matchers.h"

namespace fringeslam {
namespace {

using support::error_of;
using testing::HasSubstr;
using testing::MatchesRegex;
using tools::admission;
using tools::LiveAccess;

constexpr const char* kToken = "correct-horse-battery";

TEST(LiveAccess, ThisComputerIsKnownByItsAddresses) {
  for (const char* host : {"127.0.0.1", "127.1.2.3", "::1", "localhost"}) EXPECT_TRUE(tools::is_loopback(host)) << host;
  for (const char* host :
       {"0.0.0.0", "::", "10.0.0.1", "128.0.0.1", "127.0.0.1.evil.com", "localhost.evil.com", "", "1"})
    EXPECT_FALSE(tools::is_loopback(host)) << host;
}

// DNS rebinding: a foreign name that resolves to this computer.
TEST(LiveAccess, OnThisComputerOnlyItsOwnNamesAreAnswered) {
  const LiveAccess access{"127.0.0.1", 8080, ""};
  for (const char* host : {"127.0.0.1:8080", "127.0.0.1", "localhost:9000", "[::1]:8080"})
    EXPECT_EQ(admission(access, {host, "", ""}, true), 200) << host;
  for (const char* host : {"evil.com", "evil.com:8080", "127.0.0.1.evil.com:8080", "", "[::1", "evil.com#127.0.0.1"})
    EXPECT_EQ(admission(access, {host, "", ""}, true), 403) << host;
}

TEST(LiveAccess, OtherPagesAreNotAnswered) {
  const LiveAccess access{"127.0.0.1", 8080, ""};
  EXPECT_EQ(admission(access, {"127.0.0.1:8080", "http://127.0.0.1:8080", ""}, true), 200);
  for (const char* origin :
       {"http://evil.com", "null", "http://127.0.0.1:8081", "https://127.0.0.1:8080", "http://localhost:8080"})
    EXPECT_EQ(admission(access, {"127.0.0.1:8080", origin, ""}, true), 403) << origin;
}

TEST(LiveAccess, BeyondItTheTokenCounts) {
  const LiveAccess access{"0.0.0.0", 8080, kToken};
  const std::string right = std::string("Bearer ") + kToken;
  EXPECT_EQ(admission(access, {"robot:8080", "", right}, true), 200);
  EXPECT_EQ(admission(access, {"robot:8080", "", ""}, false), 200);  // the page itself asks for the token
  for (const std::string& wrong :
       std::vector<std::string>{"", "Bearer ", kToken, right + "x", right.substr(0, right.size() - 1), "bearer",
                                "Bearer correct-horse-batterz"})
    EXPECT_EQ(admission(access, {"robot:8080", "", wrong}, true), 401) << wrong;
}

TEST(LiveAccess, SecretsAreComparedWhole) {
  EXPECT_TRUE(tools::same_secret("", ""));
  EXPECT_TRUE(tools::same_secret("abc", "abc"));
  for (const char* other : {"", "ab", "abcd", "abd", "Abc"}) EXPECT_FALSE(tools::same_secret("abc", other)) << other;
  EXPECT_FALSE(tools::same_secret(std::string_view("a\0", 2), "a"));
}

TEST(LiveAccess, ATokenIsMadeUpBeyondThisComputerAlone) {
  EXPECT_EQ(tools::checked({"127.0.0.1", 0, ""}).token, "");
  std::set<std::string> tokens;
  for (int i = 0; i < 20; ++i) tokens.insert(tools::checked({"0.0.0.0", 0, ""}).token);
  EXPECT_EQ(tokens.size(), 20u);
  for (const std::string& token : tokens) EXPECT_THAT(token, MatchesRegex("[0-9a-f]+")) << token;
  EXPECT_EQ(tokens.begin()->size(), 32u);
  EXPECT_EQ(tools::checked({"0.0.0.0", 0, kToken}).token, kToken);
  EXPECT_EQ(tools::checked({"127.0.0.1", 0, kToken}).token, kToken);
}

TEST(LiveAccess, InvalidAddressesAndTokensAreRefused) {
  for (const char* host : {"robot", "", "127.0.0", "http://127.0.0.1", "0.0.0.0:80"})
    EXPECT_THAT(error_of([&] { tools::checked({host, 0, ""}); }), HasSubstr("--live-host")) << host;
  for (const char* token : {"short", "with spaces in it at all", "fifteen-letters", "line\nends are not allowed"})
    EXPECT_THAT(error_of([&] { tools::checked({"0.0.0.0", 0, token}); }), HasSubstr("--live-token")) << token;
}

}  // namespace
}  // namespace fringeslam
