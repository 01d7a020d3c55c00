// SPDX-License-Identifier: Apache-2.0
// A web page that shows a capture or run while it is in progress.
//
//   /                            the page (tools/report/page/src/live)
//   /snapshot                    the whole state (live_feed.h)
//   /changes?run=ID&since=N      changes since N; waits some seconds for one
//   /picture/N/texture.jpg       also modulation.jpg, saturation.png, depth.png of view N; 204 if it is too old
//   /keyframe/N/points           keyframe_points.h
//
// Nothing else is served (page_server.h).
#pragma once

#include <atomic>
#include <string>

#include "tools/live/live_feed.h"
#include "tools/live/page_server.h"

namespace fringeslam::tools {

class LivePage {
 public:
  static constexpr int kDefaultPort = 8080;
  static constexpr size_t kViewers = 8;  // waiting for changes concurrently
  static constexpr size_t kRequests = PageServer::kRequests;

  // Serves until destroyed; the destructor takes no longer than one preview. Throws Error if the port is unavailable.
  LivePage(LiveSetup setup, LiveAccess access);
  LivePage(const LivePage&) = delete;
  LivePage& operator=(const LivePage&) = delete;

  LiveFeed& feed() { return feed_; }
  // Returns http://127.0.0.1:8080/, with the token if there is one; beyond loopback it uses this computer's host name.
  std::string url() const { return server_.url(); }
  const LiveAccess& access() const { return server_.access(); }  // with the actual port

 private:
  PageAnswer answer(const PageRequest& request);

  LiveFeed feed_;
  std::atomic<size_t> waiting_ = 0;
  PageServer server_;  // last: its threads use the other members
};

}  // namespace fringeslam::tools
