// SPDX-License-Identifier: Apache-2.0
#include "core/types/frame.h"

#include "core/types/parallel.h"

namespace fringeslam {

PixelRays pixel_rays(const Pinhole& camera) {
  PixelRays rays(camera.height, camera.width);
  for_each_row(camera.height, [&](int row) {
    for (int col = 0; col < camera.width; ++col) {
      const Eigen::Vector2d xy = camera.undistort({col, row});
      rays(row, col) = {static_cast<float>(xy.x()), static_cast<float>(xy.y())};
    }
  });
  return rays;
}

}  // namespace fringeslam
