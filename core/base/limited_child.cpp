// SPDX-License-Identifier: Apache-2.0
#include "core/base/limited_child.h"

#include <fcntl.h>
#include <linux/audit.h>
#include <linux/filter.h>
#include <linux/landlock.h>
#include <linux/seccomp.h>
#include <poll.h>
#include <sched.h>
#include <sys/ioctl.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <bit>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstddef>
#include <cstdio>
#include <filesystem>
#include <system_error>
#include <thread>
#include <vector>

namespace fringeslam {

void detach_child() {
  setsid();  // without a terminal, whose signals are meant for the program
  for (const int signal : {SIGSEGV, SIGABRT, SIGBUS, SIGFPE, SIGILL, SIGINT, SIGTERM}) std::signal(signal, SIG_DFL);
  const int nowhere = open("/dev/null", O_RDWR);
  for (const int standard : {0, 1, 2}) dup2(nowhere, standard);
  if (nowhere > 2) close(nowhere);
  const rlimit no_core{0, 0};
  setrlimit(RLIMIT_CORE, &no_core);
}

int keep_only_descriptor(int descriptor) {
  constexpr int kKept = 3, kMost = 65536;
  if (dup2(descriptor, kKept) != kKept) _exit(1);
#ifdef SYS_close_range
  if (syscall(SYS_close_range, static_cast<unsigned>(kKept + 1), ~0u, 0u) == 0) return kKept;
#endif
  for (int number = kKept + 1; number < kMost; ++number) close(number);
  return kKept;
}

uint64_t address_space_bytes() {
  long pages = 0;
  if (FILE* statm = std::fopen("/proc/self/statm", "r")) {
    if (std::fscanf(statm, "%ld", &pages) != 1) pages = 0;
    std::fclose(statm);
  }
  return static_cast<uint64_t>(pages) * static_cast<uint64_t>(sysconf(_SC_PAGESIZE));
}

void limit_address_space(uint64_t bytes, uint64_t most_bytes) {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)  // their shadow memory exceeds any limit
  (void)bytes, (void)most_bytes;
#else
  const rlimit memory{bytes, most_bytes};
  setrlimit(RLIMIT_AS, &memory);
#endif
}

void enter_limited_child(double time_limit_s, double memory_limit_gib) {
  detach_child();
  const auto seconds = static_cast<rlim_t>(std::ceil(time_limit_s));
  const rlimit time{seconds, seconds + 5};  // the first limit sends SIGXCPU, the second SIGKILL
  setrlimit(RLIMIT_CPU, &time);
  const uint64_t bytes = address_space_bytes() + static_cast<uint64_t>(memory_limit_gib * 1024 * 1024 * 1024);
  limit_address_space(bytes, bytes);
}

