// SPDX-License-Identifier: Apache-2.0
// Victims in generated rubble, found by the thermal camera among other warm objects; also in smoke and dust.
#include <cmath>
#include <cstdio>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "bench/accuracy/percent_chart.h"
#include "bench/row.h"
#include "bench/victim_search.h"
#include "core/score/score.h"
#include "core/types/options.h"

namespace fringeslam::bench {

namespace {

// The gates were set on seeds from 1001 to 1040; these seeds are different.
constexpr uint64_t kFirstSeed = 1;

struct Total {
  VictimScore score;
  std::map<std::string, int> things, wrong;

  void add(const VictimSearchResult& s) {
    score.to_find += s.score.to_find;
    score.found += s.score.found;
    score.candidates += s.score.candidates;
    score.right += s.score.right;
    for (const auto& [material, n] : s.things) things[material] += n;
    for (const auto& [material, n] : s.wrong) wrong[material] += n;
  }
};

std::vector<Row> victim_rows(const Context& context) {
  const int count = context.quick ? 15 : 120;
  prepare_victim_scenes(kFirstSeed, count);
  Total total;
  for (int i = 0; i < count; ++i) {
    const uint64_t seed = kFirstSeed + static_cast<uint64_t>(i);
    const VictimSearchResult s = search_for_victims(seed);
    total.add(s);
    for (const std::string& failure : s.failures)
      std::fprintf(stderr, "  seed %d: %s\n", static_cast<int>(seed), failure.c_str());
  }
  for (const auto& [material, n] : total.things)
    std::fprintf(stderr, "  %-12s %4d warm objects, %d of them mistaken for a victim\n", material.c_str(), n,
                 total.wrong[material]);
  const VictimScore& score = total.score;
  return {bound_row("victim.recall", score.recall(), score.to_find, "", 0.95, Limit::least),
          bound_row("victim.precision", score.precision(), score.candidates, "", 0.9, Limit::least)};
}

// A medium or layer between the cameras and the scene, in increasing amounts.
struct Obscurant {
  std::string id, unit, words;
  std::string section, quantity, rest;  // section of the scene file, its varied and its fixed entries
  std::vector<double> levels;
  double rated = 0;  // the row's level

  std::pair<std::string, std::string> change(double level) const {
    return {section, "{" + quantity + ": " + to_text(level) + ", " + rest + "}"};
  }
};

Obscurant in_the_air(const std::string& id, const std::string& what, const std::string& rest) {
  return {id,
          "per metre",
          what + " of this extinction",
          "air",
          "extinction_per_m",
          rest,
          {0.0, 0.1, 0.2, 0.3, 0.5, 0.8, 1.2, 2.0},
          0.3};
}

// Fine particles: a tenth as dense in the infrared.
Obscurant smoke() { return in_the_air("smoke", "smoke", "albedo: 0.85, anisotropy: 0.6"); }
// Grains of some micrometres: bright and forward-scattering, and nearly as dense in the infrared.
Obscurant whirled_dust() {
  return in_the_air("dust_in_air", "dust in the air", "albedo: 0.95, anisotropy: 0.7, infrared_share: 0.8");
}
Obscurant settled_dust() {
  return {"dust",
          "covered",
          "settled dust, covered share of level surfaces",
          "dust",
          "cover",
          "albedo: 0.34, max_slope_deg: 55",
          {0.0, 0.2, 0.4, 0.6, 0.8, 0.9, 0.95, 1.0},
          0.6};
}

// Measures valid pixels, victims found and correct motions at each level.
std::vector<Row> veil_rows(const Obscurant& veil, const Context& context) {
  constexpr double kRight_m = 1e-3;
  const int worlds = context.quick ? 3 : 12;
  prepare_victim_scenes(kFirstSeed, worlds);
  double rated = 0;
  int rated_to_find = 0;
  std::vector<BarGroup> bars;
  std::fprintf(stderr, "  %9s %8s %8s %8s %10s %12s %10s\n", veil.unit.c_str(), "valid %", "tracked", "corr. %",
               "median mm", "found", "correct");
  for (const double level : veil.levels) {
    Total total;
    std::vector<double> valid, translations_m;
    int views = 0, tracked = 0;
    for (int i = 0; i < worlds; ++i) {
      const VictimSearchResult s = search_for_victims(kFirstSeed + static_cast<uint64_t>(i), {veil.change(level)});
      total.add(s);
      valid.push_back(s.valid);
      views += s.views;
      tracked += s.tracked;
      translations_m.insert(translations_m.end(), s.translations_m.begin(), s.translations_m.end());
    }
    // The motions after each scene's first view; those that were not found count as wrong.
    const int motions = views - worlds;
    int right = 0;
    for (const double error_m : translations_m) right += error_m < kRight_m;
    const VictimScore& score = total.score;
    const double median_mm = translations_m.empty() ? std::nan("") : 1e3 * median_of(translations_m);
    std::fprintf(stderr, "  %9.2f %8.1f %4d/%-4d %7.0f %10.4f %6d of %-4d %5d of %d\n", level, 100 * median_of(valid),
                 tracked, views, 100.0 * right / motions, median_mm, score.found, score.to_find, score.right,
                 score.candidates);
    char name[64];
    std::snprintf(name, sizeof name, "%g %s", level, veil.unit.c_str());
    bars.push_back({name, {100 * median_of(valid), 100.0 * right / motions, 100 * score.recall()}});
    if (level == veil.rated) rated = score.recall(), rated_to_find = score.to_find;
  }
  if (!context.quick)
    write_percent_chart(FRINGESLAM_SCENES "/victims/" + veil.id + ".png",
                        veil.words + ", %, over " + std::to_string(worlds) + " scenes",
                        {"valid pixels", "correct motions", "victims found"}, bars);
  return {bound_row(veil.id + ".victim_recall", rated, rated_to_find, "", 0.9, Limit::least)};
}

}  // namespace

std::vector<Item> victim_items() {
  return {{{"victim.recall", "victim.precision"},
           "victims among other warm objects in 120 rubble piles, by the thermal camera",
           victim_rows},
          {{"smoke.victim_recall"},
           "victims, depth and motions in smoke of increasing density; the row is at 0.3 per metre",
           [](const Context& context) { return veil_rows(smoke(), context); }},
          {{"dust_in_air.victim_recall"},
           "the same in airborne dust; the row is at 0.3 per metre",
           [](const Context& context) { return veil_rows(whirled_dust(), context); }},
          {{"dust.victim_recall"},
           "the same under settled dust; the row is at 60 % of level surfaces covered",
           [](const Context& context) { return veil_rows(settled_dust(), context); }}};
}

}  // namespace fringeslam::bench
