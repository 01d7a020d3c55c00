// SPDX-License-Identifier: Apache-2.0
#include "tools/run_folder.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <nlohmann/json.hpp>
#include <numbers>
#include <opencv2/imgproc.hpp>
#include <sstream>

#include "core/io/files.h"
#include "core/io/glb.h"
#include "core/io/json_text.h"
#include "core/io/ply_writer.h"
#include "core/rig/dataset.h"
#include "core/rig/rig_file.h"
#include "tools/landmark_files.h"

namespace fringeslam::tools {

namespace fs = std::filesystem;

namespace {

cv::Mat1f depth_of(const Frame& frame) {
  cv::Mat1f depth;
  cv::extractChannel(frame.points_m, depth, 2);
  return depth;
}

// Returns the index of the first image with the finest fringes; 0 if there are none.
int finest_image(const PatternSequence& sequence) {
  size_t finest = 0;
  double period_px = std::numeric_limits<double>::max();
  for (size_t i = 0; i < sequence.patterns.size(); ++i) {
    const Pattern& pattern = sequence.patterns[i];
    if (pattern.coding != Coding::fringe || pattern.period_px >= period_px) continue;
    finest = i;
    period_px = pattern.period_px;
  }
  return static_cast<int>(finest);
}

constexpr double kErrorLimitM = 0.3e-3;  // depth error at the ends of the colour scale

std::string fixed(double value, int digits) {
  char buffer[64];
  std::snprintf(buffer, sizeof buffer, "%.*f", digits, value);
  return buffer;
}

// Returns the text lines of the overview's score panel.
std::vector<std::string> summary(const RunScore& score) {
  std::vector<std::string> lines = {
      score.name + ", seed " + std::to_string(score.seed),
      std::to_string(score.tracked) + " of " + std::to_string(score.stacks) + " views tracked", "",
      "motion error      mm        deg    / bound"};
  const auto motion = [&](const std::string& label, double error_m, double error_rad, double over_bound) {
    lines.push_back(label + "            " + fixed(error_m * 1e3, 4) + "    " +
                    fixed(error_rad * 180 / std::numbers::pi, 5) + "    " + fixed(over_bound, 2));
  };
  const auto depth = [&](const std::string& label, double median_m, double p99_m) {
    lines.push_back(label + "               " + fixed(median_m * 1e3, 4) + "    " + fixed(p99_m * 1e3, 4));
  };
  // Long runs do not fit line by line.
  constexpr size_t kMostLines = 6;
  const bool all = score.frames.size() <= kMostLines;
  const auto middle = [](const auto& list, const auto& value_of) {
    std::vector<double> values;
    for (const auto& entry : list) values.push_back(value_of(entry));
    return median_of(std::move(values));
  };
  if (all) {
    for (const PairScore& pair : score.pairs)
      motion(std::to_string(pair.previous) + " -> " + std::to_string(pair.current), pair.motion.translation_error_m,
             pair.motion.rotation_error_rad, pair.error_over_bound);
  } else {
    motion("median", middle(score.pairs, [](const PairScore& p) { return p.motion.translation_error_m; }),
           middle(score.pairs, [](const PairScore& p) { return p.motion.rotation_error_rad; }),
           middle(score.pairs, [](const PairScore& p) { return p.error_over_bound; }));
  }
  lines.push_back("");
  lines.push_back("depth error mm     median     99 %");
  if (all) {
    for (const FrameScore& frame : score.frames)
      depth("view " + std::to_string(frame.index), frame.depth.median_m, frame.depth.p99_m);
  } else {
    depth("median", middle(score.frames, [](const FrameScore& f) { return f.depth.median_m; }),
          middle(score.frames, [](const FrameScore& f) { return f.depth.p99_m; }));
  }
  if (!score.trajectory) return lines;
  lines.push_back("");
  lines.push_back("ATE " + fixed(score.trajectory->ate_rmse_m * 1e3, 4) + " mm");
  return lines;
}

// Returns the 10, 50 and 90 % quantiles of every 7th pixel.
nlohmann::ordered_json sigmas_mm(const cv::Mat1f& sigma_m) {
  std::vector<double> sigmas;
  for (int row = 0; row < sigma_m.rows; ++row) {
    for (int col = row % 7; col < sigma_m.cols; col += 7) {
      if (!std::isnan(sigma_m(row, col))) sigmas.push_back(1e3 * sigma_m(row, col));
    }
  }
  if (sigmas.empty()) return nullptr;
  return {quantile_of(sigmas, 0.1), quantile_of(sigmas, 0.5), quantile_of(sigmas, 0.9)};
}

cv::Mat3b phase_picture(const DecodedStack& decoded) {
  return false_colour(decoded.wrapped_phase, -std::numbers::pi, std::numbers::pi);
}

// Returns a pose that explains an ambiguous view, relative to the reference keyframe.
nlohmann::ordered_json alternative_json(const Pose& reference_from_view, double log_likelihood) {
  const SixDof six = six_dof(reference_from_view);
  const Eigen::Vector3d &shift = six.translation_mm, &angles = six.angles_deg;
  return {{"translation_mm", {shift.x(), shift.y(), shift.z()}},
          {"angles_deg", {angles.x(), angles.y(), angles.z()}},
          {"log_likelihood", log_likelihood}};
}

// Returns the entry of a view in frames.json.
nlohmann::ordered_json frame_json(const FrameResult& result, const cv::Mat1f& depth) {
  const Frame& frame = result.frame;
  const MotionEstimate& motion = result.registration.motion;
  const IcpResult& icp = result.registration.icp;
  nlohmann::ordered_json entry = {
      {"index", frame.index},
      {"tracking", to_string(result.tracking)},
      {"images", result.images},
      {"unwrapping", result.decoded.unwrapping ? to_string(*result.decoded.unwrapping) : ""},
      {"valid_pixels", cv::countNonZero(depth == depth)},
      {"sigma_mm", sigmas_mm(frame.sigma_m)},
      {"keypoints_detected", result.keypoints.detected},
      {"keypoints_with_depth", result.keypoints.keypoints.size()},
      {"matches", result.matches.size()},
      {"motion", result.matches.empty() ? "" : to_string(motion.status)},
      {"inliers", motion.inliers},
      {"rank", motion.rank},
      {"icp_iterations", icp.iterations},
      {"icp_pairs", icp.pairs},
      {"icp_overlap", icp.overlap},
      {"icp_consistency", icp.consistency},
      {"icp_rms_sigma", icp.rms_sigma}};
  for (const auto& directions : {motion.undetermined, result.registration.undetermined}) {
    for (const UnobservableDirection& free : directions) entry["undetermined"].push_back(to_string(free));
  }
  if (result.tracking == Tracking::ambiguous) {
    entry["alternatives"].push_back(alternative_json(result.registration.earlier_from_current, 0));
    for (const AlternativePose& other : result.registration.alternatives)
      entry["alternatives"].push_back(alternative_json(other.target_from_source, other.log_likelihood));
  }
  if (result.motion_untested) {
    entry["motion_untested"] = true;
  } else if (result.motion && result.motion->converged) {
    const CameraMotion& during = result.motion->motion;
    const auto sigma = result.motion->covariance.diagonal().cwiseSqrt();
    entry["speed_m_s"] = during.velocity_m_s.norm();
    entry["turn_rad_s"] = during.angular_rad_s.norm();
    entry["speed_sigma_m_s"] = sigma.segment<3>(3).maxCoeff();
    entry["turn_sigma_rad_s"] = sigma.segment<3>(0).maxCoeff();
  } else if (result.motion) {
    entry["motion_unknown"] = true;
  }
  if (result.relocalized) entry["relocalized"] = true;
  if (result.reference >= 0) entry["reference"] = result.reference;
  if (result.keyframe >= 0) entry["keyframe"] = result.keyframe;
  if (result.loops > 0) entry["loops"] = result.loops;
  if (result.corrected) entry["corrected"] = true;
  return entry;
}

std::function<void()> mesh_writer(const fs::path& folder, const Mesh& mesh) {
  return [folder, mesh] {
    fs::create_directories(folder);
    write_text(folder / "mesh.ply", to_ply(mesh, "camera"));
  };
}

// Returns a task that writes the images of a view.
std::function<void()> image_writer(const fs::path& folder, const FrameResult& result, const ThermalView& thermal) {
  // Images share their pixels when copied.
  return [folder, frame = result.frame, decoded = result.decoded, thermal] {
    fs::create_directories(folder);
    const cv::Mat1f depth = depth_of(frame);
    // The coordinate is written only where a depth was kept.
    cv::Mat1f column = decoded.coordinate_px.clone();
    column.setTo(std::nan(""), depth != depth);
    write_exr(folder / "depth.exr", {{"depth_m", depth}, {"sigma_m", frame.sigma_m}, {"projector_column", column}},
              ExrCompression::none);
    write_png(folder / "texture.png", frame.texture);
    write_png(folder / "depth.png", frame.depth_image);
    write_png(folder / "phase.png", phase_picture(decoded));
    if (thermal.temperature_c.empty()) return;
    write_exr(folder / "temperature.exr", {{"Y", thermal.temperature_c}});
    write_png(folder / "temperature.png", warm_picture(frame.texture, thermal));
  };
}

}  // namespace

RunFolder::RunFolder(fs::path folder, const RigModel& rig, const PatternSequence& sequence)
    : folder_(std::move(folder)), rig_(rig), finest_image_(finest_image(sequence)) {
  write_text(folder_ / "rig.yaml", to_yaml(rig));
  write_text(folder_ / "patterns.yaml", to_yaml(sequence));
}

fs::path RunFolder::frame_folder(int index) const { return folder_ / "frames" / stack_name(index); }

void RunFolder::add(const FringeStack& stack, const FrameResult& result, const ThermalView& thermal,
                    const KeyframeMap& map) {
  writing_.add(image_writer(frame_folder(stack.index), result, thermal));
  const cv::Mat1f depth = depth_of(result.frame);
  frames_.push_back(frame_json(result, depth));
  const bool tracked = has_pose(result.tracking);
  const MotionEstimate& motion = result.registration.motion;
  landmarks_.push_back(landmarks_json(stack.index, result, thermal));
  (tracked ? tracked_ : lost_).push_back(stack.index);
  const bool first_matches = tracked && !result.matches.empty() && matches_.empty();
  if (fringe_.empty() || first_matches) {
    shown_ = stack.index;
    fringe_ = grey_picture(stack.images[std::min(static_cast<size_t>(finest_image_), stack.images.size() - 1)],
                           0.8 * rig_.sensor.max_dn());
    phase_ = phase_picture(result.decoded);
    const auto [near_m, far_m] = content_limits(depth);
    depth_ = false_colour(depth, near_m, far_m);
    depth_title_ = "depth, " + fixed(1e3 * near_m, 0) + " to " + fixed(1e3 * far_m, 0) + " mm, near = blue";
    const double largest_sigma_m = content_limits(result.frame.sigma_m).second;
    sigma_ = false_colour(result.frame.sigma_m, 0, largest_sigma_m);
    sigma_title_ = "depth sigma, 0 to " + fixed(1e3 * largest_sigma_m, 2) + " mm";
    shaded_ = shaded_picture(result.frame.normals);
    texture_ = grey_picture(result.frame.texture, 0.8 * 255);
    const int valid = static_cast<int>(std::count_if(depth.begin(), depth.end(), [](float z) { return z == z; }));
    std::vector<float> sigmas;
    for (const float sigma : result.frame.sigma_m) {
      if (sigma == sigma) sigmas.push_back(sigma);
    }
    const auto middle = sigmas.begin() + static_cast<std::ptrdiff_t>(sigmas.size() / 2);
    std::nth_element(sigmas.begin(), middle, sigmas.end());
    facts_ = {"no ground truth, no score", "",
              std::to_string(valid) + " pixels with depth (" +
                  fixed(100.0 * valid / static_cast<double>(depth.total()), 1) + " %)",
              "depth " + fixed(1e3 * near_m, 1) + " to " + fixed(1e3 * far_m, 1) + " mm (1 to 99 %)"};
    if (!sigmas.empty()) facts_.push_back("median sigma " + fixed(1e3 * static_cast<double>(*middle), 3) + " mm");
  }
  if (first_matches) {
    const Keyframe& reference = map.keyframes()[static_cast<size_t>(result.reference)];
    matches_ = match_picture(reference, result);
    match_title_ = "matches, view " + std::to_string(reference.index) + " to " + std::to_string(stack.index) + ": " +
                   std::to_string(motion.inliers) + " of " + std::to_string(result.matches.size()) + " are inliers";
  }
}

// Replaces the entry and the images of a view that was added without a pose.
void RunFolder::replace(const FrameResult& recovered) {
  const int index = recovered.frame.index;
  const auto entry = std::find_if(frames_.begin(), frames_.end(), [&](const auto& e) { return e["index"] == index; });
  if (entry == frames_.end()) return;
  *entry = frame_json(recovered, depth_of(recovered.frame));
  (*entry)["recovered"] = true;
  std::erase(lost_, index);
  tracked_.insert(std::lower_bound(tracked_.begin(), tracked_.end(), index), index);
  writing_.wait();  // for the images that these replace
  writing_.add(image_writer(frame_folder(index), recovered, {}));
}

void RunFolder::add_mesh(const Mesh& mesh, int index) { writing_.add(mesh_writer(frame_folder(index), mesh)); }

void RunFolder::replace_mesh(const Mesh& mesh, int index) {
  writing_.wait();
  writing_.add(mesh_writer(frame_folder(index), mesh));
}

void RunFolder::add_image_poses(const ImageTrajectory& images, const Mapper& mapper) const {
  nlohmann::ordered_json list = nlohmann::ordered_json::array();
  for (const ImageOfRun& image : images.images()) {
    nlohmann::ordered_json entry = {
        {"stack", image.stack}, {"image", image.image}, {"timestamp_s", image.timestamp_s}, {"tracked", image.tracked}};
    if (image.tracked) {
      const auto sigma = image.covariance.diagonal().cwiseSqrt();
      entry["sigma_rad"] = sigma.head<3>().maxCoeff();
      entry["sigma_m"] = sigma.tail<3>().maxCoeff();
    }
    if (!image.as_expected) {
      entry["unexpected"] = true;
      if (image.shown)
        entry["shown"] = {{"coding", to_string(image.shown->coding)},
                          {"axis", to_string(image.shown->axis)},
                          {"period_px", image.shown->period_px},
                          {"shift_rad", image.shown->shift_rad}};
    }
    list.push_back(std::move(entry));
  }
  write_text(folder_ / "images.json", json_text(list, 1) + "\n");
  write_text(folder_ / "images.tum", to_tum(images.trajectory(mapper)));
}

void RunFolder::add_warm_objects(const std::vector<WarmObject>& things) const {
  write_text(folder_ / "victims.json", json_text(to_json(things), 1) + "\n");
}

void RunFolder::finish(const Trajectory& trajectory) {
  trajectory_ = trajectory;
  std::string lost;
  for (const int index : lost_) lost += (lost.empty() ? "# lost: stacks " : ", ") + std::to_string(index);
  write_text(folder_ / "trajectory.tum", (lost.empty() ? lost : lost + "\n") + to_tum(trajectory_));
  write_text(folder_ / "frames.json", json_text(frames_, 1) + "\n");
  write_text(folder_ / "landmarks.json", json_text(landmarks_, 1) + "\n");
  landmarks_ = nullptr;  // hundreds of megabytes after a long run
  writing_.finish();
}

void RunFolder::write_cloud(const KeyframeMap& map, const CloudOptions& options, const TileProgress& progress) {
  constexpr size_t kMostShown = 2'000'000;
  size_t every = 1;
  PlyWriter file(folder_ / "map.ply", {"world", 0, true, true, std::nullopt});
  for_each_cloud_part(
      map, options,
      [&](const std::vector<CloudPoint>& part) {
        file.add(part);
        for (const CloudPoint& point : part) {
          if (cloud_points_++ % every == 0) cloud_.push_back(point);
          if (cloud_.size() < kMostShown) continue;
          for (size_t i = 0; 2 * i < cloud_.size(); ++i) cloud_[i] = cloud_[2 * i];
          cloud_.resize((cloud_.size() + 1) / 2);
          every *= 2;
        }
      },
      progress);
  file.finish();
}

bool RunFolder::write_surface(const KeyframeMap& map, const SurfaceOptions& options,
                              const TileProgress& progress) const {
  PlyWriter file(folder_ / "mesh.ply", {"world", 0, true, true, 0});
  for_each_surface_part(
      map, options,
      [&](const SurfaceMesh& part) {
        file.add(part.vertices);
        file.add(part.triangles);
      },
      progress);
  file.finish();
  if (!fits_glb(file.layout().vertices, *file.layout().triangles)) return false;
  ply_to_glb(folder_ / "mesh.ply", folder_ / "mesh.glb");
  return true;
}

void RunFolder::draw_error(int index, const DepthEstimate& estimate, const TruthFrame& truth) {
  cv::Mat1f difference;
  cv::subtract(estimate.depth_m, truth.depth_m, difference);
  const cv::Mat3b picture = false_colour(difference, -kErrorLimitM, kErrorLimitM);
  write_png(frame_folder(index) / "error.png", picture);
  if (index == shown_) error_ = picture;
}

void RunFolder::draw_overview(const RunScore* score) const {
  Panel error{sigma_title_, sigma_, 1};
  if (!error_.empty()) error = {"depth error, -0.3 to 0.3 mm", error_, 1};
  std::vector<Pose> cameras;
  for (const TimedPose& pose : trajectory_) cameras.push_back(pose.world_from_robot * rig_.robot_from_camera);
  const cv::Size cell(448, 421);
  std::vector<std::string> facts = facts_;
  facts.push_back(std::to_string(tracked_.size()) + " views tracked, " + std::to_string(lost_.size()) + " lost");
  // Without a second view there are no matches; the surface and its sigma are shown instead.
  std::vector<Panel> second_row = {{match_title_, matches_, 2}};
  if (matches_.empty()) {
    second_row = {{"surface, shaded by its normals", shaded_, 1},
                  score ? Panel{sigma_title_, sigma_, 1} : Panel{"texture", texture_, 1}};
  }
  second_row.push_back({"map from above, " + std::to_string(cloud_points_) + " points; cameras yellow",
                        map_picture(cloud_, cameras, cell), 1});
  second_row.push_back({"score", text_picture(score ? summary(*score) : facts, cell), 1});
  write_png(folder_ / "overview.png", sheet({{{"view " + std::to_string(shown_) + ": fringe image", fringe_, 1},
                                              {"wrapped phase", phase_, 1},
                                              {depth_title_, depth_, 1},
                                              error},
                                             second_row},
                                            cell));
}

}  // namespace fringeslam::tools
