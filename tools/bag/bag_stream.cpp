// SPDX-License-Identifier: Apache-2.0
#include "tools/bag/bag_stream.h"

#include <fcntl.h>
#include <poll.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <cstring>
#include <new>
#include <utility>

#include "core/base/append_bytes.h"
#include "core/base/limited_child.h"
#include "core/types/error.h"

namespace fringeslam::tools {

namespace fs = std::filesystem;

namespace {

constexpr double kMemoryLimit_gib = 4;
constexpr int kSilence_ms = 120000;              // longest time without a message
constexpr uint64_t kLargestRecord = 1ull << 31;  // more than the largest image

// Records in the pipe: kind, size, bytes.
constexpr char kTopics = 't', kMessage = 'm', kEnd = 'x', kRefusal = 'r', kFailure = 'e';

double time_limit_s(const fs::path& file) {
  std::error_code ignored;
  return 60 + 1e-7 * static_cast<double>(fs::file_size(file, ignored));
}

void append_text(std::string& bytes, const std::string& text) {
  append_bytes(bytes, static_cast<uint64_t>(text.size()));
  bytes += text;
}

class Unpacker {
 public:
  explicit Unpacker(const std::string& bytes) : bytes_(bytes) {}
  template <class T>
  T value() {
    T v;
    std::memcpy(&v, take(sizeof v), sizeof v);
    return v;
  }
  std::string text() {
    const auto size = value<uint64_t>();
    return {take(size), size};
  }
  const char* take(size_t size) {
    if (size > bytes_.size() - at_) throw Error("the bag reader's output is truncated");
    at_ += size;
    return bytes_.data() + at_ - size;
  }
  size_t left() const { return bytes_.size() - at_; }

