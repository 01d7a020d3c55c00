// SPDX-License-Identifier: Apache-2.0
// Fuzz target (libFuzzer, run by tools/fuzz): arbitrary bytes sent to the server of the live page must be answered by HTTP or by
// closing the connection, and the server must go on serving.
#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <sys/time.h>

#include <array>
#include <csignal>

#include "tests/fuzz/fuzzing.h"
#include "tools/live/page_server.h"

namespace fringeslam::fuzz {

namespace {

tools::PageAnswer answer(const tools::PageRequest& request) {
  if (request.path == "/") return tools::PageAnswer::of("<p>page</p>", "text/html");
  if (request.path == "/changes") return tools::PageAnswer::of("{}" + request.parameter("since"), "application/json");
  if (request.is_post) return tools::PageAnswer::of(request.body, "application/json");
  return {};
}

const tools::PageServer& server() {
  static const tools::PageServer only({"127.0.0.1", 0, ""}, "--live-port", answer, {true, 2048, 0, false});
  return only;
}

// Sends a request and returns all that the server answers.
std::string exchanged(std::string_view request) {
  const int connection = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<uint16_t>(server().access().port));
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  require(connection >= 0 && connect(connection, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0,
          "the server accepts no connection");
  const timeval patience{8, 0};
  setsockopt(connection, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
  (void)send(connection, request.data(), request.size(), MSG_NOSIGNAL);
  shutdown(connection, SHUT_WR);
  std::string received;
  std::array<char, 4096> bytes;
  ssize_t count = 0;
  while ((count = recv(connection, bytes.data(), bytes.size(), 0)) > 0)
    received.append(bytes.data(), static_cast<size_t>(count));
  const bool late = count < 0 && (errno == EAGAIN || errno == EWOULDBLOCK);
  close(connection);
  require(!late, "no answer within 8 s");
  return received;
}

}  // namespace

}  // namespace fringeslam::fuzz

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace fringeslam::fuzz;
  static int requests = 0;
  const std::string received = exchanged(text_of(data, size));
  require(received.empty() || received.starts_with("HTTP/1."), "an answer that is not HTTP: " + received.substr(0, 40));
  if (++requests % 100 == 0) {
    const std::string page = exchanged("GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n");
    require(page.starts_with("HTTP/1.1 200") && page.ends_with("<p>page</p>"), "the page is no longer served: " + page);
  }
  return 0;
}
