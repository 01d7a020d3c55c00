# SPDX-License-Identifier: Apache-2.0
import pathlib
import re
import sys

from skbuild import setup

root = pathlib.Path(__file__).parent
version = re.search(r"project\(FringeSLAM VERSION (\S+)", (root / "CMakeLists.txt").read_text())[1]

setup(
    name="fringeslam",
    version=version,
    description="3D visual SLAM with a structured-light sensor, scored against exact ground truth",
    license="Apache-2.0",
    python_requires=">=3.9",
    install_requires=["numpy<2"],  # Debian's pybind11 2.10 knows the layout of NumPy 1 alone
    packages=["fringeslam"],
    package_dir={"fringeslam": "python/fringeslam"},
    cmake_args=[
        f"-DPython_EXECUTABLE={sys.executable}",
        "-DBUILD_SHARED_LIBS=OFF",  # the project's libraries become part of the module
        "-DFRINGESLAM_PYTHON_DIR=python/fringeslam",
        *(f"-DFRINGESLAM_{part}=OFF" for part in ("TESTS", "BENCH", "HW", "REPORT")),
    ],
    cmake_install_target="install-python",
)
