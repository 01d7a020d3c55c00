// SPDX-License-Identifier: Apache-2.0
// Large scenes, from the scene file to the ray tracer's BVH: time and peak memory.
#include <malloc.h>

#include <chrono>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "bench/process_memory.h"
#include "bench/row.h"
#include "bench/speed/interleaving.h"
#include "core/io/files.h"
#include "core/types/error.h"
#include "sim/light/ray_scene.h"
#include "sim/scene/scene.h"

namespace fringeslam::bench {

namespace {

namespace fs = std::filesystem;

// A pile of stones of 20 * 4^detail triangles each.
fs::path stone_scene(int count, int detail, int variants) {
  const fs::path file = fs::temp_directory_path() / "fringeslam-bench-pile.yaml";
  std::ostringstream text;
  text << "name: stones\nrig: {file: " << FRINGESLAM_SCENES << "/rigs/thesis.yaml}\n"
       << "patterns: {steps: 3, periods_px: [16.5]}\nmaterials: {stone: {grain: stone, albedo: 0.5}}\n"
       << "objects:\n  - {shape: plane, size_m: [2, 2], material: stone}\n"
       << "  - {shape: pile, count: " << count
       << ", area_m: [1, 1], walls_m: 0.3, items: [{shape: stone, detail: " << detail << ", variants: " << variants
       << ", size_min_m: [0.05, 0.04, 0.03], size_max_m: [0.1, 0.09, 0.07], material: stone}]}\ntrajectory: {}\n";
  write_text(file, text.str());
  return file;
}

double peak_mib() { return process_memory_mib("VmHWM"); }
// Returns unused memory to the system and forgets the peak so far; returns what remains in use, of earlier rows.
double reset_peak_mib() {
  malloc_trim(0);
  std::ofstream forget("/proc/self/clear_refs");
  if (!(forget << 5 << std::flush))
    throw Error("/proc/self/clear_refs cannot be written; run this row outside a container");
  return process_memory_mib("VmRSS");
}

struct Loading {
  double seconds = 0, triangles = 0;
  double peak_mib = 0;  // of the process, since just before the file was first read, above what it used then
};

Loading loading(const fs::path& file) {
  Loading result;
  result.seconds = seconds_of([&] {
    const sim::Scene scene = sim::load_scene(file);
    const sim::RayScene world(scene);
    for (const sim::Object& object : scene.objects)
      result.triangles += static_cast<double>(object.mesh->triangles.size());
  });
  return result;
}

std::vector<Row> world_rows(const Context& context) {
  const int repeats = context.quick ? 1 : 5;
  const auto measured = [&](const char* what, const fs::path& file) {
    const double before_mib = reset_peak_mib();
    const double first = seconds_of([&] { sim::load_scene(file); });  // settles the pile unless it is in the cache
    std::vector<double> seconds;
    Loading last;
    for (int i = 0; i < repeats; ++i) seconds.push_back((last = loading(file)).seconds);
    last.seconds = median(seconds);
    last.peak_mib = peak_mib() - before_mib;
    std::fprintf(stderr, "  %s: %.2f million triangles; first load %.1f s, then %.2f s to the BVH, %.0f MiB\n", what,
                 1e-6 * last.triangles, first, last.seconds, last.peak_mib);
    return last;
  };
  const Loading pile = measured("196 different stones", stone_scene(196, 4, 0));
  const Loading shared = measured("128 stones of 10 kinds", stone_scene(128, 6, 10));
  return {bound_row("speed.worlds.pile", pile.seconds, repeats, "s", 5, Limit::most),
          bound_row("speed.worlds.memory", pile.peak_mib, repeats, "MiB", 1024, Limit::most),
          bound_row("speed.worlds.shared", shared.peak_mib, repeats, "MiB", 2048, Limit::most)};
}

}  // namespace

std::vector<Item> large_world_items() {
  return {{{"speed.worlds.pile", "speed.worlds.memory", "speed.worlds.shared"},
           "a pile of a million triangles from its file to the BVH; ten million in shared meshes",
           world_rows}};
}

}  // namespace fringeslam::bench
