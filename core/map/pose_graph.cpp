// SPDX-License-Identifier: Apache-2.0
#include "core/map/pose_graph.h"

#include <ceres/ceres.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <optional>
#include <string>

#include "core/map/pose_edges.h"

namespace fringeslam {

namespace {

using State = std::array<double, 12>;  // rotation matrix (column-major), translation

State state_of(const Pose& pose) {
  State state;
  Eigen::Map<Eigen::Matrix3d>(state.data()) = pose.rotation;
  Eigen::Map<Eigen::Vector3d>(state.data() + 9) = pose.translation;
  return state;
}

Pose pose_of(const double* state) {
  return {Eigen::Map<const Eigen::Matrix3d>(state), Eigen::Map<const Eigen::Vector3d>(state + 9)};
}

// Manifold with retract() and difference(). Cost functions return derivatives with respect to the tangent in the first
// six columns; PlusJacobian passes them on unchanged.
class PoseManifold : public ceres::Manifold {
 public:
  int AmbientSize() const override { return 12; }
  int TangentSize() const override { return 6; }
  bool Plus(const double* x, const double* delta, double* x_plus_delta) const override {
    const State state = state_of(retract(pose_of(x), Eigen::Map<const Vector6d>(delta)));
    std::copy(state.begin(), state.end(), x_plus_delta);
    return true;
  }
  bool PlusJacobian(const double*, double* jacobian) const override {
    Eigen::Map<Eigen::Matrix<double, 12, 6, Eigen::RowMajor>>(jacobian).setIdentity();
    return true;
  }
  bool Minus(const double* y, const double* x, double* y_minus_x) const override {
    Eigen::Map<Vector6d>(y_minus_x, 6) = difference(pose_of(y), pose_of(x));
    return true;
  }
  bool MinusJacobian(const double*, double* jacobian) const override {
    Eigen::Map<Eigen::Matrix<double, 6, 12, Eigen::RowMajor>>(jacobian).setIdentity();
    return true;
  }
};

class EdgeCost : public ceres::SizedCostFunction<6, 12, 12> {
 public:
  EdgeCost(const PoseEdge& edge, const Matrix6d& root, const double& weight)
      : edge_(edge), root_(root), weight_(weight) {}

  bool Evaluate(double const* const* states, double* residual, double** jacobians) const override {
    const LinearEdge linear = linearise(edge_, root_, pose_of(states[0]), pose_of(states[1]));
    const double root = std::sqrt(weight_);
    Eigen::Map<Vector6d>(residual, 6) = root * linear.residual;
    const auto write = [&](int i, const Matrix6d& by) {
      if (!jacobians || !jacobians[i]) return;
      Eigen::Map<Eigen::Matrix<double, 6, 12, Eigen::RowMajor>> out(jacobians[i]);
      out.setZero();
      out.leftCols<6>() = root * by;
    };
    write(0, linear.by_from);
    write(1, linear.by_to);
    return true;
  }

 private:
  const PoseEdge& edge_;
  const Matrix6d& root_;
  const double& weight_;
};

class Graph {
 public:
  Graph(const std::vector<Pose>& initial, const std::vector<PoseEdge>& edges, const PoseGraphOptions& options)
      : edges_(edges), options_(options), limit_(options.loop_sigma * options.loop_sigma), weights_(edges.size(), 1) {
    for (const Pose& pose : initial) states_.push_back(state_of(pose));
    for (size_t i = 0; i < edges.size(); ++i) roots_.push_back(information_root(edges[i].information, i));
    ceres::Problem::Options problem_options;
    problem_options.manifold_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    problem_ = std::make_unique<ceres::Problem>(problem_options);
    const std::vector<int> parts = connected_parts(initial.size(), edges, std::vector<char>(edges.size(), 1));
    std::vector<int> sizes(initial.size(), 0);
    for (const int part : parts) ++sizes[part];
    for (size_t node = 0; node < initial.size(); ++node) {
      if (sizes[parts[node]] < 2) continue;
      problem_->AddParameterBlock(states_[node].data(), 12, &manifold_);
      if (parts[node] == static_cast<int>(node)) problem_->SetParameterBlockConstant(states_[node].data());
    }
    for (size_t i = 0; i < edges.size(); ++i) {
      problem_->AddResidualBlock(new EdgeCost(edges[i], roots_[i], weights_[i]), nullptr, states_[edges[i].from].data(),
                                 states_[edges[i].to].data());
    }
  }

