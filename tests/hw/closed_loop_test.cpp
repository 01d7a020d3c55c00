// SPDX-License-Identifier: Apache-2.0
// Tests the complete hardware backend without a device: a full-screen window under Xvfb and, in another process, a GigE
// Vision camera on the loopback interface that views a simulated scene lit by the contents of that display.
#include <fcntl.h>
#include <gmock/gmock.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>
#include <thread>

#include "core/decode/decode.h"
#include "core/depth/depth.h"
#include "core/score/score.h"
#include "hw/rig_hardware.h"
#include "sim/virtual_rig.h"
#include "tests/hw/desktop.h"
#include "tests/support/matchers.h"
#include "tests/tools/child.h"
#include "tools/focus_reading.h"
#include "tools/live/preview.h"

// After Eigen, some of whose names are macros in the system headers included here.
#include <httplib.h>

namespace fringeslam {
namespace {

using support::error_of;
using test::TempFolder;
namespace fs = std::filesystem;
using testing::HasSubstr;

template <class Done>
bool wait_until(double seconds, const Done& done) {
  for (int i = 0; i < seconds * 50; ++i) {
    if (done()) return true;
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  return done();
}

// A child process that is killed on destruction.
class Child {
 public:
  explicit Child(const std::vector<std::string>& command, const fs::path& log) {
    pid_ = fork();
    if (pid_ != 0) return;
    const int file = open(log.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0644);
    dup2(file, 1);
    dup2(file, 2);
    std::vector<char*> words;
    for (const std::string& word : command) words.push_back(const_cast<char*>(word.c_str()));
    words.push_back(nullptr);
    execvp(words[0], words.data());
    _exit(127);
  }
  ~Child() { stop(SIGKILL); }
  Child(const Child&) = delete;
  Child& operator=(const Child&) = delete;

  void send(int signal_number) const {
    if (pid_ > 0) kill(pid_, signal_number);
  }
  // Exit code, or 128 + signal number.
  int stop(int signal_number) {
    send(signal_number);
    return wait();
  }
  int wait() {
    if (pid_ <= 0) return -1;
    int status = 0;
    waitpid(pid_, &status, 0);
    return ended(status);
  }
  // -1 if it still runs.
  int wait_for(double seconds) {
    int status = 0;
    return wait_until(seconds, [&] { return waitpid(pid_, &status, WNOHANG) != 0; }) ? ended(status) : -1;
  }

 private:
  int ended(int status) {
    pid_ = -1;
    return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  }

  pid_t pid_ = -1;
};

// All tests share one display; each has its own camera.
class ClosedLoop : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = new TempFolder;
    const fs::path& at = folder_->path();
    test::write_small_scene(at);
    const RigModel rig = read_rig(at / "rig.yaml");
    test::write_bytes(at / "rig.yaml",
                      to_yaml(rig) + "hardware: {settle_s: 0.01, camera: {timeout_s: 5, reopen_s: 6, attempts: 4}}\n");
    fs::create_directories(at / "screen");
    for (int number = 90; number < 130; ++number) {
      const std::string display = ":" + std::to_string(number);
      xvfb_ = new Child(
          {"Xvfb", display, "-screen", "0", "1024x768x24", "-fbdir", (at / "screen").string(), "-nocursor", "-noreset"},
          at / "xvfb.log");
      const fs::path socket = "/tmp/.X11-unix/X" + std::to_string(number);
      std::this_thread::sleep_for(std::chrono::milliseconds(300));
      if (wait_until(3, [&] { return fs::exists(socket) && fs::exists(framebuffer()); })) {
        setenv("DISPLAY", display.c_str(), 1);
        return;
      }
      delete xvfb_;  // the display number is taken
      xvfb_ = nullptr;
    }
  }
  static void TearDownTestSuite() {
    delete xvfb_;
    delete folder_;
  }

  void SetUp() override {
    ASSERT_TRUE(xvfb_) << "no display: is xvfb installed?";
    control("");
    start_camera();
  }

  static fs::path framebuffer() { return folder_->path() / "screen" / "Xvfb_screen0"; }
  fs::path at(const std::string& name) const { return *folder_ / name; }
  void control(const std::string& words) const { test::write_bytes(at("control"), words); }

  void start_camera(const std::string& scene = "scene.yaml") {
    camera_.reset();
    fs::remove(at("camera.log"));
    camera_ = std::make_unique<Child>(
        std::vector<std::string>{FRINGESLAM_FAKE_CAMERA, "T1", at(scene), framebuffer(), at("control")},
        at("camera.log"));
    ASSERT_TRUE(wait_until(20, [&] { return log_of("camera").find("ready") != std::string::npos; }))
        << log_of("camera");
  }

  std::string log_of(const std::string& who) const {
    return fs::exists(at(who + ".log")) ? test::read_bytes(at(who + ".log")) : "";
  }

