// SPDX-License-Identifier: Apache-2.0
// A web page, for this computer alone, that shows the newest stack while there are more to come.
//
//   /                        the page (page.html)
//   /state.json              number of the newest stack, from 1 (0: none yet), and its figures (preview.h)
//   /preview/texture.png     and modulation.png, saturation.png, depth.png of the newest stack
//
// Nothing is decoded or encoded unless a viewer asks, and then once a stack, in a thread of the page.
#pragma once

#include <memory>
#include <string>

#include "core/patterns/patterns.h"
#include "core/types/fringe_stack.h"
#include "core/types/rig_model.h"

namespace fringeslam::tools {

class LivePage {
 public:
  static constexpr int kUsualPort = 8080;

  // Serves at 127.0.0.1 until it is destroyed, which takes no longer than one preview. Port 0: any that is free.
  // Throws Error when the port cannot be had.
  LivePage(const PatternSequence& sequence, const RigModel& rig, int port);
  ~LivePage();
  LivePage(const LivePage&) = delete;
  LivePage& operator=(const LivePage&) = delete;

  // Never waits for a viewer: the stack takes the place of the one before. Its images are shared and must not change.
  void show(const FringeStack& stack);

  std::string url() const;  // http://127.0.0.1:8080/

 private:
  class Server;
  std::unique_ptr<Server> server_;
};

}  // namespace fringeslam::tools
