# SPDX-License-Identifier: Apache-2.0
"""Renders one view, reconstructs its depth and compares it with ground truth."""
import sys

import fringeslam as fs

scene = fs.load_scene(sys.argv[1] if len(sys.argv) > 1 else "scenes/boxes_and_foam")
rig = fs.VirtualRig(scene)
view = next(rig)
decoded = fs.decode(view.stack, rig.model)
frame = fs.reconstruct(decoded, rig.model)
score = fs.score_depth(frame, view.truth, decoded)
fs.write_ply("view.ply", frame)
print(f"median depth error {1e3 * score.median_m:.3f} mm, {100 * score.valid_fraction:.1f} % of the lit pixels")
assert score.median_m < 1e-4
