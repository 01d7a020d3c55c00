// SPDX-License-Identifier: Apache-2.0
#include "tools/live/viewer_socket.h"

#include <poll.h>
#include <sys/socket.h>

#include <algorithm>

namespace fringeslam::tools {

bool ViewerSocket::readable() const { return begin_ < end_ || ready(POLLIN, request_by_); }

bool ViewerSocket::writable() const { return ready(POLLOUT, answer_by_.value_or(Clock::time_point::max())); }

bool ViewerSocket::gone() const {
  pollfd descriptor{socket_, POLLRDHUP, 0};
  return poll(&descriptor, 1, 0) > 0;
}

ssize_t ViewerSocket::read(char* target, size_t size) {
  if (begin_ == end_) {
    if (received_ >= kMaxRequestBytes || !ready(POLLIN, request_by_)) return -1;
    const ssize_t got = recv(socket_, buffer_.data(), std::min(buffer_.size(), kMaxRequestBytes - received_), 0);
    if (got <= 0) return got;
    begin_ = 0;
    end_ = static_cast<size_t>(got);
    received_ += end_;
  }
  const size_t count = std::min(size, end_ - begin_);
  std::copy_n(buffer_.data() + begin_, count, target);
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