namespace {

#ifdef SYS_landlock_create_ruleset
// Rights that the headers may not know yet, and the first version of the kernel's interface that does.
struct LaterRight {
  int version;
  uint64_t right;
};
constexpr LaterRight kLaterRights[] = {{2, 1 << 13},   // LANDLOCK_ACCESS_FS_REFER
                                       {3, 1 << 14},   // LANDLOCK_ACCESS_FS_TRUNCATE: opening to read can empty a file
                                       {5, 1 << 15}};  // LANDLOCK_ACCESS_FS_IOCTL_DEV

// Permits reading a file, or what is below a folder.
void permit_reading(int ruleset, const std::string& path) {
  landlock_path_beneath_attr rule{};
  rule.parent_fd = open(path.c_str(), O_PATH | O_CLOEXEC);
  if (rule.parent_fd < 0) return;
  struct stat status {};
  rule.allowed_access = LANDLOCK_ACCESS_FS_READ_FILE;
  if (fstat(rule.parent_fd, &status) == 0 && S_ISDIR(status.st_mode))
    rule.allowed_access |= LANDLOCK_ACCESS_FS_READ_DIR;
  (void)syscall(SYS_landlock_add_rule, ruleset, LANDLOCK_RULE_PATH_BENEATH, &rule, 0);
  close(rule.parent_fd);
}
#endif

// Below /dev, /proc and /sys are terminals, the memory of other processes, and their environment.
void restrict_files([[maybe_unused]] ChildReads reads) {
#ifdef SYS_landlock_create_ruleset
  constexpr unsigned kAskForVersion = 1;
  const auto version = static_cast<int>(syscall(SYS_landlock_create_ruleset, nullptr, size_t{0}, kAskForVersion));
  landlock_ruleset_attr rules{};
  rules.handled_access_fs = LANDLOCK_ACCESS_FS_EXECUTE | LANDLOCK_ACCESS_FS_WRITE_FILE | LANDLOCK_ACCESS_FS_REMOVE_DIR |
                            LANDLOCK_ACCESS_FS_REMOVE_FILE | LANDLOCK_ACCESS_FS_MAKE_CHAR |
                            LANDLOCK_ACCESS_FS_MAKE_DIR | LANDLOCK_ACCESS_FS_MAKE_REG | LANDLOCK_ACCESS_FS_MAKE_SOCK |
                            LANDLOCK_ACCESS_FS_MAKE_FIFO | LANDLOCK_ACCESS_FS_MAKE_BLOCK | LANDLOCK_ACCESS_FS_MAKE_SYM |
                            LANDLOCK_ACCESS_FS_READ_FILE | LANDLOCK_ACCESS_FS_READ_DIR;
  for (const LaterRight& later : kLaterRights) {
    if (version >= later.version) rules.handled_access_fs |= later.right;
  }
  const auto ruleset = static_cast<int>(syscall(SYS_landlock_create_ruleset, &rules, sizeof rules, 0));
  if (ruleset < 0) return;
  if (reads == ChildReads::files) {
    std::error_code failed;
    for (const auto& entry : std::filesystem::directory_iterator("/", failed)) {
      const std::string name = entry.path().string();
      if (name != "/dev" && name != "/proc" && name != "/sys") permit_reading(ruleset, name);
    }
    permit_reading(ruleset, "/dev/shm");
  }
  (void)syscall(SYS_landlock_restrict_self, ruleset, 0);
  close(ruleset);
#endif
}

// System calls are permitted by number, which is meaningful for these two architectures alone.
#if defined(__x86_64__) || defined(__aarch64__)
#if defined(__x86_64__)
constexpr unsigned kArchitecture = AUDIT_ARCH_X86_64;
#else
constexpr unsigned kArchitecture = AUDIT_ARCH_AARCH64;
#endif

// Calls that reach nothing but this process and its open descriptors, except that newfstatat and statx, with which the C library
// asks about descriptors, also tell whether a file exists.
constexpr long kPermitted[] = {
    // descriptors
    SYS_read,
    SYS_readv,
    SYS_pread64,
    SYS_preadv,
    SYS_write,
    SYS_writev,
    SYS_close,
    SYS_lseek,
    SYS_fstat,
    SYS_newfstatat,
    SYS_dup,
    SYS_dup3,
    SYS_pipe2,
    SYS_ppoll,
    SYS_pselect6,
    SYS_recvmsg,
    SYS_recvfrom,
    SYS_fadvise64,
    // memory
    SYS_mmap,
    SYS_munmap,
    SYS_mprotect,
    SYS_mremap,
    SYS_madvise,
    SYS_mincore,
    SYS_brk,
    SYS_membarrier,
    SYS_get_mempolicy,
    // threads and time
    SYS_futex,
    SYS_set_robust_list,
    SYS_get_robust_list,
    SYS_set_tid_address,
    SYS_sched_yield,
    SYS_sched_getaffinity,
    SYS_sched_getparam,
    SYS_sched_getscheduler,
    SYS_sched_get_priority_max,
    SYS_sched_get_priority_min,
    SYS_getcpu,
    SYS_nanosleep,
    SYS_clock_nanosleep,
    SYS_clock_gettime,
    SYS_clock_getres,
    SYS_gettimeofday,
    SYS_setitimer,
    SYS_getitimer,
    SYS_exit,
    SYS_exit_group,
    SYS_restart_syscall,
    // signals to itself
    SYS_rt_sigaction,
    SYS_rt_sigprocmask,
    SYS_rt_sigreturn,
    SYS_rt_sigpending,
    SYS_rt_sigtimedwait,
    SYS_sigaltstack,
    // questions
    SYS_getpid,
    SYS_getppid,
    SYS_gettid,
    SYS_getuid,
    SYS_geteuid,
    SYS_getgid,
    SYS_getegid,
    SYS_getrusage,
    SYS_times,
    SYS_sysinfo,
    SYS_uname,
    SYS_getrandom,
#if defined(__x86_64__)
    SYS_dup2,
    SYS_pipe,
    SYS_poll,
    SYS_select,
    SYS_alarm,
    SYS_time,
    SYS_arch_prctl,
    SYS_getrlimit,
    SYS_setrlimit,
#endif
#ifdef SYS_statx
    SYS_statx,
#endif
#ifdef SYS_rseq
    SYS_rseq,
#endif
#ifdef SYS_close_range
    SYS_close_range,
#endif
};

// Calls that find files and folders by name.
constexpr long kSearching[] = {
    SYS_getdents64, SYS_getcwd,   SYS_readlinkat, SYS_faccessat, SYS_statfs, SYS_fstatfs,
#if defined(__x86_64__)
    SYS_access,     SYS_readlink, SYS_getdents,   SYS_stat,      SYS_lstat,
#endif
#ifdef SYS_faccessat2
    SYS_faccessat2,
#endif
};

// Calls whose arguments a filter cannot see; without them, the C library makes older ones instead.
constexpr long kUnknown[] = {
#ifdef SYS_clone3
    SYS_clone3,
#endif
#ifdef SYS_openat2
    SYS_openat2,
#endif
};

class CallFilter {
 public:
  CallFilter() {
    load(offsetof(seccomp_data, arch));
    // Calls by another ABI have other numbers.
    jump_if(BPF_JEQ, kArchitecture, 1, 0);
    answer(SECCOMP_RET_KILL_PROCESS);
    load(offsetof(seccomp_data, nr));
#if defined(__x86_64__)
    constexpr unsigned kX32 = 0x40000000;
    jump_if(BPF_JGE, kX32, 0, 1);
    answer(kRefused);
#endif
  }
  void add(long number, unsigned result) {
    jump_if(BPF_JEQ, static_cast<unsigned>(number), 0, 1);
    answer(result);
  }
  void permit(long number) { add(number, SECCOMP_RET_ALLOW); }
  // Permits a call if an argument has one of these values.
  void permit_if(long number, int argument, const std::vector<unsigned>& values) {
    const auto count = static_cast<unsigned>(values.size());
    jump_if(BPF_JEQ, static_cast<unsigned>(number), 0, count + 3);
    load(place_of(argument));
    for (unsigned i = 0; i < count; ++i) jump_if(BPF_JEQ, values[i], count - i, 0);
    answer(kRefused);
    answer(SECCOMP_RET_ALLOW);
  }
  // Permits a call if an argument, masked, has this value.
  void permit_if_masked(long number, int argument, unsigned mask, unsigned value) {
    jump_if(BPF_JEQ, static_cast<unsigned>(number), 0, 5);
    load(place_of(argument));
    program_.push_back(BPF_STMT(BPF_ALU | BPF_AND | BPF_K, mask));
    jump_if(BPF_JEQ, value, 1, 0);
    answer(kRefused);
    answer(SECCOMP_RET_ALLOW);
  }
  // Refuses all other calls from now on.
  void install() {
    answer(kRefused);
    const sock_fprog filter{static_cast<unsigned short>(program_.size()), program_.data()};
    (void)prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &filter);
  }

