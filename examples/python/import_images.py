# SPDX-License-Identifier: Apache-2.0
"""Reconstructs images of your own rig: import_images.py FOLDER, with import.yaml in it (tutorial: use your captures)."""
import sys

import fringeslam as fs
import numpy as np

rig = fs.ImportedRig(sys.argv[1])
depth = {"near_m": rig.model.near_m, "far_m": rig.model.far_m}
for stack in rig:
    frame = fs.reconstruct(fs.decode(stack, rig.model), rig.model, depth)
    print(f"stack {stack.index}: {100 * np.isfinite(frame.depth_m).mean():.1f} % of the pixels have a depth")
    fs.write_ply(f"stack_{stack.index:06d}.ply", frame)
