// SPDX-License-Identifier: Apache-2.0
// The web page of a scene while its author edits it.
//
//   /                  the page (tools/report/page/src/world)
//   /state?since=N     number, scene, error, loading (WatchedScene::State), and the command that opens the scene shown;
//                      waits some seconds for a state with another number than N
//   /scene/N           SceneData::json of scene number N
//   /mesh/NAME         SceneData::meshes
//   /view/KIND.png?scene=N&place=I&pattern=K&size=reduced
//                      sensor_picture.h from place I of the path; size full or reduced. Pictures are rendered one after
//                      another, in parallel to all other answers; a rendering stops when its viewer leaves.
//   /difficulty?scene=N&known=K
//                      total, done, error, views: difficulty_json() of all views assessed (difficulty_run.h) but the first
//                      K; waits some seconds for more
//   POST /seed         draws another seed
//   POST /value?path=P&value=V
//                      overrides a value of the scene, as --with does; without V, no longer
//   POST /place?path=P&x=X&y=Y&z=Z
//                      stores a position in placed.yaml (placed_file.h); the answer's `error` says why it did not
//
// 204: of another scene than the newest. Nothing else is served (page_server.h).
#pragma once

#include <atomic>
#include <mutex>
#include <string>

#include "tools/authoring/difficulty_run.h"
#include "tools/authoring/watched_scene.h"
#include "tools/live/page_server.h"
#include "tools/source.h"

namespace fringeslam::tools {

class ScenePage {
 public:
  static constexpr size_t kViewers = 8;     // waiting for changes concurrently
  static constexpr size_t kRenderings = 8;  // waiting or in progress; further viewers are asked to retry

  // Serves the scene that a user names until destroyed. Throws Error if it is invalid or the port is unavailable.
  ScenePage(std::string scene, SceneVariant variant, LiveAccess access);
  ScenePage(const ScenePage&) = delete;
  ScenePage& operator=(const ScenePage&) = delete;

  std::string url() const { return server_.url(); }
  // True while a changed scene is being loaded, for which the destructor waits.
  bool loading() const { return scene_.state().loading; }

 private:
  PageAnswer answer(const PageRequest& request);
  PageAnswer state(const PageRequest& request);
  PageAnswer view(const PageRequest& request);
  PageAnswer difficulty(const PageRequest& request);
  PageAnswer place(const PageRequest& request);
  PageAnswer override_value(const PageRequest& request);
  std::string command(const WatchedScene::State& state) const;

  std::string name_;
  SceneVariant variant_;
  WatchedScene scene_;
  DifficultyRun difficulty_;
  std::atomic<size_t> waiting_ = 0, renderings_ = 0, waiting_for_difficulty_ = 0;
  std::timed_mutex rendering_;
  std::mutex placing_;
  PageServer server_;  // last: its threads use the other members
};

}  // namespace fringeslam::tools
