// SPDX-License-Identifier: Apache-2.0
// Connections whose requests have not arrived completely. One thread watches all of them, so that clients who send slowly
// or nothing keep nobody else waiting.
#pragma once

#include <chrono>
#include <functional>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

namespace fringeslam::tools {

class WaitingRoom {
 public:
  static constexpr auto kPatience = std::chrono::seconds(5);  // from the connection to the end of the request's header
  static constexpr size_t kMostPerPeer = 16, kMost = 128;     // waiting connections; the oldest is closed for a new one

  // Receives a connection and the bytes of its complete header; it has to close the connection.
  using Arrived = std::function<void(int socket, std::string head)>;

  WaitingRoom(int nice, Arrived arrived);  // niceness of its thread
  ~WaitingRoom();                          // closes all connections
  WaitingRoom(const WaitingRoom&) = delete;
  WaitingRoom& operator=(const WaitingRoom&) = delete;

  // Takes over a connected socket.
  void add(int socket);

 private:
  using Clock = std::chrono::steady_clock;
  struct Waiting {
    int socket;
    std::string peer, head;
    Clock::time_point until;
  };
  enum class State { waiting, arrived, over };

  void watch();
  static State receive(Waiting& waiting);
  void wake() const;

  int nice_;
  Arrived arrived_;
  std::mutex mutex_;
  std::vector<Waiting> waiting_;  // the oldest first
  bool stopping_ = false;
  int wake_ = -1;
  std::thread thread_;
};

}  // namespace fringeslam::tools
