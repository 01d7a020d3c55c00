// SPDX-License-Identifier: Apache-2.0
// All that the page about a run shows, collected from the run's folder.
#pragma once

#include <filesystem>
#include <nlohmann/json_fwd.hpp>

namespace fringeslam::tools {

struct ReportLimits {
  size_t vertices = 120000;          // in the map
  size_t picture_bytes = 5'500'000;  // of all pictures together, encoded as text
  int pictured_views = 60;           // only views with pictures are compared with ground truth, which is slow to read
  int picture_width_px = 640;
};

// Collects the data. The keys are read by page/src. Lengths are in metres unless a key says otherwise; unknown values
// are null.
//
//   version, name, seed, has_truth
//   rig       name, near_m, far_m, width_px, height_px, corners: slopes (x/z, y/z) of the image's four corners
//   summary   the figures in the page's header
//   views     each view's entry of frames.json, and time_s, pose, true_pose: {position, quaternion: x y z w} of
//             map_from_camera, position_error_mm, sigma_mm: 10, 50 and 90 %, score: its entry of score.json,
//             pictures (view_pictures.h), landmarks: outlines x y x y … in px, recognised
//   motions   the pairs of score.json; without ground truth only the estimates
//   pictures  near_m, far_m, error_limit_mm, cold_c, warm_c: ends of the scales; every: every n-th view has pictures;
//             width_px
//   map       vertices, triangles: their numbers; whole_vertices, whole_triangles: their numbers before thinning;
//             cell_mm: grid cell of the thinning; origin, step_m: position = origin + step_m * (x, y, z); white: grey
//             value of white; x, y, z, grey, error, indices: packed (packing.h), error from 1 to 255 as levels() of
//             ±error_limit_mm, 0 unknown; null without a map
//   warm_objects  the entries of victims.json; null without a thermal camera
//
// Throws Error if the folder is not a run, or a part of it is missing or damaged.
nlohmann::ordered_json report_data(const std::filesystem::path& run, const ReportLimits& limits = {});

}  // namespace fringeslam::tools
