#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Runs all systems that Debian 12 provides on all suites: leaderboard.sh OUT. About three hours on two cores; what is finished
# is kept, and the same command continues. Needs python3-open3d, python3-opencv and a build of this project.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
build=${FRINGESLAM_BUILD:-$here/../../build/release}
out=${1:?usage: leaderboard.sh OUT}
suites=(stills smoke repeating arenas moving loop)

evaluate() {  # NAME FORMAT COMMAND
  "$build/tools/fringeslam" evaluate "${suites[@]}" --out "$out" --name "$1" --format "$2" --with "$3" >/dev/null
}
ours="'$build/tools/fringeslam' run {dataset} --out {out} --no-report --quiet"

evaluate fringeslam fringes "$ours"
# As in the papers: landmarks in every view, no prediction, the thesis's ICP.
evaluate fringeslam-papers fringes \
  "$ours --set tracking.predict=false --set tracking.landmarks=every_frame --set tracking.engine=zhang"
# One thread: if other processes keep a processor busy, Open3D's threads wait for each other and fusion takes 20 times as long.
for method in gicp point_to_plane colored_icp hybrid; do
  evaluate "open3d-$method" tum-rgbd "OMP_NUM_THREADS=1 /usr/bin/python3 -B '$here/open3d_rgbd.py' {dataset} {out} --method $method"
done
for method in icp rgbd_icp rgbd; do
  evaluate "opencv-$method" tum-rgbd "/usr/bin/python3 -B '$here/opencv_rgbd.py' {dataset} {out} --method $method"
done
for method in icp gicp ndt; do
  evaluate "pcl-$method" tum-rgbd "'$build/bench/fringeslam-pcl-odometry' {dataset} {out} $method"
done