  static PatternSequence sequence() { return phase_shift_sequence(1024, 768, {1040, 131, 16.5}, 3, Axis::columns, 8); }

  // The images rendered by the simulator.
  const FringeStack& simulated() const {
    static const FringeStack stack = [&] {
      const sim::Scene scene = sim::load_scene(at("scene.yaml"));
      sim::RenderOptions options;
      options.noise = false;
      return *sim::VirtualRig(scene, options).capture(sequence());
    }();
    return stack;
  }

  void expect_right(const FringeStack& stack) const {
    ASSERT_EQ(stack.images.size(), simulated().images.size());
    for (size_t i = 0; i < stack.images.size(); ++i)
      EXPECT_LE(cv::norm(stack.images[i], simulated().images[i], cv::NORM_INF), 1) << "image " << i;
  }

  // Writes the rig file with another `hardware:` section.
  fs::path rig_with(const std::string& hardware) const {
    test::write_bytes(at("other.yaml"), to_yaml(read_rig(at("rig.yaml"))) + "hardware: " + hardware + "\n");
    return at("other.yaml");
  }

  Child program(const std::vector<std::string>& arguments) const {
    std::vector<std::string> command = {FRINGESLAM_PROGRAM};
    command.insert(command.end(), arguments.begin(), arguments.end());
    fs::remove(at("program.log"));  // the child creates it later
    return Child(command, at("program.log"));
  }

