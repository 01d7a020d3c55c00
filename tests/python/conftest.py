# SPDX-License-Identifier: Apache-2.0
import os
import pathlib

import fringeslam as fs
import pytest

ROOT = pathlib.Path(__file__).resolve().parents[2]


@pytest.fixture(scope="session")
def root():
    return ROOT


@pytest.fixture(scope="session")
def program():
    return os.environ["FRINGESLAM_PROGRAM"]


@pytest.fixture(scope="session")
def scene():
    """Boxes and foam, four views."""
    return fs.load_scene(ROOT / "scenes/boxes_and_foam")


@pytest.fixture(scope="session")
def view(scene):
    return fs.VirtualRig(scene).simulate()


@pytest.fixture(scope="session")
def rig(scene):
    return fs.VirtualRig(scene).model
