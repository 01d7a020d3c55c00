#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""Plots the drift along the tour of `mission`, with loop closure and without, from what `scale.view` prints.

tools/bench --only scale.view 2> view.log; /usr/bin/python3 bench/speed/drift.py view.log drift.png
"""
import re
import sys

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402

# views, path m, keyframes, links, MiB, ms/view, (cpu), drift mm twice, ...
ROW = re.compile(r"\s+(\d+)\s+([\d.]+)\s+\d+\s+\d+\s+\d+\s+[\d.]+\s+[\d.]+\s+([\d.]+)\s+([\d.]+)\s")


def main(log, picture):
    rows = [match.groups() for match in map(ROW.match, open(log, encoding="utf-8")) if match]
    if not rows:
        sys.exit(f"{log}: has no rows of scale.view")
    path_m = [float(row[1]) for row in rows]
    figure, axes = plt.subplots(figsize=(8, 4))
    axes.semilogy(path_m, [float(row[3]) for row in rows], "o-", color="tab:orange", label="without loop closure")
    axes.semilogy(path_m, [float(row[2]) for row in rows], "o-", color="tab:blue", label="with loop closure")
    axes.set(xlabel="path, m", ylabel="distance from the true position, mm", xlim=(0, None))
    axes.grid(True, which="both", alpha=0.3)
    axes.legend()
    figure.tight_layout()
    figure.savefig(picture, dpi=110, metadata={"Software": None})


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(*sys.argv[1:])
