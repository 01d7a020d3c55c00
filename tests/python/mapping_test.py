# SPDX-License-Identifier: Apache-2.0
"""Mapping from Python equals the program's, with our components and with Python's."""
import json
import subprocess
import threading

import fringeslam as fs
import numpy as np
import pytest


def run(scene, rig=None, **options):
    rig = rig or fs.VirtualRig(scene)
    pipeline = fs.Pipeline(rig.model, scene.patterns, **options)
    return list(fs.Driver(rig, pipeline)), pipeline


@pytest.fixture(scope="session")
def mapped(scene):
    return run(scene)


@pytest.fixture(scope="session")
def run_folder(root, program, tmp_path_factory):
    folder = tmp_path_factory.mktemp("run") / "out"
    command = [program, "run", root / "scenes/boxes_and_foam", "--out", folder, "--no-report", "--save-map", "--quiet"]
    subprocess.run(command, check=True)
    return folder


def test_the_trajectory_equals_that_of_the_program(mapped, run_folder):
    assert mapped[1].trajectory.to_tum() == (run_folder / "trajectory.tum").read_text()


def test_the_cloud_equals_that_of_the_program(mapped, run_folder, tmp_path):
    cloud = mapped[1].map.cloud()
    cloud.write_ply(tmp_path / "map.ply")
    # The headers differ by a comment that the program reserves for the number of points.
    ours, program = (file.read_bytes().split(b"end_header\n", 1)[1] for file in (tmp_path / "map.ply", run_folder / "map.ply"))
    assert ours == program
    assert len(ours) == len(cloud) * (7 * 4 + 3)


def test_the_score_equals_that_of_the_program(mapped, scene, run_folder):
    score = fs.score_trajectory(mapped[1].trajectory, scene.trajectory)
    expected = json.loads((run_folder / "score.json").read_text())["trajectory"]
    assert 1e3 * score.ate_rmse_m == pytest.approx(expected["ate_rmse_mm"], rel=1e-6)  # of the text file


def test_processing_stack_by_stack_gives_the_same_result(mapped, scene):
    rig = fs.VirtualRig(scene)
    pipeline = fs.Pipeline(rig.model, scene.patterns)
    while (stack := rig.capture(pipeline.next_patterns)) is not None:
        pipeline.process(stack)
    assert pipeline.trajectory.to_tum() == mapped[1].trajectory.to_tum()


def test_keyframes_outlive_the_growth_of_the_map(scene):
    rig = fs.VirtualRig(scene)
    pipeline = fs.Pipeline(rig.model, scene.patterns, mapping={"every_view": True})
    held, indices = [], []
    while (stack := rig.capture(patterns := pipeline.next_patterns)) is not None:
        first = patterns.patterns[0]
        pipeline.process(stack)
        assert first.period_px == patterns.patterns[0].period_px
        held.append(pipeline.map.keyframes[-1])
        indices.append(held[-1].index)
    assert len(held) > 2
    assert [keyframe.index for keyframe in held] == indices == list(range(len(held)))
    assert all(keyframe.landmarks > 0 for keyframe in held)


def test_results_describe_each_view(mapped, rig):
    views, pipeline = mapped
    assert [view.result.tracking for view in views] == ["first", "refined", "refined", "refined"]
    for view in views[1:]:
        result = view.result
        keyframe = pipeline.map.keyframes[result.reference]
        assert np.linalg.eigvalsh(result.covariance).min() > 0
        estimate = keyframe.world_from_camera @ result.reference_from_current
        assert np.allclose(estimate, result.world_from_robot @ rig.robot_from_camera, atol=1e-12)


def test_the_surface_is_a_mesh_near_the_true_one(mapped, scene):
    mesh = mapped[1].map.surface()
    triangles = np.asarray(mesh.triangles)
    assert triangles.max() < len(mesh)
    # The map's world frame is the robot's first pose.
    start = scene.trajectory[0][1]
    points = np.asarray(mesh.points_m, float) @ start[:3, :3].T + start[:3, 3]
    distances = np.array(fs.NearestSurface(scene).distances_m(points[::50], 0.01))
    assert np.median(distances) < 2e-4
    assert np.mean(np.isfinite(distances)) > 0.99
    assert np.shares_memory(mesh.points_m, mesh.points_m)


