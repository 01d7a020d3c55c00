// SPDX-License-Identifier: Apache-2.0
#include "tools/live/live_page.h"

#include <httplib.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <charconv>
#include <condition_variable>
#include <deque>
#include <mutex>
#include <thread>
#include <vector>

#include "core/types/error.h"
#include "tools/live/viewer_socket.h"
#include "tools/live/waiting_room.h"
#include "tools/report/report_page.h"

namespace fringeslam::tools {

namespace {

constexpr auto kLongestWait = std::chrono::seconds(5);  // for a change
constexpr int kNice = 10;                               // niceness of the page's threads
constexpr int kBacklog = 128;                           // pending connections
constexpr size_t kMaxRejected = 64;  // connections waiting for their 503; any further ones are closed

enum class Service { full, busy };
thread_local Service service = Service::full;       // service level of this thread
thread_local const ViewerSocket* viewer = nullptr;  // of the request that this thread answers

class ViewerStream : public httplib::Stream {
 public:
  explicit ViewerStream(ViewerSocket& socket) : socket_(socket) {}
  bool is_readable() const override { return socket_.readable(); }
  bool is_writable() const override { return socket_.writable(); }
  ssize_t read(char* target, size_t size) override { return socket_.read(target, size); }
  ssize_t write(const char* data, size_t size) override { return socket_.write(data, size); }
  void get_remote_ip_and_port(std::string& ip, int& port) const override { ip.clear(), port = 0; }
  void get_local_ip_and_port(std::string& ip, int& port) const override { ip.clear(), port = 0; }
  socket_t socket() const override { return socket_.socket(); }

 private:
  ViewerSocket& socket_;
};

// Threads that answer requests, and one more that answers excess requests with 503.
class RequestThreads {
 public:
  // `answer` has to close the socket.
  RequestThreads(size_t count, std::function<void(int socket, std::string head)> answer)
      : count_(count), answer_(std::move(answer)) {
    for (size_t i = 0; i < count; ++i) threads_.emplace_back([this] { work(tasks_, Service::full); });
    threads_.emplace_back([this] { work(turned_away_, Service::busy); });
  }

  ~RequestThreads() {
    {
      const std::lock_guard lock(mutex_);
      stopping_ = true;
    }
    wake_.notify_all();
    for (std::thread& thread : threads_) thread.join();
  }

  RequestThreads(const RequestThreads&) = delete;
  RequestThreads& operator=(const RequestThreads&) = delete;

  void add(int socket, std::string head) {
    {
      const std::lock_guard lock(mutex_);
      const bool free = busy_ + tasks_.size() < count_;
      if (!free && turned_away_.size() >= kMaxRejected) return void(::close(socket));
      (free ? tasks_ : turned_away_).push_back({socket, std::move(head)});
    }
    wake_.notify_all();
  }

 private:
  struct Task {
    int socket;
    std::string head;
  };

  void work(std::deque<Task>& tasks, Service mine) {
    setpriority(PRIO_PROCESS, 0, kNice);  // of this thread only
    service = mine;
    std::unique_lock lock(mutex_);
    for (;;) {
      wake_.wait(lock, [&] { return stopping_ || !tasks.empty(); });
      if (tasks.empty()) return;
      Task task = std::move(tasks.front());
      tasks.pop_front();
      const size_t here = mine == Service::full ? 1 : 0;
      busy_ += here;
      lock.unlock();
      answer_(task.socket, std::move(task.head));
      lock.lock();
      busy_ -= here;
    }
  }