  static inline TempFolder* folder_ = nullptr;
  static inline Child* xvfb_ = nullptr;
  std::unique_ptr<Child> camera_;
};

TEST_F(ClosedLoop, DepthIsThatOfTheSimulator) {
  const auto rig = open_hardware(at("rig.yaml"));
  const auto stack = rig->capture(sequence());
  EXPECT_EQ(rig->retaken(), 0);
  expect_right(*stack);
  const auto frame_of = [&](const FringeStack& images) {
    return reconstruct(decode(images, rig->model(), {}), rig->model(), pixel_rays(rig->model().camera), {});
  };
  const Frame captured = frame_of(*stack), expected = frame_of(simulated());
  std::vector<double> off;
  for (int row = 0; row < expected.height(); ++row) {
    for (int col = 0; col < expected.width(); ++col) {
      if (expected.valid(row, col) && captured.valid(row, col))
        off.push_back(std::abs(captured.points_m(row, col)[2] - expected.points_m(row, col)[2]) /
                      static_cast<double>(expected.sigma_m(row, col)));
    }
  }
  EXPECT_GT(off.size(), 20000u);
  EXPECT_LT(median_of(off), 0.25) << "sigmas";
}

TEST_F(ClosedLoop, EachPatternIsTakenAtItsExposures) {
  SequenceDesign design;
  design.width = 1024;
  design.height = 768;
  design.periods_px = {1040, 131, 16.5};
  design.exposures = {1, 0.25};
  const PatternSequence exposures = design_sequence(design);
  const sim::Scene scene = sim::load_scene(at("scene.yaml"));
  sim::RenderOptions options;
  options.noise = false;
  const FringeStack expected = *sim::VirtualRig(scene, options).capture(exposures);
  const auto rig = open_hardware(at("rig.yaml"));
  const auto stack = rig->capture(exposures);
  ASSERT_EQ(stack->images.size(), 18u);
  for (size_t i = 0; i < stack->images.size(); ++i) {
    EXPECT_NEAR(stack->exposure_s[i], expected.exposure_s[i], 1e-6) << i;
    EXPECT_LE(cv::norm(stack->images[i], expected.images[i], cv::NORM_INF), 1) << i;
  }
  // Dropped patterns are noticed, and the camera returns to the rig's exposure. Every other image shows a new pattern.
  for (const int image : {6, 8, 12}) {
    const int before = rig->retaken();
    control("fault repeat " + std::to_string(image));
    rig->capture(exposures);
    EXPECT_EQ(rig->retaken(), before + 1) << "image " << image;
    control("");
  }
  expect_right(*rig->capture(sequence()));
}

// Eight times the exposure that suits the scene saturates the images, so that they do not even show the patterns.
TEST_F(ClosedLoop, CaptureFindsTheExposureItself) {
  const double exposure_s = read_rig(at("rig.yaml")).timing.exposure_s;
  const fs::path rig = rig_with("{settle_s: 0.01, camera: {exposure_s: " + std::to_string(8 * exposure_s) + "}}");
  test::write_bytes(at("patterns.yaml"), to_yaml(sequence()));
  const std::vector<std::string> command = {
      "capture", "--rig", rig.string(), "--out", at("exposed").string(), "--patterns", at("patterns.yaml").string()};
  Child saturated = program(command);
  EXPECT_EQ(saturated.wait(), 2);
  EXPECT_THAT(log_of("program"), HasSubstr("no valid sequence in 3 attempts"));
  std::vector<std::string> with_look = command;
  with_look.push_back("--auto-exposure");
  Child capture = program(with_look);
  ASSERT_EQ(capture.wait(), 0) << log_of("program");
  EXPECT_THAT(log_of("program"), HasSubstr("exposures: "));
  ReplayRig replay(at("exposed"));
  const auto decoded_px = [&](const FringeStack& stack) {
    return cv::countNonZero(decode(stack, replay.model(), {}).fringe_order >= 0);
  };
  EXPECT_GT(decoded_px(*replay.capture(replay.sequence())), 0.97 * decoded_px(simulated()));
}

TEST_F(ClosedLoop, AnUnsupportedExposureIsRefusedAndTheEarlierOneKept) {
  const auto rig = open_hardware(at("rig.yaml"));
  const double exposure_s = rig->camera().exposure_s();
  for (const double factor : {1e-6, 1e6}) {
    EXPECT_THAT(error_of([&] { rig->scale_exposure(factor); }), HasSubstr("Aravis-Fake-T1 supports exposures from "));
    EXPECT_EQ(rig->camera().exposure_s(), exposure_s);
  }
  expect_right(*rig->capture(sequence()));
  EXPECT_EQ(rig->camera().statistics().reopened, 0u);
}

TEST_F(ClosedLoop, LostPacketsCostTimeAndNoImage) {
  for (const char* ratio : {"0.005", "0.02"}) {
    control(std::string("lost ") + ratio);
    // The fake camera does not resend packets; at 2 % loss, one in three images arrives complete (49 packets).
    const auto rig = open_hardware(rig_with("{settle_s: 0.01, camera: {attempts: 40}}"));
    expect_right(*rig->capture(sequence()));
    const CameraStatistics statistics = rig->camera().statistics();
    RecordProperty(std::string("lost ") + ratio, std::to_string(statistics.resent_packets) + " resent, " +
                                                     std::to_string(statistics.refused) + " images taken again");
  }
}

TEST_F(ClosedLoop, APatternThatTheProjectorDropsIsTakenAgain) {
  for (const int image : {1, 3, 6, 10}) {
    const auto rig = open_hardware(at("rig.yaml"));
    control("fault repeat " + std::to_string(image));
    expect_right(*rig->capture(sequence()));
    EXPECT_EQ(rig->retaken(), 1) << "image " << image;
    control("");
  }
}

// The projector's response is unknown when a rig is checked for the first time.
TEST_F(ClosedLoop, AProjectorWhoseLightIsNotLinearIsCheckedAsWell) {
  std::string scene = test::read_bytes(at("scene.yaml"));
  scene.insert(scene.find("file: rig.yaml"), "projector: {gamma: 2.2}\n  ");
  test::write_bytes(at("bent_scene.yaml"), scene);
  start_camera("bent_scene.yaml");

  Child check = program({"rig", "check", "--rig", at("rig.yaml"), "--json"});
  ASSERT_EQ(check.wait(), 0) << log_of("program");
  const nlohmann::json said = nlohmann::json::parse(log_of("program"));
  EXPECT_NEAR(said["gamma"], 2.2, 0.1);
  EXPECT_EQ(said["sequences_retaken"], 0);
  EXPECT_EQ(said["advice"]["nonlinear"], true);

  Child focus = program({"rig", "focus", "--rig", at("rig.yaml"), "--count", "1"});
  EXPECT_EQ(focus.wait(), 0) << log_of("program");

  const auto rig = open_hardware(at("rig.yaml"));
  for (const int image : {1, 4, 7}) {
    control("fault repeat " + std::to_string(image));
    rig->capture(sequence());
    EXPECT_EQ(rig->retaken(), 1 + (image - 1) / 3) << "image " << image;
    control("");
  }
}

TEST_F(ClosedLoop, ExposuresThatNobodyAskedForAreTakenAfterTheyBegan) {
  const auto rig = open_hardware(rig_with("{settle_s: 0.01, camera: {trigger: free}}"));
  expect_right(*rig->capture(sequence()));
}

// The camera is free-running, and each exposure sees the next channel of the display, as with a projector that shows
// the channels one after another and triggers the camera.
TEST_F(ClosedLoop, PackedPatternsOfAProjectorThatStepsByItself) {
  for (const std::string packing : {"RGB", "BGR"}) {
    control("packed " + packing);
    const auto rig =
        open_hardware(rig_with("{settle_s: 0.01, camera: {trigger: free}, projector: {packing: " + packing + "}}"));
    expect_right(*rig->capture(sequence()));
    const PatternSequence uneven = phase_shift_sequence(1024, 768, {1040}, 4, Axis::columns, 8);
    const auto stack = rig->capture(uneven);  // the last frame is incomplete
    ASSERT_EQ(stack->images.size(), 4u);
    cv::Mat opposite = stack->images[0] + stack->images[2], other = stack->images[1] + stack->images[3];
    EXPECT_LE(cv::norm(opposite, other, cv::NORM_INF), 4) << "cos + cos(. + pi) = 0";
  }
}

// The image shown before the sequence must not pass for its first bit.
TEST_F(ClosedLoop, ADroppedFirstBitOfAGrayCodeIsNoticed) {
  SequenceDesign design;
  design.width = 1024;
  design.height = 768;
  design.gray_cell_px = 32;
  const PatternSequence bits = design_sequence(design);
  ASSERT_EQ(bits.patterns.front().coding, Coding::gray);
  const auto rig = open_hardware(at("rig.yaml"));
  const auto expected = rig->capture(bits);
  ASSERT_EQ(rig->retaken(), 0);
  control("fault repeat 3");  // after white, black and the level between them
  const auto stack = rig->capture(bits);
  EXPECT_EQ(rig->retaken(), 1);
  for (size_t i = 0; i < bits.patterns.size(); ++i)
    EXPECT_LE(cv::norm(stack->images[i], expected->images[i], cv::NORM_INF), 1) << "image " << i;
}

TEST_F(ClosedLoop, AnExposureLongerThanAPackedPatternIsRefused) {
  const auto rig =
      open_hardware(rig_with("{settle_s: 0.01, camera: {trigger: free, exposure_s: 0.03}, projector: {packing: RGB}}"));
  EXPECT_THAT(error_of([&] { (void)rig->capture(sequence()); }),
              HasSubstr("the exposure of 30 ms is longer than the "));
}

TEST_F(ClosedLoop, AMissedExposureOfPackedPatternsIsNoticed) {
  const auto rig =
      open_hardware(rig_with("{settle_s: 0.01, attempts: 5, camera: {trigger: free}, projector: {packing: RGB}}"));
  for (const int exposure : {12, 20, 28}) {
    control("packed RGB fault missed " + std::to_string(exposure));
    expect_right(*rig->capture(sequence()));
  }
  // The number of exposures before the sequence depends on timing; at least one of the three faults falls within it.
  EXPECT_GE(rig->retaken(), 1);
}

TEST_F(ClosedLoop, AWindowThatWasMovedIsRefused) {
  const auto rig = open_hardware(at("rig.yaml"));
  expect_right(*rig->capture(sequence()));
  ASSERT_TRUE(test::move_window("FringeSLAM", 300, 0));
  EXPECT_THAT(error_of([&] { (void)rig->capture(sequence()); }),
              HasSubstr("the window is at (300, 0) of the desktop and does not fill display 0"));
}

TEST_F(ClosedLoop, ACameraThatComesBackGoesOn) {
  const auto rig = open_hardware(at("rig.yaml"));
  expect_right(*rig->capture(sequence()));
  std::thread again([&] {
    std::this_thread::sleep_for(std::chrono::milliseconds(300));
    camera_->stop(SIGKILL);
    std::this_thread::sleep_for(std::chrono::milliseconds(500));
    start_camera();
  });
  const auto stack = rig->capture(sequence());
  again.join();
  expect_right(*stack);
  expect_right(*rig->capture(sequence()));
  EXPECT_GE(rig->camera().statistics().reopened, 1u);
}

TEST_F(ClosedLoop, ACameraThatIsGoneIsNamed) {
  const auto rig = open_hardware(at("rig.yaml"));
  camera_->stop(SIGKILL);
  EXPECT_THAT(error_of([&] { (void)rig->capture(sequence()); }),
              HasSubstr("Aravis-Fake-T1 was lost and did not reconnect within 6 s"));
}

// Every packet may be changed, replies to commands included. FRINGESLAM_HOSTILE_CAMERAS sets the number of cameras.
TEST_F(ClosedLoop, ACameraThatSendsNonsenseDoesNoHarm) {
  const char* wanted = std::getenv("FRINGESLAM_HOSTILE_CAMERAS");
  const int count = wanted ? std::atoi(wanted) : 6;
  const fs::path rig = rig_with("{settle_s: 0.01, camera: {timeout_s: 0.3, reopen_s: 1, attempts: 3}}");
  int datasets = 0;
  for (int seed = 1; seed <= count; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    const char* shares[] = {"0.001", "0.01", "0.1"};
    control("corrupt " + std::string(shares[seed % 3]) + " " + std::to_string(seed));
    start_camera();
    const fs::path out = at("hostile" + std::to_string(seed));
    Child capture = program({"capture", "--rig", rig, "--out", out, "--count", "2"});
    const int code = capture.wait_for(120);
    ASSERT_THAT(code, testing::AnyOf(0, 2)) << log_of("program");
    if (code == 0) {
      ++datasets;
      ReplayRig replay(out);
      for (int i = 0; i < 2; ++i) EXPECT_TRUE(replay.capture(replay.sequence()));
    } else {
      EXPECT_THAT(log_of("program"), testing::ContainsRegex("(^|\n)fringeslam: [^\n]*camera[^\n]*\n$"));
    }
  }
  RecordProperty("datasets", datasets);
}

TEST_F(ClosedLoop, ASlowCameraIsWaitedForButNotForEver) {
  const auto rig = open_hardware(rig_with("{settle_s: 0.01, camera: {timeout_s: 1.5, attempts: 4}}"));
  control("delay_ms 200");
  PatternSequence coarse = sequence();
  coarse.patterns.resize(3);
  const auto stack = rig->capture(coarse);
  for (size_t i = 0; i < 3; ++i)
    EXPECT_LE(cv::norm(stack->images[i], simulated().images[i], cv::NORM_INF), 1) << "image " << i;
  control("delay_ms 4000");
  EXPECT_THAT(error_of([&] { (void)rig->capture(coarse); }), HasSubstr("no complete image from Aravis-Fake-T1"));
}

TEST_F(ClosedLoop, OnlyOneProgramControlsACamera) {
  const auto rig = open_hardware(at("rig.yaml"));
  Child second = program({"rig", "check", "--rig", at("rig.yaml")});
  EXPECT_EQ(second.wait(), 2);
  EXPECT_THAT(log_of("program"), HasSubstr("controlled by another program"));
}

TEST_F(ClosedLoop, UnsupportedCameraSettingsAreReported) {
  const auto opened_with = [&](const std::string& hardware) {
    return error_of([&] { (void)open_hardware(rig_with(hardware)); });
  };
  EXPECT_THAT(opened_with("{camera: {pixel_format: Mono12p}}"), HasSubstr("has 12 bits, but camera.sensor.bits is 8"));
  EXPECT_THAT(opened_with("{camera: {pixel_format: Mono88}}"), HasSubstr("did you mean 'Mono8'"));
  EXPECT_THAT(opened_with("{camera: {id: nobody}}"), HasSubstr("no camera 'nobody'; found: Aravis-Fake-T1"));
  EXPECT_THAT(opened_with("{camera: {offset_px: [3000, 0]}}"), HasSubstr("camera: "));
  EXPECT_THAT(opened_with("{camera: {exposure_s: 59}}"), HasSubstr("camera: "));
  EXPECT_THAT(opened_with("{projector: {display: 3}}"), HasSubstr("no display 3"));
  EXPECT_THAT(opened_with("{projector: {packing: RGBW}}"), HasSubstr("RGBW"));
  EXPECT_THAT(opened_with("{projector: {packing: RGB}}"), HasSubstr("set camera.trigger to the input line"));
  EXPECT_THAT(opened_with("{projector: {dlpc350: {}}}"), HasSubstr("not found on USB"));
  EXPECT_THAT(opened_with("{camera: {exposure: 1}}"), HasSubstr("unknown key 'exposure'"));
  // None of these failures keeps the rig from being opened.
  EXPECT_NO_THROW((void)open_hardware(at("rig.yaml")));
}

TEST_F(ClosedLoop, WithoutADesktopNothingIsShown) {
  Child nowhere({"env", "DISPLAY=:4711", FRINGESLAM_PROGRAM, "rig", "check", "--rig", at("rig.yaml")},
                at("program.log"));
  EXPECT_EQ(nowhere.wait(), 2);
  EXPECT_THAT(log_of("program"), HasSubstr("no desktop to show a window on"));
}

TEST_F(ClosedLoop, ADisplayOfAnotherSizeIsRefused) {
  RigModel rig = read_rig(at("rig.yaml"));
  rig.projector.width = 912;
  test::write_bytes(at("wrong.yaml"), to_yaml(rig) + "hardware: {}\n");
  EXPECT_THAT(error_of([&] { (void)open_hardware(at("wrong.yaml")); }),
              HasSubstr("display 0 has 1024x768 px, but the rig's projector has 912x768 px"));
}

int stacks_in(const fs::path& dataset) {
  return fs::exists(dataset / kDatasetFile) ? read_dataset_info(dataset).stacks : 0;
}

TEST_F(ClosedLoop, AKilledCaptureLeavesWhatItHad) {
  Child capture = program({"capture", "--rig", at("rig.yaml"), "--out", at("killed"), "--count", "50"});
  ASSERT_TRUE(wait_until(60, [&] { return stacks_in(at("killed")) >= 2; })) << log_of("program");
  std::this_thread::sleep_for(std::chrono::milliseconds(700));
  capture.stop(SIGKILL);
  ReplayRig replay(at("killed"));
  const int stacks = replay.info().stacks;
  EXPECT_GE(stacks, 2);
  for (int i = 0; i < stacks; ++i) EXPECT_TRUE(replay.capture(replay.sequence()).has_value()) << i;
}

TEST_F(ClosedLoop, AnInterruptedCaptureIsADataset) {
  Child capture = program({"capture", "--rig", at("rig.yaml"), "--out", at("interrupted"), "--count", "50"});
  ASSERT_TRUE(wait_until(60, [&] { return stacks_in(at("interrupted")) >= 1; })) << log_of("program");
  EXPECT_EQ(capture.stop(SIGINT), 0);
  EXPECT_THAT(log_of("program"), HasSubstr("interrupted"));
  const int stacks = stacks_in(at("interrupted"));
  EXPECT_GE(stacks, 1);
  EXPECT_LT(stacks, 50);
  EXPECT_EQ(std::distance(fs::directory_iterator(at("interrupted/stacks")), fs::directory_iterator()), stacks);
}

// A bag appears at the end, after Ctrl-C while the command of --before runs, too, and becomes a dataset of the same images.
TEST_F(ClosedLoop, ACaptureIntoABagIsImported) {
  test::write_bytes(at("patterns.yaml"), to_yaml(sequence()));
  Child capture = program({"capture", "--rig", at("rig.yaml"), "--out", at("a.bag"), "--format", "rosbag", "--count",
                           "50", "--patterns", at("patterns.yaml"), "--before",
                           "touch " + test::quoted(at("before").string()) + "$FRINGESLAM_STACK; sleep 0.3"});
  const bool captured = wait_until(60, [&] { return fs::exists(at("before2")); });
  if (log_of("program").find("built without ROS bags") != std::string::npos) GTEST_SKIP() << log_of("program");
  ASSERT_TRUE(captured) << log_of("program");
  EXPECT_FALSE(fs::exists(at("a.bag")));
  EXPECT_EQ(capture.stop(SIGINT), 0);
  EXPECT_THAT(log_of("program"), HasSubstr("interrupted"));
  Child import = program({"import", at("a.bag"), "--out", at("imported")});
  ASSERT_EQ(import.wait(), 0) << log_of("program");
  ReplayRig replay(at("imported"));
  EXPECT_GE(replay.info().stacks, 2);
  for (int i = 0; i < replay.info().stacks; ++i) expect_right(*replay.capture(replay.sequence()));
  Child again = program({"capture", "--rig", at("rig.yaml"), "--out", at("a.bag"), "--format", "rosbag"});
  EXPECT_EQ(again.wait(), 2);
  EXPECT_THAT(log_of("program"), HasSubstr("exists"));
}

// The port in a line `live: http://127.0.0.1:PORT/`; 0 if the line is absent.
int live_port(const std::string& log) {
  const std::string lead = "live: http://127.0.0.1:";
  const size_t at = log.find(lead);
  const size_t end = at == std::string::npos ? at : log.find("/\n", at + lead.size());
  return end == std::string::npos ? 0 : std::stoi(log.substr(at + lead.size(), end - at - lead.size()));
}

TEST_F(ClosedLoop, CapturedViewsAppearOnTheLivePage) {
  // The long interval keeps the first stack the newest one while the viewer connects; Ctrl-C ends it.
  Child capture = program(
      {"capture", "--rig", at("rig.yaml"), "--out", at("live"), "--live", "0", "--count", "3", "--interval", "600"});
  ASSERT_TRUE(wait_until(60, [&] { return live_port(log_of("program")) > 0; })) << log_of("program");
  httplib::Client viewer("127.0.0.1", live_port(log_of("program")));
  viewer.set_read_timeout(60);
  nlohmann::json snapshot, state;
  ASSERT_TRUE(wait_until(60, [&] {
    const auto answer = viewer.Get("/snapshot");
    if (answer) snapshot = nlohmann::json::parse(answer->body);
    state = snapshot.value("newest", nlohmann::json());
    return state.is_object();
  })) << log_of("program");
  EXPECT_EQ(state["number"], 1);
  EXPECT_EQ(snapshot["about"]["maps"], true);
  EXPECT_EQ(snapshot["views"]["list"][0]["tracking"], "first");
  EXPECT_EQ(snapshot["keyframes"]["list"].size(), 1u);
  const PatternSequence captured = read_patterns(at("live/patterns.yaml"));
  const tools::PreviewFigures expected =
      tools::preview_of(*ReplayRig(at("live")).capture(captured), captured, read_rig(at("rig.yaml"))).figures;
  EXPECT_GT(expected.valid, 0.2);
  EXPECT_DOUBLE_EQ(state["valid"], expected.valid);
  EXPECT_DOUBLE_EQ(state["saturated"], expected.saturated);
  EXPECT_DOUBLE_EQ(state["mean_modulation_dn"], expected.mean_modulation_dn);
  const auto depth = viewer.Get("/picture/1/depth.png");
  ASSERT_TRUE(depth);
  EXPECT_EQ(depth->status, 200);
  EXPECT_THAT(depth->body, testing::StartsWith("\x89PNG"));
  EXPECT_EQ(capture.stop(SIGINT), 0);
  EXPECT_FALSE(viewer.Get("/snapshot"));
  EXPECT_EQ(stacks_in(at("live")), 1);
}

TEST_F(ClosedLoop, ATakenPortIsSaidBeforeAnythingIsCaptured) {
  httplib::Server other;
  const int port = other.bind_to_any_port("127.0.0.1");
  Child capture = program({"capture", "--rig", at("rig.yaml"), "--out", at("nothing"), "--live", std::to_string(port)});
  EXPECT_EQ(capture.wait(), 2);
  EXPECT_THAT(log_of("program"),
              testing::MatchesRegex("fringeslam: live: port [0-9]+ is in use or not permitted; [^\n]*\n"));
  EXPECT_FALSE(fs::exists(at("nothing")));
}

TEST_F(ClosedLoop, CameraAndDisplayAreListed) {
  Child list = program({"rig", "list", "--json"});
  ASSERT_EQ(list.wait(), 0) << log_of("program");
  const nlohmann::json found = nlohmann::json::parse(log_of("program"));
  ASSERT_EQ(found["cameras"].size(), 1u);
  EXPECT_EQ(found["cameras"][0]["serial"], "T1");
  ASSERT_EQ(found["displays"].size(), 1u);
  EXPECT_EQ(found["displays"][0]["width_px"], 1024);
  EXPECT_EQ(found["displays"][0]["height_px"], 768);
  EXPECT_TRUE(found["controllers"].empty());
  Child text = program({"rig", "list"});
  EXPECT_EQ(text.wait(), 0);
  EXPECT_THAT(log_of("program"), AllOf(HasSubstr("T1"), HasSubstr("1024x768 px"), HasSubstr("projector controllers:")));
}

TEST_F(ClosedLoop, LatencyIsThatOfADisplayWithoutDelay) {
  Child latency = program({"rig", "latency", "--rig", at("rig.yaml"), "--json"});
  ASSERT_EQ(latency.wait(), 0) << log_of("program");
  const nlohmann::json measured = nlohmann::json::parse(log_of("program"));
  // The fake camera reads the display's memory when an exposure begins.
  const double delay_s = measured["delay_s"], largest_s = measured["largest_delay_s"],
               refresh_s = measured["refresh_s"];
  EXPECT_LE(delay_s, largest_s);
  EXPECT_LT(delay_s, 0.01);
  EXPECT_GT(measured["image_s"], 0);
  EXPECT_NEAR(measured["settle_s"], 1.5 * largest_s + 0.5 * refresh_s, 1e-3);
}

TEST_F(ClosedLoop, FocusIsThatOfTheSimulatorsImages) {
  Child focus = program({"rig", "focus", "--rig", at("rig.yaml"), "--count", "2", "--json"});
  ASSERT_EQ(focus.wait(), 0) << log_of("program");
  const nlohmann::json readings = nlohmann::json::parse(log_of("program"));
  ASSERT_EQ(readings.size(), 2u);

  const sim::Scene scene = sim::load_scene(at("scene.yaml"));
  sim::RenderOptions options;
  options.noise = false;
  const PatternSequence fringes = tools::focus_sequence(scene.rig, 16);
  const FringeStack seen = *sim::VirtualRig(scene, options).capture(fringes);
  const tools::FocusReading expected = tools::read_focus(seen, scene.rig);
  EXPECT_GT(expected.fringes, 0.5);
  EXPECT_LT(expected.fringes, 0.99);
  for (const nlohmann::json& reading : readings) {
    EXPECT_NEAR(reading["fringes"], expected.fringes, 0.01);
    EXPECT_NEAR(reading["centre"], expected.centre, 0.01);
    EXPECT_NEAR(reading["corners"], expected.corners, 0.01);
    EXPECT_NEAR(reading["sharpness"], expected.sharpness, 0.02 * expected.sharpness);
    EXPECT_NEAR(reading["measured"], expected.measured, 0.01);
  }
}

TEST_F(ClosedLoop, FocusGoesOnUntilItIsInterrupted) {
  Child focus = program({"rig", "focus", "--rig", at("rig.yaml")});
  const auto lines = [&] {
    const std::string log = log_of("program");
    return std::count(log.begin(), log.end(), '\n');
  };
  ASSERT_TRUE(wait_until(60, [&] { return lines() >= 2; })) << log_of("program");
  EXPECT_EQ(focus.stop(SIGINT), 0);
  EXPECT_THAT(log_of("program"),
              testing::ContainsRegex("^fringes [0-9]+ % .best [0-9]+ %., center [0-9]+ %, corners [0-9]+ %; texture "
                                     "sharpness 0[.][0-9]+ .best 0[.][0-9]+.\n"));
}

TEST_F(ClosedLoop, AFullDiskIsSaidAndLeavesNoHalf) {
  // Limits file sizes to 4 KiB, which acts like a full disk: the images of a stack are larger.
  const std::string command = "trap '' XFSZ; " + test::limit_file_size(4, at("counters")) + "exec " +
                              test::quoted(FRINGESLAM_PROGRAM) + " capture --rig " + test::quoted(at("rig.yaml")) +
                              " --out " + test::quoted(at("full"));
  Child capture({"bash", "-c", command}, at("program.log"));
  EXPECT_EQ(capture.wait(), 2);
  EXPECT_THAT(log_of("program"), HasSubstr("cannot be written"));
  EXPECT_FALSE(fs::exists(at("full")));
}

// The images of a stack are of no use without dataset.yaml.
TEST_F(ClosedLoop, AStackThatCannotBeListedIsRemoved) {
  const std::string notes = at("listed").string() + "/dataset.yaml/notes";  // of the user
  Child capture =
      program({"capture", "--rig", at("rig.yaml"), "--out", at("listed"), "--before",
               "mkdir " + test::quoted(fs::path(notes).parent_path()) + " && touch " + test::quoted(notes)});
  EXPECT_EQ(capture.wait(), 2);
  EXPECT_THAT(log_of("program"), HasSubstr("dataset.yaml: cannot be written: it is a folder; the stack captured before "
                                           "is removed"));
  EXPECT_EQ(test::listing(at("listed")), (std::set<std::string>{"dataset.yaml", "dataset.yaml/notes"}));
}

// At sixteen times the exposure that suits the scene, the images do not show that camera and projector work together.
TEST_F(ClosedLoop, AnOverexposedRigIsCheckedAtAShorterExposure) {
  const double exposure_s = read_rig(at("rig.yaml")).timing.exposure_s;
  const fs::path rig =
      rig_with("{settle_s: 0.01, attempts: 1, camera: {exposure_s: " + std::to_string(16 * exposure_s) + "}}");
  Child focus = program({"rig", "focus", "--rig", rig.string(), "--count", "1"});
  EXPECT_EQ(focus.wait(), 2);
  EXPECT_THAT(log_of("program"), HasSubstr("of the pixels are saturated in white"));
  Child check = program({"rig", "check", "--rig", rig.string(), "--json"});
  ASSERT_EQ(check.wait(), 0) << log_of("program");
  const nlohmann::json said = nlohmann::json::parse(log_of("program"));
  EXPECT_LT(said["exposure"], 1);
  EXPECT_LT(said["saturated"], 1);
  EXPECT_NEAR(said["advice"]["advice"]["exposure_s"], static_cast<double>(said["exposure"]) * 16 * exposure_s, 1e-6);
}

// The page is there before the devices are opened.
TEST_F(ClosedLoop, FocusThatIsInterruptedAtItsStartEndsInOrder) {
  Child focus = program({"rig", "focus", "--rig", at("rig.yaml"), "--live", "0"});
  ASSERT_TRUE(wait_until(60, [&] { return live_port(log_of("program")) > 0; })) << log_of("program");
  EXPECT_EQ(focus.stop(SIGINT), 0) << log_of("program");
}

// The program of --before would run for minutes.
TEST_F(ClosedLoop, SigtermDoesNotWaitForTheCommandBefore) {
  struct Kind {
    std::string name, trap;
    bool ends;
  };
  for (const Kind& kind : {Kind{"obedient", "", true}, Kind{"stubborn", "trap '' INT TERM; ", false}}) {
    const fs::path note = at(kind.name + "_pid");
    Child capture = program({"capture", "--rig", at("rig.yaml"), "--out", at(kind.name), "--count", "3", "--before",
                             kind.trap + "[ $FRINGESLAM_STACK = 0 ] || { echo $$ > " + test::quoted(note.string()) +
                                 "; exec sleep 200; }"});
    ASSERT_TRUE(wait_until(60, [&] { return fs::exists(note) && fs::file_size(note) > 1; })) << log_of("program");
    const pid_t sleeper = std::stoi(test::read_bytes(note));
    capture.send(SIGTERM);
    EXPECT_EQ(capture.wait_for(60), 0) << log_of("program");
    EXPECT_THAT(log_of("program"), HasSubstr("1 stack, interrupted"));
    EXPECT_EQ(stacks_in(at(kind.name)), 1);
    // The one that ignores signals is left to itself.
    EXPECT_EQ(kill(sleeper, kind.ends ? 0 : SIGKILL), kind.ends ? -1 : 0) << kind.name;
  }
}

}  // namespace
}  // namespace fringeslam
