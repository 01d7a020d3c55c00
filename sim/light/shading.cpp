// SPDX-License-Identifier: Apache-2.0
#include "sim/light/shading.h"

#include <Eigen/Geometry>
#include <cmath>
#include <limits>
#include <optional>

#include "core/types/parallel.h"
#include "sim/random.h"

namespace fringeslam::sim {

namespace {

constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();

// Positions of the samples in the unit pixel, relative to its centre; they add up to zero. A turned grid: no two samples
// share a row or a column, so that an edge along either is shaded in as many steps as there are samples.
std::vector<Eigen::Vector2d> sample_offsets(int per_pixel) {
  if (per_pixel == 4) return {{-0.125, -0.375}, {0.375, -0.125}, {0.125, 0.375}, {-0.375, 0.125}};
  const int side = static_cast<int>(std::lround(std::sqrt(per_pixel)));
  std::vector<Eigen::Vector2d> offsets;
  for (int i = 0; i < side * side; ++i) {
    const int col = i % side, row = i / side;
    offsets.emplace_back((col + (row + 0.5) / side) / side - 0.5, (row + (side - col - 0.5) / side) / side - 0.5);
  }
  return offsets;
}

// How the projector lights a surface point.
struct Lighting {
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
  double irradiance = 0;  // cos(theta) / r^2, m^-2, regardless of shadow and beam
  bool in_beam = false, in_shadow = false;
};

class ProjectorLight {
 public:
  ProjectorLight(const RayWorld& world, const RigModel& rig, const Pose& world_from_camera)
      : world_(world),
        projector_(rig.projector),
        projector_from_world_(rig.projector_from_camera * world_from_camera.inverse()),
        position_(projector_from_world_.inverse().translation) {}

  Lighting operator()(const Hit& hit) const {
    Lighting lighting;
    const Eigen::Vector3d to_light = position_ - hit.point;
    const double r2 = to_light.squaredNorm();
    const double cosine = hit.normal.dot(to_light) / std::sqrt(r2);
    const Eigen::Vector3d in_projector = projector_from_world_ * hit.point;
    if (in_projector.z() > 0) {
      lighting.pixel = projector_.project(in_projector);
      lighting.in_beam = projector_.contains(lighting.pixel);
    }
    lighting.irradiance = std::max(cosine, 0.0) / r2;
    // A surface that faces away from the light is in its own shadow.
    lighting.in_shadow = cosine <= 0 || world_.occluded(hit, position_);
    return lighting;
  }

 private:
  const RayWorld& world_;
  const Pinhole& projector_;
  Pose projector_from_world_;
  Eigen::Vector3d position_;
};

Sample to_sample(const RayWorld& world, const Lighting& lighting, const Hit& hit) {
  const double albedo = world.albedo(hit);
  Sample sample;
  sample.ambient = static_cast<float>(albedo);
  if (lighting.in_beam && !lighting.in_shadow) {
    sample.beam = static_cast<float>(albedo * lighting.irradiance);
    sample.column = static_cast<float>(lighting.pixel.x());
    sample.row = static_cast<float>(lighting.pixel.y());
  }
  return sample;
}

// A ray's hit and its light; empty where the ray meets nothing.
struct LitHit {
  std::optional<Hit> hit;
  Lighting lighting;
};

// Two rays of one pixel that do not see one smooth, evenly lit surface.
bool differ(const LitHit& a, const LitHit& b) {
  constexpr double kCosine30 = 0.866;
  if (a.hit.has_value() != b.hit.has_value()) return true;
  if (!a.hit) return false;
  return a.hit->object != b.hit->object || a.lighting.in_shadow != b.lighting.in_shadow ||
         a.lighting.in_beam != b.lighting.in_beam || a.hit->normal.dot(b.hit->normal) < kCosine30;
}

void set_truth(TruthFrame& truth, int row, int col, const Hit& hit, const Lighting& lighting,
               const Pose& camera_from_world) {
  const Eigen::Vector3d normal = camera_from_world.rotation * hit.normal;
  truth.depth_m(row, col) = static_cast<float>(hit.distance);  // rays have d_z = 1
  truth.normals(row, col) = {static_cast<float>(normal.x()), static_cast<float>(normal.y()),
                             static_cast<float>(normal.z())};
  truth.object_id(row, col) = static_cast<float>(hit.object + 1);
  if (lighting.in_beam) truth.projector_column(row, col) = static_cast<float>(lighting.pixel.x());
  truth.mask(row, col) = static_cast<float>(kTruthSurface + (lighting.in_beam ? kTruthInBeam : 0) +
                                            (lighting.in_shadow ? kTruthInShadow : 0));
}

// The light of a pattern at a point of the projector's image: interpolated between pixel centres and clamped at the
// border; patterns of continuous intensity are exact everywhere.
class ShownPattern {
 public:
  ShownPattern(const Pattern& pattern, const PatternSequence& sequence, const std::vector<double>& response)
      : pattern_(pattern),
        sequence_(sequence),
        response_(response),
        light_(pattern.bits == 0 ? cv::Mat1f() : pattern_levels(pattern, sequence)) {
    for (float& level : light_) level = static_cast<float>(table_value(response_, static_cast<double>(level)));
  }

