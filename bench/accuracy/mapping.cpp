// SPDX-License-Identifier: Apache-2.0
// A run over a field of rubble and back to its first view: accuracy of the trajectory and of the map.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>

#include "bench/row.h"
#include "core/map/map_cloud.h"
#include "core/map/surface.h"
#include "core/mapper/pipeline.h"
#include "core/score/map_score.h"
#include "core/score/score.h"
#include "sim/nearest_surface.h"
#include "sim/virtual_rig.h"

namespace fringeslam::bench {

namespace {

constexpr double kTolerance_m = 1e-3;

struct MapRun {
  double ate_m = INFINITY, open_ate_m = INFINITY;  // with and without loop closures; infinite if a view was lost
  MapScore score;
  double cloud_m = 0;  // median distance of the cloud's points from the true surface
};

double ate_m(const Pipeline& pipeline, const Trajectory& truth) {
  const Trajectory trajectory = pipeline.trajectory();
  return trajectory.size() == truth.size() ? score_trajectory(trajectory, truth).ate_rmse_m : INFINITY;
}

std::vector<Eigen::Vector3d> positions(const std::vector<CloudPoint>& points) {
  std::vector<Eigen::Vector3d> result;
  result.reserve(points.size());
  for (const CloudPoint& point : points) result.push_back(point.position_m.cast<double>());
  return result;
}

double area_m2(const sim::Mesh& mesh) {
  double area = 0;
  for (const Eigen::Vector3i& t : mesh.triangles) {
    const Eigen::Vector3d &corner = mesh.vertices[static_cast<size_t>(t[0])],
                          a = mesh.vertices[static_cast<size_t>(t[1])] - corner,
                          b = mesh.vertices[static_cast<size_t>(t[2])] - corner;
    area += std::sqrt(std::max(0.0, a.squaredNorm() * b.squaredNorm() - a.dot(b) * a.dot(b))) / 2;
  }
  return area;
}

void measure_map(const sim::Scene& scene, Pipeline& pipeline, const std::vector<Eigen::Vector3d>& seen, MapRun& run) {
  constexpr double kFarthest_m = 0.05;
  const KeyframeMap& map = pipeline.map();
  const SurfaceModel model = pipeline.surface();
  const SurfaceMesh fused = model.mesh();
  sim::Mesh surface{positions(fused.vertices), {}};
  for (const auto& t : fused.triangles) surface.triangles.push_back(Eigen::Array<uint32_t, 3, 1>(t.data()).cast<int>());
  const double area = area_m2(surface), mib = 1048576;
  const sim::NearestSurface truth(scene);
  const std::vector<double> distances = truth.distances_m(surface.vertices, kFarthest_m);
  run.cloud_m = median_of(truth.distances_m(positions(cloud_of(map, {})), kFarthest_m));
  run.score =
      score_map(distances, sim::NearestSurface(std::move(surface)).distances_m(seen, kFarthest_m), kTolerance_m);
  std::fprintf(stderr,
               "    surface %.4f mm, cloud %.4f mm; precision %.4f, recall %.4f, F %.4f over %zu observed points\n"
               "    %.2f m^2 in voxels of %.2f mm: surface %.0f MiB, kept frames %.0f MiB, %.1f and %.1f per m^2\n",
               1e3 * run.score.accuracy.median_m, 1e3 * run.cloud_m, run.score.precision, run.score.recall,
               run.score.f_score(), seen.size(), area, 1e3 * model.voxel_m(),
               static_cast<double>(model.memory_bytes()) / mib, static_cast<double>(map.memory_bytes()) / mib,
               static_cast<double>(model.memory_bytes()) / mib / area,
               static_cast<double>(map.memory_bytes()) / mib / area);
}

MapRun measured(const std::string& name, uint64_t seed) {
  const sim::Scene scene = sim::load_scene(std::string(FRINGESLAM_SCENES) + "/" + name + "/scene.yaml", {seed});
  const PixelRays rays = pixel_rays(scene.rig.camera);
  std::vector<Eigen::Vector3d> seen;
  sim::VirtualRig rig(scene, {});
  const Pose& start = scene.trajectory[0].world_from_robot;
  PipelineOptions no_loops;
  no_loops.mapping.max_links = 0;
  Pipeline pipeline(scene.rig, scene.patterns, {}, start), open(scene.rig, scene.patterns, no_loops, start);
  while (const auto view = rig.simulate(scene.patterns)) {
    append_visible_surface(view->truth, scene.rig, rays, seen);
    pipeline.process(view->stack);
    open.process(view->stack);
  }
  MapRun run;
  run.ate_m = ate_m(pipeline, scene.trajectory);
  run.open_ate_m = ate_m(open, scene.trajectory);
  std::fprintf(
      stderr,
      "  %s seed %d: %zu views, %zu lost, %zu keyframes, %zu frames kept, %zu links; ATE %.4f mm, without loop "
      "closure %.4f mm\n",
      name.c_str(), static_cast<int>(seed), scene.trajectory.size(),
      scene.trajectory.size() - pipeline.trajectory().size(), pipeline.map().keyframes().size(),
      pipeline.map().frames().size(), pipeline.map().links().size(), 1e3 * run.ate_m, 1e3 * run.open_ate_m);
  measure_map(scene, pipeline, seen, run);
  return run;
}

// Measured once for all rows that use them.
const std::vector<MapRun>& loop_runs(const Context& context) {
  static std::map<int, std::vector<MapRun>> known;
  const int seeds = context.quick ? 1 : 3;
  std::vector<MapRun>& runs = known[seeds];
  for (int i = static_cast<int>(runs.size()); i < seeds; ++i)
    runs.push_back(measured("loop", static_cast<uint64_t>(3 + i)));
  return runs;
}

template <class Value>
std::vector<double> collect(const std::vector<MapRun>& runs, const Value& value) {
  std::vector<double> values;
  for (const MapRun& run : runs) values.push_back(value(run));
  return values;
}

std::vector<Row> ate_rows(const Context& context) {
  return {median_row("loop.ate", collect(loop_runs(context), [](const MapRun& run) { return 1e3 * run.ate_m; }), "mm",
                     0.3)};
}

std::vector<Row> map_rows(const Context& context) {
  const std::vector<MapRun>& runs = loop_runs(context);
  measured("rubble_pile", 1);  // for comparison
  return {median_row("map.surface", collect(runs, [](const MapRun& run) { return 1e3 * run.score.accuracy.median_m; }),
                     "mm", 0.1),
          median_row("map.f1", collect(runs, [](const MapRun& run) { return run.score.f_score(); }), "", 0.99,
                     Limit::least)};
}

}  // namespace

std::vector<Item> mapping_items() {
  return {{{"loop.ate"}, "one lap over a field of rubble, 121 views: trajectory", ate_rows},
          {{"map.surface", "map.f1"}, "the same run: fused surface", map_rows}};
}

}  // namespace fringeslam::bench
