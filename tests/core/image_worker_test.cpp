// SPDX-License-Identifier: Apache-2.0
// Images are decoded in other processes with the same result as here, and nothing that happens to these affects the program.
#include "core/io/image_worker.h"

#include <fcntl.h>
#include <gmock/gmock.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <functional>
#include <opencv2/core.hpp>
#include <thread>

#include "core/base/limited_child.h"
#include "core/io/files.h"
#include "core/io/jpeg_file.h"
#include "tests/support/same_pixels.h"
#include "tests/support/temp_folder.h"

namespace fringeslam {
namespace {

using test::message_of;
using test::same_pixels;
using testing::HasSubstr;
using testing::StartsWith;

cv::Mat noise(cv::Size size, int type, int seed) {
  cv::Mat image(size, type);
  cv::RNG random(static_cast<uint64_t>(seed));
  random.fill(image, cv::RNG::UNIFORM, 0, CV_MAT_DEPTH(type) == CV_16U ? 65536 : 256);
  return image;
}

TEST(ImageWorkers, ReturnWhatDecodingHereReturns) {
  const test::TempFolder temp;
  write_png(temp / "8.png", noise({61, 40}, CV_8UC1, 1));
  write_png(temp / "16.png", noise({33, 70}, CV_16UC1, 2));
  write_png(temp / "colour.png", noise({20, 21}, CV_8UC3, 3));
  test::write_bytes(temp / "lossy.jpg", jpeg_bytes(noise({64, 48}, CV_8UC1, 4), 90));
  cv::Mat values;
  noise({50, 30}, CV_8UC1, 5).convertTo(values, CV_32F, 0.01);
  write_exr(temp / "float.exr", {{"Y", values}});
  for (const char* name : {"8.png", "16.png", "colour.png", "lossy.jpg", "float.exr"}) {
    const cv::Mat there = read_as_grey(temp / name, GreyFrom::red);
    decode_in_this_process(true);
    const cv::Mat here = read_as_grey(temp / name, GreyFrom::red);
    decode_in_this_process(false);
    EXPECT_TRUE(same_pixels(there, here)) << name;
  }
  EXPECT_TRUE(same_pixels(read_grey(temp / "8.png"), noise({61, 40}, CV_8UC1, 1)));
  EXPECT_TRUE(same_pixels(read_grey(temp / "16.png"), noise({33, 70}, CV_16UC1, 2)));
}

// Sizes grow and shrink, so that the shared memory of a worker is larger than its image.
TEST(ImageWorkers, ServeManyThreads) {
  constexpr int kThreads = 6, kImages = 20;
  std::atomic<int> wrong = 0;
  std::vector<std::thread> threads;
  for (int t = 0; t < kThreads; ++t) {
    threads.emplace_back([&, t] {
      for (int i = 0; i < kImages; ++i) {
        const cv::Mat image = noise({1 + 97 * ((i * 7 + t) % 5), 3 + i}, CV_8UC1, 100 * t + i);
        wrong += !same_pixels(decode_image(png_bytes(image), "image").image, image);
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(wrong, 0);
}

TEST(ImageWorkers, SurviveDamagedFiles) {
  const cv::Mat image = noise({120, 90}, CV_8UC1, 7);
  const std::string png = png_bytes(image);
  cv::Mat1f values(90, 120, 0.5f);
  values(3, 4) = 7;
  const std::string exr = exr_bytes({{"depth", values}, {"sigma", values}});
  cv::RNG random(1);
  for (const std::string& good : {png, exr}) {
    for (int trial = 0; trial < 150; ++trial) {
      std::string bytes = good;
      for (int i = 0; i < 1 + trial % 4; ++i)
        bytes[static_cast<size_t>(random.uniform(0, static_cast<int>(bytes.size())))] ^=
            static_cast<char>(1 << random.uniform(0, 8));
      if (trial % 5 == 0) bytes.resize(static_cast<size_t>(random.uniform(1, static_cast<int>(bytes.size()))));
      try {
        (void)decode_image(bytes, "damaged");
      } catch (const Error& error) {
        EXPECT_THAT(error.what(), StartsWith("damaged: "));
      }
    }
  }
  EXPECT_TRUE(same_pixels(decode_image(png, "good").image, image));
  EXPECT_EQ(decode_image(exr, "good").channels, (std::vector<std::string>{"depth", "sigma"}));
}

TEST(ImageWorkers, RefuseFormatsWithoutNeed) {
  const test::TempFolder temp;
  for (const char* name : {"image.null", "image.mp4", "image.fits", "image", "1x1.nul"}) {
    test::write_bytes(temp / name, "content");
    EXPECT_THAT(message_of([&] { (void)read_grey(temp / name); }), HasSubstr("convert it to PNG, TIFF or EXR")) << name;
  }
}

// Processes whose parent, in any generation, is this one.
std::vector<pid_t> descendants() {
  std::vector<pid_t> found;
  for (const auto& entry : test::fs::directory_iterator("/proc")) {
    pid_t pid = std::atoi(entry.path().filename().c_str());
    const pid_t candidate = pid;
    while (pid > 1) {
      std::string text;
      std::getline(std::ifstream("/proc/" + std::to_string(pid) + "/stat"), text);
      const size_t end = text.rfind(')');
      pid = end == std::string::npos ? 0 : std::atoi(text.c_str() + end + 4);
      if (pid == getpid()) found.push_back(candidate);
    }
  }
  return found;
}

// In a process of its own, which adopts the decoders' processes and so can find them.
TEST(ImageWorkersDeathTest, AreReplacedWhenTheyDie) {
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  const auto survives = [] {
    prctl(PR_SET_CHILD_SUBREAPER, 1);
    const cv::Mat image = noise({1500, 1000}, CV_8UC1, 8);
    const std::string png = png_bytes(image);
    if (!same_pixels(decode_image(png, "first").image, image)) return 1;
    if (descendants().size() != 2) return 2;  // one that forks, one that decodes
    for (const pid_t pid : descendants()) kill(pid, SIGKILL);
    if (!same_pixels(decode_image(png, "after all died").image, image)) return 3;
    std::atomic<bool> done = false;
    std::thread killer([&] {
      while (!done) {
        for (const pid_t pid : descendants()) kill(pid, SIGKILL);
        std::this_thread::sleep_for(std::chrono::milliseconds(3));
      }
    });
    int crashes = 0, wrong = 0;
    for (int trial = 0; trial < 2000 && crashes < 1; ++trial) {
      try {
        wrong += !same_pixels(decode_image(png, "killed").image, image);
      } catch (const Error& error) {
        wrong += std::string(error.what()).rfind("killed: ", 0) != 0;
        ++crashes;
      }
    }
    done = true;
    killer.join();
    if (crashes < 1) return 4;
    if (wrong > 0) return 5;
    return same_pixels(decode_image(png, "last").image, image) ? 0 : 6;
  };
  EXPECT_EXIT(std::exit(survives()), testing::ExitedWithCode(0), "");
}

// A data loader forks, and its processes decode at the same time as their parent.
TEST(ImageWorkers, ServeForkedProcesses) {
  const cv::Mat image = noise({300, 200}, CV_8UC1, 9);
  const std::string png = png_bytes(image);
  (void)decode_image(png, "parent");
  std::vector<pid_t> children;
  for (int child = 0; child < 3; ++child) {
    const pid_t pid = fork();
    ASSERT_GE(pid, 0);
    if (pid == 0) {
      int wrong = 0;
      for (int i = 0; i < 20; ++i) wrong += !same_pixels(decode_image(png, "child").image, image);
      _exit(wrong);
    }
    children.push_back(pid);
  }
  for (int i = 0; i < 20; ++i) EXPECT_TRUE(same_pixels(decode_image(png, "parent").image, image));
  for (const pid_t pid : children) {
    int status = 0;
    ASSERT_EQ(waitpid(pid, &status, 0), pid);
    EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0) << status;
  }
}

// Returns how many of the actions succeed in a restricted child; -1 if it crashes.
int successes(ChildReads reads, const std::vector<std::function<bool()>>& actions) {
  const pid_t pid = fork();
  if (pid == 0) {
    restrict_child(reads);
    int count = 0;
    for (const auto& action : actions) count += action();
    _exit(count);
  }
  int status = 0;
  if (waitpid(pid, &status, 0) != pid || !WIFEXITED(status)) return -1;
  return WEXITSTATUS(status);
}

TEST(RestrictedChild, CanDoNothingButRead) {
  const test::TempFolder temp;
  const std::string file = (temp / "file").string(), other = (temp / "other").string();
  test::write_bytes(file, "content");
  const std::vector<std::function<bool()>> forbidden = {
      [&] { return open(other.c_str(), O_WRONLY | O_CREAT, 0600) >= 0 && write(3, "x", 1) == 1; },
      [&] { return unlink(file.c_str()) == 0; },
      [&] { return rename(file.c_str(), other.c_str()) == 0; },
      [&] { return mkdir(other.c_str(), 0700) == 0; },
      [&] { return chmod(file.c_str(), 0777) == 0; },
      [&] { return truncate(file.c_str(), 0) == 0; },
      [&] { return open(file.c_str(), O_RDONLY | O_TRUNC) >= 0; },
      [&] { return syscall(SYS_fork) >= 0; },
      [&] { return socket(AF_INET, SOCK_STREAM, 0) >= 0; },
      [&] { return kill(getppid(), 0) == 0; },
      [&] { return execl("/bin/true", "true", nullptr) == 0; }};
  EXPECT_EQ(successes(ChildReads::files, forbidden), 0);
  EXPECT_EQ(successes(ChildReads::nothing, forbidden), 0);
  const std::vector<std::function<bool()>> reading = {[&] { return open(file.c_str(), O_RDONLY) >= 0; }};
  EXPECT_EQ(successes(ChildReads::files, reading), 1);
  EXPECT_EQ(successes(ChildReads::nothing, reading), 0);
  EXPECT_EQ(test::read_bytes(file), "content");
}

}  // namespace
}  // namespace fringeslam
