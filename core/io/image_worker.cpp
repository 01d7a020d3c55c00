// SPDX-License-Identifier: Apache-2.0
#include "core/io/image_worker.h"

#include <fcntl.h>
#include <poll.h>
#include <pthread.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <memory>
#include <mutex>
#include <new>
#include <optional>
#include <string_view>
#include <thread>
#include <utility>
#include <vector>

#include "core/base/append_bytes.h"
#include "core/base/limited_child.h"
#include "core/base/module.h"
#include "core/io/image_library.h"
#include "core/io/input_file.h"
#include "core/types/error.h"

namespace fringeslam {

namespace {

// Messages between this process and a worker, one per packet: a kind and its values.
//   request:  kDecode, file size, as_float, format (with a descriptor)
//   worker:   kImageHeader, width, height, type, names of channels, each ended by a zero
//   request:  kPixelMemory, bytes of the shared memory; omitted if the memory of an earlier image suffices
//   worker:   kDone; or at any time kError, message; kTimeout; kNeedsLibrary, if a worker without OpenImageIO cannot decode it
constexpr char kDecode = 'd', kImageHeader = 'h', kPixelMemory = 'p', kDone = 'x', kError = 'e', kTimeout = 't',
               kNeedsLibrary = 'l';
constexpr size_t kMostMessage = 60000;  // channels: OpenCV has at most 512

// Processor time of a worker for a file, and the time after which it ends even if it waits for something.
constexpr double kTime_s = 8, kTimePerByte_s = 1e-7, kWaitFactor = 8;
// Address space beyond that of the file and the pixels, and in total.
constexpr uint64_t kScratchBytes = 512 * kMebibyte, kMostBytes = 8192 * kMebibyte;
constexpr size_t kLargestKept = 256 * kMebibyte;  // shared memory of a worker that waits for the next file

// An open descriptor.
class OpenDescriptor {
 public:
  explicit OpenDescriptor(int number = -1) : number_(number) {}
  OpenDescriptor(OpenDescriptor&& other) noexcept : number_(std::exchange(other.number_, -1)) {}
  OpenDescriptor& operator=(OpenDescriptor&& other) noexcept {
    std::swap(number_, other.number_);
    return *this;
  }
  ~OpenDescriptor() { reset(); }
  void reset() {
    if (number_ >= 0) close(number_);
    number_ = -1;
  }
  int get() const { return number_; }

 private:
  int number_;
};

// A shared mapping of a descriptor.
class SharedMemory {
 public:
  ~SharedMemory() { reset(); }
  bool map(int descriptor, size_t bytes) {
    if (bytes <= bytes_) return true;
    reset();
    void* at = mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_SHARED, descriptor, 0);
    if (at == MAP_FAILED) return false;
    at_ = at, bytes_ = bytes;
    return true;
  }
  void* data() const { return at_; }
  size_t size() const { return bytes_; }

