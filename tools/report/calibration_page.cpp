// SPDX-License-Identifier: Apache-2.0
#include "tools/report/calibration_page.h"

#include <cmath>
#include <cstdio>
#include <opencv2/imgproc.hpp>

#include "core/io/files.h"
#include "core/rig/dataset.h"
#include "tools/report/pictures.h"

namespace fringeslam::tools {

namespace fs = std::filesystem;

namespace {

constexpr double kMagnification = 100;  // of the residuals in the pictures
constexpr int kPictureWidth = 900;

cv::Mat3b residual_picture(const cv::Mat1f& texture, const ViewResult& view) {
  const auto [low, high] = content_limits(texture);
  cv::Mat1f scaled;
  texture.convertTo(scaled, CV_32F, 255 / (high - low), -255 * low / (high - low));
  cv::Mat1b grey;
  scaled.convertTo(grey, CV_8U);
  const double scale = static_cast<double>(kPictureWidth) / texture.cols;
  cv::Mat resized;
  cv::resize(grey, resized, {}, scale, scale, cv::INTER_AREA);
  cv::Mat3b picture;
  cv::cvtColor(resized, picture, cv::COLOR_GRAY2BGR);
  constexpr int kShift = 4;
  const auto point = [&](const Eigen::Vector2d& p) {
    return cv::Point(cvRound((p.x() + 0.5) * scale * (1 << kShift)), cvRound((p.y() + 0.5) * scale * (1 << kShift)));
  };
  for (size_t j = 0; j < view.camera_px.size(); ++j) {
    const Eigen::Vector2d& corner = view.camera_px[j];
    if (!corner.allFinite()) continue;
    cv::circle(picture, point(corner), 3 << kShift, {80, 220, 250}, 1, cv::LINE_AA, kShift);
    const Eigen::Vector2d& residual = view.camera_residual_px[j];
    if (residual.allFinite())
      cv::line(picture, point(corner), point(corner + kMagnification * residual), {80, 80, 255}, 1, cv::LINE_AA,
               kShift);
  }
  return picture;
}

std::string cell(const char* format, double value) {
  char text[64];
  std::snprintf(text, sizeof text, format, value);
  return "<td>" + std::string(text) + "</td>";
}

std::string parameter(const char* name, double value, double sigma, int decimals) {
  char text[160];
  std::snprintf(text, sizeof text, "<tr><td>%s</td><td>%.*f</td><td>%.*f</td></tr>\n", name, decimals, value, decimals,
                sigma);
  return text;
}

std::string lens_table(const std::string& title, const Pinhole& lens, const LensSigmas& sigma) {
  const Distortion &d = lens.distortion, &s = sigma.distortion;
  return "<h2>" + title + "</h2>\n<table><tr><th>parameter</th><th>estimate</th><th>sigma</th></tr>\n" +
         parameter("fx, px", lens.fx, sigma.fx, 2) + parameter("fy, px", lens.fy, sigma.fy, 2) +
         parameter("cx, px", lens.cx, sigma.cx, 2) + parameter("cy, px", lens.cy, sigma.cy, 2) +
         parameter("k1", d.k1, s.k1, 4) + parameter("k2", d.k2, s.k2, 4) + parameter("p1", d.p1, s.p1, 5) +
         parameter("p2", d.p2, s.p2, 5) + parameter("k3", d.k3, s.k3, 4) + "</table>\n";
}

}  // namespace

void write_calibration_page(const fs::path& folder, const RigCalibration& c, const std::vector<cv::Mat1f>& textures) {
  fs::create_directories(folder / "views");
  std::string page =
      "<!doctype html>\n<meta charset=\"utf-8\">\n<title>Rig calibration</title>\n<style>body{font:16px sans-serif;"
      "max-width:70em;margin:2em auto}table{border-collapse:collapse}td,th{padding:.3em 1em;border-bottom:1px solid "
      "#ccc;"
      "text-align:right}td:first-child,th:first-child{text-align:left}img{max-width:100%}.warning{background:#fe9;"
      "padding:"
      ".5em 1em}</style>\n<h1>Rig calibration</h1>\n";
  for (const std::string& warning : c.warnings) page += "<p class=\"warning\">" + warning + "</p>\n";
  char line[300];
  std::snprintf(
      line, sizeof line,
      "<p>Reprojection error %.3f px in the camera, %.3f px in the projector (RMS). The corners cover %.0f %% of "
      "the camera's and %.0f %% of the projector's image. The boards disagree by %.1f times the noise of their "
      "corners; the sigmas below contain that.</p>\n",
      c.camera_rms_px, c.projector_rms_px, 100 * c.camera_coverage, 100 * c.projector_coverage, c.covariance_factor);
  page += line;
  page +=
      "<h2>Views</h2>\n<p>Plane RMS and scale error: the board measured with the rig calibrated from the other "
      "views.</p>"
      "\n<table><tr><th>view</th><th>camera, px</th><th>projector, px</th><th>plane RMS, mm</th><th>scale error, %</th>"
      "</tr>\n";
  for (const ViewResult& view : c.views) {
    page += "<tr><td>" + view.name + "</td>";
    if (!view.used) {
      page += "<td colspan=\"4\">not used: " + view.reason + "</td></tr>\n";
      continue;
    }
    page += cell("%.3f", view.camera_rms_px) + cell("%.3f", view.projector_rms_px);
    for (const HeldOutBoard& board : c.held_out) {
      if (board.name == view.name)
        page += cell("%.3f", 1e3 * board.plane_rms_m) + cell("%.3f", 100 * board.scale_error);
    }
    page += "</tr>\n";
  }
  page += "</table>\n" + lens_table("Camera", c.rig.camera, c.camera_sigma) +
          lens_table("Projector", c.rig.projector, c.projector_sigma);
  const Eigen::Vector3d &t = c.rig.projector_from_camera.translation, &s = c.translation_sigma_m;
  page += "<h2>Relative pose</h2>\n<table><tr><th>projector_from_camera</th><th>estimate</th><th>sigma</th></tr>\n" +
          parameter("x, mm", 1e3 * t.x(), 1e3 * s.x(), 3) + parameter("y, mm", 1e3 * t.y(), 1e3 * s.y(), 3) +
          parameter("z, mm", 1e3 * t.z(), 1e3 * s.z(), 3) + "</table>\n<h2>Coverage</h2>\n<img src=\"coverage.png\" " +
          "alt=\"corners in camera and projector\">\n";
  std::snprintf(line, sizeof line, "<h2>Residuals, magnified %.0f times</h2>\n", kMagnification);
  page += line;
  for (size_t v = 0; v < c.views.size(); ++v) {
    if (!c.views[v].used) continue;
    const std::string file = "views/" + stack_name(static_cast<int>(v)) + ".png";
    write_png(folder / file, residual_picture(textures[v], c.views[v]));
    page += "<p>" + c.views[v].name + "</p>\n<img src=\"" + file + "\" alt=\"residuals\">\n";
  }
  write_text(folder / "calibration.html", page);
}

}  // namespace fringeslam::tools
