// SPDX-License-Identifier: Apache-2.0
#include "core/base/limited_child.h"

#include <fcntl.h>
#include <linux/audit.h>
#include <linux/filter.h>
#include <linux/landlock.h>
#include <linux/seccomp.h>
#include <poll.h>
#include <sys/prctl.h>
#include <sys/resource.h>
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
#include <thread>
#include <vector>

namespace fringeslam {

void detach_child() {
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

void restrict_files([[maybe_unused]] ChildReads reads) {
#ifdef SYS_landlock_create_ruleset
  landlock_ruleset_attr rules{};
  rules.handled_access_fs = LANDLOCK_ACCESS_FS_EXECUTE | LANDLOCK_ACCESS_FS_WRITE_FILE | LANDLOCK_ACCESS_FS_REMOVE_DIR |
                            LANDLOCK_ACCESS_FS_REMOVE_FILE | LANDLOCK_ACCESS_FS_MAKE_CHAR |
                            LANDLOCK_ACCESS_FS_MAKE_DIR | LANDLOCK_ACCESS_FS_MAKE_REG | LANDLOCK_ACCESS_FS_MAKE_SOCK |
                            LANDLOCK_ACCESS_FS_MAKE_FIFO | LANDLOCK_ACCESS_FS_MAKE_BLOCK | LANDLOCK_ACCESS_FS_MAKE_SYM;
  if (reads == ChildReads::nothing)
    rules.handled_access_fs |= LANDLOCK_ACCESS_FS_READ_FILE | LANDLOCK_ACCESS_FS_READ_DIR;
  const auto ruleset = static_cast<int>(syscall(SYS_landlock_create_ruleset, &rules, sizeof rules, 0));
  if (ruleset < 0) return;
  (void)syscall(SYS_landlock_restrict_self, ruleset, 0);
  close(ruleset);
#endif
}

// System calls are refused by number, which is meaningful for these two architectures alone.
#if defined(__x86_64__) || defined(__aarch64__)
#if defined(__x86_64__)
constexpr unsigned kArchitecture = AUDIT_ARCH_X86_64;
#else
constexpr unsigned kArchitecture = AUDIT_ARCH_AARCH64;
#endif

constexpr long kRefused[] = {
    SYS_socket,
    SYS_socketpair,
    SYS_connect,
    SYS_bind,
    SYS_listen,
    SYS_sendto,
    SYS_sendmsg,
    SYS_sendmmsg,
    SYS_execve,
    SYS_execveat,
    SYS_ptrace,
    SYS_mount,
    SYS_umount2,
    SYS_unshare,
    SYS_setns,
    SYS_bpf,
    SYS_perf_event_open,
    SYS_process_vm_readv,
    SYS_process_vm_writev,
    SYS_init_module,
    SYS_finit_module,
    SYS_keyctl,
    SYS_add_key,
    SYS_request_key,
    SYS_kill,
    SYS_tkill,
    SYS_rt_sigqueueinfo,
    SYS_rt_tgsigqueueinfo,
    SYS_truncate,
    SYS_linkat,
    SYS_symlinkat,
    SYS_unlinkat,
    SYS_renameat2,
    SYS_mkdirat,
    SYS_mknodat,
    SYS_fchmodat,
    SYS_fchownat,
    SYS_fchmod,
    SYS_fchown,
    SYS_utimensat,
    SYS_setxattr,
    SYS_lsetxattr,
    SYS_fsetxattr,
#if defined(__x86_64__)
    SYS_link,
    SYS_symlink,
    SYS_unlink,
    SYS_rmdir,
    SYS_rename,
    SYS_renameat,
    SYS_mkdir,
    SYS_mknod,
    SYS_chmod,
    SYS_chown,
    SYS_lchown,
    SYS_utime,
    SYS_utimes,
    SYS_futimesat,
#endif
#ifdef SYS_io_uring_setup  // whose operations are not system calls
    SYS_io_uring_setup,
#endif
#ifdef SYS_pidfd_send_signal
    SYS_pidfd_send_signal,
#endif
#ifdef SYS_pidfd_open
    SYS_pidfd_open,
#endif
#ifdef SYS_pidfd_getfd
    SYS_pidfd_getfd,
#endif
};

constexpr long kOpening[] = {SYS_openat,
#if defined(__x86_64__)
                             SYS_open, SYS_creat,
#endif
#ifdef SYS_openat2
                             SYS_openat2,
#endif
                             SYS_open_by_handle_at};

void restrict_calls(ChildReads reads) {
  std::vector<sock_filter> program = {
      BPF_STMT(BPF_LD | BPF_W | BPF_ABS, offsetof(seccomp_data, arch)),
      // Calls by another ABI have other numbers.
      BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, kArchitecture, 1, 0),
      BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_KILL_PROCESS),
      BPF_STMT(BPF_LD | BPF_W | BPF_ABS, offsetof(seccomp_data, nr)),
  };
#if defined(__x86_64__)
  constexpr unsigned kX32 = 0x40000000;
  program.push_back(BPF_JUMP(BPF_JMP | BPF_JGE | BPF_K, kX32, 0, 1));
  program.push_back(BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ERRNO | EPERM));
#endif
  const auto refuse = [&](long number) {
    program.push_back(BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, static_cast<unsigned>(number), 0, 1));
    program.push_back(BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ERRNO | EPERM));
  };
  // Calls whose first argument is a process may only name this one.
  const auto refuse_unless = [&](long number, unsigned process) {
    static_assert(std::endian::native == std::endian::little);
    program.push_back(BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, static_cast<unsigned>(number), 0, 4));
    program.push_back(BPF_STMT(BPF_LD | BPF_W | BPF_ABS, offsetof(seccomp_data, args)));
    program.push_back(BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, process, 0, 1));
    program.push_back(BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ALLOW));
    program.push_back(BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ERRNO | EPERM));
  };
  for (const long number : kRefused) refuse(number);
  refuse_unless(SYS_tgkill, static_cast<unsigned>(getpid()));  // abort() signals itself
  refuse_unless(SYS_prlimit64, 0);
  if (reads == ChildReads::nothing) {
    for (const long number : kOpening) refuse(number);
  }
  program.push_back(BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ALLOW));
  const sock_fprog filter{static_cast<unsigned short>(program.size()), program.data()};
  (void)prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &filter);
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
