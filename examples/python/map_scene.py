# SPDX-License-Identifier: Apache-2.0
"""Maps a scene; writes its trajectory and mesh, and prints poses with standard deviations."""
import pathlib

import fringeslam as fs
import numpy as np

scene = fs.load_scene("scenes/boxes_and_foam")
rig = fs.VirtualRig(scene)
pipeline = fs.Pipeline(rig.model, scene.patterns, icp={"stride": 2})
for view in fs.Driver(rig, pipeline):
    sigmas = np.sqrt(np.diag(view.result.covariance))
    print(view.stack.index, view.result.tracking, "position sigma", 1e3 * np.linalg.norm(sigmas[3:]), "mm")
pathlib.Path("trajectory.tum").write_text(pipeline.trajectory.to_tum())
pipeline.map.surface().write_ply("mesh.ply")
score = fs.score_trajectory(pipeline.trajectory, scene.trajectory)
print(f"ATE {1e3 * score.ate_rmse_m:.4f} mm")
assert score.ate_rmse_m < 1e-5
