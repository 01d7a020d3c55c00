// SPDX-License-Identifier: Apache-2.0
// Serves one web page and its data. Only GET and HEAD are answered. Requests are limited in size and time, and requests
// beyond a maximum number of concurrent ones are asked to retry (503). Everything but the page itself, which is at /,
// requires the token, if there is one (access.h). The threads run at a lower priority than the program's other threads.
#pragma once

#include <functional>
#include <memory>
#include <string>

#include "tools/live/access.h"

namespace fringeslam::tools {

struct PageRequest {
  const std::string& path;
  std::function<std::string(const std::string& name)> parameter;  // of the query; empty if absent
  std::function<bool()> given_up;  // true once nobody waits for the answer: the viewer left or the server stops
};

struct PageAnswer {
  int status = 404;
  std::string body;  // sent with status 200
  std::string type = {};

  // 404 if the body is empty.
  static PageAnswer of(std::string body, std::string type) {
    const int status = body.empty() ? 404 : 200;
    return {status, std::move(body), std::move(type)};
  }
};

class PageServer {
 public:
  static constexpr size_t kRequests = 24;  // of all kinds, answered concurrently
  // Called by several threads; an exception becomes status 500.
  using Answers = std::function<PageAnswer(const PageRequest&)>;

  // Serves until destroyed. `port_option` names the option of the port in messages. Throws Error if the port is
  // unavailable or the access is invalid.
  PageServer(LiveAccess access, std::string port_option, Answers answers);
  ~PageServer();
  PageServer(const PageServer&) = delete;
  PageServer& operator=(const PageServer&) = delete;

  // Returns http://127.0.0.1:8080/, with the token if there is one; beyond loopback it uses this computer's host name.
  std::string url() const;
  const LiveAccess& access() const;  // with the actual port

 private:
  class Server;
  std::unique_ptr<Server> server_;
};

}  // namespace fringeslam::tools
