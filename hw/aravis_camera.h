// SPDX-License-Identifier: Apache-2.0
// A GenICam camera on GigE Vision or USB3 Vision, by Aravis.
//
// Cameras keep what they are set to: the trigger is switched off again when this ends. On a lost connection the camera
// is looked for again, at longer and longer intervals. A network interface in the same machine (127.0.0.1) has no
// packet socket; the socket buffer is fixed and large, as small ones lose most of an image's packets.
//
// Exposures that nobody asked for (trigger "free", or an input line) may have begun before take(), and one may be on
// its way while the next is exposed; so the first two images go by. That takes a camera whose images arrive within one
// exposure's interval.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "hw/grey_camera.h"

namespace fringeslam {

struct CameraSettings {
  std::string id;  // as `fringeslam rig list` prints it; empty: the only one there
  std::string pixel_format = "Mono8";
  cv::Size size;     // of the region that is read, px
  cv::Point offset;  // of it on the sensor, px
  double exposure_s = 0.01;
  double gain = 0;                   // in the camera's own unit; 0: left as it is
  std::string trigger = "software";  // or "free" (exposures come by themselves), or the name of an input line
  int packet_bytes = 0;              // of GigE Vision; 0: as large as goes through
  double timeout_s = 1;              // for an image beyond its exposure
  int attempts = 10;                 // to get a whole image
  double reopen_s = 10;              // for how long a lost camera is looked for
};

struct FoundCamera {
  std::string id, vendor, model, serial, address, protocol;
};

std::vector<FoundCamera> find_cameras();

class AravisCamera : public GreyCamera {
 public:
  // Opens, sets and starts the camera. Throws Error when there is none such, when another program controls it, and when
  // it cannot be set so: each value is read back.
  explicit AravisCamera(const CameraSettings& settings);
  ~AravisCamera() override;

  cv::Size size() const override;
  GreyImage take() override;
  GreyImage next() override;
  CameraStatistics statistics() const override;

 private:
  class Connection;
  void reopen();
  template <class Get>
  GreyImage patiently(const Get& get);

  CameraSettings settings_;
  CameraStatistics before_;  // of connections that are gone
  std::unique_ptr<Connection> connection_;
};

}  // namespace fringeslam
