// SPDX-License-Identifier: Apache-2.0
// The live page over HTTP: as requested by browsers, and by malicious clients.
#include "tools/live/live_page.h"

#include <arpa/inet.h>
#include <gmock/gmock.h>
#include <httplib.h>
#include <sys/socket.h>
#include <unistd.h>

#include <chrono>
#include <deque>
#include <nlohmann/json.hpp>
#include <thread>

#include "core/io/files.h"
#include "tests/live/synthetic_run.h"
#include "tests/support/matchers.h"
#include "tests/support/temp_folder.h"
#include "tools/live/page_server.h"

namespace fringeslam {
namespace {

using nlohmann::json;
using support::error_of;
using test::ramp_stack;
using test::SyntheticRun;
using test::TempFolder;
using testing::AllOf;
using testing::HasSubstr;
using testing::Not;
using testing::StartsWith;
using tools::LiveAccess;
using tools::LivePage;

constexpr const char* kToken = "correct-horse-battery";

tools::LiveSetup capture_setup() {
  return {.verb = "capture", .name = "made", .rig = test::tiny_rig(), .sequence = test::short_sequence()};
}

int port_of(const LivePage& page) { return page.access().port; }

// A connection that sends some bytes and does not read until asked.
class NonReadingClient {
 public:
  NonReadingClient(int port, const std::string& bytes) : socket_(socket(AF_INET, SOCK_STREAM, 0)) {
    // A small receive buffer, so that an answer does not fit.
    const int room = 2048;
    setsockopt(socket_, SOL_SOCKET, SO_RCVBUF, &room, sizeof room);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(static_cast<uint16_t>(port));
    inet_pton(AF_INET, "127.0.0.1", &address.sin_addr);
    EXPECT_EQ(connect(socket_, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
    EXPECT_EQ(send(socket_, bytes.data(), bytes.size(), MSG_NOSIGNAL), static_cast<ssize_t>(bytes.size()));
  }
  ~NonReadingClient() { close(socket_); }
  NonReadingClient(const NonReadingClient&) = delete;
  NonReadingClient& operator=(const NonReadingClient&) = delete;

  // Waits until an answer has begun to arrive.
  void await_answer() const {
    char byte = 0;
    EXPECT_EQ(recv(socket_, &byte, 1, MSG_PEEK), 1);
  }

  // Reads until the other side closes the connection.
  std::string rest() const {
    std::string text;
    char bytes[1024];
    for (ssize_t count = 0; (count = recv(socket_, bytes, sizeof bytes, 0)) > 0;)
      text.append(bytes, static_cast<size_t>(count));
    return text;
  }

 private:
  int socket_;
};

httplib::Result get(const LivePage& page, const std::string& path, const httplib::Headers& headers = {}) {
  httplib::Client client("127.0.0.1", port_of(page));
  client.set_read_timeout(60);
  return client.Get(path, headers);
}

int status_of(const LivePage& page, const std::string& path, const httplib::Headers& headers = {}) {
  const auto answer = get(page, path, headers);
  return answer ? answer->status : -1;
}

json snapshot_of(const LivePage& page) {
  const auto answer = get(page, "/snapshot");
  return answer ? json::parse(answer->body) : json("no answer");
}

std::string wait_for_more(const LivePage& page) {
  const json now = snapshot_of(page);
  return "/changes?run=" + now["run"].get<std::string>() + "&since=" + std::to_string(now["sequence"].get<int>());
}

class LivePageTest : public testing::Test {
 protected:
  LivePage page_{capture_setup(), {}};
};

TEST_F(LivePageTest, BeforeTheFirstStackThereIsNoPicture) {
  EXPECT_FALSE(snapshot_of(page_).contains("newest"));
  EXPECT_EQ(status_of(page_, "/picture/1/texture.jpg"), 404);
}

TEST_F(LivePageTest, FiguresAreOfTheNewestStack) {
  for (int number = 1; number <= 3; ++number) {
    const double modulation_dn = 20.0 * number;
    page_.feed().show(ramp_stack(modulation_dn));
    const json all = snapshot_of(page_);
    const json now = all["newest"];
    EXPECT_EQ(now["number"], number);
    EXPECT_EQ(all["about"]["rig"]["name"], "thesis");
    EXPECT_NEAR(now["mean_modulation_dn"].get<double>(), modulation_dn, 0.5);
    EXPECT_EQ(now["saturated"], 0);
    EXPECT_EQ(now["full_scale_dn"], 255);
    EXPECT_EQ(all["views_per_s"] > 0, number > 1);
  }
  // Of several views shown while nobody polls, only the last one is sent.
  for (int i = 0; i < 5; ++i) page_.feed().show(ramp_stack(70 + i));
  const json now = snapshot_of(page_)["newest"];
  EXPECT_EQ(now["number"], 8);
  EXPECT_NEAR(now["mean_modulation_dn"].get<double>(), 74, 0.5);
}

TEST_F(LivePageTest, WarningsArePassedOn) {
  page_.feed().show(ramp_stack(140));  // 260 at its crests
  const json now = snapshot_of(page_)["newest"];
  EXPECT_GT(now["saturated"], 0.01);
  EXPECT_THAT(now["warnings"].dump(), HasSubstr("saturated"));
}

TEST_F(LivePageTest, PicturesAreOfTheCamerasSize) {
  page_.feed().show(ramp_stack(90));
  snapshot_of(page_);
  const TempFolder folder;
  const auto picture = [&](int number, const std::string& name) -> cv::Mat {
    const auto answer = get(page_, "/picture/" + std::to_string(number) + "/" + name);
    if (!answer || answer->status != 200) return {};
    EXPECT_EQ(answer->get_header_value("Content-Type"), name.ends_with("jpg") ? "image/jpeg" : "image/png");
    test::write_bytes(folder / name, answer->body);
    return read_as_grey(folder / name, GreyFrom::red);
  };
  for (const char* name : {"texture.jpg", "modulation.jpg", "saturation.png", "depth.png"})
    EXPECT_EQ(picture(1, name).size(), cv::Size(test::tiny_rig().camera.width, test::tiny_rig().camera.height)) << name;
  EXPECT_NEAR(cv::mean(picture(1, "texture.jpg"))[0], 255 * 120 / (0.6 * 255), 2);
  EXPECT_NEAR(cv::mean(picture(1, "modulation.jpg"))[0], 255 * 90 / 127.5, 2);
  // The previous view's pictures stay available to slower viewers for a while.
  page_.feed().show(ramp_stack(45));
  snapshot_of(page_);
  EXPECT_NEAR(cv::mean(picture(2, "modulation.jpg"))[0], 255 * 45 / 127.5, 2);
  EXPECT_NEAR(cv::mean(picture(1, "modulation.jpg"))[0], 255 * 90 / 127.5, 2);
  for (int i = 0; i < 20; ++i) {
    page_.feed().show(ramp_stack(45));
    snapshot_of(page_);
  }
  EXPECT_EQ(status_of(page_, "/picture/1/modulation.jpg"), 204);
  EXPECT_EQ(status_of(page_, "/picture/22/modulation.jpg"), 200);
  EXPECT_EQ(status_of(page_, "/picture/23/modulation.jpg"), 404);
}

TEST_F(LivePageTest, ThePageNeedsNothingFromElsewhere) {
  const auto answer = get(page_, "/");
  ASSERT_TRUE(answer);
  EXPECT_EQ(answer->status, 200);
  EXPECT_THAT(answer->get_header_value("Content-Type"), StartsWith("text/html"));
  EXPECT_THAT(answer->body, AllOf(HasSubstr("<html lang=\"en\">"), HasSubstr("/snapshot"), Not(HasSubstr("@@"))));
  EXPECT_THAT(answer->body,
              AllOf(Not(HasSubstr("src=\"http")), Not(HasSubstr("src=\"//")), Not(HasSubstr("url(http"))));
  EXPECT_THAT(answer->get_header_value("Content-Security-Policy"), StartsWith("default-src 'none'"));
}

TEST_F(LivePageTest, NothingElseIsServed) {
  page_.feed().show(ramp_stack(90));
  snapshot_of(page_);
  for (const char* path : {"/index.html", "/picture/", "/picture/1", "/picture/1/texture", "/picture/1/texture.jpg/",
                           "/picture/1/other.jpg", "/picture/-1/texture.jpg", "/picture/1e0/texture.jpg",
                           "/picture/99999999999/texture.jpg", "/keyframe/0/points", "/keyframe/../points",
                           "/snapshotX", "/../etc/passwd", "/picture/1/../../../etc/passwd", "/%2e%2e/etc/passwd",
                           "//etc/passwd", "/picture/1/%2e%2e%2f%2e%2e%2fetc%2fpasswd"})
    EXPECT_EQ(status_of(page_, path), 404) << path;
  for (const char* since : {"", "x", "-1", "1x", "99999999999999999999999"})
    EXPECT_EQ(status_of(page_, std::string("/changes?run=a&since=") + since), 400) << since;
  const auto posted =
      httplib::Client("127.0.0.1", port_of(page_)).Post("/snapshot", std::string(100000, 'x'), "text/plain");
  EXPECT_TRUE(!posted || posted->status == 405);
  for (const char* method : {"PUT", "DELETE", "OPTIONS", "PATCH"}) {
    httplib::Request request;
    request.method = method;
    request.path = "/snapshot";
    const auto answer = httplib::Client("127.0.0.1", port_of(page_)).send(request);
    EXPECT_TRUE(!answer || answer->status == 405) << method;
  }
  const auto parts = get(page_, "/picture/1/texture.jpg", {{"Range", "bytes=0-9,0-9,0-9"}});
  EXPECT_TRUE(!parts || parts->status == 416);
  EXPECT_EQ(status_of(page_, "/snapshot"), 200);
}

TEST_F(LivePageTest, RequestsAreBounded) {
  EXPECT_EQ(status_of(page_, "/snapshot?" + std::string(10000, 'x')), 414);
  // Endless headers: the connection is closed before they end.
  std::string headers = "GET /snapshot HTTP/1.1\r\n";
  for (int i = 0; i < 2000; ++i) headers += "X-" + std::to_string(i) + ": y\r\n";
  headers += "\r\n";
  EXPECT_THAT(NonReadingClient(port_of(page_), headers).rest(), Not(HasSubstr("200 OK")));
  EXPECT_EQ(status_of(page_, "/snapshot"), 200);
}

TEST_F(LivePageTest, ForeignNamesAndPagesAreRefused) {
  EXPECT_EQ(status_of(page_, "/", {{"Host", "evil.com"}}), 403);
  EXPECT_EQ(status_of(page_, "/snapshot", {{"Host", "evil.com:" + std::to_string(port_of(page_))}}), 403);
  EXPECT_EQ(status_of(page_, "/snapshot", {{"Origin", "http://evil.com"}}), 403);
  EXPECT_EQ(status_of(page_, "/snapshot", {{"Host", "localhost:8080"}}), 200);  // through an SSH tunnel
  EXPECT_THAT(NonReadingClient(port_of(page_), "GET /snapshot HTTP/1.0\r\n\r\n").rest(), HasSubstr("403"));
}

TEST_F(LivePageTest, ChangesArePublishedImmediately) {
  page_.feed().show(ramp_stack(60));
  const std::string path = wait_for_more(page_);
  std::thread capture([&] { page_.feed().show(ramp_stack(80)); });
  const auto answer = get(page_, path);
  capture.join();
  ASSERT_TRUE(answer);
  const json changes = json::parse(answer->body);
  EXPECT_EQ(changes["views"], json::parse(R"({"from": 1, "list": [{"index": 0, "timestamp_s": 0.0}]})"));
  EXPECT_EQ(changes["newest"]["number"], 2);
  EXPECT_FALSE(changes.contains("about"));
}

TEST(LivePage, BeyondThisComputerATokenIsAskedFor) {
  const LivePage page(capture_setup(), {"0.0.0.0", 0, kToken});
  EXPECT_THAT(page.url(), AllOf(StartsWith("http://"), testing::EndsWith(std::string("/#token=") + kToken)));
  EXPECT_THAT(page.url(), Not(HasSubstr("0.0.0.0")));
  EXPECT_EQ(status_of(page, "/"), 200);
  for (const char* path :
       {"/snapshot", "/changes?run=a&since=0", "/picture/1/texture.jpg", "/keyframe/0/points", "/other"}) {
    EXPECT_EQ(status_of(page, path), 401) << path;
    EXPECT_EQ(status_of(page, path, {{"Authorization", "Bearer wrong-horse-battery"}}), 401) << path;
  }
  EXPECT_EQ(status_of(page, "/snapshot", {{"Authorization", std::string("Bearer ") + kToken}}), 200);
  EXPECT_EQ(status_of(page, "/snapshot", {{"Authorization", std::string("Bearer ") + kToken}, {"Host", "robot"}}), 200);
  // A random token is used if none is given.
  EXPECT_EQ(LivePage(capture_setup(), {"0.0.0.0", 0, ""}).access().token.size(), 32u);
}

TEST(LivePage, NobodyBeyondThisComputerIsServed) {
  const LivePage page(capture_setup(), {});
  // All of 127.0.0.0/8 is this computer; a page listening on every address would also answer here.
  httplib::Client elsewhere("127.0.0.2", port_of(page));
  EXPECT_FALSE(elsewhere.Get("/snapshot"));
}

TEST(LivePage, ALateViewerGetsWhatAnEarlyOneGathered) {
  LivePage page(test::run_setup(), {});
  SyntheticRun run;
  json views = json::array();
  std::string path = wait_for_more(page);
  for (int i = 0; i < 6; ++i) {
    i == 2 ? run.lose(page.feed()) : run.track(page.feed(), i == 3);
    const json answer = json::parse(get(page, path)->body);
    for (const json& view : answer["views"]["list"]) views.push_back(view);
    path = wait_for_more(page);
  }
  const json late = snapshot_of(page);
  EXPECT_EQ(late["views"]["list"], views);
  EXPECT_EQ(late["keyframes"]["list"].size(), 2u);
  const auto points = get(page, "/keyframe/1/points");
  ASSERT_TRUE(points);
  EXPECT_EQ(points->body, page.feed().points_of(1));
}

// Each viewer waits for changes; only the excess one gets a 503.
TEST(LivePage, ExcessViewersGetAMessage) {
  LivePage page(capture_setup(), {});
  const std::string request = "GET " + wait_for_more(page) + " HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n";
  std::deque<NonReadingClient> waiting;
  for (size_t i = 0; i < LivePage::kViewers; ++i) waiting.emplace_back(port_of(page), request);
  std::string answer;
  while (answer.find("HTTP/1.1 200") == 0 || answer.empty()) answer = NonReadingClient(port_of(page), request).rest();
  EXPECT_THAT(answer, AllOf(StartsWith("HTTP/1.1 503"), HasSubstr("Retry-After:")));
  EXPECT_EQ(status_of(page, "/snapshot"), 200);
  // Viewers that disconnect make room for others: waiting connections are polled.
  waiting.clear();
  page.feed().show(ramp_stack(60));
  while (answer.find("HTTP/1.1 503") == 0) answer = NonReadingClient(port_of(page), request).rest();
  EXPECT_THAT(answer, StartsWith("HTTP/1.1 200"));
}

// Clients that request and never read, many at a time.
TEST(LivePage, ViewersWhoDoNotReadHoldUpNobody) {
  // The camera has so many pixels that a picture exceeds the buffers of a connection without a reader.
  tools::LiveSetup setup = capture_setup();
  setup.sequence = phase_shift_sequence(1024, 768, {16}, 3, Axis::columns, 8);
  setup.rig = test::thesis_rig();
  setup.rig.camera.width = 2400;
  setup.rig.camera.height = 2000;
  std::vector<cv::Mat> noise;
  cv::RNG random(3);
  for (size_t i = 0; i < setup.sequence.patterns.size(); ++i) {
    cv::Mat1b image(setup.rig.camera.height, setup.rig.camera.width);
    random.fill(image, cv::RNG::UNIFORM, 0, 240);
    noise.push_back(image);
  }
  const FringeStack stack = support::stack_of(setup.sequence, noise);
  auto page = std::make_unique<LivePage>(setup, LiveAccess{});
  page->feed().show(stack);
  snapshot_of(*page);
  const std::string path = "/picture/1/saturation.png";
  const auto picture = get(*page, path);
  ASSERT_TRUE(picture);
  ASSERT_GT(picture->body.size(), 4'500'000u);
  std::deque<NonReadingClient> silent;
  for (int i = 0; i < 3; ++i) {
    silent.emplace_back(port_of(*page), "GET " + path + " HTTP/1.1\r\nHost: localhost\r\n\r\n");
    silent.back().await_answer();
  }
  // A thread that waits for one of them would wait for 20 s.
  using Clock = std::chrono::steady_clock;
  Clock::time_point begin = Clock::now();
  for (int i = 0; i < 1000; ++i) page->feed().show(stack);
  EXPECT_LT(Clock::now() - begin, std::chrono::seconds(10));
  EXPECT_EQ(snapshot_of(*page)["newest"]["number"], 1001);
  EXPECT_LE(page->feed().views_kept(), 8u);
  begin = Clock::now();
  page.reset();
  EXPECT_LT(Clock::now() - begin, std::chrono::seconds(10));
}

// Clients who send a part of a request and then nothing.
TEST(LivePage, SlowConnectionsKeepNobodyWaiting) {
  LivePage page(capture_setup(), {});
  std::deque<NonReadingClient> slow;
  using Clock = std::chrono::steady_clock;
  const Clock::time_point begin = Clock::now();
  for (int i = 0; i < 50; ++i) slow.emplace_back(port_of(page), "GET /snapshot HTTP/1.1\r\nHost: local");
  for (int i = 0; i < 20; ++i) EXPECT_EQ(status_of(page, "/snapshot"), 200);
  EXPECT_LT(Clock::now() - begin, std::chrono::seconds(4));
  // They are closed after 5 s, those in excess at once.
  for (const NonReadingClient& client : slow) EXPECT_EQ(client.rest(), "");
  EXPECT_LT(Clock::now() - begin, std::chrono::seconds(20));
  EXPECT_EQ(status_of(page, "/snapshot"), 200);
}

// More clients than the page has threads: the excess ones are rejected, and mapping goes on.
TEST(LivePage, ACrowdThatNeverReadsDoesNotStopAMap) {
  LivePage page(test::run_setup(), {});
  const std::string request = "GET " + wait_for_more(page) + " HTTP/1.1\r\nHost: localhost\r\n\r\n";
  std::deque<NonReadingClient> crowd;
  for (int i = 0; i < 200; ++i) crowd.emplace_back(port_of(page), request.substr(0, i % 2 ? request.size() : 30));
  SyntheticRun run;
  for (int i = 0; i < 50; ++i) run.track(page.feed());
  EXPECT_EQ(json::parse(page.feed().snapshot())["views"]["list"].size(), 50u);
  crowd.clear();
  while (status_of(page, "/snapshot") != 200) continue;
  EXPECT_EQ(snapshot_of(page)["views"]["list"].size(), 50u);
}

TEST(LivePage, ATakenPortIsOneClearError) {
  const LivePage first(capture_setup(), {});
  const int port = port_of(first);
  EXPECT_EQ(error_of([&] {
              LivePage(capture_setup(), {"127.0.0.1", port, ""});
            }),
            "live: port " + std::to_string(port) +
                " is in use or not permitted; choose another with --live PORT, or any free one with --live 0");
  EXPECT_FALSE(snapshot_of(first).contains("newest"));
  EXPECT_THAT(error_of([&] {
                LivePage(capture_setup(), {"192.0.2.1", 0, ""});
              }),
              HasSubstr("check that this is an address of this computer"));
}

TEST(LivePage, APortIsFreeAgainAtOnce) {
  int port = 0;
  {
    LivePage page(capture_setup(), {});
    port = port_of(page);
    EXPECT_FALSE(snapshot_of(page).contains("newest"));
  }
  EXPECT_FALSE(snapshot_of(LivePage(capture_setup(), {"127.0.0.1", port, ""})).contains("newest"));
}

// A server that answers POST with the size of the body, and the start of a request to it.
class PostedBodies : public testing::Test {
 protected:
  static constexpr size_t kMost = 40000;  // more than fits into a header

  // Sends a header without the body, which the server must not wait for, and returns the status line.
  static std::string refusal_of(const tools::PageServer& server, const std::string& path, const std::string& headers) {
    const std::string request = "POST " + path + " HTTP/1.1\r\nHost: 127.0.0.1\r\n" + headers + "\r\n";
    const std::string answer = NonReadingClient(server.access().port, request).rest();
    return answer.substr(0, answer.find('\r'));
  }
  httplib::Result post(const std::string& path, const std::string& body) const {
    return httplib::Client("127.0.0.1", server_.access().port).Post(path, body, "model/stl");
  }
  static tools::PageServer server_with(const std::string& token) {
    return tools::PageServer({"127.0.0.1", 0, token}, "--live", answer, {.posts = true, .most_body_bytes = kMost});
  }

  tools::PageServer server_ = server_with("");

 private:
  static tools::PageAnswer answer(const tools::PageRequest& request) {
    return tools::PageAnswer::of(std::to_string(request.body.size()), "text/plain");
  }
};

TEST_F(PostedBodies, OfAStatedSizeAreRead) {
  for (const size_t bytes : {size_t{0}, size_t{1}, kMost}) {
    const auto answer = post("/mesh", std::string(bytes, 'x'));
    ASSERT_TRUE(answer);
    EXPECT_EQ(answer->status, 200);
    EXPECT_EQ(answer->body, std::to_string(bytes));
  }
}

TEST_F(PostedBodies, OfAnUnknownSizeAreRefusedUnread) {
  for (const char* coding : {"gzip", "br", "deflate", "identity"})
    EXPECT_THAT(refusal_of(server_, "/mesh", std::string("Content-Length: 9\r\ncontent-encoding: ") + coding + "\r\n"),
                StartsWith("HTTP/1.1 415"))
        << coding;
  for (const char* type : {"multipart/form-data; boundary=x", "multipart/form-data;boundary=\"x\""})
    EXPECT_THAT(refusal_of(server_, "/mesh", std::string("Content-Length: 9\r\nContent-Type: ") + type + "\r\n"),
                StartsWith("HTTP/1.1 415"))
        << type;
  for (const char* headers : {"", "Content-Length:\r\n", "Content-Length: x\r\n", "Content-Length: -1\r\n",
                              "Content-Length: 1e3\r\n", "Transfer-Encoding: chunked\r\n",
                              "Content-Length: 9\r\ntransfer-encoding: chunked\r\n", "Transfer-Encoding: gzip\r\n"})
    EXPECT_THAT(refusal_of(server_, "/mesh", headers), StartsWith("HTTP/1.1 411")) << headers;
  for (const std::string& bytes : {std::to_string(kMost + 1), std::string("18446744073709551615")})
    EXPECT_THAT(refusal_of(server_, "/mesh", "Content-Length: " + bytes + "\r\n"), StartsWith("HTTP/1.1 413")) << bytes;
  EXPECT_EQ(post("/mesh", "still served")->body, "12");
}

TEST_F(PostedBodies, RequireTheTokenOnEveryPath) {
  const tools::PageServer server = server_with(kToken);
  for (const char* path : {"/", "/mesh"})
    EXPECT_THAT(refusal_of(server, path, "Content-Length: 9\r\n"), StartsWith("HTTP/1.1 401")) << path;
  EXPECT_THAT(refusal_of(server, "/", std::string("Content-Length: 0\r\nAuthorization: Bearer ") + kToken + "\r\n"),
              StartsWith("HTTP/1.1 200"));
}

}  // namespace
}  // namespace fringeslam
