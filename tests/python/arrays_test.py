# SPDX-License-Identifier: Apache-2.0
"""Images share memory in both directions, and live as long as anything uses them."""
import gc
import threading
import weakref

import fringeslam as fs
import numpy as np
import pytest


def address(array):
    return array.__array_interface__["data"][0]


class Owner(np.ndarray):
    """An array that can be referenced weakly."""


def small_sequence():
    return fs.design_patterns(64, 48, [16], steps=3)


def small_stack(images):
    return fs.FringeStack(images, small_sequence())


def test_arrays_from_cpp_share_the_image(view):
    assert address(view.stack.images[0]) == address(view.stack.images[0])
    assert address(view.truth.depth_m) == address(view.truth.depth_m)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
def test_images_given_to_cpp_are_not_copied(dtype):
    images = [np.full((6, 8), i, dtype) for i in range(3)]
    stack = small_stack(images)
    for image, kept in zip(images, stack.images):
        assert address(kept) == address(image)
        assert kept.dtype == dtype
        assert np.array_equal(kept, image)


def test_a_window_of_a_larger_array_is_not_copied():
    whole = np.arange(3 * 20 * 30, dtype=np.float32).reshape(3, 20, 30)
    windows = [image[2:8, 3:11] for image in whole]
    for window, kept in zip(windows, small_stack(windows).images):
        assert address(kept) == address(window)
        assert np.array_equal(kept, window)


def test_points_and_depth_share_memory(view, rig):
    frame = fs.reconstruct(fs.decode(view.stack, rig), rig)
    assert frame.points_m.shape == (*view.truth.depth_m.shape, 3)
    assert np.shares_memory(frame.points_m, frame.depth_m)
    assert np.shares_memory(frame.points_m, frame.points_m)


def test_arrays_from_cpp_are_read_only(view):
    with pytest.raises(ValueError, match="read-only"):
        view.stack.images[0][0, 0] = 1


def test_arrays_outlive_their_owner(scene):
    image = fs.VirtualRig(scene).simulate().stack.images[0]
    before = image.copy()
    gc.collect()
    np.zeros((2000, 2000)).sum()  # reuses freed memory
    assert np.array_equal(image, before)


def test_cpp_keeps_arrays_alive_and_releases_them():
    images = [np.zeros((6, 8), np.uint8).view(Owner) for _ in range(3)]
    references = [weakref.ref(image) for image in images]
    stack = small_stack(images)
    del images
    gc.collect()
    assert all(reference() is not None for reference in references)
    kept = stack.images
    del stack
    gc.collect()
    assert all(reference() is not None for reference in references)
    del kept
    gc.collect()
    assert all(reference() is None for reference in references)


def test_images_may_be_released_by_any_thread():
    reference = None

    def work():
        nonlocal reference
        image = np.zeros((6, 8), np.uint8).view(Owner)
        reference = weakref.ref(image)
        stacks.append(small_stack([image] * 3))

    stacks = []
    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    stacks.clear()
    gc.collect()
    assert reference() is None


@pytest.mark.parametrize(
    "image, message",
    [
        (np.zeros((6, 8)), "float64"),
        (np.zeros((6, 8, 3), np.uint8), r"\(6, 8, 3\)"),
        (np.zeros((8, 6), np.uint8).T, "ascontiguousarray"),
        (np.zeros((6, 16), np.uint8)[:, ::2], "ascontiguousarray"),
        (np.zeros((6, 8), np.uint8)[::-1], "ascontiguousarray"),
        ([[0, 1], [2, 3]], "list"),
    ],
)
def test_other_arrays_are_rejected_with_one_line(image, message):
    with pytest.raises(TypeError, match=message) as error:
        small_stack([image] * 3)
    assert "\n" not in str(error.value)


def test_stacks_are_checked():
    image = np.zeros((6, 8), np.uint8)
    with pytest.raises(fs.Error, match="2 images"):
        small_stack([image] * 2)
    with pytest.raises(fs.Error):
        small_stack([image, image, image[:5]])


def test_poses_are_matrices():
    turn = np.eye(4)
    turn[:3, :3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    turn[:3, 3] = [1, 2, 3]
    rig = fs.RigModel()
    rig.projector_from_camera = turn
    assert np.array_equal(rig.projector_from_camera, turn)
    for wrong in (2 * turn, np.diag([1.0, 1, -1, 1]), np.full((4, 4), np.nan)):
        with pytest.raises(fs.Error, match="rigid"):
            rig.projector_from_camera = wrong
    with pytest.raises(TypeError, match="4 x 4"):
        rig.projector_from_camera = np.eye(3)
    assert np.array_equal(rig.projector_from_camera, turn)


def test_missing_images_are_none(view):
    assert view.stack.thermal_c is None
    assert fs.Frame().depth_m is None
