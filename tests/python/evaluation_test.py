# SPDX-License-Identifier: Apache-2.0
"""Python functions are evaluated beside commands, in one leaderboard."""
import subprocess

import fringeslam as fs
import numpy as np
import pytest


@pytest.fixture
def suite(root, tmp_path):
    file = tmp_path / "two.yaml"
    file.write_text(
        f"datasets:\n  - {{name: boxes, scene: {root}/scenes/boxes_and_foam, seeds: 2, with: [light.ambient_lux=100]}}\n"
    )
    return str(file)


def our_odometry(scene):
    def register(target, source):
        result = fs.register_frames(target, source, scene.rig.camera)
        return result.target_from_source if result.converged else None

    return fs.odometry(register)


def test_python_and_commands_share_a_leaderboard(suite, program, tmp_path):
    out = tmp_path / "out"
    results = fs.evaluate(our_odometry, suite, "odometry", out)
    assert [r.dataset for r in results] == ["boxes-1", "boxes-2"]
    assert all(r.end == "finished" and r.ate_m < 1e-4 and r.poses == r.views == 4 for r in results)
    command = f"'{program}' run {{dataset}} --out {{out}} --no-report --quiet"
    subprocess.run([program, "evaluate", suite, "--with", command, "--name", "ours", "--out", out, "--quiet"],
                   check=True, capture_output=True)  # fmt: skip
    standings = fs.standings(fs.read_results(out))
    assert {s.system for s in standings} == {"odometry", "ours"}
    for standing in standings:
        median, low, high = standing.ate_m
        assert low <= median <= high < 1e-4
        assert standing.scored == standing.datasets == 2
    # Odometry accumulates its errors; the mapper registers all views with one keyframe.
    medians = {s.system: s.ate_m[0] for s in standings}
    assert medians["ours"] < medians["odometry"]
    assert "odometry" in (out / "leaderboard.html").read_text()


def test_failures_are_results(suite, tmp_path):
    def broken(scene):
        raise RuntimeError("no GPU")

    failed = fs.evaluate(broken, suite, "broken", tmp_path / "out")
    assert [(r.end, r.message) for r in failed] == [("failed", "RuntimeError: no GPU")] * 2
    lost = fs.evaluate(lambda scene: lambda frame: None, suite, "lost", tmp_path / "out")
    assert [(r.end, r.poses) for r in lost] == [("no_trajectory", 0)] * 2
    assert np.isnan(lost[0].ate_m)
    assert all(s.scored == 0 for s in fs.standings(fs.read_results(tmp_path / "out")))


def test_an_unknown_suite_lists_the_known_ones():
    with pytest.raises(fs.Error, match="arenas, loop, moving"):
        fs.evaluate(our_odometry, "stil", "x")
