// SPDX-License-Identifier: Apache-2.0
// Access control of the live page. On the loopback interface everyone may open it, except foreign web pages that a
// browser was tricked into requesting it for (DNS rebinding: the Host header then does not name this computer). On any
// other interface a viewer needs the token.
#pragma once

#include <string>
#include <string_view>

namespace fringeslam::tools {

struct LiveAccess {
  std::string host = "127.0.0.1";  // address to listen on
  int port = 0;                    // 0: any free port
  std::string token;               // required unless empty
};

// True for 127.0.0.0/8, ::1 and localhost.
bool is_loopback(std::string_view host);

// Returns 128 random bits from the system as hexadecimal digits.
std::string random_token();

// Adds a random token if the host is not loopback. Throws Error if the host is not a numeric address, or if the token
// is short enough to guess or contains anything but letters, digits, - and _.
LiveAccess checked(LiveAccess access);

// Compares in constant time.
bool same_secret(std::string_view one, std::string_view other);

struct Caller {
  std::string host, origin, authorization;  // headers; empty if absent
};

// Returns 200, 403 (foreign Host or Origin) or, if `secret`, 401 (no or wrong token in Authorization: Bearer TOKEN).
int admission(const LiveAccess& access, const Caller& caller, bool secret);

}  // namespace fringeslam::tools
