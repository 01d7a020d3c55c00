// SPDX-License-Identifier: Apache-2.0
#include "hw/aravis_camera.h"

#include <arv.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <functional>
#include <optional>
#include <thread>
#include <utility>

#include "core/types/error.h"
#include "core/types/options.h"
#include "hw/network.h"
#include "hw/pixel_formats.h"
#include "hw/words.h"

namespace fringeslam {

namespace {

constexpr int kSocketBytes = 4 << 20;
constexpr int kBuffers = 8;

struct Unreference {
  void operator()(void* object) const { g_object_unref(object); }
};
template <class Object>
using Reference = std::unique_ptr<Object, Unreference>;

std::string text(const char* value) { return value ? value : ""; }

// A command that the camera rejected or did not answer.
struct CommandFailed : Error {
  using Error::Error;
};

// Calls an Aravis function with an error pointer and throws CommandFailed if the error is set.
template <class Call>
auto checked(const std::string& what, const Call& call) {
  GError* error = nullptr;
  const auto rethrow = [&] {
    if (!error) return;
    const std::string reason = error->message;
    g_error_free(error);
    throw CommandFailed("camera: " + what + ": " + reason);
  };
  if constexpr (std::is_void_v<decltype(call(&error))>) {
    call(&error);
    rethrow();
  } else {
    auto result = call(&error);
    rethrow();
    return result;
  }
}

// Converts a time of the system clock, ns since 1970, to one that increases evenly also while that clock is being set:
// intervals between images must be those of a motion.
double even_time_s(uint64_t system_ns) {
  // Difference of both clocks, read so close to each other that the process was not suspended in between.
  const auto system_minus_steady = [] {
    constexpr auto kClose = std::chrono::microseconds(20);
    constexpr int kMost = 100;
    std::chrono::nanoseconds difference{}, least = std::chrono::nanoseconds::max();
    for (int i = 0; i < kMost && least > kClose; ++i) {
      const auto before = std::chrono::steady_clock::now();
      const auto system = std::chrono::system_clock::now();
      const auto after = std::chrono::steady_clock::now();
      if (after - before >= least) continue;
      least = after - before;
      difference = system.time_since_epoch() - (before + (after - before) / 2).time_since_epoch();
    }
    return difference;
  };
  static const std::chrono::nanoseconds at_start = system_minus_steady();
  const std::chrono::nanoseconds set = system_minus_steady() - at_start;
  return std::chrono::duration<double>(std::chrono::nanoseconds(system_ns) - set).count();
}

std::string to_words(const std::vector<FoundCamera>& cameras) {
  std::string words;
  for (const FoundCamera& camera : cameras) words += (words.empty() ? "" : ", ") + camera.id;
  return words;
}

FoundCamera find(const std::string& id) {
  const std::vector<FoundCamera> cameras = find_cameras();
  if (cameras.empty())
    throw Error("camera: none found; is it powered, connected, in the computer's subnet and allowed by the firewall?");
  if (id.empty()) {
    if (cameras.size() == 1) return cameras.front();
    throw Error("camera: several found; set hardware.camera.id to one of: " + to_words(cameras));
  }
  for (const FoundCamera& camera : cameras) {
    if (camera.id == id) return camera;
  }
  throw Error("camera: no camera '" + id + "'; found: " + to_words(cameras));
}

bool is_loopback(const FoundCamera& camera) { return camera.address.starts_with("127."); }

const char* to_words(ArvBufferStatus status) {
  switch (status) {
    case ARV_BUFFER_STATUS_TIMEOUT:
      return "packets timed out";
    case ARV_BUFFER_STATUS_MISSING_PACKETS:
      return "packets are missing";
    case ARV_BUFFER_STATUS_WRONG_PACKET_ID:
      return "packets arrived in the wrong order";
    case ARV_BUFFER_STATUS_SIZE_MISMATCH:
      return "it has an unexpected size";
    case ARV_BUFFER_STATUS_ABORTED:
      return "the transfer was aborted";
    default:
      return "it never arrived";
  }
}

}  // namespace

std::vector<FoundCamera> find_cameras() {
  arv_disable_interface("Fake");
  arv_update_device_list();
  std::vector<FoundCamera> cameras;
  for (unsigned i = 0; i < arv_get_n_devices(); ++i)
    cameras.push_back({text(arv_get_device_id(i)), text(arv_get_device_vendor(i)), text(arv_get_device_model(i)),
                       text(arv_get_device_serial_nbr(i)), text(arv_get_device_address(i)),
                       text(arv_get_device_protocol(i))});
  return cameras;
}

class AravisCamera::Connection {
 public:
  // Without a gain in the settings, `gain` is set, if given: a camera that was switched off returns to its own.
  explicit Connection(const CameraSettings& settings, std::optional<double> gain = {})
      : settings_(settings),
        gain_(settings.gain ? settings.gain : gain),
        found_(find(settings.id)),
        format_(pixel_format(settings.pixel_format)) {
    if (const std::string fault = network_fault(found_.address, settings.packet_bytes, network_interfaces());
        !fault.empty())
      throw Error("camera: " + found_.id + ": " + fault);
    camera_.reset(checked("opening " + found_.id, [&](GError** e) { return arv_camera_new(found_.id.c_str(), e); }));
    ArvDevice* device = arv_camera_get_device(camera_.get());
    if (ARV_IS_GV_DEVICE(device) && !arv_gv_device_is_controller(ARV_GV_DEVICE(device)))
      throw Error("camera: " + found_.id + " is controlled by another program; close that program first");
    g_signal_connect(device, "control-lost",
                     G_CALLBACK(+[](ArvDevice*, gpointer lost) { static_cast<std::atomic<bool>*>(lost)->store(true); }),
                     &lost_);
    arv_camera_set_range_check_policy(camera_.get(), ARV_RANGE_CHECK_POLICY_ENABLE);
    configure();
    open_stream();
  }

