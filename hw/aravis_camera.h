// SPDX-License-Identifier: Apache-2.0
// A GenICam camera on GigE Vision or USB3 Vision, accessed through Aravis.
//
// Cameras keep their settings, so the trigger is switched off again on destruction. After a lost connection, the camera
// is searched for at increasing intervals. A camera on the loopback interface (127.0.0.1) is read without a packet
// socket. The socket buffer has a large fixed size, since small ones lose most of an image's packets.
//
// Exposures that take() does not trigger (trigger "free" or an input line) may have begun before the call, and one may
// still be in transfer while the next is exposed; take() therefore discards two images. This requires a camera whose
// images arrive within one exposure interval.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "hw/grey_camera.h"

namespace fringeslam {

struct CameraSettings {
  std::string id;  // as printed by `fringeslam rig list`; empty: the only camera
  std::string pixel_format = "Mono8";
  cv::Size size;     // of the image region, px
  cv::Point offset;  // of the region on the sensor, px
  double exposure_s = 0.01;
  std::optional<double> gain = {};   // in the camera's unit; empty: unchanged
  std::string trigger = "software";  // or "free" (free-running), or the name of an input line
  int packet_bytes = 0;              // GigE Vision packet size; 0: largest that passes
  double timeout_s = 1;              // for an image, in addition to its exposure
  int attempts = 10;                 // to receive a complete image
  double reopen_s = 10;              // how long a lost camera is searched for
};

struct FoundCamera {
  std::string id, vendor, model, serial, address, protocol;
};

// Lists the cameras on the network and on USB.
std::vector<FoundCamera> find_cameras();

class AravisCamera : public GreyCamera {
 public:
  // Opens, configures and starts the camera. Throws Error if it is not found, is controlled by another program, or does
  // not accept a setting: region, pixel format and exposure are read back.
  explicit AravisCamera(const CameraSettings& settings);
  ~AravisCamera() override;

  cv::Size size() const override;
  double exposure_s() const override { return settings_.exposure_s; }
  void set_exposure_s(double exposure_s) override;
  GreyImage take() override;
  GreyImage next() override;
  CameraStatistics statistics() const override;

 private:
  class Connection;
  void reopen();
  template <class Result, class Get>
  Result with_retries(const Get& get);

  CameraSettings settings_;
  CameraStatistics before_;  // of previous connections
  std::unique_ptr<Connection> connection_;
  std::optional<double> gain_;  // of the first connection; empty if the camera has no such setting
};

}  // namespace fringeslam
