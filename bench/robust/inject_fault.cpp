// SPDX-License-Identifier: Apache-2.0
// Runs a command and kills it at, or fails, the N-th of its system calls that change or read files below a folder.
//
//   inject_fault FOLDER KILL N COMMAND...     kills the command and its children when call N is about to happen
//   inject_fault FOLDER ERROR N COMMAND...    makes call N fail with ERROR: ENOSPC, EIO, EINTR or EDQUOT
//
// Calls that only read are counted with EIO and EINTR alone. With N = 0 nothing happens to any call. Prints the number of
// calls as "calls: N" on standard error. Exit code: that of the command, 128 + signal if a signal ended it, 125 if tracing
// is not possible here.
//
// The kernel reports the calls through seccomp and ptrace, so that every call is seen, however it is made and whichever
// thread or child makes it. Linux on x86-64.
#include <fcntl.h>
#include <linux/audit.h>
#include <linux/filter.h>
#include <linux/seccomp.h>
#include <signal.h>
#include <stddef.h>
#include <sys/prctl.h>
#include <sys/ptrace.h>
#include <sys/syscall.h>
#include <sys/user.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <set>
#include <string>
#include <vector>

#if defined(__x86_64__)

namespace {

// Where a call names its file: an argument that points to a path or is a descriptor.
enum class Names { path, descriptor };
struct Call {
  long number;
  bool changes;  // false: reads, or depends on the flags of open
  Names names;
  int argument;
};
constexpr Call kCalls[] = {{SYS_open, false, Names::path, 0},
                           {SYS_openat, false, Names::path, 1},
                           {SYS_read, false, Names::descriptor, 0},
                           {SYS_pread64, false, Names::descriptor, 0},
                           {SYS_readv, false, Names::descriptor, 0},
                           {SYS_getdents64, false, Names::descriptor, 0},
                           {SYS_write, true, Names::descriptor, 0},
                           {SYS_pwrite64, true, Names::descriptor, 0},
                           {SYS_writev, true, Names::descriptor, 0},
                           {SYS_creat, true, Names::path, 0},
                           {SYS_rename, true, Names::path, 0},
                           {SYS_renameat, true, Names::path, 1},
                           {SYS_renameat2, true, Names::path, 1},
                           {SYS_link, true, Names::path, 1},
                           {SYS_linkat, true, Names::path, 3},
                           {SYS_unlink, true, Names::path, 0},
                           {SYS_unlinkat, true, Names::path, 1},
                           {SYS_mkdir, true, Names::path, 0},
                           {SYS_mkdirat, true, Names::path, 1},
                           {SYS_rmdir, true, Names::path, 0},
                           {SYS_fsync, true, Names::descriptor, 0},
                           {SYS_fdatasync, true, Names::descriptor, 0},
                           {SYS_syncfs, true, Names::descriptor, 0},
                           {SYS_ftruncate, true, Names::descriptor, 0},
                           {SYS_copy_file_range, true, Names::descriptor, 2},
                           {SYS_sendfile, true, Names::descriptor, 0},
                           {SYS_flock, true, Names::descriptor, 0},
                           {SYS_close, true, Names::descriptor, 0},
                           {SYS_chmod, true, Names::path, 0}};

constexpr int kCannotTrace = 125;

[[noreturn]] void start(char** command) {
  std::vector<sock_filter> program = {BPF_STMT(BPF_LD | BPF_W | BPF_ABS, offsetof(seccomp_data, nr))};
  for (const Call& call : kCalls) {
    program.push_back(BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, static_cast<unsigned>(call.number), 0, 1));
    program.push_back(BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_TRACE));
  }
  program.push_back(BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ALLOW));
  const sock_fprog filter{static_cast<unsigned short>(program.size()), program.data()};
  if (ptrace(PTRACE_TRACEME, 0, nullptr, nullptr) != 0) _exit(kCannotTrace);
  raise(SIGSTOP);
  if (prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) != 0 || prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &filter) != 0)
    _exit(kCannotTrace);
  execvp(command[0], command);
  _exit(127);
}

struct Fault {
  std::string below;
  int error = 0;  // 0: kill
  long at = 0;    // from 1; 0: never
};

unsigned long long argument(const user_regs_struct& registers, int number) {
  const unsigned long long arguments[] = {registers.rdi, registers.rsi, registers.rdx,
                                          registers.r10, registers.r8,  registers.r9};
  return arguments[number];
}

std::string text_at(pid_t thread, unsigned long long address) {
  std::string text;
  for (;; address += sizeof(long)) {
    errno = 0;
    const long word = ptrace(PTRACE_PEEKDATA, thread, address, nullptr);
    if (errno != 0) return text;
    char bytes[sizeof word];
    std::memcpy(bytes, &word, sizeof word);
    for (const char byte : bytes) {
      if (byte == '\0') return text;
      text += byte;
    }
  }
}