  ~Connection() {
    // A lost camera cannot be commanded, and Aravis would wait for its replies.
    if (!lost_) {
      arv_camera_stop_acquisition(camera_.get(), nullptr);
      if (settings_.trigger != "free") arv_camera_clear_triggers(camera_.get(), nullptr);
    }
    g_signal_handlers_disconnect_by_data(arv_camera_get_device(camera_.get()), &lost_);
  }

  void set_exposure_s(double exposure_s) {
    double least_us = 0, most_us = 0;
    checked("exposure limits",
            [&](GError** e) { arv_camera_get_exposure_time_bounds(camera_.get(), &least_us, &most_us, e); });
    if (!(1e6 * exposure_s >= least_us && 1e6 * exposure_s <= most_us))
      throw UnsupportedExposure("camera: " + found_.id + " supports exposures from " + to_text(1e-6 * least_us) +
                                " to " + to_text(1e-6 * most_us) + " s, not " + to_text(exposure_s) + " s");
    const double earlier_s = settings_.exposure_s;
    const auto set = [&](double wanted_s) {
      checked("exposure", [&](GError** e) { arv_camera_set_exposure_time(camera_.get(), 1e6 * wanted_s, e); });
      settings_.exposure_s = wanted_s;
      read_exposure();
    };
    try {
      set(exposure_s);
    } catch (const CommandFailed&) {
      throw;                    // the camera is lost
    } catch (const Error& e) {  // it rounds to another exposure
      const std::string reason = e.what();
      set(earlier_s);
      throw UnsupportedExposure(reason);
    }
  }

  const std::string& name() const { return found_.id; }
  std::optional<double> gain() const { return gain_; }
  bool lost() const { return lost_; }
  void give_up() { lost_ = true; }

