// SPDX-License-Identifier: Apache-2.0
#include "tools/authoring/watched_scene.h"

#include <algorithm>

#include "tools/authoring/placed_file.h"

namespace fringeslam::tools {

namespace {

using std::chrono::milliseconds;

constexpr milliseconds kLook(50);         // between looks at the files
constexpr milliseconds kGiveUpLook(100);  // between looks whether a viewer left

// Returns the current time by the clock of file systems, which may lag by one tick of the kernel.
int64_t file_time_ns() {
  timespec now{};
  clock_gettime(CLOCK_REALTIME_COARSE, &now);
  return nanoseconds(now);
}

// Numbers of this run of the program start here, so that a page that was opened from an earlier run notices.
uint64_t first_number() {
  const auto since_epoch = std::chrono::system_clock::now().time_since_epoch();
  return static_cast<uint64_t>(std::chrono::duration_cast<milliseconds>(since_epoch).count());
}

}  // namespace

WatchedScene::WatchedScene(std::filesystem::path file, sim::SceneLoadOptions reading)
    : file_(std::move(file)), reading_(std::move(reading)) {
  state_.scene = load();
  state_.placeable = includes_placed();
  state_.number = state_.scene_number = first_number();
  thread_ = std::thread([this] { watch(); });
}

WatchedScene::~WatchedScene() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  changed_.notify_all();
  thread_.join();
}

WatchedScene::State WatchedScene::state() const {
  const std::lock_guard lock(mutex_);
  return state_;
}

WatchedScene::State WatchedScene::await_change(uint64_t number, milliseconds longest,
                                               const std::function<bool()>& given_up) const {
  const auto end = std::chrono::steady_clock::now() + longest;
  std::unique_lock lock(mutex_);
  while (state_.number == number && std::chrono::steady_clock::now() < end && !given_up())
    changed_.wait_for(lock, kGiveUpLook);
  return state_;
}

void WatchedScene::reseed(uint64_t seed) {
  {
    const std::lock_guard lock(mutex_);
    new_seed_ = seed;
  }
  changed_.notify_all();
}

void WatchedScene::change_value(const std::string& path, const std::optional<std::string>& value) {
  {
    const std::lock_guard lock(mutex_);
    Changes changes = new_changes_.value_or(state_.changes);
    std::erase_if(changes, [&](const auto& change) { return change.first == path; });
    if (value) changes.emplace_back(path, *value);
    new_changes_ = std::move(changes);
  }
  changed_.notify_all();
}

void WatchedScene::change(const std::function<void(State&)>& how) {
  {
    const std::lock_guard lock(mutex_);
    how(state_);
    ++state_.number;
  }
  changed_.notify_all();
}

WatchedScene::Stamps WatchedScene::stamps() const {
  Stamps now;
  for (const auto& [file, then] : loaded_) now[file] = file_stamp(file);
  return now;
}

std::shared_ptr<ShownScene> WatchedScene::load() {
  // Files are stamped before they are read: a later change then counts as one.
  const Stamps before = stamps();
  const int64_t start_ns = file_time_ns();
  std::vector<std::filesystem::path> files;
  std::vector<sim::SceneValue> values;
  sim::SceneLoadOptions reading = reading_;
  reading.changes.insert(reading.changes.end(), changes_.begin(), changes_.end());
  reading.files = &files;
  reading.values = &values;
  const auto remember = [&] {
    loaded_.clear();
    files.push_back(file_);  // also if nothing of it could be read
    for (const std::filesystem::path& file : files) {
      if (const auto known = before.find(file); known != before.end()) {
        loaded_.insert(*known);
        continue;
      }
      // The name of a new file is known only now. If it changed meanwhile, any stamp of it counts as a change.
      const FileStamp stamp = file_stamp(file);
      loaded_[file] = stamp && stamp->front() >= start_ns ? FileStamp(std::vector<int64_t>{}) : stamp;
    }
  };
  try {
    sim::Scene scene = sim::load_scene(file_, reading);
    remember();
    return std::make_shared<ShownScene>(std::move(scene), values);
  } catch (...) {
    remember();
    throw;
  }
}

bool WatchedScene::includes_placed() const {
  // Files of names that cannot exist are other ones.
  const auto canonical = [](const std::filesystem::path& file) {
    std::error_code failed;
    std::filesystem::path name = std::filesystem::weakly_canonical(file, failed);
    return failed ? std::filesystem::path() : name;
  };
  const std::filesystem::path placed = canonical(file_.parent_path() / kPlacedFile);
  return !placed.empty() && std::any_of(loaded_.begin(), loaded_.end(),
                                        [&](const auto& entry) { return canonical(entry.first) == placed; });
}

void WatchedScene::reload() {
  change([](State& state) { state.loading = true; });
  std::string error;
  std::shared_ptr<ShownScene> scene;
  try {
    scene = load();
  } catch (const std::exception& failure) {
    error = failure.what();
  }
  change([&](State& state) {
    state.loading = false;
    state.placeable = includes_placed();
    state.error = error;
    if (!scene) return;
    state.scene = scene;
    ++state.scene_number;
  });
}

void WatchedScene::watch() {
  Stamps last = stamps();
  for (;;) {
    std::optional<uint64_t> seed;
    std::optional<Changes> changes;
    {
      std::unique_lock lock(mutex_);
      changed_.wait_for(lock, kLook, [&] { return stopping_ || new_seed_ || new_changes_; });
      if (stopping_) return;
      seed = std::exchange(new_seed_, std::nullopt);
      changes = std::exchange(new_changes_, std::nullopt);
      if (changes) state_.changes = *changes;  // the next change_value() adds to them
    }
    const Stamps now = stamps();
    if (seed) reading_.seed = seed;
    if (changes) changes_ = *changes;
    if (seed || changes || (now != loaded_ && now == last)) {
      reload();
      last = stamps();
    } else {
      last = now;
    }
  }
}

}  // namespace fringeslam::tools
