// SPDX-License-Identifier: Apache-2.0
#include "bench/repeating_scenes.h"

#include <cmath>
#include <functional>
#include <memory>
#include <numbers>
#include <random>
#include <utility>

#include "sim/scene/furniture.h"
#include "sim/scene/mesh.h"

namespace fringeslam::bench {

namespace {

using sim::Grain;
using sim::Material;

constexpr double kExtent_m = 0.66;  // of the structure; the sensor sees 0.26 m

Material matt(double albedo, Grain grain = Grain::plain, double contrast = 0) {
  Material material;
  material.grain = grain;
  material.albedo = albedo;
  material.contrast = contrast;
  material.grain_m = 0.008;
  return material;
}

// All objects of a scene share one texture seed, so that equal objects look equal.
struct Builder {
  sim::Scene scene;

  void add(sim::Mesh mesh, const Material& material, const Eigen::Vector3d& at = Eigen::Vector3d::Zero()) {
    sim::Object object;
    object.name = "object " + std::to_string(scene.objects.size() + 1);
    object.mesh = std::make_shared<const sim::Mesh>(std::move(mesh));
    object.world_from_object.translation = at;
    object.material = material;
    object.texture_seed = 1;
    scene.objects.push_back(std::move(object));
  }
  void floor(const Material& material) { add(sim::plane_mesh(2 * kExtent_m, 2 * kExtent_m), material); }
  // Copies of a box on the floor in a square grid.
  void grid(const Eigen::Vector3d& size, double period_m, double extent_m, const Material& material) {
    const int half = static_cast<int>(0.5 * extent_m / period_m);
    for (int i = -half; i <= half; ++i) {
      for (int j = -half; j <= half; ++j)
        add(sim::box_mesh(size), material, {i * period_m, j * period_m, 0.5 * size.z()});
    }
  }
  void plate(double period_m, double height_m, const Material& material) {
    const int cells = 2 * static_cast<int>(0.5 * kExtent_m / period_m);
    add(sim::lattice_mesh(cells * period_m, cells * period_m, 0.003, cells, cells, 0.45), material, {0, 0, height_m});
  }
  void print(Grain grain, double period_m) {
    Material print = matt(0.7, grain);
    print.columns = print.rows = static_cast<int>(kExtent_m / period_m);
    print.spacing_m = period_m;
    print.diameter_m = 0.5 * period_m;
    print.print_albedo = 0.25;
    floor(print);
  }
};

struct Kind {
  const char* name;
  double period_m;
  std::function<void(Builder&, double)> build;
};

const std::vector<Kind>& kinds() {
  static const std::vector<Kind> all = {
      {"perforated plate", 0.015,
       [](Builder& b, double p) {
         b.floor(matt(0.4));
         b.plate(p, 0.02, matt(0.55));
       }},
      {"coarse perforated plate", 0.04,
       [](Builder& b, double p) {
         b.floor(matt(0.4));
         b.plate(p, 0.03, matt(0.5));
       }},
      {"tiles", 0.03,
       [](Builder& b, double p) {
         b.floor(matt(0.35));
         b.grid({p - 0.003, p - 0.003, 0.0015}, p, kExtent_m, matt(0.6));
       }},
      {"tiles with equal decor", 0.06,
       [](Builder& b, double p) {
         b.floor(matt(0.35));
         b.grid({p - 0.003, p - 0.003, 0.002}, p, kExtent_m, matt(0.5, Grain::stone, 0.4));
       }},
      {"printed checkerboard", 0.012, [](Builder& b, double p) { b.print(Grain::checkerboard, p); }},
      {"printed dots", 0.02, [](Builder& b, double p) { b.print(Grain::circles, p); }},
      {"equal cartons", 0.092,
       [](Builder& b, double p) {
         b.floor(matt(0.4));
         b.grid({0.05, 0.04, 0.03}, p, kExtent_m, matt(0.5, Grain::cardboard, 0.35));
       }},
      {"equal blocks", 0.045,
       [](Builder& b, double p) {
         b.floor(matt(0.45));
         b.grid({0.025, 0.025, 0.02}, p, kExtent_m, matt(0.55));
       }},
      {"equal blocks and a stone", 0.045,
       [](Builder& b, double p) {
         b.floor(matt(0.45));
         b.grid({0.025, 0.025, 0.02}, p, kExtent_m, matt(0.55));
         b.add(sim::rock_mesh({0.035, 0.03, 0.06}, 3, 0.25, 3), matt(0.6, Grain::stone, 0.4), {0.022, 0.02, 0.01});
       }},
      {"tiles on a faint grain", 0.03,
       [](Builder& b, double p) {
         b.floor(matt(0.35, Grain::concrete, 0.1));
         b.grid({p - 0.004, p - 0.004, 0.0015}, p, kExtent_m, matt(0.6));
       }},
      {"grating of bars", 0.024,
       [](Builder& b, double p) {
         b.floor(matt(0.4, Grain::concrete, 0.03));
         const int half = static_cast<int>(0.5 * kExtent_m / p);
         for (int i = -half; i <= half; ++i)
           b.add(sim::box_mesh({0.5 * p, kExtent_m, 0.02}), matt(0.55, Grain::metal, 0.1), {i * p, 0, 0.02});
       }},
      {"cartons with decor on a printed floor", 0.05,
       [](Builder& b, double p) {
         b.print(Grain::circles, 0.5 * p);
         b.grid({0.03, 0.03, 0.025}, p, kExtent_m, matt(0.5, Grain::wood, 0.4));
       }},
  };
  return all;
}

}  // namespace

int repeating_scene_count() { return static_cast<int>(kinds().size()); }

RepeatingScene repeating_scene(int number) {
  const Kind& kind = kinds()[static_cast<size_t>(number)];
  Builder builder{sim::load_scene(FRINGESLAM_SCENES "/boxes_and_foam/scene.yaml")};
  builder.scene.objects.clear();
  kind.build(builder, kind.period_m);
  return {kind.name, kind.period_m, std::move(builder.scene)};
}

std::vector<Pose> cameras_above(const RepeatingScene& repeating, int count, uint64_t seed) {
  constexpr double kRadPerDeg = std::numbers::pi / 180, kTilt = 6, kTurn = 12, kNear_m = 0.95, kFar_m = 1.08;
  std::mt19937_64 random(seed);
  const auto uniform = [&](double low, double high) {
    return low + (high - low) * static_cast<double>(random() >> 11) / 9007199254740992.0;
  };
  std::vector<Pose> poses;
  for (int i = 0; i < count; ++i) {
    const double most_m = 0.75 * repeating.period_m;
    const Eigen::Vector3d target(uniform(-most_m, most_m), uniform(-most_m, most_m), 0);
    Pose pose;
    pose.rotation = rotation_exp(kRadPerDeg * Eigen::Vector3d(uniform(-kTilt, kTilt), uniform(-kTilt, kTilt),
                                                              uniform(-kTurn, kTurn))) *
                    rotation_exp({std::numbers::pi, 0, 0});
    pose.translation = target - uniform(kNear_m, kFar_m) * pose.rotation.col(2);
    poses.push_back(pose);
  }
  return poses;
}

}  // namespace fringeslam::bench
