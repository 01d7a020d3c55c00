# SPDX-License-Identifier: Apache-2.0
"""3D visual SLAM with a structured-light sensor, scored against exact ground truth.

Arrays of images are read-only and share the memory of the C++ objects. Poses are 4 x 4 matrices `a_from_b`; lengths are
in metres, angles in radians, times in seconds. Errors in files, options and data raise `Error` with a one-line message.
"""

from ._fringeslam import *  # noqa: F401,F403
from ._fringeslam import __version__  # noqa: F401
from .datasets import SampleDataset  # noqa: F401
from .evaluation import evaluate  # noqa: F401
from .slam import TrackedScene, odometry, track  # noqa: F401
from .studies import study  # noqa: F401

for _value in list(vars().values()):
    if isinstance(_value, type) and _value.__module__ == "fringeslam._fringeslam":
        _value.__module__ = "fringeslam"  # in messages and documentation
del _value
