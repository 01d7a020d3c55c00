#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""Runs Open3D's frame-to-frame RGB-D odometry and TSDF fusion on a folder of `render --format tum-rgbd`.

Writes OUT.tum (world_from_camera, the world is the first camera's frame) and OUT.ply, for `fringeslam score`.
Needs python3-open3d and python3-numpy.
"""
import argparse
import os

import numpy as np
import open3d as o3d

DEPTH_UNITS_PER_M = 5000.0
FARTHEST_M = 3.0


def quaternion(rotation):
    """Returns the quaternion x y z w of a 3x3 rotation, w >= 0: eigenvector of Bar-Itzhack's symmetric matrix (2000)"""
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = rotation
    q = np.linalg.eigh(np.array([
        [xx - yy - zz, yx + xy, zx + xz, zy - yz],
        [yx + xy, yy - xx - zz, zy + yz, xz - zx],
        [zx + xz, zy + yz, zz - xx - yy, yx - xy],
        [zy - yz, xz - zx, yx - xy, xx + yy + zz]]))[1][:, 3]
    return q if q[3] >= 0 else -q


def image(folder, rgb, depth, grey):
    return o3d.geometry.RGBDImage.create_from_color_and_depth(
        o3d.io.read_image(os.path.join(folder, rgb)), o3d.io.read_image(os.path.join(folder, depth)),
        DEPTH_UNITS_PER_M, FARTHEST_M, grey)


def main():
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("folder")
    arguments.add_argument("out")
    arguments.add_argument("--voxel", type=float, default=0.005, metavar="M")
    options = arguments.parse_args()

    camera = o3d.io.read_pinhole_camera_intrinsic(os.path.join(options.folder, "intrinsic.json"))
    odometry = o3d.pipelines.odometry.OdometryOption()
    hybrid = o3d.pipelines.odometry.RGBDOdometryJacobianFromHybridTerm()
    volume = o3d.pipelines.integration.ScalableTSDFVolume(
        options.voxel, 4 * options.voxel, o3d.pipelines.integration.TSDFVolumeColorType.RGB8)
    world_from_camera, last, lines = np.eye(4), None, []
    with open(os.path.join(options.folder, "associations.txt"), encoding="ascii") as associations:
        entries = [line.split() for line in associations if line.strip() and not line.startswith("#")]
    for time, rgb, _, depth in entries:
        grey = image(options.folder, rgb, depth, True)
        if last is not None:
            found, last_from_camera, _ = o3d.pipelines.odometry.compute_rgbd_odometry(
                grey, last, camera, np.eye(4), hybrid, odometry)
            if not found:
                raise SystemExit(f"{options.folder}: lost at {time} s")
            world_from_camera = world_from_camera @ last_from_camera
        last = grey
        volume.integrate(image(options.folder, rgb, depth, False), camera, np.linalg.inv(world_from_camera))
        numbers = [*world_from_camera[:3, 3], *quaternion(world_from_camera[:3, :3])]
        lines.append(time + "".join(f" {number:.9g}" for number in numbers))
    with open(options.out + ".tum", "w", encoding="ascii") as trajectory:
        trajectory.write("\n".join(lines) + "\n")
    o3d.io.write_triangle_mesh(options.out + ".ply", volume.extract_triangle_mesh())


if __name__ == "__main__":
    main()