 private:
  void reset() {
    if (at_) munmap(at_, bytes_);
    at_ = nullptr, bytes_ = 0;
  }
  void* at_ = nullptr;
  size_t bytes_ = 0;
};

// --- packets ---

bool send_packet(int socket, const std::string& packet, const std::vector<int>& descriptors = {}) {
  iovec part{const_cast<char*>(packet.data()), packet.size()};
  alignas(cmsghdr) std::array<char, CMSG_SPACE(2 * sizeof(int))> control{};
  msghdr message{};
  message.msg_iov = &part, message.msg_iovlen = 1;
  if (!descriptors.empty()) {
    const size_t bytes = descriptors.size() * sizeof(int);
    message.msg_control = control.data(), message.msg_controllen = CMSG_SPACE(bytes);
    cmsghdr* head = CMSG_FIRSTHDR(&message);
    head->cmsg_level = SOL_SOCKET, head->cmsg_type = SCM_RIGHTS, head->cmsg_len = CMSG_LEN(bytes);
    std::memcpy(CMSG_DATA(head), descriptors.data(), bytes);
  }
  ssize_t sent;
  do {
    sent = sendmsg(socket, &message, MSG_NOSIGNAL);
  } while (sent < 0 && errno == EINTR);
  return sent == static_cast<ssize_t>(packet.size());
}

// Receives a packet and the descriptors that came with it. Returns an empty text at the end.
std::string receive_packet(int socket, std::vector<OpenDescriptor>* descriptors = nullptr) {
  static thread_local std::array<char, kMostMessage> buffer;
  iovec part{buffer.data(), buffer.size()};
  alignas(cmsghdr) std::array<char, CMSG_SPACE(2 * sizeof(int))> control{};
  msghdr message{};
  message.msg_iov = &part, message.msg_iovlen = 1;
  message.msg_control = control.data(), message.msg_controllen = control.size();
  ssize_t count;
  do {
    count = recvmsg(socket, &message, MSG_CMSG_CLOEXEC);
  } while (count < 0 && errno == EINTR);
  for (cmsghdr* head = CMSG_FIRSTHDR(&message); head; head = CMSG_NXTHDR(&message, head)) {
    if (head->cmsg_level != SOL_SOCKET || head->cmsg_type != SCM_RIGHTS) continue;
    std::array<int, 2> numbers{-1, -1};
    const size_t received = (head->cmsg_len - CMSG_LEN(0)) / sizeof(int);
    std::memcpy(numbers.data(), CMSG_DATA(head), std::min(received, numbers.size()) * sizeof(int));
    for (size_t i = 0; i < std::min(received, numbers.size()); ++i) {
      OpenDescriptor descriptor(numbers[i]);
      if (descriptors) descriptors->push_back(std::move(descriptor));
    }
  }
  return {buffer.data(), static_cast<size_t>(std::max<ssize_t>(count, 0))};
}

// Reads values from a packet. A packet that is too short sets failed().
class PacketFields {
 public:
  explicit PacketFields(const std::string& packet) : packet_(packet) {}
  template <class T>
  T value() {
    T v{};
    if (sizeof v > packet_.size() - at_) {
      failed_ = true;
      return v;
    }
    std::memcpy(&v, packet_.data() + at_, sizeof v);
    at_ += sizeof v;
    return v;
  }
  std::string rest() const { return packet_.substr(at_); }
  bool failed() const { return failed_; }

