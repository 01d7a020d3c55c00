// SPDX-License-Identifier: Apache-2.0
#include "tools/live/page_server.h"

#include <httplib.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <deque>
#include <mutex>
#include <thread>
#include <vector>

#include "core/base/start_threads.h"
#include "core/types/error.h"
#include "tools/live/viewer_socket.h"
#include "tools/live/waiting_room.h"
#include "tools/report/packing.h"

namespace fringeslam::tools {

namespace {

constexpr int kBacklog = 128;        // pending connections
constexpr size_t kMaxPath = 256;     // bytes; routing by a regular expression recurses once per character
constexpr size_t kMaxRejected = 64;  // connections waiting for their 503; any further ones are closed

enum class Service { full, busy };
thread_local Service service = Service::full;  // service level of this thread
thread_local ViewerSocket* viewer = nullptr;   // of the request that this thread answers

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
  RequestThreads(size_t count, int nice, std::function<void(int socket, std::string head)> answer)
      : count_(count), nice_(nice), answer_(std::move(answer)) {
    std::vector<std::function<void()>> works(count, [this] { work(tasks_, Service::full); });
    works.emplace_back([this] { work(turned_away_, Service::busy); });
    threads_ = start_threads(works, [this] { stop(); });
  }

  ~RequestThreads() {
    stop();
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

  void stop() {
    {
      const std::lock_guard lock(mutex_);
      stopping_ = true;
    }
    wake_.notify_all();
  }

  void work(std::deque<Task>& tasks, Service mine) {
    if (nice_ != 0) setpriority(PRIO_PROCESS, 0, nice_);  // of this thread only
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
  const int nice_;
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

// Delays connections that arrive faster than viewers need: a flood of requests must not slow the mapping beside it. A viewer
// who watches 30 views per second asks about 100 times. While they arrive faster, their answers get a thirty-second of one core.
// Connections that wait to be accepted wait in the system's queue.
class Pace {
 public:
  // Called by the thread that accepts connections.
  void wait(const std::atomic<bool>& stopping) {
    const auto now = Clock::now();
    next_ = std::max(next_, now - kBurst * kInterval);
    const std::chrono::nanoseconds cost(cost_ns_.exchange(0));
    if (next_ > now) next_ += kTimesCost * cost;
    while (!stopping && Clock::now() < next_)
      std::this_thread::sleep_until(std::min(next_, Clock::now() + std::chrono::milliseconds(50)));
    next_ += kInterval;
  }

  // Adds the processor time of an answer.
  void add_cost(std::chrono::nanoseconds cost) { cost_ns_ += cost.count(); }

 private:
  using Clock = std::chrono::steady_clock;
  static constexpr auto kInterval = std::chrono::milliseconds(5);
  static constexpr int kBurst = 100;  // connections at once after a pause
  static constexpr int kTimesCost = 32;
  Clock::time_point next_ = Clock::now();
  std::atomic<std::chrono::nanoseconds::rep> cost_ns_ = 0;
};

// Returns the processor time of this thread.
std::chrono::nanoseconds thread_time() {
  timespec time{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return std::chrono::seconds(time.tv_sec) + std::chrono::nanoseconds(time.tv_nsec);
}

bool only_reads(const httplib::Request& request) { return request.method == "GET" || request.method == "HEAD"; }

std::string name_for_others(const std::string& host) {
  if (host != "0.0.0.0" && host != "::") return host.find(':') == std::string::npos ? host : "[" + host + "]";
  char name[256] = {};
  return gethostname(name, sizeof name - 1) == 0 && name[0] != '\0' ? name : host;
}

}  // namespace

class PageServer::Server : public httplib::Server {
 public:
  Server(LiveAccess access, std::string port_option, Answers answers, const PageRules& rules)
      : answers_(std::move(answers)), access_(std::move(access)), port_option_(std::move(port_option)), rules_(rules) {
    new_task_queue = [] { return new AtOnce; };
    // httplib's default options let two programs share a port.
    set_socket_options([](socket_t socket) {
      const int yes = 1;
      setsockopt(socket, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
    });
    set_payload_max_length(rules_.most_body_bytes);
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
    throw Error("live: port " + std::to_string(wanted) + " is in use or not permitted; choose another with " +
                port_option_ + " PORT, or any free one with " + port_option_ + " 0");
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
    if (!only_reads(request) && !(rules_.posts && request.method == "POST"))
      return refuse(405,
                    rules_.posts ? "Only GET, HEAD and POST are supported.\n" : "Only GET and HEAD are supported.\n");
    if (request.path.size() > kMaxPath) return refuse(414, "The path is too long.\n");
    if (!request.ranges.empty()) return refuse(416, "Ranges are not supported.\n");
    const Caller caller{request.get_header_value("Host"), request.get_header_value("Origin"),
                        request.get_header_value("Authorization")};
    const bool posts = request.method == "POST", secret = posts || request.path != "/";
    const int status = admission(access_, caller, secret);
    if (status == 401) response.set_header("WWW-Authenticate", "Bearer");
    if (status == 403) return refuse(403, "Only for this computer; use 127.0.0.1 or localhost.\n");
    if (status != 200) return refuse(status, "Requires the token that was printed with the page's address.\n");
    if (!posts) return true;
    // httplib limits neither chunks, nor what it decompresses, nor the memory for the parts of a form.
    if (request.has_header("Content-Encoding") || request.is_multipart_form_data())
      return refuse(415, "Compressed bodies and forms are not supported.\n");
    const auto bytes = number_in<size_t>(request.get_header_value("Content-Length"));
    if (request.has_header("Transfer-Encoding") || !bytes)
      return refuse(411, "Requires a Content-Length, without a Transfer-Encoding.\n");
    if (*bytes > rules_.most_body_bytes) return refuse(413, "The body is too long.\n");
    if (viewer) viewer->expect_body(*bytes);
    return true;
  }

  void add_routes() {
    const auto respond = [this](const httplib::Request& request, httplib::Response& response) {
      const PageRequest asked{request.path, request.method == "POST", request.body,
                              [&](const std::string& name) { return request.get_param_value(name); },
                              [this, mine = viewer] { return stopping_ || (mine && mine->gone()); }};
      PageAnswer answer = answers_(asked);
      response.status = answer.status;
      if (answer.status == 503) response.set_header("Retry-After", "5");
      if (answer.status == 200) send(request, response, std::move(answer));
    };
    Get(".*", respond);
    if (rules_.posts) Post(".*", respond);
  }

  // Text is compressed for other computers only. httplib alone would compress it by Brotli at its highest level, which takes
  // over a second for a page.
  void send(const httplib::Request& request, httplib::Response& response, PageAnswer answer) const {
    const bool text = answer.type.starts_with("text/") || answer.type == "application/json";
    const bool accepted = request.get_header_value("Accept-Encoding").find("deflate") != std::string::npos;
    if (text && accepted && !is_loopback(access_.host)) {
      answer.body = deflated(answer.body);
      response.set_header("Content-Encoding", "deflate");
    }
    // httplib does not compress what a provider yields.
    const auto body = std::make_shared<const std::string>(std::move(answer.body));
    response.set_content_provider(body->size(), answer.type,
                                  [body](size_t offset, size_t length, httplib::DataSink& sink) {
                                    return sink.write(body->data() + offset, length);
                                  });
  }

  // The connection is answered by another thread once its request is complete.
  bool process_and_close_socket(socket_t socket) override {
    if (rules_.paced) pace_.wait(stopping_);
    waiting_room_.add(socket);
    return true;
  }

  void answer(int socket, std::string head) {
    using std::chrono::milliseconds;
    const auto start = thread_time();
    ViewerSocket mine(socket, std::move(head), stopping_,
                      service == Service::busy ? milliseconds(500) : milliseconds(kRequestPatience));
    ViewerStream stream(mine);
    viewer = &mine;
    bool closed = false;
    process_request(stream, true, closed, nullptr);
    viewer = nullptr;
    ::shutdown(socket, SHUT_RDWR);
    ::close(socket);
    pace_.add_cost(thread_time() - start);
  }

  Answers answers_;
  LiveAccess access_;
  std::string port_option_;  // for messages
  PageRules rules_;
  std::atomic<bool> stopping_ = false;
  Pace pace_;
  // In this order: each hands connections to the one before it.
  RequestThreads threads_{PageServer::kRequests, rules_.nice,
                          [this](int socket, std::string head) { answer(socket, std::move(head)); }};
  WaitingRoom waiting_room_{rules_.nice,
                            [this](int socket, std::string head) { threads_.add(socket, std::move(head)); }};
  std::thread listening_;
};

PageServer::PageServer(LiveAccess access, std::string port_option, Answers answers, const PageRules& rules)
    : server_(std::make_unique<Server>(checked(std::move(access)), std::move(port_option), std::move(answers), rules)) {
}

PageServer::~PageServer() = default;

const LiveAccess& PageServer::access() const { return server_->access(); }

std::string PageServer::url() const {
  const std::string address = "http://" + name_for_others(access().host) + ":" + std::to_string(access().port) + "/";
  return access().token.empty() ? address : address + "#token=" + access().token;
}

}  // namespace fringeslam::tools
