// SPDX-License-Identifier: Apache-2.0
// Registration of two full frames from no start, beside PCL's ICP.
#include <cstdio>

#include "bench/frame_pairs.h"
#include "bench/row.h"
#include "bench/speed/turns.h"
#include "core/map/engines.h"

namespace fringeslam::bench {

namespace {

std::vector<Row> register_rows(const Context& context) {
  const FramePair pair = rendered_frames("rubble_under_dust", 3, random_motion(2, 0.02, 1, 3));
  const Pinhole& camera = pair.rig.camera;
  IcpOptions options;
  options.max_distance_m = 0.05;
  const auto times = take_turns({[&] { register_frames(pair.target, pair.source, camera, {}); },
                                 [&] { register_by("point_to_plane", pair.target, pair.source, camera, {}, options); },
                                 [&] { register_by("pcl_icp", pair.target, pair.source, camera, {}, options, 1); }},
                                context.quick ? 1 : 5);
  std::fprintf(stderr, "  cold %.1f ms, from no motion %.1f ms, PCL's ICP %.0f ms\n", 1e3 * median(times[0]),
               1e3 * median(times[1]), 1e3 * median(times[2]));
  return {median_row("speed.register", ratios(times[2], times[0]), "x", 50, Limit::least)};
}

}  // namespace

std::vector<Item> registration_speed_items() {
  return {{{"speed.register"}, "two full frames from no start, against PCL's ICP", register_rows}};
}

}  // namespace fringeslam::bench