 private:
  const std::string& packet_;
  size_t at_ = 1;  // after the kind
  bool failed_ = false;
};

// --- the worker ---

// Nothing but system calls, because it runs in a signal handler. A file that takes too much work is damaged; a worker that waits
// without working is stuck, and another one is tried.
int timeout_socket = -1;
void on_timeout(int signal) {
  if (signal == SIGPROF) (void)!write(timeout_socket, &kTimeout, 1);
  _exit(1);
}

itimerval seconds(double time_s) {
  itimerval timer{};
  timer.it_value.tv_sec = static_cast<time_t>(std::ceil(time_s));
  return timer;
}

void limit_time(double time_s) {
  const itimerval work = seconds(time_s), wait = seconds(kWaitFactor * time_s);
  setitimer(ITIMER_PROF, &work, nullptr);
  setitimer(ITIMER_REAL, &wait, nullptr);
}

std::string read_whole(int descriptor, uint64_t size, const std::string& name) {
  std::string bytes(size, '\0');
  size_t filled = 0;
  while (filled < bytes.size()) {
    const ssize_t count = pread(descriptor, bytes.data() + filled, bytes.size() - filled, static_cast<off_t>(filled));
    if (count < 0 && errno == EINTR) continue;
    if (count < 0) throw Error(name + ": cannot be read: " + std::strerror(errno));
    if (count == 0) break;
    filled += static_cast<size_t>(count);
  }
  bytes.resize(filled);
  return bytes;
}

// Writes, because sending is refused with the other calls of sockets.
void reply(int socket, const std::string& packet) {
  if (!write_all(socket, packet.data(), packet.size())) _exit(0);
}

// True if the pixels have a place in memory that was mapped for an earlier image. Sizes that no image can have are left to the
// other process to refuse.
bool suffices(const SharedMemory& memory, const ImageHeader& header) {
  constexpr int kMostSide = 1 << 20;
  const auto& [width, height] = header.size;
  return width > 0 && height > 0 && width <= kMostSide && height <= kMostSide &&
         uint64_t{static_cast<uint64_t>(width)} * static_cast<uint64_t>(height) * CV_ELEM_SIZE(header.type) <=
             memory.size();
}

void serve_file(int socket, int shared, SharedMemory& memory, uint64_t base_bytes, const std::string& packet, int file,
                bool with_library) {
  const auto limit_memory = [&](uint64_t bytes) {
    limit_address_space(base_bytes + memory.size() + kScratchBytes + 2 * bytes, base_bytes + kMostBytes);
  };
  PacketFields fields(packet);
  const auto size = fields.value<uint64_t>();
  ImageRequest request;
  request.as_float = fields.value<bool>();
  request.format = fields.rest();
  limit_time(kTime_s + kTimePerByte_s * static_cast<double>(size));
  limit_memory(size);
  try {
    const std::string bytes = read_whole(file, size, "");
    const auto allocate = [&](const ImageHeader& header) {
      std::string answer(1, kImageHeader);
      for (const int value : {header.size.width, header.size.height, header.type}) append_bytes(answer, value);
      for (const std::string& name : header.channels) answer += std::string(name.c_str()) + '\0';
      if (answer.size() > kMostMessage) throw Error(": has names of channels that are too long");
      reply(socket, answer);
      uint64_t pixels = memory.size();
      if (!suffices(memory, header)) {
        const std::string accepted = receive_packet(socket);
        if (accepted.empty() || accepted[0] != kPixelMemory) _exit(0);
        pixels = PacketFields(accepted).value<uint64_t>();
      }
      limit_time(kTime_s + kTimePerByte_s * static_cast<double>(size + pixels));
      limit_memory(size + pixels);
      if (!memory.map(shared, pixels)) throw std::bad_alloc();
      return cv::Mat(header.size, header.type, memory.data());
    };
    bool decoded = true;
    if (with_library)
      decode_here(bytes, request, "", allocate);
    else
      decoded = decode_without_library(bytes, request, "", allocate).has_value();
    reply(socket, std::string(1, decoded ? kDone : kNeedsLibrary));
  } catch (const std::bad_alloc&) {
    reply(socket, std::string(1, kError) + ": decoding it needs too much memory; it is damaged, or too large");
  } catch (const std::exception& e) {
    reply(socket, kError + std::string(e.what()).substr(0, kMostMessage / 2));
  }
}

[[noreturn]] void serve(int socket, int shared, bool with_library) {
  timeout_socket = socket;
  for (const int signal : {SIGPROF, SIGALRM}) std::signal(signal, on_timeout);
  const uint64_t base_bytes = address_space_bytes();
  restrict_child(ChildReads::nothing);
  SharedMemory memory;
  for (;;) {
    limit_time(0);  // none while it waits
    std::vector<OpenDescriptor> files;
    const std::string packet = receive_packet(socket, &files);
    if (packet.empty() || packet[0] != kDecode || files.size() != 1) _exit(0);
    serve_file(socket, shared, memory, base_bytes, packet, files[0].get(), with_library);
  }
}

// --- the process that forks workers ---

// Decodes an image of one pixel, so that the library has loaded what it needs before a worker can no longer open files.
void use_library_once() {
  use_no_image_threads();
  // PBM: the smallest image there is.
  const std::string pixel("P4\n1 1\n\0", 8);
  for (const char* format : {"pnm", "openexr", "tiff"}) {
    try {
      decode_here(pixel, {format}, "", [](const ImageHeader& header) { return cv::Mat(header.size, header.type); });
    } catch (const std::exception&) {
      continue;  // which is what the other two readers say to it
    }
  }
}

std::ptrdiff_t threads_of_this_process() {
  const std::filesystem::directory_iterator threads("/proc/self/task");
  return std::distance(begin(threads), end(threads));
}

// True if all threads but this one wait for something.
bool other_threads_wait() {
  const std::string own = std::to_string(gettid());
  for (const auto& thread : std::filesystem::directory_iterator("/proc/self/task")) {
    if (thread.path().filename() == own) continue;
    std::ifstream file(thread.path() / "stat");
    const std::string stat(std::istreambuf_iterator<char>(file), {});
    const size_t name_end = stat.rfind(") ");  // the name may contain parentheses
    if (name_end != std::string::npos && stat[name_end + 2] != 'S') return false;
  }
  return true;
}

// Loads OpenImageIO into the process that forks workers. Returns why it cannot.
std::string load_library() {
  constexpr unsigned kLongest_s = 20;
  alarm(kLongest_s);
  std::string failure;
  try {
    (void)image_library();
    // Libraries that it depends on start threads, which wait for work that they never get.
    const std::ptrdiff_t waiting = threads_of_this_process();
    use_library_once();
    // It creates a thread before it learns that it should not. Until that thread has ended, it may hold a lock, which would
    // stay locked in a forked worker.
    while (threads_of_this_process() > waiting) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    // Nor may the threads that remain still be on their way to where they wait.
    for (int times = 0; times < 3; times = other_threads_wait() ? times + 1 : 0)
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
  } catch (const std::exception& e) {
    failure = e.what();
  }
  alarm(0);
  return failure;
}

// Kinds of workers, as they are requested.
constexpr char kWorker = 'w', kWorkerWithLibrary = 'l';

[[noreturn]] void fork_workers(int requests) {
  detach_child();
  (void)!chdir("/");
  requests = keep_only_descriptor(requests);
  sigset_t none;
  sigemptyset(&none);
  sigprocmask(SIG_SETMASK, &none, nullptr);
  for (const int signal : {SIGHUP, SIGPIPE, SIGCHLD}) std::signal(signal, SIG_IGN);
  std::signal(SIGALRM, SIG_DFL);
  for (bool library_loaded = false;;) {
    std::vector<OpenDescriptor> ends;
    const std::string packet = receive_packet(requests, &ends);
    if (packet.empty()) _exit(0);  // no process is left that could ask
    if (ends.size() != 2) continue;
    const bool with_library = packet[0] == kWorkerWithLibrary;
    if (with_library && !library_loaded) {
      if (const std::string failure = load_library(); !failure.empty()) {
        // Closing a socket with a request that was not read would discard the answer.
        (void)receive_packet(ends[0].get());
        (void)send_packet(ends[0].get(), kError + (": cannot be read: " + failure));
        continue;
      }
      library_loaded = true;
    }
    if (fork() == 0) {
      close(requests);
      serve(ends[0].get(), ends[1].get(), with_library);
    }
  }
}

// --- this process ---

struct ImageWorker {
  OpenDescriptor socket, shared;
  SharedMemory memory;
};

class ImageWorkers {
 public:
  // Never destroyed: threads may still decode while the program exits.
  static ImageWorkers& instance() {
    static auto* workers = new ImageWorkers;
    return *workers;
  }

