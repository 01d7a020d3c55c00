// SPDX-License-Identifier: Apache-2.0
// Distributions in scene files.
#include <gmock/gmock.h>

#include <cmath>
#include <set>

#include "core/io/files.h"
#include "sim/scene/scene.h"
#include "tests/support/matchers.h"
#include "tests/support/temp_folder.h"

namespace fringeslam::sim {
namespace {

using support::error_of;
using testing::HasSubstr;

class SceneDraws : public testing::Test {
 protected:
  // A board whose albedo, size and material may be drawn.
  std::filesystem::path file(const std::string& ambient, const std::string& material = "a",
                             const std::string& size = "[1, 1]") const {
    write_text(temp_ / "scene.yaml",
               "name: drawn\nrig: {file: " FRINGESLAM_SOURCE_DIR
               "/scenes/rigs/thesis.yaml}\n"
               "patterns: {steps: 3, periods_px: [16.5]}\nlight:\n  ambient_lux: " +
                   ambient +
                   "\nmaterials:\n  a: {grain: plain, albedo: 0.2}\n  b: {grain: plain, albedo: 0.8}\n"
                   "objects:\n  - {shape: plane, size_m: " +
                   size + ", material: " + material + "}\ntrajectory: {}\n");
    return temp_ / "scene.yaml";
  }
  double ambient(const std::string& text, uint64_t seed) const { return load_scene(file(text), {seed}).ambient_lux; }

  test::TempFolder temp_;
};

struct Moments {
  double mean = 0, variance = 0, low = 1e300, high = -1e300;
};

template <class Value>
Moments moments(const Value& value) {
  constexpr int kSeeds = 500;
  Moments m;
  double squares = 0;
  for (uint64_t seed = 1; seed <= kSeeds; ++seed) {
    const double x = value(seed);
    m.mean += x / kSeeds, squares += x * x / kSeeds;
    m.low = std::min(m.low, x), m.high = std::max(m.high, x);
  }
  m.variance = squares - m.mean * m.mean;
  return m;
}

TEST_F(SceneDraws, HaveTheMomentsOfTheirDistribution) {
  const Moments uniform = moments([&](uint64_t seed) { return ambient("{uniform: [100, 400]}", seed); });
  EXPECT_NEAR(uniform.mean, 250, 16);
  EXPECT_NEAR(uniform.variance, 300 * 300 / 12.0, 1100);
  EXPECT_GE(uniform.low, 100);
  EXPECT_LE(uniform.high, 400);
  const Moments normal = moments([&](uint64_t seed) { return ambient("{normal: [500, 50]}", seed); });
  EXPECT_NEAR(normal.mean, 500, 9);
  EXPECT_NEAR(std::sqrt(normal.variance), 50, 6);
  const Moments logarithms =
      moments([&](uint64_t seed) { return std::log10(ambient("{log_uniform: [1, 10000]}", seed)); });
  EXPECT_NEAR(logarithms.mean, 2, 0.2);
  EXPECT_NEAR(logarithms.variance, 16 / 12.0, 0.2);
  const Moments choice = moments([&](uint64_t seed) { return ambient("{choice: [1, 1, 4]}", seed); });
  EXPECT_NEAR(choice.mean, 2, 0.25);
}

TEST_F(SceneDraws, NormalIsCutOffWhereTheKeyEnds) {
  const Moments half = moments([&](uint64_t seed) { return ambient("{normal: [0, 100]}", seed); });
  EXPECT_GE(half.low, 0);
  EXPECT_NEAR(half.mean, 100 * std::sqrt(2 / 3.14159265), 9);
}

TEST_F(SceneDraws, SameSeedSameWorldAndPlacesAreIndependent) {
  const auto path = file("{uniform: [0, 1]}", "{choice: [a, b]}", "[{uniform: [0.5, 1]}, {uniform: [0.5, 1]}]");
  std::set<double> albedos;
  double product = 0, x = 0, y = 0;
  constexpr int kSeeds = 200;
  for (uint64_t seed = 1; seed <= kSeeds; ++seed) {
    const Scene scene = load_scene(path, {seed}), again = load_scene(path, {seed});
    EXPECT_EQ(scene.ambient_lux, again.ambient_lux);
    EXPECT_EQ(scene.resolved, again.resolved);
    albedos.insert(scene.objects[0].material.albedo);
    const Eigen::Vector3d corner = scene.objects[0].mesh->vertices[2].cwiseAbs();
    x += corner.x() / kSeeds, y += corner.y() / kSeeds, product += corner.x() * corner.y() / kSeeds;
  }
  EXPECT_EQ(albedos, (std::set<double>{0.2, 0.8}));
  EXPECT_LT(std::abs(product - x * y), 4 * 0.25 * 0.25 / 12 / std::sqrt(kSeeds));
}

// The resolved scene written with a run contains no distributions and describes the same scene.
TEST_F(SceneDraws, TheResolvedSceneIsThatWorld) {
  const Scene scene = load_scene(file("{normal: [300, 50]}", "{choice: [a, b]}", "[{uniform: [0.5, 1]}, 1]"), {7});
  EXPECT_EQ(scene.resolved.find("normal"), std::string::npos);
  EXPECT_EQ(scene.resolved.find("choice"), std::string::npos);
  write_text(temp_ / "scene.yaml", scene.resolved);
  for (const uint64_t seed : {7, 8}) {
    const Scene read = load_scene(temp_ / "scene.yaml", {seed});
    EXPECT_EQ(read.ambient_lux, scene.ambient_lux);
    EXPECT_EQ(read.objects[0].mesh->vertices, scene.objects[0].mesh->vertices);
    EXPECT_EQ(read.objects[0].material.albedo, scene.objects[0].material.albedo);
  }
}

TEST_F(SceneDraws, InvalidDistributionsAreRefused) {
  const std::string place = (temp_ / "scene.yaml").string() + ":5: ";
  const auto says = [&](const std::string& text, const std::string& what) {
    EXPECT_THAT(error_of([&] { load_scene(file(text)); }), testing::AllOf(testing::StartsWith(place), HasSubstr(what)));
  };
  says("{uniform: [5, 1]}", "smaller number first");
  says("{uniform: [1]}", "takes two numbers");
  says("{unifrom: [1, 2]}", "'unifrom' is not a distribution");
  says("{uniform: [-1, 2]}", "'ambient_lux' is -1");
  says("{log_uniform: [0, 2]}", "takes positive numbers");
  says("{normal: [1, -2]}", "a non-negative sigma");
  says("{normal: [-100000, 1]}", "almost never yields a permitted value");
  says("{uniform: [1, two]}", "must be a number");
  says("{uniform: 3}", "a number or a distribution");
  says("{choice: []}", "'choice' must not be empty");
}

}  // namespace
}  // namespace fringeslam::sim
