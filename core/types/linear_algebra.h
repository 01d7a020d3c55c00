// SPDX-License-Identifier: Apache-2.0
// Decompositions of dense matrices. Eigen's decompositions are large templates; these functions compile each of them
// once for all callers.
#pragma once

#include <Eigen/Core>
#include <optional>

#include "core/types/pose.h"

namespace fringeslam {

using Vector5d = Eigen::Matrix<double, 5, 1>;
using Matrix5d = Eigen::Matrix<double, 5, 5>;

// Returns the inverse of a regular matrix, by LU decomposition with partial pivoting.
Matrix6d inverse(const Matrix6d& matrix);

// Returns x with `matrix` x = `right` for a symmetric matrix that is positive or negative semidefinite, by LDL^T
// decomposition with pivoting.
Eigen::Vector3d solve_symmetric(const Eigen::Matrix3d& matrix, const Eigen::Vector3d& right);
Vector5d solve_symmetric(const Matrix5d& matrix, const Vector5d& right);
Vector6d solve_symmetric(const Matrix6d& matrix, const Vector6d& right);

// The same, and the inverse; nullopt unless the matrix's reciprocal condition number exceeds `least_rcond`.
std::optional<Vector6d> solve_well_conditioned(const Matrix6d& matrix, const Vector6d& right, double least_rcond);
std::optional<Matrix6d> inverse_if_well_conditioned(const Matrix6d& matrix, double least_rcond);

// Returns x with `matrix` x = `right` for a symmetric positive definite matrix, by Cholesky decomposition.
Eigen::Vector3d solve_positive_definite(const Eigen::Matrix3d& matrix, const Eigen::Vector3d& right);

Eigen::VectorXd solve_positive_definite(const Eigen::MatrixXd& matrix, const Eigen::VectorXd& right);

// Returns the inverse of a symmetric positive definite matrix.
Eigen::MatrixXd inverse_positive_definite(const Eigen::MatrixXd& matrix);

// Returns the logarithm of the normal distribution's density at `x`, up to a constant that depends on the dimension only;
// `covariance` is positive definite.
double log_normal(const Eigen::VectorXd& x, const Eigen::MatrixXd& covariance);

// True if the symmetric matrix has a Cholesky decomposition.
bool is_positive_definite(const Eigen::Matrix3d& matrix);
bool is_positive_definite(const Matrix6d& matrix);

// Returns the lower triangular W with W^T W = covariance^-1.
Eigen::Matrix3d whitening(const Eigen::Matrix3d& covariance);

// Returns R with R R^T = `covariance`, which may be singular; negative variances count as zero.
Matrix6d covariance_root(const Matrix6d& covariance);

// Eigenvalues of a symmetric matrix in ascending order, and its orthonormal eigenvectors as columns.
template <int Size>
struct SymmetricEigen {
  Eigen::Matrix<double, Size, 1> values;
  Eigen::Matrix<double, Size, Size> vectors;
};

SymmetricEigen<3> symmetric_eigen(const Eigen::Matrix3d& matrix);
SymmetricEigen<6> symmetric_eigen(const Matrix6d& matrix);
SymmetricEigen<Eigen::Dynamic> symmetric_eigen(const Eigen::MatrixXd& matrix);

// Returns the solutions of matrix v = value metric v in ascending order of the values; `metric` is positive definite,
// and V^T metric V = I.
SymmetricEigen<Eigen::Dynamic> generalized_eigen(const Eigen::MatrixXd& matrix, const Eigen::MatrixXd& metric);

// A basis B in which two symmetric matrices are diagonal, first = B B^T and second = B diag(values) B^T, and a vector's
// coordinates in it: B^-1 vector.
struct CommonBasis {
  Matrix6d basis;
  Vector6d values, coordinates;
};

// Returns nullopt unless `first` is positive definite.
std::optional<CommonBasis> common_basis(const Matrix6d& first, const Matrix6d& second, const Vector6d& vector);

// matrix = u diag(values) v^T with descending singular values.
struct SingularValues {
  Eigen::MatrixXd u, v;
  Eigen::VectorXd values;
};

SingularValues thin_svd(const Eigen::MatrixXd& matrix);
SingularValues full_svd(const Eigen::MatrixXd& matrix);  // u and v square

// Returns the shortest x that minimises |matrix x - right|; `matrix` has three rows.
Eigen::VectorXd least_squares(const Eigen::MatrixXd& matrix, const Eigen::Vector3d& right);

// Returns the singular values in descending order.
Eigen::Vector3d singular_values(const Eigen::Matrix3d& matrix);

// Returns the orthogonal matrix nearest to `matrix` in the Frobenius norm, and the nearest one that is a rotation.
Eigen::Matrix3d nearest_orthogonal(const Eigen::Matrix3d& matrix);
Eigen::Matrix3d nearest_rotation(const Eigen::Matrix3d& matrix);

}  // namespace fringeslam
