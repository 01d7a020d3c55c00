// SPDX-License-Identifier: Apache-2.0
#include "core/types/linear_algebra.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <Eigen/SVD>

namespace fringeslam {

namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

template <class Matrix>
SymmetricEigen<Matrix::RowsAtCompileTime> eigen_of(const Matrix& matrix) {
  const Eigen::SelfAdjointEigenSolver<Matrix> solver(matrix);
  return {solver.eigenvalues(), solver.eigenvectors()};
}

Eigen::JacobiSVD<Matrix3d> svd(const Matrix3d& matrix) {
  return Eigen::JacobiSVD<Matrix3d>(matrix, Eigen::ComputeFullU | Eigen::ComputeFullV);
}

bool well_conditioned(const Eigen::LDLT<Matrix6d>& factor, double least_rcond) {
  // Eigen's solution leaves out zero pivots, and with them its condition number.
  return factor.info() == Eigen::Success && (factor.vectorD().array() != 0).all() && factor.rcond() > least_rcond;
}

}  // namespace

Matrix6d inverse(const Matrix6d& matrix) { return matrix.inverse(); }

Vector3d solve_symmetric(const Matrix3d& matrix, const Vector3d& right) { return matrix.ldlt().solve(right); }
Vector5d solve_symmetric(const Matrix5d& matrix, const Vector5d& right) { return matrix.ldlt().solve(right); }
Vector6d solve_symmetric(const Matrix6d& matrix, const Vector6d& right) { return matrix.ldlt().solve(right); }

std::optional<Vector6d> solve_well_conditioned(const Matrix6d& matrix, const Vector6d& right, double least_rcond) {
  const Eigen::LDLT<Matrix6d> factor(matrix);
  if (!well_conditioned(factor, least_rcond)) return std::nullopt;
  return factor.solve(right);
}

std::optional<Matrix6d> inverse_if_well_conditioned(const Matrix6d& matrix, double least_rcond) {
  const Eigen::LDLT<Matrix6d> factor(matrix);
  if (!well_conditioned(factor, least_rcond)) return std::nullopt;
  return factor.solve(Matrix6d::Identity());
}

Vector3d solve_positive_definite(const Matrix3d& matrix, const Vector3d& right) { return matrix.llt().solve(right); }

double log_normal(const Eigen::VectorXd& x, const Eigen::MatrixXd& covariance) {
  const Eigen::LLT<Eigen::MatrixXd> root(covariance);
  const Eigen::VectorXd diagonal = root.matrixLLT().diagonal();
  return -0.5 * x.dot(root.solve(x)) - diagonal.array().log().sum();
}

bool is_positive_definite(const Matrix3d& matrix) { return matrix.llt().info() == Eigen::Success; }
bool is_positive_definite(const Matrix6d& matrix) { return matrix.llt().info() == Eigen::Success; }

Matrix3d whitening(const Matrix3d& covariance) {
  const Matrix3d lower = covariance.llt().matrixL();
  return lower.triangularView<Eigen::Lower>().solve(Matrix3d::Identity());
}

Matrix6d covariance_root(const Matrix6d& covariance) {
  const Eigen::LDLT<Matrix6d> factors(covariance);
  const Vector6d spread = factors.vectorD().cwiseMax(0).cwiseSqrt();
  const Matrix6d lower = factors.matrixL();
  return factors.transpositionsP().transpose() * Matrix6d(lower * spread.asDiagonal());
}

SymmetricEigen<3> symmetric_eigen(const Matrix3d& matrix) { return eigen_of(matrix); }
SymmetricEigen<6> symmetric_eigen(const Matrix6d& matrix) { return eigen_of(matrix); }

std::optional<CommonBasis> common_basis(const Matrix6d& first, const Matrix6d& second, const Vector6d& vector) {
  const Eigen::LLT<Matrix6d> factor(first);
  if (factor.info() != Eigen::Success) return std::nullopt;
  const Matrix6d half = factor.matrixL().solve(second);
  const Eigen::SelfAdjointEigenSolver<Matrix6d> solver(factor.matrixL().solve(half.transpose()));
  return CommonBasis{factor.matrixL() * solver.eigenvectors(), solver.eigenvalues(),
                     solver.eigenvectors().transpose() * factor.matrixL().solve(vector)};
}

Vector3d singular_values(const Matrix3d& matrix) { return svd(matrix).singularValues(); }

Matrix3d nearest_orthogonal(const Matrix3d& matrix) {
  const auto parts = svd(matrix);
  return parts.matrixU() * parts.matrixV().transpose();
}

Matrix3d nearest_rotation(const Matrix3d& matrix) {
  const auto parts = svd(matrix);
  // If the nearest orthogonal matrix is a reflection, the direction of the smallest singular value is flipped.
  const double handedness = (parts.matrixU() * parts.matrixV().transpose()).determinant();
  const Vector3d signs(1, 1, handedness < 0 ? -1 : 1);
  return parts.matrixU() * signs.asDiagonal() * parts.matrixV().transpose();
}

}  // namespace fringeslam
