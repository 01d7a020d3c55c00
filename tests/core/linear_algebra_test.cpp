// SPDX-License-Identifier: Apache-2.0
#include "core/types/linear_algebra.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "tests/support/matchers.h"

namespace fringeslam {
namespace {

using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;
using support::MatrixNear;

constexpr double kClose = 1e-13;

const Matrix3d kFirst = rotation_exp({0.3, -0.2, 0.9}), kSecond = rotation_exp({-1.1, 0.4, 0.2});

// The matrix of second differences: its inverse, solutions and eigenvalues have closed forms.
MatrixXd second_differences(int size) {
  MatrixXd matrix = 2 * MatrixXd::Identity(size, size);
  for (int i = 0; i + 1 < size; ++i) matrix(i, i + 1) = matrix(i + 1, i) = -1;
  return matrix;
}

MatrixXd inverse_of_second_differences(int size) {
  return MatrixXd::NullaryExpr(size, size, [&](Eigen::Index i, Eigen::Index j) {
    return static_cast<double>((std::min(i, j) + 1) * (size - std::max(i, j))) / (size + 1);
  });
}

// The solution of second_differences(size) x = (1, ..., 1).
VectorXd parabola(int size) {
  return VectorXd::NullaryExpr(size, [&](Eigen::Index i) { return 0.5 * static_cast<double>((i + 1) * (size - i)); });
}

template <int Size>
void expect_waves(const SymmetricEigen<Size>& eigen, int size) {
  ASSERT_EQ(eigen.values.size(), size);
  ASSERT_EQ(eigen.vectors.cols(), size);
  for (int k = 0; k < size; ++k) {
    const double step = std::numbers::pi * (k + 1) / (size + 1);
    EXPECT_NEAR(eigen.values[k], 2 - 2 * std::cos(step), kClose);
    VectorXd wave = VectorXd::NullaryExpr(size, [&](Eigen::Index i) {
      return std::sqrt(2.0 / (size + 1)) * std::sin(step * static_cast<double>(i + 1));
    });
    if (wave.dot(eigen.vectors.col(k)) < 0) wave = -wave;
    EXPECT_THAT(eigen.vectors.col(k), MatrixNear(wave, kClose));
  }
}

// A regular matrix with det = 1 and an inverse that is not symmetric.
Matrix6d unit_lower() {
  Matrix6d matrix = Matrix6d::Identity();
  for (int i = 0; i < 6; ++i) {
    for (int j = 0; j < i; ++j) matrix(i, j) = 0.5 * (i - j);
  }
  return matrix;
}

TEST(LinearAlgebra, InvertsAMatrixOfSixRows) {
  EXPECT_THAT(inverse(Matrix6d(second_differences(6))), MatrixNear(inverse_of_second_differences(6), kClose));
  EXPECT_THAT(inverse(unit_lower()) * unit_lower(), MatrixNear(Matrix6d::Identity(), kClose));
}

TEST(LinearAlgebra, SolvesSymmetricSystemsOfAllSizes) {
  EXPECT_THAT(solve_symmetric(Matrix3d(second_differences(3)), Vector3d::Ones()), MatrixNear(parabola(3), kClose));
  EXPECT_THAT(solve_symmetric(Matrix5d(second_differences(5)), Vector5d::Ones()), MatrixNear(parabola(5), kClose));
  EXPECT_THAT(solve_symmetric(Matrix6d(second_differences(6)), Vector6d::Ones()), MatrixNear(parabola(6), kClose));
  EXPECT_THAT(solve_positive_definite(second_differences(3), Vector3d::Ones()), MatrixNear(parabola(3), kClose));
}

TEST(LinearAlgebra, RefusesMatricesBelowTheConditionNumber) {
  // The norm of the matrix is 4 and that of its inverse 6.
  const Matrix6d matrix = second_differences(6);
  const auto solution = solve_well_conditioned(matrix, Vector6d::Ones(), 1.0 / 25);
  ASSERT_TRUE(solution);
  EXPECT_THAT(*solution, MatrixNear(parabola(6), kClose));
  const auto inverted = inverse_if_well_conditioned(matrix, 1.0 / 25);
  ASSERT_TRUE(inverted);
  EXPECT_THAT(*inverted, MatrixNear(inverse_of_second_differences(6), kClose));
  EXPECT_FALSE(solve_well_conditioned(matrix, Vector6d::Ones(), 1.0 / 23));
  EXPECT_FALSE(inverse_if_well_conditioned(matrix, 1.0 / 23));
  const Matrix6d singular = Vector6d::Ones() * Vector6d::Ones().transpose();
  EXPECT_FALSE(solve_well_conditioned(singular, Vector6d::Ones(), 1e-12));
  EXPECT_FALSE(inverse_if_well_conditioned(singular, 1e-12));
}

TEST(LinearAlgebra, RecognisesPositiveDefiniteMatrices) {
  EXPECT_TRUE(is_positive_definite(Matrix3d(kFirst * Vector3d(1e-9, 1, 2).asDiagonal() * kFirst.transpose())));
  EXPECT_FALSE(is_positive_definite(Matrix3d(kFirst * Vector3d(-1e-9, 1, 2).asDiagonal() * kFirst.transpose())));
  EXPECT_FALSE(is_positive_definite(Matrix3d(Matrix3d::Zero())));
}

TEST(LinearAlgebra, WhitensACovariance) {
  Matrix3d lower;
  lower << 2, 0, 0, 1, 3, 0, -1, 2, 4;
  EXPECT_THAT(whitening(lower * lower.transpose()) * lower, MatrixNear(Matrix3d::Identity(), kClose));
}

TEST(LinearAlgebra, RootOfACovarianceThatMayBeSingular) {
  const Matrix6d root = covariance_root(second_differences(6));
  EXPECT_THAT(root * root.transpose(), MatrixNear(second_differences(6), kClose));
  const Matrix6d rank_two = unit_lower().leftCols<2>() * unit_lower().leftCols<2>().transpose();
  const Matrix6d thin = covariance_root(rank_two);
  EXPECT_THAT(thin * thin.transpose(), MatrixNear(rank_two, kClose));
  const Vector6d variances{{1, 4, -1e-3, 0, 9, 16}};
  const Matrix6d clipped = covariance_root(Matrix6d(variances.asDiagonal()));
  EXPECT_THAT(clipped * clipped.transpose(), MatrixNear(Matrix6d(variances.cwiseMax(0).asDiagonal()), kClose));
}

TEST(LinearAlgebra, EigenvectorsOfSymmetricMatricesOfAllSizes) {
  expect_waves(symmetric_eigen(Matrix3d(second_differences(3))), 3);
  expect_waves(symmetric_eigen(Matrix6d(second_differences(6))), 6);
  expect_waves(symmetric_eigen(second_differences(12)), 12);
}

TEST(LinearAlgebra, EigenvectorsRelativeToAMetric) {
  const Vector3d values(-1, 0.5, 4);
  Matrix3d basis;
  basis << 2, 0, 0, 1, 3, 0, -1, 2, 4;
  const auto eigen = generalized_eigen(basis * values.asDiagonal() * basis.transpose(), basis * basis.transpose());
  EXPECT_THAT(eigen.values, MatrixNear(values, kClose));
  // basis^T V has orthonormal columns that are the axes, up to their signs.
  EXPECT_THAT((basis.transpose() * eigen.vectors).cwiseAbs(), MatrixNear(Matrix3d::Identity(), kClose));
}

TEST(LinearAlgebra, CommonBasisOfTwoMatrices) {
  const Vector6d values{{-2, -1, 0, 0.5, 1, 3}}, vector{{1, -2, 3, -4, 5, -6}};
  const Matrix6d lower = unit_lower(), first = lower * lower.transpose(),
                 second = lower * values.asDiagonal() * lower.transpose();
  const auto common = common_basis(first, second, vector);
  ASSERT_TRUE(common);
  EXPECT_THAT(common->values, MatrixNear(values, 1e-11));
  EXPECT_THAT(common->basis * common->basis.transpose(), MatrixNear(first, 1e-11));
  EXPECT_THAT(common->basis * common->values.asDiagonal() * common->basis.transpose(), MatrixNear(second, 1e-11));
  EXPECT_THAT(common->basis * common->coordinates, MatrixNear(vector, 1e-11));
  EXPECT_FALSE(common_basis(second, first, vector));
}

TEST(LinearAlgebra, SingularValuesOfMatricesOfAnyShape) {
  // 3 x 5 with singular values 3, 2 and 0.
  MatrixXd wide = MatrixXd::Zero(3, 5);
  wide.topLeftCorner<3, 3>() = Vector3d(3, 2, 0).asDiagonal();
  wide = kFirst * wide;
  wide.leftCols<3>() *= kSecond;
  for (const MatrixXd& matrix : {wide, MatrixXd(wide.transpose())}) {
    const Eigen::Index rows = matrix.rows(), cols = matrix.cols();
    const SingularValues thin = thin_svd(matrix), full = full_svd(matrix);
    ASSERT_EQ(thin.u.rows(), rows);
    ASSERT_EQ(thin.u.cols(), 3);
    ASSERT_EQ(thin.v.rows(), cols);
    ASSERT_EQ(thin.v.cols(), 3);
    ASSERT_EQ(full.u.cols(), rows);
    ASSERT_EQ(full.v.cols(), cols);
    EXPECT_THAT(thin.values, MatrixNear(Vector3d(3, 2, 0), kClose));
    EXPECT_THAT(full.values, MatrixNear(Vector3d(3, 2, 0), kClose));
    EXPECT_THAT(thin.u * thin.values.asDiagonal() * thin.v.transpose(), MatrixNear(matrix, kClose));
    EXPECT_THAT(full.u.leftCols(3) * full.values.asDiagonal() * full.v.leftCols(3).transpose(),
                MatrixNear(matrix, kClose));
    EXPECT_THAT(full.u.transpose() * full.u, MatrixNear(MatrixXd::Identity(rows, rows), kClose));
    EXPECT_THAT(full.v.transpose() * full.v, MatrixNear(MatrixXd::Identity(cols, cols), kClose));
  }
  EXPECT_THAT(singular_values(kFirst * Vector3d(1, -3, 2).asDiagonal() * kSecond),
              MatrixNear(Vector3d(3, 2, 1), kClose));
}

TEST(LinearAlgebra, LeastSquaresReturnsTheShortestSolution) {
  const Vector3d right(1, 2, 4);
  MatrixXd line(3, 2);  // a + b x at x = -1, 0, 1
  line << 1, -1, 1, 0, 1, 1;
  EXPECT_THAT(least_squares(line, right), MatrixNear(Eigen::Vector2d(7.0 / 3, 1.5), kClose));
  MatrixXd twice(3, 6);
  twice << Matrix3d::Identity(), Matrix3d::Identity();
  VectorXd halves(6);
  halves << right / 2, right / 2;
  EXPECT_THAT(least_squares(twice, right), MatrixNear(halves, kClose));
}

TEST(LinearAlgebra, NearestRotationIsThePolarFactor) {
  const Matrix3d stretch = kSecond * Vector3d(3, 2, 0.1).asDiagonal() * kSecond.transpose();
  EXPECT_THAT(nearest_orthogonal(kFirst * stretch), MatrixNear(kFirst, kClose));
  EXPECT_THAT(nearest_rotation(kFirst * stretch), MatrixNear(kFirst, kClose));
}

TEST(LinearAlgebra, NearestRotationFlipsTheSmallestSingularValue) {
  const Matrix3d mirrored = kFirst * Vector3d(3, 2, -1).asDiagonal();
  EXPECT_THAT(nearest_orthogonal(mirrored), MatrixNear(kFirst * Vector3d(1, 1, -1).asDiagonal(), kClose));
  EXPECT_THAT(nearest_rotation(mirrored), MatrixNear(kFirst, kClose));
}

}  // namespace
}  // namespace fringeslam
