# SPDX-License-Identifier: Apache-2.0
"""Components written in Python, driven by our rig: their poses, covariances and failures are scored as they are."""
import fringeslam as fs
import numpy as np
import pytest


def truth_slam(scene, world=np.eye(4), error=np.eye(4), covariance=None):
    """Returns the true poses in another world, each disturbed by `error`."""
    index = -1

    def slam(frame):
        nonlocal index
        index += 1
        camera = scene.trajectory[index][1] @ scene.rig.robot_from_camera
        pose = world @ camera @ (error if index else np.eye(4))
        return pose if covariance is None else (pose, covariance)

    return slam


def shifted(x_m):
    pose = np.eye(4)
    pose[0, 3] = x_m
    return pose


def test_the_truth_has_no_error_in_any_world(scene):
    world = fs.retract(np.eye(4), [0.3, -0.2, 0.5, 1, 2, 3])
    run = fs.track(truth_slam(scene, world), scene)
    assert run.score.ate_rmse_m < 1e-12
    assert run.views == len(scene.trajectory) == len(run.trajectory)
    assert run.lost == []
    assert run.nees == []


def test_an_error_is_scored_as_it_is(scene):
    run = fs.track(truth_slam(scene, error=shifted(2e-3), covariance=np.eye(6) * 1e-6), scene)
    others = len(scene.trajectory) - 1
    assert run.score.ate_rmse_m == pytest.approx(2e-3 * np.sqrt(others / (others + 1)), rel=1e-3)
    # 2 mm at a standard deviation of 1 mm
    assert np.allclose(run.nees, 4, rtol=1e-6)
    assert len(run.nees) == others


def test_lost_views_are_counted(scene):
    true_pose = truth_slam(scene)

    def slam(frame):
        pose = true_pose(frame)
        return None if frame.index == 2 else pose

    run = fs.track(slam, scene)
    assert run.lost == [2]
    assert run.score.poses == len(scene.trajectory) - 1
    nothing = fs.track(lambda frame: None, scene, views=2)
    assert nothing.lost == [0, 1]
    with pytest.raises(fs.Error, match="pose"):
        nothing.score


@pytest.mark.parametrize("result", [np.eye(3), 2 * np.eye(4), (np.eye(4), np.eye(3)), "lost"])
def test_wrong_poses_are_errors(scene, result):
    with pytest.raises((fs.Error, TypeError, ValueError)):
        fs.track(lambda frame: result, scene, views=2)


def test_odometry_of_our_registration_is_honest(scene, root):
    def register(target, source):
        result = fs.register_frames(target, source, scene.rig.camera)
        return (result.target_from_source, result.covariance) if result.converged else None

    nees = []
    for seed in range(1, 6):
        world = fs.load_scene(root / "scenes/boxes_and_foam", seed=seed)
        run = fs.track(fs.odometry(register), world)
        assert run.lost == []
        nees += run.nees
    # The three values of a scene are correlated, those of the five scenes are not.
    assert 2 < np.mean(nees) < 14


def test_chained_covariances_equal_those_of_many_draws():
    rng = np.random.default_rng(1)
    motions = [fs.retract(np.eye(4), v) for v in ([0.2, -0.1, 0.3, 0.5, 0.1, -0.2], [-0.3, 0.2, 0.1, -0.1, 0.6, 0.3])]
    root = rng.normal(size=(6, 6)) * 1e-3
    covariance = root @ root.T
    frames = [fs.Frame() for _ in range(3)]

    def chained(noisy):
        steps = iter(motions)

        def register(target, source):
            motion = next(steps)
            return fs.retract(motion, root @ rng.normal(size=6)) if noisy else motion, covariance

        slam = fs.odometry(register)
        return [slam(frame) for frame in frames][-1]

    mean, predicted = chained(False)
    errors = np.array([fs.pose_difference(chained(True)[0], mean) for _ in range(4000)])
    sampled = errors.T @ errors / len(errors)
    whitened = np.linalg.solve(predicted, sampled)
    assert np.allclose(np.linalg.eigvals(whitened), 1, atol=0.15)


def test_moving_views_are_compensated(root):
    scene = fs.load_scene(root / "scenes/loop", changes={"trajectory.continuous.speed_m_s": 0.3})
    assert scene.moves_continuously
    assert np.allclose(scene.pose_at(0.1)[:3, 3] - scene.pose_at(0)[:3, 3], 0, atol=0.04)
    rig = fs.VirtualRig(scene)
    view = rig.simulate()
    assert np.array_equal(scene.pose_at(view.stack.timestamp_s), view.truth.world_from_robot)
    front_end = fs.FringeFrontEnd(rig.model, scene.patterns)
    moving, motion = front_end.reconstruct_moving(view.stack)
    assert motion.converged
    speed = np.linalg.norm(motion.velocity_m_s)
    assert speed == pytest.approx(0.3, abs=0.1)
    still = fs.score_depth(fs.reconstruct(fs.decode(view.stack, rig.model), rig.model), view.truth)
    assert fs.score_depth(moving, view.truth).median_m < 0.7 * still.median_m


def test_views_with_a_motion_of_their_own_are_compensated(root):
    changes = {"trajectory.while_capturing.velocity_mm_s": [0, 0, 100]}
    scene = fs.load_scene(root / "scenes/boxes_and_foam", changes=changes)
    assert scene.moves_continuously
    assert not fs.load_scene(root / "scenes/boxes_and_foam").moves_continuously
    frames = []
    fs.track(lambda frame: frames.append(frame), scene, views=1)
    view = next(fs.VirtualRig(scene))
    compensated = fs.score_depth(frames[0], view.truth)
    still = fs.score_depth(fs.reconstruct(fs.decode(view.stack, scene.rig), scene.rig), view.truth)
    assert compensated.median_m < 0.7 * still.median_m
    assert compensated.valid_fraction > still.valid_fraction + 0.3


def test_odometry_of_a_moving_robot(root):
    scene = fs.load_scene(root / "scenes/loop", changes={"trajectory.continuous.speed_m_s": 0.3})
    last = []

    def register(target, source):
        guess = last[-1] if last else None
        result = fs.register_frames(target, source, scene.rig.camera, guess)
        last.append(result.target_from_source)
        return result.target_from_source if result.converged else None

    run = fs.track(fs.odometry(register), scene, views=5)
    assert run.views == 5
    assert run.score.ate_rmse_m < 5e-3
    assert np.linalg.norm(run.truth.world_from_robot[-1, :3, 3] - run.truth.world_from_robot[0, :3, 3]) > 0.05


def test_a_still_scene_has_poses_at_its_views_only(scene):
    time_s, pose = scene.trajectory[1]
    assert np.array_equal(scene.pose_at(time_s), pose)
    with pytest.raises(fs.Error, match="no view at"):
        scene.pose_at(time_s + 0.1)