  void prepare() {
    const std::lock_guard lock(mutex_);
    if (forker_.get() < 0) start_forker();
  }

  // Returns a worker that waits, if one may be `reused`, or a new one.
  std::unique_ptr<ImageWorker> take(const std::string& name, char kind, bool reused) {
    const std::lock_guard lock(mutex_);
    std::vector<std::unique_ptr<ImageWorker>>& idle = idle_[kind == kWorkerWithLibrary];
    while (reused && !idle.empty()) {
      std::unique_ptr<ImageWorker> worker = std::move(idle.back());
      idle.pop_back();
      pollfd state{worker->socket.get(), POLLIN, 0};
      if (poll(&state, 1, 0) == 0) return worker;  // otherwise it has ended
    }
    try {
      return started(kind);
    } catch (const Error& e) {
      throw Error(name + ": " + e.what());
    }
  }

  // Lets the next worker come from another process: that which forks them may be stuck, or may have inherited a lock that a
  // thread of this process held, which stops all workers.
  void replace_forker() {
    const std::lock_guard lock(mutex_);
    forker_.reset();
  }

  void give_back(std::unique_ptr<ImageWorker> worker, char kind) {
    if (worker->memory.size() > kLargestKept) return;
    const std::lock_guard lock(mutex_);
    idle_[kind == kWorkerWithLibrary].push_back(std::move(worker));
  }

 private:
  ImageWorkers() { pthread_atfork(&before_fork, &after_fork, &in_child); }

  // A forked process must not use the workers of its parent, but it shares the process that forks them.
  static void before_fork() {
    if (!forks_) instance().mutex_.lock();
  }
  static void after_fork() {
    if (!forks_) instance().mutex_.unlock();
  }
  static void in_child() {
    if (forks_) return;
    for (auto& idle : instance().idle_) idle.clear();
    instance().mutex_.unlock();
  }

