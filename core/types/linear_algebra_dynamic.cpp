// SPDX-License-Identifier: Apache-2.0
// The decompositions of matrices whose size is known at run time only.
#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/SVD>

#include "core/types/linear_algebra.h"

namespace fringeslam {

namespace {

using Eigen::MatrixXd;

SingularValues svd(const MatrixXd& matrix, unsigned parts) {
  const Eigen::JacobiSVD<MatrixXd> solver(matrix, parts);
  return {solver.matrixU(), solver.matrixV(), solver.singularValues()};
}

}  // namespace

Eigen::VectorXd solve_positive_definite(const MatrixXd& matrix, const Eigen::VectorXd& right) {
  return matrix.llt().solve(right);
}

MatrixXd inverse_positive_definite(const MatrixXd& matrix) {
  return matrix.llt().solve(MatrixXd::Identity(matrix.rows(), matrix.cols()));
}

SymmetricEigen<Eigen::Dynamic> symmetric_eigen(const MatrixXd& matrix) {
  const Eigen::SelfAdjointEigenSolver<MatrixXd> solver(matrix);
  return {solver.eigenvalues(), solver.eigenvectors()};
}

SymmetricEigen<Eigen::Dynamic> generalized_eigen(const MatrixXd& matrix, const MatrixXd& metric) {
  const Eigen::GeneralizedSelfAdjointEigenSolver<MatrixXd> solver(matrix, metric);
  return {solver.eigenvalues(), solver.eigenvectors()};
}

SingularValues thin_svd(const MatrixXd& matrix) { return svd(matrix, Eigen::ComputeThinU | Eigen::ComputeThinV); }
SingularValues full_svd(const MatrixXd& matrix) { return svd(matrix, Eigen::ComputeFullU | Eigen::ComputeFullV); }

Eigen::VectorXd least_squares(const MatrixXd& matrix, const Eigen::Vector3d& right) {
  return Eigen::JacobiSVD<MatrixXd>(matrix, Eigen::ComputeThinU | Eigen::ComputeThinV).solve(right);
}

}  // namespace fringeslam
