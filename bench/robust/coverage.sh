#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Measures which share of the lines of core, sim, hw and tools the tests execute: coverage.sh prints a JSON object of percentages on
# standard output, everything else on standard error. The files with the most lines that are not executed are in
# build/coverage/lines.html.
set -euo pipefail
cd "$(dirname "$0")/../.."
source tools/build.sh
{
  tools/setup --coverage
  PRESET=coverage build all
  find build/coverage -name '*.gcda' -delete
  ctest --preset coverage --parallel 2
} >&2
folders=(core sim hw tools)
filters=()
for folder in "${folders[@]}"; do filters+=(--filter "$folder/"); done
gcovr --root . "${filters[@]}" --json build/coverage/lines.json --html build/coverage/lines.html build/coverage >&2
python3 - build/coverage/lines.json "${folders[@]}" <<'END'
import json
import sys

report, folders = sys.argv[1], sys.argv[2:]
lines = {folder: [] for folder in folders}
for file in json.load(open(report, encoding="utf-8"))["files"]:
    lines[file["file"].split("/")[0]] += [line["count"] > 0 for line in file["lines"] if not line.get("gcovr/noncode")]
print(json.dumps({folder: {"lines": len(counts), "percent": 100 * sum(counts) / max(1, len(counts))}
                  for folder, counts in lines.items()}))
END