  [[noreturn]] static void fail(const char* what) {
    throw Error(std::string("cannot be decoded: ") + what + ": " + std::strerror(errno) +
                "; check the limits of processes and open files");
  }

  void start_forker() {
    locate_modules();  // it changes its working folder
    int ends[2];
    if (socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, ends) != 0) fail("cannot create a socket");
    OpenDescriptor ours(ends[0]), theirs(ends[1]);
    // Forked twice, so that programs that wait for all their children do not wait for this one.
    forks_ = true;
    const pid_t child = fork();
    if (child == 0) {
      if (fork() == 0) fork_workers(theirs.get());
      _exit(0);
    }
    forks_ = false;
    if (child < 0) fail("cannot start a process");
    while (waitpid(child, nullptr, 0) < 0 && errno == EINTR) continue;
    forker_ = std::move(ours);
  }

  std::unique_ptr<ImageWorker> started(char kind) {
    int ends[2];
    if (socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, ends) != 0) fail("cannot create a socket");
    auto worker = std::make_unique<ImageWorker>();
    worker->socket = OpenDescriptor(ends[0]);
    const OpenDescriptor theirs(ends[1]);
    worker->shared = OpenDescriptor(memfd_create("fringeslam-image", MFD_CLOEXEC | MFD_ALLOW_SEALING));
    // Otherwise a worker could shorten it while this process reads it.
    if (worker->shared.get() < 0 || fcntl(worker->shared.get(), F_ADD_SEALS, F_SEAL_SHRINK) != 0)
      fail("cannot create shared memory");
    const std::vector<int> both = {theirs.get(), worker->shared.get()};
    const std::string request(1, kind);
    if (forker_.get() >= 0 && send_packet(forker_.get(), request, both)) return worker;
    forker_.reset();  // it was killed
    start_forker();
    if (!send_packet(forker_.get(), request, both)) fail("cannot start a process");
    return worker;
  }

  static thread_local bool forks_;  // the mutex is held by this thread, which forks
  std::mutex mutex_;
  std::array<std::vector<std::unique_ptr<ImageWorker>>, 2> idle_;  // without OpenImageIO, and with it
  OpenDescriptor forker_;
};

thread_local bool ImageWorkers::forks_ = false;

std::atomic<bool> decodes_here{false};

OpenDescriptor in_memory(const ImageSource& source) {
  OpenDescriptor file(memfd_create("fringeslam-encoded", MFD_CLOEXEC));
  if (file.get() < 0 || !write_all(file.get(), source.bytes->data(), source.bytes->size()))
    throw Error(source.name + ": cannot be passed to the image decoder: " + std::strerror(errno));
  return file;
}

struct WorkerEnded {};

// Returns the worker's next packet, of a wanted kind. Throws its Error, or WorkerEnded.
std::string answer(ImageWorker& worker, std::string_view wanted, double most_s, const std::string& name) {
  const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(most_s);
  pollfd waiting{worker.socket.get(), POLLIN, 0};
  for (int ready = 0; ready <= 0;) {
    const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(end - std::chrono::steady_clock::now());
    ready = left.count() <= 0 ? 0 : poll(&waiting, 1, static_cast<int>(left.count()));
    if (ready == 0) throw WorkerEnded();
  }
  const std::string packet = receive_packet(worker.socket.get());
  const char kind = packet.empty() ? '\0' : packet[0];
  if (wanted.find(kind) != std::string_view::npos) return packet;
  if (kind == kTimeout)
    throw Error(name + ": decoding it takes too long; the file is damaged: record or render it again");
  if (kind != kError) throw WorkerEnded();
  std::string message = packet.substr(1);
  std::replace_if(
      message.begin(), message.end(), [](unsigned char c) { return c < ' '; }, ' ');
  throw Error(name + message);
}

