# SPDX-License-Identifier: Apache-2.0
"""How much light does the sensor need? Valid pixels and depth error over random exposures."""
import fringeslam as fs

def trial(seed, exposure_s):
    scene = fs.load_scene("scenes/boxes_and_foam", seed, {"rig.timing.exposure_s": exposure_s})
    rig = fs.VirtualRig(scene)
    view = next(rig)
    score = fs.score_depth(fs.reconstruct(fs.decode(view.stack, rig.model), rig.model), view.truth)
    return {"valid": score.valid_fraction, "error_mm": 1e3 * score.median_m}

rows = fs.study(trial, {"exposure_s": {"log_uniform": [5e-5, 3e-3]}}, trials=6)
for row in sorted(rows, key=lambda row: row["exposure_s"]):
    print(f"{1e3 * row['exposure_s']:6.3f} ms: {100 * row['valid']:5.1f} % valid, error {row['error_mm']:.3f} mm")
