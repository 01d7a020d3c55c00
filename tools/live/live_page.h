// SPDX-License-Identifier: Apache-2.0
// A web page that shows what is captured or mapped while there is more to come.
//
//   /                            the page (tools/report/page/src/live)
//   /snapshot                    all that is known (live_feed.h)
//   /changes?run=ID&since=N      what changed since; waits some seconds for it
//   /picture/N/texture.jpg       and modulation.jpg, saturation.png, depth.png of view N; 204 when it is too old
//   /keyframe/N/points           keyframe_points.h
//
// Nothing else is served. Only GET and HEAD are answered, requests are small and have to come and be read in time,
// those beyond a number at once are told to come again (503). All but the page itself asks for the token where there is
// one. Threads of the page have a lower priority than those that map.
#pragma once

#include <memory>
#include <string>

#include "tools/live/access.h"
#include "tools/live/live_feed.h"

namespace fringeslam::tools {

class LivePage {
 public:
  static constexpr int kUsualPort = 8080;
  static constexpr size_t kViewers = 8;    // that wait for changes at the same time
  static constexpr size_t kRequests = 24;  // of all kinds that are answered at the same time

  // Serves until it is destroyed, which takes no longer than one preview. Throws Error when the port cannot be had.
  LivePage(LiveSetup setup, LiveAccess access);
  ~LivePage();
  LivePage(const LivePage&) = delete;
  LivePage& operator=(const LivePage&) = delete;

  LiveFeed& feed() { return feed_; }
  // http://127.0.0.1:8080/, with the token where there is one. Beyond this computer by its name.
  std::string url() const;
  const LiveAccess& access() const;  // with the port that it got

 private:
  class Server;
  LiveFeed feed_;
  std::unique_ptr<Server> server_;
};

}  // namespace fringeslam::tools
