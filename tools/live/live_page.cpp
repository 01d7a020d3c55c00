// SPDX-License-Identifier: Apache-2.0
#include "tools/live/live_page.h"

#include <httplib.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <deque>
#include <map>
#include <mutex>
#include <nlohmann/json.hpp>
#include <optional>
#include <thread>

#include "core/rig/files.h"
#include "core/types/error.h"
#include "tools/live/page_html.h"
#include "tools/live/preview.h"

namespace fringeslam::tools {

namespace {

using Clock = std::chrono::steady_clock;

constexpr const char* kHost = "127.0.0.1";
constexpr size_t kViewers = 8;  // that are served at the same time
constexpr size_t kMaxRequestBytes = 16384;
constexpr auto kRequestPatience = std::chrono::seconds(5), kAnswerPatience = std::chrono::seconds(20);
constexpr size_t kRateStacks = 8;  // over which their rate is averaged

// One request and its answer, neither of which may take for ever: httplib alone bounds a header's lines, but neither
// their number nor the time of a viewer who sends or reads drop by drop.
class ViewerStream : public httplib::Stream {
 public:
  ViewerStream(int socket, const std::atomic<bool>& stopping)
      : socket_(socket), stopping_(stopping), request_by_(Clock::now() + kRequestPatience) {}

  bool is_readable() const override { return begin_ < end_ || ready(POLLIN, request_by_); }
  bool is_writable() const override { return ready(POLLOUT, answer_by_.value_or(Clock::time_point::max())); }

  ssize_t read(char* target, size_t size) override {
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

  ssize_t write(const char* data, size_t size) override {
    // From the first byte on: it may take long to get an answer ready.
    if (!answer_by_) answer_by_ = Clock::now() + kAnswerPatience;
    if (!ready(POLLOUT, *answer_by_)) return -1;
    return send(socket_, data, size, MSG_NOSIGNAL | MSG_DONTWAIT);
  }

  void get_remote_ip_and_port(std::string& ip, int& port) const override { ip = kHost, port = 0; }
  void get_local_ip_and_port(std::string& ip, int& port) const override { ip = kHost, port = 0; }
  socket_t socket() const override { return socket_; }

 private:
  // In short waits, so that none outlives the page.
  bool ready(short events, Clock::time_point until) const {
    while (!stopping_) {
      pollfd descriptor{socket_, events, 0};
      if (poll(&descriptor, 1, 20) > 0) return true;
      if (Clock::now() >= until) break;
    }
    return false;
  }

  int socket_;
  const std::atomic<bool>& stopping_;
  Clock::time_point request_by_;
  std::optional<Clock::time_point> answer_by_;
  std::array<char, 2048> buffer_ = {};
  size_t begin_ = 0, end_ = 0, received_ = 0;
};

// The place where the newest stack lies. Held for no longer than it takes to copy a pointer.
class Handover {
 public:
  struct Newest {
    std::shared_ptr<const FringeStack> stack;
    int number = 0;
    double stacks_per_s = 0;
  };

  void put(const FringeStack& stack) {
    auto copy = std::make_shared<const FringeStack>(stack);
    const std::lock_guard lock(mutex_);
    stack_.swap(copy);
    ++number_;
    times_.push_back(Clock::now());
    if (times_.size() > kRateStacks) times_.pop_front();
  }

  Newest take() const {
    const std::lock_guard lock(mutex_);
    double rate = 0;
    if (times_.size() > 1)
      rate = static_cast<double>(times_.size() - 1) /
             std::chrono::duration<double>(times_.back() - times_.front()).count();
    return {stack_, number_, rate};
  }

