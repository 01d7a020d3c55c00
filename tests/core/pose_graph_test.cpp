// SPDX-License-Identifier: Apache-2.0
#include "core/map/pose_graph.h"

#include <gmock/gmock.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <limits>
#include <numbers>

#include "tests/support/matchers.h"
#include "tests/support/random.h"

namespace fringeslam {
namespace {

using support::error_of;
using support::PoseNear;
using support::Random;
using testing::HasSubstr;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

Vector6d sigmas(double rad, double m) {
  Vector6d result;
  result << rad, rad, rad, m, m, m;
  return result;
}

Matrix6d information_of(const Vector6d& sigma) { return sigma.cwiseAbs2().cwiseInverse().asDiagonal(); }

// Laps of a circle of 2 m radius, slightly offset, with varying viewing directions.
std::vector<Pose> laps(int nodes, int nodes_per_lap) {
  std::vector<Pose> poses;
  for (int i = 0; i < nodes; ++i) {
    const double angle = 2 * std::numbers::pi * i / nodes_per_lap;
    poses.push_back({rotation_exp({0, 0, angle}) * rotation_exp({0.3 * std::sin(7 * angle), 0.1, 0}),
                     {2 * std::cos(angle), 2 * std::sin(angle), 0.05 * std::sin(3 * angle) + 1e-3 * i}});
  }
  return poses;
}

PoseEdge exact_edge(const std::vector<Pose>& truth, int from, int to, const Matrix6d& information, bool loop) {
  return {from, to, truth[from].inverse() * truth[to], information, loop};
}

PoseEdge noisy_edge(const std::vector<Pose>& truth, int from, int to, const Matrix6d& information, bool loop,
                    Random& random) {
  PoseEdge edge = exact_edge(truth, from, to, information, loop);
  edge.from_from_to = retract(edge.from_from_to, random.gaussian<6>(Matrix6d(information.inverse())));
  return edge;
}

// Poses from the odometry edges i -> i + 1, which come first.
std::vector<Pose> dead_reckoning(const Pose& start, const std::vector<PoseEdge>& edges, size_t nodes) {
  std::vector<Pose> poses = {start};
  for (size_t i = 0; i + 1 < nodes; ++i) poses.push_back(poses.back() * edges[i].from_from_to);
  return poses;
}

std::vector<Pose> perturbed(std::vector<Pose> poses, double rad, double m, Random& random) {
  for (size_t i = 1; i < poses.size(); ++i)
    poses[i] = retract(poses[i], sigmas(rad, m).cwiseProduct(random.normals<6>()));
  return poses;
}

void expect_poses(const std::vector<Pose>& poses, const std::vector<Pose>& expected, double tolerance) {
  ASSERT_EQ(poses.size(), expected.size());
  for (size_t i = 0; i < poses.size(); ++i)
    EXPECT_THAT(poses[i], PoseNear(expected[i], tolerance, tolerance)) << "node " << i;
}

TEST(PoseGraph, ExactMeasurementsGiveTheTruth) {
  const std::vector<Pose> truth = laps(60, 20);
  std::vector<PoseEdge> edges;
  for (int i = 0; i + 1 < 60; ++i)
    edges.push_back(exact_edge(truth, i, i + 1, information_of(sigmas(1e-3, 2e-3)), false));
  for (int i = 0; i + 20 < 60; i += 4)
    edges.push_back(exact_edge(truth, i + 20, i, information_of(sigmas(5e-4, 1e-3)), true));
  for (int seed = 0; seed < 5; ++seed) {
    Random random(seed);
    const PoseGraphResult result = optimise_poses(perturbed(truth, 0.1, 0.1, random), edges, {});
    EXPECT_TRUE(result.converged);
    expect_poses(result.poses, truth, 1e-9);
    EXPECT_THAT(result.weights, testing::Each(1.0));
    EXPECT_GT(result.initial_cost, 1);
    EXPECT_LT(result.cost, 1e-9);
  }
}

TEST(PoseGraph, TheFirstNodeIsHeld) {
  const std::vector<Pose> truth = laps(10, 10);
  std::vector<PoseEdge> edges;
  Random random(1);
  for (int i = 0; i + 1 < 10; ++i)
    edges.push_back(noisy_edge(truth, i, i + 1, information_of(sigmas(1e-2, 1e-2)), false, random));
  edges.push_back(noisy_edge(truth, 9, 0, information_of(sigmas(1e-2, 1e-2)), true, random));
  const PoseGraphResult result = optimise_poses(truth, edges, {});
  EXPECT_EQ(result.poses[0].rotation, truth[0].rotation);
  EXPECT_EQ(result.poses[0].translation, truth[0].translation);
  EXPECT_GT(translation_m(result.poses[5].inverse() * truth[5]), 1e-4);
}

// Numerical sum of J^T J of all edges, in the tangents of all nodes but the first.
Eigen::MatrixXd information_of_nodes(const std::vector<Pose>& poses, const std::vector<PoseEdge>& edges) {
  const auto size = static_cast<Eigen::Index>(6 * (poses.size() - 1));
  Eigen::MatrixXd information = Eigen::MatrixXd::Zero(size, size);
  constexpr double kStep = 1e-6;
  for (const PoseEdge& edge : edges) {
    Eigen::MatrixXd jacobian = Eigen::MatrixXd::Zero(6, size);
    for (const int node : {edge.from, edge.to}) {
      for (int i = 0; node > 0 && i < 6; ++i) {
        const auto residual = [&](double step) {
          const Pose moved = retract(poses[node], step * Vector6d::Unit(i));
          const Pose& a = node == edge.from ? moved : poses[edge.from];
          const Pose& b = node == edge.to ? moved : poses[edge.to];
          return difference(a.inverse() * b, edge.from_from_to);
        };
        jacobian.col(6 * (node - 1) + i) = (residual(kStep) - residual(-kStep)) / (2 * kStep);
      }
    }
    information += jacobian.transpose() * edge.information * jacobian;
  }
  return information;
}

TEST(PoseGraph, ErrorsAreWhatTheInformationsSay) {
  constexpr int kSeeds = 200, kNodes = 24, kNode = 13;
  const std::vector<Pose> truth = laps(kNodes, 8);
  double residuals = 0, nees = 0;
  int freedom = 0;
  for (int seed = 0; seed < kSeeds; ++seed) {
    Random random(100 + seed);
    std::vector<PoseEdge> edges;
    Matrix6d mix = Matrix6d::Identity();  // correlated information matrices
    mix.topRightCorner<3, 3>() = 0.3 * skew({0.2, -0.5, 0.4});
    const Matrix6d odometry = mix.transpose() * information_of(sigmas(1e-3, 2e-3)) * mix;
    for (int i = 0; i + 1 < kNodes; ++i) edges.push_back(noisy_edge(truth, i, i + 1, odometry, false, random));
    for (int i = 0; i + 8 < kNodes; i += 3)
      edges.push_back(noisy_edge(truth, i + 8, i, information_of(sigmas(5e-4, 1e-3)), true, random));
    const PoseGraphResult result = optimise_poses(dead_reckoning(truth[0], edges, kNodes), edges, {});
    ASSERT_TRUE(result.converged);
    ASSERT_THAT(result.weights, testing::Each(1.0));
    residuals += 2 * result.cost;
    freedom += 6 * (static_cast<int>(edges.size()) - (kNodes - 1));
    const Eigen::MatrixXd covariance = information_of_nodes(result.poses, edges).inverse();
    const Vector6d error = difference(result.poses[kNode], truth[kNode]);
    nees += error.dot(covariance.block<6, 6>(6 * (kNode - 1), 6 * (kNode - 1)).llt().solve(error));
  }
  // Chi-square with n degrees of freedom has the standard deviation sqrt(2 n).
  EXPECT_NEAR(residuals, freedom, 1.96 * std::sqrt(2.0 * freedom));
  EXPECT_NEAR(nees / kSeeds, 6, 1.96 * std::sqrt(12.0 / kSeeds));
  RecordProperty("nees", std::to_string(nees / kSeeds));
  RecordProperty("chi2_per_freedom", std::to_string(residuals / freedom));
}

TEST(PoseGraph, ARingTakesUpItsGapInProportionToTheCovariances) {
  constexpr int kNodes = 12;
  // Rotations are known; each side, including the closing one, has its own covariance.
  const auto sigma = [](int i) { return 1e-3 * (1 + i % 4); };
  const Eigen::Vector3d gap(0.012, -0.02, 0.007);
  std::vector<Pose> truth;
  for (int i = 0; i < kNodes; ++i) {
    const double angle = 2 * std::numbers::pi * i / kNodes;
    truth.push_back({Eigen::Matrix3d::Identity(), {std::cos(angle), std::sin(angle), 0}});
  }
  std::vector<PoseEdge> edges;
  double variance = 0;
  for (int i = 0; i < kNodes; ++i) {
    edges.push_back(exact_edge(truth, i, (i + 1) % kNodes, information_of(sigmas(1e-9, sigma(i))), i == kNodes - 1));
    variance += sigma(i) * sigma(i);
  }
  edges.back().from_from_to.translation += gap;
  const PoseGraphResult result = optimise_poses(truth, edges, {});
  EXPECT_TRUE(result.converged);
  EXPECT_EQ(result.weights.back(), 1);
  std::vector<Pose> expected = truth;
  double so_far = 0;
  for (int i = 1; i < kNodes; ++i) {
    so_far += sigma(i - 1) * sigma(i - 1);
    expected[i].translation -= gap * (so_far / variance);
  }
  expect_poses(result.poses, expected, 1e-9);
  EXPECT_NEAR(2 * result.cost, gap.squaredNorm() / variance, 1e-6);
}

// Off by several metres and an arbitrary rotation.
PoseEdge false_loop(int from, int to, const Matrix6d& information, Random& random) {
  return {
      from, to, {rotation_exp(random.uniform(0, 3) * random.direction()), 4 * random.normals<3>()}, information, true};
}

class FalseLoops : public testing::TestWithParam<int> {};
INSTANTIATE_TEST_SUITE_P(Seeds, FalseLoops, testing::Range(0, 12));

// Laps of the circle whose loops follow each node's odometry. `one_in` of them is false.
struct GrowingGraph {
  std::vector<Pose> truth;
  std::vector<PoseEdge> edges;
  std::vector<char> is_false;  // per edge
};

GrowingGraph growing_graph(int nodes, int lap, int one_in, Random& random) {
  GrowingGraph graph{laps(nodes, lap), {}, {}};
  const Matrix6d odometry = information_of(sigmas(2e-3, 4e-3)), closure = information_of(sigmas(1e-3, 2e-3));
  const auto add = [&](const PoseEdge& edge, bool wrong) {
    graph.edges.push_back(edge);
    graph.is_false.push_back(wrong);
  };
  for (int node = 1; node < nodes; ++node) {
    add(noisy_edge(graph.truth, node - 1, node, odometry, false, random), false);
    if (node < lap || node % 2 == 0) continue;
    const bool wrong = random.uniform(0, one_in) < 1;
    PoseEdge loop = noisy_edge(graph.truth, node, node % lap, closure, true, random);
    if (wrong && node % 3 == 0)
      loop = false_loop(node, static_cast<int>(random.uniform(0, node)), closure, random);
    else if (wrong)
      loop.from_from_to.translation += random.uniform(0.1, 0.5) * random.direction();
    add(loop, wrong);
  }
  return graph;
}

TEST_P(FalseLoops, AreRejectedInAGrowingGraphAsInAWholeOne) {
  constexpr int kNodes = 110, kLap = 30;
  Random random(7000 + GetParam());
  const bool few = GetParam() % 2 == 0;
  const GrowingGraph graph = growing_graph(kNodes, kLap, few ? 25 : 4, random);
  std::vector<Pose> poses = {graph.truth[0]};
  std::vector<PoseEdge> edges;
  std::vector<double> weights;
  int kept = 0;
  for (const PoseEdge& edge : graph.edges) {
    edges.push_back(edge);
    if (!edge.loop) {
      poses.push_back(poses.back() * edge.from_from_to);
      continue;
    }
    const PoseGraphResult result = optimise_poses(poses, edges, {}, weights);
    kept += !result.all_tested;
    // Two loops that contradict each other and nothing else have no selection.
    if (const PoseGraphResult whole = optimise_poses(poses, edges, {}); whole.converged) {
      ASSERT_EQ(result.weights, whole.weights) << edges.size() << " edges";
      expect_poses(result.poses, whole.poses, 1e-8);
    }
    poses = result.poses;
    weights = result.converged ? result.weights : std::vector<double>();
  }
  EXPECT_GE(kept, few ? 8 : 0);  // of 40 times
  for (size_t i = 0; i < edges.size(); ++i) EXPECT_EQ(weights[i], graph.is_false[i] ? 0 : 1) << "edge " << i;
}

// Mixed kinds: off by metres, off by decimetres (within what drift explains), and some consistent with each other.
TEST_P(FalseLoops, ThreeInTenAreRejectedAndAllTrueOnesKept) {
  constexpr int kNodes = 160, kLap = 40, kLoops = 60;
  Random random(2000 + GetParam());
  const std::vector<Pose> truth = laps(kNodes, kLap);
  const Matrix6d odometry = information_of(sigmas(2e-3, 4e-3)), closure = information_of(sigmas(1e-3, 2e-3));
  std::vector<PoseEdge> edges;
  for (int i = 0; i + 1 < kNodes; ++i) edges.push_back(noisy_edge(truth, i, i + 1, odometry, false, random));
  std::vector<char> is_false(edges.size(), 0);
  const Pose alike = {rotation_exp({0.1, 0.05, -0.1}), {0.3, -0.4, 0.1}};
  for (int i = 0; i < kLoops; ++i) {
    const int from = static_cast<int>(random.uniform(kLap, kNodes)), to = from % kLap;
    const bool wrong = i % 10 < 3;
    PoseEdge edge = noisy_edge(truth, from, to, closure, true, random);
    if (wrong && i % 3 == 0)
      edge = false_loop(from, static_cast<int>(random.uniform(0, from)), closure, random);
    else if (wrong && i % 3 == 1)
      edge.from_from_to.translation += random.uniform(0.05, 0.5) * random.direction();
    else if (wrong)
      edge.from_from_to = edge.from_from_to * alike;
    edges.push_back(edge);
    is_false.push_back(wrong);
  }
  const PoseGraphResult result = optimise_poses(dead_reckoning(truth[0], edges, kNodes), edges, {});
  EXPECT_TRUE(result.converged);
  for (size_t i = 0; i < edges.size(); ++i)
    EXPECT_EQ(result.weights[i], is_false[i] ? 0 : 1) << "edge " << i << ": " << edges[i].from << " to " << edges[i].to;

  std::vector<PoseEdge> true_edges;
  for (size_t i = 0; i < edges.size(); ++i) {
    if (!is_false[i]) true_edges.push_back(edges[i]);
  }
  const PoseGraphResult without =
      optimise_poses(dead_reckoning(truth[0], edges, kNodes), true_edges, {.reject_loops = false});
  expect_poses(result.poses, without.poses, 1e-8);
}

TEST(PoseGraph, AFalseLoopAloneLeavesTheOdometry) {
  constexpr int kNodes = 50;
  const std::vector<Pose> truth = laps(kNodes, kNodes);
  for (const double off : {0.2, 1.0, 5.0}) {
    Random random(3);
    std::vector<PoseEdge> edges;
    for (int i = 0; i + 1 < kNodes; ++i)
      edges.push_back(noisy_edge(truth, i, i + 1, information_of(sigmas(5e-4, 2e-3)), false, random));
    const std::vector<Pose> odometry = dead_reckoning(truth[0], edges, kNodes);
    edges.push_back(exact_edge(odometry, kNodes - 1, 0, information_of(sigmas(1e-4, 1e-4)), true));
    edges.back().from_from_to.translation.x() += off;
    const PoseGraphResult result = optimise_poses(odometry, edges, {});
    EXPECT_TRUE(result.converged);
    EXPECT_EQ(result.weights.back(), 0) << off;
    expect_poses(result.poses, odometry, 1e-9);
  }
}

TEST(PoseGraph, ALoopFarMoreCertainThanTheOdometryIsMet) {
  constexpr int kNodes = 40;
  const std::vector<Pose> truth = laps(kNodes, kNodes);
  Random random(4);
  std::vector<PoseEdge> edges;
  for (int i = 0; i + 1 < kNodes; ++i)
    edges.push_back(noisy_edge(truth, i, i + 1, information_of(sigmas(1e-3, 2e-3)), false, random));
  edges.push_back(exact_edge(truth, kNodes - 1, 0, information_of(sigmas(1e-8, 1e-8)), true));
  const PoseGraphResult result = optimise_poses(dead_reckoning(truth[0], edges, kNodes), edges, {});
  EXPECT_TRUE(result.converged);
  EXPECT_EQ(result.weights.back(), 1);
  EXPECT_THAT(result.poses[kNodes - 1], PoseNear(truth[kNodes - 1], 1e-8, 1e-8));
}

TEST(PoseGraph, SmallGraphs) {
  EXPECT_TRUE(optimise_poses({}, {}, {}).converged);
  const std::vector<Pose> some = laps(4, 7);
  for (const size_t nodes : {1, 4}) {
    const std::vector<Pose> initial(some.begin(), some.begin() + nodes);
    const PoseGraphResult result = optimise_poses(initial, {}, {});
    EXPECT_TRUE(result.converged);
    EXPECT_EQ(result.cost, 0);
    expect_poses(result.poses, initial, 0);
  }
}

TEST(PoseGraph, NodesThatNothingJoinsStay) {
  const std::vector<Pose> truth = laps(8, 8);
  Random random(5);
  const std::vector<Pose> initial = perturbed(truth, 0.05, 0.05, random);
  const Matrix6d information = information_of(sigmas(1e-3, 1e-3));
  // 0-1-2 and 4-5 are connected; 3, 6 and 7 are isolated.
  const std::vector<PoseEdge> edges = {exact_edge(truth, 0, 1, information, false),
                                       exact_edge(truth, 2, 1, information, false),
                                       exact_edge(truth, 5, 4, information, false)};
  const PoseGraphResult result = optimise_poses(initial, edges, {});
  EXPECT_TRUE(result.converged);
  std::vector<Pose> expected = initial;
  for (const int i : {1, 2}) expected[i] = truth[i];
  expected[5] = initial[4] * (truth[4].inverse() * truth[5]);
  expect_poses(result.poses, expected, 1e-9);
}

TEST(PoseGraph, APartThatOnlyLoopsJoinIsBroughtToItsPlace) {
  const std::vector<Pose> truth = laps(20, 20);
  const Matrix6d information = information_of(sigmas(1e-3, 1e-3));
  std::vector<PoseEdge> edges;
  for (int i = 0; i + 1 < 20; ++i) {
    if (i != 9) edges.push_back(exact_edge(truth, i, i + 1, information, false));
  }
  for (const int i : {2, 5, 8}) edges.push_back(exact_edge(truth, i, i + 10, information, true));
  std::vector<Pose> initial = truth;
  for (int i = 10; i < 20; ++i) initial[i] = Pose{rotation_exp({0.4, -0.2, 0.3}), {3, -2, 1}} * truth[i];
  const PoseGraphResult result = optimise_poses(initial, edges, {});
  EXPECT_TRUE(result.converged);
  EXPECT_THAT(result.weights, testing::Each(1.0));
  expect_poses(result.poses, truth, 1e-9);
}

TEST(PoseGraph, SingularInformationsSayNothingOfTheirDirections) {
  const std::vector<Pose> truth = laps(6, 6);
  Vector6d slides = Vector6d::Constant(1e6);
  slides[4] = 0;
  std::vector<PoseEdge> edges;
  for (int i = 0; i + 1 < 6; ++i) {
    edges.push_back(exact_edge(truth, i, i + 1, slides.asDiagonal(), false));
    edges.back().from_from_to.translation.y() += 0.3;  // an unconstrained direction
  }
  for (int i = 0; i + 2 < 6; i += 2)
    edges.push_back(exact_edge(truth, i, i + 2, information_of(sigmas(1e-3, 1e-3)), true));
  edges.push_back(exact_edge(truth, 1, 3, information_of(sigmas(1e-3, 1e-3)), true));
  edges.push_back(exact_edge(truth, 0, 5, information_of(sigmas(1e-3, 1e-3)), true));
  edges.push_back(exact_edge(truth, 0, 3, information_of(sigmas(1e-3, 1e-3)), true));
  Random random(6);
  const PoseGraphResult result = optimise_poses(perturbed(truth, 0.02, 0.02, random), edges, {});
  EXPECT_TRUE(result.converged);
  expect_poses(result.poses, truth, 1e-9);
}

TEST(PoseGraph, TheSameResultOnEveryCall) {
  constexpr int kNodes = 60;
  const std::vector<Pose> truth = laps(kNodes, 20);
  Random random(7);
  std::vector<PoseEdge> edges;
  const Matrix6d information = information_of(sigmas(1e-3, 2e-3));
  for (int i = 0; i + 1 < kNodes; ++i) edges.push_back(noisy_edge(truth, i, i + 1, information, false, random));
  for (int i = 20; i < kNodes; i += 4) edges.push_back(noisy_edge(truth, i, i % 20, information, true, random));
  edges.push_back(false_loop(50, 3, information, random));
  const std::vector<Pose> initial = dead_reckoning(truth[0], edges, kNodes);
  const PoseGraphResult first = optimise_poses(initial, edges, {}), again = optimise_poses(initial, edges, {});
  for (size_t i = 0; i < first.poses.size(); ++i) {
    EXPECT_EQ(first.poses[i].rotation, again.poses[i].rotation);
    EXPECT_EQ(first.poses[i].translation, again.poses[i].translation);
  }
  EXPECT_EQ(first.weights, again.weights);
  EXPECT_EQ(first.cost, again.cost);
}

TEST(PoseGraph, InvalidGraphsAreRefused) {
  const std::vector<Pose> poses = laps(3, 3);
  const PoseEdge good = exact_edge(poses, 0, 1, Matrix6d::Identity(), false);
  const auto refused = [&](const auto& spoil) {
    std::vector<PoseEdge> edges = {good, good};
    spoil(edges[1]);
    return error_of([&] { optimise_poses(poses, edges, {}); });
  };
  EXPECT_THAT(refused([](PoseEdge& e) { e.from_from_to.translation.x() = kNaN; }), HasSubstr("edge 1"));
  EXPECT_THAT(refused([](PoseEdge& e) { e.from_from_to.rotation(1, 1) = kNaN; }), HasSubstr("not finite"));
  EXPECT_THAT(refused([](PoseEdge& e) { e.information(2, 3) = kNaN; }), HasSubstr("edge 1 is not finite"));
  EXPECT_THAT(refused([](PoseEdge& e) { e.information(2, 3) = 1; }), HasSubstr("not symmetric"));
  EXPECT_THAT(refused([](PoseEdge& e) { e.information(3, 3) = -1; }), HasSubstr("negative"));
  EXPECT_THAT(refused([](PoseEdge& e) { e.to = 3; }), HasSubstr("node 3"));
  EXPECT_THAT(refused([](PoseEdge& e) { e.from = -1; }), HasSubstr("does not join"));
  EXPECT_THAT(refused([](PoseEdge& e) { e.to = e.from; }), HasSubstr("does not join"));
  std::vector<Pose> broken = poses;
  broken[2].translation.y() = kNaN;
  EXPECT_THAT(error_of([&] { optimise_poses(broken, {good}, {}); }), HasSubstr("node 2"));
  EXPECT_THAT(error_of([&] { optimise_poses(poses, {good}, {.loop_sigma = 0}); }), HasSubstr("pose_graph.loop_sigma"));
}

}  // namespace
}  // namespace fringeslam
