# SPDX-License-Identifier: Apache-2.0
"""Pictures of indirect light and its decoding.

indirect_pictures.py groove OUT.png             depth error in a groove of 60 degrees: three periods, micro phase shifting
indirect_pictures.py waxbowl CAPTURES OUT.png   projector columns of a real wax bowl: ours, the authors', difference
"""
import pathlib
import sys

import matplotlib

matplotlib.use("Agg")
import fringeslam as fs
import matplotlib.pyplot as plt
import numpy as np

ROOT = pathlib.Path(__file__).resolve().parents[2]


def panels(titles, images, low, high, label, colors, out):
    """Writes images beside each other, each with its own scale."""
    figure, axes = plt.subplots(1, len(images), figsize=(4.4 * len(images), 4), layout="constrained")
    for i, (axis, title, image) in enumerate(zip(axes, titles, images)):
        shown = axis.imshow(image, colors[i], vmin=low[i], vmax=high[i])
        axis.set_title(title, fontsize=9)
        axis.set_xticks([]), axis.set_yticks([]), axis.set_facecolor("black")
        figure.colorbar(shown, ax=axis, shrink=0.7, label=label[i])
    figure.savefig(out, dpi=100, metadata={"Software": None})


def groove(out):
    """Depth error, mm, of the same view with three kinds of patterns."""
    images, titles = [], []
    nine = "{axis: columns, steps: 3, periods_px: [1040, 131, 16.5]}"
    for name, patterns, options in (
        ("three periods, all pixels kept", nine, {"max_order_residual_sigma": 1e6}),
        ("three periods", nine, {}),
        ("micro phase shifting", None, {}),
    ):
        scene = fs.load_scene(str(ROOT / "scenes/groove_60/scene.yaml"), changes={"patterns": patterns} if patterns else {})
        rig = fs.VirtualRig(scene)
        view = rig.simulate()
        frame = fs.reconstruct(fs.decode(view.stack, rig.model, options), rig.model)
        error_mm = 1e3 * (np.array(frame.depth_m) - np.array(view.truth.depth_m))
        lit = np.isfinite(np.array(view.truth.projector_column))
        measured = np.isfinite(error_mm[lit])
        off = np.abs(error_mm[lit][measured]) > 0.3
        titles.append(f"{name} ({len(view.stack.images)})\n{100 * measured.mean():.1f} % of the lit pixels with depth,\n"
                      f"{100 * off.mean():.2g} % of them off by more than 0.3 mm")
        images.append(error_mm)
    panels(titles, images, [-0.3] * 3, [0.3] * 3, ["depth error, mm"] * 3, ["RdBu"] * 3, out)


def waxbowl(captures, out):
    """Projector columns, px; the authors' count from 1."""
    folder = pathlib.Path(captures) / "waxbowl"
    rig = fs.ImportedRig(folder, ROOT / "bench/accuracy/captures/waxbowl.yaml")
    ours = np.array(fs.decode(next(iter(rig)), rig.model, {"unwrapping": "micro"}).coordinate_px)
    raw = plt.imread(folder / "column_x16.png")
    theirs = np.where(raw > 0, raw * 65535 / 16 - 1, np.nan)
    titles = ["ours", "the authors', after their median filter", "ours minus theirs"]
    panels(titles, [ours, theirs, ours - theirs], [495, 495, -1], [945, 945, 1], ["projector column, px"] * 3,
           ["viridis", "viridis", "RdBu"], out)


if __name__ == "__main__":
    {"groove": groove, "waxbowl": waxbowl}[sys.argv[1]](*sys.argv[2:])