 private:
  const std::string& bytes_;
  size_t at_ = 0;
};

std::string packed(const std::vector<BagTopic>& topics) {
  std::string bytes;
  append_bytes(bytes, static_cast<uint64_t>(topics.size()));
  for (const BagTopic& topic : topics) {
    append_text(bytes, topic.name);
    append_text(bytes, topic.type);
    append_bytes(bytes, topic.messages);
  }
  return bytes;
}

std::string packed(const BagMessage& message) {
  std::string bytes;
  append_text(bytes, message.topic);
  append_bytes(bytes, message.recorded);
  append_bytes(bytes, message.stamp);
  append_text(bytes, message.text);
  const BagImage& image = message.image;
  append_text(bytes, image.encoding);
  append_bytes(bytes, image.big_endian);
  append_bytes(bytes, static_cast<uint64_t>(message.path.size()));
  for (const auto& [stamp, pose] : message.path) {
    append_bytes(bytes, stamp);
    append_bytes(bytes, pose.translation_m);
    append_bytes(bytes, pose.xyzw);
  }
  for (const uint32_t value : {image.width, image.height, image.step}) append_bytes(bytes, value);
  bytes.append(reinterpret_cast<const char*>(image.bytes.data()), image.bytes.size());
  return bytes;
}

BagMessage unpacked(const std::string& bytes) {
  Unpacker in(bytes);
  BagMessage message;
  message.topic = in.text();
  message.recorded = in.value<BagTime>();
  message.stamp = in.value<BagTime>();
  message.text = in.text();
  BagImage& image = message.image;
  image.encoding = in.text();
  image.big_endian = in.value<bool>();
  for (auto left = in.value<uint64_t>(); left > 0; --left) {
    const auto stamp = in.value<BagTime>();
    const auto translation_m = in.value<std::array<double, 3>>();
    message.path.push_back({stamp, {translation_m, in.value<std::array<double, 4>>()}});
  }
  for (uint32_t* value : {&image.width, &image.height, &image.step}) *value = in.value<uint32_t>();
  const size_t size = in.left();
  const auto* pixels = reinterpret_cast<const uint8_t*>(in.take(size));
  image.bytes.assign(pixels, pixels + size);
  return message;
}

[[noreturn]] void work_as_child(int descriptor, const fs::path& file, const std::vector<std::string>& topics) {
  std::signal(SIGPIPE, SIG_DFL);  // ends with the parent
  enter_limited_child(time_limit_s(file), kMemoryLimit_gib);
  descriptor = keep_only_descriptor(descriptor);
  restrict_child(ChildReads::files);
  const auto send = [&](char kind, const std::string& bytes) {
    std::string head(1, kind);
    append_bytes(head, static_cast<uint64_t>(bytes.size()));
    if (!write_all(descriptor, head.data(), head.size()) || !write_all(descriptor, bytes.data(), bytes.size()))
      _exit(1);
  };
  try {
    read_bag(
        file, topics, [&](const std::vector<BagTopic>& all) { send(kTopics, packed(all)); },
        [&](const BagMessage& message) { send(kMessage, packed(message)); });
    send(kEnd, "");
  } catch (const std::bad_alloc&) {
    send(kFailure, "reading it exceeds the memory limit");
  } catch (const Error& e) {
    send(kRefusal, e.what());
  } catch (const std::exception& e) {
    send(kFailure, std::string(e.what()) + "; the file is truncated or damaged: copy or record it again");
  }
  _exit(0);
}

}  // namespace

BagStream::BagStream(fs::path file, const std::vector<std::string>& topics) : file_(std::move(file)) {
  require_bags(file_.string());
  int ends[2];
  if (pipe2(ends, O_CLOEXEC) != 0) throw Error(file_.string() + ": cannot create a pipe to the bag reader");
  child_ = fork();
  if (child_ < 0) throw Error(file_.string() + ": cannot start a process for the bag reader");
  if (child_ == 0) {
    work_as_child(ends[1], file_, topics);
  }
  close(ends[1]);
  pipe_ = ends[0];
  try {
    char kind = 0;
    const std::string bytes = record(kind);
    Unpacker in(bytes);
    for (auto left = in.value<uint64_t>(); left > 0; --left) {
      BagTopic topic;
      topic.name = in.text(), topic.type = in.text(), topic.messages = in.value<uint64_t>();
      topics_.push_back(std::move(topic));
    }
  } catch (...) {
    stop();
    throw;
  }
}

BagStream::~BagStream() { stop(); }

void BagStream::stop() {
  if (pipe_ >= 0) close(pipe_);
  pipe_ = -1;
  end_child();
}

int BagStream::end_child() {
  int status = 0;
  if (child_ > 0) {  // kill(-1) would end every process of the user
    kill(child_, SIGKILL);
    while (waitpid(child_, &status, 0) < 0 && errno == EINTR) continue;
  }
  child_ = -1;
  return status;
}

void BagStream::report_death() {
  const int status = end_child();
  if (WIFSIGNALED(status) && WTERMSIG(status) == SIGXCPU)
    throw Error(file_.string() + ": reading it takes too long; the bag is broken");
  throw Error(file_.string() + ": the bag reader crashed; the bag is probably broken, record or copy it again");
}

void BagStream::read(char* bytes, size_t size) {
  for (size_t done = 0; done < size;) {
    pollfd waiting{pipe_, POLLIN, 0};
    const int ready = poll(&waiting, 1, kSilence_ms);
    if (ready < 0) continue;  // a signal
    if (ready == 0) throw Error(file_.string() + ": reading it takes too long; the bag is broken");
    const ssize_t count = ::read(pipe_, bytes + done, size - done);
    if (count < 0 && errno == EINTR) continue;
    if (count <= 0) report_death();
    done += static_cast<size_t>(count);
  }
}

// Reads one record and its kind. Throws the child's error.
std::string BagStream::record(char& kind) {
  uint64_t size = 0;
  read(&kind, 1);
  read(reinterpret_cast<char*>(&size), sizeof size);
  if (size > kLargestRecord) throw Error(file_.string() + ": a message has " + std::to_string(size) + " bytes");
  std::string bytes(size, '\0');
  read(bytes.data(), size);
  if (kind == kRefusal) throw Error(file_.string() + ": " + bytes);
  if (kind == kFailure) throw Error(file_.string() + ": is not a readable ROS bag: " + bytes);
  return bytes;
}

std::optional<BagMessage> BagStream::next() {
  if (ended_) return std::nullopt;
  char kind = 0;
  const std::string bytes = record(kind);
  ended_ = kind == kEnd;
  if (ended_) return std::nullopt;
  return unpacked(bytes);
}

}  // namespace fringeslam::tools
