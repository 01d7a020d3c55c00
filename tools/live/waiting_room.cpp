// SPDX-License-Identifier: Apache-2.0
#include "tools/live/waiting_room.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>

#include "core/types/error.h"
#include "tools/live/viewer_socket.h"

namespace fringeslam::tools {

namespace {

constexpr int kLongestPollMs = 250;  // the resolution of kPatience

std::string address_of_peer(int socket) {
  sockaddr_storage address{};
  socklen_t size = sizeof address;
  char text[INET6_ADDRSTRLEN] = "";
  if (getpeername(socket, reinterpret_cast<sockaddr*>(&address), &size) != 0) return "";
  if (address.ss_family == AF_INET)
    inet_ntop(AF_INET, &reinterpret_cast<sockaddr_in&>(address).sin_addr, text, sizeof text);
  if (address.ss_family == AF_INET6)
    inet_ntop(AF_INET6, &reinterpret_cast<sockaddr_in6&>(address).sin6_addr, text, sizeof text);
  return text;
}

}  // namespace

WaitingRoom::WaitingRoom(int nice, Arrived arrived)
    : nice_(nice), arrived_(std::move(arrived)), wake_(eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)) {
  if (wake_ < 0) throw Error("live: cannot watch connections; close other programs' files or raise their limit");
  thread_ = std::thread([this] { watch(); });
}

WaitingRoom::~WaitingRoom() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  wake();
  thread_.join();
  for (const Waiting& waiting : waiting_) close(waiting.socket);
  close(wake_);
}

void WaitingRoom::wake() const {
  const uint64_t one = 1;
  (void)!write(wake_, &one, sizeof one);
}

void WaitingRoom::add(int socket) {
  Waiting newest{socket, address_of_peer(socket), "", Clock::now() + kPatience};
  {
    const std::lock_guard lock(mutex_);
    const auto from_same = [&](const Waiting& other) { return other.peer == newest.peer; };
    const auto leave = [&](const auto& oldest) {
      close(oldest->socket);
      waiting_.erase(oldest);
    };
    if (std::count_if(waiting_.begin(), waiting_.end(), from_same) >= static_cast<std::ptrdiff_t>(kMostPerPeer))
      leave(std::find_if(waiting_.begin(), waiting_.end(), from_same));
    if (waiting_.size() >= kMost) leave(waiting_.begin());
    waiting_.push_back(std::move(newest));
  }
  wake();
}

WaitingRoom::State WaitingRoom::receive(Waiting& waiting) {
  std::array<char, 4096> bytes;
  for (;;) {
    const ssize_t count = recv(waiting.socket, bytes.data(), bytes.size(), MSG_DONTWAIT);
    if (count < 0 && errno == EINTR) continue;
    if (count < 0 && (errno == EAGAIN || errno == EWOULDBLOCK)) return State::waiting;
    if (count <= 0) return State::over;
    waiting.head.append(bytes.data(), static_cast<size_t>(count));
    if (waiting.head.find("\r\n\r\n") != std::string::npos) return State::arrived;
    if (waiting.head.size() > kMaxRequestBytes) return State::over;
  }
}

void WaitingRoom::watch() {
  if (nice_ != 0) setpriority(PRIO_PROCESS, 0, nice_);  // of this thread only
  std::vector<pollfd> descriptors;
  for (;;) {
    descriptors.assign(1, {wake_, POLLIN, 0});
    {
      const std::lock_guard lock(mutex_);
      if (stopping_) return;
      for (const Waiting& waiting : waiting_) descriptors.push_back({waiting.socket, POLLIN, 0});
    }
    (void)poll(descriptors.data(), descriptors.size(), descriptors.size() > 1 ? kLongestPollMs : -1);
    uint64_t woken = 0;
    (void)!read(wake_, &woken, sizeof woken);
    std::vector<Waiting> arrived;
    {
      const std::lock_guard lock(mutex_);
      const Clock::time_point now = Clock::now();
      std::erase_if(waiting_, [&](Waiting& waiting) {
        State state = receive(waiting);
        if (state == State::waiting && now >= waiting.until) state = State::over;
        if (state == State::over) close(waiting.socket);
        if (state == State::arrived) arrived.push_back(std::move(waiting));
        return state != State::waiting;
      });
    }
    for (Waiting& waiting : arrived) arrived_(waiting.socket, std::move(waiting.head));
  }
}

}  // namespace fringeslam::tools
