# SPDX-License-Identifier: Apache-2.0
"""Drives a whole SLAM along a scene and scores it: any function of a frame that returns world_from_camera or None."""
import fringeslam as fs
import numpy as np

class PlaneSlam:  # estimates the height above a table from the mean depth, and nothing else
    def __init__(self):
        self.first = None

    def __call__(self, frame):
        distance = np.nanmedian(frame.depth_m)
        self.first = self.first or distance
        pose = np.eye(4)
        pose[2, 3] = self.first - distance
        return pose

run = fs.track(PlaneSlam(), fs.load_scene("scenes/boxes_and_foam"))
print(f"ATE {1e3 * run.score.ate_rmse_m:.1f} mm")
