// SPDX-License-Identifier: Apache-2.0
// A GigE Vision camera on the loopback interface that views a simulated scene, lit by the contents of an Xvfb
// framebuffer at the time of the exposure:
//
//   fake_camera SERIAL SCENE FRAMEBUFFER CONTROL
//
// CONTROL is a file that is read at each exposure, one `key value` per line:
//   pose N        pose index in the scene's trajectory
//   next_after N  advances to the next pose after every N exposures
//   packed RGB    the projector shows the screen's channels cyclically, one per exposure; default: the green channel
//   delay_ms N    delay before the image is sent
//   lost R        share of packets that are dropped
//   corrupt R S   changes a share R of all packets at random (seed S), replies to commands included, as a hostile camera could
//   fault KIND K  the K-th exposure from now on sees a wrong screen: `repeat` the previous one, as if the projector had
//                 not changed; `black` a black one; `missed`: the camera misses one of the projector's triggers
#include <arv.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <mutex>
#include <random>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include "core/io/files.h"
#include "core/types/error.h"
#include "sim/virtual_rig.h"

namespace {

using namespace fringeslam;

// Reads an X window dump as written by Xvfb (X11's XWDFile.h): a header of big-endian words, colour map, pixels.
cv::Mat3b read_screen(const std::string& file) {
  const std::string bytes = read_bytes(file);
  const auto word = [&](size_t index) {
    uint32_t value = 0;
    for (size_t i = 0; i < 4; ++i) value = value << 8 | static_cast<uint8_t>(bytes.at(4 * index + i));
    return value;
  };
  const size_t header = word(0), width = word(4), height = word(5), bits = word(11), line = word(12),
               colours = word(19);
  if (bits != 32) throw Error(file + ": is not a framebuffer with 32 bits per pixel");
  const size_t start = header + 12 * colours;
  if (bytes.size() < start + line * height) throw Error(file + ": is truncated");
  cv::Mat3b screen(static_cast<int>(height), static_cast<int>(width));
  for (size_t row = 0; row < height; ++row) {
    for (size_t col = 0; col < width; ++col)  // blue, green, red, unused
      std::memcpy(screen(static_cast<int>(row), static_cast<int>(col)).val, &bytes[start + row * line + 4 * col], 3);
  }
  return screen;
}

// Changes packets before they are sent.
class Corruption {
 public:
  void set(double share, unsigned seed) {
    const std::lock_guard lock(mutex_);
    share_ = share;
    random_.seed(seed);
  }

  // Returns false if the packet is to be sent as it is.
  bool change(std::vector<uint8_t>& packet) {
    const std::lock_guard lock(mutex_);
    if (packet.empty() || share_ <= 0 || !std::bernoulli_distribution(share_)(random_)) return false;
    constexpr size_t kHeaderBytes = 64;
    switch (below(5)) {
      case 0:  // headers
        overwrite(packet, std::min(packet.size(), kHeaderBytes), 1 + below(4));
        break;
      case 1:
        overwrite(packet, packet.size(), 1 + below(16));
        break;
      case 2:
        packet.resize(1 + below(packet.size()));
        break;
      case 3:
        overwrite(packet, packet.size(), 2 * packet.size());
        break;
      default:
        packet.resize(packet.size() + 1 + below(100), static_cast<uint8_t>(below(256)));
    }
    return true;
  }

 private:
  size_t below(size_t count) { return std::uniform_int_distribution<size_t>(0, count - 1)(random_); }
  void overwrite(std::vector<uint8_t>& packet, size_t first_bytes, size_t times) {
    constexpr uint8_t kExtremes[] = {0, 1, 0x7f, 0x80, 0xff};
    for (size_t i = 0; i < times; ++i)
      packet[below(first_bytes)] = below(2) ? kExtremes[below(std::size(kExtremes))] : static_cast<uint8_t>(below(256));
  }

  std::mutex mutex_;
  std::mt19937 random_;
  double share_ = 0;
};

Corruption& corruption() {
  static Corruption all;
  return all;
}

class Eye {
 public:
  Eye(const std::string& scene, std::string framebuffer, std::string control)
      : scene_(sim::load_scene(scene)),
        rig_(scene_, options()),
        framebuffer_(std::move(framebuffer)),
        control_(std::move(control)) {}

