// SPDX-License-Identifier: Apache-2.0
// The thermal channel: registration, warm regions, shapes, and merging over several views.
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <limits>

#include "core/score/victim_score.h"
#include "core/thermal/registration.h"
#include "core/thermal/shape.h"
#include "core/thermal/victims.h"
#include "core/thermal/warm_regions.h"
#include "tests/support/scene.h"

namespace fringeslam {
namespace {

using support::Surface;

// The thermal camera of the tests: coarser than the camera, 60 mm to its left.
RigModel thermal_rig() {
  RigModel rig = support::small_rig(false);
  ThermalCamera thermal;
  thermal.lens = {80, 75, rig.camera.fx * 0.55, rig.camera.fx * 0.55, 39.5, 37, {}};
  thermal.thermal_from_camera.translation = {0.06, 0, 0};
  rig.thermal = thermal;
  return rig;
}

// Simulated thermal image of surfaces whose temperature is a function of the point; exact, without noise.
cv::Mat1f thermal_view(const Surface& surface, const RigModel& rig,
                       const std::function<double(const Eigen::Vector3d&)>& temperature_c) {
  const Pinhole& lens = rig.thermal->lens;
  const Pose camera_from_thermal = rig.thermal->thermal_from_camera.inverse();
  cv::Mat1f image(lens.height, lens.width, 15.0f);
  for (int row = 0; row < lens.height; ++row) {
    for (int col = 0; col < lens.width; ++col) {
      const Eigen::Vector3d ray = camera_from_thermal.rotation * lens.undistort({col, row}).homogeneous();
      if (const auto hit = surface(camera_from_thermal.translation, ray))
        image(row, col) = static_cast<float>(temperature_c(hit->point));
    }
  }
  return image;
}

Frame frame_of(const Surface& surface, const RigModel& rig) { return support::observe(surface, rig, {}, 1e-4); }

Surface sphere(const Eigen::Vector3d& middle, double radius) {
  return [=](const Eigen::Vector3d& origin, const Eigen::Vector3d& direction) -> std::optional<support::Hit> {
    const Eigen::Vector3d o = origin - middle;
    const double a = direction.squaredNorm(), b = o.dot(direction), c = o.squaredNorm() - radius * radius;
    if (b * b < a * c) return std::nullopt;
    const double t = (-b - std::sqrt(b * b - a * c)) / a;
    if (t <= 0) return std::nullopt;
    const Eigen::Vector3d point = origin + t * direction;
    return support::Hit{t, point, (point - middle) / radius};
  };
}

// An open cylinder between two heights along its axis.
Surface cylinder(const Eigen::Vector3d& middle, const Eigen::Vector3d& axis, double radius, double length) {
  return [=](const Eigen::Vector3d& origin, const Eigen::Vector3d& direction) -> std::optional<support::Hit> {
    const Eigen::Vector3d o = origin - middle;
    const Eigen::Vector3d across = direction - axis * axis.dot(direction), start = o - axis * axis.dot(o);
    const double a = across.squaredNorm(), b = start.dot(across), c = start.squaredNorm() - radius * radius;
    if (b * b < a * c) return std::nullopt;
    const double t = (-b - std::sqrt(b * b - a * c)) / a;
    const Eigen::Vector3d point = origin + t * direction;
    if (t <= 0 || std::abs(axis.dot(point - middle)) > length / 2) return std::nullopt;
    const Eigen::Vector3d from_axis = point - middle - axis * axis.dot(point - middle);
    return support::Hit{t, point, from_axis.normalized()};
  };
}

// A rectangle in a plane perpendicular to z.
Surface plate(const Eigen::Vector3d& middle, double half_x, double half_y) {
  return [=](const Eigen::Vector3d& origin, const Eigen::Vector3d& direction) -> std::optional<support::Hit> {
    const double t = (middle.z() - origin.z()) / direction.z();
    const Eigen::Vector3d point = origin + t * direction;
    if (t <= 0 || std::abs(point.x() - middle.x()) > half_x || std::abs(point.y() - middle.y()) > half_y)
      return std::nullopt;
    return support::Hit{t, point, {0, 0, -1}};
  };
}

// An object in front of a wall of another temperature.
struct World {
  Surface thing;
  double thing_c = 33, wall_c = 15;
  Surface all() const { return support::nearest_of({thing, support::plane({0, 0, -1}, -1.1)}); }
  cv::Mat1f thermal(const RigModel& rig) const {
    return thermal_view(all(), rig, [&](const Eigen::Vector3d& p) { return p.z() < 1.0999 ? thing_c : wall_c; });
  }
  WarmView warm(const RigModel& rig, const ThermalOptions& options = {}) const {
    const Frame frame = frame_of(all(), rig);
    return find_warm_regions(frame, register_thermal(frame.points_m, thermal(rig), rig, options), rig, options);
  }
};

// A temperature ramp on a slanted wall: each point gets its own temperature, up to the ramp's steps between pixels.
TEST(Registration, EachPointHasItsTemperature) {
  const RigModel rig = thermal_rig();
  const Surface wall = support::plane(Eigen::Vector3d(0.3, 0.1, -1).normalized(), -1);
  const auto ramp = [](const Eigen::Vector3d& p) { return 20 + 40 * p.x() - 25 * p.y(); };
  const Frame frame = frame_of(wall, rig);
  const RegisteredThermal thermal = register_thermal(frame.points_m, thermal_view(wall, rig, ramp), rig, {});
  int known = 0;
  for (int row = 0; row < frame.height(); ++row) {
    for (int col = 0; col < frame.width(); ++col) {
      const float t = thermal.temperature_c(row, col);
      if (std::isnan(t)) continue;
      ++known;
      const cv::Vec3f p = frame.points_m(row, col);
      const Eigen::Vector3d point(p[0], p[1], p[2]);
      const Eigen::Vector2d pixel = rig.thermal->lens.project(rig.thermal->thermal_from_camera * point);
      if (pixel.x() < 0 || pixel.y() < 0 || pixel.x() > 79 || pixel.y() > 74) continue;  // outer half of border pixels
      EXPECT_NEAR(t, ramp(point), 0.005) << row << " " << col;
    }
  }
  EXPECT_GT(known, frame.height() * frame.width() / 2);
}

// A cold plate in front of a warm wall: points of the wall that the plate hides from the thermal camera but not from
// the camera must have no temperature, in particular not the plate's.
TEST(Registration, HiddenPointsHaveNoTemperature) {
  const RigModel rig = thermal_rig();
  const World world{plate({0, 0, 0.8}, 0.04, 0.04), 10, 30};
  const Frame frame = frame_of(world.all(), rig);
  const RegisteredThermal thermal = register_thermal(frame.points_m, world.thermal(rig), rig, {});
  const Eigen::Vector3d eye = rig.thermal->thermal_from_camera.inverse().translation;
  const double pixel_m = 1.1 / rig.thermal->lens.fx;
  int hidden = 0;
  for (int row = 0; row < frame.height(); ++row) {
    for (int col = 0; col < frame.width(); ++col) {
      const cv::Vec3f p = frame.points_m(row, col);
      if (!(p[2] > 1.09f)) continue;
      // Consider points where the line from the thermal camera passes through the plate, more than a pixel from its
      // edge.
      const Eigen::Vector3d point(p[0], p[1], p[2]);
      const Eigen::Vector3d at = eye + (point - eye) * (0.8 - eye.z()) / (point.z() - eye.z());
      if (std::abs(at.x()) > 0.04 - pixel_m || std::abs(at.y()) > 0.04 - pixel_m) continue;
      ++hidden;
      EXPECT_TRUE(std::isnan(thermal.temperature_c(row, col))) << row << " " << col;
    }
  }
  EXPECT_GT(hidden, 50);
}

TEST(Registration, AnImageOfAnotherSizeIsRefused) {
  const RigModel rig = thermal_rig();
  EXPECT_THROW(register_thermal(cv::Mat3f(125, 133), cv::Mat1f(10, 10), rig, {}), Error);
  EXPECT_THROW(register_thermal(cv::Mat3f(125, 133), cv::Mat1f(10, 10), support::small_rig(false), {}), Error);
}

const WarmRegion& largest(const WarmView& view) {
  return *std::max_element(view.list.begin(), view.list.end(),
                           [](const auto& a, const auto& b) { return a.area_m2 < b.area_m2; });
}

TEST(WarmRegions, ASphereAsWarmAsSkinIsACandidate) {
  const WarmView view = World{sphere({0, 0, 0.95}, 0.05)}.warm(thermal_rig());
  ASSERT_FALSE(view.list.empty());
  EXPECT_NEAR(view.surroundings_c, 15, 1e-3);
  const WarmRegion& region = largest(view);
  EXPECT_TRUE(region.candidate()) << region.reason;
  EXPECT_NEAR(region.warmest_c, 33, 1e-3);
  // Seen from 0.95 m: the cap up to the tangents, 2 pi r^2 (1 - r / d), less what lies at grazing angles or is mixed.
  const double cap_m2 = 2 * M_PI * 0.05 * 0.05 * (1 - 0.05 / 0.95);
  EXPECT_LT(region.area_m2, 1.05 * cap_m2);
  EXPECT_GT(region.area_m2, 0.5 * cap_m2);
  EXPECT_NEAR(region.centre_m.x(), 0, 0.01);
}

TEST(WarmRegions, TemperatureGates) {
  const auto kind = [&](double temperature_c) {
    return largest(World{sphere({0, 0, 0.95}, 0.05), temperature_c}.warm(thermal_rig())).kind;
  };
  EXPECT_EQ(kind(20), WarmKind::too_cold);
  EXPECT_EQ(kind(33), WarmKind::skin);
  EXPECT_EQ(kind(42), WarmKind::too_hot);
  EXPECT_EQ(kind(90), WarmKind::too_hot);
}

// At the rim of a hot object, pixels mix it with the surroundings and appear as warm as skin.
TEST(WarmRegions, TheRimOfAHotThingIsNoCandidate) {
  const RigModel rig = thermal_rig();
  World world{sphere({0, 0, 0.95}, 0.05), 90};
  cv::Mat1f blurred = world.thermal(rig);
  cv::Mat1f copy = blurred.clone();
  for (int row = 1; row + 1 < copy.rows; ++row) {
    for (int col = 1; col + 1 < copy.cols; ++col)
      blurred(row, col) = static_cast<float>(cv::mean(copy(cv::Rect(col - 1, row - 1, 3, 3)))[0]);
  }
  const Frame frame = frame_of(world.all(), rig);
  const WarmView view = find_warm_regions(frame, register_thermal(frame.points_m, blurred, rig, {}), rig, {});
  ASSERT_FALSE(view.list.empty());
  for (const WarmRegion& region : view.list) EXPECT_FALSE(region.candidate()) << region.reason;
}

TEST(WarmRegions, NothingIsWarmWhereAllIsAlike) {
  EXPECT_TRUE((World{sphere({0, 0, 0.95}, 0.05), 30, 30}.warm(thermal_rig()).list.empty()));
}

TEST(WarmRegions, SizeGates) {
  const auto kind = [&](double radius_m, const ThermalOptions& options) {
    return largest(World{sphere({0, 0, 0.95}, radius_m)}.warm(thermal_rig(), options)).kind;
  };
  ThermalOptions options;
  options.min_area_m2 = 0.003;
  EXPECT_EQ(kind(0.02, options), WarmKind::too_small);
  EXPECT_EQ(kind(0.05, options), WarmKind::skin);
  options.max_area_m2 = 0.004;
  EXPECT_EQ(kind(0.05, options), WarmKind::too_large);
}

TEST(WarmRegions, APlateIsFlat) {
  const WarmView view = World{plate({0, 0, 0.95}, 0.05, 0.04)}.warm(thermal_rig());
  EXPECT_EQ(largest(view).kind, WarmKind::flat);
  EXPECT_NEAR(largest(view).area_m2, 0.1 * 0.08, 0.002);
}

TEST(WarmRegions, ACylinderIsAPipe) {
  const Eigen::Vector3d axis = Eigen::Vector3d(1, 0.4, 0.2).normalized();
  const WarmView view = World{cylinder({0, 0, 0.95}, axis, 0.02, 0.16)}.warm(thermal_rig());
  EXPECT_EQ(largest(view).kind, WarmKind::pipe) << largest(view).reason;
}

// A pipe half sunk into a plate of the same temperature is a region of its own. Each keeps its pixels without a normal.
TEST(WarmRegions, PixelsWithoutANormalStayWithWhatTheyLieOn) {
  const RigModel rig = thermal_rig();
  const World world{
      support::nearest_of({plate({-0.02, 0, 0.98}, 0.09, 0.04), cylinder({-0.02, 0, 0.99}, {1, 0, 0}, 0.02, 0.16)})};
  Frame frame = frame_of(world.all(), rig);
  const cv::Rect on_pipe(53, 60, 6, 4), on_plate(53, 76, 6, 4);
  for (const cv::Rect& part : {on_pipe, on_plate})
    frame.normals(part).setTo(cv::Scalar::all(std::numeric_limits<double>::quiet_NaN()));
  ThermalOptions options;
  options.crease_radius_m = 1e-4;  // the crease between them does not separate them
  const WarmView view =
      find_warm_regions(frame, register_thermal(frame.points_m, world.thermal(rig), rig, options), rig, options);
  const auto region_of = [&](const cv::Rect& part) {
    const int beside = view.regions(part.y, part.x - 4);
    EXPECT_EQ(cv::countNonZero(view.regions(part) != beside), 0) << part;
    return beside;
  };
  const int pipe = region_of(on_pipe), flat = region_of(on_plate);
  ASSERT_TRUE(pipe >= 0 && flat >= 0);
  EXPECT_EQ(view.list[static_cast<size_t>(pipe)].kind, WarmKind::pipe);
  EXPECT_EQ(view.list[static_cast<size_t>(flat)].kind, WarmKind::flat);
}

// Two warm spheres adjacent in the image, one far behind the other.
TEST(WarmRegions, AStepInDepthEndsARegion) {
  const RigModel rig = thermal_rig();
  const World world{support::nearest_of({sphere({-0.03, 0, 0.8}, 0.035), sphere({0.04, 0, 1.0}, 0.05)})};
  const WarmView view = world.warm(rig);
  int candidates = 0;
  for (const WarmRegion& region : view.list) candidates += region.candidate();
  EXPECT_EQ(candidates, 2);
}

std::vector<SurfacePoint> patch_of(const std::function<SurfacePoint(double, double)>& at) {
  std::vector<SurfacePoint> patch;
  for (int i = 0; i < 40; ++i) {
    for (int k = 0; k < 40; ++k) patch.push_back(at(i / 39.0, k / 39.0));
  }
  return patch;
}

// `turned` is the arc as a fraction of a full turn; the pipe is 100 mm long.
std::vector<SurfacePoint> pipe_patch(double radius_m, double turned, double taper = 0) {
  const Eigen::Matrix3d r = rotation_exp(Eigen::Vector3d(0.3, -0.7, 0.4));
  return patch_of([&](double u, double v) {
    const double angle = 2 * M_PI * turned * (u - 0.5), radius = radius_m * (1 + taper * (v - 0.5));
    const Eigen::Vector3d out(std::cos(angle), std::sin(angle), 0);
    return SurfacePoint{r * (radius * out + Eigen::Vector3d(0, 0, 0.1 * v)) + Eigen::Vector3d(0.1, 0.2, 1), r * out};
  });
}

TEST(Shape, FitsTheCylinder) {
  for (const double radius_m : {0.01, 0.03, 0.05}) {
    const PipeFit fit = fit_pipe(pipe_patch(radius_m, 0.4), {});
    ASSERT_TRUE(fit.found);
    EXPECT_NEAR(fit.radius_m, radius_m, 1e-6);
    EXPECT_NEAR(fit.share, 1, 1e-9);
    EXPECT_NEAR(fit.length_m, 0.1, 0.006);
    EXPECT_NEAR(fit.width_m, 2 * radius_m * std::sin(0.4 * M_PI), 0.1 * radius_m);
  }
}

TEST(Shape, ATaperedArmIsNoCylinder) {
  const ThermalOptions options;
  EXPECT_LT(fit_pipe(pipe_patch(0.03, 0.4, 0.6), options).share, options.pipe_share);
}

TEST(Shape, PlanesHoldABoxAndNoCylinder) {
  const ThermalOptions options;
  const auto box = patch_of([](double u, double v) {
    const bool top = u < 0.6;
    return top ? SurfacePoint{{u, v, 1}, {0, 0, -1}} : SurfacePoint{{0.6, v, 1 + u - 0.6}, {1, 0, 0}};
  });
  EXPECT_NEAR(planar_share(box, options), 1, 1e-9);
  // Two planes cover 8 degrees to either side each, of 144 degrees.
  EXPECT_NEAR(planar_share(pipe_patch(0.01, 0.4), options), 32.0 / 144, 0.06);
  EXPECT_EQ(planar_share({}, options), 0);
}

// A pipe on a plate, and a tapered arm, no long part of which is a cylinder.
TEST(Shape, FindsThePipeInWhatItTouches) {
  std::vector<SurfacePoint> patch = pipe_patch(0.015, 0.4);
  const auto pipe = static_cast<std::ptrdiff_t>(patch.size());
  const auto plate = patch_of([](double u, double v) {
    return SurfacePoint{{0.1 + 0.1 * u, 0.25 + 0.1 * v, 1.02}, {0, 0, -1}};
  });
  patch.insert(patch.end(), plate.begin(), plate.end());
  const std::vector<char> on_pipe = find_long_pipe(patch, 0.25, {});
  ASSERT_EQ(on_pipe.size(), patch.size());
  EXPECT_GT(std::count(on_pipe.begin(), on_pipe.begin() + pipe, 1), pipe * 99 / 100);
  EXPECT_LT(std::count(on_pipe.begin() + pipe, on_pipe.end(), 1), pipe * 2 / 100);
  EXPECT_TRUE(find_long_pipe(plate, 0.25, {}).empty());
  EXPECT_TRUE(find_long_pipe(pipe_patch(0.033, 0.4, 0.4), 0.25, {}).empty());
}

WarmRegion region_at(const Eigen::Vector3d& centre_m, WarmKind kind, double area_m2) {
  WarmRegion region;
  region.kind = kind;
  region.reason = to_string(kind);
  region.centre_m = centre_m;
  region.points_m = {centre_m, centre_m + Eigen::Vector3d(0.02, 0, 0)};
  region.area_m2 = area_m2;
  return region;
}

TEST(Merging, OneThingInSeveralViewsIsOne) {
  const Pose second = pose_from({{200, 0, 0}, {0, 10, 0}});
  const Eigen::Vector3d world(0.1, 0, 1);
  const std::vector<WarmObject> things =
      merge_regions({{0, {}, {region_at(world, WarmKind::skin, 0.004)}},
                     {1, second, {region_at(second.inverse() * world, WarmKind::skin, 0.006)}}},
                    {});
  ASSERT_EQ(things.size(), 1u);
  EXPECT_TRUE(things[0].victim);
  EXPECT_EQ(things[0].views, 2);
  EXPECT_EQ(things[0].best_view, 1);
  EXPECT_LT((things[0].position_m - world).norm(), 1e-9);
}

TEST(Merging, MostOfWhatWasSeenDecides) {
  const Eigen::Vector3d at(0, 0, 1);
  const auto decide = [&](double skin_m2, double pipe_m2) {
    return merge_regions(
               {{0, {}, {region_at(at, WarmKind::skin, skin_m2)}}, {1, {}, {region_at(at, WarmKind::pipe, pipe_m2)}}},
               {})
        .at(0);
  };
  EXPECT_TRUE(decide(0.006, 0.004).victim);
  EXPECT_FALSE(decide(0.003, 0.006).victim);
  EXPECT_EQ(decide(0.003, 0.006).reason, "pipe");
}

// A square region perpendicular to z, of which an even grid of 64 points is known: `within` 0 to 1 places them in its cells.
WarmRegion square_region(const Eigen::Vector3d& corner_m, double side_m, WarmKind kind, double within = 0.5) {
  constexpr int kPoints = 8;
  WarmRegion region = region_at(corner_m, kind, side_m * side_m);
  region.points_m.clear();
  for (int i = 0; i < kPoints; ++i) {
    for (int k = 0; k < kPoints; ++k)
      region.points_m.push_back(corner_m + side_m / kPoints * Eigen::Vector3d(i + within, k + within, 0));
  }
  return region;
}

// The points of a large region are 5 cm apart, so those of another view lie up to 3.5 cm from the nearest one.
TEST(Merging, LargeThingsAreOneThoughTheirPointsAreFarApart) {
  const auto count = [](const WarmRegion& first, const WarmRegion& second) {
    return merge_regions({{0, {}, {first}}, {1, {}, {second}}}, {}).size();
  };
  const WarmRegion wall = square_region({0, 0, 1}, 0.4, WarmKind::too_large);
  EXPECT_EQ(count(wall, square_region({0, 0, 1}, 0.4, WarmKind::too_large, 0)), 1u);
  EXPECT_EQ(count(wall, square_region({0.03, 0, 1}, 0.34, WarmKind::skin, 0)), 1u);
  // Beside it, touching or 10 cm apart, and a hand 4 cm in front of it.
  EXPECT_EQ(count(wall, square_region({0.4, 0, 1}, 0.4, WarmKind::too_large, 0)), 2u);
  EXPECT_EQ(count(wall, square_region({0.5, 0, 1}, 0.4, WarmKind::too_large, 0)), 2u);
  EXPECT_EQ(count(wall, square_region({0.15, 0.15, 0.96}, 0.1, WarmKind::skin)), 2u);
}

TEST(Merging, ThingsApartStayApart) {
  const std::vector<WarmObject> things =
      merge_regions({{0,
                      {},
                      {region_at({0, 0, 1}, WarmKind::skin, 0.004), region_at({0.3, 0, 1}, WarmKind::flat, 0.01),
                       region_at({0.6, 0, 1}, WarmKind::too_small, 0.0001)}}},
                    {});
  ASSERT_EQ(things.size(), 2u);
  EXPECT_TRUE(things[0].victim);
  EXPECT_FALSE(things[1].victim);
}

TEST(Landmarks, HaveTheTemperatureOfTheirPixels) {
  const RigModel rig = thermal_rig();
  Frame frame = frame_of(support::plane({0, 0, -1}, -1), rig);
  cv::Mat1f temperature_c(frame.points_m.size(), 10.0f);
  temperature_c(cv::Rect(0, 0, 30, 20)) = 30.0f;
  temperature_c(cv::Rect(0, 0, 30, 5)) = std::numeric_limits<float>::quiet_NaN();
  WarmView warm;
  warm.surroundings_c = 10;
  warm.regions = cv::Mat1i(frame.points_m.size(), -1);
  warm.regions(cv::Rect(0, 5, 30, 15)) = 0;
  warm.list.resize(1);
  warm.list[0].pixels = 450;
  Landmarks landmarks;
  landmarks.landmarks.resize(2);
  landmarks.landmarks[0].outline = {{0, 0}, {29, 0}, {29, 34}, {0, 34}};  // 450 px at 30 degrees, 450 at 10
  landmarks.landmarks[1].outline = {{60, 60}, {80, 60}, {80, 80}, {60, 80}};
  const std::vector<LandmarkTemperature> temperatures = landmark_temperatures(temperature_c, warm, landmarks, {});
  ASSERT_EQ(temperatures.size(), 2u);
  const LandmarkTemperature& t = temperatures[0];
  EXPECT_EQ(t.pixels, 900);
  EXPECT_NEAR(t.mean_c, 20, 1e-6);
  EXPECT_NEAR(t.spread_c, 10, 1e-6);
  EXPECT_NEAR(t.warm_share, 0.5, 1e-6);
  EXPECT_EQ(t.p95_c, 30);
  EXPECT_EQ(t.max_c, 30);
  EXPECT_EQ(t.regions, std::vector<int>{0});
  EXPECT_EQ(temperatures[1].mean_c, 10);
  EXPECT_TRUE(temperatures[1].regions.empty());
}

// Ground truth of a view of a wall with a square victim of 0.1 m at 1 m.
TruthFrame truth_with_victim(const RigModel& rig) {
  TruthFrame truth = support::truth_of(support::plane({0, 0, -1}, -1), rig, {});
  truth.object_id.create(truth.mask.size());
  for (int row = 0; row < truth.mask.rows; ++row) {
    for (int col = 0; col < truth.mask.cols; ++col) {
      const Eigen::Vector2d slope = rig.camera.undistort({col, row});
      const bool here = std::abs(slope.x()) < 0.05 && std::abs(slope.y()) < 0.05;
      truth.object_id(row, col) = here ? 7 : 1;
      truth.mask(row, col) = kTruthSurface | kTruthInBeam | kTruthThermal | (here ? kTruthVictim : 0);
    }
  }
  return truth;
}

TEST(VictimScore, CountsWhatCouldBeFound) {
  const RigModel rig = support::small_rig(false);
  TruthFrame truth = truth_with_victim(rig);
  VisibleVictims visible;
  visible.add(truth, rig.camera, {});
  ASSERT_EQ(visible.all().size(), 1u);
  EXPECT_NEAR(visible.all().at(7).area_m2, 0.01, 0.0006);  // within one row and column of pixels

  // Points of a square of 40 mm around a position.
  const auto square = [](double x, double y, double z) {
    VictimCandidate points;
    for (int i = -2; i <= 2; ++i) {
      for (int k = -2; k <= 2; ++k) points.emplace_back(x + 0.01 * i, y + 0.01 * k, z);
    }
    return points;
  };
  const auto score = [&](const std::vector<VictimCandidate>& candidates) { return score_victims(visible, candidates); };
  EXPECT_EQ(score({}).to_find, 1);
  EXPECT_EQ(score({}).found, 0);
  EXPECT_TRUE(std::isnan(score({}).precision()));
  EXPECT_EQ(score({square(0.02, 0.02, 1.01)}).found, 1);
  EXPECT_EQ(score({square(0.02, 0.02, 1.03)}).right, 0);
  const VictimScore two = score({square(0, 0, 1), square(0.3, 0, 1)});
  EXPECT_EQ(two.found, 1);
  EXPECT_EQ(two.precision(), 0.5);
  EXPECT_EQ(two.wrong, std::vector<size_t>{1});
  // A single point on the victim is correct, but marks too little of it.
  EXPECT_EQ(score({{{0, 0, 1}}}).right, 1);
  EXPECT_EQ(score({{{0, 0, 1}}}).found, 0);

  VictimScoreOptions larger;
  larger.least_area_m2 = 0.02;
  EXPECT_EQ(score_victims(visible, {}, larger).to_find, 0);
  // Parts not lit by the projector or not seen by the thermal camera cannot be found.
  for (const int lacking : {kTruthInBeam, kTruthThermal}) {
    TruthFrame dark = truth_with_victim(rig);
    for (float& mask : dark.mask) mask = static_cast<float>(static_cast<int>(mask) & ~lacking);
    VisibleVictims none;
    none.add(dark, rig.camera, {});
    EXPECT_TRUE(none.all().empty());
  }
}

}  // namespace
}  // namespace fringeslam