  // Returns a complete image whose exposure started after the call; empty with the reason otherwise.
  std::optional<GreyImage> take(std::string& reason) {
    const bool by_software = settings_.trigger == "software";
    drain();
    if (by_software)
      checked("trigger", [&](GError** e) { arv_camera_software_trigger(camera_.get(), e); });
    else
      for (int begun_before = 0; begun_before < 2; ++begun_before) (void)receive(reason);
    auto image = next(reason);
    if (!image && by_software && !lost_) restart();
    return image;
  }

  std::optional<GreyImage> next(std::string& reason) {
    auto image = receive(reason);
    ++(image ? statistics_.images : statistics_.refused);
    return image;
  }

  CameraStatistics statistics() const {
    CameraStatistics all = statistics_;
    if (ARV_IS_GV_STREAM(stream_.get())) {
      guint64 resent = 0, missing = 0;
      arv_gv_stream_get_statistics(ARV_GV_STREAM(stream_.get()), &resent, &missing);
      all.resent_packets = resent;
      all.missing_packets = missing;
    }
    return all;
  }

 private:
  void configure() {
    ArvCamera* camera = camera_.get();
    checked("image region", [&](GError** e) {
      arv_camera_set_region(camera, settings_.offset.x, settings_.offset.y, settings_.size.width, settings_.size.height,
                            e);
    });
    checked("pixel format " + format_.name,
            [&](GError** e) { arv_camera_set_pixel_format_from_string(camera, format_.name.c_str(), e); });
    // Cameras without automatic control may have it as a constant.
    if (arv_camera_is_exposure_auto_available(camera, nullptr) &&
        arv_camera_get_exposure_time_auto(camera, nullptr) != ARV_AUTO_OFF)
      checked("automatic exposure", [&](GError** e) { arv_camera_set_exposure_time_auto(camera, ARV_AUTO_OFF, e); });
    checked("exposure", [&](GError** e) { arv_camera_set_exposure_time(camera, 1e6 * settings_.exposure_s, e); });
    if (arv_camera_is_gain_auto_available(camera, nullptr) && arv_camera_get_gain_auto(camera, nullptr) != ARV_AUTO_OFF)
      checked("automatic gain", [&](GError** e) { arv_camera_set_gain_auto(camera, ARV_AUTO_OFF, e); });
    if (gain_) checked("gain", [&](GError** e) { arv_camera_set_gain(camera, *gain_, e); });
    if (!gain_ && arv_camera_is_gain_available(camera, nullptr))
      gain_ = checked("gain", [&](GError** e) { return arv_camera_get_gain(camera, e); });
    read_back();
    if (settings_.trigger == "free")
      checked("trigger", [&](GError** e) { arv_camera_clear_triggers(camera, e); });
    else
      checked("trigger " + settings_.trigger, [&](GError** e) {
        arv_camera_set_trigger(camera, settings_.trigger == "software" ? "Software" : settings_.trigger.c_str(), e);
      });
    checked("acquisition mode",
            [&](GError** e) { arv_camera_set_acquisition_mode(camera, ARV_ACQUISITION_MODE_CONTINUOUS, e); });
  }

  // Cameras round settings to supported values, and some silently accept unsupported ones.
  void read_back() {
    ArvCamera* camera = camera_.get();
    int x = 0, y = 0, width = 0, height = 0;
    checked("image region", [&](GError** e) { arv_camera_get_region(camera, &x, &y, &width, &height, e); });
    if (cv::Size(width, height) != settings_.size || cv::Point(x, y) != settings_.offset)
      throw Error("camera: the image region is " + to_words({width, height}) + " at (" + std::to_string(x) + ", " +
                  std::to_string(y) + "), not " + to_words(settings_.size) + " at (" +
                  std::to_string(settings_.offset.x) + ", " + std::to_string(settings_.offset.y) +
                  "); choose a region that the camera supports");
    const std::string format =
        checked("pixel format", [&](GError** e) { return text(arv_camera_get_pixel_format_as_string(camera, e)); });
    if (format != format_.name) throw Error("camera: the pixel format is " + format + ", not " + format_.name);
    read_exposure();
  }

