# SPDX-License-Identifier: Apache-2.0
"""Drives a registration of your own along a scene and scores its odometry; here it is ours."""
import fringeslam as fs
import numpy as np

scene = fs.load_scene("scenes/boxes_and_foam")

def register(target, source):  # -> target_from_source and its covariance, or None
    result = fs.register_frames(target, source, scene.rig.camera)
    return (result.target_from_source, result.covariance) if result.converged else None

run = fs.track(fs.odometry(register), scene)
print(f"ATE {1e3 * run.score.ate_rmse_m:.4f} mm, lost {run.lost}, NEES {np.mean(run.nees):.1f} (6 if honest)")
assert run.score.ate_rmse_m < 1e-5 and not run.lost
