// SPDX-License-Identifier: Apache-2.0
#include "core/base/limited_child.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/ioctl.h>
#include <sys/resource.h>
#include <sys/shm.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <csignal>
#include <cstdlib>
#include <string>

namespace fringeslam {
namespace {

constexpr ChildLimits kLimits{1, 0.01, ChildReads::nothing};
constexpr int kMostDescriptors = 256, kPipe = 3;  // of the answer

TEST(LimitedChild, AnswersAreReturned) {
  const ChildAnswer answer = answer_of_child(kLimits, [] { return std::string(100000, 'x'); });
  EXPECT_EQ(answer.end, ChildEnd::answered);
  EXPECT_EQ(answer.bytes, std::string(100000, 'x'));
}

TEST(LimitedChild, CrashesAndSilenceAreNoAnswers) {
  EXPECT_EQ(answer_of_child(kLimits, []() -> std::string { std::abort(); }).end, ChildEnd::crashed);
  EXPECT_EQ(answer_of_child(kLimits, []() -> std::string { _exit(0); }).end, ChildEnd::crashed);
}

// A child can neither signal other processes nor change their limits.
TEST(LimitedChild, OthersAreOutOfReach) {
  const auto is_refused = [](long result) { return result == -1 && errno == EPERM; };
  const ChildAnswer answer = answer_of_child(kLimits, [&] {
    const pid_t parent = getppid(), self = getpid();
    siginfo_t info{};
    rlimit limit{};
    std::string refused;
    const auto note = [&](const char* name, long result) {
      if (is_refused(result)) refused += std::string(name) + " ";
    };
    note("kill", syscall(SYS_kill, parent, 0));
    note("tkill", syscall(SYS_tkill, parent, 0));
    note("tgkill", syscall(SYS_tgkill, parent, parent, 0));
    note("sigqueue", syscall(SYS_rt_sigqueueinfo, parent, 0, &info));
    note("prlimit", syscall(SYS_prlimit64, parent, RLIMIT_NOFILE, nullptr, &limit));
    note("socket", syscall(SYS_socket, 1, 1, 0));
    note("own tgkill", syscall(SYS_tgkill, self, self, 0));
    note("own prlimit", syscall(SYS_prlimit64, 0, RLIMIT_NOFILE, nullptr, &limit));
    return refused + ".";
  });
  EXPECT_EQ(answer.bytes, "kill tkill tgkill sigqueue prlimit socket .");
}

// The kernel sends signals on behalf of a process, and types into its terminal.
TEST(LimitedChild, TheKernelDoesNotActOnOthersForIt) {
  const ChildAnswer answer = answer_of_child(kLimits, [] {
    std::string done;
    const auto note = [&](const char* name, long result) {
      if (result != -1) done += std::string(name) + " ";
    };
    note("owner", fcntl(kPipe, F_SETOWN, getppid()));
    note("signal", fcntl(kPipe, F_SETSIG, SIGKILL));
    const char letter = 'x';
    note("type", ioctl(0, TIOCSTI, &letter) == -1 && errno == EPERM ? -1 : 0);
    note("fork", syscall(SYS_fork));
    note("shared memory", shmget(IPC_PRIVATE, 1, IPC_CREAT | 0600));
    return done + ".";
  });
  EXPECT_EQ(answer.bytes, ".");
}

TEST(LimitedChild, HasNoTerminal) {
  const pid_t child = fork();
  if (child == 0) {
    enter_limited_child(1, 1);
    _exit(getsid(0) == getpid() && open("/dev/tty", O_RDONLY) < 0 ? 0 : 1);
  }
  int status = 0;
  ASSERT_EQ(waitpid(child, &status, 0), child);
  EXPECT_EQ(status, 0);
}

// Terminals, and the memory and environment of other processes, are files too.
TEST(LimitedChild, FilesOfTheSystemAreOutOfReach) {
  constexpr unsigned kAskForVersion = 1;
  if (syscall(SYS_landlock_create_ruleset, nullptr, 0, kAskForVersion) < 1) GTEST_SKIP() << "no Landlock";
  const std::string environment = "/proc/" + std::to_string(getpid()) + "/environ";
  const ChildAnswer answer = answer_of_child({1, 0.01, ChildReads::files}, [&] {
    std::string opened;
    for (const std::string& file : {std::string("/dev/zero"), environment, std::string("/sys/kernel/mm/ksm/run"),
                                    std::string(FRINGESLAM_SOURCE_DIR "/CMakeLists.txt")}) {
      if (open(file.c_str(), O_RDONLY) >= 0) opened += file + " ";
    }
    return opened + ".";
  });
  EXPECT_EQ(answer.bytes, FRINGESLAM_SOURCE_DIR "/CMakeLists.txt .");
}

// The child must not reach results and connections of its parent.
TEST(LimitedChild, OpenFilesOfTheParentAreOutOfReach) {
  const int opened = open("/dev/null", O_RDONLY);  // inherited even by exec()
  ASSERT_GE(opened, 3);
  const ChildAnswer answer = answer_of_child(kLimits, [&] {
    std::string still_open = "open:";
    for (int number = 0; number < kMostDescriptors; ++number)
      if (fcntl(number, F_GETFD) >= 0) still_open += " " + std::to_string(number);
    return still_open;
  });
  close(opened);
  EXPECT_EQ(answer.bytes, "open: 0 1 2 3");  // /dev/null, and the pipe of the answer
}

TEST(LimitedChild, OneThatWorksTooLongIsEnded) {
  EXPECT_EQ(answer_of_child(kLimits,
                            []() -> std::string {
                              for (std::atomic<int> turns = 0;;) ++turns;
                            })
                .end,
            ChildEnd::too_slow);
}

TEST(LimitedChild, OneThatClosesItsPipeAndSleepsIsEnded) {
  EXPECT_EQ(answer_of_child(kLimits,
                            []() -> std::string {
                              close(kPipe);
                              for (;;) pause();
                            })
                .end,
            ChildEnd::too_slow);
}

TEST(LimitedChild, OneThatNeverStopsAnsweringIsEnded) {
  const ChildAnswer answer = answer_of_child({60, 0.01, ChildReads::nothing}, [&]() -> std::string {
    static const std::string kBytes(4096, 'x');
    while (write_all(kPipe, kBytes.data(), kBytes.size())) continue;
    _exit(0);
  });
  EXPECT_EQ(answer.end, ChildEnd::too_slow);
  EXPECT_TRUE(answer.bytes.empty());
}

}  // namespace
}  // namespace fringeslam
