#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""Prints the standings in a leaderboard's folder as Markdown: leaderboard_table.py FOLDER."""
import itertools
import math
import sys

import fringeslam as fs


def number(value, factor=1.0):
    return "–" if math.isnan(value) else f"{factor * value:.3g}"


def quantity(values, factor=1.0):
    median, low, high = (number(value, factor) for value in values)
    return median if median == "–" else f"{median} [{low}, {high}]"


for suite, group in itertools.groupby(fs.standings(fs.read_results(sys.argv[1])), lambda s: s.suite):
    print(f"**{suite}**\n\n| system | datasets | tracked | ATE, mm | RPE, mm | F-score | s per view |\n|---|---|---|---|---|---|---|")
    for s in group:
        print(f"| {s.system} | {s.scored} of {s.datasets} | {100 * s.tracked:.0f} % | {quantity(s.ate_m, 1e3)} | "
              f"{quantity(s.rpe_m, 1e3)} | {quantity(s.f_score)} | {number(s.seconds_per_view[0])} |")
    print()