  const size_t count_;
  std::function<void(int, std::string)> answer_;
  std::mutex mutex_;
  std::condition_variable wake_;
  std::deque<Task> tasks_, turned_away_;
  size_t busy_ = 0;
  bool stopping_ = false;
  std::vector<std::thread> threads_;
};

// Runs httplib's tasks, which take a moment, in the thread that accepts connections.
class AtOnce : public httplib::TaskQueue {
 public:
  void enqueue(std::function<void()> task) override { task(); }
  void shutdown() override {}
};

// Parses an integer; empty if there is anything else in the text.
template <class Number>
std::optional<Number> number_in(const std::string& text) {
  Number number = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  if (error != std::errc() || end != text.data() + text.size()) return std::nullopt;
  return number;
}

bool only_reads(const httplib::Request& request) { return request.method == "GET" || request.method == "HEAD"; }

std::string name_for_others(const std::string& host) {
  if (host != "0.0.0.0" && host != "::") return host.find(':') == std::string::npos ? host : "[" + host + "]";
  char name[256] = {};
  return gethostname(name, sizeof name - 1) == 0 && name[0] != '\0' ? name : host;
}

}  // namespace

class LivePage::Server : public httplib::Server {
 public:
  Server(const LiveFeed& feed, LiveAccess access) : feed_(feed), access_(std::move(access)) {
    new_task_queue = [] { return new AtOnce; };
    // httplib's default options let two programs share a port.
    set_socket_options([](socket_t socket) {
      const int yes = 1;
      setsockopt(socket, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
    });
    set_payload_max_length(0);
    set_default_headers({{"Cache-Control", "no-store"},
                         {"X-Content-Type-Options", "nosniff"},
                         {"Referrer-Policy", "no-referrer"},
                         {"Cross-Origin-Resource-Policy", "same-origin"},
                         {"Content-Security-Policy",
                          "default-src 'none'; connect-src 'self'; img-src blob: data:; style-src 'unsafe-inline'; "
                          "script-src 'unsafe-inline'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"}});
    // Before a body is read or the ranges of an answer, of which there may be many, are assembled.
    set_pre_routing_handler([this](const httplib::Request& request, httplib::Response& response) {
      return admit(request, response) ? HandlerResponse::Unhandled : HandlerResponse::Handled;
    });
    set_exception_handler(
        [](const httplib::Request&, httplib::Response& response, std::exception_ptr) { response.status = 500; });
    add_routes();
    bind();
    // httplib's own backlog of 5 delays simultaneous connections by seconds.
    ::listen(svr_sock_, kBacklog);
    listening_ = std::thread([this] { listen_after_bind(); });
    while (!is_running()) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }

  ~Server() override {
    stopping_ = true;
    stop();
    listening_.join();
  }

  const LiveAccess& access() const { return access_; }

 private:
  void bind() {
    const int wanted = access_.port;
    const std::string& host = access_.host;
    if (wanted == 0 ? (access_.port = bind_to_any_port(host.c_str())) > 0 : bind_to_port(host.c_str(), wanted)) return;
    if (!is_loopback(host))
      throw Error("live: cannot listen on " + host + ", port " + std::to_string(wanted) +
                  "; check that this is an address of this computer and the port is free");
    throw Error("live: port " + std::to_string(wanted) +
                " is in use or not permitted; choose another with --live PORT, or any free one with --live 0");
  }

  bool admit(const httplib::Request& request, httplib::Response& response) const {
    const auto refuse = [&](int status, const char* why) {
      response.status = status;
      response.set_content(why, "text/plain");
      return false;
    };
    if (service == Service::busy) {
      response.set_header("Retry-After", "5");
      return refuse(503, "Too many concurrent viewers; try again later.\n");
    }
    if (!only_reads(request)) return refuse(405, "Only GET and HEAD are supported.\n");
    if (!request.ranges.empty()) return refuse(416, "Ranges are not supported.\n");
    const Caller caller{request.get_header_value("Host"), request.get_header_value("Origin"),
                        request.get_header_value("Authorization")};
    const bool secret = request.path != "/";
    const int status = admission(access_, caller, secret);
    if (status == 401) response.set_header("WWW-Authenticate", "Bearer");
    if (status == 403) return refuse(403, "Only for this computer; use 127.0.0.1 or localhost.\n");
    if (status != 200) return refuse(status, "Requires the token that was printed with the page's address.\n");
    return true;
  }

  void add_routes() {
    using Request = httplib::Request;
    using Response = httplib::Response;
    const auto serve = [](Response& response, const std::string& body, const char* type) {
      if (body.empty())
        response.status = 404;
      else
        response.set_content(body, type);
    };
    Get("/", [](const Request&, Response& response) {
      const std::string_view page = live_page();
      response.set_content(page.data(), page.size(), "text/html; charset=utf-8");
    });
    Get("/snapshot",
        [=, this](const Request&, Response& response) { serve(response, feed_.snapshot(), "application/json"); });
    Get("/changes", [=, this](const Request& request, Response& response) {
      const std::string run = request.get_param_value("run");
      const auto since = number_in<uint64_t>(request.get_param_value("since"));
      if (!since) return void(response.status = 400);
      const Waiting waiting(waiting_);
      if (waiting.place > kViewers) {
        response.set_header("Retry-After", "5");
        return void(response.status = 503);
      }
      feed_.await_change(run, *since, kLongestWait, [this] { return stopping_ || (viewer && viewer->gone()); });
      serve(response, feed_.changes(run, *since), "application/json");
    });
    Get(R"(/picture/(\d{1,9})/([a-z]+\.(jpg|png)))", [=, this](const Request& request, Response& response) {
      const int number = number_in<int>(request.matches[1]).value_or(0);
      const auto view = feed_.view(number);
      if (!view && feed_.had_view(number)) return void(response.status = 204);
      const bool jpeg = request.matches[3] == "jpg";
      serve(response, view ? view->picture(request.matches[2]) : std::string(), jpeg ? "image/jpeg" : "image/png");
    });
    Get(R"(/keyframe/(\d{1,9})/points)", [=, this](const Request& request, Response& response) {
      const auto points = feed_.points_of(number_in<int>(request.matches[1]).value_or(-1));
      serve(response, points.value_or(std::string()), "application/octet-stream");
    });
  }

  // The connection is answered by another thread once its request is complete.
  bool process_and_close_socket(socket_t socket) override {
    waiting_room_.add(socket);
    return true;
  }

  void answer(int socket, std::string head) {
    using std::chrono::milliseconds;
    ViewerSocket mine(socket, std::move(head), stopping_,
                      service == Service::busy ? milliseconds(500) : milliseconds(kRequestPatience));
    ViewerStream stream(mine);
    viewer = &mine;
    bool closed = false;
    process_request(stream, true, closed, nullptr);
    viewer = nullptr;
    ::shutdown(socket, SHUT_RDWR);
    ::close(socket);
  }

  // A viewer's place among those waiting for changes, starting at 1.
  struct Waiting {
    explicit Waiting(std::atomic<size_t>& all_waiting) : all(all_waiting), place(++all) {}
    ~Waiting() { --all; }
    Waiting(const Waiting&) = delete;
    Waiting& operator=(const Waiting&) = delete;
    std::atomic<size_t>& all;
    size_t place;
  };

  const LiveFeed& feed_;
  LiveAccess access_;
  std::atomic<size_t> waiting_ = 0;
  std::atomic<bool> stopping_ = false;
  // In this order: each hands connections to the one before it.
  RequestThreads threads_{kRequests, [this](int socket, std::string head) { answer(socket, std::move(head)); }};
  WaitingRoom waiting_room_{[this](int socket, std::string head) { threads_.add(socket, std::move(head)); }};
  std::thread listening_;
};

LivePage::LivePage(LiveSetup setup, LiveAccess access)
    : feed_(std::move(setup)), server_(std::make_unique<Server>(feed_, checked(std::move(access)))) {}

LivePage::~LivePage() = default;

const LiveAccess& LivePage::access() const { return server_->access(); }

std::string LivePage::url() const {
  const std::string address = "http://" + name_for_others(access().host) + ":" + std::to_string(access().port) + "/";
  return access().token.empty() ? address : address + "#token=" + access().token;
}

}  // namespace fringeslam::tools
