# SPDX-License-Identifier: Apache-2.0
# build TARGET…: configures and builds the release preset, or with PRESET=NAME another one. Prints the plan and the
# progress; on failure prints the compiler's messages. To be sourced from the project's root.

build() {
  local preset=${PRESET:-release} log jobs memory_jobs plan status=0
  log=$(mktemp)
  cmake --preset "$preset" >"$log" 2>&1 || status=$?
  if ((status == 0)); then
    plan=$(ninja -C "build/$preset" -n "$@" 2>/dev/null | sed -n 's/^\[[0-9]*\/\([0-9]*\)\].*/\1/p' | tail -n 1)
    # A compile takes up to 1.5 GiB.
    memory_jobs=$(awk '/MemAvailable/ {print int($2 / 1500000)}' /proc/meminfo)
    jobs=$(nproc)
    ((memory_jobs < jobs)) && jobs=$((memory_jobs > 0 ? memory_jobs : 1))
    if [[ -n $plan ]]; then
      echo "build: $plan steps with $jobs jobs, about $((plan * 7 / jobs / 60 + 1)) min (build/$preset)"
      # A condition, because the shell may end at the first failing command.
      if ! NINJA_STATUS='[%f/%t] ' ninja -C "build/$preset" -j "$jobs" "$@" 2>&1 | tee "$log" |
        awk -v terminal="$([[ -t 1 ]] && echo 1)" '
          match($0, /^\[[0-9]+\/[0-9]+\]/) {
            split(substr($0, 2, RLENGTH - 2), n, "/")
            percent = int(100 * n[1] / n[2])
            if (terminal) { printf "\rbuild: %3d %%  (%d of %d)", percent, n[1], n[2]; fflush() }
            else if (percent >= next_percent) { printf "build: %d %%\n", percent; next_percent = percent - percent % 10 + 10; fflush() }
          }
          END { if (terminal && NR) print "" }'; then
        status=${PIPESTATUS[0]}
      fi
    fi
  fi
  if ((status != 0)); then
    echo "build: failed; the end of the tools' output:" >&2
    grep -E -A12 'error|Error|FAILED' "$log" | head -n 60 >&2 || true
    tail -n 5 "$log" >&2
  fi
  rm -f "$log"
  return "$status"
}
