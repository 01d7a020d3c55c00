# SPDX-License-Identifier: Apache-2.0
"""Reads folders of `fringeslam render --format tum-rgbd` and writes results for `fringeslam evaluate`."""
import argparse
import json
import os

import numpy as np

DEPTH_UNITS_PER_M = 5000.0
FARTHEST_M = 3.0


def arguments(description, methods):
    """Parses `FOLDER OUT [--method NAME]`; OUT is the folder for trajectory.tum and map.ply."""
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder")
    parser.add_argument("out")
    parser.add_argument("--method", choices=methods, default=methods[0])
    return parser.parse_args()


def camera_matrix(folder):
    """Returns (width, height, fx, fy, cx, cy)."""
    with open(os.path.join(folder, "intrinsic.json"), encoding="ascii") as file:
        lens = json.load(file)
    k = lens["intrinsic_matrix"]  # column by column
    return lens["width"], lens["height"], k[0], k[4], k[6], k[7]


def entries(folder):
    """Yields (timestamp as text, path of the texture, path of the depth image)."""
    with open(os.path.join(folder, "associations.txt"), encoding="ascii") as associations:
        for line in associations:
            if line.strip() and not line.startswith("#"):
                time, rgb, _, depth = line.split()
                yield time, os.path.join(folder, rgb), os.path.join(folder, depth)


def quaternion(rotation):
    """Returns the quaternion x y z w of a 3x3 rotation, w >= 0: eigenvector of Bar-Itzhack's symmetric matrix (2000)."""
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = rotation
    q = np.linalg.eigh(np.array([
        [xx - yy - zz, yx + xy, zx + xz, zy - yz],
        [yx + xy, yy - xx - zz, zy + yz, xz - zx],
        [zx + xz, zy + yz, zz - xx - yy, yx - xy],
        [zy - yz, xz - zx, yx - xy, xx + yy + zz]]))[1][:, 3]  # fmt: skip
    return q if q[3] >= 0 else -q


class Trajectory:
    """Writes each pose world_from_camera when it is added, so that a program that ends early leaves the poses so far."""

    def __init__(self, out):
        self.file = open(os.path.join(out, "trajectory.tum"), "w", encoding="ascii", buffering=1)

    def add(self, time, world_from_camera):
        numbers = [*world_from_camera[:3, 3], *quaternion(world_from_camera[:3, :3])]
        self.file.write(time + "".join(f" {number:.12g}" for number in numbers) + "\n")


def odometry(out, folder, read, register):
    """Chains register(last, current) -> last_from_current or None. After a failure the pose is that of the last view."""
    trajectory = Trajectory(out)
    pose, last = np.eye(4), None
    for time, rgb, depth in entries(folder):
        view = read(rgb, depth)
        if last is not None:
            motion = register(last, view)
            if motion is None:
                continue  # the view is lost; the next one is registered with the last tracked one
            pose = pose @ motion
        last = view
        trajectory.add(time, pose)
        yield time, view, pose