 private:
  static constexpr unsigned kRefused = SECCOMP_RET_ERRNO | EPERM;

  // The lower half of an argument: flags, commands and process numbers have 32 bits.
  static unsigned place_of(int argument) {
    static_assert(std::endian::native == std::endian::little);
    return static_cast<unsigned>(offsetof(seccomp_data, args) + sizeof(uint64_t) * static_cast<size_t>(argument));
  }
  void load(size_t place) { program_.push_back(BPF_STMT(BPF_LD | BPF_W | BPF_ABS, static_cast<unsigned>(place))); }
  void jump_if(unsigned comparison, unsigned value, unsigned if_true, unsigned if_false) {
    program_.push_back(
        BPF_JUMP(BPF_JMP | comparison | BPF_K, value, static_cast<uint8_t>(if_true), static_cast<uint8_t>(if_false)));
  }
  void answer(unsigned result) { program_.push_back(BPF_STMT(BPF_RET | BPF_K, result)); }

  std::vector<sock_filter> program_;
};

void restrict_calls(ChildReads reads) {
  CallFilter filter;
  for (const long number : kPermitted) filter.permit(number);
  for (const long number : kUnknown) filter.add(number, SECCOMP_RET_ERRNO | ENOSYS);
  filter.permit_if(SYS_tgkill, 0, {static_cast<unsigned>(getpid())});  // abort() signals itself
  filter.permit_if(SYS_prlimit64, 0, {0});
  // A process has its own limits of time, so that only threads may be started.
  filter.permit_if_masked(SYS_clone, 0, CLONE_THREAD, CLONE_THREAD);
  // F_SETOWN and F_SETSIG would make the kernel send signals to other processes.
  filter.permit_if(SYS_fcntl, 1, {F_GETFD, F_SETFD, F_GETFL, F_DUPFD, F_DUPFD_CLOEXEC, F_GET_SEALS});
  filter.permit_if(SYS_ioctl, 1, {TCGETS, FIONREAD});  // TIOCSTI would type into a terminal
  filter.permit_if(SYS_prctl, 0, {PR_SET_NAME, PR_GET_NAME});
  if (reads == ChildReads::files) {
    for (const long number : kSearching) filter.permit(number);
    constexpr unsigned kWriting = O_ACCMODE | O_CREAT | O_TRUNC | (O_TMPFILE & ~O_DIRECTORY);
    filter.permit_if_masked(SYS_openat, 2, kWriting, O_RDONLY);
#if defined(__x86_64__)
    filter.permit_if_masked(SYS_open, 1, kWriting, O_RDONLY);
#endif
  }
  filter.install();
}
#else
void restrict_calls(ChildReads) {}
#endif

}  // namespace

