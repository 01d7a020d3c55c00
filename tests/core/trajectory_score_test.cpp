// SPDX-License-Identifier: Apache-2.0
// Trajectory scores against closed forms of evo's definitions, and trajectory files of other systems.
#include "core/score/trajectory_score.h"

#include <gmock/gmock.h>

#include <Eigen/Geometry>
#include <cmath>
#include <numbers>

#include "core/score/trajectory_file.h"
#include "tests/support/matchers.h"
#include "tests/support/random.h"
#include "tests/support/temp_folder.h"

namespace fringeslam {
namespace {

using support::error_of;
using support::MatrixNear;
using support::PoseNear;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Pair;

constexpr double kClose = 1e-12;

struct Expected {
  double rmse, mean, median, std, min, max, sse;
};

void expect_statistics(const ErrorStatistics& s, const Expected& e) {
  EXPECT_NEAR(s.rmse, e.rmse, kClose);
  EXPECT_NEAR(s.mean, e.mean, kClose);
  EXPECT_NEAR(s.median, e.median, kClose);
  EXPECT_NEAR(s.std, e.std, kClose);
  EXPECT_NEAR(s.min, e.min, kClose);
  EXPECT_NEAR(s.max, e.max, kClose);
  EXPECT_NEAR(s.sse, e.sse, kClose);
}

void expect_all(const ErrorStatistics& s, double error, int count) {
  expect_statistics(s, {error, error, error, 0, error, error, count * error * error});
}

TrajectoryOptions aligned(Alignment how, PoseRelation relation = PoseRelation::translation) {
  TrajectoryOptions options;
  options.align = how;
  options.relation = relation;
  return options;
}

Trajectory at(const std::vector<Eigen::Vector3d>& positions) {
  Trajectory trajectory;
  for (const Eigen::Vector3d& p : positions)
    trajectory.push_back({0.5 * static_cast<double>(trajectory.size()), {Eigen::Matrix3d::Identity(), p}});
  return trajectory;
}

// The corners of a square centred on the origin, side 2 m.
const std::vector<Eigen::Vector3d> kSquare = {{1, 1, 0}, {-1, 1, 0}, {-1, -1, 0}, {1, -1, 0}};

Trajectory transformed(const Similarity& by, Trajectory trajectory) {
  for (TimedPose& pose : trajectory) pose.world_from_robot = by * pose.world_from_robot;
  return trajectory;
}

// A non-planar path with rotations about all axes.
Trajectory winding(int poses) {
  Trajectory trajectory;
  for (int i = 0; i < poses; ++i) {
    const double s = 0.3 * i;
    trajectory.push_back(
        {0.1 * i, {rotation_exp({0.1 * s, std::sin(s), 0.2 * s}), {std::cos(s), std::sin(s), 0.2 * s}}});
  }
  return trajectory;
}

TEST(Statistics, OfFourNumbersByHand) {
  // Sum 12, squares 9 + 16 + 1 + 16 = 42; median between 3 and 4; variance 42/4 - 9 = 1.5.
  expect_statistics(statistics_of({3, 4, 1, 4}), {std::sqrt(10.5), 3, 3.5, std::sqrt(1.5), 1, 4, 42});
  EXPECT_TRUE(std::isnan(statistics_of({}).rmse));
}

TEST(TrajectoryAlignment, AConstantOffsetIsTheErrorUntilItIsAligned) {
  const Eigen::Vector3d offset(0.03, -0.04, 0.12);  // 0.13 m long
  const Trajectory truth = winding(7), estimate = transformed({1, {Eigen::Matrix3d::Identity(), offset}}, truth);
  expect_all(score_trajectory(estimate, truth, aligned(Alignment::none)).ape, 0.13, 7);
  for (const Alignment how : {Alignment::origin, Alignment::se3, Alignment::sim3}) {
    const TrajectoryScore score = score_trajectory(estimate, truth, aligned(how));
    expect_all(score.ape, 0, 7);
    EXPECT_THAT(score.truth_from_estimate.pose, PoseNear(Pose{Eigen::Matrix3d::Identity(), -offset}, 1e-12, 1e-12));
  }
  const TrajectoryScore score = score_trajectory(estimate, truth, aligned(Alignment::none));
  EXPECT_EQ(score.steps, 6);
  expect_all(score.rpe_translation_m, 0, 6);
}

// A trajectory rotated by theta about the point c: the position error of a pose at distance r from the axis is the
// chord 2 r sin(theta / 2), its rotation error is theta. ||R - I||_F of a rotation by theta is 2 sqrt(2) sin(theta /
// 2), so the full error is 2 sin(theta / 2) sqrt(2 + r^2).
TEST(TrajectoryAlignment, ARotationAboutAPoint) {
  const double theta = 0.3, chord = 2 * std::sin(theta / 2);
  const Eigen::Vector3d c(1, 1, 5);
  const Eigen::Matrix3d turn = rotation_exp({0, 0, theta});
  const Trajectory truth = at(kSquare);  // 0, 2, sqrt(8) and 2 m from the axis through c
  const Trajectory estimate = transformed({1, {turn, c - turn * c}}, truth);
  const double far = std::sqrt(8.0), mean = (4 + far) / 4, rms = std::sqrt((4 + 8 + 4) / 4.0);
  expect_statistics(score_trajectory(estimate, truth, aligned(Alignment::none)).ape,
                    {chord * rms, chord * mean, chord * 2, chord * std::sqrt(rms * rms - mean * mean), 0, chord * far,
                     chord * chord * 16});
  expect_all(score_trajectory(estimate, truth, aligned(Alignment::none, PoseRelation::rotation_deg)).ape,
             theta * 180 / std::numbers::pi, 4);
  const ErrorStatistics full = score_trajectory(estimate, truth, aligned(Alignment::none, PoseRelation::full)).ape;
  EXPECT_NEAR(full.sse, chord * chord * (2 * 4 + 16), kClose);
  EXPECT_NEAR(full.min, chord * std::sqrt(2.0), kClose);
  EXPECT_NEAR(full.max, chord * std::sqrt(10.0), kClose);
  for (const PoseRelation relation : choice_values<PoseRelation>())
    EXPECT_NEAR(score_trajectory(estimate, truth, aligned(Alignment::se3, relation)).ape.max, 0, 1e-7)
        << to_string(relation);
}

// The estimate is 1.25 times too large. Alignment without scale leaves 0.25 sqrt(2) at each corner; with scale, a
// factor 0.8 is exact. A step of 2 m is 0.5 m too long, and exact after scaling.
TEST(TrajectoryAlignment, APureScale) {
  const Trajectory truth = at(kSquare), estimate = transformed({1.25, {}}, truth);
  expect_all(score_trajectory(estimate, truth, aligned(Alignment::se3)).ape, 0.25 * std::sqrt(2.0), 4);
  expect_all(score_trajectory(estimate, truth, aligned(Alignment::se3)).rpe_translation_m, 0.5, 3);
  const TrajectoryScore scaled = score_trajectory(estimate, truth, aligned(Alignment::sim3));
  EXPECT_NEAR(scaled.truth_from_estimate.scale, 0.8, kClose);
  expect_all(scaled.ape, 0, 4);
  expect_all(scaled.rpe_translation_m, 0, 3);
  EXPECT_NEAR(scaled.rpe_translation_rmse_m, 0.5, kClose);  // option-independent scores are not scaled
  EXPECT_NEAR(scaled.ate_umeyama_rmse_m, 0.25 * std::sqrt(2.0), kClose);
}

// Corners alternately raised and lowered by h. By symmetry neither rotation nor translation reduces the error, so
// without scale it is h at each corner. The scale s = sum t.f / sum f.f = 8 / (8 + 4 h^2) leaves sqrt(2 (1 - s)^2 + s^2
// h^2).
TEST(TrajectoryAlignment, OfASaddleOntoASquare) {
  const double h = 0.2, s = 8 / (8 + 4 * h * h);
  std::vector<Eigen::Vector3d> saddle = kSquare;
  for (size_t i = 0; i < 4; ++i) saddle[i].z() = i % 2 == 0 ? h : -h;
  expect_all(score_trajectory(at(saddle), at(kSquare), aligned(Alignment::se3)).ape, h, 4);
  const TrajectoryScore scaled = score_trajectory(at(saddle), at(kSquare), aligned(Alignment::sim3));
  EXPECT_NEAR(scaled.truth_from_estimate.scale, s, kClose);
  expect_all(scaled.ape, std::sqrt(2 * (1 - s) * (1 - s) + s * s * h * h), 4);
}

TEST(TrajectoryAlignment, FindsAnySimilarity) {
  support::Random random(3);
  const Trajectory truth = winding(40);
  for (int i = 0; i < 20; ++i) {
    const Similarity by{random.uniform(0.1, 10),
                        {rotation_exp(random.uniform(0, 3) * random.direction()), 10 * random.normals<3>()}};
    const TrajectoryScore score =
        score_trajectory(transformed(by, truth), truth, aligned(Alignment::sim3, PoseRelation::full));
    EXPECT_NEAR(score.truth_from_estimate.scale, 1 / by.scale, 1e-12 / by.scale);
    EXPECT_NEAR(score.ape.max, 0, 1e-11);
  }
}

// A mirrored square equals a rotated one; a mirrored solid cannot be aligned by a rotation.
TEST(TrajectoryAlignment, IsNeverAMirror) {
  const std::vector<Eigen::Vector3d> solid = {{0, 0, 0}, {1, 0, 0}, {0, 2, 0}, {0, 0, 3}};
  std::vector<Eigen::Vector3d> mirrored = solid;
  for (Eigen::Vector3d& p : mirrored) p.x() = -p.x();
  const Similarity found = align_similarity(solid, mirrored, true);
  const Eigen::Matrix3d& r = found.pose.rotation;
  EXPECT_NEAR(r.col(0).cross(r.col(1)).dot(r.col(2)), 1, 1e-12);
  EXPECT_GT(score_trajectory(at(mirrored), at(solid), aligned(Alignment::sim3)).ape.rmse, 0.1);
}

// Errors 0, d, 2d … of n = 6 poses: mean (n-1)/2, sum of squares (n-1) n (2n-1) / 6 = 55, variance (n^2-1)/12.
TEST(RelativeErrors, OfADriftGrowWithDelta) {
  const double d = 0.01;
  Trajectory truth, estimate;
  for (int i = 0; i < 6; ++i) {
    const Eigen::Matrix3d turn = rotation_exp({0, 0, 0.4 * i});  // of both trajectories; errors are in the robot frame
    truth.push_back({1.0 * i, {turn, {0.5 * i, 0, 0}}});
    estimate.push_back({1.0 * i, {turn, {0.5 * i, 0, d * i}}});
  }
  expect_statistics(score_trajectory(estimate, truth).ape,
                    {d * std::sqrt(55.0 / 6), 2.5 * d, 2.5 * d, d * std::sqrt(35.0 / 12), 0, 5 * d, 55 * d * d});
  for (const auto& [delta, all_pairs, steps] :
       {std::tuple(1, false, 5), std::tuple(2, false, 2), std::tuple(2, true, 4), std::tuple(5, false, 1),
        std::tuple(4, false, 1)}) {
    TrajectoryOptions options;
    options.delta = delta;
    options.all_pairs = all_pairs;
    const TrajectoryScore score = score_trajectory(estimate, truth, options);
    EXPECT_EQ(score.steps, steps);
    expect_all(score.rpe_translation_m, delta * d, steps);
    expect_all(score.rpe_rotation_deg, 0, steps);
    EXPECT_NEAR(score.rpe_translation_rmse_m, d, kClose);  // always of consecutive poses
  }
}

TEST(TrajectoryOptions, InvalidValuesAreRefused) {
  const Trajectory line = at({{0, 0, 0}, {1, 0, 0}, {2, 0, 0}}), still = at({{1, 2, 3}, {1, 2, 3}, {1, 2, 3}});
  const auto refusal = [&](const Trajectory& estimate, const Trajectory& truth, TrajectoryOptions options) {
    return error_of([&] { score_trajectory(estimate, truth, options); });
  };
  EXPECT_THAT(refusal(line, line, aligned(Alignment::se3, PoseRelation::rotation_deg)),
              HasSubstr("collinear positions"));
  EXPECT_THAT(refusal(line, line, aligned(Alignment::sim3, PoseRelation::full)), HasSubstr("collinear positions"));
  EXPECT_THAT(refusal(still, line, aligned(Alignment::sim3)), HasSubstr("does not determine a scale"));
  EXPECT_THAT(refusal(line, still, aligned(Alignment::sim3)), HasSubstr("does not determine a scale"));
  TrajectoryOptions options;
  options.delta = 3;
  EXPECT_THAT(refusal(line, line, options), HasSubstr("no two of 3 associated poses are 3 frames apart"));
  options.delta = 0;
  EXPECT_THAT(refusal(line, line, options), HasSubstr("delta"));
  EXPECT_THAT(refusal(at({{0, 0, 0}}), line, {}), HasSubstr("only 1 poses"));
  // One pose is enough for alignment by the origin.
  EXPECT_EQ(align_trajectory(at({{0, 0, 0}}), at({{1, 2, 3}}), aligned(Alignment::origin)).pose.translation,
            Eigen::Vector3d(1, 2, 3));
}

// If the rotation is undetermined, the distances do not depend on it.
TEST(TrajectoryOptions, PositionsOnALineHaveATranslationError) {
  const Trajectory line = at({{0, 0, 0}, {1, 0, 0}, {2, 0, 0}}), still = at({{1, 2, 3}, {1, 2, 3}, {1, 2, 3}});
  expect_all(score_trajectory(line, line, aligned(Alignment::se3)).ape, 0, 3);
  expect_all(score_trajectory(line, line, aligned(Alignment::sim3)).ape, 0, 3);
  // All at the middle of the line: errors of 1, 0 and 1 m.
  EXPECT_NEAR(score_trajectory(still, line, aligned(Alignment::se3)).ape.sse, 2, kClose);
  // Two poses 1 m apart, estimated as 1.2 m apart.
  expect_all(score_trajectory(at({{0, 0, 0}, {0, 1.2, 0}}), at({{0, 0, 0}, {1, 0, 0}}), aligned(Alignment::se3)).ape,
             0.1, 2);
}

Trajectory times(const std::vector<double>& seconds) {
  Trajectory trajectory;
  for (const double s : seconds) trajectory.push_back({s, {}});
  return trajectory;
}

TEST(Association, AtTheEdgeOfTheGap) {
  // 0.25 is exact in binary.
  EXPECT_THAT(associate(times({10.25}), times({10, 20}), 0.25), ElementsAre(Pair(0, 0)));
  EXPECT_THAT(associate(times({10.25}), times({10, 20}), std::nextafter(0.25, 0)), IsEmpty());
  EXPECT_THAT(associate(times({1, 2}), times({1, 2}), 0), ElementsAre(Pair(0, 0), Pair(1, 1)));
}

TEST(Association, TheEarlierOfTwoEquallyNear) {
  EXPECT_THAT(associate(times({1.5}), times({1, 2}), 1), ElementsAre(Pair(0, 0)));
  EXPECT_THAT(associate(times({1, 2}), times({1.5}), 1), ElementsAre(Pair(0, 0)));
}

TEST(Association, TheShorterTrajectoryChooses) {
  // 1 is the nearest time to both 1.1 and 1.4; the shorter trajectory chooses, so 1 is paired with 1.1.
  EXPECT_THAT(associate(times({1.1, 1.4, 3}), times({1, 3}), 0.5), ElementsAre(Pair(0, 0), Pair(2, 1)));
  EXPECT_THAT(associate(times({1, 3}), times({1.1, 1.4, 3}), 0.5), ElementsAre(Pair(0, 0), Pair(1, 2)));
}

TEST(Association, EachPoseOnce) {
  EXPECT_THAT(associate(times({0, 0.008, 0.009}), times({0.0075, 5, 6, 7}), 0.01), ElementsAre(Pair(1, 0)));
  EXPECT_THAT(associate(times({0.0075, 5, 6, 7}), times({0, 0.008, 0.009}), 0.01), ElementsAre(Pair(0, 1)));
}

class TrajectoryFile : public testing::Test {
 protected:
  test::fs::path file(const std::string& name, const std::string& text) const {
    test::write_bytes(temp_ / name, text);
    return temp_ / name;
  }
  std::string error(const std::string& text) const {
    return error_of([&] { read_trajectory(file("t.txt", text)); });
  }

