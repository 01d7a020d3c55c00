# SPDX-License-Identifier: Apache-2.0
"""Runs other people's SLAM and registration on rendered scenes, and scores them."""

import dataclasses
import time
from typing import Any, Callable, List, Optional, Tuple, Union

import numpy as np

from . import _fringeslam as fs

Array = np.ndarray
PoseAndCovariance = Tuple[Array, Array]
#: Frame -> world_from_camera (4 x 4), or (pose, 6 x 6 covariance), or None if the view is lost.
Slam = Callable[[fs.Frame], Union[Array, PoseAndCovariance, None]]
#: (target, source) -> target_from_source, or (pose, covariance), or None.
Registration = Callable[[fs.Frame, fs.Frame], Union[Array, PoseAndCovariance, None]]


@dataclasses.dataclass
class TrackedScene:
    """A trajectory estimated along a scene, and its errors."""

    trajectory: fs.Trajectory  #: of the robot, tracked views only
    views: int  #: views of the scene
    lost: List[int]  #: indices of views without a pose
    seconds: List[float]  #: time of each call
    nees: List[float]  #: squared Mahalanobis error of each pose with a covariance; 6 on average if it is honest
    truth: fs.Trajectory  #: true poses of the tracked views

    @property
    def score(self) -> fs.TrajectoryScore:
        """Errors of the trajectory, first poses aligned. Raises Error with fewer than two poses."""
        return fs.score_trajectory(self.trajectory, self.truth)


def _pose_and_covariance(result: Any) -> Tuple[Optional[Array], Optional[Array]]:
    if result is None:
        return None, None
    pose, covariance = result if isinstance(result, tuple) else (result, None)
    pose = np.asarray(pose, float)
    if pose.shape != (4, 4):
        raise fs.Error(f"a pose must be a 4 x 4 matrix, not an array of shape {pose.shape}")
    if covariance is not None:
        covariance = np.asarray(covariance, float)
        if covariance.shape != (6, 6):
            raise fs.Error(f"a covariance must be a 6 x 6 matrix, not an array of shape {covariance.shape}")
    return pose, covariance


def _frames(rig: fs.VirtualRig):
    """Yields the reconstructed frame and the ground truth of each view."""
    scene = rig.scene
    front_end = fs.FringeFrontEnd(rig.model, scene.patterns)
    for view in rig:
        if scene.moves_continuously:
            yield front_end.reconstruct_moving(view.stack)[0], view.truth
        else:
            yield front_end.reconstruct(view.stack), view.truth


def track(slam: Slam, scene: fs.Scene, *, views: Optional[int] = None, **render: Any) -> TrackedScene:
    """Calls `slam` with each frame of a scene, as our sensor measures it, and scores the poses that it returns.

    The world of `slam` may be any; its first pose is aligned with the true one. Covariances are those of the camera's
    pose relative to the first one, of (rotation in rad, translation in m) applied from the left. `render` changes
    RenderOptions, such as noise=False.
    """
    rig = fs.VirtualRig(scene, **render)
    robot_from_camera = rig.model.robot_from_camera
    times: List[float] = []
    poses: List[Array] = []
    lost: List[int] = []
    seconds: List[float] = []
    nees: List[float] = []
    true_poses: List[Array] = []
    origin: Optional[Tuple[Array, Array]] = None
    count = 0
    for frame, truth in _frames(rig):
        if views is not None and count == views:
            break
        count += 1
        start = time.perf_counter()
        pose, covariance = _pose_and_covariance(slam(frame))
        seconds.append(time.perf_counter() - start)
        if pose is None:
            lost.append(frame.index)
            continue
        true_pose = truth.world_from_robot @ robot_from_camera
        if origin is None:
            origin = pose, true_pose
        elif covariance is not None:
            error = fs.pose_difference(np.linalg.inv(origin[0]) @ pose, np.linalg.inv(origin[1]) @ true_pose)
            nees.append(float(error @ np.linalg.solve(covariance, error)))
        times.append(frame.timestamp_s)
        true_poses.append(truth.world_from_robot)
        poses.append(pose @ np.linalg.inv(robot_from_camera))
    return TrackedScene(
        fs.Trajectory(times, poses), count, lost, seconds, nees, fs.Trajectory(times, true_poses)
    )


def _skew(v: Array) -> Array:
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


def odometry(register: Registration) -> Slam:
    """Makes a SLAM of a registration: each frame is registered with the last tracked one, and the motions are chained."""
    last: Optional[fs.Frame] = None
    pose = np.eye(4)
    covariance: Optional[Array] = np.zeros((6, 6))

    def slam(frame: fs.Frame) -> Union[Array, PoseAndCovariance, None]:
        nonlocal last, pose, covariance
        if last is not None:
            motion, motion_covariance = _pose_and_covariance(register(last, frame))
            if motion is None:
                return None
            rotation = pose[:3, :3]
            if covariance is not None and motion_covariance is not None:
                # First order: the error of the earlier pose turns the motion's lever, the motion's error is turned by it.
                by_pose = np.eye(6)
                by_pose[3:, :3] = -_skew(rotation @ motion[:3, 3])
                by_motion = np.kron(np.eye(2), rotation)
                covariance = by_pose @ covariance @ by_pose.T + by_motion @ motion_covariance @ by_motion.T
            else:
                covariance = None
            pose = pose @ motion
        last = frame
        return pose if covariance is None else (pose, covariance)

    return slam
