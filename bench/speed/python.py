# SPDX-License-Identifier: Apache-2.0
"""Maps a dataset for each line on standard input; answers with the seconds and the bytes copied for images and points."""
import sys
import time

import fringeslam as fs


def address(array):
    return array.__array_interface__["data"][0]


def copied_bytes(arrays, again):
    """Arrays that share the C++ object's memory have the same address each time."""
    return sum(a.nbytes for a, b in zip(arrays, again) if address(a) != address(b))


def arrays_of(view):
    return [*view.stack.images, view.result.frame.points_m, view.result.frame.sigma_m, view.result.frame.texture]


def map_dataset(folder):
    rig = fs.ReplayRig(folder)
    pipeline = fs.Pipeline(rig.model, rig.patterns)
    views, copied = 0, 0
    start = time.perf_counter()
    for view in fs.Driver(rig, pipeline):
        copied += copied_bytes(arrays_of(view), arrays_of(view))
        views += view.result.has_pose
    seconds = time.perf_counter() - start
    cloud = pipeline.map.cloud({"cell_m": 0.01})
    copied += copied_bytes([cloud.points_m, cloud.sigma_m], [cloud.points_m, cloud.sigma_m])
    return seconds, copied, views


for _ in sys.stdin:
    print(*map_dataset(sys.argv[1]), flush=True)
