// SPDX-License-Identifier: Apache-2.0
// A viewer's connection: one request and its answer, both limited in time. httplib alone limits the length of header
// lines, but neither their number nor the time taken by a viewer who sends or reads very slowly.
#pragma once

#include <sys/types.h>

#include <atomic>
#include <chrono>
#include <cstddef>
#include <optional>
#include <string>
#include <utility>

namespace fringeslam::tools {

inline constexpr size_t kMaxRequestBytes = 16384;
inline constexpr auto kRequestPatience = std::chrono::seconds(5), kAnswerPatience = std::chrono::seconds(20),
                      kBodyPatience = std::chrono::seconds(60);

class ViewerSocket {
 public:
  // `head` are the bytes that were received already. All waits end once `stopping` is set.
  ViewerSocket(int socket, std::string head, const std::atomic<bool>& stopping,
               std::chrono::milliseconds request_patience)
      : socket_(socket),
        stopping_(stopping),
        request_by_(Clock::now() + request_patience),
        received_bytes_(std::move(head)),
        received_(received_bytes_.size()) {}

  // Permits a body of this size after the head, for which the viewer has some time more.
  void expect_body(size_t bytes);

  bool readable() const;
  bool writable() const;
  bool gone() const;  // the viewer closed the connection
  ssize_t read(char* target, size_t size);
  ssize_t write(const char* data, size_t size);
  int socket() const { return socket_; }

 private:
  using Clock = std::chrono::steady_clock;
  bool ready(short events, Clock::time_point until) const;

  int socket_;
  const std::atomic<bool>& stopping_;
  Clock::time_point request_by_;
  size_t most_bytes_ = kMaxRequestBytes;
  std::optional<Clock::time_point> answer_by_;  // counted from the answer's first byte: preparing it may take long
  std::string received_bytes_;                  // not read yet, from begin_
  size_t begin_ = 0, received_ = 0;
};

}  // namespace fringeslam::tools
