// SPDX-License-Identifier: Apache-2.0
// Floods the live page of a run: as many connections as the page admits and more ask for everything it serves, again and
// again, and others send their requests one byte at a time.
#include "bench/robust/flood.h"

#include <netinet/in.h>
#include <poll.h>
#include <sched.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>

#include "bench/script.h"
#include "bench/speed/interleaving.h"
#include "core/io/input_file.h"
#include "core/io/staged.h"
#include "core/types/error.h"

namespace fringeslam::bench {

namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

sockaddr_in loopback(int port) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<uint16_t>(port));
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  return address;
}

int free_port() {
  const int probe = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  sockaddr_in address = loopback(0);
  socklen_t size = sizeof address;
  const bool bound = probe >= 0 && bind(probe, reinterpret_cast<sockaddr*>(&address), size) == 0 &&
                     getsockname(probe, reinterpret_cast<sockaddr*>(&address), &size) == 0;
  if (probe >= 0) close(probe);
  if (!bound) throw Error("live.flood: no port of 127.0.0.1 is free");
  return ntohs(address.sin_port);
}

// Clients in one thread, until destroyed.
class Flood {
 public:
  explicit Flood(int port) : port_(port), thread_([this] { run(); }) {}
  ~Flood() {
    stopping_ = true;
    thread_.join();
    for (const Client& client : clients_) {
      if (client.socket >= 0) close(client.socket);
    }
  }
  Flood(const Flood&) = delete;
  Flood& operator=(const Flood&) = delete;

  int answers() const { return answers_; }

 private:
  static constexpr int kClients = 64, kSlow = 16;
  struct Client {
    int socket = -1;
    std::string request;
    size_t sent = 0;
    bool answered = false;
    Clock::time_point next{};
  };

  std::string request_of(int number) const {
    constexpr std::array kPaths = {"/", "/snapshot", "/changes?since=0", "/keyframe/0/points", "/picture/0/depth.png"};
    return std::string("GET ") + kPaths[static_cast<size_t>(number) % kPaths.size()] +
           " HTTP/1.1\r\nHost: 127.0.0.1:" + std::to_string(port_) + "\r\nConnection: close\r\n\r\n";
  }

  void open(Client& client) {
    client = {};
    client.socket = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    client.request = request_of(opened_++);
    const sockaddr_in address = loopback(port_);
    if (client.socket >= 0 &&
        (connect(client.socket, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0 ||
         errno == EINPROGRESS))
      return;
    finish(client);
  }

  void finish(Client& client) {
    if (client.socket >= 0) close(client.socket);
    answers_ += client.answered;
    client.socket = -1;
    // The page may not be open yet.
    client.next = Clock::now() + std::chrono::milliseconds(client.answered ? 0 : 20);
  }

  void send_some(Client& client, bool slow) {
    if (slow && Clock::now() < client.next) return;
    client.next = Clock::now() + std::chrono::milliseconds(200);
    const size_t bytes = slow ? 1 : client.request.size() - client.sent;
    const ssize_t count = send(client.socket, client.request.data() + client.sent, bytes, MSG_NOSIGNAL | MSG_DONTWAIT);
    if (count > 0)
      client.sent += static_cast<size_t>(count);
    else if (errno != EAGAIN)
      finish(client);
  }

  void receive(Client& client) {
    std::array<char, 1 << 16> bytes;
    const ssize_t count = recv(client.socket, bytes.data(), bytes.size(), MSG_DONTWAIT);
    if (count > 0)
      client.answered = true;
    else if (count == 0 || errno != EAGAIN)
      finish(client);
  }

  void run() {
    // The clients' own work would not be on this computer.
    const sched_param none{};
    (void)sched_setscheduler(0, SCHED_IDLE, &none);
    std::array<pollfd, kClients> descriptors;
    while (!stopping_) {
      for (int i = 0; i < kClients; ++i) {
        Client& client = clients_[static_cast<size_t>(i)];
        if (client.socket < 0 && Clock::now() >= client.next) open(client);
        const bool sending = i >= kSlow && client.sent < client.request.size();
        descriptors[static_cast<size_t>(i)] = {client.socket, static_cast<short>(POLLIN | (sending ? POLLOUT : 0)), 0};
      }
      (void)poll(descriptors.data(), descriptors.size(), 20);
      for (int i = 0; i < kClients; ++i) {
        Client& client = clients_[static_cast<size_t>(i)];
        const short ready = descriptors[static_cast<size_t>(i)].revents;
        if (client.socket >= 0 && (ready & (POLLIN | POLLHUP | POLLERR))) receive(client);
        if (client.socket >= 0 && client.sent < client.request.size() && (i < kSlow || (ready & POLLOUT)))
          send_some(client, i < kSlow);
      }
    }
  }

  const int port_;
  std::array<Client, kClients> clients_;
  int opened_ = 0;
  std::atomic<int> answers_ = 0;
  std::atomic<bool> stopping_ = false;
  std::thread thread_;
};

// Removes the ground truth of a dataset, because scoring would take longer than mapping.
void forget_truth(const fs::path& dataset) {
  const fs::path file = dataset / "dataset.yaml";
  std::string text = read_input(file, kMostTextBytes);
  const std::string declared = "truth: true\n";
  text.erase(text.find(declared), declared.size());
  write_text(file, text);
  fs::remove_all(dataset / "truth");
}

// Returns the seconds that a run with a live page spends on mapping.
double mapping_s(const fs::path& folder, int port) {
  const fs::path answer = folder / "run.json";
  run_program("run '" + (folder / "dataset").string() + "' --out '" + (folder / "run").string() +
                  "' --no-report --live " + std::to_string(port),
              answer, folder / "messages");
  const auto run = nlohmann::json::parse(std::ifstream(answer));
  for (const auto& phase : run.at("phases")) {
    if (phase.at("name") == "mapping") return phase.at("seconds");
  }
  throw Error("live.flood: run printed no time of mapping");
}

}  // namespace

std::vector<Row> flood_rows(const Context& context) {
  std::string name = (fs::temp_directory_path() / "fringeslam-flood-XXXXXX").string();
  if (!mkdtemp(name.data())) throw Error(name + ": cannot be created");
  const fs::path folder = name;
  run_program("render '" FRINGESLAM_SCENES "/loop' --out '" + (folder / "dataset").string() + "'",
              folder / "render.json", folder / "messages");
  forget_truth(folder / "dataset");
  std::vector<double> ratio;
  int answers = 0;
  double seconds = 0;
  for (int turn = 0; turn < (context.quick ? 3 : 9); ++turn) {
    const int port = free_port();
    const double calm = mapping_s(folder, port);
    const Flood flood(port);
    seconds += seconds_of([&] { ratio.push_back(mapping_s(folder, port) / calm); });
    answers += flood.answers();
  }
  fs::remove_all(folder);
  std::fprintf(stderr, "  %.0f answers per second\n", answers / seconds);
  return {median_row("live.flood", ratio, "x", 1.05)};
}

}  // namespace fringeslam::bench
