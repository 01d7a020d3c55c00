# SPDX-License-Identifier: Apache-2.0
import fringeslam as fs
import numpy as np
import pytest


@pytest.fixture(scope="module")
def calibration(root):
    scene = fs.load_scene(root / "scenes/calibration_checkerboard", changes={"trajectory.board_views.count": 6})
    board = fs.Board(columns=12, rows=10, spacing_m=0.01)
    rig = fs.VirtualRig(scene)
    return scene, board, [fs.observe_board(view.stack, rig.model, board) for view in rig]


def test_a_rig_is_calibrated_within_its_sigmas(calibration):
    scene, board, views = calibration
    result = fs.calibrate_rig(views, board, scene.rig)
    for estimate, truth, sigma in (
        (result.rig.camera, scene.rig.camera, result.camera_sigma),
        (result.rig.projector, scene.rig.projector, result.projector_sigma),
    ):
        for name in ("fx", "fy", "cx", "cy"):
            assert abs(getattr(estimate, name) - getattr(truth, name)) < 5 * getattr(sigma, name)
    shift = result.rig.projector_from_camera[:3, 3] - scene.rig.projector_from_camera[:3, 3]
    assert np.all(np.abs(shift) < 5 * result.translation_sigma_m)
    assert result.covariance.shape == (24, 24)


def test_too_few_views_are_an_error(calibration):
    scene, board, views = calibration
    with pytest.raises(fs.Error, match="view"):
        fs.calibrate_rig(views[:2], board, scene.rig)


def test_a_stack_without_a_board_is_reported(view, rig):
    with pytest.raises(fs.Error, match="rows"):
        fs.observe_board(view.stack, rig, fs.Board())  # only columns are coded
