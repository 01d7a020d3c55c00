// SPDX-License-Identifier: Apache-2.0
// Simulates window operations of users and window managers.
#pragma once

#include <string>

namespace fringeslam::test {

// Moves the window with that title on $DISPLAY and waits until the server has done so. False if there is none.
bool move_window(const std::string& title, int x, int y);

}  // namespace fringeslam::test
