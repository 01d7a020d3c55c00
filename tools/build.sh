# SPDX-License-Identifier: Apache-2.0
# build PRESET TARGET…: configures and builds, in few words; on failure shows the compiler's. To be sourced
# from the project's root.

build() {
  local preset=$1 log
  shift
  log=$(mktemp)
  echo "build: $* ($preset)"
  # A compile takes up to 1.5 GiB.
  local memory_jobs jobs
  memory_jobs=$(awk '/MemAvailable/ {print int($2 / 1500000)}' /proc/meminfo)
  jobs=$(nproc)
  ((memory_jobs < jobs)) && jobs=$((memory_jobs > 0 ? memory_jobs : 1))
  if ! { cmake --preset "$preset" && cmake --build --preset "$preset" --target "$@" --parallel "$jobs"; } >"$log" 2>&1; then
    echo "build: failed; the end of what the tools said:" >&2
    grep -E -A12 'error|Error|FAILED' "$log" | head -n 60 >&2 || true
    tail -n 5 "$log" >&2
    rm -f "$log"
    return 1
  fi
  rm -f "$log"
}
