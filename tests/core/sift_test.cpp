// SPDX-License-Identifier: Apache-2.0
#include "core/landmarks/sift.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <opencv2/core/utility.hpp>
#include <opencv2/features2d.hpp>
#include <opencv2/imgproc.hpp>

#include "core/landmarks/scale_space.h"
#include "tests/support/random.h"

namespace fringeslam {
namespace {

// Light and dark blobs of many sizes, with noise of two grey levels.
cv::Mat1b texture(uint64_t seed, cv::Size size = {320, 280}) {
  support::Random random(seed);
  cv::Mat1f image(size, 128);
  for (int blob = 0; blob < 900; ++blob) {
    const double x = random.uniform(0, size.width), y = random.uniform(0, size.height);
    const double sigma = std::exp(random.uniform(std::log(1.0), std::log(12.0))), height = random.uniform(-60, 60);
    const cv::Rect around =
        cv::Rect(cv::Point(static_cast<int>(x - 3 * sigma), static_cast<int>(y - 3 * sigma)),
                 cv::Point(static_cast<int>(x + 3 * sigma) + 1, static_cast<int>(y + 3 * sigma) + 1)) &
        cv::Rect({0, 0}, size);
    for (int row = around.y; row < around.br().y; ++row) {
      for (int col = around.x; col < around.br().x; ++col)
        image(row, col) += static_cast<float>(
            height * std::exp(-((col - x) * (col - x) + (row - y) * (row - y)) / (2 * sigma * sigma)));
    }
  }
  for (float& value : image) value += static_cast<float>(2 * random.normal());
  cv::Mat1b rounded;
  image.convertTo(rounded, CV_8U);
  return rounded;
}

TEST(ScaleSpace, BlurIsThatOfOpenCV) {
  cv::Mat1f image;
  texture(1, {101, 67}).convertTo(image, CV_32F);
  for (const double sigma : {0.8, 1.6, 3.0, 7.5}) {
    cv::Mat1f theirs;
    const int size = 2 * static_cast<int>(std::ceil(3.5 * sigma)) + 1;
    cv::GaussianBlur(image, theirs, {size, size}, sigma, sigma, cv::BORDER_REFLECT_101);
    EXPECT_LT(cv::norm(blurred(image, sigma), theirs, cv::NORM_INF), 2e-4) << sigma;
  }
}

// Narrower than the kernel, and than a vector register.
TEST(ScaleSpace, BlurOfNarrowImagesKeepsTheirMean) {
  for (const cv::Size size : {cv::Size(3, 40), cv::Size(40, 3), cv::Size(2, 2), cv::Size(70, 1)}) {
    const cv::Mat1f even(size, 17);
    EXPECT_LT(cv::norm(blurred(even, 5), even, cv::NORM_INF), 1e-4) << size;
  }
}

TEST(Sift, OfNoOrTinyImagesThereAreNone) {
  for (const int size : {0, 1, 2, 3, 4, 5}) {
    const SiftFeatures features = sift(texture(1, {size, size}), {}, Describe::yes);
    EXPECT_TRUE(features.keypoints.empty()) << size;
    EXPECT_EQ(features.descriptors.rows, 0);
  }
}

TEST(Sift, EdgesAreNoKeypoints) {
  cv::Mat1b edge(200, 200, uchar{60});
  for (int row = 0; row < 200; ++row) {
    for (int col = 0; col < 200; ++col) edge(row, col) = 0.6 * row + 0.8 * col > 140 ? 180 : 60;
  }
  cv::GaussianBlur(edge, edge, {}, 1);
  EXPECT_LT(sift(edge, {.contrast_threshold = 0.03}, Describe::no).keypoints.size(), 5U);
}

TEST(Sift, KeepsTheStrongest) {
  const cv::Mat1b image = texture(2);
  const SiftFeatures all = sift(image, {.max_keypoints = 100000}, Describe::yes),
                     few = sift(image, {.max_keypoints = 100}, Describe::yes);
  ASSERT_GT(all.keypoints.size(), 500U);
  ASSERT_EQ(few.keypoints.size(), 100U);
  for (size_t i = 0; i < 100; ++i) EXPECT_EQ(few.keypoints[i].pixel, all.keypoints[i].pixel);
  EXPECT_EQ(cv::norm(few.descriptors, all.descriptors.rowRange(0, 100), cv::NORM_INF), 0);
  for (size_t i = 1; i < all.keypoints.size(); ++i) ASSERT_LE(all.keypoints[i].strength, all.keypoints[i - 1].strength);
}

TEST(Sift, NumberOfThreadsDoesNotMatter) {
  const cv::Mat1b image = texture(2);
  const int threads = cv::getNumThreads();
  cv::setNumThreads(1);
  const SiftFeatures one = sift(image, {}, Describe::yes);
  cv::setNumThreads(2);
  const SiftFeatures two = sift(image, {}, Describe::yes);
  cv::setNumThreads(threads);
  ASSERT_EQ(two.keypoints.size(), one.keypoints.size());
  for (size_t i = 0; i < one.keypoints.size(); ++i) {
    EXPECT_EQ(two.keypoints[i].pixel, one.keypoints[i].pixel);
    EXPECT_EQ(two.keypoints[i].angle_rad, one.keypoints[i].angle_rad);
  }
  EXPECT_EQ(cv::norm(one.descriptors, two.descriptors, cv::NORM_INF), 0);
}

// Nearest descriptor of b for each of a, if it is distinctive (Lowe's ratio 0.8).
struct Match {
  size_t a = 0, b = 0;
  double distance = 0;
};
std::vector<Match> matches_of(const cv::Mat1f& a, const cv::Mat1f& b) {
  std::vector<Match> matches;
  cv::Mat1f products;
  cv::gemm(a, b, 1, {}, 0, products, cv::GEMM_2_T);
  for (int i = 0; i < products.rows; ++i) {
    float best = -1, second = -1;
    size_t at = 0;
    for (int j = 0; j < products.cols; ++j) {
      if (products(i, j) > best)
        second = best, best = products(i, j), at = static_cast<size_t>(j);
      else
        second = std::max(second, products(i, j));
    }
    const auto distance = [](float product) { return std::sqrt(std::max(0.0, 2 - 2 * static_cast<double>(product))); };
    if (distance(best) < 0.8 * distance(second)) matches.push_back({static_cast<size_t>(i), at, distance(best)});
  }
  return matches;
}

// A rotated image has the same keypoints and descriptors, apart from different pixel grids of the coarser octaves.
TEST(Sift, AQuarterTurnTurnsKeypointsAndKeepsDescriptors) {
  const cv::Mat1b image = texture(3, {256, 256});
  cv::Mat1b turned;
  cv::rotate(image, turned, cv::ROTATE_90_CLOCKWISE);
  const SiftFeatures a = sift(image, {}, Describe::yes), b = sift(turned, {}, Describe::yes);
  ASSERT_GT(a.keypoints.size(), 300U);
  int right = 0, turned_too = 0;
  double distance = 0;
  for (const Match& match : matches_of(a.descriptors, b.descriptors)) {
    const SiftKeypoint &one = a.keypoints[match.a], &other = b.keypoints[match.b];
    const Eigen::Vector2d expected(255 - one.pixel.y(), one.pixel.x());
    if ((other.pixel - expected).norm() > 0.2 * one.sigma) continue;
    ++right;
    distance += match.distance;
    const double turn = std::remainder(other.angle_rad - one.angle_rad - std::numbers::pi / 2, 2 * std::numbers::pi);
    turned_too += std::abs(turn) < 0.1;
  }
  EXPECT_GT(right, 0.9 * static_cast<double>(a.keypoints.size()));
  EXPECT_GT(turned_too, 0.97 * right);
  EXPECT_LT(distance / right, 0.05);
}

TEST(Sift, BrightnessAndContrastDoNotMatter) {
  const cv::Mat1b image = texture(4);
  cv::Mat1b dim;
  image.convertTo(dim, CV_8U, 0.5, 70);
  const SiftFeatures a = sift(image, {}, Describe::yes), b = sift(dim, {.contrast_threshold = 0.0015}, Describe::yes);
  int right = 0;
  double distance = 0;
  for (const Match& match : matches_of(a.descriptors, b.descriptors)) {
    if ((a.keypoints[match.a].pixel - b.keypoints[match.b].pixel).norm() > 0.5) continue;
    ++right;
    distance += match.distance;
  }
  EXPECT_GT(right, 0.75 * static_cast<double>(a.keypoints.size()));
  EXPECT_LT(distance / right, 0.15);  // the levels are quantised twice as coarsely
}

// OpenCV's features in this project's form. OpenCV's positions are off by a quarter of a pixel, since it doubles
// images preserving their corners but maps positions back preserving pixel centres.
SiftFeatures of_opencv(const cv::Mat1b& image, const SiftOptions& options) {
  std::vector<cv::KeyPoint> found;
  SiftFeatures features;
  cv::SIFT::create(options.max_keypoints, kScalesPerOctave, options.contrast_threshold, options.edge_threshold,
                   kFinestSigma)
      ->detectAndCompute(image, {}, found, features.descriptors);
  for (const cv::KeyPoint& k : found)
    features.keypoints.push_back(
        {{k.pt.x - 0.25, k.pt.y - 0.25}, k.size / 2, k.angle * std::numbers::pi / 180, k.response});
  for (int i = 0; i < features.descriptors.rows; ++i)
    cv::normalize(features.descriptors.row(i), features.descriptors.row(i));
  return features;
}

// The image is rotated by `degrees`, scaled, darkened and noisy.
struct Similarity {
  double degrees = 0, zoom = 1;
};
class SiftBesideOpenCV : public testing::TestWithParam<Similarity> {};
INSTANTIATE_TEST_SUITE_P(Turns, SiftBesideOpenCV,
                         testing::Values(Similarity{0, 1}, Similarity{25, 1}, Similarity{-70, 1.4},
                                         Similarity{170, 0.7}));

TEST_P(SiftBesideOpenCV, MatchesAsManyAsWellLocated) {
  const auto [degrees, zoom] = GetParam();
  struct Outcome {
    int kept = 0, right = 0;
    std::vector<double> off_px;
  } ours, theirs;
  for (uint64_t seed = 5; seed < 8; ++seed) {
    const cv::Mat1b image = texture(seed);
    const cv::Matx23d turn = cv::getRotationMatrix2D({160, 140}, degrees, zoom);
    cv::Mat1b seen;
    cv::warpAffine(image, seen, turn, image.size(), cv::INTER_CUBIC);
    support::Random random(seed);
    for (uchar& value : seen) value = cv::saturate_cast<uchar>(0.8 * value + 15 + 1.5 * random.normal());
    const auto measure = [&](const SiftFeatures& a, const SiftFeatures& b, Outcome& outcome) {
      for (const Match& match : matches_of(a.descriptors, b.descriptors)) {
        const SiftKeypoint& k = a.keypoints[match.a];
        const cv::Vec2d at = turn * cv::Vec3d(k.pixel.x(), k.pixel.y(), 1);
        if (at[0] < 0 || at[1] < 0 || at[0] >= seen.cols || at[1] >= seen.rows) continue;
        const double off = (b.keypoints[match.b].pixel - Eigen::Vector2d(at[0], at[1])).norm();
        ++outcome.kept;
        if (off > 2 * k.sigma * zoom) continue;
        ++outcome.right;
        outcome.off_px.push_back(off);
      }
    };
    const SiftOptions options;
    measure(sift(image, options, Describe::yes), sift(seen, options, Describe::yes), ours);
    measure(of_opencv(image, options), of_opencv(seen, options), theirs);
  }
  const auto median = [](std::vector<double>& values) {
    std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2), values.end());
    return values[values.size() / 2];
  };
  ASSERT_GT(theirs.right, 200);
  EXPECT_GT(ours.right, 0.95 * theirs.right);
  EXPECT_GT(1.0 * ours.right / ours.kept, 1.0 * theirs.right / theirs.kept - 0.02);
  EXPECT_LT(median(ours.off_px), 1.05 * median(theirs.off_px) + 0.005);
}

}  // namespace
}  // namespace fringeslam
