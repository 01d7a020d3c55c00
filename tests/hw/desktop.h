// SPDX-License-Identifier: Apache-2.0
// What people and their window managers do to windows.
#pragma once

#include <string>

namespace fringeslam::test {

// Moves the window with that title on $DISPLAY, and waits until the server has done it. False when there is none.
bool move_window(const std::string& title, int x, int y);

}  // namespace fringeslam::test
