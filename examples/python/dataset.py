# SPDX-License-Identifier: Apache-2.0
"""Reads a dataset of `fringeslam dataset`, as a torch.utils.data.DataLoader would: dataset.py FOLDER."""
import sys

import fringeslam as fs
import numpy as np

train = fs.SampleDataset(sys.argv[1], split="train", parts=["images", "depth", "mask"])
print(f"{len(train)} samples of {len(set(train.column('world')))} worlds")
for start in range(0, len(train), 2):  # torch: DataLoader(train, batch_size=2, num_workers=4)
    samples = [train[i] for i in range(start, min(start + 2, len(train)))]
    images = np.stack([sample["images"] for sample in samples])  # (batch, patterns, height, width)
    lit = np.stack([sample["mask"] & 7 for sample in samples]) == 3  # on a surface, in the projector's light
    depth_m = np.stack([sample["depth"] for sample in samples])
    print(images.shape, images.dtype, f"median depth of lit pixels {np.median(depth_m[lit]):.3f} m")
    assert np.isfinite(depth_m[lit]).all()
