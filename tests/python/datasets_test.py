# SPDX-License-Identifier: Apache-2.0
"""Datasets are read back as they were rendered: by index, in worker processes, and by tools for WebDatasets."""
import io
import json
import multiprocessing
import pickle
import shutil
import subprocess
import tarfile

import fringeslam as fs
import numpy as np
import pytest

SPEC = """name: small
scenes: [{root}/scenes/boxes_and_foam]
rigs: [rig.yaml]
samples: 8
views: 2
worlds: 2
seed: 3
samples_per_tar: 2
split: {{train: 0.5, test: 0.5}}
parameters:
  light.ambient_lux: {{uniform: [0, 500]}}
fixed:
  render.samples_per_pixel: 1
"""


@pytest.fixture(scope="session")
def folder(root, program, tmp_path_factory):
    folder = tmp_path_factory.mktemp("dataset")
    rig = fs.read_rig(root / "scenes/rigs/thesis.yaml")
    for lens in (rig.camera,):  # a quarter of the pixels, the same field of view
        lens.width, lens.height = lens.width // 4, lens.height // 4
        lens.fx, lens.fy = lens.fx / 4, lens.fy / 4
        lens.cx, lens.cy = (lens.cx + 0.5) / 4 - 0.5, (lens.cy + 0.5) / 4 - 0.5
    (folder / "rig.yaml").write_text(rig.to_yaml())
    (folder / "dataset.yaml").write_text(SPEC.format(root=root))
    subprocess.run([program, "--quiet", "dataset", folder / "dataset.yaml", "--out", folder / "out"], check=True)
    return folder / "out"


def test_samples_equal_the_simulation(folder, root):
    dataset = fs.SampleDataset(folder, parts=["images", "depth", "normals", "coordinate", "phase", "order", "mask"])
    sample = dataset[5]
    info = sample["info"]
    scene = fs.load_scene(
        root / "scenes/boxes_and_foam", info["seed"], info["parameters"], rig=folder.parent / "rig.yaml"
    )
    view = list(fs.VirtualRig(scene, samples_per_pixel=1))[info["view"]]
    np.testing.assert_array_equal(sample["images"], np.stack(view.stack.images))
    truth = view.truth
    np.testing.assert_array_equal(sample["depth"], truth.depth_m)
    np.testing.assert_array_equal(sample["normals"], truth.normals)
    np.testing.assert_array_equal(sample["column"], truth.projector_column)
    np.testing.assert_array_equal(sample["mask"], truth.mask.astype(np.uint8))
    np.testing.assert_allclose(
        sample["world_from_camera"], truth.world_from_robot @ scene.rig.robot_from_camera, atol=1e-15
    )
    # phase = 2 pi order + phase within the period
    finest = sample["column_order"][np.argmin(sample["column_periods"])]
    known = ~np.isnan(sample["column"])
    assert (finest[~known] == -1).all() and known.sum() > 1000
    np.testing.assert_array_equal(finest[known], np.floor(sample["column_phase"][known] / (2 * np.pi) + 1e-5))
    assert fs.parse_rig(sample["rig"]).camera.width == scene.rig.camera.width
    assert len(fs.parse_patterns(sample["patterns"]).patterns) == len(sample["images"]) == 9


@pytest.mark.parametrize("values", [np.array([[0, 65534, 65535]], np.uint16), np.array([[0, 65534, np.nan]], np.float32)])
def test_unknown_orders_are_minus_one(values):
    orders = fs.datasets._order(values)
    assert orders.dtype == np.int32
    assert orders.tolist() == [[0, 65534, -1]]


def test_splits_share_no_world(folder):
    train, test = (fs.SampleDataset(folder, split) for split in ("train", "test"))
    assert len(train) == len(test) == 4 and len(fs.SampleDataset(folder)) == 8
    assert not set(train.column("world")) & set(test.column("world"))
    lux = train.column("light.ambient_lux")
    assert lux.dtype == np.float64 and (lux >= 0).all() and (lux <= 500).all() and len(set(lux)) == 2


def test_it_is_a_sequence(folder):
    dataset = fs.SampleDataset(folder, parts=["depth"])
    names = [sample["name"] for sample in dataset]
    assert names == [dataset[i]["name"] for i in range(len(dataset))]
    assert len(set(names)) == 8 and dataset[-1]["name"] == names[-1]
    with pytest.raises(IndexError):
        dataset[8]
    assert set(dataset[0]) >= {"depth", "world_from_camera", "info"} and "images" not in dataset[0]


def depth_sum(arguments):
    dataset, index = arguments
    return dataset[index]["name"], float(np.nansum(dataset[index]["depth"]))


@pytest.mark.parametrize("method", ["fork", "spawn"])
def test_worker_processes_read_it(folder, method):
    dataset = fs.SampleDataset(folder, parts=["depth"])
    expected = [depth_sum((dataset, i)) for i in range(len(dataset))]  # the files are open when the workers start
    with multiprocessing.get_context(method).Pool(2) as pool:
        assert pool.map(depth_sum, [(dataset, i) for i in range(len(dataset))]) == expected


