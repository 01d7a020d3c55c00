// SPDX-License-Identifier: Apache-2.0
// The scene of the rendering rows.
#pragma once

#include <memory>

#include "sim/virtual_rig.h"

namespace fringeslam::bench {

// The default scene's table with 36 rocks, of 20 * 4^subdivisions triangles each: 184,000 in total for 4.
sim::Scene rubble(int subdivisions);

// Everything from a pose to the grey values of a number of patterns with one period, and with `truth` the ground truth,
// repeatedly.
class Stack {
 public:
  Stack(const sim::Scene& scene, int patterns, const sim::RenderOptions& options = {}, bool truth = true);
  void operator()();

 private:
  sim::Scene scene_;
  PatternSequence sequence_;
  std::unique_ptr<sim::VirtualRig> rig_;
  bool truth_;
};

}  // namespace fringeslam::bench
