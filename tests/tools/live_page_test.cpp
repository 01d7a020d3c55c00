// SPDX-License-Identifier: Apache-2.0
// The page of live previews over HTTP, as a browser asks for it.
#include "tools/live/live_page.h"

#include <arpa/inet.h>
#include <gmock/gmock.h>
#include <httplib.h>
#include <sys/socket.h>
#include <unistd.h>

#include <chrono>
#include <deque>
#include <nlohmann/json.hpp>

#include "core/rig/files.h"
#include "tests/support/fringes.h"
#include "tests/support/matchers.h"
#include "tests/support/temp_folder.h"
#include "tests/tools/fake_rig.h"

namespace fringeslam {
namespace {

using nlohmann::json;
using support::error_of;
using test::TempFolder;
using testing::AllOf;
using testing::HasSubstr;
using testing::Not;
using testing::StartsWith;
using tools::LivePage;

int port_of(const LivePage& page) {
  const std::string url = page.url();
  EXPECT_THAT(url, AllOf(StartsWith("http://127.0.0.1:"), testing::EndsWith("/")));
  return std::stoi(url.substr(std::string("http://127.0.0.1:").size()));
}

// A connection that sends some bytes and reads nothing.
class SilentViewer {
 public:
  SilentViewer(int port, const std::string& bytes) : socket_(socket(AF_INET, SOCK_STREAM, 0)) {
    // Little room, so that an answer does not fit into it.
    const int room = 2048;
    setsockopt(socket_, SOL_SOCKET, SO_RCVBUF, &room, sizeof room);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(static_cast<uint16_t>(port));
    inet_pton(AF_INET, "127.0.0.1", &address.sin_addr);
    EXPECT_EQ(connect(socket_, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
    EXPECT_EQ(send(socket_, bytes.data(), bytes.size(), MSG_NOSIGNAL), static_cast<ssize_t>(bytes.size()));
  }
  ~SilentViewer() { close(socket_); }
  SilentViewer(const SilentViewer&) = delete;
  SilentViewer& operator=(const SilentViewer&) = delete;

  // Until an answer has begun to come.
  void await_answer() const {
    char byte = 0;
    EXPECT_EQ(recv(socket_, &byte, 1, MSG_PEEK), 1);
  }

  // What comes until the other side ends the connection.
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

int status_of(const LivePage& page, const std::string& path) {
  const auto answer = get(page, path);
  return answer ? answer->status : -1;
}

json state_of(const LivePage& page) {
  const auto answer = get(page, "/state.json");
  return answer ? json::parse(answer->body) : json("no answer");
}

// Fringes along a ramp of coordinates: of no scene, but light.
FringeStack stack(double modulation_dn) {
  const RigModel rig = test::tiny_rig();
  cv::Mat1d coordinate_px(rig.camera.height, rig.camera.width);
  for (int row = 0; row < coordinate_px.rows; ++row)
    support::ramp(300, 700, rig.camera.width).copyTo(coordinate_px.row(row));
  return support::fringe_stack(coordinate_px, test::short_sequence(), {.mean_dn = 120, .modulation_dn = modulation_dn},
                               CV_8UC1);
}

class LivePageTest : public testing::Test {
 protected:
  LivePage page_{test::short_sequence(), test::tiny_rig(), 0};
};

TEST_F(LivePageTest, BeforeTheFirstStackThereIsNoPicture) {
  EXPECT_EQ(state_of(page_)["number"], 0);
  EXPECT_EQ(status_of(page_, "/preview/texture.png"), 404);
}

TEST_F(LivePageTest, StateIsOfTheNewestStack) {
  for (int number = 1; number <= 3; ++number) {
    const double modulation_dn = 20.0 * number;
    page_.show(stack(modulation_dn));
    const json now = state_of(page_);
    EXPECT_EQ(now["number"], number);
    EXPECT_EQ(now["rig"], "thesis");
    EXPECT_NEAR(now["mean_modulation_dn"].get<double>(), modulation_dn, 0.5);
    EXPECT_EQ(now["saturated"], 0);
    EXPECT_EQ(now["full_scale_dn"], 255);
    EXPECT_EQ(now["stacks_per_s"] > 0, number > 1);
    EXPECT_TRUE(now["warnings"].is_array());
  }
  // Of several that come while nobody looks the last is left.
  for (int i = 0; i < 5; ++i) page_.show(stack(70 + i));
  const json now = state_of(page_);
  EXPECT_EQ(now["number"], 8);
  EXPECT_NEAR(now["mean_modulation_dn"].get<double>(), 74, 0.5);
}

TEST_F(LivePageTest, WarningsArePassedOn) {
  page_.show(stack(140));  // 260 at its crests
  const json now = state_of(page_);
  EXPECT_GT(now["saturated"], 0.01);
  EXPECT_THAT(now["warnings"].dump(), HasSubstr("saturated"));
}

TEST_F(LivePageTest, PicturesAreOfTheCamerasSize) {
  page_.show(stack(90));
  const TempFolder folder;
  for (const std::string name : {"texture", "modulation", "saturation", "depth"}) {
    const auto answer = get(page_, "/preview/" + name + ".png?n=1");
    ASSERT_TRUE(answer) << name;
    EXPECT_EQ(answer->status, 200);
    EXPECT_EQ(answer->get_header_value("Content-Type"), "image/png");
    test::write_bytes(folder / (name + ".png"), answer->body);
    const cv::Mat picture = read_as_grey(folder / (name + ".png"), GreyFrom::red);
    EXPECT_EQ(picture.size(), cv::Size(test::tiny_rig().camera.width, test::tiny_rig().camera.height)) << name;
  }
  EXPECT_NEAR(cv::mean(read_as_grey(folder / "texture.png", GreyFrom::red))[0], 255 * 120 / (0.6 * 255), 2);
  EXPECT_NEAR(cv::mean(read_as_grey(folder / "modulation.png", GreyFrom::red))[0], 255 * 90 / 127.5, 2);
  // Another stack, another picture.
  page_.show(stack(45));
  const auto later = get(page_, "/preview/modulation.png?n=2");
  ASSERT_TRUE(later);
  test::write_bytes(folder / "later.png", later->body);
  EXPECT_NEAR(cv::mean(read_as_grey(folder / "later.png", GreyFrom::red))[0], 255 * 45 / 127.5, 2);
}

TEST_F(LivePageTest, ThePageNeedsNothingFromElsewhere) {
  const auto answer = get(page_, "/");
  ASSERT_TRUE(answer);
  EXPECT_EQ(answer->status, 200);
  EXPECT_THAT(answer->get_header_value("Content-Type"), StartsWith("text/html"));
  EXPECT_THAT(answer->body, AllOf(HasSubstr("<html lang=\"en\">"), HasSubstr("name=\"viewport\""),
                                  HasSubstr("prefers-color-scheme: dark"), HasSubstr("/state.json")));
  EXPECT_THAT(answer->body, AllOf(Not(HasSubstr("http:")), Not(HasSubstr("https:")), Not(HasSubstr("src=\"//"))));
  EXPECT_THAT(answer->get_header_value("Content-Security-Policy"), StartsWith("default-src 'none'"));
}

TEST_F(LivePageTest, NothingElseIsServed) {
  page_.show(stack(90));
  for (const char* path :
       {"/index.html", "/preview/", "/preview/texture", "/preview/texture.png/", "/previewXtexture.png", "/stateXjson",
        "/../etc/passwd", "/preview/../../../etc/passwd", "/%2e%2e/etc/passwd", "//etc/passwd"})
    EXPECT_EQ(status_of(page_, path), 404) << path;
  const auto posted =
      httplib::Client("127.0.0.1", port_of(page_)).Post("/state.json", std::string(100000, 'x'), "text/plain");
  EXPECT_TRUE(!posted || posted->status == 405);
  const auto parts = get(page_, "/preview/texture.png", {{"Range", "bytes=0-9,0-9,0-9"}});
  EXPECT_TRUE(!parts || parts->status == 416);
  EXPECT_EQ(status_of(page_, "/state.json"), 200);
}

TEST_F(LivePageTest, RequestsAreBounded) {
  EXPECT_EQ(status_of(page_, "/state.json?" + std::string(10000, 'x')), 414);
  // Headers without end: the connection ends before them.
  std::string headers = "GET /state.json HTTP/1.1\r\n";
  for (int i = 0; i < 2000; ++i) headers += "X-" + std::to_string(i) + ": y\r\n";
  headers += "\r\n";
  EXPECT_THAT(SilentViewer(port_of(page_), headers).rest(), Not(HasSubstr("200 OK")));
  EXPECT_EQ(status_of(page_, "/state.json"), 200);
}

TEST(LivePage, ViewersWhoDoNotReadHoldUpNobody) {
  const PatternSequence fine = phase_shift_sequence(1024, 768, {16}, 3, Axis::columns, 8);
  // Of a camera with so many pixels that a picture is larger than what a connection takes without a reader.
  RigModel rig = test::thesis_rig();
  rig.camera.width = 2400;
  rig.camera.height = 2000;
  FringeStack noise;
  cv::RNG random(3);
  for (size_t i = 0; i < fine.patterns.size(); ++i) {
    cv::Mat1b image(rig.camera.height, rig.camera.width);
    random.fill(image, cv::RNG::UNIFORM, 0, 240);
    noise.images.push_back(image);
    noise.exposure_s.push_back(0.01);
  }
  auto page = std::make_unique<LivePage>(fine, rig, 0);
  page->show(noise);
  const auto picture = get(*page, "/preview/saturation.png");
  ASSERT_TRUE(picture);
  ASSERT_GT(picture->body.size(), 4'500'000u);
  std::deque<SilentViewer> silent;
  for (int i = 0; i < 3; ++i) {
    silent.emplace_back(port_of(*page), "GET /preview/saturation.png HTTP/1.1\r\nHost: here\r\n\r\n");
    silent.back().await_answer();
  }
  // Whoever waits for one of them waits for 20 s.
  using Clock = std::chrono::steady_clock;
  Clock::time_point begin = Clock::now();
  for (int i = 0; i < 1000; ++i) page->show(noise);
  EXPECT_LT(Clock::now() - begin, std::chrono::seconds(10));
  EXPECT_EQ(state_of(*page)["number"], 1001);
  begin = Clock::now();
  page.reset();
  EXPECT_LT(Clock::now() - begin, std::chrono::seconds(10));
}

TEST(LivePage, ATakenPortIsOneClearError) {
  const LivePage first(test::short_sequence(), test::tiny_rig(), 0);
  const std::string port = std::to_string(port_of(first));
  EXPECT_EQ(error_of([&] { LivePage(test::short_sequence(), test::tiny_rig(), port_of(first)); }),
            "live: port " + port +
                " is taken or not allowed; choose another by --live PORT, or --live 0 for one that is free");
  EXPECT_EQ(state_of(first)["number"], 0);
}

TEST(LivePage, APortIsFreeAgainAtOnce) {
  int port = 0;
  {
    LivePage page(test::short_sequence(), test::tiny_rig(), 0);
    port = port_of(page);
    EXPECT_EQ(state_of(page)["number"], 0);
  }
  EXPECT_EQ(state_of(LivePage(test::short_sequence(), test::tiny_rig(), port))["number"], 0);
}

TEST(LivePage, NobodyBeyondThisComputerIsServed) {
  const LivePage page(test::short_sequence(), test::tiny_rig(), 0);
  // The whole of 127.0.0.0/8 is this computer; a page that listens on every address would answer here, too.
  httplib::Client elsewhere("127.0.0.2", port_of(page));
  EXPECT_FALSE(elsewhere.Get("/state.json"));
}

}  // namespace
}  // namespace fringeslam
