# SPDX-License-Identifier: Apache-2.0
"""Evaluates a registration on a suite of scenes and writes evaluation/leaderboard.html: evaluate.py [SUITE]."""
import sys

import fringeslam as fs

def odometry(scene):
    def register(target, source):  # replace this by yours
        result = fs.register_frames(target, source, scene.rig.camera)
        return result.target_from_source if result.converged else None
    return fs.odometry(register)

fs.evaluate(odometry, sys.argv[1] if len(sys.argv) > 1 else "stills", name="my odometry")
for s in fs.standings(fs.read_results("evaluation")):
    print(f"{s.suite} {s.system}: {s.scored} of {s.datasets} datasets, median ATE {1e3 * s.ate_m[0]:.4f} mm")
