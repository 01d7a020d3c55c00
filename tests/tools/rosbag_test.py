# SPDX-License-Identifier: Apache-2.0
"""Reads a rendered bag with ROS's own Python library, as a user would. Arguments: the program and a scratch folder.

Exits with 77, which ctest counts as skipped, if the library or the program's support is missing.
"""
import pathlib
import shutil
import subprocess
import sys

SCENE = """name: small
description: Two views of a few boxes
seed: 3
rig:
  file: rig.yaml
patterns: {axis: columns, steps: 3, periods_px: [1040, 131, 16.5], bits: 8}
light: {ambient_lux: 290}
materials:
  table: {grain: wood, albedo: 0.4, contrast: 0.35, grain_m: 0.012}
objects:
  - {shape: plane, size_m: [0.8, 0.8], material: table}
  - {shape: scatter, count: 12, area_m: [0.24, 0.24], max_height_m: 0.12, items: [{shape: box, size_min_m: [0.04, 0.03, 0.02], size_max_m: [0.09, 0.08, 0.08], material: table}]}
trajectory:
  interval_s: 0.5
  motions:
    - {translation_mm: [10, 5, -5], rotation_deg: [3, 1, -2]}
"""

try:
    import numpy as np
    import rosbag
except ImportError as missing:
    print(f"skipped: {missing}; tools/setup --test installs python3-rosbag")
    sys.exit(77)


def image_of(message):
    kind = {"mono8": np.uint8, "mono16": np.uint16, "32FC1": np.float32}[message.encoding]
    rows = np.frombuffer(message.data, np.uint8).reshape(message.height, message.step)
    return rows.view(kind)[:, : message.width]


def points_of(message):
    """Returns the fields of a PointCloud2, each H x W."""
    assert all(field.datatype == 7 and field.count == 1 for field in message.fields)
    values = np.frombuffer(message.data, np.float32).reshape(message.height, message.width, -1)
    return {field.name: values[:, :, field.offset // 4] for field in message.fields}


def matrix_of(transform):
    """Returns parent_from_child as a 4 x 4 matrix."""
    t, q = transform.translation, transform.rotation
    x, y, z, w = q.x, q.y, q.z, q.w
    assert abs(x * x + y * y + z * z + w * w - 1) < 1e-9
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w), t.x],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w), t.y],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y), t.z],
        [0, 0, 0, 1]])


