// SPDX-License-Identifier: Apache-2.0
// Digital twin of a real capture: its rig, its surface with its albedo, and its light as a scene, rendered under the same
// patterns and decoded like the original (docs/method.md, section 12.5). Differences between the two show
// effects that are not modelled.
#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "core/types/decoded_stack.h"
#include "core/types/frame.h"
#include "core/types/fringe_stack.h"
#include "core/types/rig_model.h"

namespace fringeslam::twin {

// Measurements of one stack, real or simulated.
struct Capture {
  FringeStack stack;
  DecodedStack decoded;
  Frame frame;
  cv::Mat1f depth_m;
};

// A quantity of the real and of the simulated capture.
struct Comparison {
  std::string name, unit;
  double real = 0, simulated = 0;
};

struct Lighting {
  double exposure_s = 1e-3, ambient_lux = 0;
};

struct Twin {
  Capture real, simulated;
  RigModel rig;  // of the simulation
  Lighting light;
  std::vector<Comparison> comparisons;
};

// Builds the twin of a stack and writes its scene into `scene_folder`, which must exist. `step` is called after each of
// three renderings. Throws Error if too little of the stack can be reconstructed.
Twin make_twin(FringeStack stack, const RigModel& rig, const std::string& name,
               const std::filesystem::path& scene_folder, const std::function<void()>& step);

}  // namespace fringeslam::twin