std::string linked(const std::string& link) {
  char target[4096];
  const ssize_t length = readlink(link.c_str(), target, sizeof target);
  return length > 0 ? std::string(target, static_cast<size_t>(length)) : "";
}

// Returns the file of a call; relative to a descriptor's folder, that folder's path stands for it.
std::string file_of(pid_t thread, const Call& call, const user_regs_struct& registers) {
  const std::string process = "/proc/" + std::to_string(thread);
  const unsigned long long value = argument(registers, call.argument);
  if (call.names == Names::descriptor) return linked(process + "/fd/" + std::to_string(static_cast<int>(value)));
  const std::string path = text_at(thread, value);
  if (path.starts_with("/")) return path;
  const int folder = call.argument > 0 ? static_cast<int>(argument(registers, call.argument - 1)) : AT_FDCWD;
  return linked(process + (folder == AT_FDCWD ? "/cwd" : "/fd/" + std::to_string(folder))) + "/" + path;
}

// True if the fault may happen to the call at which the thread has stopped.
bool concerns(const Fault& fault, pid_t thread, const user_regs_struct& registers) {
  for (const Call& call : kCalls) {
    if (call.number != static_cast<long>(registers.orig_rax)) continue;
    const bool opens = call.number == SYS_open || call.number == SYS_openat;
    const bool writes = opens && (argument(registers, call.argument + 1) & (O_WRONLY | O_RDWR | O_CREAT)) != 0;
    if (!call.changes && !writes && fault.error != EIO && fault.error != EINTR) return false;
    // Failing to close, lock or list for lack of space is not something that a kernel does.
    const bool full = fault.error == ENOSPC || fault.error == EDQUOT;
    if (full && (call.number == SYS_flock || call.number == SYS_unlink || call.number == SYS_unlinkat ||
                 call.number == SYS_rmdir))
      return false;
    return file_of(thread, call, registers).starts_with(fault.below);
  }
  return false;
}

int run(const Fault& fault, char** command) {
  const pid_t first = fork();
  if (first == 0) start(command);
  int status = 0;
  if (waitpid(first, &status, 0) != first || !WIFSTOPPED(status)) return kCannotTrace;
  const long options = PTRACE_O_TRACESECCOMP | PTRACE_O_TRACECLONE | PTRACE_O_TRACEFORK | PTRACE_O_TRACEVFORK |
                       PTRACE_O_TRACEEXEC | PTRACE_O_EXITKILL;
  if (ptrace(PTRACE_SETOPTIONS, first, nullptr, options) != 0) return kCannotTrace;
  ptrace(PTRACE_CONT, first, nullptr, nullptr);
  std::set<pid_t> known = {first};
  long calls = 0;
  int result = kCannotTrace;
  for (pid_t thread; (thread = waitpid(-1, &status, __WALL)) > 0;) {
    if (WIFEXITED(status) || WIFSIGNALED(status)) {
      known.erase(thread);
      if (thread == first) result = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
      continue;
    }
    int signal = WSTOPSIG(status);
    const int event = status >> 16;
    if (event == PTRACE_EVENT_SECCOMP) {
      signal = 0;
      user_regs_struct registers{};
      if (ptrace(PTRACE_GETREGS, thread, nullptr, &registers) == 0) {
        if (concerns(fault, thread, registers) && ++calls == fault.at) {
          if (fault.error == 0) {
            for (const pid_t other : known) kill(other, SIGKILL);
            kill(thread, SIGKILL);
            continue;
          }
          registers.orig_rax = static_cast<unsigned long long>(-1);
          registers.rax = static_cast<unsigned long long>(-static_cast<long long>(fault.error));
          ptrace(PTRACE_SETREGS, thread, nullptr, &registers);
        }
      }
    } else if (event != 0) {
      signal = 0;
    } else if (!known.contains(thread) && signal == SIGSTOP) {
      signal = 0;  // a new thread
    }
    known.insert(thread);
    ptrace(PTRACE_CONT, thread, nullptr, static_cast<long>(signal));
  }
  std::fprintf(stderr, "calls: %ld\n", calls);
  return result;
}

int error_named(const std::string& name) {
  if (name == "ENOSPC") return ENOSPC;
  if (name == "EIO") return EIO;
  if (name == "EINTR") return EINTR;
  if (name == "EDQUOT") return EDQUOT;
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  const int error = argc > 4 ? error_named(argv[2]) : 0;
  if (argc < 5 || (error == 0 && std::strcmp(argv[2], "KILL") != 0)) {
    std::fprintf(stderr, "usage: inject_fault FOLDER KILL|ENOSPC|EIO|EINTR|EDQUOT N COMMAND...\n");
    return 2;
  }
  return run({argv[1], error, std::atol(argv[3])}, argv + 4);
}

#else

int main() { return 125; }

#endif
