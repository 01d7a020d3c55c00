// SPDX-License-Identifier: Apache-2.0
#include "core/thermal/victims.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <map>
#include <tuple>

namespace fringeslam {

namespace {

// A region in world coordinates.
struct Piece {
  int view, number;
  const WarmRegion* region;
  Eigen::Vector3d centre_m;
  std::vector<Eigen::Vector3d> points_m;
};

std::vector<Piece> pieces_of(const std::vector<LocatedRegions>& views, double min_area_m2) {
  std::vector<Piece> pieces;
  for (const LocatedRegions& view : views) {
    for (size_t i = 0; i < view.regions.size(); ++i) {
      const WarmRegion& region = view.regions[i];
      if (region.area_m2 < min_area_m2 || region.kind == WarmKind::too_cold) continue;
      Piece piece{view.view, static_cast<int>(i), &region, view.world_from_camera * region.centre_m, {}};
      for (const Eigen::Vector3d& p : region.points_m) piece.points_m.push_back(view.world_from_camera * p);
      pieces.push_back(std::move(piece));
    }
  }
  return pieces;
}

// Returns the number of points of a near some point of b.
size_t count_near(const Piece& a, const Piece& b, double distance_m) {
  return static_cast<size_t>(std::count_if(a.points_m.begin(), a.points_m.end(), [&](const Eigen::Vector3d& p) {
    return std::any_of(b.points_m.begin(), b.points_m.end(),
                       [&](const Eigen::Vector3d& q) { return (p - q).squaredNorm() < distance_m * distance_m; });
  }));
}

// Distance at which samples of two regions show the same surface. Those of large regions are farther apart than overlap_m.
// The spacing of the smaller region's samples finds them, and is too small a part of its size to take in what lies beside it.
double overlap_distance(const Piece& piece, double overlap_m) {
  const auto samples = static_cast<double>(piece.points_m.size());
  return std::max(overlap_m, std::sqrt(piece.region->area_m2 / samples));
}

// Regions of skin near each other belong to one victim, since debris may separate them. Other regions are one object
// if two views saw the same surface.
bool one_thing(const Piece& a, const Piece& b, const ThermalOptions& options) {
  if (a.region->candidate() && b.region->candidate()) return count_near(a, b, options.same_place_m) > 0;
  if (a.view == b.view) return false;
  const auto& [small, large] = a.region->area_m2 < b.region->area_m2 ? std::tie(a, b) : std::tie(b, a);
  return 2 * count_near(small, large, overlap_distance(small, options.overlap_m)) > small.points_m.size();
}

// Returns the object number of each region.
std::vector<size_t> things_of(const std::vector<Piece>& pieces, const ThermalOptions& options) {
  std::vector<size_t> thing(pieces.size());
  for (size_t i = 0; i < pieces.size(); ++i) {
    thing[i] = i;
    for (size_t j = 0; j < i; ++j) {
      if (thing[i] == thing[j] || !one_thing(pieces[i], pieces[j], options)) continue;
      const size_t from = std::max(thing[i], thing[j]), to = std::min(thing[i], thing[j]);
      std::replace(thing.begin(), thing.begin() + static_cast<std::ptrdiff_t>(i) + 1, from, to);
    }
  }
  return thing;
}

int count_views(const std::vector<const Piece*>& pieces) {
  std::vector<int> views;
  for (const Piece* piece : pieces) views.push_back(piece->view);
  std::sort(views.begin(), views.end());
  return static_cast<int>(std::unique(views.begin(), views.end()) - views.begin());
}

WarmObject summed_up(const std::vector<const Piece*>& pieces) {
  WarmObject thing;
  double all_m2 = 0, skin_m2 = 0;
  for (const Piece* piece : pieces) {
    all_m2 += piece->region->area_m2;
    if (piece->region->candidate()) skin_m2 += piece->region->area_m2;
  }
  thing.skin_share = all_m2 > 0 ? skin_m2 / all_m2 : 0;
  thing.victim = thing.skin_share > 0.5;
  std::vector<const Piece*> telling;  // regions with the object's class
  std::copy_if(pieces.begin(), pieces.end(), std::back_inserter(telling),
               [&](const Piece* piece) { return piece->region->candidate() == thing.victim; });
  const Piece* best = *std::max_element(telling.begin(), telling.end(), [](const Piece* a, const Piece* b) {
    return a->region->area_m2 < b->region->area_m2;
  });
  thing.position_m = best->centre_m;
  for (const Piece* piece : telling) {
    thing.points_m.insert(thing.points_m.end(), piece->points_m.begin(), piece->points_m.end());
    for (const Eigen::Vector3d& p : piece->points_m)
      thing.extent_m = std::max(thing.extent_m, (p - thing.position_m).norm());
  }
  thing.views = count_views(pieces);
  thing.skin_views = thing.victim ? count_views(telling) : 0;
  thing.temperature_c = best->region->warmest_c;
  thing.area_m2 = best->region->area_m2;
  thing.reason = best->region->reason;
  thing.best_view = best->view;
  thing.best_region = best->number;
  return thing;
}

}  // namespace

std::vector<WarmObject> merge_regions(const std::vector<LocatedRegions>& views, const ThermalOptions& options) {
  const std::vector<Piece> pieces = pieces_of(views, options.min_area_m2);
  const std::vector<size_t> thing = things_of(pieces, options);
  std::map<size_t, std::vector<const Piece*>> together;
  for (size_t i = 0; i < pieces.size(); ++i) together[thing[i]].push_back(&pieces[i]);
  std::vector<WarmObject> things;
  for (const auto& [number, members] : together) things.push_back(summed_up(members));
  return things;
}

}  // namespace fringeslam