  PoseGraphResult solved(const std::vector<Pose>& initial, const std::vector<double>& earlier_weights) {
    PoseGraphResult result;
    bool settled = true;
    const bool loops = std::any_of(edges_.begin(), edges_.end(), [](const PoseEdge& edge) { return edge.loop; });
    const bool select = loops && options_.reject_loops;
    result.all_tested = !(select && fits_earlier(earlier_weights));
    if (select && result.all_tested) {
      for (size_t i = 0; i < states_.size(); ++i) states_[i] = state_of(initial[i]);
      test_against_odometry();
      graduate();
      settled = test_against_accepted();
    }
    result.converged = !result.all_tested || (solve(kFine) && settled);
    result.iterations = iterations_;
    result.weights = weights_;
    for (size_t node = 0; node < initial.size(); ++node) {
      // A pose that did not move is returned bit for bit.
      const bool moved = states_[node] != state_of(initial[node]);
      result.poses.push_back(moved ? orthonormalised(pose(node)) : initial[node]);
    }
    result.initial_cost = cost(initial);
    result.cost = cost(result.poses);
    return result;
  }

 private:
  // Relative change of the cost, and while loops are being selected.
  static constexpr double kFine = 1e-14, kCoarse = 1e-4;

  Pose pose(size_t node) const { return pose_of(states_[node].data()); }

  std::vector<Pose> poses() const {
    std::vector<Pose> result;
    for (size_t node = 0; node < states_.size(); ++node) result.push_back(pose(node));
    return result;
  }

  bool solve(double tolerance) {
    if (problem_->NumResidualBlocks() == 0) return true;
    ceres::Solver::Options options;
    options.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
    options.sparse_linear_algebra_library_type = ceres::EIGEN_SPARSE;  // single-threaded, fixed summation order
    options.num_threads = 1;
    options.max_num_iterations = options_.max_iterations;
    options.function_tolerance = tolerance;
    options.parameter_tolerance = 1e-14;
    // Damping relative to the diagonal suppresses joint motion of a long chain, so start with almost none.
    options.initial_trust_region_radius = 1e14;
    options.logging_type = ceres::SILENT;
    ceres::Solver::Summary summary;
    ceres::Solve(options, problem_.get(), &summary);
    iterations_ += static_cast<int>(summary.iterations.size()) - 1;
    return summary.termination_type == ceres::CONVERGENCE;
  }

  double squared_sigmas(size_t i) const {
    return linearise(edges_[i], roots_[i], pose(edges_[i].from), pose(edges_[i].to)).residual.squaredNorm();
  }

  double cost(const std::vector<Pose>& at) const {
    double sum = 0;
    for (size_t i = 0; i < edges_.size(); ++i)
      sum += weights_[i] * linearise(edges_[i], roots_[i], at[edges_[i].from], at[edges_[i].to]).residual.squaredNorm();
    return sum / 2;
  }

  std::vector<char> used() const {
    std::vector<char> use(edges_.size());
    for (size_t i = 0; i < edges_.size(); ++i) use[i] = weights_[i] > 0;
    return use;
  }

  std::vector<double> chi2() const { return loop_chi2(poses(), edges_, roots_, used()); }

  // Solves with the loops that were accepted earlier and the new ones; returns whether these are consistent.
  bool fits_earlier(const std::vector<double>& earlier_weights) {
    // Where many loops contradict each other, the next one may be what decides which are true.
    constexpr int kLeastAcceptedPerRejected = 10;
    int accepted = 0, rejected = 0;
    for (size_t i = 0; i < earlier_weights.size(); ++i) {
      if (edges_[i].loop) ++(earlier_weights[i] > 0 ? accepted : rejected);
    }
    if (accepted == 0 || accepted < kLeastAcceptedPerRejected * rejected) return false;
    for (size_t i = 0; i < edges_.size(); ++i) weights_[i] = i < earlier_weights.size() ? earlier_weights[i] : 1;
    const std::optional<RefinedPoses> refined = refined_poses(poses(), edges_, roots_, used(), earlier_weights.size());
    if (!refined) return false;
    for (size_t i = 0; i < edges_.size(); ++i) {
      if (weights_[i] > 0 && refined->chi2[i] > limit_) return false;
    }
    for (size_t i = 0; i < states_.size(); ++i) states_[i] = state_of(refined->poses[i]);
    iterations_ += refined->steps;
    return true;
  }

