// SPDX-License-Identifier: Apache-2.0
#include "tools/authoring/gallery_page.h"

#include <sys/resource.h>

#include <algorithm>
#include <chrono>
#include <nlohmann/json.hpp>
#include <utility>

#include "core/base/start_threads.h"
#include "core/io/files.h"
#include "core/io/json_text.h"
#include "core/io/staged.h"
#include "sim/preview.h"
#include "sim/scene/cache.h"
#include "sim/scene/data_folder.h"
#include "tools/authoring/file_stamp.h"
#include "tools/authoring/mesh_scene.h"
#include "tools/process.h"
#include "tools/report/report_page.h"
#include "tools/shell.h"
#include "tools/source.h"

namespace fringeslam::tools {

namespace fs = std::filesystem;

namespace {

using Json = nlohmann::ordered_json;
using std::chrono::milliseconds;

constexpr auto kOpeningWait = std::chrono::seconds(5);  // for a scene's page
constexpr milliseconds kViewerLook(100);                // between looks whether a viewer left
constexpr int kDrawingNice = 10;
const cv::Size kPictureSize(480, 320);

std::string name_of(const ListedScene& scene) { return scene.folder.filename().string(); }

Json stamp_of(const fs::path& file) {
  const FileStamp stamp = file_stamp(file);
  return stamp ? Json(*stamp) : Json();
}

// Pictures are kept together with the state of all files that their scenes consist of.
std::string cache_key(const fs::path& folder) {
  return "picture of a scene, version 1: " + fs::absolute(folder).lexically_normal().string();
}

std::optional<std::string> kept_picture(const fs::path& folder) {
  const std::optional<std::string> kept = sim::cached(cache_key(folder));
  if (!kept) return std::nullopt;
  const size_t end = kept->find('\n');
  if (end == std::string::npos) return std::nullopt;
  const Json files = Json::parse(kept->substr(0, end), nullptr, false);
  if (!files.is_array()) return std::nullopt;
  for (const Json& file : files) {
    if (!file.is_array() || file.size() != 2 || !file[0].is_string()) return std::nullopt;
    if (stamp_of(file[0].get<std::string>()) != file[1]) return std::nullopt;
  }
  return kept->substr(end + 1);
}

std::string drawn_picture(const fs::path& folder) {
  std::vector<fs::path> files;
  sim::SceneLoadOptions reading;
  reading.files = &files;
  const sim::Scene scene = sim::load_scene(folder / kSceneFile, reading);
  Json stamps = Json::array();
  for (const fs::path& file : files) stamps.push_back({file.string(), stamp_of(file)});
  std::string png = png_bytes(sim::overview_picture(scene, kPictureSize), 7);
  sim::store(cache_key(folder), json_text(stamps) + "\n" + png);
  return png;
}

PageAnswer json_answer(const Json& json) { return PageAnswer::of(json_text(json), "application/json"); }

}  // namespace

GalleryPage::GalleryPage(fs::path folder, LiveAccess access)
    : folder_(std::move(folder)),
      access_(checked(std::move(access))),
      scenes_(list_scenes(folder_)),
      server_(access_, "--page", [this](const PageRequest& request) { return answer(request); },
              {.posts = true, .most_body_bytes = kMostMeshBytes, .nice = 0}) {
  // After the server, which throws if its port is taken.
  const auto draw = [this] {
    setpriority(PRIO_PROCESS, 0, kDrawingNice);  // of this thread only
    draw_pictures();
  };
  threads_ = start_threads({[this] { open_wanted(); }, draw}, [this] { stop(); });
}

// Opens the pages of the scenes that are wanted, one after another.
void GalleryPage::open_wanted() {
  std::unique_lock lock(mutex_);
  while (!stopping_) {
    if (wanted_.empty()) {
      changed_.wait(lock);
      continue;
    }
    const std::string name = wanted_.front();
    wanted_.erase(wanted_.begin());
    const auto found = std::find_if(open_.begin(), open_.end(), [&](const auto& o) { return o.first == name; });
    if (found == open_.end()) continue;
    const std::shared_ptr<Opened> opened = found->second;
    lock.unlock();
    std::unique_ptr<ScenePage> page;
    std::string error;
    try {
      LiveAccess any_port = access_;
      any_port.port = 0;
      page = std::make_unique<ScenePage>((folder_ / name).string(), SceneVariant{}, any_port);
    } catch (const std::exception& failure) {
      error = failure.what();
    }
    lock.lock();
    opened->page = std::move(page);
    opened->error = error;
    opened->loading = false;
    changed_.notify_all();
  }
}

GalleryPage::~GalleryPage() {
  stop();
  for (std::thread& thread : threads_) thread.join();
}

void GalleryPage::stop() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  changed_.notify_all();
}

bool GalleryPage::loading() const {
  const std::lock_guard lock(mutex_);
  const bool opening = std::any_of(open_.begin(), open_.end(), [](const auto& entry) { return entry.second->loading; });
  return opening || pictures_.size() < scenes_.size();
}

