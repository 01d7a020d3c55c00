#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Renders FOLDER/scene.glb with Blender's Cycles as specified by FOLDER/view.json; installs Blender if it is missing.
set -euo pipefail
folder=$1
if ! dpkg -s blender python3-numpy >/dev/null 2>&1; then
  echo "cycles.sh: installing blender" >&2
  run=(); ((EUID == 0)) || run=(sudo)
  "${run[@]}" apt-get update -qq >&2
  "${run[@]}" apt-get install -y -qq --no-install-recommends blender python3-numpy >&2
fi
blender -b --factory-startup --python-exit-code 3 -P "$(dirname "$0")/cycles.py" -- "$folder" >"$folder/log" 2>&1 ||
  { tail -n 20 "$folder/log" >&2; exit 2; }
test -s "$folder/seconds.json"
