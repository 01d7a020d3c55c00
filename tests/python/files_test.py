# SPDX-License-Identifier: Apache-2.0
"""Scenes, datasets and trajectories as files, and scenes made in Python."""
import subprocess

import fringeslam as fs
import numpy as np
import pytest


def test_a_scene_is_changed_by_key(root):
    folder = root / "scenes/boxes_and_foam"
    assert fs.load_scene(folder, seed=7).seed == 7
    dark = fs.load_scene(folder, changes={"light.ambient_lux": 0, "name": "night"})
    assert dark.name == "night"
    assert "ambient_lux: 0" in dark.resolved
    with pytest.raises(fs.Error, match="ambient"):
        fs.load_scene(folder, changes={"light.ambient_luxx": 1})


def wall(root, distance_m):
    return {
        "name": "wall",
        "seed": 1,
        "rig": {"file": str(root / "scenes/rigs/thesis.yaml"), "robot_from_camera": {"translation_m": [0, 0, 0]}},
        "patterns": {"axis": "columns", "steps": 3, "periods_px": [1040, 131, 16.5]},
        "materials": {"board": {"grain": "plain", "albedo": 0.8}},
        "objects": [
            {"shape": "plane", "size_m": [0.6, 0.6], "material": "board", "pose": {"translation_m": [0, 0, distance_m]}}
        ],
        "trajectory": {},
    }


def test_a_scene_is_made_from_a_dict(root):
    scene = fs.make_scene(wall(root, 0.9))
    view = fs.VirtualRig(scene, noise=False).simulate()
    seen = view.truth.depth_m[np.isfinite(view.truth.depth_m)]
    assert len(seen) > 10000
    assert np.allclose(seen, 0.9, atol=1e-6)
    assert scene.objects[0].vertices_m.shape == (4, 3)
    with pytest.raises(fs.Error, match="scene from Python.*objectz"):
        fs.make_scene(wall(root, 0.9) | {"objectz": []})


def test_relative_paths_refer_to_the_folder(root):
    scene = wall(root, 0.9)
    scene["rig"]["file"] = "rigs/thesis.yaml"
    assert fs.make_scene(scene, folder=root / "scenes").rig.name == "thesis"
    with pytest.raises(fs.Error, match="rigs/thesis.yaml"):
        fs.make_scene(scene, folder=root)


def test_recorded_datasets_equal_those_of_the_program(root, program, scene, tmp_path):
    recorder = fs.RecordingRig(fs.VirtualRig(scene), tmp_path / "python")
    while recorder.capture(scene.patterns) is not None:
        assert not (tmp_path / "python").exists()
    recorder.finish(scene.name, scene.seed)
    subprocess.run([program, "render", root / "scenes/boxes_and_foam", "--out", tmp_path / "cpp", "--quiet"], check=True)
    images = sorted((tmp_path / "cpp/stacks").rglob("*.png"))
    assert len(images) == len(scene.trajectory) * len(scene.patterns)
    for image in images:
        assert (tmp_path / "python" / image.relative_to(tmp_path / "cpp")).read_bytes() == image.read_bytes()
    replayed = fs.ReplayRig(tmp_path / "cpp")
    assert replayed.has_truth
    assert replayed.patterns == scene.patterns
    stacks = list(replayed)
    assert len(stacks) == len(scene.trajectory)
    rendered = list(fs.VirtualRig(scene))
    for stack, other in zip(stacks, rendered):
        assert all(np.array_equal(a, b) for a, b in zip(stack.images, other.stack.images))
    truth = fs.read_truth(tmp_path / "cpp/truth/000001.exr")
    for image in ("depth_m", "position_m", "normals", "projector_column", "projector_row", "temperature_c", "mask"):
        assert np.array_equal(getattr(truth, image), getattr(rendered[1].truth, image), equal_nan=True), image
    rig = scene.rig
    assert np.array_equal(fs.visible_surface([truth], rig), fs.visible_surface([rendered[1].truth], rig))


def test_an_unfinished_recording_leaves_nothing(scene, tmp_path):
    recorder = fs.RecordingRig(fs.VirtualRig(scene), tmp_path / "dataset")
    recorder.capture(scene.patterns)
    del recorder
    assert list(tmp_path.iterdir()) == []


def test_a_recording_does_not_replace_its_input(scene, tmp_path):
    folder = tmp_path / "dataset"
    recorder = fs.RecordingRig(fs.VirtualRig(scene), folder)
    recorder.capture(scene.patterns)
    recorder.finish(scene.name, scene.seed)
    with pytest.raises(fs.Error, match="dataset: contains the input .*dataset, which would be replaced"):
        fs.RecordingRig(fs.ReplayRig(folder), folder)
    files = sorted(path.name for path in (folder / "stacks/000000").glob("*.png"))
    (tmp_path / "import.yaml").write_text(
        "name: own\nnear_m: 0.7\nfar_m: 1.4\nstacks: [stacks/000000]\n"
        f"projector: {{width_px: {scene.rig.projector.width}, height_px: {scene.rig.projector.height}}}\n"
        f"patterns: [{{files: [{', '.join(files)}], "
        f"fringe: {{axis: columns, period_px: 16, steps: {len(files)}}}}}]\n"
    )
    imported = fs.ImportedRig(folder, tmp_path / "import.yaml")
    with pytest.raises(fs.Error, match="dataset: contains the input .*000000, which would be replaced"):
        fs.RecordingRig(imported, folder)
    assert len(list(imported)) == 1
    copy = fs.RecordingRig(fs.ReplayRig(folder), tmp_path / "copy")
    assert copy.capture(scene.patterns) is not None
    copy.finish(scene.name, scene.seed)
    assert len(fs.ReplayRig(folder)) == len(fs.ReplayRig(tmp_path / "copy")) == 1


def test_trajectories_are_written_and_read(tmp_path):
    poses = np.stack([np.eye(4)] * 3)
    poses[:, 0, 3] = [0, 1, 2]
    trajectory = fs.Trajectory([0.0, 0.5, 1.0], list(poses))
    (tmp_path / "t.tum").write_text(trajectory.to_tum())
    read = fs.read_trajectory(tmp_path / "t.tum")
    assert np.array_equal(read.timestamps_s, [0, 0.5, 1])
    assert np.array_equal(read.world_from_robot, poses)
    assert fs.score_trajectory(read, trajectory).ate_rmse_m == 0
    with pytest.raises(fs.Error, match="as many"):
        fs.Trajectory([0.0], list(poses))
    (tmp_path / "t.tum").write_text("0 1 2\n")
    with pytest.raises(fs.Error, match="t.tum:1"):
        fs.read_trajectory(tmp_path / "t.tum")


@pytest.mark.parametrize("call", [fs.load_scene, fs.ReplayRig, fs.ImportedRig, fs.read_rig, fs.read_trajectory])
def test_missing_files_are_errors_of_one_line(call):
    with pytest.raises(fs.Error, match="nowhere") as error:
        call("nowhere")
    assert "\n" not in str(error.value)
