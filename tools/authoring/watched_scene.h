// SPDX-License-Identifier: Apache-2.0
// A scene while its author edits it: loaded again when one of its files changes, or with another seed. If that fails, the
// last valid scene remains beside the error. Files are looked at several times per second, since editors replace files,
// and network file systems report no changes; they are read once they stay the same between two looks.
#pragma once

#include <chrono>
#include <condition_variable>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "sim/sensor_view.h"
#include "tools/authoring/file_stamp.h"
#include "tools/authoring/scene_data.h"

namespace fringeslam::tools {

// A loaded scene with all that its page shows of it.
struct ShownScene {
  ShownScene(sim::Scene loaded, const std::vector<sim::SceneValue>& values)
      : scene(std::move(loaded)), data(scene_data(scene, values)), view(scene) {}
  sim::Scene scene;
  SceneData data;
  sim::SensorView view;
};

class WatchedScene {
 public:
  // Key paths and YAML values, as in SceneLoadOptions::changes.
  using Changes = std::vector<std::pair<std::string, std::string>>;
  struct State {
    uint64_t number = 0;  // changes with every other member; differs between runs of the program
    std::shared_ptr<ShownScene> scene;
    uint64_t scene_number = 0;  // changes with the scene; differs between runs of the program
    std::string error = {};     // of the newest version; empty: `scene` is the newest version
    bool loading = false;       // a newer version is being loaded
    Changes changes = {};       // of values, of the newest version
    bool placeable = false;     // the newest version includes placed.yaml (placed_file.h)
  };

  // Loads a scene and begins to watch it. Throws Error if it is invalid.
  WatchedScene(std::filesystem::path file, sim::SceneLoadOptions reading);
  // Waits until a loading scene is loaded.
  ~WatchedScene();
  WatchedScene(const WatchedScene&) = delete;
  WatchedScene& operator=(const WatchedScene&) = delete;

  const std::filesystem::path& file() const { return file_; }
  State state() const;
  // Waits for a state with another number, at most `longest` or until `given_up` returns true.
  State await_change(uint64_t number, std::chrono::milliseconds longest, const std::function<bool()>& given_up) const;
  // Loads the scene again with another seed, which it keeps from then on.
  void reseed(uint64_t seed);
  // Loads the scene again with another value of its files, which it keeps from then on; without one, with the value of
  // the files.
  void change_value(const std::string& path, const std::optional<std::string>& value);

 private:
  using Stamps = std::map<std::filesystem::path, FileStamp>;

  bool includes_placed() const;
  Stamps stamps() const;  // of the files, now
  std::shared_ptr<ShownScene> load();
  void reload();
  void watch();
  void change(const std::function<void(State&)>& how);

  const std::filesystem::path file_;
  sim::SceneLoadOptions reading_;
  Changes changes_;  // after those of reading_
  Stamps loaded_;    // files of the newest version, as they were when it was loaded

  mutable std::mutex mutex_;  // guards the members below
  mutable std::condition_variable changed_;
  State state_;
  std::optional<uint64_t> new_seed_;
  std::optional<Changes> new_changes_;
  bool stopping_ = false;

  std::thread thread_;  // last: uses the other members
};

}  // namespace fringeslam::tools
