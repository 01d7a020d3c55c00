// SPDX-License-Identifier: Apache-2.0
// Who may see the live page. On this computer alone, whoever can open it, but no foreign web page that a browser was
// talked into asking for it (DNS rebinding: the name in the Host header is then not that of this computer); beyond it,
// whoever knows the token.
#pragma once

#include <string>
#include <string_view>

namespace fringeslam::tools {

struct LiveAccess {
  std::string host = "127.0.0.1";  // address to listen at
  int port = 0;                    // 0: any that is free
  std::string token;               // asked for unless empty
};

// 127.0.0.0/8, ::1 or localhost.
bool is_loopback(std::string_view host);

// 128 random bits of the system, in hexadecimal digits.
std::string random_token();

// Fills in a token beyond loopback. Throws Error for a host that is no numeric address, or for a token that is short
// enough to be guessed or holds more than letters, digits, - and _.
LiveAccess checked(LiveAccess access);

// Takes the same time wherever they differ.
bool same_secret(std::string_view one, std::string_view other);

struct Caller {
  std::string host, origin, authorization;  // headers; empty where there is none
};

// 200, 403 (a foreign Host or Origin) or, where `secret`, 401 (no token, or a wrong one: Authorization: Bearer TOKEN).
int admission(const LiveAccess& access, const Caller& caller, bool secret);

}  // namespace fringeslam::tools
