// SPDX-License-Identifier: Apache-2.0
#include "core/map/pose_edges.h"

#include <Eigen/SparseCholesky>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>

#include "core/types/linear_algebra.h"

namespace fringeslam {

namespace {

using SparseMatrix = Eigen::SparseMatrix<double>;
using Rows6 = Eigen::Matrix<double, Eigen::Dynamic, 6, Eigen::RowMajor>;

// d log(Exp(a) R) = J_l^-1(log R) a.
Eigen::Matrix3d inverse_left_jacobian(const Eigen::Vector3d& log) {
  const double angle = log.norm();
  const double square = angle < 1e-3 ? 1.0 / 12 : 1 / (angle * angle) - 1 / (2 * angle * std::tan(angle / 2));
  const Eigen::Matrix3d k = skew(log);
  return Eigen::Matrix3d::Identity() - 0.5 * k + square * k * k;
}

// Sparse Cholesky factor L with P^T L L^T P = sum J^T J over the edges in use, in the tangents of all nodes that are
// not fixed.
class Factor {
 public:
  Factor(const std::vector<LinearEdge>& linear, const std::vector<PoseEdge>& edges, const std::vector<char>& use,
         const std::vector<int>& parts)
      : first_row_(parts.size(), -1) {
    int rows = 0;
    for (size_t node = 0; node < parts.size(); ++node) {
      if (parts[node] == static_cast<int>(node)) continue;  // each part's first node is fixed
      first_row_[node] = rows;
      rows += 6;
    }
    std::vector<Eigen::Triplet<double>> entries;
    const auto add = [&](int a, int b, const Matrix6d& block) {
      if (first_row_[a] < first_row_[b]) return;  // only the lower triangle is needed
      for (int col = 0; col < 6; ++col) {
        for (int row = a == b ? col : 0; row < 6; ++row)
          entries.emplace_back(first_row_[a] + row, first_row_[b] + col, block(row, col));
      }
    };
    for (size_t i = 0; i < edges.size(); ++i) {
      if (!use[i]) continue;
      const auto [from, to] = std::pair(edges[i].from, edges[i].to);
      const Matrix6d &a = linear[i].by_from, &b = linear[i].by_to;
      if (first_row_[from] >= 0) add(from, from, a.transpose() * a);
      if (first_row_[to] >= 0) add(to, to, b.transpose() * b);
      if (first_row_[from] < 0 || first_row_[to] < 0) continue;
      add(from, to, a.transpose() * b);
      add(to, from, b.transpose() * a);
    }
    SparseMatrix normal(rows, rows);
    normal.setFromTriplets(entries.begin(), entries.end());
    // Directions left free by singular information matrices are damped just enough for the factorisation to exist.
    llt_.analyzePattern(normal);
    for (double damping = 1e-13; damping < 1; damping *= 100) {
      SparseMatrix damped = normal;
      for (int i = 0; i < rows; ++i) damped.coeffRef(i, i) += std::max(damping * normal.coeff(i, i), 1e-12);
      llt_.factorize(damped);
      if (llt_.info() == Eigen::Success) return;
    }
  }

  // Returns J (sum J^T J)^-1 J^T of an edge, 6 x 6, exploiting the sparsity of the right-hand side in the
  // substitution.
  Matrix6d leverage(const PoseEdge& edge, const LinearEdge& linear) {
    const SparseMatrix& lower = llt_.matrixL().nestedExpression();
    const auto& order = llt_.permutationP().indices();
    solution_.setZero(lower.rows(), 6);
    Eigen::Index first = lower.rows();
    const auto place = [&](int node, const Matrix6d& jacobian) {
      if (first_row_[node] < 0) return;
      for (int i = 0; i < 6; ++i) {
        const Eigen::Index row = order[first_row_[node] + i];
        solution_.row(row) = jacobian.col(i).transpose();
        first = std::min(first, row);
      }
    };
    place(edge.from, linear.by_from);
    place(edge.to, linear.by_to);
    Matrix6d sum = Matrix6d::Zero();
    for (Eigen::Index col = first; col < lower.cols(); ++col) {
      if (solution_.row(col).isZero(0)) continue;
      SparseMatrix::InnerIterator entry(lower, col);
      const Eigen::Matrix<double, 1, 6> x = solution_.row(col) / entry.value();
      sum.noalias() += x.transpose() * x;
      for (++entry; entry; ++entry) solution_.row(entry.row()) -= entry.value() * x;
    }
    return sum;
  }

