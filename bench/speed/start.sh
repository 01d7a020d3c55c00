#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Measures the time from scratch. Prints seconds on standard output, everything else on standard error.
#   start.sh build   configure and build the Release program from a fresh clone, without compiler cache
#   start.sh again   the same, then one changed .cpp of core, built to the linked program; the time of the second build
#   start.sh test    after tools/run in a fresh clone: tools/test, built and run, without compiler cache
#   start.sh all     build, again and test one after the other in one fresh clone; prints the three times
#   start.sh bare    a minimal Debian 12 (debootstrap, as root), then git clone and tools/run in it; measured
#                    from the clone to the end of tools/run
#   start.sh deb     a minimal Debian 12, then `apt install` of the packages of build/release, and the first run
set -euo pipefail
root=$(cd "$(dirname "$0")/../.." && pwd)
work=$(mktemp -d /var/tmp/fringeslam-start.XXXXXX)
mounted=()
clean() {
  for point in "${mounted[@]}"; do umount "$point" 2>/dev/null || umount -l "$point" || true; done
  rm -rf --one-file-system "$work"
}
trap clean EXIT

export CCACHE_DISABLE=1

# timed COMMAND…: sets `seconds` to the time that the command took; its output goes to the log.
timed() {
  local start=$SECONDS
  "$@" >"$work/log" 2>&1 || { tail -n 40 "$work/log" >&2; exit 2; }
  seconds=$((SECONDS - start))
}
compile() { ninja -C build/release fringeslam; }
build() { cmake --preset release && compile; }
clone() {
  git clone -q "$root" "$work/clone" >&2
  cd "$work/clone"
}
# A change that compiles one file of core again, and links the program.
change() { echo "// changed" >>core/mapper/mapper.cpp; }

# fresh_system PACKAGES: creates a minimal Debian 12 in $system.
fresh_system() {
  if ((EUID != 0)); then echo "start.sh: creating a fresh system needs root" >&2; exit 2; fi
  command -v debootstrap >/dev/null || apt-get install -y -qq --no-install-recommends debootstrap >&2
  system=$work/system
  mirror=$(apt-get indextargets --format '$(SITE)' 'Created-By: Packages' | head -n 1)
  echo "start.sh: creating a fresh Debian 12 from the configured mirror" >&2
  debootstrap --variant=minbase --include="$1",ca-certificates bookworm "$system" "$mirror" >"$work/log" 2>&1 ||
    { tail -n 20 "$work/log" >&2; exit 2; }
  # This machine's network configuration.
  cp -L /etc/resolv.conf "$system/etc/resolv.conf"
  cp -rL /etc/apt/. "$system/etc/apt/"
  cp -L /etc/hosts "$system/etc/hosts"
  cp -rL /usr/local/share/ca-certificates/. "$system/usr/local/share/ca-certificates/" 2>/dev/null || true
  cp -L /etc/ssl/certs/ca-certificates.crt "$system/etc/ssl/certs/ca-certificates.crt" 2>/dev/null || true
  for point in proc dev sys; do
    mount --bind "/$point" "$system/$point"
    mounted+=("$system/$point")
  done
}
# in_system COMMAND: runs a shell command in it.
in_system() {
  env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/root LC_ALL=C.UTF-8 DEBIAN_FRONTEND=noninteractive \
    ${http_proxy:+http_proxy="$http_proxy"} ${https_proxy:+https_proxy="$https_proxy"} \
    chroot "$system" sh -c "$1" >&2 || exit 2
}

case "${1:-}" in
  build)
    clone
    timed build
    echo "$seconds"
    ;;
  again)
    clone
    timed build
    change
    timed compile
    echo "$seconds"
    ;;
  test)
    clone
    timed tools/run
    timed tools/test
    echo "$seconds"
    ;;
  all)
    clone
    timed build
    echo "build $seconds"
    change
    timed compile
    echo "again $seconds"
    git checkout -q core/mapper/mapper.cpp
    timed tools/run
    timed tools/test
    echo "test $seconds"
    ;;
  bare)
    fresh_system git
    git clone -q --bare "$root" "$system/srv/fringeslam.git" >&2
    start=$SECONDS
    in_system 'git clone -q /srv/fringeslam.git /srv/fringeslam && cd /srv/fringeslam && tools/run'
    echo $((SECONDS - start))
    ;;
  deb)
    fresh_system apt
    (cd "$root/build/release" && cpack -B "$work/packages" >&2)
    cp "$work"/packages/*.deb "$system/srv"
    start=$SECONDS
    in_system 'apt-get update -qq && apt-get install -y -qq --no-install-recommends /srv/libfringeslam0_*.deb \
      /srv/fringeslam_*.deb >/dev/null && cd /root && fringeslam run boxes_and_foam'
    echo $((SECONDS - start))
    ;;
  *)
    echo "start.sh: specify build, again, test, all, bare or deb" >&2
    exit 2
    ;;
esac
