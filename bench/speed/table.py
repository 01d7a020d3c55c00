#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Prints rows of fringeslam-bench as a Markdown table: table.py ROWS.json [ROWS.json ...] > table.md

The rows of the first file that has an id come first; figures of later files appear in the column "again".
"""
import json
import sys


def number(value):
    if value is None:
        return "–"
    return f"{value:.4g}" if abs(value) < 1e4 else f"{value:.0f}"


def figure(row):
    low, high = row["interval_95"]
    text = number(row["value"])
    if low != high:
        text += f" [{number(low)}, {number(high)}]"
    if "scaled" in row:
        text += f"; {number(row['scaled'])}"
    return text


def main():
    if len(sys.argv) < 2:
        sys.exit("table.py: name the files written by fringeslam-bench --json")
    runs = {}
    for name in sys.argv[1:]:
        with open(name, encoding="utf-8") as file:
            for row in json.load(file):
                runs.setdefault(row["id"], []).append(row)
    repeated = any(len(rows) > 1 for rows in runs.values())
    heads = ["id", "figure [95 %]; at yardstick 1", "limit", "yardstick", "holds"] + ["again"] * repeated
    print("| " + " | ".join(heads) + " |\n" + "|---" * len(heads) + "|")
    for id, rows in runs.items():
        first = rows[0]
        sign = "≤" if first["limit_is"] == "most" else "≥"
        yardstick = number(first["yardstick"]) if "yardstick" in first else "–"
        cells = [f"`{id}`", figure(first), f"{sign} {number(first['limit'])} {first['unit']}".strip(), yardstick,
                 "yes" if first["pass"] else "no"]
        if repeated:
            cells.append("; ".join(figure(row) + (" (holds)" if row["pass"] else "") for row in rows[1:]))
        print("| " + " | ".join(cells) + " |")


if __name__ == "__main__":
    main()
