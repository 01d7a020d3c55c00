// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>

#include <Eigen/Eigenvalues>
#include <limits>
#include <numeric>
#include <opencv2/core/utility.hpp>

#include "core/depth/depth.h"
#include "core/landmarks/keypoints.h"
#include "tests/support/matchers.h"
#include "tests/support/scene.h"

namespace fringeslam {
namespace {

using support::MatrixNear;
using support::observe;
using support::plane;
using support::Random;
using support::small_rig;

struct Blob {
  Eigen::Vector2d centre;
  double sigma = 3, height = 100;
};

cv::Mat1b blob_image(const cv::Size& size, const std::vector<Blob>& blobs) {
  cv::Mat1b image(size);
  for (int row = 0; row < size.height; ++row) {
    for (int col = 0; col < size.width; ++col) {
      double grey = 100;
      for (const Blob& blob : blobs) {
        const double distance2 = (Eigen::Vector2d(col, row) - blob.centre).squaredNorm();
        grey += blob.height * std::exp(-distance2 / (2 * blob.sigma * blob.sigma));
      }
      image(row, col) = cv::saturate_cast<uchar>(grey);
    }
  }
  return image;
}

const Eigen::Vector3d kNormal = Eigen::Vector3d(0.4, -0.3, -1).normalized();

// A tilted board with the given texture.
Frame board(const RigModel& rig, const cv::Mat1b& texture) {
  Frame frame = observe(plane(kNormal, kNormal.z()), rig, {}, 3e-5);
  frame.texture = texture;
  return frame;
}

std::vector<Blob> scattered_blobs(uint64_t seed, int count) {
  Random random(seed);
  std::vector<Blob> blobs;
  for (int i = 0; i < count; ++i)
    blobs.push_back(
        {{random.uniform(10, 122), random.uniform(10, 114)}, random.uniform(1.5, 5), random.uniform(-60, 60)});
  return blobs;
}

Keypoints detect(const Frame& frame, const RigModel& rig) {
  return detect_keypoints(frame, rig, pixel_rays(rig.camera), {});
}

class BlobPosition : public testing::TestWithParam<double> {};
INSTANTIATE_TEST_SUITE_P(Sigmas, BlobPosition, testing::Values(2.0, 3.0, 4.5, 6.0));

TEST_P(BlobPosition, IsUnbiasedAtAnySubPixelPosition) {
  const RigModel rig = small_rig(false);
  Eigen::Vector2d sum = Eigen::Vector2d::Zero();
  int count = 0;
  for (double dx = 0; dx < 2; dx += 0.25) {
    for (double dy = 0; dy < 2; dy += 0.25) {
      const Eigen::Vector2d truth(64 + dx, 60 + dy);
      const Keypoints found = detect(board(rig, blob_image({133, 125}, {{truth, GetParam(), 100}})), rig);
      for (const Keypoint& keypoint : found.keypoints) {
        if ((keypoint.pixel - truth).norm() > 1 || std::abs(keypoint.scale / GetParam() - 1) > 0.5) continue;
        EXPECT_THAT(keypoint.pixel, MatrixNear(truth, 0.05)) << "at " << truth.transpose();
        sum += keypoint.pixel - truth;
        ++count;
      }
    }
  }
  ASSERT_GE(count, 64) << "a blob was not detected";
  RecordProperty("mean_shift_x", std::to_string(sum.x() / count));
  RecordProperty("mean_shift_y", std::to_string(sum.y() / count));
  EXPECT_THAT((sum / count).eval(), MatrixNear(Eigen::Vector2d::Zero(), 0.02));
}

TEST(Keypoints, ScaleIsTheSigmaOfTheBlob) {
  const RigModel rig = small_rig(false);
  const Keypoints found = detect(board(rig, blob_image({133, 125}, {{{60.3, 70.6}, 4, 100}})), rig);
  ASSERT_FALSE(found.keypoints.empty());
  EXPECT_NEAR(found.keypoints[0].scale, 4, 0.8);
}

TEST(Keypoints, PointsLieOnTheSurfaceBehindTheirPixel) {
  const RigModel rig = small_rig(true);
  const Keypoints found = detect(board(rig, blob_image({133, 125}, scattered_blobs(1, 80))), rig);
  ASSERT_GT(found.keypoints.size(), 20U);
  EXPECT_EQ(found.descriptors.rows, static_cast<int>(found.keypoints.size()));
  EXPECT_EQ(found.descriptors.cols, 128);
  for (const Keypoint& keypoint : found.keypoints) {
    EXPECT_NEAR(kNormal.dot(keypoint.point_m), kNormal.z(), 1e-6);
    EXPECT_THAT(rig.camera.project(keypoint.point_m), MatrixNear(keypoint.pixel, 1e-3));
    const Eigen::Vector3d spread = Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(keypoint.covariance_m2).eigenvalues();
    EXPECT_GT(spread.minCoeff(), 0);
    EXPECT_LT(spread.maxCoeff(), 0.005 * 0.005);
  }
  for (int i = 0; i < found.descriptors.rows; ++i) EXPECT_NEAR(cv::norm(found.descriptors.row(i)), 1, 1e-5);
}

TEST(Keypoints, NoneWithoutDepthOrAcrossAStep) {
  const RigModel rig = small_rig(false);
  const cv::Mat1b texture = blob_image({133, 125}, {{{30.4, 60}, 3, 100}, {{70.5, 60}, 3, 100}, {{110.2, 60}, 3, 100}});
  Frame frame = board(rig, texture);
  for (int row = 55; row < 66; ++row) {
    frame.points_m(row, 30) = cv::Vec3f::all(std::numeric_limits<float>::quiet_NaN());
    for (int col = 71; col < 133; ++col) frame.points_m(row, col) += cv::Vec3f(0, 0, 0.1F);
  }
  const Keypoints found = detect(frame, rig);
  EXPECT_GE(found.detected, 3);
  for (const Keypoint& keypoint : found.keypoints) {
    EXPECT_GT(std::abs(keypoint.pixel.x() - 30.4), 1);
    EXPECT_GT(std::abs(keypoint.pixel.x() - 70.5), 1);
  }
  EXPECT_TRUE(std::any_of(found.keypoints.begin(), found.keypoints.end(),
                          [](const Keypoint& k) { return (k.pixel - Eigen::Vector2d(110.2, 60)).norm() < 1; }));
}

TEST(Keypoints, NoTextureNoKeypoints) {
  const RigModel rig = small_rig(false);
  const Keypoints found = detect(board(rig, cv::Mat1b(125, 133, uchar{90})), rig);
  EXPECT_EQ(found.keypoints.size(), 0U);
  EXPECT_EQ(found.descriptors.rows, 0);
  EXPECT_THAT(match_keypoints(found, found, {}), testing::IsEmpty());
}

TEST(Keypoints, DoNotDependOnTheNumberOfThreads) {
  const RigModel rig = small_rig(false);
  const Frame frame = board(rig, blob_image({133, 125}, scattered_blobs(2, 120)));
  const int threads = cv::getNumThreads();
  cv::setNumThreads(1);
  const Keypoints one = detect(frame, rig);
  cv::setNumThreads(2);
  const Keypoints two = detect(frame, rig);
  cv::setNumThreads(threads);
  ASSERT_EQ(one.keypoints.size(), two.keypoints.size());
  for (size_t i = 0; i < one.keypoints.size(); ++i) EXPECT_EQ(one.keypoints[i].point_m, two.keypoints[i].point_m);
  EXPECT_EQ(cv::norm(one.descriptors, two.descriptors, cv::NORM_INF), 0);
}

Keypoints with_descriptors(const std::vector<Eigen::VectorXf>& descriptors) {
  Keypoints keypoints;
  keypoints.keypoints.resize(descriptors.size());
  keypoints.descriptors = cv::Mat1f(static_cast<int>(descriptors.size()), 128, 0.0F);
  for (size_t i = 0; i < descriptors.size(); ++i) {
    keypoints.keypoints[i].pixel.x() = static_cast<double>(i);
    for (int k = 0; k < descriptors[i].size(); ++k) keypoints.descriptors(static_cast<int>(i), k) = descriptors[i][k];
  }
  return keypoints;
}

std::vector<Eigen::VectorXf> random_descriptors(uint64_t seed, int count) {
  Random random(seed);
  std::vector<Eigen::VectorXf> descriptors;
  for (int i = 0; i < count; ++i) descriptors.push_back(random.normals<128>().cwiseAbs().normalized().cast<float>());
  return descriptors;
}

TEST(Matching, IdentityAndPermutation) {
  const auto descriptors = random_descriptors(3, 150);
  std::vector<int> order(150);
  std::iota(order.begin(), order.end(), 0);
  for (int shift : {0, 47}) {
    std::vector<Eigen::VectorXf> permuted;
    for (int i = 0; i < 150; ++i) permuted.push_back(descriptors[static_cast<size_t>((7 * i + shift) % 150)]);
    const auto matches = match_keypoints(with_descriptors(descriptors), with_descriptors(permuted), {});
    ASSERT_EQ(matches.size(), 150U);
    for (int i = 0; i < 150; ++i) {
      EXPECT_EQ(matches[static_cast<size_t>(i)].current, i);
      EXPECT_EQ(matches[static_cast<size_t>(i)].earlier, (7 * i + shift) % 150);
      EXPECT_NEAR(matches[static_cast<size_t>(i)].distance, 0, 1e-3);
    }
  }
}

// Unit vectors in a plane; their distances are chords, 2 sin(angle / 2).
Eigen::VectorXf at_angle(double degrees) {
  Eigen::VectorXf v = Eigen::VectorXf::Zero(128);
  v[0] = static_cast<float>(std::cos(degrees * 0.017453292519943295));
  v[1] = static_cast<float>(std::sin(degrees * 0.017453292519943295));
  return v;
}

TEST(Matching, PairsAreEachOthersNearest) {
  // Current 12 and 16 are both nearest to earlier 10, which in turn is nearest to 12 only.
  const auto matches = match_keypoints(with_descriptors({at_angle(10), at_angle(80)}),
                                       with_descriptors({at_angle(16), at_angle(12)}), {.max_ratio = 1});
  ASSERT_EQ(matches.size(), 1U);
  EXPECT_EQ(matches[0].earlier, 0);
  EXPECT_EQ(matches[0].current, 1);
  EXPECT_NEAR(matches[0].distance, 2 * std::sin(0.017453292519943295), 1e-3);
}

TEST(Matching, OrientationsOfOnePositionCountOnce) {
  Keypoints earlier = with_descriptors({at_angle(0), at_angle(40), at_angle(80)}),
            current = with_descriptors({at_angle(1), at_angle(42), at_angle(83)});
  EXPECT_EQ(match_keypoints(earlier, current, {}).size(), 3U);
  earlier.keypoints[1].pixel = earlier.keypoints[2].pixel;
  current.keypoints[1].pixel = current.keypoints[2].pixel;
  const auto matches = match_keypoints(earlier, current, {});
  ASSERT_EQ(matches.size(), 2U);
  EXPECT_EQ(matches[0].current, 0);
  EXPECT_EQ(matches[1].current, 1) << "the orientation with the nearest descriptor";
  EXPECT_EQ(matches[1].earlier, 1);
}

TEST(Matching, AmbiguousPairsFailTheRatioTest) {
  // The nearest is 6 degrees away, the second nearest 9, in either order.
  const Keypoints current = with_descriptors({at_angle(6)});
  const double ratio = std::sin(3 * 0.017453292519943295) / std::sin(4.5 * 0.017453292519943295);
  for (const auto& [nearer, farther] : {std::pair{0.0, 15.0}, {12.0, -3.0}}) {
    for (const Keypoints& previous : {with_descriptors({at_angle(nearer), at_angle(farther)}),
                                      with_descriptors({at_angle(farther), at_angle(nearer)})}) {
      EXPECT_EQ(match_keypoints(previous, current, {.max_ratio = ratio - 0.01}).size(), 0U);
      const auto matches = match_keypoints(previous, current, {.max_ratio = ratio + 0.01});
      ASSERT_EQ(matches.size(), 1U);
      EXPECT_NEAR(matches[0].ratio, ratio, 1e-3);
    }
  }
}

}  // namespace
}  // namespace fringeslam
