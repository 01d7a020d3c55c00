# SPDX-License-Identifier: Apache-2.0
"""Decoding, reconstruction and registration by stages, scored against ground truth."""
import fringeslam as fs
import numpy as np
import pytest


def test_a_decoded_view_has_the_true_depth(view, rig):
    decoded = fs.decode(view.stack, rig)
    frame = fs.reconstruct(decoded, rig)
    score = fs.score_depth(frame, view.truth, decoded)
    assert score.median_m < 1e-4
    assert score.wrong_order < 1e-3
    assert score.valid_fraction > 0.95
    shown = fs.TRUTH_SURFACE | fs.TRUTH_IN_BEAM
    directly_lit = view.truth.mask.astype(int) & (shown | fs.TRUTH_IN_SHADOW) == shown
    lit = np.isfinite(frame.depth_m) & directly_lit
    error = (frame.depth_m - view.truth.depth_m)[lit]
    assert np.median(np.abs(error)) == pytest.approx(score.median_m, rel=1e-4)
    # The error is normally distributed with the sigma that the frame reports.
    assert 0.85 < np.median(np.abs(error / frame.sigma_m[lit])) / 0.6745 < 1.1


def test_textbook_phase_shifting_in_numpy_agrees(view, rig):
    # Three steps of -120, 0 and 120 degrees: equations 1 to 3 of the conference paper.
    finest = min(p.period_px for p in view.stack.patterns.patterns)
    images = [i.astype(float) for i, p in zip(view.stack.images, view.stack.patterns.patterns) if p.period_px == finest]
    phase = np.arctan2(np.sqrt(3) * (images[0] - images[2]), 2 * images[1] - images[0] - images[2])
    decoded = fs.decode(view.stack, rig)
    valid = np.isfinite(decoded.wrapped_phase)
    difference = np.angle(np.exp(1j * (phase - decoded.wrapped_phase)))[valid]
    assert valid.mean() > 0.5
    assert np.abs(difference).max() < 1e-5


def test_coordinates_of_another_decoder_are_triangulated(view, rig):
    exact = view.truth.projector_column
    frame = fs.reconstruct_coordinates(exact, np.full_like(exact, 0.01), rig)
    both = np.isfinite(frame.depth_m) & np.isfinite(view.truth.depth_m)
    assert both.mean() > 0.5
    assert np.nanmax(np.abs(frame.depth_m - view.truth.depth_m)[both]) < 1e-5


def test_registration_finds_the_true_motion(scene, rig):
    views = list(fs.VirtualRig(scene))
    frames = [fs.reconstruct(fs.decode(v.stack, rig), rig) for v in views[:2]]
    result = fs.register_frames(*frames, rig.camera)
    true_pose = np.linalg.inv(views[0].truth.world_from_robot) @ views[1].truth.world_from_robot
    robot_from_camera = rig.robot_from_camera
    true_motion = np.linalg.inv(robot_from_camera) @ true_pose @ robot_from_camera
    assert result.converged
    error = fs.pose_difference(result.target_from_source, true_motion)
    nees = error @ np.linalg.solve(result.covariance, error)
    assert nees < 30  # chi-square of six degrees of freedom, exceeded once in 25,000
    assert fs.score_motion(result.target_from_source, true_motion).translation_error_m < 2e-5
    refined = fs.register_frames(*frames, rig.camera, true_motion, stride=2)
    assert refined.pairs < result.pairs


def test_frames_without_all_images_are_refused(view, rig, tmp_path):
    whole = fs.reconstruct(fs.decode(view.stack, rig), rig)
    part = fs.Frame()
    part.points_m = np.ones((48, 64, 3), np.float32)
    for target, source, name in ((part, whole, "target"), (whole, part, "source")):
        with pytest.raises(fs.Error, match=f"{name}: needs points_m, sigma_m, normals and texture"):
            fs.register_frames(target, source, rig.camera)
    with pytest.raises(fs.Error, match="frame: needs points_m"):
        fs.write_ply(tmp_path / "part.ply", part)
    assert not (tmp_path / "part.ply").exists()
    with pytest.raises(TypeError):
        fs.visible_surface([None], rig)


def test_decoded_images_of_another_size_are_refused(view, rig):
    exact = view.truth.projector_column
    sigma = np.full_like(exact, 0.01)
    part = fs.DecodedStack()
    part.coordinate_px, part.sigma_px = exact, sigma
    with pytest.raises(fs.Error, match="depth: needs coordinate_px, sigma_px and mean"):
        fs.reconstruct(part, rig)
    with pytest.raises(fs.Error, match="of the same size"):
        fs.reconstruct_coordinates(exact, sigma[:10].copy(), rig)
    with pytest.raises(fs.Error, match="of the same size"):
        fs.reconstruct_coordinates(exact, sigma, rig, texture=sigma[:10].copy())
    part.coordinate_px = exact[:10].copy()
    with pytest.raises(fs.Error, match="differ in size"):
        fs.score_depth(fs.reconstruct_coordinates(exact, sigma, rig), view.truth, part)


def test_surface_is_that_of_the_camera_of_the_truth(view, rig):
    assert len(fs.visible_surface([view.truth], rig)) > 1000
    smaller = fs.parse_rig(rig.to_yaml(), "rig.yaml")
    smaller.camera.height //= 2
    with pytest.raises(fs.Error, match="visible surface: the ground truth's"):
        fs.visible_surface([view.truth], smaller)


def test_retract_inverts_pose_difference():
    tangent = np.array([0.1, -0.2, 0.3, 1, 2, 3])
    pose = fs.retract(np.eye(4), tangent)
    assert np.allclose(fs.pose_difference(pose, np.eye(4)), tangent)


def test_patterns_have_the_intensity_of_the_method():
    sequence = fs.design_patterns(640, 2, [16, 160], steps=4)
    assert len(sequence) == 8
    column = np.arange(640) + 0.5
    for pattern, image in zip(sequence.patterns, sequence.images()):
        phase = 2 * np.pi * column / pattern.period_px + pattern.shift_rad
        ideal = 255 * (0.5 + 0.5 * np.cos(phase))
        assert np.abs(np.broadcast_to(image, (2, 640)) - ideal).max() <= 0.5 + 1e-9
    with pytest.raises(fs.Error):
        fs.design_patterns(640, 2, [16], gray="grey")


def test_truth_refers_to_the_pose(scene):
    rig = fs.VirtualRig(scene)
    truth = rig.truth_of(2)
    assert np.array_equal(truth.world_from_robot, scene.trajectory[2][1])
    on_surface = np.isfinite(truth.depth_m)
    points = truth.position_m[on_surface][::500].astype(float)
    assert max(fs.NearestSurface(scene).distances_m(points, 0.1)) < 1e-5
    with pytest.raises(fs.Error, match="no pose 99"):
        rig.truth_of(99)