 private:
  mutable std::mutex mutex_;
  std::shared_ptr<const FringeStack> stack_;
  std::deque<Clock::time_point> times_;
  int number_ = 0;
};

}  // namespace

class LivePage::Server : public httplib::Server {
 public:
  Server(const PatternSequence& sequence, const RigModel& rig, int port) : sequence_(sequence), rig_(rig) {
    new_task_queue = [] { return new httplib::ThreadPool(kViewers); };
    // httplib's own options let two programs share a port.
    set_socket_options([](socket_t socket) {
      const int yes = 1;
      setsockopt(socket, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
    });
    set_payload_max_length(0);
    set_default_headers({{"Cache-Control", "no-store"},
                         {"X-Content-Type-Options", "nosniff"},
                         {"Cross-Origin-Resource-Policy", "same-origin"},
                         {"Content-Security-Policy",
                          "default-src 'none'; connect-src 'self'; img-src 'self' data:; style-src 'unsafe-inline'; "
                          "script-src 'unsafe-inline'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"}});
    // Before a body is read or ranges of an answer are put together, of which there may be many.
    set_pre_routing_handler([](const httplib::Request& request, httplib::Response& response) {
      if (request.method != "GET" && request.method != "HEAD")
        response.status = 405;
      else if (!request.ranges.empty())
        response.status = 416;
      else
        return HandlerResponse::Unhandled;
      return HandlerResponse::Handled;
    });
    Get("/", [](const httplib::Request&, httplib::Response& response) {
      response.set_content(kPageHtml.data(), kPageHtml.size(), "text/html; charset=utf-8");
    });
    Get("/state\\.json", [this](const httplib::Request&, httplib::Response& response) {
      response.set_content(state(), "application/json");
    });
    for (const char* name : {"texture", "modulation", "saturation", "depth"}) {
      Get(std::string("/preview/") + name + "\\.png",
          [this, name](const httplib::Request&, httplib::Response& response) {
            const std::string png = picture(name);
            if (png.empty())
              response.status = 404;
            else
              response.set_content(png, "image/png");
          });
    }
    port_ = port;
    if (port == 0 ? (port_ = bind_to_any_port(kHost)) <= 0 : !bind_to_port(kHost, port))
      throw Error("live: port " + std::to_string(port) +
                  " is taken or not allowed; choose another by --live PORT, or --live 0 for one that is free");
    listening_ = std::thread([this] { listen_after_bind(); });
    while (!is_running()) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }

  ~Server() override {
    stopping_ = true;
    stop();
    listening_.join();
  }

  Handover& handover() { return handover_; }
  int port() const { return port_; }

 private:
  bool process_and_close_socket(socket_t socket) override {
    ViewerStream stream(socket, stopping_);
    bool closed = false;
    const bool good = process_request(stream, true, closed, nullptr);
    ::shutdown(socket, SHUT_RDWR);
    ::close(socket);
    return good;
  }

  // Of the newest stack; with the lock held, so that viewers who ask at the same time wait for one decoding.
  void update() {
    const Handover::Newest newest = handover_.take();
    stacks_per_s_ = newest.stacks_per_s;
    if (newest.number == number_) return;
    if (number_ == 0) triangulation_ = preview_triangulation(sequence_, rig_);
    preview_ = preview_of(*newest.stack, sequence_, rig_, triangulation_);
    encoded_.clear();
    number_ = newest.number;
  }

  std::string state() {
    const std::lock_guard lock(mutex_);
    update();
    nlohmann::ordered_json document{{"number", number_}, {"rig", rig_.name}};
    if (number_ > 0) {
      const PreviewFigures& figures = preview_.figures;
      document.update({{"stacks_per_s", stacks_per_s_},
                       {"valid", figures.valid},
                       {"saturated", figures.saturated},
                       {"mean_modulation_dn", figures.mean_modulation_dn},
                       {"brightness", figures.brightness},
                       {"full_scale_dn", figures.full_scale_dn},
                       {"depth_possible", figures.depth_possible},
                       {"near_m", rig_.near_m},
                       {"far_m", rig_.far_m},
                       {"warnings", warnings(figures)}});
    }
    return document.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
  }

  // PNG; empty before the first stack.
  std::string picture(const std::string& name) {
    const std::lock_guard lock(mutex_);
    update();
    if (number_ == 0) return {};
    std::string& png = encoded_[name];
    if (png.empty())
      png = png_bytes(name == "texture"      ? preview_.texture
                      : name == "modulation" ? preview_.modulation
                      : name == "saturation" ? preview_.saturation
                                             : preview_.depth);
    return png;
  }

  const PatternSequence sequence_;
  const RigModel rig_;
  Handover handover_;
  std::mutex mutex_;  // of what follows
  std::optional<Triangulation> triangulation_;
  Preview preview_;
  std::map<std::string, std::string> encoded_;
  int number_ = 0;
  double stacks_per_s_ = 0;

  int port_ = 0;
  std::atomic<bool> stopping_ = false;
  std::thread listening_;
};

LivePage::LivePage(const PatternSequence& sequence, const RigModel& rig, int port)
    : server_(std::make_unique<Server>(sequence, rig, port)) {}

LivePage::~LivePage() = default;

void LivePage::show(const FringeStack& stack) { server_->handover().put(stack); }

std::string LivePage::url() const {
  return std::string("http://") + kHost + ":" + std::to_string(server_->port()) + "/";
}

}  // namespace fringeslam::tools
