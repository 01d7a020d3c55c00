// SPDX-License-Identifier: Apache-2.0
#include "sim/preview.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <opencv2/imgproc.hpp>

#include "core/types/error.h"
#include "sim/light/renderer.h"
#include "sim/preview/line_drawing.h"
#include "sim/preview/overview.h"
#include "sim/preview/viewpoint.h"
#include "sim/sensor_view.h"

namespace fringeslam::sim {

namespace {

const cv::Scalar kInk(225, 225, 225), kFaintInk(150, 150, 150);
const cv::Scalar kCameraColour(255, 190, 70), kProjectorColour(40, 140, 255), kPathColour(90, 235, 130);

// Layout of the preview; lengths in px.
struct Layout {
  double unit = 1;  // scale relative to a 1200 x 800 px preview
  int gap = 8, caption = 28;
  cv::Rect overview, view, depth;
};

int scaled(double unit, double length) { return std::max(1, static_cast<int>(std::lround(unit * length))); }

Layout layout_of(const cv::Size& size, const Pinhole& camera) {
  Layout layout;
  layout.unit = std::min(size.height / 800.0, size.width / 1200.0);
  layout.gap = scaled(layout.unit, 8), layout.caption = scaled(layout.unit, 28);
  const int height = (size.height - 2 * layout.caption - layout.gap) / 2;
  const int width = std::min(size.width * 2 / 5, height * camera.width / camera.height);
  const int left = size.width - layout.gap - width;
  layout.view = {left, layout.caption, width, height};
  layout.depth = {left, 2 * layout.caption + height, width, height};
  layout.overview = {layout.gap, layout.caption, left - 2 * layout.gap, size.height - layout.caption - layout.gap};
  return layout;
}

// Draws a one-line caption above a panel, shrunk to the panel's width if necessary.
void put_caption(cv::Mat3b& paper, const Layout& layout, const cv::Rect& place, const std::string& text) {
  const double full = 0.56 * layout.unit;
  const int stroke = layout.unit > 1.5 ? 2 : 1;
  const int width = cv::getTextSize(text, cv::FONT_HERSHEY_SIMPLEX, full, stroke, nullptr).width;
  const double size = full * std::min(1.0, static_cast<double>(place.width) / std::max(1, width));
  cv::putText(paper, text, {place.x + scaled(layout.unit, 2), place.y - scaled(layout.unit, 9)},
              cv::FONT_HERSHEY_SIMPLEX, size, kInk, stroke, cv::LINE_AA);
}

std::string counted(size_t count, const std::string& what) {
  return std::to_string(count) + " " + what + (count == 1 ? "" : "s");
}

std::string headline(const Scene& scene) {
  size_t triangles = 0;
  for (const Object& object : scene.objects) triangles += object.mesh->triangles.size();
  return scene.name + ", seed " + std::to_string(scene.seed) + ": " + counted(scene.objects.size(), "object") + ", " +
         counted(triangles, "triangle") + ", " + counted(scene.trajectory.size(), "view");
}

std::string metres(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.3g m", value);
  return text;
}

// --- left: external view ---

void draw_frustum(LineDrawing& drawing, const Pinhole& device, const Pose& world_from_device, const RigModel& rig,
                  const Pen& pen) {
  std::vector<Eigen::Vector3d> near, far;
  for (const Eigen::Vector3d& corner : image_corners(device, rig.near_m)) near.push_back(world_from_device * corner);
  for (const Eigen::Vector3d& corner : image_corners(device, rig.far_m)) far.push_back(world_from_device * corner);
  drawing.polygon(near, pen);
  drawing.polygon(far, pen);
  Pen lead = pen;
  lead.strength *= 0.5;
  for (size_t i = 0; i < near.size(); ++i) {
    drawing.line(near[i], far[i], pen);
    drawing.line(world_from_device.translation, near[i], lead);
  }
}

// Draws the border of the first view's image projected onto the surfaces.
void draw_footprint(LineDrawing& drawing, const Scene& scene, const RayScene& world, const Pen& pen) {
  constexpr int kPerSide = 100;
  const Pose pose = world_from_camera(scene, 0);
  const std::vector<Eigen::Vector3d> corners = image_corners(scene.rig.camera, 1);
  std::optional<Hit> before;
  for (int i = 0; i <= 4 * kPerSide; ++i) {
    const auto side = static_cast<size_t>(i / kPerSide);
    const double share = static_cast<double>(i % kPerSide) / kPerSide;
    const Eigen::Vector3d ray = (1 - share) * corners[side % 4] + share * corners[(side + 1) % 4];
    const std::optional<Hit> hit = world.trace(pose.translation, pose.rotation * ray);
    // Skip segments that jump between surfaces at a depth discontinuity.
    constexpr double kJump = 0.05;
    if (hit && before && (hit->point - before->point).norm() < kJump * hit->distance)
      drawing.line(before->point, hit->point, pen);
    before = hit;
  }
}

void draw_sensor(LineDrawing& drawing, const Scene& scene, const RayScene& world, double unit) {
  constexpr size_t kMostFrusta = 12, kMostPairs = 4, kMostPlaces = 2000;
  const RigModel& rig = scene.rig;
  const std::vector<size_t> views = some_views(scene.trajectory.size(), kMostFrusta);
  const bool in_pairs = views.size() <= kMostPairs;  // otherwise projector frusta would clutter the image
  for (const size_t view : views) {
    const bool first = view == 0;
    const double width = first ? 2 * unit : unit, strength = first ? 0.9 : in_pairs ? 0.4 : 0.3;
    if (first || in_pairs)
      draw_frustum(drawing, rig.projector, world_from_projector(scene, view), rig, {kProjectorColour, width, strength});
    draw_frustum(drawing, rig.camera, world_from_camera(scene, view), rig, {kCameraColour, width, strength});
    const double radius = (first ? 6 : 3.5) * unit;
    if (first || in_pairs)
      drawing.dot(world_from_projector(scene, view).translation, radius, {kProjectorColour, 1, first ? 1 : 0.7});
    drawing.dot(world_from_camera(scene, view).translation, radius, {kCameraColour, 1, first ? 1 : 0.7});
  }
  draw_footprint(drawing, scene, world, {kCameraColour, unit, 0.9});
  const std::vector<size_t> places = some_views(scene.trajectory.size(), kMostPlaces);
  for (size_t i = 1; i < places.size(); ++i)
    drawing.line(world_from_camera(scene, places[i - 1]).translation, world_from_camera(scene, places[i]).translation,
                 {kPathColour, 2 * unit, 0.85});
}

void put_legend(cv::Mat3b& picture, double unit, bool has_path) {
  std::vector<std::pair<std::string, cv::Scalar>> lines = {{"camera", kCameraColour}, {"projector", kProjectorColour}};
  if (has_path) lines.emplace_back("camera path", kPathColour);
  const cv::Rect back(0, picture.rows - static_cast<int>(lines.size()) * scaled(unit, 22) - scaled(unit, 12),
                      scaled(unit, has_path ? 215 : 125), picture.rows);
  cv::Mat behind = picture(back & cv::Rect({}, picture.size()));
  cv::addWeighted(behind, 0.4, cv::Mat(behind.size(), behind.type(), cv::Scalar(kPaper)), 0.6, 0, behind);
  int y = picture.rows - scaled(unit, 14) - static_cast<int>(lines.size() - 1) * scaled(unit, 22);
  for (const auto& [text, colour] : lines) {
    const int x = scaled(unit, 12), stroke = unit > 1.5 ? 2 : 1;
    cv::line(picture, {x, y - scaled(unit, 5)}, {x + scaled(unit, 24), y - scaled(unit, 5)}, colour, scaled(unit, 3),
             cv::LINE_AA);
    cv::putText(picture, text, {x + scaled(unit, 32), y}, cv::FONT_HERSHEY_SIMPLEX, 0.5 * unit, kInk, stroke,
                cv::LINE_AA);
    y += scaled(unit, 22);
  }
}

cv::Mat3b overview_panel(const Scene& scene, const RayScene& world, const Layout& layout) {
  const Interest interest = interest_of(scene, world);
  const Viewpoint viewpoint = choose_viewpoint(scene, world, interest, layout.overview.width, layout.overview.height);
  Overview overview = render_overview(scene, world, viewpoint);
  LineDrawing drawing(viewpoint, overview.distance_m);
  draw_sensor(drawing, scene, world, layout.unit);
  drawing.paint(overview.picture);
  put_legend(overview.picture, layout.unit, scene.trajectory.size() > 1);
  return overview.picture;
}

// --- right: first view ---

// Tone-maps illuminance for display (gamma 2.2), with the 99th percentile scaled to 92 % of white.
cv::Mat3b toned(const cv::Mat1f& lux) {
  std::vector<float> sorted(lux.begin(), lux.end());
  const auto high = sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() * 99 / 100);
  std::nth_element(sorted.begin(), high, sorted.end());
  const float scale = *high > 0 ? 0.92f / *high : 0.0f;
  cv::Mat3b picture(lux.size());
  std::transform(lux.begin(), lux.end(), picture.begin(), [&](float value) {
    return cv::Vec3b::all(cv::saturate_cast<uchar>(255 * std::pow(scale * value, 1 / 2.2f)));
  });
  return picture;
}

// Colour-codes depth; values outside the rig's working range are faded, NaN is background.
cv::Mat3b coloured_depth(const cv::Mat1f& depth_m, double near_m, double far_m) {
  cv::Mat1b levels(depth_m.size());
  std::transform(depth_m.begin(), depth_m.end(), levels.begin(), [&](float depth) {
    return cv::saturate_cast<uchar>(255 * (static_cast<double>(depth) - near_m) / (far_m - near_m));
  });
  cv::Mat3b colours;
  cv::applyColorMap(levels, colours, cv::COLORMAP_TURBO);
  for (int k = 0; k < static_cast<int>(depth_m.total()); ++k) {
    const auto depth = static_cast<double>(depth_m(k));
    if (std::isnan(depth))
      colours(k) = kPaper;
    else if (depth < near_m || depth > far_m)
      colours(k) = 0.45 * colours(k) + 0.55 * kPaper;
  }
  return colours;
}

// Draws the depth colour scale, right-aligned in the caption line.
void put_scale(cv::Mat3b& paper, const Layout& layout, const RigModel& rig) {
  const double size = 0.5 * layout.unit;
  const int stroke = layout.unit > 1.5 ? 2 : 1, bar = scaled(layout.unit, 90), space = scaled(layout.unit, 6);
  const int bottom = layout.depth.y - scaled(layout.unit, 9), height = scaled(layout.unit, 11);
  const std::string near = metres(rig.near_m), far = metres(rig.far_m);
  int x = layout.depth.br().x - cv::getTextSize(far, cv::FONT_HERSHEY_SIMPLEX, size, stroke, nullptr).width;
  cv::putText(paper, far, {x, bottom}, cv::FONT_HERSHEY_SIMPLEX, size, kInk, stroke, cv::LINE_AA);
  x -= space + bar;
  cv::Mat1b ramp(height, bar);
  for (int i = 0; i < bar; ++i) ramp.col(i) = cv::saturate_cast<uchar>(255 * i / std::max(1, bar - 1));
  cv::Mat3b colours;
  cv::applyColorMap(ramp, colours, cv::COLORMAP_TURBO);
  colours.copyTo(paper(cv::Rect(x, bottom - height + 1, bar, height)));
  x -= space + cv::getTextSize(near, cv::FONT_HERSHEY_SIMPLEX, size, stroke, nullptr).width;
  cv::putText(paper, near, {x, bottom}, cv::FONT_HERSHEY_SIMPLEX, size, kInk, stroke, cv::LINE_AA);
}

Effects seen_effects() {
  Effects effects = Effects::none();
  effects.vignetting = effects.gloss = effects.relief = effects.dust = effects.water = effects.air = true;
  return effects;
}

}  // namespace

