// SPDX-License-Identifier: Apache-2.0
// The views of a source as an RGB-D camera in place of the sensor would deliver them: fringe-free texture and depth.
#pragma once

#include <functional>

#include "core/mapper/front_end.h"
#include "tools/settings.h"
#include "tools/source.h"
#include "tools/verbs.h"

namespace fringeslam::tools {

struct RgbdOptions {
  std::string depth = "measured";  // decoded from the fringes and triangulated; or "truth"
  double units_per_m = 5000;       // of depth images with 16 bits
  bool distorted = false;          // keep the lens distortion; otherwise scenes are rendered without it
};

struct RgbdView {
  FringeStack stack;
  Frame frame;        // as measured
  cv::Mat1f depth_m;  // as measured or true, see RgbdOptions
};

// Reconstructs single views, without a map. Unless `tracking.at_rest` is set, views that show a motion are compensated for
// it, if their images determine it.
class DepthSensor {
 public:
  // Throws Error if the rig is not calibrated or if the patterns cannot be decoded.
  DepthSensor(const RigModel& model, const PatternSequence& sequence, const Settings& settings,
              const std::string& name);
  RgbdView see(FringeStack stack) const;

 private:
  MotionPrior unknown_motion_;
  FringeFrontEnd front_end_;
};

// Applies `options` to a source. Throws Error, which `out` begins, if it cannot provide what they ask for.
void prepare(Source& source, const RgbdOptions& options, const std::string& out);

// Passes every view of a prepared source to `take` and returns the true trajectory of the robot, empty if the source has
// no truth. `scratch` receives the files that document the images' origin and no truth other than resolved_scene.yaml.
// Throws Error, which `out` begins, if the source has no views.
Trajectory for_each_view(Source& source, const Settings& settings, const RgbdOptions& options,
                         const std::filesystem::path& scratch, const std::string& out, const Common& common,
                         const std::function<void(const RgbdView&)>& take);

struct WrittenViews {
  int views = 0;
  Trajectory robot;  // the true trajectory of the robot, at the times in the files; empty without truth
};

// Returns the trajectory of the camera on a robot.
Trajectory camera_trajectory(Trajectory robot, const RigModel& model);

// Converts depth to 16-bit units; 0 where there is no depth or it exceeds 65535 units.
cv::Mat1w depth_units(const cv::Mat1f& depth_m, double units_per_m);

}  // namespace fringeslam::tools
