// SPDX-License-Identifier: Apache-2.0
#include "tools/live/viewer_socket.h"

#include <poll.h>
#include <sys/socket.h>

#include <algorithm>

namespace fringeslam::tools {

void ViewerSocket::expect_body(size_t bytes) {
  most_bytes_ += bytes;
  request_by_ += kBodyPatience;
}

bool ViewerSocket::readable() const { return begin_ < received_bytes_.size() || ready(POLLIN, request_by_); }

bool ViewerSocket::writable() const { return ready(POLLOUT, answer_by_.value_or(Clock::time_point::max())); }

bool ViewerSocket::gone() const {
  pollfd descriptor{socket_, POLLRDHUP, 0};
  return poll(&descriptor, 1, 0) > 0;
}

ssize_t ViewerSocket::read(char* target, size_t size) {
  if (begin_ == received_bytes_.size()) {
    if (received_ >= most_bytes_ || !ready(POLLIN, request_by_)) return -1;
    const size_t part = most_bytes_ > kMaxRequestBytes ? 65536 : 2048;
    received_bytes_.resize(std::min(part, most_bytes_ - received_));
    const ssize_t got = recv(socket_, received_bytes_.data(), received_bytes_.size(), 0);
    begin_ = 0;
    received_bytes_.resize(static_cast<size_t>(std::max<ssize_t>(got, 0)));
    if (got <= 0) return got;
    received_ += received_bytes_.size();
  }
  const size_t count = std::min(size, received_bytes_.size() - begin_);
  std::copy_n(received_bytes_.data() + begin_, count, target);
  begin_ += count;
  return static_cast<ssize_t>(count);
}

ssize_t ViewerSocket::write(const char* data, size_t size) {
  if (!answer_by_) answer_by_ = Clock::now() + kAnswerPatience;
  if (!ready(POLLOUT, *answer_by_)) return -1;
  return send(socket_, data, size, MSG_NOSIGNAL | MSG_DONTWAIT);
}

// Polls in short waits, so that none outlives the page.
bool ViewerSocket::ready(short events, Clock::time_point until) const {
  while (!stopping_) {
    pollfd descriptor{socket_, events, 0};
    if (poll(&descriptor, 1, 20) > 0) return true;
    if (Clock::now() >= until) break;
  }
  return false;
}

}  // namespace fringeslam::tools