void restrict_child(ChildReads reads) {
  const rlimit none{0, 0};
  setrlimit(RLIMIT_FSIZE, &none);
  if (prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) != 0) return;
  restrict_files(reads);
  restrict_calls(reads);
}

bool write_all(int descriptor, const char* bytes, size_t size) {
  for (size_t done = 0; done < size;) {
    const ssize_t written = ::write(descriptor, bytes + done, size - done);
    if (written < 0 && errno == EINTR) continue;
    if (written <= 0) return false;
    done += static_cast<size_t>(written);
  }
  return true;
}

namespace {

using Clock = std::chrono::steady_clock;

// Reads until the child closes the pipe; returns false if the time is up first or the child writes more than it could allocate.
bool read_all(int descriptor, Clock::time_point end, double most_gib, std::string& bytes) {
  const auto most_bytes = static_cast<size_t>(most_gib * 1024 * 1024 * 1024);
  std::vector<char> buffer(1 << 20);
  while (bytes.size() <= most_bytes) {
    const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(end - Clock::now());
    if (left.count() <= 0) return false;
    pollfd waiting{descriptor, POLLIN, 0};
    const int ready = poll(&waiting, 1, static_cast<int>(left.count()));
    if (ready == 0) return false;
    if (ready < 0) continue;  // a signal
    const ssize_t count = ::read(descriptor, buffer.data(), buffer.size());
    if (count <= 0) return true;
    bytes.append(buffer.data(), static_cast<size_t>(count));
  }
  return false;
}

// Waits for the end of a child that closed its pipe, and kills it when the time is up; returns false then.
bool wait_for(pid_t child, Clock::time_point end, int& status) {
  for (;;) {
    const pid_t ended = waitpid(child, &status, WNOHANG);
    if (ended == child || (ended < 0 && errno != EINTR)) return true;
    if (Clock::now() >= end) break;
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  kill(child, SIGKILL);
  while (waitpid(child, &status, 0) < 0 && errno == EINTR) continue;
  return false;
}

}  // namespace

ChildAnswer answer_of_child(const ChildLimits& limits, const std::function<std::string()>& work) {
  int ends[2];
  if (pipe2(ends, O_CLOEXEC) != 0) return {};
  const pid_t child = fork();
  if (child == 0) {
    prctl(PR_SET_PDEATHSIG, SIGKILL);  // the thread that forked it waits for it
    enter_limited_child(limits.time_s, limits.memory_gib);
    const int pipe = keep_only_descriptor(ends[1]);
    restrict_child(limits.reads);
    const std::string answer = work();
    write_all(pipe, answer.data(), answer.size());
    _exit(0);
  }
  close(ends[1]);
  if (child < 0) {
    close(ends[0]);
    return {};
  }
  ChildAnswer answer;
  const auto end =
      Clock::now() + std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(limits.time_s));
  const bool complete = read_all(ends[0], end, limits.memory_gib, answer.bytes);
  close(ends[0]);
  int status = 0;
  const bool in_time = wait_for(child, complete ? end : Clock::now(), status) && complete;
  if (!in_time || (WIFSIGNALED(status) && WTERMSIG(status) == SIGXCPU)) return {ChildEnd::too_slow, {}};
  if (!WIFEXITED(status) || answer.bytes.empty()) return {ChildEnd::crashed, {}};
  answer.end = ChildEnd::answered;
  return answer;
}

}  // namespace fringeslam
