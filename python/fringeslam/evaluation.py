# SPDX-License-Identifier: Apache-2.0
"""Evaluates Python functions on suites of scenes, beside the systems of `fringeslam evaluate`."""

import os
from typing import Callable, List, Union

from . import _fringeslam as fs
from .slam import Slam, track


def evaluate(
    make_slam: Callable[[fs.Scene], Slam], suite: str, name: str, out: Union[str, "os.PathLike[str]"] = "evaluation"
) -> List[fs.EvaluationResult]:
    """Calls `make_slam(scene)` for each dataset of a suite, tracks its views and scores the poses.

    The SLAM receives the frames that our sensor measures; it should use only `scene.rig` of the scene. Results are added
    to the leaderboard in `out` as soon as they exist. An exception in the SLAM is a result: the dataset failed.
    """
    description = fs.read_suite(suite)
    results = []
    for dataset in description.datasets:
        changes = dict(change.split("=", 1) for change in dataset.changes)
        scene = fs.load_scene(dataset.scene, dataset.seed, changes)
        result = fs.EvaluationResult()
        result.suite, result.dataset, result.system = description.name, dataset.name, name
        result.command = "Python: " + getattr(make_slam, "__qualname__", type(make_slam).__qualname__)
        try:
            run = track(make_slam(scene), scene)
            result.views, result.poses, result.seconds = run.views, len(run.trajectory), sum(run.seconds)
            if len(run.trajectory) < 2:
                result.end, result.message = "no_trajectory", f"tracked {len(run.trajectory)} of {run.views} views"
            else:
                result.end = "finished"
                fs.set_score(result, run.score)
        except Exception as error:  # whatever the SLAM raises
            result.end, result.message = "failed", f"{type(error).__name__}: {error}"
            result.views = len(scene.trajectory)
        fs.add_result(out, result)
        results.append(result)
    return results
