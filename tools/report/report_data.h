// SPDX-License-Identifier: Apache-2.0
// All that the page about a run shows, collected from the run's folder.
#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>

namespace fringeslam::tools {

struct ReportLimits {
  size_t vertices = 120000;          // of the map
  size_t picture_bytes = 5'500'000;  // of all pictures, as text
  int pictured_views = 60;           // and no more are compared with their truth: reading that takes the time
  int picture_width_px = 640;
};

// The keys are read by page/src. Lengths are in metres unless a key's name says otherwise; what is unknown is null.
//
//   version, name, seed, has_truth
//   rig       name, near_m, far_m, width_px, height_px, corners: slopes (x/z, y/z) of the image's four corners
//   summary   the figures of the page's head
//   views     what frames.json says of each, and time_s, pose, true_pose: {position, quaternion: x y z w} of
//             map_from_camera, position_error_mm, sigma_mm: 10, 50 and 90 %, score: its entry of score.json,
//             pictures (view_pictures.h), landmarks: outlines x y x y … in px, recognised
//   motions   pairs of score.json; of a run without truth the estimates alone
//   pictures  near_m, far_m, error_limit_mm, cold_c, warm_c: ends of the scales; every: pictures are of every so
//   manieth view; width_px map       vertices, triangles: numbers of both; whole_vertices, whole_triangles, cell_mm:
//   before thinning, and its
//             grid; origin, step_m: position = origin + step_m * (x, y, z); x, y, z, grey, error, indices: packed
//             (packing.h), error from 1 to 255 as levels() of ±error_limit_mm, 0 unknown; null without a map
//   warm_things  what victims.json says of each; null without a thermal camera
//
// Throws Error when the folder is not a run, or something in it is missing or damaged.
nlohmann::ordered_json report_data(const std::filesystem::path& run, const ReportLimits& limits = {});

}  // namespace fringeslam::tools