  void read_exposure() {
    exposure_s_ =
        1e-6 * checked("exposure", [&](GError** e) { return arv_camera_get_exposure_time(camera_.get(), e); });
    if (std::abs(exposure_s_ - settings_.exposure_s) > 0.05 * settings_.exposure_s)
      throw Error("camera: the exposure is " + to_text(exposure_s_) + " s, not " + to_text(settings_.exposure_s) +
                  " s; choose an exposure that the camera supports");
  }

  void open_stream() {
    ArvCamera* camera = camera_.get();
    if (arv_camera_is_gv_device(camera)) {
      if (is_loopback(found_)) arv_camera_gv_set_stream_options(camera, ARV_GV_STREAM_OPTION_PACKET_SOCKET_DISABLED);
      if (settings_.packet_bytes > 0)
        checked("packet size", [&](GError** e) { arv_camera_gv_set_packet_size(camera, settings_.packet_bytes, e); });
      else if (!is_loopback(found_))
        checked("packet size", [&](GError** e) { return arv_camera_gv_auto_packet_size(camera, e); });
    }
    stream_.reset(checked("stream", [&](GError** e) { return arv_camera_create_stream(camera, nullptr, nullptr, e); }));
    if (ARV_IS_GV_STREAM(stream_.get()))
      g_object_set(stream_.get(), "socket-buffer", ARV_GV_STREAM_SOCKET_BUFFER_FIXED, "socket-buffer-size",
                   kSocketBytes, nullptr);
    const guint payload = checked("payload", [&](GError** e) { return arv_camera_get_payload(camera, e); });
    check_payload(format_, settings_.size, payload);
    for (int i = 0; i < kBuffers; ++i) arv_stream_push_buffer(stream_.get(), arv_buffer_new_allocate(payload));
    checked("start", [&](GError** e) { arv_camera_start_acquisition(camera, e); });
  }

  void return_buffer(ArvBuffer* buffer) { arv_stream_push_buffer(stream_.get(), buffer); }

  void drain() {
    while (ArvBuffer* old = arv_stream_try_pop_buffer(stream_.get())) return_buffer(old);
  }

  // After a failed image: keeps an image still in transfer from being taken for that of the next trigger. A new thread accepts
  // cameras that number their images from the beginning again, which Aravis would take for late images and discard.
  void restart() {
    arv_camera_stop_acquisition(camera_.get(), nullptr);
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
    arv_stream_stop_thread(stream_.get(), FALSE);
    arv_stream_start_thread(stream_.get());
    drain();
    checked("start", [&](GError** e) { arv_camera_start_acquisition(camera_.get(), e); });
  }

  std::optional<GreyImage> receive(std::string& reason) {
    const auto timeout_us = static_cast<guint64>(1e6 * (settings_.timeout_s + exposure_s_));
    ArvBuffer* buffer = arv_stream_timeout_pop_buffer(stream_.get(), timeout_us);
    if (!buffer) {
      reason = to_words(ARV_BUFFER_STATUS_UNKNOWN);
      return std::nullopt;
    }
    const std::unique_ptr<ArvBuffer, std::function<void(ArvBuffer*)>> returned(
        buffer, [this](ArvBuffer* b) { return_buffer(b); });
    const ArvBufferStatus status = arv_buffer_get_status(buffer);
    if (status != ARV_BUFFER_STATUS_SUCCESS) {
      reason = to_words(status);
      return std::nullopt;
    }
    const cv::Size size(arv_buffer_get_image_width(buffer), arv_buffer_get_image_height(buffer));
    if (size != settings_.size)
      throw Error("camera: received an image of " + to_words(size) + ", not " + to_words(settings_.size) +
                  "; did another program reconfigure the camera?");
    if (arv_buffer_get_image_pixel_format(buffer) != format_.code)
      throw Error("camera: received an image in a pixel format other than " + format_.name +
                  "; did another program reconfigure the camera?");
    int across = 0, down = 0;
    arv_buffer_get_image_padding(buffer, &across, &down);
    if (across != 0)
      throw Error("camera: " + found_.id + " adds " + std::to_string(across) + " bytes to each line of " +
                  to_words(settings_.size) + " images; choose a width that it sends without padding");
    size_t bytes = 0;
    const void* data = arv_buffer_get_image_data(buffer, &bytes);
    bytes = std::min(bytes, image_bytes(format_, size));  // buffers may end in padding
    return GreyImage{unpacked(format_, size, data, bytes), even_time_s(arv_buffer_get_system_timestamp(buffer)),
                     exposure_s_, arv_buffer_get_frame_id(buffer)};
  }

