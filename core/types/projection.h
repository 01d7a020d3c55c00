// SPDX-License-Identifier: Apache-2.0
// A pose and a pinhole camera in single precision, as the kernels that project whole images use them.
#pragma once

#include "core/types/pinhole.h"
#include "core/types/pose.h"

namespace fringeslam {

struct Projection {
  float r[9], t[3];  // camera_from_points; the rotation by rows, the translation in m
  float fx, fy, cx, cy, k1, k2, p1, p2, k3;
  int width, height;

  Projection(const Pose& camera_from_points, const Pinhole& camera)
      : fx(static_cast<float>(camera.fx)),
        fy(static_cast<float>(camera.fy)),
        cx(static_cast<float>(camera.cx)),
        cy(static_cast<float>(camera.cy)),
        k1(static_cast<float>(camera.distortion.k1)),
        k2(static_cast<float>(camera.distortion.k2)),
        p1(static_cast<float>(camera.distortion.p1)),
        p2(static_cast<float>(camera.distortion.p2)),
        k3(static_cast<float>(camera.distortion.k3)),
        width(camera.width),
        height(camera.height) {
    for (int i = 0; i < 9; ++i) r[i] = static_cast<float>(camera_from_points.rotation(i / 3, i % 3));
    for (int i = 0; i < 3; ++i) t[i] = static_cast<float>(camera_from_points.translation[i]);
  }
};

}  // namespace fringeslam
