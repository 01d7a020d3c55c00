// SPDX-License-Identifier: Apache-2.0
// Rendering compared with bare Embree: the same rays, in the same packets and order, on the same threads, interleaved.

#include <chrono>
#include <cstdio>

#include "bench/process_memory.h"
#include "bench/row.h"
#include "bench/speed/interleaving.h"
#include "bench/speed/rubble.h"
#include "sim/light/ray_tracing_baseline.h"
#include "sim/virtual_rig.h"

namespace fringeslam::bench {

namespace {

std::vector<Row> render_rows(const Context& context) {
  const sim::Scene scene = rubble(4);
  const sim::Renderer renderer(scene, {}, 4);
  const sim::RayTracingBaseline bare(scene, renderer);
  Stack stack(scene, 3);
  const auto times = interleaved_times({[&] { bare(); }, [&] { stack(); }}, context.quick ? 5 : 25);
  const double rays = static_cast<double>(bare.count());
  std::fprintf(stderr,
               "  %.2f million rays; bare Embree %.1f ms, %.1f Mray/s; three images with truth %.1f ms, %.1f Mray/s\n",
               1e-6 * rays, 1e3 * median(times[0]), 1e-6 * rays / median(times[0]), 1e3 * median(times[1]),
               1e-6 * rays / median(times[1]));
  return {median_row("speed.render", ratios(times[0], times[1]), "of bare Embree", 0.6, Limit::least)};
}

std::vector<Row> pattern_rows(const Context& context) {
  const sim::Scene scene = rubble(4);
  Stack one(scene, 1), nine(scene, 9);
  const auto times = interleaved_times({[&] { one(); }, [&] { nine(); }}, context.quick ? 5 : 25);
  std::fprintf(stderr, "  one pattern %.1f ms, nine %.1f ms\n", 1e3 * median(times[0]), 1e3 * median(times[1]));
  return {median_row("speed.patterns", ratios(times[1], times[0]), "x", 1.5)};
}

// Time of three images as a function of the number of triangles (up to 1000 times) and samples; memory of the geometry.
std::vector<Row> scaling_rows(const Context& context) {
  std::vector<double> seconds, memory;
  for (const int subdivisions : {2, 4, 5, context.quick ? 6 : 7}) {
    const sim::Scene scene = rubble(subdivisions);
    double triangles = 0;
    for (const sim::Object& object : scene.objects) triangles += static_cast<double>(object.mesh->triangles.size());
    const double before = process_memory_mib("VmRSS");
    const auto build_start = std::chrono::steady_clock::now();
    const sim::RayScene world(scene);
    const double build = std::chrono::duration<double>(std::chrono::steady_clock::now() - build_start).count();
    memory.push_back((process_memory_mib("VmRSS") - before) / (1e-6 * triangles));
    Stack stack(scene, 3);
    seconds.push_back(median(interleaved_times({[&] { stack(); }}, context.quick ? 3 : 7)[0]));
    std::fprintf(stderr, "  %10.0f triangles: %.0f ms, BVH built in %.1f s, %.0f MiB per million\n", triangles,
                 1e3 * seconds.back(), build, memory.back());
  }
  const sim::Scene scene = rubble(4);
  std::vector<double> by_samples;
  for (const int samples : {1, 4, 16, 64}) {
    sim::RenderOptions options;
    options.samples_per_pixel = samples;
    Stack stack(scene, 3, options);
    by_samples.push_back(median(interleaved_times({[&] { stack(); }}, context.quick ? 3 : 7)[0]));
    std::fprintf(stderr, "  %10d samples per pixel: %.0f ms\n", samples, 1e3 * by_samples.back());
  }
  return {bound_row("speed.scaling.triangles", seconds.back() / seconds.front(), 1, "x", 10, Limit::most),
          bound_row("speed.scaling.samples", by_samples[3] / by_samples[1], 1, "x", 16, Limit::most),
          bound_row("speed.scaling.memory", memory.back(), 1, "MiB", 300, Limit::most)};
}

}  // namespace

std::vector<Item> rendering_items() {
  return {{{"speed.render"}, "a stack of three images, ray rate relative to bare Embree", render_rows},
          {{"speed.patterns"}, "nine patterns relative to one", pattern_rows},
          {{"speed.scaling.triangles", "speed.scaling.samples", "speed.scaling.memory"},
           "three images: 1000 times the triangles, 16 times the samples; memory per million triangles",
           scaling_rows}};
}

}  // namespace fringeslam::bench