  // Returns the tangent of each node that solves the normal equations with this factor, given the sums of J^T r.
  std::vector<Vector6d> step(const std::vector<Vector6d>& gradient) const {
    Eigen::VectorXd right(llt_.rows());
    for (size_t node = 0; node < gradient.size(); ++node) {
      if (first_row_[node] >= 0) right.segment<6>(first_row_[node]) = -gradient[node];
    }
    const Eigen::VectorXd solution = llt_.solve(right);
    std::vector<Vector6d> steps(gradient.size(), Vector6d::Zero());
    for (size_t node = 0; node < gradient.size(); ++node) {
      if (first_row_[node] >= 0) steps[node] = solution.segment<6>(first_row_[node]);
    }
    return steps;
  }

 private:
  std::vector<int> first_row_;
  Eigen::SimplicialLLT<SparseMatrix> llt_;
  Rows6 solution_;
};

std::vector<LinearEdge> linearised(const std::vector<Pose>& poses, const std::vector<PoseEdge>& edges,
                                   const std::vector<Matrix6d>& roots) {
  std::vector<LinearEdge> linear;
  linear.reserve(edges.size());
  for (size_t i = 0; i < edges.size(); ++i)
    linear.push_back(linearise(edges[i], roots[i], poses[edges[i].from], poses[edges[i].to]));
  return linear;
}

// Returns chi^2 of a loop with residual and derivatives `linear`.
double chi2_of(const PoseEdge& edge, const LinearEdge& linear, bool in_use, Factor& factor) {
  const SymmetricEigen<6> eigen = symmetric_eigen(factor.leverage(edge, linear));
  const Vector6d along = eigen.vectors.transpose() * linear.residual;
  double chi2 = 0;
  for (int k = 0; k < 6; ++k) {
    // In sigmas of the edge, the residual's variance is 1 + g relative to a solution without the edge and 1 - g
    // within its own solution; if the latter is zero, no other edge constrains it.
    const double g = std::max(0.0, eigen.values[k]);
    const double variance = in_use ? 1 - g : 1 + g;
    if (variance > 1e-8) chi2 += along[k] * along[k] / variance;
  }
  return chi2;
}

}  // namespace

Matrix6d information_root(const Matrix6d& information, size_t edge) {
  const auto fail = [&](const std::string& what) {
    throw Error("pose graph: the information matrix of edge " + std::to_string(edge) + " " + what);
  };
  if (!information.allFinite()) fail("is not finite");
  const double size = information.cwiseAbs().maxCoeff();
  if ((information - information.transpose()).cwiseAbs().maxCoeff() > 1e-9 * size) fail("is not symmetric");
  const SymmetricEigen<6> eigen = symmetric_eigen(Matrix6d(0.5 * (information + information.transpose())));
  if (eigen.values.minCoeff() < -1e-9 * size) fail("has a negative eigenvalue");
  const Vector6d roots = eigen.values.cwiseMax(0).cwiseSqrt();
  return eigen.vectors * roots.asDiagonal() * eigen.vectors.transpose();
}

LinearEdge linearise(const PoseEdge& edge, const Matrix6d& root, const Pose& world_from_from,
                     const Pose& world_from_to) {
  const Eigen::Matrix3d back = world_from_from.rotation.transpose();
  const Eigen::Vector3d apart = world_from_to.translation - world_from_from.translation;
  const Vector6d off = difference({back * world_from_to.rotation, back * apart}, edge.from_from_to);
  Matrix6d by_to = Matrix6d::Zero();
  by_to.topLeftCorner<3, 3>() = inverse_left_jacobian(off.head<3>()) * back;
  by_to.bottomRightCorner<3, 3>() = back;
  Matrix6d by_from = -by_to;
  by_from.bottomLeftCorner<3, 3>() = back * skew(apart);
  return {root * off, root * by_from, root * by_to};
}

std::vector<int> connected_parts(size_t nodes, const std::vector<PoseEdge>& edges, const std::vector<char>& use) {
  std::vector<int> parent(nodes);
  std::iota(parent.begin(), parent.end(), 0);
  const auto lowest = [&](int node) {
    while (parent[node] != node) node = parent[node] = parent[parent[node]];
    return node;
  };
  for (size_t i = 0; i < edges.size(); ++i) {
    if (!use[i]) continue;
    const int a = lowest(edges[i].from), b = lowest(edges[i].to);
    parent[std::max(a, b)] = std::min(a, b);
  }
  for (size_t node = 0; node < nodes; ++node) parent[node] = lowest(static_cast<int>(node));
  return parent;
}

std::vector<double> loop_chi2(const std::vector<Pose>& poses, const std::vector<PoseEdge>& edges,
                              const std::vector<Matrix6d>& roots, const std::vector<char>& use) {
  const std::vector<int> parts = connected_parts(poses.size(), edges, use);
  const std::vector<LinearEdge> linear = linearised(poses, edges, roots);
  Factor factor(linear, edges, use, parts);
  std::vector<double> chi2(edges.size(), 0);
  for (size_t i = 0; i < edges.size(); ++i) {
    if (edges[i].loop && parts[edges[i].from] == parts[edges[i].to])
      chi2[i] = chi2_of(edges[i], linear[i], use[i], factor);
  }
  return chi2;
}

std::optional<RefinedPoses> refined_poses(const std::vector<Pose>& near, const std::vector<PoseEdge>& edges,
                                          const std::vector<Matrix6d>& roots, const std::vector<char>& use,
                                          size_t first) {
  constexpr int kMostSteps = 20;
  constexpr double kFine_sigmas = 1e-6;
  const std::vector<int> parts = connected_parts(near.size(), edges, use);
  std::vector<LinearEdge> linear = linearised(near, edges, roots);
  Factor factor(linear, edges, use, parts);
  RefinedPoses result{near, {}, 0};
  for (bool converged = false; !converged;) {
    if (++result.steps > kMostSteps) return std::nullopt;
    std::vector<Vector6d> gradient(near.size(), Vector6d::Zero());
    for (size_t i = 0; i < edges.size(); ++i) {
      if (!use[i]) continue;
      gradient[edges[i].from] += linear[i].by_from.transpose() * linear[i].residual;
      gradient[edges[i].to] += linear[i].by_to.transpose() * linear[i].residual;
    }
    const std::vector<Vector6d> steps = factor.step(gradient);
    double squared_sigmas = 0;
    for (size_t node = 0; node < near.size(); ++node) {
      squared_sigmas -= gradient[node].dot(steps[node]);
      result.poses[node] = retract(result.poses[node], steps[node]);
    }
    if (!std::isfinite(squared_sigmas)) return std::nullopt;
    converged = squared_sigmas < kFine_sigmas * kFine_sigmas;
    linear = linearised(result.poses, edges, roots);
  }
  result.chi2.assign(edges.size(), 0);
  for (size_t i = 0; i < edges.size(); ++i) {
    if (!edges[i].loop) continue;
    if (i >= first && parts[edges[i].from] == parts[edges[i].to])
      result.chi2[i] = chi2_of(edges[i], linear[i], use[i], factor);
    else if (i < first && use[i])
      result.chi2[i] = linear[i].residual.squaredNorm();
  }
  return result;
}

Matrix6d covariance_of_node(const std::vector<Pose>& poses, const std::vector<PoseEdge>& edges,
                            const std::vector<char>& use, int node) {
  const std::vector<int> parts = connected_parts(poses.size(), edges, use);
  std::vector<LinearEdge> linear;
  for (size_t i = 0; i < edges.size(); ++i)
    linear.push_back(
        linearise(edges[i], information_root(edges[i].information, i), poses[edges[i].from], poses[edges[i].to]));
  PoseEdge of_node;
  of_node.from = parts[node];
  of_node.to = node;
  return Factor(linear, edges, use, parts)
      .leverage(of_node, {Vector6d::Zero(), Matrix6d::Zero(), Matrix6d::Identity()});
}

}  // namespace fringeslam
