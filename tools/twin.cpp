// SPDX-License-Identifier: Apache-2.0
// fringeslam twin DATASET --out FOLDER: simulates a real capture and compares the simulation with it.
#include "bench/twin/twin.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>

#include "core/io/files.h"
#include "core/io/json_text.h"
#include "core/rig/dataset.h"
#include "tools/output_file.h"
#include "tools/progress.h"
#include "tools/report/pictures.h"
#include "tools/verbs.h"

namespace fringeslam::tools {

namespace fs = std::filesystem;
using twin::Capture;
using twin::Comparison;

namespace {

struct TwinArguments {
  std::string dataset, out;
};

double quantile_of(std::vector<double> values, double share) {
  if (values.empty()) return std::nan("");
  const auto nth = values.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), nth, values.end());
  return *nth;
}

std::string ratio_text(const Comparison& row) {
  if (row.real == 0) return row.simulated == 0 ? "1" : "-";
  char text[32];
  std::snprintf(text, sizeof text, "%.3f", row.simulated / row.real);
  return text;
}

std::string to_table(const std::vector<Comparison>& rows) {
  std::string text = "                                   real   simulated   ratio\n";
  char line[160];
  for (const Comparison& row : rows) {
    const std::string name = row.name + (row.unit.empty() ? "" : ", " + row.unit);
    std::snprintf(line, sizeof line, "%-28s %10.4g  %10.4g  %6s\n", name.c_str(), row.real, row.simulated,
                  ratio_text(row).c_str());
    text += line;
  }
  return text;
}

cv::Mat3b beside(const cv::Mat3b& left, const cv::Mat3b& right) {
  cv::Mat3b joined;
  cv::hconcat(std::vector<cv::Mat>{left, cv::Mat3b(left.rows, 8, cv::Vec3b(255, 255, 255)), right}, joined);
  return joined;
}

// Writes real and simulated images side by side and the page that shows them.
void write_page(const fs::path& folder, const Capture& real, const Capture& twin, const std::vector<Comparison>& rows,
                double full_scale_dn) {
  std::vector<double> depths;
  for (const float z : real.depth_m) {
    if (std::isfinite(z)) depths.push_back(static_cast<double>(z));
  }
  const double low = quantile_of(depths, 0.01), high = quantile_of(depths, 0.99);
  const double modulation =
      quantile_of(std::vector<double>(real.decoded.modulation.begin(), real.decoded.modulation.end()), 0.99);
  const size_t last = real.stack.images.size() - 1;
  const std::vector<std::pair<std::string, cv::Mat3b>> pictures = {
      {"first image",
       beside(grey_picture(real.stack.images[0], full_scale_dn), grey_picture(twin.stack.images[0], full_scale_dn))},
      {"last image", beside(grey_picture(real.stack.images[last], full_scale_dn),
                            grey_picture(twin.stack.images[last], full_scale_dn))},
      {"modulation", beside(false_colour(real.decoded.modulation, 0, modulation),
                            false_colour(twin.decoded.modulation, 0, modulation))},
      {"depth", beside(false_colour(real.depth_m, low, high), false_colour(twin.depth_m, low, high))}};
  std::string page =
      "<!doctype html>\n<meta charset=\"utf-8\">\n<title>Digital twin</title>\n<style>body{font:16px "
      "sans-serif;max-width:"
      "80em;margin:2em auto}table{border-collapse:collapse}td,th{padding:.3em 1em;border-bottom:1px solid "
      "#ccc;text-align:"
      "right}td:first-child,th:first-child{text-align:left}img{width:100%}</style>\n<h1>Digital twin: real and "
      "simulated</h1>"
      "\n<table><tr><th>quantity</th><th>real</th><th>simulated</th><th>simulated / real</th></tr>\n";
  char line[200];
  for (const Comparison& row : rows) {
    std::snprintf(line, sizeof line, "<tr><td>%s%s%s</td><td>%.4g</td><td>%.4g</td><td>%s</td></tr>\n",
                  row.name.c_str(), row.unit.empty() ? "" : ", ", row.unit.c_str(), row.real, row.simulated,
                  ratio_text(row).c_str());
    page += line;
  }
  page +=
      "</table>\n<p>Not modelled: indirect and subsurface light, gloss, the surroundings of the reconstructed surface, "
      "the projector's response, and blur that varies over the view. They show where the columns differ, mostly as a "
      "lower "
      "share of wrong orders and sharper shadows in the simulation.</p>\n";
  for (const auto& [name, picture] : pictures) {
    std::string file = name + ".png";
    std::replace(file.begin(), file.end(), ' ', '_');
    write_png(folder / file, picture);
    page += "<h2>" + name + "</h2>\n<p>Left: real. Right: simulated.</p>\n<img src=\"" + file + "\" alt=\"" + name +
            "\">\n";
  }
  write_text(folder / "twin.html", page);
}

int run_twin(const TwinArguments& arguments, const Common& common) {
  ReplayRig replay(arguments.dataset);
  if (!replay.model().calibrated)
    throw Error(arguments.dataset + ": its rig is not calibrated; run fringeslam calibrate rig");
  auto stack = replay.capture(replay.sequence());
  if (!stack) throw Error(arguments.dataset + ": has no stacks");
  require_not_an_input(arguments.out, {arguments.dataset});
  StagedFolder folder(arguments.out, "twin");
  fs::create_directories(folder.path() / "scene");
  twin::Twin made;
  try {
    Progress progress("rendering", 3, common.quiet || common.json);
    made = twin::make_twin(std::move(*stack), replay.model(), replay.info().name + "_twin", folder.path() / "scene",
                           [&] { progress.step(); });
  } catch (const Error& e) {
    throw Error(arguments.dataset + ": " + e.what());
  }
  write_page(folder.path(), made.real, made.simulated, made.comparisons, made.rig.sensor.max_dn());
  nlohmann::ordered_json json;
  json["blur_px"] = made.rig.projector_lens.blur_px;
  json["ambient_lux"] = made.light.ambient_lux;
  json["exposure_s"] = made.light.exposure_s;
  for (const Comparison& row : made.comparisons)
    json["comparison"].push_back(
        {{"quantity", row.name}, {"unit", row.unit}, {"real", row.real}, {"simulated", row.simulated}});
  write_text(folder.path() / "twin.json", json_text(json, 2) + "\n");
  folder.commit();
  print_result(common, json,
               to_table(made.comparisons) + "\nwritten: " + arguments.out + "  (twin.html, twin.json, scene/)");
  return 0;
}

}  // namespace

Verb add_twin(Command app, const Common& common) {
  auto arguments = std::make_shared<TwinArguments>();
  const Command verb = app.add_subcommand(
      "twin", "Simulate a real capture with its own rig, surface and noise, and compare the simulation with it");
  verb.add_option("dataset", arguments->dataset, "Dataset of a calibrated rig; its first stack is used").required();
  verb.add_option("--out", arguments->out, "Folder for twin.html, twin.json and the scene").required();
  return [arguments, &common] { return run_twin(*arguments, common); };
}

}  // namespace fringeslam::tools
