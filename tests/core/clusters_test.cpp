// SPDX-License-Identifier: Apache-2.0
#include "core/landmarks/reference/clusters.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>

#include "core/landmarks/reference/hull.h"
#include "core/landmarks/regions.h"
#include "tests/support/random.h"

namespace fringeslam {
namespace {

using Eigen::Vector2d;
using support::Random;

std::vector<Vector2d> corners_of(const std::vector<Vector2d>& points) {
  std::vector<Vector2d> corners;
  for (const int i : gift_wrap(points).corners) corners.push_back(points[static_cast<size_t>(i)]);
  return corners;
}

TEST(Hull, OfFewPoints) {
  EXPECT_EQ(gift_wrap({}).status, HullStatus::empty);
  EXPECT_EQ(gift_wrap({{3, 4}}).status, HullStatus::point);
  EXPECT_EQ(gift_wrap({{3, 4}, {3, 4}, {3, 4}}).status, HullStatus::point);
  const ConvexHull segment = gift_wrap({{0, 0}, {2, 2}, {1, 1}, {3, 3}});
  EXPECT_EQ(segment.status, HullStatus::segment);
  EXPECT_THAT(segment.corners, testing::ElementsAre(0, 3));
  EXPECT_EQ(gift_wrap({{0, 0}, {1, std::nan("")}, {1, 1}}).status, HullStatus::undefined);
}

TEST(Hull, DropsCollinearAndRepeatedPoints) {
  EXPECT_THAT(corners_of({{0, 0}, {1, 0}, {2, 0}, {2, 2}, {2, 2}, {0, 2}, {0, 1}, {1, 1}}),
              testing::ElementsAre(Vector2d(0, 0), Vector2d(2, 0), Vector2d(2, 2), Vector2d(0, 2)));
}

TEST(Hull, HoldsAllPointsAndTurnsOneWay) {
  for (uint64_t seed = 1; seed <= 200; ++seed) {
    Random random(seed);
    std::vector<Vector2d> points;
    // Every second set lies on a grid, where collinear points are common.
    for (int i = 0; i < 40; ++i) {
      Vector2d p(random.uniform(0, 8), random.uniform(0, 8));
      points.push_back(seed % 2 ? Vector2d(std::floor(p.x()), std::floor(p.y())) : p);
    }
    const std::vector<Vector2d> hull = corners_of(points);
    ASSERT_GE(hull.size(), 3u);
    for (size_t i = 0; i < hull.size(); ++i) {
      const Vector2d &a = hull[i], &b = hull[(i + 1) % hull.size()], &next = hull[(i + 2) % hull.size()];
      const auto turn = [&](const Vector2d& p) { return (b - a).x() * (p - a).y() - (b - a).y() * (p - a).x(); };
      for (const Vector2d& p : points) EXPECT_GE(turn(p), -1e-9) << seed;
      EXPECT_GT(turn(next), 0) << seed;
    }
  }
}

DepthKeypoint keypoint(double x, double y, int level, double strength = 1) {
  DepthKeypoint k;
  k.pixel = {x, y};
  k.level = level;
  k.strength = strength;
  return k;
}

// Two boxes in front of a floor; edges at their outlines, keypoints inside near their borders.
struct Boxes {
  cv::Mat1b levels = cv::Mat1b(120, 200, uchar{60}), edges = cv::Mat1b(120, 200, uchar{0});
  std::vector<DepthKeypoint> keypoints;
  Boxes() {
    add({20, 20, 60, 70}, 120);
    add({110, 30, 70, 60}, 150);
  }
  void add(const cv::Rect& box, uchar level) {
    levels(box) = level;
    const cv::Mat1b outline = edges(box);
    outline.row(0) = outline.row(box.height - 1) = 255;
    outline.col(0) = outline.col(box.width - 1) = 255;
    for (const double u : {0.1, 0.5, 0.9}) {
      for (const double v : {0.1, 0.9})
        keypoints.push_back(keypoint(box.x + u * box.width, box.y + v * box.height, level));
    }
    keypoints.push_back(keypoint(box.x + 0.3 * box.width, box.y + 0.5 * box.height, level));
  }
};

bool crossing(const std::vector<DepthKeypoint>& k, const cv::Vec2i& a, const cv::Vec2i& b) {
  const auto at = [&](int i) { return k[static_cast<size_t>(i)].pixel; };
  const auto side = [&](const cv::Vec2i& line, int i) {
    const Vector2d u = at(line[1]) - at(line[0]), v = at(i) - at(line[0]);
    return u.x() * v.y() - u.y() * v.x();
  };
  return side(a, b[0]) * side(a, b[1]) < -1e-9 && side(b, a[0]) * side(b, a[1]) < -1e-9;
}

class EveryMethod : public testing::TestWithParam<ClusterMethod> {};

TEST_P(EveryMethod, EdgesPartClusters) {
  Boxes boxes;
  ClusterOptions options;
  options.method = GetParam();
  const Clusters clusters = find_clusters(boxes.keypoints, boxes.levels, boxes.edges, options);
  ASSERT_EQ(clusters.members.size(), 2u);
  for (const std::vector<int>& members : clusters.members) {
    std::set<int> boxes_of;
    for (const int m : members) boxes_of.insert(m / 7);
    EXPECT_EQ(boxes_of.size(), 1u);
    EXPECT_GE(members.size(), 6u);
  }
}

TEST_P(EveryMethod, ColumnsOfTheMatrixAgree) {
  Boxes boxes;
  ClusterOptions options;
  options.method = GetParam();
  const Clusters clusters = find_clusters(boxes.keypoints, boxes.levels, boxes.edges, options);
  std::vector<int> connections(boxes.keypoints.size(), 0);
  for (const cv::Vec2i& c : clusters.connections) {
    ++connections[static_cast<size_t>(c[0])];
    ++connections[static_cast<size_t>(c[1])];
    EXPECT_EQ(boxes.keypoints[static_cast<size_t>(c[0])].cluster, boxes.keypoints[static_cast<size_t>(c[1])].cluster);
  }
  for (size_t i = 0; i < boxes.keypoints.size(); ++i) EXPECT_EQ(boxes.keypoints[i].connections, connections[i]);
  for (size_t c = 0; c < clusters.members.size(); ++c) {
    for (size_t order = 0; order < clusters.members[c].size(); ++order) {
      const DepthKeypoint& k = boxes.keypoints[static_cast<size_t>(clusters.members[c][order])];
      EXPECT_EQ(k.cluster, static_cast<int>(c));
      EXPECT_EQ(k.order, static_cast<int>(order));
    }
  }
}

TEST_P(EveryMethod, TheSameSeedTheSameClusters) {
  Random random(5);
  Boxes boxes;
  for (int i = 0; i < 200; ++i) {
    const double x = random.uniform(0, 199), y = random.uniform(0, 119);
    boxes.keypoints.push_back(keypoint(x, y, boxes.levels(static_cast<int>(y), static_cast<int>(x))));
  }
  ClusterOptions options;
  options.method = GetParam();
  std::vector<DepthKeypoint> again = boxes.keypoints;
  const Clusters first = find_clusters(boxes.keypoints, boxes.levels, boxes.edges, options);
  const Clusters second = find_clusters(again, boxes.levels, boxes.edges, options);
  EXPECT_EQ(first.members, second.members);
  EXPECT_EQ(first.connections, second.connections);
}

TEST_P(EveryMethod, BadInput) {
  ClusterOptions options;
  options.method = GetParam();
  const cv::Mat1b levels(50, 60, uchar{100}), edges(50, 60, uchar{0});
  std::vector<DepthKeypoint> none;
  EXPECT_TRUE(find_clusters(none, levels, edges, options).members.empty());
  // Outside the image or without finite coordinates.
  std::vector<DepthKeypoint> outside = {keypoint(-5, 3, 100), keypoint(1e30, 3, 100), keypoint(std::nan(""), 3, 100),
                                        keypoint(std::numeric_limits<double>::infinity(), 3, 100)};
  EXPECT_TRUE(find_clusters(outside, levels, edges, options).members.empty());
  for (const DepthKeypoint& k : outside) EXPECT_EQ(k.cluster, -1);
  // A single keypoint, and many at one position.
  std::vector<DepthKeypoint> alone = {keypoint(30, 20, 100)};
  EXPECT_LE(find_clusters(alone, levels, edges, options).members.size(), 1u);
  std::vector<DepthKeypoint> heap(50, keypoint(30, 20, 100));
  EXPECT_LE(find_clusters(heap, levels, edges, options).members.size(), 1u);
  const cv::Mat1b other(40, 60, uchar{0});
  EXPECT_THROW(find_clusters(alone, levels, other, options), Error);
}

TEST_P(EveryMethod, AHundredThousandKeypoints) {
  Random random(9);
  const cv::Mat1b levels(500, 532, uchar{100}), edges(500, 532, uchar{0});
  std::vector<DepthKeypoint> many;
  for (int i = 0; i < 100000; ++i)
    many.push_back(keypoint(random.uniform(0, 531), random.uniform(0, 499), 100, random.uniform(0, 1)));
  ClusterOptions options;
  options.method = GetParam();
  options.max_keypoints = 500;
  const Clusters clusters = find_clusters(many, levels, edges, options);
  // Only the strongest are clustered.
  std::vector<double> strengths;
  for (const DepthKeypoint& k : many) strengths.push_back(k.strength);
  std::nth_element(strengths.begin(), strengths.begin() + 499, strengths.end(), std::greater<>());
  size_t clustered = 0;
  for (const DepthKeypoint& k : many) {
    if (k.cluster < 0) continue;
    ++clustered;
    EXPECT_GE(k.strength, strengths[499]);
  }
  EXPECT_LE(clustered, 500u);
  EXPECT_GE(clustered, 400u);
}

INSTANTIATE_TEST_SUITE_P(Clusters, EveryMethod, testing::ValuesIn(choice_values<ClusterMethod>()));

TEST(DepthSampling, TwoConnectionsAndNoCrossing) {
  for (uint64_t seed = 1; seed <= 10; ++seed) {
    Random random(seed);
    Boxes boxes;
    for (int i = 0; i < 120; ++i) {
      const double x = random.uniform(0, 199), y = random.uniform(0, 119);
      boxes.keypoints.push_back(keypoint(x, y, boxes.levels(static_cast<int>(y), static_cast<int>(x))));
    }
    const Clusters clusters = find_clusters(boxes.keypoints, boxes.levels, boxes.edges, {});
    for (const DepthKeypoint& k : boxes.keypoints) {
      if (k.cluster >= 0) {
        EXPECT_GE(k.connections, 2) << seed;
      }
    }
    for (size_t i = 0; i < clusters.connections.size(); ++i) {
      for (size_t j = 0; j < i; ++j)
        EXPECT_FALSE(crossing(boxes.keypoints, clusters.connections[i], clusters.connections[j])) << seed;
    }
  }
}

TEST(DepthSampling, DepthWithinAClusterIsBounded) {
  // A ramp from level 0 to 249 without edges.
  cv::Mat1b levels(60, 250);
  for (int c = 0; c < 250; ++c) levels.col(c) = static_cast<uchar>(c);
  std::vector<DepthKeypoint> keypoints;
  for (int c = 5; c < 250; c += 12) {
    for (const int r : {20, 32, 44}) keypoints.push_back(keypoint(c, r, c));
  }
  const Clusters clusters = find_clusters(keypoints, levels, cv::Mat1b(levels.size(), uchar{0}), {});
  EXPECT_GE(clusters.members.size(), 3u);
  for (const auto& members : clusters.members) {
    int low = 255, high = 0;
    for (const int m : members) {
      low = std::min(low, keypoints[static_cast<size_t>(m)].level);
      high = std::max(high, keypoints[static_cast<size_t>(m)].level);
    }
    EXPECT_LE(high - low, 80);
  }
}

TEST(DepthSampling, ATrenchParts) {
  // A trench 40 levels deeper than both sides, without edges; only depth samples detect it.
  cv::Mat1b levels(60, 120, uchar{120});
  levels.colRange(50, 70) = 80;
  std::vector<DepthKeypoint> keypoints;
  for (const int c : {15, 30, 42, 78, 90, 105}) {
    for (const int r : {15, 45}) keypoints.push_back(keypoint(c, r, 120));
  }
  const cv::Mat1b no_edges(levels.size(), uchar{0});
  find_clusters(keypoints, levels, no_edges, {});
  for (size_t i = 0; i < 6; ++i) {
    for (size_t j = 6; j < 12; ++j) EXPECT_NE(keypoints[i].cluster, keypoints[j].cluster);
  }
  ClusterOptions region;
  region.method = ClusterMethod::convex_hull;
  EXPECT_EQ(find_clusters(keypoints, levels, no_edges, region).members.size(), 1u);
}

TEST(Regions, BridgesDoNotJoin) {
  cv::Mat1b area(80, 160, uchar{0});
  area(cv::Rect(10, 10, 50, 60)) = 255;
  area(cv::Rect(90, 10, 50, 60)) = 255;
  area(cv::Rect(60, 30, 30, 5)) = 255;
  area(cv::Rect(145, 70, 5, 5)) = 255;
  const Regions regions = find_regions(area, 4, 300);
  ASSERT_EQ(regions.regions.size(), 2u);
  EXPECT_NE(regions.labels(40, 30), regions.labels(40, 110));
  EXPECT_EQ(regions.labels(72, 147), 0);
  for (const Region& region : regions.regions) EXPECT_NEAR(region.area_px, 50 * 60, 60);
  EXPECT_EQ(find_regions(area, 0, 300).regions.size(), 1u);
  EXPECT_TRUE(find_regions(cv::Mat1b(0, 0), 4, 1).regions.empty());
  EXPECT_TRUE(find_regions(cv::Mat1b(30, 30, uchar{0}), 4, 1).regions.empty());
}

}  // namespace
}  // namespace fringeslam