  // Tests loops against the non-loop edges. Drift bends a chain beyond what the linearised test covers, so the limit
  // is doubled here, in sigmas.
  void test_against_odometry() {
    for (size_t i = 0; i < edges_.size(); ++i) weights_[i] = !edges_[i].loop;
    solve(kCoarse);
    const std::vector<double> distances = chi2();
    for (size_t i = 0; i < edges_.size(); ++i) weights_[i] = distances[i] <= 4 * limit_;
  }

  void graduate() {
    std::vector<size_t> loops;
    for (size_t i = 0; i < edges_.size(); ++i) {
      if (edges_[i].loop && weights_[i] > 0) loops.push_back(i);
    }
    solve(kCoarse);
    double worst = 0;
    for (const size_t i : loops) worst = std::max(worst, squared_sigmas(i));
    constexpr double kStep = 2;
    for (double mu = limit_ / (2 * worst - limit_); worst > limit_; mu *= kStep) {
      bool graded = false;
      for (const size_t i : loops) {
        const double squared = squared_sigmas(i);
        weights_[i] = std::clamp(std::sqrt(limit_ * mu * (mu + 1) / squared) - mu, 0.0, 1.0);
        graded |= weights_[i] > 0 && weights_[i] < 1;
      }
      solve(kCoarse);
      if (!graded || mu > 1e6) break;
    }
    for (const size_t i : loops) weights_[i] = weights_[i] > 0.5;
  }

  // Returns false if the selection does not converge.
  bool test_against_accepted() {
    constexpr int kRounds = 50;
    for (int round = 0; round < kRounds; ++round) {
      solve(kCoarse);
      const std::vector<double> distances = chi2();
      double worst = 0;
      for (size_t i = 0; i < edges_.size(); ++i) {
        if (weights_[i] > 0) worst = std::max(worst, distances[i]);
      }
      bool changed = false;
      for (size_t i = 0; i < edges_.size(); ++i) {
        if (!edges_[i].loop) continue;
        // Loops nearly as bad as the worst are rejected with it; those rejected wrongly are accepted again later.
        const bool believed = worst > limit_ ? weights_[i] > 0 && distances[i] <= 0.5 * worst : distances[i] <= limit_;
        changed |= believed != (weights_[i] > 0);
        weights_[i] = believed;
      }
      if (!changed) return true;
    }
    return false;
  }

  const std::vector<PoseEdge>& edges_;
  const PoseGraphOptions& options_;
  const double limit_;
  std::vector<double> weights_;
  std::vector<State> states_;
  std::vector<Matrix6d> roots_;
  PoseManifold manifold_;
  std::unique_ptr<ceres::Problem> problem_;
  int iterations_ = 0;
};

}  // namespace

PoseGraphResult optimise_poses(const std::vector<Pose>& initial, const std::vector<PoseEdge>& edges,
                               const PoseGraphOptions& options, const std::vector<double>& earlier_weights) {
  check_options(options, "pose_graph");
  const auto nodes = static_cast<int>(initial.size());
  for (size_t i = 0; i < initial.size(); ++i) {
    if (!initial[i].is_finite())
      throw Error("pose graph: the initial pose of node " + std::to_string(i) + " is not finite");
  }
  for (size_t i = 0; i < edges.size(); ++i) {
    const PoseEdge& edge = edges[i];
    const std::string name = "pose graph: edge " + std::to_string(i) + " from node " + std::to_string(edge.from) +
                             " to node " + std::to_string(edge.to);
    if (std::min(edge.from, edge.to) < 0 || std::max(edge.from, edge.to) >= nodes || edge.from == edge.to)
      throw Error(name + " does not join two of the " + std::to_string(nodes) + " nodes");
    if (!edge.from_from_to.is_finite()) throw Error(name + ": its pose is not finite");
  }
  if (earlier_weights.size() > edges.size())
    throw Error("pose graph: there are " + std::to_string(earlier_weights.size()) + " earlier weights for " +
                std::to_string(edges.size()) + " edges");
  return Graph(initial, edges, options).solved(initial, earlier_weights);
}

}  // namespace fringeslam
