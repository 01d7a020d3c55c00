#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""OpenCV's rgbd module on a folder of `render --format tum-rgbd`: frame-to-frame odometry.

Methods: RGB-D and ICP odometry combined, RGB-D alone, ICP alone. Needs python3-opencv, python3-numpy.
"""
import cv2
import numpy as np
import rgbd_folder

METHODS = ["rgbd_icp", "rgbd", "icp"]
CREATE = {
    "rgbd_icp": cv2.rgbd.RgbdICPOdometry_create,
    "rgbd": cv2.rgbd.RgbdOdometry_create,
    "icp": cv2.rgbd.ICPOdometry_create,
}
MAX_ROTATION_DEG, MAX_TRANSLATION_M = 30, 0.3  # motions beyond are rejected; the defaults are half of these


def main():
    options = rgbd_folder.arguments(__doc__, METHODS)
    _, _, fx, fy, cx, cy = rgbd_folder.camera_matrix(options.folder)
    odometry = CREATE[options.method]()
    odometry.setMaxRotation(MAX_ROTATION_DEG)
    odometry.setMaxTranslation(MAX_TRANSLATION_M)
    odometry.setCameraMatrix(np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]], np.float32))

    def read(rgb, depth):
        grey = cv2.imread(rgb, cv2.IMREAD_GRAYSCALE)
        metres = cv2.imread(depth, cv2.IMREAD_UNCHANGED).astype(np.float32) / rgbd_folder.DEPTH_UNITS_PER_M
        metres[metres == 0] = np.nan
        return cv2.rgbd.OdometryFrame_create(grey, metres, (metres == metres).astype(np.uint8) * 255)

    def register(last, current):
        found, motion = odometry.compute2(current, last)
        return motion if found else None

    for _ in rgbd_folder.odometry(options.out, options.folder, read, register):
        pass


if __name__ == "__main__":
    main()