  float at(float column, float row) const {
    if (light_.empty()) {
      const float along = pattern_.axis == Axis::columns ? column : row;
      const double ideal = ideal_intensity(pattern_, static_cast<double>(along));
      return static_cast<float>(table_value(response_, table_value(sequence_.inverse_response, ideal)));
    }
    const Place x = place(column, light_.cols), y = place(row, light_.rows);
    const float* above = light_[y.low];
    const float* below = light_[y.high];
    const float top = above[x.low] + x.part * (above[x.high] - above[x.low]);
    const float bottom = below[x.low] + x.part * (below[x.high] - below[x.low]);
    return top + y.part * (bottom - top);
  }

 private:
  struct Place {
    int low, high;
    float part;
  };
  static Place place(float coordinate, int size) {
    const float clamped = std::clamp(coordinate, 0.0f, static_cast<float>(size - 1));
    const int low = static_cast<int>(clamped);
    return {low, std::min(low + 1, size - 1), clamped - static_cast<float>(low)};
  }

  const Pattern& pattern_;
  const PatternSequence& sequence_;
  const std::vector<double>& response_;
  cv::Mat1f light_;
};

}  // namespace

SampleRays sample_rays(const Pinhole& camera, int per_pixel) {
  const std::vector<Eigen::Vector2d> offsets = sample_offsets(per_pixel);
  SampleRays rays;
  rays.per_pixel = per_pixel;
  const auto pixels = static_cast<size_t>(camera.width) * static_cast<size_t>(camera.height);
  rays.centres.resize(pixels);
  rays.samples.resize(pixels * offsets.size());
  for_each_row(camera.height, [&](int row) {
    for (int col = 0; col < camera.width; ++col) {
      const auto pixel = static_cast<size_t>(row * camera.width + col);
      const Eigen::Vector2d centre(col, row);
      rays.centres[pixel] = camera.undistort(centre).homogeneous();
      for (size_t s = 0; s < offsets.size(); ++s)
        rays.samples[pixel * offsets.size() + s] = camera.undistort(centre + offsets[s]).homogeneous();
    }
  });
  return rays;
}

TracedView trace_view(const RayWorld& world, const RigModel& rig, const SampleRays& rays,
                      const Pose& world_from_camera) {
  const cv::Size size(rig.camera.width, rig.camera.height);
  TracedView view;
  view.samples.resize(rays.samples.size());
  TruthFrame& truth = view.truth;
  for (cv::Mat1f* image : {&truth.depth_m, &truth.projector_column}) *image = cv::Mat1f(size, kNaN);
  for (cv::Mat1f* image : {&truth.object_id, &truth.mask}) *image = cv::Mat1f(size, 0.0f);
  truth.normals = cv::Mat3f(size, cv::Vec3f::all(kNaN));

  const ProjectorLight light(world, rig, world_from_camera);
  const Pose camera_from_world = world_from_camera.inverse();
  const Eigen::Vector3d& origin = world_from_camera.translation;
  const auto per_pixel = static_cast<size_t>(rays.per_pixel);
  const auto cast = [&](const Eigen::Vector3d& ray) {
    LitHit result{world.trace(origin, world_from_camera.rotation * ray), {}};
    if (result.hit) result.lighting = light(*result.hit);
    return result;
  };
  for_each_row(size.height, [&](int row) {
    for (int col = 0; col < size.width; ++col) {
      const auto pixel = static_cast<size_t>(row * size.width + col);
      const LitHit centre = cast(rays.centres[pixel]);
      if (centre.hit) set_truth(truth, row, col, *centre.hit, centre.lighting, camera_from_world);
      bool mixed = false;
      for (size_t s = pixel * per_pixel; s < (pixel + 1) * per_pixel; ++s) {
        const LitHit sample = cast(rays.samples[s]);
        if (sample.hit) view.samples[s] = to_sample(world, sample.lighting, *sample.hit);
        mixed = mixed || differ(centre, sample);
      }
      if (mixed) truth.mask(row, col) += static_cast<float>(kTruthMixed);
    }
  });
  return view;
}

cv::Mat1f shade(const TracedView& view, int samples_per_pixel, const Pattern& pattern, const PatternSequence& sequence,
                const RigModel& rig, double ambient_electrons) {
  const ShownPattern shown(pattern, sequence, rig.projector_response);
  const auto black = static_cast<float>(rig.projector_black_level);
  const auto white = static_cast<float>(rig.white_electrons_at_1m);
  const auto ambient = static_cast<float>(ambient_electrons);
  cv::Mat1f electrons(rig.camera.height, rig.camera.width);
  for_each_row(electrons.rows, [&](int row) {
    for (int col = 0; col < electrons.cols; ++col) {
      const auto first = static_cast<size_t>((row * electrons.cols + col) * samples_per_pixel);
      float sum = 0;
      for (size_t s = first; s < first + static_cast<size_t>(samples_per_pixel); ++s) {
        const Sample& sample = view.samples[s];
        const float light = shown.at(sample.column, sample.row);
        sum += sample.ambient * ambient + sample.beam * white * (black + (1 - black) * light);
      }
      electrons(row, col) = sum / static_cast<float>(samples_per_pixel);
    }
  });
  return electrons;
}

cv::Mat expose(const cv::Mat1f& electrons, const SensorModel& sensor, const Exposure& exposure) {
  const Philox random(exposure.seed, Stream::sensor_noise, static_cast<uint32_t>(exposure.stack),
                      static_cast<uint32_t>(exposure.image));
  const double dark_variance = sensor.dark_noise_electrons * sensor.dark_noise_electrons;
  cv::Mat1f grey(electrons.size());
  for_each_row(electrons.rows, [&](int row) {
    // Two neighbours share the two numbers of one address.
    std::pair<double, double> normals;
    for (int col = 0; col < electrons.cols; ++col) {
      double n = static_cast<double>(electrons(row, col));
      if (exposure.noise) {
        if (col % 2 == 0) normals = random.normal_pair(static_cast<uint32_t>(row * electrons.cols + col));
        n += std::sqrt(n + dark_variance) * (col % 2 == 0 ? normals.first : normals.second);
      }
      if (exposure.quantise) n = std::min(n, sensor.full_well_electrons);
      grey(row, col) = static_cast<float>(sensor.offset_dn + sensor.gain_dn_per_electron * n);
    }
  });
  if (!exposure.quantise) return grey;
  cv::Mat quantised;
  cv::Mat clipped = cv::min(grey, sensor.max_dn());
  clipped.convertTo(quantised, sensor.bits <= 8 ? CV_8U : CV_16U);  // rounds, and clips below at 0
  return quantised;
}

}  // namespace fringeslam::sim
