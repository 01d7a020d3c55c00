// SPDX-License-Identifier: Apache-2.0
// Serves one web page and its data. Only GET, HEAD and, if the page takes orders, POST are answered, with a body only if the
// page takes files. A POST must state the size of its body, which must not be compressed, chunked or a form.
// Requests are limited in size and time, and requests beyond a maximum number of concurrent ones are asked to retry
// (503). Everything but the page itself, which is read at /, requires the token, if there is one (access.h).
#pragma once

#include <atomic>
#include <charconv>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "tools/live/access.h"

namespace fringeslam::tools {

struct PageRequest {
  const std::string& path;
  bool is_post;  // an order; browsers name its origin, so that none from a foreign page is admitted
  const std::string& body;
  std::function<std::string(const std::string& name)> parameter;  // of the query; empty if absent
  // True once nobody waits for the answer: the viewer left or the server stops. May be called by other threads while the
  // request is answered.
  std::function<bool()> given_up;
};

// Parses an integer of a request; empty if there is anything else in the text.
template <class Number>
std::optional<Number> number_in(std::string_view text) {
  Number number = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  if (error != std::errc() || end != text.data() + text.size()) return std::nullopt;
  return number;
}

// A viewer's place among those who wait for the same, starting at 1.
struct Waiting {
  explicit Waiting(std::atomic<size_t>& all_waiting) : all(all_waiting), place(++all) {}
  ~Waiting() { --all; }
  Waiting(const Waiting&) = delete;
  Waiting& operator=(const Waiting&) = delete;
  std::atomic<size_t>& all;
  size_t place;
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

struct PageRules {
  bool posts = false;          // accept POST
  size_t most_body_bytes = 0;  // of a POST
  int nice = 15;               // niceness of the threads that receive and answer requests
  bool paced = true;           // delay connections that arrive faster than viewers need
};

class PageServer {
 public:
  static constexpr size_t kRequests = 24;  // of all kinds, answered concurrently
  // Called by several threads; an exception becomes status 500.
  using Answers = std::function<PageAnswer(const PageRequest&)>;

  // Serves until destroyed. `port_option` names the option of the port in messages. Throws Error if the port is
  // unavailable or the access is invalid.
  PageServer(LiveAccess access, std::string port_option, Answers answers, const PageRules& rules = {});
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
