// SPDX-License-Identifier: Apache-2.0
// Mapping of a long run: pose graph and fused surface.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>

#include "bench/frame_pairs.h"
#include "bench/row.h"
#include "bench/speed/interleaving.h"
#include "core/map/frame_planes.h"
#include "core/map/pose_graph.h"
#include "core/map/surface.h"
#include "sim/random.h"

namespace fringeslam::bench {

namespace {

struct Run {
  std::vector<Pose> dead_reckoning;
  std::vector<PoseEdge> edges;
  std::vector<double> truths;  // of each edge: 1 = correct loop closure
};

// Laps of a 4 m field with a keyframe every decimetre; one loop closure in `one_wrong_in` is wrong by centimetres to metres.
Run long_run(int keyframes, int keyframes_per_lap, int loops, int one_wrong_in) {
  constexpr double kTurnSigma = 3e-4, kShiftSigma_m = 5e-4;
  const sim::Philox random(1, sim::Stream::draws, 0);
  uint32_t drawn = 0;
  const auto normals = [&](double turn, double shift) {
    Vector6d result;
    for (int i = 0; i < 6; ++i) result[i] = (i < 3 ? turn : shift) * random.normal_pair(drawn++).first;
    return result;
  };
  Vector6d diagonal;
  diagonal << Eigen::Vector3d::Constant(std::pow(kTurnSigma, -2)),
      Eigen::Vector3d::Constant(std::pow(kShiftSigma_m, -2));
  std::vector<Pose> truth;
  for (int i = 0; i < keyframes; ++i) {
    const double angle = 2 * std::numbers::pi * i / keyframes_per_lap;
    truth.push_back(
        {rotation_exp({0, 0, angle}), {2 * std::cos(angle), 2 * std::sin(angle), 0.1 * std::sin(3 * angle)}});
  }
  Run run{{truth[0]}, {}, {}};
  const auto measure = [&](int from, int to, bool loop, bool right) {
    Pose pose = retract(truth[from].inverse() * truth[to], normals(kTurnSigma, kShiftSigma_m));
    if (!right) pose = retract(pose, run.edges.size() % 2 ? normals(0.3, 1) : normals(0.01, 0.03));
    run.edges.push_back({from, to, pose, diagonal.asDiagonal(), loop});
    run.truths.push_back(right);
  };
  for (int i = 0; i + 1 < keyframes; ++i) {
    measure(i, i + 1, false, true);
    run.dead_reckoning.push_back(run.dead_reckoning.back() * run.edges.back().from_from_to);
  }
  for (int i = 0; i < loops; ++i) {
    const int from = keyframes_per_lap + (keyframes - keyframes_per_lap) * i / loops;
    measure(from, from - keyframes_per_lap, true, i % one_wrong_in != 0);
  }
  return run;
}

std::vector<Row> pose_graph_rows(const Context& context) {
  const Run run = long_run(1000, 125, 100, 5);
  PoseGraphResult result;
  const auto times =
      interleaved_times({[&] { result = optimise_poses(run.dead_reckoning, run.edges, {}); }}, context.quick ? 3 : 9);
  std::fprintf(stderr, "  %d iterations, cost %.4g -> %.4g, every loop %s\n", result.iterations, result.initial_cost,
               result.cost, result.converged && result.weights == run.truths ? "judged right" : "judged WRONG");
  return {median_row("speed.pose_graph", in_ms(times[0]), "ms", 1000)};
}

// Adds one keyframe to a graph as large as that of a long mission.
std::vector<Row> growing_graph_rows(const Context& context) {
  constexpr int kKeyframes = 2000, kLoops = 3000;
  const Run run = long_run(kKeyframes, 125, kLoops, 100);
  std::vector<PoseEdge> edges, added;
  for (const PoseEdge& edge : run.edges) (std::max(edge.from, edge.to) < kKeyframes - 1 ? edges : added).push_back(edge);
  PoseGraphResult before;
  const double whole_s = seconds_of([&] {
    before = optimise_poses({run.dead_reckoning.begin(), run.dead_reckoning.end() - 1}, edges, {});
  });
  std::vector<Pose> poses = before.poses;
  for (const PoseEdge& edge : added) {
    if (!edge.loop) poses.push_back(poses[static_cast<size_t>(edge.from)] * edge.from_from_to);
  }
  edges.insert(edges.end(), added.begin(), added.end());
  PoseGraphResult result;
  const auto times =
      interleaved_times({[&] { result = optimise_poses(poses, edges, {}, before.weights); }}, context.quick ? 3 : 15);
  std::fprintf(stderr, "  %zu links, %zu of them new; the whole graph takes %.0f ms; %s\n", edges.size(), added.size(),
               1e3 * whole_s, result.all_tested ? "all loops tested" : "new loops tested");
  return {median_row("scale.graph", in_ms(times[0]), "ms", 200)};
}

// One frame from poses that differ like those of a slow robot.
std::vector<Row> surface_rows(const Context& context) {
  const FramePair pair = rendered_frames("rubble_pile", 3, {});
  const int repeats = context.quick ? 5 : 25;
  SurfaceModel model(pair.rig, {});
  std::vector<double> first, alone, steady;
  for (int i = 0; i < repeats; ++i) {
    std::vector<PosedFrame> together;
    for (uint64_t k = 0; k < kMaxFusedFrames; ++k)
      together.push_back({pair.target, random_motion(0.05, 0.0005, 1, kMaxFusedFrames * static_cast<uint64_t>(i) + k)});
    model = SurfaceModel(pair.rig, {});
    first.push_back(seconds_of([&] { model.add(together); }) / kMaxFusedFrames);
    steady.push_back(seconds_of([&] { model.add(together); }) / kMaxFusedFrames);
    alone.push_back(seconds_of([&] { model.add(together[0].frame, together[0].world_from_camera); }));
  }
  SurfaceMesh mesh;
  const double extraction_s = seconds_of([&] { mesh = model.mesh(); });
  double area_m2 = 0;
  for (const auto& triangle : mesh.triangles) {
    const auto at = [&](size_t i) { return Eigen::Vector3d(mesh.vertices[triangle[i]].position_m.cast<double>()); };
    const Eigen::Vector3d a = at(1) - at(0), b = at(2) - at(0);
    area_m2 += std::sqrt(a.squaredNorm() * b.squaredNorm() - a.dot(b) * a.dot(b)) / 2;
  }
  std::fprintf(stderr,
               "  eight at a time: first %.1f ms, then %.1f ms, single %.1f ms; %zu triangles in %.0f ms; "
               "%.2f MiB/dm^2 over %.1f dm^2\n",
               1e3 * median(first), 1e3 * median(steady), 1e3 * median(alone), mesh.triangles.size(),
               1e3 * extraction_s, static_cast<double>(model.memory_bytes()) / (100 * area_m2) / 1048576,
               100 * area_m2);
  return {median_row("speed.surface", in_ms(steady), "ms", 15)};
}

}  // namespace

std::vector<Item> mapping_speed_items() {
  return {
      {{"speed.pose_graph"}, "pose graph of 1,000 keyframes and 100 loop closures, 20 of them false", pose_graph_rows},
      {{"scale.graph"}, "one more keyframe in a pose graph of 2,000 keyframes and 3,000 loop closures", growing_graph_rows},
      {{"speed.surface"}, "a frame of 532 x 500 into the fused surface", surface_rows}};
}

}  // namespace fringeslam::bench