def main(program, scratch, rig):
    shutil.rmtree(scratch, ignore_errors=True)
    scratch.mkdir(parents=True)
    (scratch / "scene.yaml").write_text(SCENE)
    shutil.copy(rig, scratch / "rig.yaml")
    file = scratch / "views.bag"
    rendered = subprocess.run([program, "render", scratch / "scene.yaml", "--out", file, "--format", "rosbag", "--quiet",
                               "--set", "render.samples_per_pixel=1"], capture_output=True, text=True)
    if "built without ROS bags" in rendered.stderr:
        print("skipped: " + rendered.stderr)
        sys.exit(77)
    assert rendered.returncode == 0, rendered.stderr

    messages = {}
    for topic, message, time in rosbag.Bag(str(file)).read_messages():
        messages.setdefault(topic, []).append(message)
        stamp = message.header.stamp if hasattr(message, "header") else time
        assert stamp == time and time.to_nsec() > 0, topic
    latched = {c.topic for c in rosbag.Bag(str(file))._get_connections() if c.header.get("latching") in ("1", b"1")}
    assert latched == {"/fringeslam/dataset", "/fringeslam/rig", "/fringeslam/patterns", "/projector/camera_info",
                       "/tf_static"}, latched

    # Nine images per view at the camera's 90 Hz, the eighth (the middle of the finest fringes) at the view's time.
    images, infos = messages["/camera/image_raw"], messages["/camera/camera_info"]
    stamps = np.array([m.header.stamp.to_nsec() for m in images])
    assert len(stamps) == 18
    expected = 10**9 * 10**9 + np.add.outer([0, 0.5], (np.arange(9) - 7) / 90).ravel() * 1e9
    assert np.abs(stamps - expected).max() <= 200, stamps - expected  # the resolution of a double
    assert [m.header.stamp for m in infos] == [m.header.stamp for m in images]
    assert [m.header.seq for m in images] == list(range(18))
    for message in images:
        assert message.encoding == "mono8" and message.header.frame_id == "camera"
        assert 10 < image_of(message).mean() < 245
    assert len({m.data for m in images}) == 18

    info = infos[0]
    fx, fy, cx, cy = info.K[0], info.K[4], info.K[2], info.K[5]
    assert info.distortion_model == "plumb_bob" and list(info.D) == [0] * 5  # rendered without distortion
    assert (info.width, info.height) == (images[0].width, images[0].height)
    projector = messages["/projector/camera_info"][0]
    assert (projector.width, projector.height, projector.header.frame_id) == (1024, 768, "projector")
    assert projector.D[0] == 0.05

    # Points, depth and texture agree with each other and with the lens.
    views = []
    for points, depth, texture in zip(messages["/camera/points"], messages["/camera/depth"], messages["/camera/texture"]):
        assert points.header.stamp == depth.header.stamp == texture.header.stamp
        fields, z = points_of(points), image_of(depth)
        assert list(fields) == ["x", "y", "z", "intensity", "sigma"]
        assert np.array_equal(fields["z"], z, equal_nan=True)
        assert np.array_equal(fields["intensity"], image_of(texture).astype(np.float32))
        valid = ~np.isnan(z)
        assert valid.mean() > 0.8  # the rest is in the shadow of boxes
        v, u = np.nonzero(valid)
        assert np.abs(fx * fields["x"][valid] / z[valid] + cx - u).max() < 1e-3
        assert np.abs(fy * fields["y"][valid] / z[valid] + cy - v).max() < 1e-3
        sigma = fields["sigma"][valid]
        assert 1e-6 < np.median(sigma) < 1e-3 and sigma.min() > 0
        views.append((fields, z, valid))
    assert len(views) == 2

    # The transforms carry the points of one view to the depth of the other.
    static = {t.child_frame_id: t for t in messages["/tf_static"][0].transforms}
    assert {child: t.header.frame_id for child, t in static.items()} == {"camera": "robot", "projector": "camera"}
    robot_from_camera = matrix_of(static["camera"].transform)
    world_from_robot = [matrix_of(m.transforms[0].transform) for m in messages["/ground_truth/tf"]]
    assert "/tf" not in messages  # truth is only where its name says so
    assert np.allclose(world_from_robot[1][:3, 3], [0.010, 0.005, -0.005], atol=1e-12)
    second_from_first = (np.linalg.inv(world_from_robot[1] @ robot_from_camera) @ world_from_robot[0]
                         @ robot_from_camera)
    fields, z, valid = views[0]
    there = second_from_first @ np.stack([fields["x"][valid], fields["y"][valid], z[valid], np.ones(valid.sum())])
    u = np.rint(fx * there[0] / there[2] + cx).astype(int)
    v = np.rint(fy * there[1] / there[2] + cy).astype(int)
    inside = (u >= 0) & (v >= 0) & (u < info.width) & (v < info.height)
    off = there[2][inside] - views[1][1][v[inside], u[inside]]
    assert inside.mean() > 0.5 and np.nanmedian(np.abs(off)) < 5e-4, np.nanmedian(np.abs(off))

    path = messages["/ground_truth/path"][0]
    assert path.header.frame_id == "world" and len(path.poses) == 2
    assert path.poses[1].header.stamp == messages["/camera/points"][1].header.stamp
    assert path.poses[1].pose.position.x == world_from_robot[1][0, 3]
    print("all topics agree")


if __name__ == "__main__":
    main(sys.argv[1], pathlib.Path(sys.argv[2]), pathlib.Path(sys.argv[3]))
