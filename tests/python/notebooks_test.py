# SPDX-License-Identifier: Apache-2.0
"""The notebooks run, show figures, and are committed without outputs. They assert their claims themselves."""
import json
import pathlib
import subprocess

import pytest

NOTEBOOKS = sorted((pathlib.Path(__file__).resolve().parents[2] / "python/notebooks").glob("*.ipynb"))
FIGURES = {"fringes_to_depth": 2, "moving_robot": 2, "three_step_failures": 3, "your_decoder": 1}


def test_all_notebooks_are_known():
    assert {path.stem for path in NOTEBOOKS} == set(FIGURES)


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_runs(notebook, tmp_path):
    (tmp_path / "scenes").symlink_to(notebook.parents[2] / "scenes")
    (tmp_path / notebook.name).write_bytes(notebook.read_bytes())
    done = subprocess.run(
        ["/usr/bin/jupyter-nbconvert", "--to", "notebook", "--execute", "--ExecutePreprocessor.timeout=600",
         "--output", "executed.ipynb", notebook.name], cwd=tmp_path, capture_output=True, text=True)  # fmt: skip
    assert done.returncode == 0, done.stderr[-3000:]
    cells = json.loads((tmp_path / "executed.ipynb").read_text())["cells"]
    pictures = [out for cell in cells for out in cell.get("outputs", []) if "image/png" in out.get("data", {})]
    assert len(pictures) == FIGURES[notebook.stem]


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_has_no_outputs(notebook):
    for cell in json.loads(notebook.read_text())["cells"]:
        assert not cell.get("outputs"), "strip with: jupyter nbconvert --clear-output --inplace"
        assert cell.get("execution_count") is None
