// SPDX-License-Identifier: Apache-2.0
// The web page of a folder of scenes.
//
//   /                    the page (tools/report/page/src/gallery)
//   /scenes              name, description, and the command that opens the scene, of each scene
//   /picture/NAME.png    its external view, drawn in the background; 204 until then, a text if the scene is invalid
//   POST /open?scene=N   begins to open the page of a scene
//   /opened?scene=N      url (empty: not yet), error; waits some seconds for either
//   POST /mesh?file=F    creates a scene from the mesh in the body, whose file name is F: name, error
//
// Nothing else is served (page_server.h).
#pragma once

#include <condition_variable>
#include <filesystem>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "tools/authoring/scene_list.h"
#include "tools/authoring/scene_page.h"
#include "tools/live/page_server.h"

namespace fringeslam::tools {

class GalleryPage {
 public:
  static constexpr size_t kMostOpen = 4;  // pages of scenes; further ones replace the oldest
  static constexpr size_t kMostMeshBytes = size_t{256} << 20;

  // Serves the scenes of a folder until destroyed. Throws Error if there are none or the port is unavailable.
  GalleryPage(std::filesystem::path folder, LiveAccess access);
  // Waits for scenes that are being loaded.
  ~GalleryPage();
  GalleryPage(const GalleryPage&) = delete;
  GalleryPage& operator=(const GalleryPage&) = delete;

  std::string url() const { return server_.url(); }
  bool loading() const;

 private:
  struct Opened {
    std::unique_ptr<ScenePage> page;
    std::string error;
    bool loading = true;
  };
  struct Picture {
    std::string png;
    bool failed = false;
  };

  PageAnswer answer(const PageRequest& request);
  PageAnswer scenes() const;
  PageAnswer picture(const std::string& name) const;
  PageAnswer open(const std::string& name);
  PageAnswer opened(const std::string& name, const std::function<bool()>& given_up);
  PageAnswer create(const PageRequest& request);
  const ListedScene* find(const std::string& name) const;
  void stop();
  void open_wanted();
  void draw_pictures();

  std::filesystem::path folder_;
  LiveAccess access_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::vector<ListedScene> scenes_;
  std::map<std::string, Picture> pictures_;
  std::vector<std::string> wanted_;                                    // scenes to open
  std::vector<std::pair<std::string, std::shared_ptr<Opened>>> open_;  // the oldest first
  bool stopping_ = false;
  std::vector<std::thread> threads_;  // open pages and draw pictures
  PageServer server_;                 // last: its threads use the other members
};

}  // namespace fringeslam::tools
