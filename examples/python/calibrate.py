# SPDX-License-Identifier: Apache-2.0
"""Calibrates camera and projector from rendered views of a checkerboard and compares them with the truth."""
import fringeslam as fs
import numpy as np

scene = fs.load_scene("scenes/calibration_checkerboard")
board = fs.Board(columns=12, rows=10, spacing_m=0.01)
rig = fs.VirtualRig(scene)
views = [fs.observe_board(view.stack, rig.model, board) for view in rig]
result = fs.calibrate_rig(views, board, scene.rig)
error = result.rig.camera.fx - scene.rig.camera.fx
baseline = [np.linalg.norm(r.projector_from_camera[:3, 3]) for r in (result.rig, scene.rig)]
print(f"camera fx {error:+.2f} px from the truth (sigma {result.camera_sigma.fx:.2f})")
print(f"baseline {1e3 * (baseline[0] - baseline[1]):+.3f} mm from the truth; {result.warnings or 'no warnings'}")
assert abs(error) < 5 * result.camera_sigma.fx
