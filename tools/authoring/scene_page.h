// SPDX-License-Identifier: Apache-2.0
// The web page of a scene.
//
//   /                  the page (tools/report/page/src/world)
//   /scene             SceneData::json
//   /mesh/N            SceneData::meshes
//   /view/KIND.png?place=I&pattern=K&size=reduced
//                      sensor_picture.h from place I of the path; size full or reduced. Pictures are rendered one after
//                      another, in parallel to all other answers; a rendering stops when its viewer leaves.
//
// Nothing else is served (page_server.h).
#pragma once

#include <atomic>
#include <mutex>
#include <string>

#include "sim/sensor_view.h"
#include "tools/authoring/scene_data.h"
#include "tools/live/page_server.h"

namespace fringeslam::tools {

class ScenePage {
 public:
  static constexpr size_t kRenderings = 8;  // waiting or in progress; further viewers are asked to retry

  // Serves until destroyed. Throws Error if a texture cannot be read or the port is unavailable.
  ScenePage(sim::Scene scene, LiveAccess access);
  ScenePage(const ScenePage&) = delete;
  ScenePage& operator=(const ScenePage&) = delete;

  std::string url() const { return server_.url(); }

 private:
  PageAnswer answer(const PageRequest& request);
  PageAnswer view(const PageRequest& request);

  sim::Scene scene_;
  SceneData data_;
  sim::SensorView view_;
  std::atomic<size_t> renderings_ = 0;
  std::timed_mutex rendering_;
  PageServer server_;  // last: its threads use the other members
};

}  // namespace fringeslam::tools
