# SPDX-License-Identifier: Apache-2.0
"""Defines a scene in Python: a sphere in front of a wall, with the thesis's rig."""
import fringeslam as fs

scene = fs.make_scene({
    "name": "sphere", "seed": 1,
    "rig": {"file": "scenes/rigs/thesis.yaml", "robot_from_camera": {"translation_m": [0, 0, 0]}},
    "patterns": {"axis": "columns", "steps": 4, "periods_px": [1040, 131, 16.5]},
    "light": {"ambient_lux": 300},
    "materials": {"plaster": {"grain": "plain", "albedo": 0.7}},
    "objects": [{"shape": "plane", "size_m": [1, 1], "material": "plaster", "pose": {"translation_m": [0, 0, 1.1]}},
                {"shape": "sphere", "radius_m": 0.1, "material": "plaster", "pose": {"translation_m": [0, 0, 1]}}],
    "trajectory": {"motions": [{"translation_mm": [10, 0, 0], "rotation_deg": [0, 0, 0]}]},
})  # fmt: skip
view = next(fs.VirtualRig(scene))
print(scene, "nearest surface", view.truth.depth_m[250, 266], "m")
assert abs(view.truth.depth_m[250, 266] - 0.9) < 1e-3
