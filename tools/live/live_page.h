// SPDX-License-Identifier: Apache-2.0
// A web page that shows a capture or run while it is in progress.
//
//   /                            the page (tools/report/page/src/live)
//   /snapshot                    the whole state (live_feed.h)
//   /changes?run=ID&since=N      changes since N; waits some seconds for one
//   /picture/N/texture.jpg       also modulation.jpg, saturation.png, depth.png of view N; 204 if it is too old
//   /keyframe/N/points           keyframe_points.h
//
// Nothing else is served. Only GET and HEAD are answered. Requests are limited in size and time, and requests beyond a
// maximum number of concurrent ones are asked to retry (503). Everything but the page itself requires the token, if
// there is one. The page's threads run at a lower priority than the mapping threads.
#pragma once

#include <memory>
#include <string>

#include "tools/live/access.h"
#include "tools/live/live_feed.h"

namespace fringeslam::tools {

class LivePage {
 public:
  static constexpr int kDefaultPort = 8080;
  static constexpr size_t kViewers = 8;    // waiting for changes concurrently
  static constexpr size_t kRequests = 24;  // of all kinds, answered concurrently

  // Serves until destroyed; the destructor takes no longer than one preview. Throws Error if the port is unavailable.
  LivePage(LiveSetup setup, LiveAccess access);
  ~LivePage();
  LivePage(const LivePage&) = delete;
  LivePage& operator=(const LivePage&) = delete;

  LiveFeed& feed() { return feed_; }
  // Returns http://127.0.0.1:8080/, with the token if there is one; beyond loopback it uses this computer's host name.
  std::string url() const;
  const LiveAccess& access() const;  // with the actual port

 private:
  class Server;
  LiveFeed feed_;
  std::unique_ptr<Server> server_;
};

}  // namespace fringeslam::tools
