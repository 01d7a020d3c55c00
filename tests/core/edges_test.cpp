// SPDX-License-Identifier: Apache-2.0
#include "core/landmarks/edges.h"

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/core/utility.hpp>

#include "tests/support/random.h"

namespace fringeslam {
namespace {

using support::Random;

// A step of `height` across a line through the centre, rotated by `angle`.
cv::Mat1f step_image(double height, double angle, int width = 80, int rows = 70) {
  cv::Mat1f image(rows, width);
  for (int r = 0; r < rows; ++r) {
    for (int c = 0; c < width; ++c) {
      const double across = (c - 39.5) * std::cos(angle) + (r - 34.5) * std::sin(angle);
      image(r, c) = static_cast<float>(across > 0 ? 50 + height : 50);
    }
  }
  return image;
}

// Direct evaluation of the filters' sums.
double direct(const cv::Mat1f& image, int r, int c, double alpha, bool along_x) {
  const double q = std::exp(-alpha), k = (1 - q) * (1 - q) / (1 + 2 * alpha * q - q * q), d = (1 - q) * (1 - q) / q;
  constexpr int kReach = 60;
  double sum = 0;
  for (int i = -kReach; i <= kReach; ++i) {
    for (int j = -kReach; j <= kReach; ++j) {
      const int n = along_x ? j : i, m = along_x ? i : j;
      const double derivative = d * n * std::pow(q, std::abs(n)),
                   smooth = k * (alpha * std::abs(m) + 1) * std::pow(q, std::abs(m));
      const int row = std::clamp(r + i, 0, image.rows - 1), col = std::clamp(c + j, 0, image.cols - 1);
      sum += derivative * smooth * image(row, col);
    }
  }
  return sum;
}

TEST(Edges, DericheIsItsSum) {
  for (const cv::Size size : {cv::Size(37, 29), cv::Size(9, 40), cv::Size(5, 3)}) {
    Random random(7);
    cv::Mat1f image(size);
    for (float& value : image) value = static_cast<float>(random.uniform(0, 255));
    const Gradient gradient = deriche_gradient(image, 0.8);
    for (const auto& [r, c] : {std::pair(size.height / 2, size.width / 2), {0, 0}, {size.height - 1, size.width - 2}}) {
      EXPECT_NEAR(gradient.x(r, c), direct(image, r, c, 0.8, true), 2e-3) << size << r << " " << c;
      EXPECT_NEAR(gradient.y(r, c), direct(image, r, c, 0.8, false), 2e-3) << size << r << " " << c;
    }
  }
}

TEST(Edges, AStripIsPartOfTheWhole) {
  for (const double alpha : {0.3, 1.0, 3.0}) {
    Random random(11);
    cv::Mat1f image(230, 100);
    for (float& value : image) value = static_cast<float>(random.uniform(0, 255));
    const Gradient whole = deriche_gradient(image, alpha);
    for (const cv::Range& rows : {cv::Range(0, 20), cv::Range(101, 164), cv::Range(229, 230)}) {
      const Gradient strip = deriche_gradient(image, alpha, rows);
      ASSERT_EQ(strip.x.size(), cv::Size(image.cols, rows.size()));
      EXPECT_LT(cv::norm(strip.x, whole.x.rowRange(rows), cv::NORM_INF), 1e-5 * 255) << alpha << " " << rows.start;
      EXPECT_LT(cv::norm(strip.y, whole.y.rowRange(rows), cv::NORM_INF), 1e-5 * 255) << alpha << " " << rows.start;
    }
  }
}

TEST(Edges, DoNotDependOnTheNumberOfThreads) {
  Random random(5);
  cv::Mat1f image(211, 333);
  for (float& value : image) value = static_cast<float>(random.uniform(0, 255));
  const int before = cv::getNumThreads();
  cv::setNumThreads(1);
  const BitImage one = detect_edges(image, EdgeDetector::canny_deriche, 1, 20, 60);
  ASSERT_GT(cv::countNonZero(one.mask()), 1000);
  cv::setNumThreads(4);
  for (int run = 0; run < 50; ++run) ASSERT_TRUE(one == detect_edges(image, EdgeDetector::canny_deriche, 1, 20, 60));
  cv::setNumThreads(before);
}

TEST(Edges, AStepHasItsHeight) {
  for (const double height : {4.0, 60.0}) {
    const cv::Mat1f image = step_image(height, 0);
    for (const Gradient& gradient : {deriche_gradient(image, 1), prewitt_gradient(image), roberts_gradient(image)}) {
      EXPECT_NEAR(gradient.x(35, 39), height, 1e-3 * height);
      EXPECT_NEAR(gradient.y(35, 39), 0, 1e-3 * height);
    }
  }
}

TEST(Edges, EveryDetectorFindsAStepWhereItIsAndNothingElse) {
  for (const EdgeDetector detector : choice_values<EdgeDetector>()) {
    for (const double angle : {0.0, 0.4, 0.785, 1.3, 1.571}) {
      const cv::Mat1b edges = detect_edges(step_image(10, angle), detector, 1, 3, 6).mask();
      int found = 0;
      for (int r = 0; r < edges.rows; ++r) {
        for (int c = 0; c < edges.cols; ++c) {
          const double across = (c - 39.5) * std::cos(angle) + (r - 34.5) * std::sin(angle);
          if (edges(r, c)) {
            EXPECT_LE(std::abs(across), 1.6) << to_string(detector) << " " << angle << ": " << r << " " << c;
          }
          found += edges(r, c) != 0 && r > 8 && r < 62 && c > 8 && c < 72;
        }
      }
      EXPECT_GE(found, 50) << to_string(detector) << " " << angle;
      EXPECT_EQ(cv::countNonZero(detect_edges(step_image(4, angle), detector, 1, 3, 6).mask()), 0)
          << to_string(detector) << " " << angle;
    }
  }
}

TEST(Edges, WeakOnesOnlyBesideStrongOnes) {
  // A step that fades from 10 levels to 4, and a parallel one of 4 levels everywhere.
  cv::Mat1f image(60, 80, 50.0f);
  for (int r = 0; r < 60; ++r) {
    for (int c = 20; c < 80; ++c) image(r, c) += static_cast<float>(10 - 6.0 * r / 59);
    for (int c = 60; c < 80; ++c) image(r, c) += 4;
  }
  const cv::Mat1b edges = detect_edges(image, EdgeDetector::canny_deriche, 1.5, 3, 8).mask();
  EXPECT_GE(cv::countNonZero(edges.colRange(17, 23)), 50);
  EXPECT_EQ(cv::countNonZero(edges.colRange(50, 80)), 0);
}

TEST(Edges, NoiseOnASlopeIsNoEdge) {
  // 0.1 mm of noise and a slope of 45 degrees, in depth levels.
  Random random(3);
  cv::Mat1f image(100, 120);
  for (int r = 0; r < 100; ++r) {
    for (int c = 0; c < 120; ++c) image(r, c) = static_cast<float>(60 + 0.18 * c + 0.036 * random.normal());
  }
  for (const EdgeDetector detector : choice_values<EdgeDetector>())
    EXPECT_EQ(cv::countNonZero(detect_edges(image, detector, 1, 2.2, 4.4).mask()), 0) << to_string(detector);
}

TEST(Edges, ImagesWithoutAnInside) {
  for (const EdgeDetector detector : choice_values<EdgeDetector>()) {
    for (const cv::Size size : {cv::Size(0, 0), cv::Size(1, 1), cv::Size(2, 40), cv::Size(3, 3)})
      EXPECT_EQ(cv::countNonZero(detect_edges(cv::Mat1f(size, 1.0f), detector, 1, 1, 2).mask()), 0);
  }
}

}  // namespace
}  // namespace fringeslam