cv::Mat3b overview_picture(const Scene& scene, cv::Size size) {
  Layout layout;
  layout.unit = std::min(size.height / 800.0, size.width / 1200.0);
  layout.overview = {{0, 0}, size};
  return overview_panel(scene, Renderer(scene, seen_effects(), 1).world(), layout);
}

cv::Mat3b preview_picture(const Scene& scene, cv::Size size) {
  if (size.width < 320 || size.height < 200) throw Error("preview: the size must be at least 320x200 px");
  const Layout layout = layout_of(size, scene.rig.camera);
  Scene shown = scene;
  shown.rig = with_camera_size(scene.rig, layout.view.size());
  const Renderer renderer(shown, seen_effects(), 4);
  const ProjectedPatterns light({shown.rig.projector.width, shown.rig.projector.height, {white_pattern()}}, shown.rig,
                                {});
  TruthFrame truth;
  const cv::Mat1f lux = renderer.render(light, {world_from_camera(shown, 0)}, 0, &truth)[0];

  cv::Mat3b paper(size, kPaper);
  overview_panel(shown, renderer.world(), layout).copyTo(paper(layout.overview));
  toned(lux).copyTo(paper(layout.view));
  coloured_depth(truth.depth_m, scene.rig.near_m, scene.rig.far_m).copyTo(paper(layout.depth));
  put_caption(paper, layout, layout.overview, headline(scene));
  put_caption(paper, layout, layout.view, "first view, white light");
  put_caption(paper, layout, layout.depth, "depth");
  put_scale(paper, layout, scene.rig);
  return paper;
}

}  // namespace fringeslam::sim