ImageHeader header_of(const std::string& packet, const std::string& name) {
  PacketFields fields(packet);
  ImageHeader header;
  header.size.width = fields.value<int>();
  header.size.height = fields.value<int>();
  header.type = fields.value<int>();
  const std::string names = fields.rest();
  for (size_t at = 0, end; (end = names.find('\0', at)) != std::string::npos; at = end + 1)
    header.channels.push_back(names.substr(at, end - at));
  const int depth = CV_MAT_DEPTH(header.type);
  if (fields.failed() || CV_MAKETYPE(depth, CV_MAT_CN(header.type)) != header.type ||
      (depth != CV_8U && depth != CV_16U && depth != CV_32F) ||
      header.channels.size() != static_cast<size_t>(CV_MAT_CN(header.type)))
    throw Error(name + ": the image decoder returned an invalid header; the file is damaged");
  return header;
}

// Returns nothing if the worker lacks the library that the file needs.
std::optional<cv::Mat> decoded_by_worker(const ImageSource& source, int descriptor, const ImageRequest& request,
                                         const AllocateImage& allocate, char kind, bool reused) {
  std::unique_ptr<ImageWorker> worker = ImageWorkers::instance().take(source.name, kind, reused);
  std::string packet(1, kDecode);
  append_bytes(packet, source.size);
  append_bytes(packet, request.as_float);
  packet += request.format;
  // A failure is seen as the end of the answers.
  (void)send_packet(worker->socket.get(), packet, {descriptor});
  const auto longest_s = [](uint64_t bytes) {
    constexpr double kMargin = 1.5;
    return kMargin * kWaitFactor * (kTime_s + kTimePerByte_s * static_cast<double>(bytes));
  };
  const std::string first =
      answer(*worker, std::string{kImageHeader, kNeedsLibrary}, longest_s(source.size), source.name);
  if (first[0] == kNeedsLibrary) {
    ImageWorkers::instance().give_back(std::move(worker), kind);
    return std::nullopt;
  }
  const ImageHeader header = header_of(first, source.name);
  cv::Mat image = allocate(header);
  const size_t bytes = image.total() * image.elemSize();
  if (!suffices(worker->memory, header)) {
    if (ftruncate(worker->shared.get(), static_cast<off_t>(bytes)) != 0 ||
        !worker->memory.map(worker->shared.get(), bytes))
      throw Error(source.name + ": no shared memory for " + std::to_string(bytes >> 20) +
                  " MiB of pixels: " + std::strerror(errno));
    packet.assign(1, kPixelMemory);
    append_bytes(packet, static_cast<uint64_t>(bytes));
    (void)send_packet(worker->socket.get(), packet);
  }
  (void)answer(*worker, std::string{kDone}, longest_s(source.size + bytes), source.name);
  std::memcpy(image.data, worker->memory.data(), bytes);
  // After an error it ends, because a damaged file may have left it in any state.
  ImageWorkers::instance().give_back(std::move(worker), kind);
  return image;
}

}  // namespace

void prepare_image_decoding() {
  if (decodes_here) return;
  try {
    ImageWorkers::instance().prepare();
  } catch (const Error&) {
    return;  // decoding will report it
  }
}

void decode_in_this_process(bool here) { decodes_here = here; }

cv::Mat decode_image_file(const ImageSource& source, const ImageRequest& request, const AllocateImage& allocate) {
  if (decodes_here)
    return decode_here(source.bytes ? *source.bytes : read_whole(source.descriptor, source.size, source.name), request,
                       source.name, allocate);
  const OpenDescriptor copy = source.bytes ? in_memory(source) : OpenDescriptor();
  const Error crashed(source.name + ": the image decoder crashed; the file is damaged: record or render it again");
  // The worker that waited may have been killed or be stuck, and so may the process that forks new ones, which the third
  // attempt replaces.
  const auto decoded = [&](char kind) -> std::optional<cv::Mat> {
    for (int attempt = 0; attempt < 3; ++attempt) {
      try {
        return decoded_by_worker(source, source.bytes ? copy.get() : source.descriptor, request, allocate, kind,
                                 attempt == 0);
      } catch (const WorkerEnded&) {
        if (attempt == 1) ImageWorkers::instance().replace_forker();
      }
    }
    throw crashed;
  };
  std::optional<cv::Mat> image;
  if (!needs_library(request)) image = decoded(kWorker);
  if (!image) image = decoded(kWorkerWithLibrary);
  if (!image) throw crashed;  // it asks for what it has
  return *std::move(image);
}

}  // namespace fringeslam