  void see(ArvBuffer* buffer, double exposure_s, ArvGvFakeCamera* camera) {
    const std::lock_guard lock(mutex_);
    read_control(camera);
    if (fault_in_ == 0 && fault_ == "missed") ++shown_;
    cv::Mat1b screen;
    cv::extractChannel(read_screen(framebuffer_), screen, channel());
    if (fault_in_ == 0 && fault_ == "black") screen = uchar{0};
    if (fault_in_ == 0 && fault_ == "repeat" && !last_.empty()) screen = last_;
    last_ = screen.clone();
    if (fault_in_ >= 0) --fault_in_;
    const size_t pose = (pose_ + (next_after_ > 0 ? number_ / next_after_ : 0)) % scene_.trajectory.size();
    const cv::Mat image = rig_.look(screen, pose, exposure_s, static_cast<int>(number_++));
    ++shown_;
    // Queries the payload, since the buffer's own size is the number of bytes received, here none.
    const size_t size = arv_fake_camera_get_payload(arv_gv_fake_camera_get_fake_camera(camera));
    auto* data = static_cast<uint8_t*>(const_cast<void*>(arv_buffer_get_data(buffer, nullptr)));
    const size_t bytes = image.total() * image.elemSize();
    std::memset(data, 0, size);
    std::memcpy(data, image.data, std::min(size, bytes));
    std::this_thread::sleep_for(std::chrono::milliseconds(delay_ms_));
  }

 private:
  static sim::RenderOptions options() {
    sim::RenderOptions options;
    options.noise = false;
    return options;
  }

  void read_control(ArvGvFakeCamera* camera) {
    std::ifstream in(control_);
    std::string text{std::istreambuf_iterator<char>(in), {}};
    if (text == known_) return;
    known_ = text;
    std::istringstream words(text);
    std::string key;
    while (words >> key) {
      if (key == "pose") words >> pose_;
      if (key == "next_after") words >> next_after_;
      if (key == "packed") words >> packed_;
      if (key == "delay_ms") words >> delay_ms_;
      if (key == "fault") words >> fault_ >> fault_in_;
      double lost = 0, corrupt = 0;
      unsigned seed = 0;
      if (key == "corrupt" && words >> corrupt >> seed) corruption().set(corrupt, seed);
      if (key == "lost" && words >> lost) g_object_set(camera, "gvsp-lost-ratio", lost, nullptr);
    }
  }

  int channel() const {
    if (packed_.empty()) return 1;
    return static_cast<int>(std::string("BGR").find(packed_[shown_ % packed_.size()]));
  }

  sim::Scene scene_;
  sim::VirtualRig rig_;
  std::string framebuffer_, control_, known_, fault_, packed_;
  std::mutex mutex_;
  cv::Mat1b last_;
  size_t pose_ = 0, next_after_ = 0, number_ = 0;
  size_t shown_ = 0;  // number of channels shown, when packed
  int delay_ms_ = 0, fault_in_ = -1;
};

struct Fill {
  Eye* eye;
  ArvGvFakeCamera* camera;
};

void fill(ArvBuffer* buffer, void* data, guint32 exposure_us, guint32, ArvPixelFormat) {
  const auto* self = static_cast<Fill*>(data);
  try {
    self->eye->see(buffer, 1e-6 * exposure_us, self->camera);
  } catch (const std::exception& e) {
    std::fprintf(stderr, "fake_camera: %s\n", e.what());
    std::_Exit(1);
  }
}

volatile std::sig_atomic_t stop = 0;

}  // namespace

// Aravis sends every packet by this function of the C library, which the program replaces.
extern "C" ssize_t sendmsg(int socket, const msghdr* message, int flags) {
  std::vector<uint8_t> packet;
  for (size_t i = 0; i < message->msg_iovlen; ++i) {
    const auto* bytes = static_cast<const uint8_t*>(message->msg_iov[i].iov_base);
    packet.insert(packet.end(), bytes, bytes + message->msg_iov[i].iov_len);
  }
  const auto size = static_cast<ssize_t>(packet.size());
  if (!corruption().change(packet)) return syscall(SYS_sendmsg, socket, message, flags);
  iovec part{packet.data(), packet.size()};
  msghdr changed = *message;
  changed.msg_iov = &part, changed.msg_iovlen = 1;
  return syscall(SYS_sendmsg, socket, &changed, flags) < 0 ? -1 : size;
}

int main(int argc, char** argv) {
  if (argc != 5) {
    std::fprintf(stderr, "usage: fake_camera SERIAL SCENE FRAMEBUFFER CONTROL\n");
    return 2;
  }
  try {
    Eye eye(argv[2], argv[3], argv[4]);
    ArvGvFakeCamera* camera = arv_gv_fake_camera_new("127.0.0.1", argv[1]);
    if (!arv_gv_fake_camera_is_running(camera)) throw Error("the camera's port on 127.0.0.1 is in use");
    Fill data{&eye, camera};
    arv_fake_camera_set_fill_pattern(arv_gv_fake_camera_get_fake_camera(camera), fill, &data);
    std::signal(SIGTERM, [](int) { stop = 1; });
    std::printf("ready\n");
    std::fflush(stdout);
    while (!stop) std::this_thread::sleep_for(std::chrono::milliseconds(20));
    g_object_unref(camera);
  } catch (const std::exception& e) {
    std::fprintf(stderr, "fake_camera: %s\n", e.what());
    return 1;
  }
  return 0;
}