// Draws the pictures that are missing.
void GalleryPage::draw_pictures() {
  std::unique_lock lock(mutex_);
  while (!stopping_) {
    const auto next = std::find_if(scenes_.begin(), scenes_.end(),
                                   [&](const ListedScene& scene) { return !pictures_.contains(name_of(scene)); });
    if (next == scenes_.end()) {
      changed_.wait(lock);
      continue;
    }
    const ListedScene scene = *next;
    lock.unlock();
    Picture picture;
    try {
      const std::optional<std::string> kept = kept_picture(scene.folder);
      picture.png = kept ? *kept : drawn_picture(scene.folder);
    } catch (const std::exception&) {
      picture.failed = true;  // opening the scene says why
    }
    lock.lock();
    pictures_[name_of(scene)] = std::move(picture);
  }
}

const ListedScene* GalleryPage::find(const std::string& name) const {
  const auto found =
      std::find_if(scenes_.begin(), scenes_.end(), [&](const ListedScene& scene) { return name_of(scene) == name; });
  return found == scenes_.end() ? nullptr : &*found;
}

PageAnswer GalleryPage::answer(const PageRequest& request) {
  const std::string_view path = request.path;
  if (request.is_post) {
    if (path == "/open") return open(request.parameter("scene"));
    return path == "/mesh" ? create(request) : PageAnswer{405, {}};
  }
  if (path == "/") return PageAnswer::of(std::string(gallery_page()), "text/html; charset=utf-8");
  if (path == "/scenes") return scenes();
  if (path == "/opened") return opened(request.parameter("scene"), request.given_up);
  constexpr std::string_view kPicture = "/picture/", kEnd = ".png";
  if (path.starts_with(kPicture) && path.ends_with(kEnd))
    return picture(std::string(path.substr(kPicture.size(), path.size() - kPicture.size() - kEnd.size())));
  return {};
}

PageAnswer GalleryPage::scenes() const {
  const std::lock_guard lock(mutex_);
  Json list = Json::array();
  for (const ListedScene& scene : scenes_)
    list.push_back({{"name", name_of(scene)},
                    {"description", scene.description},
                    {"command", "fringeslam scene open " + shell_word(scene.folder.string())}});
  return json_answer({{"folder", folder_.string()}, {"scenes", list}});
}

PageAnswer GalleryPage::picture(const std::string& name) const {
  const std::lock_guard lock(mutex_);
  if (!find(name)) return {};
  const auto drawn = pictures_.find(name);
  if (drawn == pictures_.end()) return {204, {}};
  const Picture& found = drawn->second;
  return found.failed ? PageAnswer::of("invalid scene", "text/plain") : PageAnswer::of(found.png, "image/png");
}

PageAnswer GalleryPage::open(const std::string& name) {
  std::shared_ptr<Opened> oldest;  // destroyed after the lock is released
  {
    const std::lock_guard lock(mutex_);
    if (!find(name)) return {};
    const auto known = std::find_if(open_.begin(), open_.end(), [&](const auto& entry) { return entry.first == name; });
    if (known != open_.end() && known->second->error.empty()) return PageAnswer::of("{}", "application/json");
    if (known != open_.end()) open_.erase(known);
    if (open_.size() >= kMostOpen) {
      if (open_.front().second->loading) return {503, {}};
      oldest = open_.front().second;
      open_.erase(open_.begin());
    }
    open_.emplace_back(name, std::make_shared<Opened>());
    wanted_.push_back(name);
  }
  changed_.notify_all();
  return PageAnswer::of("{}", "application/json");
}

PageAnswer GalleryPage::opened(const std::string& name, const std::function<bool()>& given_up) {
  const auto end = std::chrono::steady_clock::now() + kOpeningWait;
  std::unique_lock lock(mutex_);
  for (;;) {
    const auto found = std::find_if(open_.begin(), open_.end(), [&](const auto& entry) { return entry.first == name; });
    if (found == open_.end()) return {204, {}};
    const Opened& state = *found->second;
    if (!state.loading || std::chrono::steady_clock::now() >= end || given_up())
      return json_answer({{"url", state.page ? state.page->url() : ""}, {"error", state.error}});
    changed_.wait_for(lock, kViewerLook);
  }
}

PageAnswer GalleryPage::create(const PageRequest& request) {
  const fs::path file = fs::path(request.parameter("file")).filename();
  const std::string name = scene_name_of(file);
  std::string error;
  try {
    if (request.body.empty()) throw Error(file.string() + ": is empty; drop a mesh file");
    create_mesh_scene(file, folder_ / name, [&](const fs::path& mesh) { write_text(mesh, request.body); });
    const std::lock_guard lock(mutex_);
    scenes_ = list_scenes(folder_);
  } catch (const std::exception& failure) {
    error = message_of(failure);
  }
  changed_.notify_all();
  return json_answer({{"name", name}, {"error", error}});
}

}  // namespace fringeslam::tools
