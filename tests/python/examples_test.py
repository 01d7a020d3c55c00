# SPDX-License-Identifier: Apache-2.0
"""The examples run, are short, and are typed as the stubs state."""
import ast
import os
import pathlib
import subprocess
import sys

import fringeslam as fs
import numpy as np
import pytest

ROOT = pathlib.Path(__file__).resolve().parents[2]
EXAMPLES = sorted((ROOT / "examples/python").glob("*.py"))
OUTPUTS = {
    "depth": ["view.ply"],
    "map_scene": ["trajectory.tum", "mesh.ply"],
    "evaluate": ["evaluation/leaderboard.html", "evaluation/leaderboard.csv"],
    "patterns": [f"pattern_{i:02d}.png" for i in range(14)],
    "import_images": ["stack_000000.ply", "stack_000001.ply"],
}


def import_folder(folder):
    """Writes two stacks as images of another rig, described by import.yaml."""
    scene = fs.load_scene(ROOT / "scenes/boxes_and_foam")
    rig = scene.rig
    for index, view in enumerate(fs.VirtualRig(scene)):
        if index == 2:
            break
        (folder / f"pose{index}").mkdir()
        for i, image in enumerate(view.stack.images):
            fs.write_image(folder / f"pose{index}/{i:02d}.png", image)
    matrices = {
        "cam_K": rig.camera.matrix,
        "proj_K": rig.projector.matrix,
        "R": rig.projector_from_camera[:3, :3],
        "T": 1e3 * rig.projector_from_camera[:3, 3:],
        **{f"{name}_kc": np.array([[d.k1, d.k2, d.p1, d.p2, d.k3]])
           for name, d in (("cam", rig.camera.distortion), ("proj", rig.projector.distortion))},
    }
    text = "%YAML:1.0\n---\n"
    for name, matrix in matrices.items():
        data = ", ".join(repr(float(x)) for x in matrix.flat)
        text += f"{name}: !!opencv-matrix\n   rows: {matrix.shape[0]}\n   cols: {matrix.shape[1]}\n"
        text += f"   dt: d\n   data: [{data}]\n"
    (folder / "calibration.yml").write_text(text)
    (folder / "import.yaml").write_text(
        'name: other rig\nnear_m: 0.7\nfar_m: 1.4\nstacks: pose*\nprojector: {width_px: 1024, height_px: 768}\n'
        "calibration: {file: calibration.yml, unit_m: 0.001, direction: projector_from_camera}\npatterns:\n"
        + "".join(
            f'  - {{files: "%02d.png", first: {3 * k}, fringe: {{axis: columns, period_px: {period}, '
            "shift_deg: [-120, 0, 120], coordinate_origin: pixel_edge}}\n"
            for k, period in enumerate([1040, 131, 16.5])
        )
    )


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_example(example, tmp_path):
    (tmp_path / "scenes").symlink_to(ROOT / "scenes")
    arguments = []
    if example.stem == "import_images":
        (tmp_path / "images").mkdir()
        import_folder(tmp_path / "images")
        arguments = ["images"]
    if example.stem == "evaluate":
        (tmp_path / "one.yaml").write_text("datasets:\n  - {name: boxes, scene: scenes/boxes_and_foam}\n")
        arguments = ["one.yaml"]
    if example.stem == "dataset":
        (tmp_path / "spec.yaml").write_text(
            "name: boxes\nscenes: [scenes/boxes_and_foam]\nsamples: 3\nsplit: {train: 1}\nwrite: [images, depth, mask]\n"
        )
        program = os.environ["FRINGESLAM_PROGRAM"]
        subprocess.run([program, "dataset", tmp_path / "spec.yaml", "--out", tmp_path / "out"], check=True)
        arguments = ["out"]
    done = subprocess.run(
        [sys.executable, example, *arguments], cwd=tmp_path, capture_output=True, text=True, env=os.environ
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout
    for output in OUTPUTS.get(example.stem, []):
        assert (tmp_path / output).stat().st_size > 100


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_examples_have_at_most_twenty_lines(example):
    assert len(example.read_text().splitlines()) <= 20


def test_the_stubs_declare_every_public_name():
    package = pathlib.Path(fs.__file__).parent
    tree = ast.parse((package / "_fringeslam.pyi").read_text())
    declared = {}
    for node in tree.body:
        if isinstance(node, ast.ClassDef):
            targets = [n.target.id for n in node.body if isinstance(n, ast.AnnAssign)]
            declared[node.name] = {n.name for n in node.body if isinstance(n, ast.FunctionDef)} | set(targets)
        elif isinstance(node, ast.FunctionDef):
            declared[node.name] = set()
        elif isinstance(node, ast.AnnAssign):
            declared[node.target.id] = set()
    module = sys.modules["fringeslam._fringeslam"]
    names = [name for name in vars(module) if not name.startswith("_")]
    assert len(names) > 80
    assert set(names) <= set(declared)
    for name in names:
        value = getattr(module, name)
        if isinstance(value, type):
            assert {member for member in vars(value) if not member.startswith("_")} <= declared[name], name


def test_every_public_function_is_documented():
    module = sys.modules["fringeslam._fringeslam"]
    for name, value in vars(module).items():
        if not name.startswith("_") and callable(value):
            text = (value.__doc__ or "").replace("Overloaded function.", "")
            prose = text if isinstance(value, type) else text.partition("\n")[2]
            assert prose.strip(), name


def test_types_of_the_examples_agree_with_the_stubs(tmp_path):
    good = subprocess.run(
        [sys.executable, "-m", "mypy", "--cache-dir", tmp_path, "--ignore-missing-imports", "--check-untyped-defs",
         "--scripts-are-modules", *EXAMPLES], capture_output=True, text=True)  # fmt: skip
    assert good.returncode == 0, good.stdout
    wrong = tmp_path / "wrong.py"
    wrong.write_text("import fringeslam as fs\nfs.load_scene(3)\nfs.IcpOptions(stride='2')\nfs.Frame().depths\n")
    bad = subprocess.run([sys.executable, "-m", "mypy", "--cache-dir", tmp_path, wrong], capture_output=True, text=True)
    assert bad.stdout.count("error:") == 3, bad.stdout
