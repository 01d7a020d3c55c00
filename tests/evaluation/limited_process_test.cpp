// SPDX-License-Identifier: Apache-2.0
#include "bench/evaluation/limited_process.h"

#include <gmock/gmock.h>
#include <signal.h>

#include "tests/support/temp_folder.h"

namespace fringeslam::evaluation {
namespace {

using testing::HasSubstr;

class LimitedProcess : public testing::Test {
 protected:
  ProcessReport run(
      const std::string& command, const ProcessLimits& limits = {},
      const std::function<bool()>& stop = [] { return false; }) {
    return run_limited(command, temp_.path(), temp_ / "log.txt", limits, stop);
  }
  std::string log() const { return test::read_bytes(temp_ / "log.txt"); }
  // The process whose number a command wrote to a file.
  bool is_alive(const std::string& file) const {
    const pid_t pid = std::stoi(test::read_bytes(temp_ / file));
    return kill(pid, 0) == 0;
  }
  test::TempFolder temp_;
};

TEST_F(LimitedProcess, ReportsExitCodesAndOutput) {
  const ProcessReport good = run("echo out; echo err >&2; pwd");
  EXPECT_EQ(good.end, ProcessEnd::finished);
  EXPECT_EQ(good.exit_code, 0);
  EXPECT_EQ(log(), "out\nerr\n" + temp_.path().string() + "\n");
  EXPECT_FALSE(good.left_processes);
  const ProcessReport bad = run("exit 3");
  EXPECT_EQ(bad.end, ProcessEnd::failed);
  EXPECT_EQ(bad.exit_code, 3);
  EXPECT_EQ(run("kill -SEGV $$").exit_code, 128 + SIGSEGV);
  EXPECT_EQ(run("no-such-program-anywhere").exit_code, 127);
}

TEST_F(LimitedProcess, InputIsEmpty) { EXPECT_EQ(run("cat").end, ProcessEnd::finished); }

TEST_F(LimitedProcess, EndsAllProcessesAfterTheTimeout) {
  const ProcessReport report = run("sleep 60 & echo $! > child; (trap '' TERM HUP; sleep 60)", {0.3, 1000});
  EXPECT_EQ(report.end, ProcessEnd::timed_out);
  EXPECT_GE(report.seconds, 0.3);
  EXPECT_LT(report.seconds, 30);
  EXPECT_FALSE(is_alive("child"));
}

TEST_F(LimitedProcess, EndsDetachedProcesses) {
  const ProcessReport report =
      run("setsid sh -c 'echo $$ > child; exec sleep 60' < /dev/null & while ! [ -s child ]; do :; done");
  EXPECT_EQ(report.end, ProcessEnd::finished);
  EXPECT_TRUE(report.left_processes);
  EXPECT_FALSE(is_alive("child"));
}

TEST_F(LimitedProcess, LimitsTheMemoryOfAllProcessesTogether) {
  const std::string half = "/usr/bin/python3 -c 'import time; x = bytearray(60 << 20); time.sleep(60)' & ";
  const ProcessReport report = run(half + half + "wait", {60, 100});
  EXPECT_EQ(report.end, ProcessEnd::out_of_memory);
  EXPECT_GT(report.peak_mib, 100);
  const ProcessReport enough =
      run("/usr/bin/python3 -c 'import time; x = bytearray(60 << 20); time.sleep(0.3)'", {60, 1000});
  EXPECT_EQ(enough.end, ProcessEnd::finished);
  EXPECT_GT(enough.peak_mib, 60);
  EXPECT_LT(enough.peak_mib, 200);
}

TEST_F(LimitedProcess, StopsOnRequest) {
  const ProcessReport report =
      run("echo $$ > shell; sleep 60", {}, [&] { return std::filesystem::exists(temp_ / "shell"); });
  EXPECT_EQ(report.end, ProcessEnd::interrupted);
}

TEST_F(LimitedProcess, AnAbsentFolderIsAnError) {
  EXPECT_THROW(run_limited("true", temp_ / "absent", temp_ / "log.txt", {}, [] { return false; }), Error);
}

}  // namespace
}  // namespace fringeslam::evaluation
