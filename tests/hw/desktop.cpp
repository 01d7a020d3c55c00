// SPDX-License-Identifier: Apache-2.0
#include "tests/hw/desktop.h"

#include <X11/Xlib.h>
#include <X11/Xutil.h>

#include <memory>

namespace fringeslam::test {

bool move_window(const std::string& title, int x, int y) {
  const std::unique_ptr<Display, decltype(&XCloseDisplay)> display(XOpenDisplay(nullptr), &XCloseDisplay);
  if (!display) return false;
  Window root = 0, parent = 0, *children = nullptr;
  unsigned count = 0;
  if (!XQueryTree(display.get(), DefaultRootWindow(display.get()), &root, &parent, &children, &count)) return false;
  bool found = false;
  for (unsigned i = 0; i < count; ++i) {
    char* name = nullptr;
    if (!XFetchName(display.get(), children[i], &name)) continue;
    if (name && title == name) {
      XMoveWindow(display.get(), children[i], x, y);
      found = true;
    }
    XFree(name);
  }
  if (children) XFree(children);
  XSync(display.get(), False);
  return found;
}

}  // namespace fringeslam::test
