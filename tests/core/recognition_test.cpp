// SPDX-License-Identifier: Apache-2.0
#include "core/landmarks/recognition.h"

#include <gmock/gmock.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <atomic>
#include <limits>

#include "core/base/parallel.h"
#include "core/landmarks/descriptor_tree.h"
#include "core/score/landmark_score.h"
#include "tests/support/random.h"

namespace fringeslam {
namespace {

using support::Random;

Pinhole camera() {
  Pinhole camera;
  camera.width = 532, camera.height = 500;
  camera.fx = camera.fy = 2000, camera.cx = 266, camera.cy = 250;
  return camera;
}

// Unit length and non-negative components, as for SIFT.
cv::Mat1f random_descriptors(Random& random, int count) {
  cv::Mat1f descriptors(count, kDescriptorSize);
  for (int i = 0; i < count; ++i) {
    cv::Mat1f row = descriptors.row(i);
    double sum = 0;
    for (float& value : row) {
      const double n = random.normal();
      value = static_cast<float>(n * n);
      sum += static_cast<double>(value) * value;
    }
    row /= std::sqrt(sum);
  }
  return descriptors;
}

cv::Mat1f with_noise(Random& random, const cv::Mat1f& descriptors, double sigma) {
  cv::Mat1f noisy = descriptors.clone();
  for (float& value : noisy) value = std::max(0.0f, value + static_cast<float>(sigma * random.normal()));
  return noisy;
}

std::pair<int, int> nearest_by_brute_force(const cv::Mat1b& descriptors, const uchar* query) {
  std::pair<int, int> best{std::numeric_limits<int>::max(), -1};
  for (int i = 0; i < descriptors.rows; ++i) best = std::min(best, {squared_distance(query, descriptors[i]), i});
  return best;
}

TEST(DescriptorTree, AllLeavesAreBruteForce) {
  Random random(1);
  const cv::Mat1b descriptors = quantised(random_descriptors(random, 700));
  const DescriptorTree tree(descriptors);
  for (int q = 0; q < 50; ++q) {
    const cv::Mat1b query = quantised(random_descriptors(random, 1));
    std::pair<int, int> best{std::numeric_limits<int>::max(), -1};
    std::vector<int> visited;
    tree.visit_nearest_leaves(query[0], 1 << 20, [&](int index, int d2) {
      best = std::min(best, {d2, index});
      visited.push_back(index);
    });
    EXPECT_EQ(best, nearest_by_brute_force(descriptors, query[0]));
    std::sort(visited.begin(), visited.end());
    ASSERT_EQ(visited.size(), 700u);
    for (int i = 0; i < 700; ++i) EXPECT_EQ(visited[static_cast<size_t>(i)], i);
  }
}

TEST(DescriptorTree, FewLeavesFindANearDescriptor) {
  Random random(2);
  const cv::Mat1f originals = random_descriptors(random, 4000);
  const DescriptorTree tree(quantised(originals));
  const cv::Mat1b queries = quantised(with_noise(random, originals, 0.02));
  int found = 0;
  for (int q = 0; q < queries.rows; ++q) {
    std::pair<int, int> best{std::numeric_limits<int>::max(), -1};
    int visited = 0;
    tree.visit_nearest_leaves(queries[q], 16, [&](int index, int d2) {
      best = std::min(best, {d2, index}), ++visited;
    });
    EXPECT_LE(visited, 16 * 8);
    found += best.second == q;
  }
  EXPECT_GE(found, 3400);
}

TEST(DescriptorTree, AlikeAndNone) {
  const cv::Mat1b alike(300, kDescriptorSize, uchar{7});
  const DescriptorTree tree(alike);
  int visited = 0;
  tree.visit_nearest_leaves(alike[0], 3, [&](int, int d2) {
    EXPECT_EQ(d2, 0);
    ++visited;
  });
  EXPECT_EQ(visited, 300);
  DescriptorTree(cv::Mat1b(0, kDescriptorSize)).visit_nearest_leaves(alike[0], 3, [](int, int) { FAIL(); });
  EXPECT_THROW(DescriptorTree(cv::Mat1b(3, 64, uchar{0})), Error);
}

WeightedPair pair_of(const Pose& earlier_from_current, const Eigen::Vector3d& current) {
  return {earlier_from_current * current, current, 1e-4};
}

TEST(RigidConsensus, WithstandsEightyPercentOfFalsePairs) {
  int found = 0;
  constexpr int kTrials = 50;
  for (uint64_t seed = 1; seed <= kTrials; ++seed) {
    Random random(seed);
    const Pose truth{rotation_exp(0.2 * random.direction()), 0.05 * random.direction()};
    std::vector<WeightedPair> pairs;
    for (int i = 0; i < 60; ++i) {
      const Eigen::Vector3d p(random.uniform(-0.1, 0.1), random.uniform(-0.1, 0.1), random.uniform(0.9, 1.1));
      pairs.push_back(pair_of(truth, p));
      pairs.back().earlier += 5e-5 * random.normals<3>();
      if (i >= 12)
        pairs.back().earlier = {random.uniform(-0.1, 0.1), random.uniform(-0.1, 0.1), random.uniform(0.9, 1.1)};
    }
    const RigidConsensus consensus = rigid_consensus(pairs, 4, 4000);
    const bool right = consensus.inliers.size() >= 11 &&
                       std::all_of(consensus.inliers.begin(), consensus.inliers.end(), [](int i) { return i < 12; });
    found += right && (consensus.earlier_from_current.translation - truth.translation).norm() < 2e-3;
  }
  EXPECT_GE(found, kTrials - 1);
}

TEST(RigidConsensus, NothingAgrees) {
  EXPECT_TRUE(rigid_consensus({}, 4).inliers.empty());
  Random random(4);
  std::vector<WeightedPair> pairs;
  for (int i = 0; i < 40; ++i) pairs.push_back({0.1 * random.normals<3>(), 0.1 * random.normals<3>(), 1e-4});
  EXPECT_LT(rigid_consensus(pairs, 4).inliers.size(), 4u);
  // A line leaves the rotation about it undetermined.
  for (size_t i = 0; i < pairs.size(); ++i)
    pairs[i].earlier = pairs[i].current = Eigen::Vector3d(0.01 * static_cast<double>(i), 0, 1);
  EXPECT_TRUE(rigid_consensus(pairs, 4).inliers.empty());
}

// A scene of objects with 30 keypoints each; views show a selection of them.
class World {
 public:
  explicit World(int things) : random_(11) {
    for (int t = 0; t < things; ++t) {
      descriptors_.push_back(random_descriptors(random_, 30));
      std::vector<Eigen::Vector3d> points;
      const Eigen::Vector3d centre(random_.uniform(-0.1, 0.1), random_.uniform(-0.1, 0.1), random_.uniform(0.95, 1.05));
      for (int i = 0; i < 30; ++i) points.push_back(centre + 0.015 * random_.normals<3>());
      points_.push_back(points);
    }
  }
  Landmarks seen(const std::vector<int>& things, const Pose& camera_from_world = {}, double noise = 0.01) {
    Landmarks view;
    view.keypoints.descriptors = cv::Mat1f(0, kDescriptorSize);
    for (const int t : things) {
      Landmark landmark;
      const cv::Mat1f noisy = with_noise(random_, descriptors_[static_cast<size_t>(t)], noise);
      for (int i = 0; i < 30; ++i) {
        Keypoint k;
        k.point_m =
            camera_from_world * points_[static_cast<size_t>(t)][static_cast<size_t>(i)] + 3e-5 * random_.normals<3>();
        k.pixel = camera().project(k.point_m);
        k.scale = 2;
        k.strength = 1.0 / (1 + i);
        k.covariance_m2 = 1e-9 * Eigen::Matrix3d::Identity();
        landmark.keypoints.push_back(static_cast<int>(view.keypoints.keypoints.size()));
        view.keypoints.keypoints.push_back(k);
        view.keypoints.descriptors.push_back(noisy.row(i));
      }
      landmark.outline = {{0, 0}, {1, 0}, {0, 1}};
      view.landmarks.push_back(landmark);
    }
    return view;
  }