  CameraSettings settings_;
  std::optional<double> gain_;  // empty if the camera has no such setting
  FoundCamera found_;
  PixelFormat format_;
  double exposure_s_ = 0;
  std::atomic<bool> lost_ = false;
  CameraStatistics statistics_;
  Reference<ArvCamera> camera_;
  Reference<ArvStream> stream_;  // destroyed before the camera
};

AravisCamera::AravisCamera(const CameraSettings& settings)
    : settings_(settings), connection_(std::make_unique<Connection>(settings)) {
  settings_.id = connection_->name();  // reconnect to the same camera
  gain_ = connection_->gain();
}

AravisCamera::~AravisCamera() = default;

cv::Size AravisCamera::size() const { return settings_.size; }

CameraStatistics AravisCamera::statistics() const {
  CameraStatistics all = before_;
  if (!connection_) return all;
  const CameraStatistics now = connection_->statistics();
  all.images += now.images, all.refused += now.refused;
  all.resent_packets += now.resent_packets, all.missing_packets += now.missing_packets;
  return all;
}

void AravisCamera::reopen() {
  using Clock = std::chrono::steady_clock;
  before_ = statistics();
  ++before_.reopened;
  connection_.reset();
  const auto end = Clock::now() + std::chrono::duration<double>(settings_.reopen_s);
  for (double pause_s = 0.1;; pause_s = std::min(2.0, 2 * pause_s)) {
    try {
      connection_ = std::make_unique<Connection>(settings_, gain_);
      return;
    } catch (const Error& e) {
      if (Clock::now() + std::chrono::duration<double>(pause_s) > end)
        throw Error("camera: " + settings_.id + " was lost and did not reconnect within " +
                    to_text(settings_.reopen_s) + " s (" + e.what() + ")");
    }
    std::this_thread::sleep_for(std::chrono::duration<double>(pause_s));
  }
}

template <class Result, class Get>
Result AravisCamera::with_retries(const Get& get) {
  std::string reason;
  for (int attempt = 0; attempt < settings_.attempts; ++attempt) {
    if (!connection_ || connection_->lost()) reopen();
    try {
      if (auto result = get(*connection_, reason)) return *result;
    } catch (const CommandFailed& e) {
      // The camera is lost or controlled by another host; the heartbeat may detect this only seconds later.
      reason = e.what();
      connection_->give_up();
    }
  }
  throw Error("camera: no complete image from " + settings_.id + " in " + std::to_string(settings_.attempts) +
              " attempts: " + reason);
}

GreyImage AravisCamera::take() {
  return with_retries<GreyImage>([](Connection& camera, std::string& reason) { return camera.take(reason); });
}

GreyImage AravisCamera::next() {
  return with_retries<GreyImage>([](Connection& camera, std::string& reason) { return camera.next(reason); });
}

void AravisCamera::set_exposure_s(double exposure_s) {
  with_retries<bool>([exposure_s](Connection& camera, std::string&) {
    camera.set_exposure_s(exposure_s);
    return std::optional<bool>(true);
  });
  settings_.exposure_s = exposure_s;  // also after a reconnection
}

}  // namespace fringeslam
