// SPDX-License-Identifier: Apache-2.0
#include "tools/live/access.h"

#include <arpa/inet.h>
#include <sys/random.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cstdint>

#include "core/types/error.h"

namespace fringeslam::tools {

namespace {

constexpr size_t kShortestToken = 16;

bool is_address(const std::string& host) {
  std::array<uint8_t, sizeof(in6_addr)> parsed;
  return inet_pton(AF_INET, host.c_str(), parsed.data()) == 1 || inet_pton(AF_INET6, host.c_str(), parsed.data()) == 1;
}

// Returns the host of "name:port", "[::1]:port" or either without a port.
std::string_view name_of(std::string_view authority) {
  if (authority.starts_with('[')) {
    const size_t end = authority.find(']');
    return end == std::string_view::npos ? std::string_view() : authority.substr(1, end - 1);
  }
  return authority.substr(0, authority.find(':'));
}

bool may_be_token(const std::string& text) {
  return std::all_of(text.begin(), text.end(), [](unsigned char c) { return std::isalnum(c) || c == '-' || c == '_'; });
}

}  // namespace

bool is_loopback(std::string_view host) {
  if (host == "localhost" || host == "::1") return true;
  in_addr address{};
  return inet_pton(AF_INET, std::string(host).c_str(), &address) == 1 && ntohl(address.s_addr) >> 24 == 127;
}

std::string random_token() {
  std::array<uint8_t, 16> bits;
  if (getrandom(bits.data(), bits.size(), 0) != static_cast<ssize_t>(bits.size()))
    throw Error("live: the system has no random numbers for a token; set one with --live-token");
  std::string token;
  for (const uint8_t byte : bits) {
    token += "0123456789abcdef"[byte >> 4];
    token += "0123456789abcdef"[byte & 15];
  }
  return token;
}

LiveAccess checked(LiveAccess access) {
  if (access.host != "localhost" && !is_address(access.host))
    throw Error("--live-host " + access.host + ": not an address; give one of this computer, 0.0.0.0 for all of them");
  if (!access.token.empty() && (access.token.size() < kShortestToken || !may_be_token(access.token)))
    throw Error("--live-token: must be at least " + std::to_string(kShortestToken) +
                " letters, digits, - or _; without it a random one is used");
  if (access.token.empty() && !is_loopback(access.host)) access.token = random_token();
  return access;
}

bool same_secret(std::string_view one, std::string_view other) {
  unsigned different = one.size() == other.size() ? 0 : 1;
  for (size_t i = 0; i < other.size(); ++i)
    different |= static_cast<unsigned char>(other[i]) ^ static_cast<unsigned char>(i < one.size() ? one[i] : '\0');
  return different == 0;
}

int admission(const LiveAccess& access, const Caller& caller, bool secret) {
  if (is_loopback(access.host) && !is_loopback(name_of(caller.host))) return 403;
  if (!caller.origin.empty() && caller.origin != "http://" + caller.host) return 403;
  if (secret && !access.token.empty() && !same_secret(caller.authorization, "Bearer " + access.token)) return 401;
  return 200;
}

}  // namespace fringeslam::tools