def test_shards_of_workers_are_disjoint_and_complete(folder):
    dataset = fs.SampleDataset(folder, parts=[])
    names = [[sample["name"] for sample in dataset.shard(i, 3)] for i in range(3)]
    assert sorted(sum(names, [])) == sorted(sample["name"] for sample in dataset)
    assert sum(len(part) for part in names) == len(dataset)
    assert [s["name"] for s in dataset.select([3, 1])] == [dataset[3]["name"], dataset[1]["name"]]
    with pytest.raises(fs.Error, match="from 0 to 2"):
        dataset.shard(3, 3)


def test_samples_can_be_pickled_and_collated(folder):
    samples = [pickle.loads(pickle.dumps(sample)) for sample in fs.SampleDataset(folder, "train")]
    keys = set(samples[0])
    for sample in samples:
        assert set(sample) == keys
        for value in sample.values():
            assert isinstance(value, (str, dict, np.ndarray))
    batch = {key: np.stack([s[key] for s in samples]) for key in keys if isinstance(samples[0][key], np.ndarray)}
    assert batch["images"].shape[:2] == (4, 9)


def test_sigma_predicts_the_scatter_of_the_phase(folder, root):
    def finest_phase(images):  # three shifts of -120, 0, 120 degrees
        images = np.asarray(images[6:9], dtype=float)
        return np.arctan2(np.sqrt(3) * (images[0] - images[2]), 2 * images[1] - images[0] - images[2])

    sample = fs.SampleDataset(folder, parts=["images", "sigma", "mask"])[0]
    info = sample["info"]
    scene = fs.load_scene(
        root / "scenes/boxes_and_foam", info["seed"], info["parameters"], rig=folder.parent / "rig.yaml"
    )
    clean = next(fs.VirtualRig(scene, samples_per_pixel=1, noise=False, quantise=False)).stack.images
    noise = np.angle(np.exp(1j * (finest_phase(sample["images"]) - finest_phase(clean)))) * 16.5 / (2 * np.pi)
    errors = (noise / sample["column_sigma"])[sample["mask"] == 3]
    errors = errors[np.isfinite(errors)]
    assert len(errors) > 5000
    assert np.median(np.abs(errors)) / 0.6745 == pytest.approx(1, abs=0.06)


def test_tar_files_are_webdatasets(folder):
    names = set()
    for tar in sorted(folder.glob("*.tar")):
        with tarfile.open(tar) as archive:
            members = archive.getmembers()
        keys = [member.name.split(".", 1)[0] for member in members]
        # The members of a sample follow each other, sorted.
        assert [m.name for m in members] == sorted(m.name for m in members)
        assert len(dict.fromkeys(keys)) == 2 and keys == sorted(keys)
        assert {m.mtime for m in members} == {946684800} and {m.uid for m in members} == {0}
        names |= set(keys)
    assert names == {sample["name"] for sample in fs.SampleDataset(folder, parts=[])}


def test_damage_is_found(folder, tmp_path):
    copy = tmp_path / "copy"
    shutil.copytree(folder, copy)
    fs.SampleDataset(copy).check()
    content = bytearray((copy / "train-000001.tar").read_bytes())
    content[len(content) // 2] ^= 1
    (copy / "train-000001.tar").write_bytes(content)
    with pytest.raises(fs.Error, match="train-000001.tar: the checksum differs"):
        fs.SampleDataset(copy).check()
    with pytest.raises(fs.Error, match="train-000001.tar, sample .*: the checksum differs"):
        list(fs.SampleDataset(copy, verify=True))
    (copy / "train-000001.tar").write_bytes(content[: len(content) // 2])
    with pytest.raises(fs.Error):
        list(fs.SampleDataset(copy))
    (copy / "train-000001.tar").unlink()
    with pytest.raises(fs.Error, match="train-000001.tar"):
        list(fs.SampleDataset(copy))


def test_wrong_use_is_an_error_of_one_line(folder, tmp_path):
    for make in (
        lambda: fs.SampleDataset(tmp_path),
        lambda: fs.SampleDataset(folder, "validation"),
        lambda: fs.SampleDataset(folder, parts=["dept"]),
        lambda: fs.SampleDataset(folder).column("flux"),
        lambda: fs.decode_image(b"no image"),
        lambda: fs.parse_rig("camera: 3"),
    ):
        with pytest.raises(fs.Error) as error:
            make()
        assert "\n" not in str(error.value)


def test_croissant_refers_to_the_files(folder):
    metadata = json.loads((folder / "croissant.json").read_text())
    sums = dict(reversed(line.split("  ")) for line in (folder / "SHA256SUMS").read_text().splitlines())
    files = [node for node in metadata["distribution"] if node["@type"] == "cr:FileObject"]
    assert {file["name"] for file in files} == {p.name for p in folder.glob("*.tar")} | {"index.csv"}
    for file in files:
        assert file["sha256"] == sums[file["name"]]
        assert file["contentSize"] == f"{(folder / file['contentUrl']).stat().st_size} B"
    header = io.StringIO((folder / "index.csv").read_text()).readline().strip().split(",")
    (samples,) = [node for node in metadata["recordSet"] if node["@id"] == "samples"]
    assert [field["source"]["extract"]["column"] for field in samples["field"]] == header