def test_a_saved_map_is_continued(mapped, scene, tmp_path):
    file = tmp_path / "saved.map"
    mapped[1].map.save(file)
    rig = fs.VirtualRig(scene)
    pipeline = fs.Pipeline.continue_map(fs.load_map(file, rig.model), scene.patterns)
    views = list(fs.Driver(rig, pipeline))
    assert views[-1].result.has_pose
    file.write_bytes(file.read_bytes()[:-1])
    with pytest.raises(fs.Error, match="saved.map"):
        fs.load_map(file, rig.model)


def test_maps_of_two_missions_are_merged(mapped, scene):
    a = mapped[1].map
    pipeline = fs.Pipeline(fs.VirtualRig(scene).model, scene.patterns, mapping={"every_view": True})
    list(fs.Driver(fs.VirtualRig(scene), pipeline))
    b = pipeline.map
    merged = fs.merge_maps(a, b)
    # The same images, so both worlds are the same.
    assert np.allclose(merged.a_from_b, np.eye(4), atol=1e-4)
    assert len(merged.map.keyframes) == len(a.keyframes) + len(b.keyframes)
    assert len([link for link in merged.links if link.accepted]) >= 2
    assert np.all(np.linalg.eigvalsh(merged.covariance) > 0)


def test_a_decoder_in_python_replaces_ours(scene, mapped):
    threads = set()

    def decoder(stack):
        threads.add(threading.get_ident())
        decoded = fs.decode(stack, scene.rig)
        return decoded.coordinate_px, np.asarray(decoded.sigma_px, np.float64)

    views, pipeline = run(scene, front_end=decoder)
    assert threads - {threading.get_ident()}, "views are reconstructed beside the mapper"
    assert all(view.result.has_pose for view in views)
    assert fs.score_trajectory(pipeline.trajectory, scene.trajectory).ate_rmse_m < 1e-5


def test_a_decoder_may_return_frames(scene, mapped):
    views, pipeline = run(scene, front_end=lambda stack: fs.reconstruct(fs.decode(stack, scene.rig), scene.rig))
    assert pipeline.trajectory.to_tum() == mapped[1].trajectory.to_tum()


def test_a_rig_in_python_gives_the_same_map(scene, mapped):
    class Camera:
        def __init__(self):
            self.inner = fs.VirtualRig(scene)
            self.model = self.inner.model

        def capture(self, patterns):
            stack = self.inner.capture(patterns)
            if stack is None:
                return None
            images = [np.array(image) for image in stack.images]
            return fs.FringeStack(images, patterns, stack.index, stack.timestamp_s, stack.exposure_time_s)

    assert run(scene, Camera())[1].trajectory.to_tum() == mapped[1].trajectory.to_tum()


class Failure(Exception):
    pass


def fail(*_):
    raise Failure("out of light")


@pytest.mark.parametrize("where", ["decoder", "rig"])
def test_exceptions_of_python_components_arrive(scene, where):
    class Camera:
        model = scene.rig
        capture = fail

    for _ in range(5):
        with pytest.raises(Failure, match="out of light"):
            run(scene, Camera()) if where == "rig" else run(scene, front_end=fail)


@pytest.mark.parametrize(
    "result, message",
    [
        (None, "a decoder must return a Frame or"),
        ((np.zeros((5, 5), np.float32),) * 2, "5 x 5"),
        (fs.Frame(), "points_m"),
    ],
)
def test_wrong_results_of_a_decoder_are_errors(scene, result, message):
    with pytest.raises(fs.Error, match=message):
        run(scene, front_end=lambda stack: result)


def test_a_driver_may_be_abandoned(scene):
    rig = fs.VirtualRig(scene)
    driver = fs.Driver(rig, fs.Pipeline(rig.model, scene.patterns, front_end=lambda s: (s.images[0] * 0.0,) * 2))
    next(driver)
    del driver


def test_other_threads_run_while_the_pipeline_works(scene):
    counted = 0
    done = threading.Event()

    def count():
        nonlocal counted
        while not done.wait(1e-3):
            counted += 1

    thread = threading.Thread(target=count)
    thread.start()
    rig = fs.VirtualRig(scene)
    rig.simulate()  # one call, which takes at least tens of milliseconds
    done.set()
    thread.join()
    assert counted > 2