 private:
  Random random_;
  std::vector<cv::Mat1f> descriptors_;
  std::vector<std::vector<Eigen::Vector3d>> points_;
};

class BothSearches : public testing::TestWithParam<DescriptorSearch> {
 protected:
  RecognitionOptions options() const {
    RecognitionOptions options;
    options.search = GetParam();
    return options;
  }
};

TEST_P(BothSearches, KnowsWhatItHasSeenWhereItSawIt) {
  World world(12);
  LandmarkDatabase database(camera(), options());
  database.add(100, world.seen({0, 1, 2, 3}));
  database.add(101, world.seen({4, 5, 6, 7}));
  const Pose moved{rotation_exp({0.02, -0.1, 0.05}), {0.02, 0.01, -0.03}};
  const auto found = database.reidentify(world.seen({6, 9, 1, 4}, moved));
  ASSERT_EQ(found.size(), 3u);
  const auto expect = [&](const Recognition& r, int landmark, int frame, int earlier) {
    EXPECT_EQ(r.landmark, landmark);
    EXPECT_EQ(r.earlier_frame, frame);
    EXPECT_EQ(r.earlier_landmark, earlier);
    EXPECT_GE(r.matches.size(), 20u);
    for (const KeypointMatch& m : r.matches) EXPECT_EQ(m.current - 30 * landmark, m.earlier - 30 * earlier);
    EXPECT_LT((r.earlier_from_current.translation - moved.inverse().translation).norm(), 5e-3);
  };
  expect(found[0], 0, 101, 2);
  expect(found[1], 2, 100, 1);
  expect(found[2], 3, 101, 0);
}

TEST_P(BothSearches, AThingSeenManyTimesIsRecognisedAllTheSame) {
  World world(6);
  LandmarkDatabase database(camera(), options());
  for (int frame = 0; frame < 30; ++frame) database.add(frame, world.seen({0, 1, 2}));
  EXPECT_EQ(database.landmarks(), 90);
  EXPECT_EQ(database.reidentify(world.seen({2, 4, 0})).size(), 2u);
}

TEST(LandmarkDatabase, SearchesLongerForAViewThatIsHardToFind) {
  // The first lookup among 12,000 descriptors finds 79 of 100 such noisy views.
  constexpr int kViews = 100, kPerView = 4;
  World world(kViews * kPerView);
  LandmarkDatabase database(camera(), {});
  std::vector<std::vector<int>> things(kViews);
  for (int frame = 0; frame < kViews; ++frame) {
    for (int i = 0; i < kPerView; ++i) things[static_cast<size_t>(frame)].push_back(kPerView * frame + i);
    database.add(frame, world.seen(things[static_cast<size_t>(frame)]));
  }
  const Pose moved{rotation_exp({0.02, -0.1, 0.05}), {0.02, 0.01, -0.03}};
  int found = 0;
  for (int frame = 0; frame < kViews; ++frame) {
    const auto recognized = database.reidentify(world.seen(things[static_cast<size_t>(frame)], moved, 0.09), true);
    for (const Recognition& r : recognized) EXPECT_EQ(r.earlier_frame, frame);
    found += !recognized.empty();
  }
  EXPECT_GE(found, 95);
}

TEST_P(BothSearches, NothingKnown) {
  World world(6);
  LandmarkDatabase database(camera(), options());
  EXPECT_TRUE(database.reidentify(world.seen({0, 1})).empty());
  database.add(0, Landmarks{});
  EXPECT_TRUE(database.reidentify(world.seen({0, 1})).empty());
  database.add(1, world.seen({2, 3}));
  EXPECT_TRUE(database.reidentify(world.seen({0, 1})).empty());
  EXPECT_TRUE(database.reidentify(Landmarks{}).empty());
}

TEST_P(BothSearches, MatchesThatDoNotAgreeAreNoRecognition) {
  World world(2);
  LandmarkDatabase database(camera(), options());
  database.add(0, world.seen({0}));
  Landmarks torn = world.seen({0});
  Random random(3);
  for (Keypoint& k : torn.keypoints.keypoints) k.point_m += 0.02 * random.normals<3>();
  EXPECT_TRUE(database.reidentify(torn).empty());
}

TEST_P(BothSearches, ThePartsOfALandmarkAreKnown) {
  World world(3);
  LandmarkDatabase database(camera(), options());
  Landmarks whole = world.seen({0, 1});
  whole.landmarks[0].keypoints.insert(whole.landmarks[0].keypoints.end(), whole.landmarks[1].keypoints.begin(),
                                      whole.landmarks[1].keypoints.end());
  whole.landmarks.pop_back();
  database.add(0, whole);
  const auto found = database.reidentify(world.seen({0, 1}));
  ASSERT_EQ(found.size(), 2u);
  std::set<int> earlier;
  for (const Recognition& r : found) {
    for (const KeypointMatch& m : r.matches) EXPECT_TRUE(earlier.insert(m.earlier).second) << "matched twice";
  }
}

// Subtrees are built in parallel.
TEST(DescriptorTree, IsTheSameForAnyNumberOfThreads) {
  constexpr int kCount = 40000;
  Random random(7);
  const cv::Mat1b descriptors = quantised(random_descriptors(random, kCount));
  const DescriptorTree parallel(descriptors);
  const auto serial = [&] {
    const SerialLoops loops;
    return DescriptorTree(descriptors);
  }();
  for (int q = 0; q < kCount; q += 997) {
    std::vector<std::pair<int, int>> a, b;
    parallel.visit_nearest_leaves(descriptors[q], 8, [&](int i, int d2) { a.emplace_back(i, d2); });
    serial.visit_nearest_leaves(descriptors[q], 8, [&](int i, int d2) { b.emplace_back(i, d2); });
    ASSERT_EQ(a, b);
    EXPECT_TRUE(std::any_of(a.begin(), a.end(), [&](const auto& found) { return found == std::pair(q, 0); }));
  }
}

// The digest of landmarks in a file determines which are read; the results are those of landmarks in memory.
TEST_P(BothSearches, LandmarksInAFileAreReadOnlyWhenTheyAreNeeded) {
  constexpr int kFrames = 20;
  World world(2 * kFrames);
  LandmarkDatabase in_memory(camera(), options()), in_file(camera(), options());
  std::atomic<int> reads = 0;
  std::vector<KnownLandmarks> known;
  for (int frame = 0; frame < kFrames; ++frame) {
    // More keypoints than the digest contains.
    Landmarks seen = world.seen({2 * frame, 2 * frame + 1});
    std::vector<int>&first = seen.landmarks[0].keypoints, &second = seen.landmarks[1].keypoints;
    first.insert(first.end(), second.begin(), second.end());
    ASSERT_GT(first.size(), static_cast<size_t>(LandmarkDigest::kMost));
    in_memory.add(frame, seen);
    known.emplace_back(digest_of(seen), [&reads, seen] {
      ++reads;
      return seen;
    });
  }
  in_file.add(0, kFrames, [&](int frame) -> const KnownLandmarks& { return known[static_cast<size_t>(frame)]; });
  EXPECT_EQ(reads, 0);
  EXPECT_EQ(in_file.landmarks(), in_memory.landmarks());
  EXPECT_EQ(in_file.keypoints(), in_memory.keypoints());
  const Pose moved{rotation_exp({0.02, -0.1, 0.05}), {0.02, 0.01, -0.03}};
  for (const std::vector<int>& things : {std::vector<int>{6, 7}, {0, 5, 30}, {39}}) {
    const Landmarks current = world.seen(things, moved);
    const auto a = in_memory.reidentify(current), b = in_file.reidentify(current);
    EXPECT_FALSE(a.empty());
    ASSERT_EQ(a.size(), b.size());
    for (size_t i = 0; i < a.size(); ++i) {
      EXPECT_EQ(a[i].landmark, b[i].landmark);
      EXPECT_EQ(a[i].earlier_frame, b[i].earlier_frame);
      EXPECT_EQ(a[i].earlier_landmark, b[i].earlier_landmark);
      EXPECT_EQ(a[i].earlier_from_current.translation, b[i].earlier_from_current.translation);
      ASSERT_EQ(a[i].matches.size(), b[i].matches.size());
      for (size_t m = 0; m < a[i].matches.size(); ++m) EXPECT_EQ(a[i].matches[m].earlier, b[i].matches[m].earlier);
    }
  }
  EXPECT_GT(reads, 0);
  EXPECT_LT(reads, kFrames);
}

INSTANTIATE_TEST_SUITE_P(Recognition, BothSearches, testing::ValuesIn(choice_values<DescriptorSearch>()));

// A plane at 1 m, seen by two cameras.
struct Plane {
  TruthFrame truth;
  Landmarks landmarks;
  Pose world_from_camera;
  explicit Plane(double x) : world_from_camera{Eigen::Matrix3d::Identity(), {x, 0, 0}} {
    const cv::Size size(532, 500);
    truth.depth_m = cv::Mat1f(size, 1.0f);
    truth.normals = cv::Mat3f(size, cv::Vec3f(0, 0, -1));
    truth.object_id = cv::Mat1f(size, 1.0f);
    truth.mask = cv::Mat1f(size, static_cast<float>(kTruthSurface | kTruthInBeam));
  }
  ScoredView judged() const { return {&landmarks, &truth, world_from_camera}; }
  int add(double x, double y, int object = 1) {
    Keypoint k;
    k.pixel = {x, y};
    k.covariance_m2 = 1e-10 * Eigen::Matrix3d::Identity();
    landmarks.keypoints.keypoints.push_back(k);
    truth.object_id(static_cast<int>(y), static_cast<int>(x)) = static_cast<float>(object);
    return static_cast<int>(landmarks.keypoints.keypoints.size()) - 1;
  }
};

TEST(LandmarkScore, CountsWhatIsTrue) {
  Plane earlier(0), current(0.01);  // 20 px apart
  Landmark a, b;
  std::vector<KeypointMatch> right, wrong;
  for (int i = 0; i < 6; ++i) {
    const int e = earlier.add(120 + 10 * i, 200 + 7 * i), c = current.add(100 + 10 * i, 200 + 7 * i, i < 3 ? 1 : 2);
    a.keypoints.push_back(e);
    b.keypoints.push_back(c);
    right.push_back({e, c, 0, 0});
    wrong.push_back({e, (c + 1) % 6, 0, 0});
  }
  a.outline = {{110, 190}, {180, 190}, {180, 250}, {110, 250}};
  b.outline = {{90, 190}, {160, 190}, {160, 250}, {90, 250}};
  earlier.landmarks.landmarks = {a};
  current.landmarks.landmarks = {b};
  EXPECT_TRUE(is_correct_match(earlier.judged(), current.judged(), right[0], camera()));
  EXPECT_FALSE(is_correct_match(earlier.judged(), current.judged(), wrong[0], camera()));
  const auto score = [&](const std::vector<KeypointMatch>& matches) {
    return score_landmarks({earlier.judged()}, current.judged(), {{0, 0, 0, matches, {}}}, camera());
  };
  const LandmarkScore good = score(right), bad = score(wrong);
  EXPECT_EQ(good.covisible, 1);
  EXPECT_EQ(good.recognised, 1);
  EXPECT_EQ(good.repeated, 1);
  EXPECT_EQ(good.right, 6);
  EXPECT_THAT(good.purity, testing::ElementsAre(0.5));
  EXPECT_EQ(bad.recognised, 0);
  EXPECT_EQ(bad.false_reidentifications, 1);
  EXPECT_EQ(bad.right, 0);
  EXPECT_EQ(bad.matches, 6);
  // One pixel is 0.5 mm here: an error of half a pixel is accepted, one of a whole pixel is not.
  current.landmarks.keypoints.keypoints[0].pixel.x() += 0.45;
  EXPECT_TRUE(is_correct_match(earlier.judged(), current.judged(), right[0], camera()));
  current.landmarks.keypoints.keypoints[0].pixel.x() += 0.5;
  EXPECT_FALSE(is_correct_match(earlier.judged(), current.judged(), right[0], camera()));
}

TEST(LandmarkScore, HiddenOrShadowedPointsAreNotCovisible) {
  for (const bool hidden : {true, false}) {
    Plane earlier(0), current(0.01);
    Landmark b;
    for (int i = 0; i < 6; ++i) b.keypoints.push_back(current.add(100 + 10 * i, 200));
    b.outline = {{90, 190}, {160, 190}, {160, 250}, {90, 250}};
    current.landmarks.landmarks = {b};
    if (hidden)
      earlier.truth.depth_m = 0.9f;
    else
      earlier.truth.mask = static_cast<float>(kTruthSurface | kTruthInBeam | kTruthInShadow);
    EXPECT_EQ(score_landmarks({earlier.judged()}, current.judged(), {}, camera()).covisible, 0);
  }
}

}  // namespace
}  // namespace fringeslam