 private:
  test::TempFolder temp_;
};

constexpr const char* kEurocHeader = "#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],\n";

TEST_F(TrajectoryFile, EurocIsTumInOtherOrderAndUnits) {
  const Trajectory tum = read_trajectory(file("a.tum",
                                              "# t x y z qx qy qz qw\n\n1403636580.25 1 2 3 0.5 -0.5 0.5 0.5\n"
                                              "1403636580.75 4 -5 6 0 0 1 0\n"));
  const Trajectory euroc =
      read_trajectory(file("b.csv", std::string(kEurocHeader) + "1403636580250000000,1,2,3,0.5,0.5,-0.5,0.5,0.1,0.2\r\n"
                                                                "1403636580750000000, 4, -5, 6, 0, 0, 0, +1\r\n"));
  const Trajectory orb = read_trajectory(file("c.txt",
                                              "1403636580250000000.000000 1 2 3 0.5 -0.5 0.5 0.5\n"
                                              "1403636580750000000.000000 4 -5 6 0 0 1 0\n"));
  ASSERT_EQ(tum.size(), 2u);
  for (const Trajectory& other : {euroc, orb}) {
    ASSERT_EQ(other.size(), 2u);
    for (size_t i = 0; i < 2; ++i) {
      EXPECT_NEAR(other[i].timestamp_s, tum[i].timestamp_s, 1e-6);
      EXPECT_THAT(other[i].world_from_robot, PoseNear(tum[i].world_from_robot, 1e-15, 1e-15));
    }
  }
}

TEST_F(TrajectoryFile, ErrorsNameFileLineAndReason) {
  const std::string good = "1000000000,1,2,3,1,0,0,0\n", head = kEurocHeader;
  EXPECT_THAT(error(head + good + "2000000000,1,2,3,1,0,0\n"), HasSubstr("t.txt:3: needs eight finite numbers"));
  EXPECT_THAT(error(good + "2000000000,1,2,3,1,0,0,\n"), HasSubstr("t.txt:2: needs eight finite numbers"));
  EXPECT_THAT(error(good + "2000000000,1,x,3,1,0,0,0\n"), HasSubstr("t.txt:2: needs eight finite numbers"));
  EXPECT_THAT(error(good + "2000000000,1,inf,3,1,0,0,0\n"), HasSubstr("t.txt:2: needs eight finite numbers"));
  EXPECT_THAT(error(good + "2000000000,1,2,3,1,1,0,0\n"), HasSubstr("t.txt:2: the quaternion is not of unit length"));
  EXPECT_THAT(error(good + good), HasSubstr("t.txt:2: timestamps must increase"));
  EXPECT_THAT(error("1 1 2 3 0 0 0 1\n2 1 2 3 0 0 0\n"), HasSubstr("t.txt:2: needs eight finite numbers"));
  EXPECT_THAT(error(head), HasSubstr("t.txt: contains no pose"));
  EXPECT_THAT(error_of([] { read_trajectory("/nowhere.csv"); }), HasSubstr("/nowhere.csv: cannot be opened"));
}

}  // namespace
}  // namespace fringeslam
