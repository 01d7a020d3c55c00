# SPDX-License-Identifier: Apache-2.0
"""Reads datasets that `fringeslam dataset` has rendered."""

import csv
import hashlib
import json
import os
import pathlib
from typing import Any, Dict, Iterator, List, Optional, Sequence, Tuple, Union

import numpy as np

from . import _fringeslam as fs

_FORMAT = "fringeslam-samples-1"
_BLOCK = 512  # bytes, of a tar archive
_PARTS = ("images", "thermal", "depth", "normals", "coordinate", "phase", "order", "sigma", "objects", "mask",
          "temperature")  # fmt: skip


def _order(values: np.ndarray) -> np.ndarray:
    none = np.isnan(values) if values.dtype == np.float32 else values == 65535
    orders = np.where(none, 0, values).astype(np.int32)
    orders[none] = -1
    return orders


class SampleDataset:
    """The samples of a dataset, or of one of its splits 'train', 'validation' and 'test'.

    `dataset[i]` is a dict; iterating yields all samples in order. Objects can be pickled, and each process opens the tar
    files itself, so that a torch.utils.data.DataLoader can use them as they are. `parts` names the parts to decode, by
    default all that are present but the phase. With `verify`, each sample's checksum is compared when it is read.

    name                 text, such as '000000042'
    images               (N, H, W) uint8, uint16 or float32: grey values
    depth                (H, W) m, z of the camera frame; NaN: no surface
    normals              (H, W, 3) unit, camera frame
    column, row          (H, W) projector coordinate, px; NaN outside the projector's field
    column_phase, row_phase   (H, W) absolute phase of the finest period, rad; only if `parts` contains 'phase'
    column_order, row_order   (P, H, W) int32: fringe orders of `column_periods`, `row_periods`; -1: none
    column_sigma, row_sigma   (H, W) standard deviation of the coordinate, px; NaN: none
    depth_sigma          (H, W) standard deviation of the depth, m
    objects              (H, W) int32: number of the object; 0: none
    mask                 (H, W) uint8: sum of bits 1 surface, 2 in the projector's field, 4 shadow, 8 edge, 16 victim,
                         32 seen by the thermal camera
    thermal, temperature thermal image, and temperature of the surface, degrees C
    world_from_camera, projector_from_camera   4 x 4
    camera_matrix, projector_matrix            3 x 3
    rig, patterns        texts for fringeslam.parse_rig() and parse_patterns()
    info                 times, seed, world, drawn values
    """

    def __init__(
        self,
        folder: Union[str, "os.PathLike[str]"],
        split: Optional[str] = None,
        parts: Optional[Sequence[str]] = None,
        verify: bool = False,
    ):
        self.folder = pathlib.Path(folder)
        self.about = self._read_about()
        self.verify = verify
        self.parts = tuple(_PARTS if parts is None else parts)
        for part in self.parts:
            if part not in _PARTS:
                raise fs.Error(f"'{part}' is not one of the parts {', '.join(_PARTS)}")
        self._derives_phase = parts is not None and "phase" in parts
        if split is not None and split not in self.about["splits"]:
            raise fs.Error(f"{self.folder}: has no split '{split}', only {', '.join(self.about['splits'])}")
        with open(self.folder / "index.csv", newline="", encoding="utf-8") as index:
            lines = csv.reader(index)
            self._columns = {name: i for i, name in enumerate(next(lines))}
            place = self._columns["split"]
            self._rows = [row for row in lines if split is None or row[place] == split]
        self._open_files: Dict[str, int] = {}

    def _read_about(self) -> Dict[str, Any]:
        try:
            about = json.loads((self.folder / "dataset.json").read_text(encoding="utf-8"))
        except (OSError, ValueError):
            about = None
        if not isinstance(about, dict) or about.get("format") != _FORMAT:
            raise fs.Error(f"{self.folder}: is not a dataset of `fringeslam dataset` of this version")
        if not (self.folder / "SHA256SUMS").exists():
            raise fs.Error(f"{self.folder}: is incomplete; run the command that renders it again")
        return about

    def __len__(self) -> int:
        return len(self._rows)

    def column(self, name: str) -> np.ndarray:
        """Returns a column of the index, such as 'world' or a drawn parameter: numbers if all values are, else texts."""
        if name not in self._columns:
            raise fs.Error(f"{self.folder}/index.csv: has no column '{name}', only {', '.join(self._columns)}")
        values = [row[self._columns[name]] for row in self._rows]
        for type_ in (np.int64, np.float64):
            try:
                return np.array(values, dtype=object).astype(type_) if name not in ("sample", "sha256") else np.array(values)
            except (ValueError, OverflowError):
                continue
        return np.array(values)

    def select(self, indices: Sequence[int]) -> "SampleDataset":
        """Returns the samples with these indices as a dataset."""
        return self._with_rows([self._rows[i] for i in indices])

    def shard(self, index: int, count: int) -> "SampleDataset":
        """Returns every `count`-th sample, starting with `index`: the share of one of `count` workers."""
        if not 0 <= index < count:
            raise fs.Error(f"shard {index} of {count}: the index must be from 0 to {count - 1}")
        return self._with_rows(self._rows[index::count])

    def _with_rows(self, rows: List[List[str]]) -> "SampleDataset":
        other = object.__new__(type(self))
        other.__dict__.update(self.__dict__, _rows=rows, _open_files={})
        return other

    def __getitem__(self, index: int) -> Dict[str, Any]:
        row = self._rows[index]  # an IndexError ends iteration
        name = row[self._columns["sample"]]
        return self._decoded(name, self.files(index))

    def __iter__(self) -> Iterator[Dict[str, Any]]:
        return (self[i] for i in range(len(self)))

    def files(self, index: int) -> Dict[str, bytes]:
        """Returns the files of a sample as bytes, by extension, such as 'depth.exr'; only of the parts to decode."""
        row = self._rows[index]
        field = {name: row[i] for name, i in self._columns.items()}
        descriptor = self._descriptor(field["tar"])
        offset, size = int(field["offset"]), int(field["bytes"])
        where = f"{self.folder / field['tar']}, sample {field['sample']}"
        if self.verify:
            content = os.pread(descriptor, size, offset)
            if hashlib.sha256(content).hexdigest() != field["sha256"]:
                raise fs.Error(f"{where}: the checksum differs; the file is damaged")
        files = {}
        for name, start, length in self._members(descriptor, offset, size, where):
            extension = name.split(".", 1)[1]
            if self._wanted(extension):
                files[extension] = os.pread(descriptor, length, start)
        return files

    def _wanted(self, extension: str) -> bool:
        part = extension.split(".")[0]
        part = {"image": "images"}.get(part, part)
        return part not in _PARTS or part in self.parts or (part == "coordinate" and self._derives_phase)

    @staticmethod
    def _members(descriptor: int, offset: int, size: int, where: str) -> Iterator[Tuple[str, int, int]]:
        end = offset + size
        while offset < end:
            header = os.pread(descriptor, _BLOCK, offset)
            if len(header) < _BLOCK or header[257:262] != b"ustar":
                raise fs.Error(f"{where}: is truncated or damaged")
            length = int(header[124:135], 8)
            yield header[:100].rstrip(b"\0").decode(), offset + _BLOCK, length
            offset += _BLOCK + -(-length // _BLOCK) * _BLOCK

    def _descriptor(self, tar: str) -> int:
        if tar not in self._open_files:
            if len(self._open_files) >= 16:
                os.close(self._open_files.pop(next(iter(self._open_files))))
            try:
                self._open_files[tar] = os.open(self.folder / tar, os.O_RDONLY | os.O_CLOEXEC)
            except OSError as error:
                raise fs.Error(f"{self.folder / tar}: {error.strerror}") from None
        return self._open_files[tar]

    def __getstate__(self) -> Dict[str, Any]:
        return {**self.__dict__, "_open_files": {}}

    def __del__(self) -> None:
        for descriptor in self.__dict__.get("_open_files", {}).values():
            os.close(descriptor)

    def _decoded(self, name: str, files: Dict[str, bytes]) -> Dict[str, Any]:
        info = json.loads(files.pop("json"))
        sample: Dict[str, Any] = {"name": name, "info": info}
        sample["rig"] = files.pop("rig.yaml").decode()
        sample["patterns"] = files.pop("patterns.yaml").decode()
        rig = fs.parse_rig(sample["rig"], f"{name}.rig.yaml")
        sample["world_from_camera"] = np.array(info.pop("world_from_camera"))
        sample["projector_from_camera"] = rig.projector_from_camera
        sample["camera_matrix"], sample["projector_matrix"] = rig.camera.matrix, rig.projector.matrix
        images = []
        orders: Dict[str, Dict[float, np.ndarray]] = {"column": {}, "row": {}}
        for extension in sorted(files):
            part = extension.split(".")[0]
            image, channels = fs.decode_image(files[extension], f"{name}.{extension}")
            if part == "image":
                images.append(image)
            elif part == "order":  # such as order.columns.16.5.png
                axis, period = extension[len("order.") : -len(".png")].split(".", 1)
                orders[axis[:-1]][float(period)] = _order(image)
            elif part == "thermal":
                sample["thermal"] = image if image.dtype == np.float32 else self._celsius(image)
            else:
                self._add(sample, part, image, channels)
        if images:
            sample["images"] = np.stack(images)
        for axis, by_period in orders.items():
            if by_period:
                sample[f"{axis}_periods"] = np.array(sorted(by_period))
                sample[f"{axis}_order"] = np.stack([by_period[period] for period in sorted(by_period)])
        if self._derives_phase:
            self._add_phase(sample)
        return sample

    @staticmethod
    def _celsius(centikelvin: np.ndarray) -> np.ndarray:
        return (0.01 * centikelvin.astype(np.float64) - 273.15).astype(np.float32)

    @staticmethod
    def _add(sample: Dict[str, Any], part: str, image: np.ndarray, channels: List[str]) -> None:
        planes = {channel: image[..., i] if image.ndim == 3 else image for i, channel in enumerate(channels)}
        if part == "mask":
            sample["mask"] = image
        elif part == "depth":
            sample["depth"] = planes["depth_m"]
        elif part == "temperature":
            sample["temperature"] = planes["temperature_c"]
        elif part == "objects":
            sample["objects"] = image.astype(np.int32)
        elif part == "normals":
            sample["normals"] = np.stack([planes[f"normal.{axis}"] for axis in "xyz"], axis=-1)
        elif part == "coordinate":
            sample["column"], sample["row"] = planes["projector_column"], planes["projector_row"]
        elif part == "sigma":
            names = {"column_sigma_px": "column_sigma", "row_sigma_px": "row_sigma", "depth_sigma_m": "depth_sigma"}
            sample.update({names[channel]: plane for channel, plane in planes.items()})
    def _add_phase(self, sample: Dict[str, Any]) -> None:
        """Absolute phase 2 pi (u + 1/2) / period, as defined in docs/method.md, section 2."""
        patterns = fs.parse_patterns(sample["patterns"])
        for axis in ("column", "row"):
            periods = [p.period_px for p in patterns.patterns if p.coding == "fringe" and p.axis == f"{axis}s"]
            if periods and axis not in sample:
                raise fs.Error(f"{self.folder}: has no part 'coordinate', from which the phase is computed")
            if periods:
                sample[f"{axis}_phase"] = (2 * np.pi * (sample[axis].astype(np.float64) + 0.5) / min(periods)).astype(np.float32)
        if "coordinate" not in self.parts:
            sample.pop("column", None)
            sample.pop("row", None)

    def check(self) -> None:
        """Compares the checksums of all files of the dataset; raises Error naming the first that differs."""
        for line in (self.folder / "SHA256SUMS").read_text(encoding="utf-8").splitlines():
            expected, name = line.split("  ", 1)
            digest = hashlib.sha256()
            try:
                with open(self.folder / name, "rb") as file:
                    while block := file.read(1 << 20):
                        digest.update(block)
            except OSError as error:
                raise fs.Error(f"{self.folder / name}: {error.strerror}") from None
            if digest.hexdigest() != expected:
                raise fs.Error(f"{self.folder / name}: the checksum differs; the file is damaged")
