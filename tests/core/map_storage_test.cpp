// SPDX-License-Identifier: Apache-2.0
// Saved maps, and the journal that saves a map while it grows: what survives kills, truncation and full disks.
#include <gmock/gmock.h>
#include <signal.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <thread>
#include <utility>

#include "core/io/files.h"
#include "core/storage/map_file.h"
#include "core/storage/map_index.h"
#include "core/storage/map_journal.h"
#include "tests/support/matchers.h"
#include "tests/support/random.h"
#include "tests/support/scene.h"
#include "tests/support/temp_folder.h"

namespace fringeslam {
namespace {

namespace fs = std::filesystem;
using support::error_of;
using support::Random;
using test::TempFolder;
using testing::HasSubstr;

RigModel tiny_rig() {
  RigModel rig = support::small_rig(false);
  rig.camera.width = 23, rig.camera.height = 17;
  return rig;
}
const RigModel kTinyRig = tiny_rig();

Frame frame_of(int number) {
  Random random(static_cast<uint64_t>(number) + 1);
  const cv::Size size(kTinyRig.camera.width, kTinyRig.camera.height);
  Frame frame;
  frame.index = number;
  frame.timestamp_s = 0.1 * number;
  frame.points_m.create(size);
  frame.sigma_m.create(size);
  frame.normals.create(size);
  frame.texture.create(size);
  for (int i = 0; i < size.area(); ++i) {
    const Eigen::Vector3d p = random.direction(), n = random.direction();
    frame.points_m(i) = {float(p.x()), float(p.y()), float(1 + p.z() / 4)};
    frame.normals(i) = {float(n.x()), float(n.y()), float(n.z())};
    frame.sigma_m(i) = 1e-4f;
    frame.texture(i) = static_cast<uchar>(i * (number + 1) % 251);
  }
  return frame;
}

Landmarks landmarks_of(int number) {
  Random random(static_cast<uint64_t>(number) + 1000);
  Landmarks landmarks;
  const int count = 3 + number % 4;
  for (int i = 0; i < count; ++i) {
    Keypoint keypoint;
    keypoint.pixel = random.direction().head<2>();
    keypoint.point_m = random.direction();
    keypoint.scale = 2 + i;
    landmarks.keypoints.keypoints.push_back(keypoint);
  }
  landmarks.keypoints.detected = 2 * count;
  landmarks.keypoints.descriptors = cv::Mat1f(count, 128, 0.01f * static_cast<float>(number + 1));
  landmarks.landmarks = {{{}, {{number, 2}, {30, 4}, {5, 60}}, {0, count - 1}}};
  return landmarks;
}

Pose at(int number) {
  return {rotation_exp(Eigen::Vector3d(0.01, 0.02, 0.03) * number), Eigen::Vector3d(0.5 * number, 0.1, 0.2)};
}

// Every second stack was exposed in motion.
KeyframeMotion motion_of(int number) {
  if (number % 2 == 0) return {};
  Random random(static_cast<uint64_t>(number) + 2000);
  Matrix6d factor;
  for (int col = 0; col < 6; col += 3) {
    for (int row = 0; row < 6; ++row) factor.block<1, 3>(row, col) = 1e-3 * random.direction().transpose();
  }
  return {factor * factor.transpose(), number == 3};
}

// View `number` of a mission: each is a keyframe, and every second one has another frame fixed to it.
void add_view(KeyframeMap& map, int number) {
  map.add_keyframe(frame_of(2 * number), landmarks_of(number), at(number), motion_of(number));
  if (number % 2 == 1) map.add_frame(frame_of(2 * number + 1), number, {Eigen::Matrix3d::Identity(), {0.2, 0, 0}});
  if (number > 0)
    map.link({number - 1, number, at(number - 1).inverse() * at(number), 1e6 * Matrix6d::Identity(), number % 3 == 0});
}

KeyframeMap map_of(int views) {
  KeyframeMap map(kTinyRig, {});
  for (int i = 0; i < views; ++i) add_view(map, i);
  return map;
}

template <class Pixel>
void expect_same(const cv::Mat_<Pixel>& a, const cv::Mat_<Pixel>& b) {
  ASSERT_EQ(a.size(), b.size());
  for (int row = 0; row < a.rows; ++row)
    ASSERT_EQ(std::memcmp(a[row], b[row], sizeof(Pixel) * static_cast<size_t>(a.cols)), 0);
}

void expect_same(const Pose& a, const Pose& b) {
  ASSERT_EQ(a.rotation, b.rotation);
  ASSERT_EQ(a.translation, b.translation);
}

void expect_same(const StoredFrame& a, const StoredFrame& b) {
  ASSERT_EQ(a.index, b.index);
  ASSERT_EQ(a.timestamp_s, b.timestamp_s);
  expect_same(a.depth_m, b.depth_m);
  expect_same(a.sigma, b.sigma);
  expect_same(a.normals, b.normals);
  expect_same(a.texture, b.texture);
}

// Expects that `map` consists of the first keyframes of `whole` and of what belongs to them, of which frames and links may be
// missing. Returns their number.
int expect_beginning(const KeyframeMap& map, const KeyframeMap& whole) {
  const size_t count = map.keyframes().size();
  EXPECT_LE(count, whole.keyframes().size());
  for (size_t i = 0; i < std::min(count, whole.keyframes().size()); ++i) {
    const Keyframe &a = map.keyframes()[i], &b = whole.keyframes()[i];
    expect_same(a.world_from_camera, b.world_from_camera);
    expect_same(a.frame, b.frame);
    EXPECT_TRUE(a.motion.covariance.isApprox(b.motion.covariance, 1e-15));
    EXPECT_EQ(a.motion.doubtful, b.motion.doubtful);
    EXPECT_EQ(landmark_bytes(*a.landmarks.get()), landmark_bytes(*b.landmarks.get()));
  }
  const auto inside = [&](int keyframe) { return keyframe < static_cast<int>(count); };
  size_t f = 0, l = 0;
  for (const MapFrame& frame : whole.frames()) {
    if (f == map.frames().size() || map.frames()[f].frame.index != frame.frame.index) continue;
    const MapFrame& other = map.frames()[f++];
    EXPECT_EQ(other.keyframe, frame.keyframe);
    expect_same(other.keyframe_from_camera, frame.keyframe_from_camera);
    expect_same(other.frame, frame.frame);
  }
  EXPECT_EQ(f, map.frames().size());
  for (const PoseEdge& link : whole.links()) {
    if (!inside(link.to) || l == map.links().size()) continue;
    EXPECT_EQ(map.links()[l].to, link.to);
    EXPECT_EQ(map.links()[l].loop, link.loop);
    expect_same(map.links()[l++].from_from_to, link.from_from_to);
  }
  EXPECT_EQ(l, map.links().size());
  return static_cast<int>(count);
}

void restore_all(const KeyframeMap& map) {
  for (const MapFrame& frame : map.frames()) (void)restored(frame.frame, map.rays());
}

// Runs `mission` in a process that is killed at its end.
template <class Mission>
void killed_after(const Mission& mission) {
  const pid_t child = fork();
  ASSERT_GE(child, 0);
  if (child == 0) {
    mission();
    ::kill(::getpid(), SIGKILL);
  }
  int status = 0;
  ASSERT_EQ(waitpid(child, &status, 0), child);
  ASSERT_TRUE(WIFSIGNALED(status) && WTERMSIG(status) == SIGKILL);
}

void ignore(const std::string&) {}

void wait_until_saved(const MapJournal& journal, int keyframes) {
  while (journal.saved_keyframes() < keyframes) std::this_thread::sleep_for(std::chrono::milliseconds(5));
}

// A mission of some views whose process was killed after they had been saved. Returns its journal.
fs::path killed_mission(const fs::path& target, int views) {
  killed_after([&] {
    KeyframeMap map(kTinyRig, {});
    MapJournal journal(target, ignore);
    for (int i = 0; i < views; ++i) {
      add_view(map, i);
      journal.update(map);
    }
    wait_until_saved(journal, views);
  });
  const std::vector<LeftMap> left = left_maps(target);
  EXPECT_EQ(left.size(), 1u);
  if (left.empty()) return {};
  EXPECT_EQ(left[0].keyframes, views);
  return left[0].folder;
}

TEST(MapStorage, AMapIsOpenedAsItWasWritten) {
  const TempFolder temp;
  const KeyframeMap map = map_of(7);
  write_map(temp / "a.map", map);
  const KeyframeMap again = open_map(temp / "a.map", kTinyRig, {});
  EXPECT_EQ(expect_beginning(again, map), 7);
  EXPECT_EQ(again.frames().size(), map.frames().size());
  EXPECT_EQ(again.links().size(), map.links().size());
  restore_all(again);
  verify_map(temp / "a.map");
  // From a map in a file and one in memory.
  write_map(temp / "b.map", again);
  EXPECT_EQ(test::read_bytes(temp / "a.map"), test::read_bytes(temp / "b.map"));
  EXPECT_EQ(read_map_info(temp / "a.map").content.index.keyframes.size(), 7u);
}

TEST(MapStorage, ImagesOutliveTheMapAndItsFile) {
  const TempFolder temp;
  const KeyframeMap map = map_of(2);
  write_map(temp / "a.map", map);
  std::optional<KeyframeMap> opened = open_map(temp / "a.map", kTinyRig, {});
  const StoredFrame frame = opened->keyframes()[1].frame;
  opened.reset();
  fs::remove(temp / "a.map");
  StoredFrame copy = frame;
  expect_same(copy, map.keyframes()[1].frame);
}

TEST(MapStorage, AMapOfAnotherCameraIsRefused) {
  const TempFolder temp;
  write_map(temp / "a.map", map_of(1));
  RigModel other = kTinyRig;
  other.camera.fx *= 1.001;
  EXPECT_THROW(open_map(temp / "a.map", other, {}), Error);
}

TEST(MapStorage, ATruncatedMapIsRefused) {
  const TempFolder temp;
  write_map(temp / "a.map", map_of(3));
  const std::string whole = test::read_bytes(temp / "a.map");
  for (size_t size = 0; size < whole.size(); size += 1 + size % 61) {
    test::write_bytes(temp / "cut.map", whole.substr(0, size));
    try {
      (void)open_map(temp / "cut.map", kTinyRig, {});
      FAIL() << size;
    } catch (const Error& e) {
      EXPECT_THAT(e.what(), testing::StartsWith((temp / "cut.map").string() + ": "));
    }
  }
}

// Valid parts that do not belong together: indices of the digest would refer to landmarks that do not exist.
TEST(MapStorage, LandmarksOfAnotherKeyframeAreRefused) {
  const TempFolder temp;
  write_map(temp / "a.map", map_of(2));
  const std::string whole = test::read_bytes(temp / "a.map");
  IndexOfFile of_file = read_index(whole, "a.map");
  std::swap(of_file.index.keyframes[0].landmarks, of_file.index.keyframes[1].landmarks);
  test::write_bytes(temp / "swapped.map",
                    whole.substr(0, of_file.parts_end) + index_bytes(of_file.index, of_file.parts_end));
  const KeyframeMap opened = open_map(temp / "swapped.map", kTinyRig, {});
  const auto says = HasSubstr("swapped.map: is damaged: the landmarks of a keyframe are not those of its digest");
  EXPECT_THAT(error_of([&] { (void)opened.keyframes()[0].landmarks.get(); }), says);
  EXPECT_THAT(error_of([&] { verify_map(temp / "swapped.map"); }), says);
}

// Links that the pose graph would refuse later, in the middle of a run.
TEST(MapStorage, ImpossibleLinksAreRefused) {
  const TempFolder temp;
  write_map(temp / "a.map", map_of(4));
  const std::string whole = test::read_bytes(temp / "a.map");
  const auto message_with = [&](const auto& change) {
    IndexOfFile of_file = read_index(whole, "a.map");
    change(of_file.index);
    test::write_bytes(temp / "bad.map",
                      whole.substr(0, of_file.parts_end) + index_bytes(of_file.index, of_file.parts_end));
    return error_of([&] { (void)open_map(temp / "bad.map", kTinyRig, {}); });
  };
  EXPECT_EQ(message_with([](MapIndex&) {}), "no Error was thrown");
  EXPECT_THAT(message_with([](MapIndex& index) { index.links[0].to = index.links[0].from; }),
              HasSubstr("bad.map: is damaged (a link joins a keyframe with itself)"));
  EXPECT_THAT(message_with([](MapIndex& index) { index.links[1].information(0, 3) = 1e5; }),
              HasSubstr("the information of a link is not symmetric"));
  EXPECT_THAT(message_with([](MapIndex& index) { index.links[1].information(2, 2) = -1; }),
              HasSubstr("the information of a link has a negative eigenvalue"));
  EXPECT_THAT(message_with([](MapIndex& index) {
                Matrix6d& covariance = index.keyframes[1].motion.covariance;
                covariance(0, 1) = covariance(1, 0) = 2 * covariance.diagonal().maxCoeff();
              }),
              HasSubstr("a covariance has a negative eigenvalue"));
}

// No byte can change unnoticed, except those that fill up parts.
TEST(MapStorage, DamageIsNoticedWhenItIsRead) {
  const TempFolder temp;
  const KeyframeMap map = map_of(3);
  write_map(temp / "a.map", map);
  const std::string whole = test::read_bytes(temp / "a.map");
  int noticed = 0, tried = 0;
  for (size_t i = 0; i < whole.size(); i += 37, ++tried) {
    std::string damaged = whole;
    damaged[i] = static_cast<char>(damaged[i] ^ (1 << i % 8));
    test::write_bytes(temp / "bad.map", damaged);
    try {
      const KeyframeMap opened = open_map(temp / "bad.map", kTinyRig, {});
      restore_all(opened);
      EXPECT_EQ(expect_beginning(opened, map), 3) << i;
    } catch (const Error& e) {
      EXPECT_THAT(e.what(), testing::StartsWith((temp / "bad.map").string() + ": "));
      ++noticed;
    }
  }
  EXPECT_GT(noticed, tried * 9 / 10);
}

TEST(MapJournal, AFinishedMapReplacesIt) {
  const TempFolder temp;
  KeyframeMap map(kTinyRig, {});
  {
    MapJournal journal(temp / "run", ignore);
    for (int i = 0; i < 5; ++i) {
      add_view(map, i);
      journal.update(map);
    }
    journal.finish(map, temp / "saved.map");
    journal.remove();
  }
  EXPECT_EQ(test::listing(temp.path()), (std::set<std::string>{"saved.map"}));
  const KeyframeMap opened = open_map(temp / "saved.map", kTinyRig, {});
  EXPECT_EQ(expect_beginning(opened, map), 5);
  EXPECT_EQ(opened.frames().size(), map.frames().size());
  verify_map(temp / "saved.map");
}

// When parts and index reach the disk depends on time, the bytes of the result do not.
TEST(MapJournal, TheResultDoesNotDependOnTime) {
  const TempFolder temp;
  const auto saved = [&](const std::string& name, bool slowly) {
    KeyframeMap map(kTinyRig, {});
    MapJournal journal(temp / name, ignore);
    for (int i = 0; i < 4; ++i) {
      add_view(map, i);
      if (i == 2) map.replace_frame(0, frame_of(99), {rotation_exp({0.01, 0, 0}), {0.001, 0.002, 0.003}});
      journal.update(map);
      if (slowly) wait_until_saved(journal, i + 1);
    }
    journal.finish(map, temp / (name + ".map"));
    return test::read_bytes(temp / (name + ".map"));
  };
  EXPECT_EQ(saved("fast", false), saved("slow", true));
}

TEST(MapJournal, ChangesOfKeyframesAndLinksAreSaved) {
  const TempFolder temp;
  KeyframeMap map = map_of(3);
  MapJournal journal(temp / "run", ignore);
  journal.update(map);
  Frame better = frame_of(99);  // of the same view
  better.index = frame_of(2).index;
  better.timestamp_s = frame_of(2).timestamp_s;
  map.replace_frame(1, better, {rotation_exp({0.01, 0, 0}), {0.001, 0.002, 0.003}});
  map.set_motion(1, motion_of(3));
  journal.finish(map, temp / "saved.map");
  const KeyframeMap opened = open_map(temp / "saved.map", kTinyRig, {});
  EXPECT_EQ(expect_beginning(opened, map), 3);
  ASSERT_EQ(opened.links().size(), map.links().size());
  for (size_t i = 0; i < map.links().size(); ++i)
    expect_same(opened.links()[i].from_from_to, map.links()[i].from_from_to);
}

TEST(MapJournal, AKilledMissionIsRecovered) {
  const TempFolder temp;
  const fs::path folder = killed_mission(temp / "run", 6);
  EXPECT_THAT(left_maps(temp / "run")[0].message, testing::HasSubstr("map recover " + (temp / "run").string()));
  WorkFolder journal = WorkFolder::taken_over(folder);
  const RecoveredMap recovered = recover_map(journal, temp / "saved.map");
  EXPECT_EQ(recovered.keyframes, 6);
  EXPECT_EQ(recovered.damaged, 0);
  journal.remove();
  EXPECT_EQ(test::listing(temp.path()), (std::set<std::string>{"saved.map"}));
  const KeyframeMap whole = map_of(6), opened = open_map(temp / "saved.map", kTinyRig, {});
  EXPECT_EQ(expect_beginning(opened, whole), 6);
  EXPECT_EQ(opened.frames().size(), whole.frames().size());
  EXPECT_EQ(opened.links().size(), whole.links().size());
  verify_map(temp / "saved.map");
}

// Poses that a loop moves and frames that are replaced are those of the last index; frames are not written again.
TEST(MapJournal, KeepsTheLatestPoses) {
  const TempFolder temp;
  const auto moved_map = [](KeyframeMap& map) {
    Frame better = frame_of(77);  // of the same view
    better.index = 0, better.timestamp_s = 0;
    map.replace_frame(0, better, {Eigen::Matrix3d::Identity(), {1e-3, 0, 0}});
    map.link({0, 3, at(0).inverse() * at(3) * Pose{Eigen::Matrix3d::Identity(), {0.01, 0, 0}},
              1e8 * Matrix6d::Identity(), true});
    map.correct({}, 1e-6);
  };
  killed_after([&] {
    KeyframeMap map(kTinyRig, {});
    MapJournal journal(temp / "run", ignore);
    for (int i = 0; i < 4; ++i) add_view(map, i);
    journal.update(map);
    wait_until_saved(journal, 4);
    moved_map(map);
    add_view(map, 4);
    journal.update(map);
    wait_until_saved(journal, 5);
  });
  KeyframeMap expected = map_of(4);
  const Pose before = expected.keyframes()[3].world_from_camera;
  moved_map(expected);
  EXPECT_NE(expected.keyframes()[3].world_from_camera.translation, before.translation);
  add_view(expected, 4);
  const auto parts_bytes = fs::file_size(left_maps(temp / "run")[0].folder / "saved.map");
  EXPECT_LT(parts_bytes, 9 * FrameLayout(cv::Size(23, 17)).bytes + 5 * 8192);
  (void)recover_map(WorkFolder::taken_over(left_maps(temp / "run")[0].folder), temp / "saved.map");
  EXPECT_EQ(expect_beginning(open_map(temp / "saved.map", kTinyRig, {}), expected), 5);
}

// Whatever a crash leaves of its files, the result is a map of the first keyframes, with right checksums, or one clear line.
TEST(MapJournal, ATruncatedJournalGivesTheBeginningOrAnError) {
  const TempFolder temp;
  const KeyframeMap whole = map_of(5);
  const fs::path folder = killed_mission(temp / "run", 5);
  const std::string parts = test::read_bytes(folder / "saved.map"), index = test::read_bytes(folder / "index");
  const auto recovered = [&] {
    fs::remove(temp / "out.map");
    const WorkFolder journal = WorkFolder::taken_over(folder);
    try {
      const RecoveredMap result = recover_map(journal, temp / "out.map");
      verify_map(temp / "out.map");
      EXPECT_EQ(expect_beginning(open_map(temp / "out.map", kTinyRig, {}), whole), result.keyframes);
      return result.keyframes;
    } catch (const Error& e) {
      EXPECT_THAT(e.what(), testing::StartsWith(folder.string()));
      EXPECT_FALSE(fs::exists(temp / "out.map"));
      return 0;
    }
  };
  int before = 0;
  std::set<int> counts;
  for (size_t size = 0; size <= parts.size(); size += size < parts.size() - 500 ? 509 : 1) {
    fs::remove(folder / "saved.map");
    test::write_bytes(folder / "saved.map", parts.substr(0, size));
    const int keyframes = recovered();
    EXPECT_GE(keyframes, before) << "more bytes, fewer keyframes";
    counts.insert(before = keyframes);
  }
  EXPECT_EQ(counts, (std::set<int>{0, 1, 2, 3, 4, 5}));
  // A part that did not reach the disk.
  for (size_t at = kMapAlignment; at < parts.size(); at += 1021) {
    std::string damaged = parts;
    damaged[at] = static_cast<char>(~damaged[at]);
    fs::remove(folder / "saved.map");
    test::write_bytes(folder / "saved.map", damaged);
    recovered();
  }
  fs::remove(folder / "saved.map");
  test::write_bytes(folder / "saved.map", parts);
  for (size_t size = 0; size < index.size(); size += 101) {
    test::write_bytes(folder / "index", index.substr(0, size));
    EXPECT_EQ(recovered(), 0);
  }
  test::write_bytes(folder / "index", index);
  EXPECT_EQ(recovered(), 5);
}

// The parts of the map that is continued are not copied while mapping, and its file may be replaced meanwhile.
TEST(MapJournal, AContinuedMapIsCompletedByItsBase) {
  const TempFolder temp;
  write_map(temp / "base.map", map_of(4));
  killed_after([&] {
    KeyframeMap map = open_map(temp / "base.map", kTinyRig, {});
    MapJournal journal(temp / "run", ignore);
    journal.update(map);
    for (int i = 4; i < 6; ++i) {
      add_view(map, i);
      journal.update(map);
    }
    wait_until_saved(journal, 6);
  });
  const std::string base = test::read_bytes(temp / "base.map");
  const fs::path folder = left_maps(temp / "run")[0].folder;
  EXPECT_LT(fs::file_size(folder / "saved.map"), base.size());
  fs::remove(temp / "base.map");
  (void)recover_map(WorkFolder::taken_over(folder), temp / "saved.map");
  verify_map(temp / "saved.map");
  const KeyframeMap whole = map_of(6);
  EXPECT_EQ(expect_beginning(open_map(temp / "saved.map", kTinyRig, {}), whole), 6);

  // The same without a kill.
  test::write_bytes(temp / "base.map", base);
  KeyframeMap map = open_map(temp / "base.map", kTinyRig, {});
  MapJournal journal(temp / "again", ignore);
  for (int i = 4; i < 6; ++i) {
    add_view(map, i);
    journal.update(map);
  }
  journal.finish(map, temp / "finished.map");
  journal.remove();
  verify_map(temp / "finished.map");
  const KeyframeMap finished = open_map(temp / "finished.map", kTinyRig, {});
  EXPECT_EQ(expect_beginning(finished, whole), 6);
  EXPECT_EQ(finished.frames().size(), whole.frames().size());
}

TEST(MapJournal, LeavesNothingIfNothingWasMapped) {
  const TempFolder temp;
  { const MapJournal journal(temp / "run", ignore); }
  EXPECT_TRUE(test::listing(temp.path()).empty());
  killed_after([&] {
    const auto* const journal = new MapJournal(temp / "run", ignore);
    (void)journal;
  });
  EXPECT_FALSE(test::listing(temp.path()).empty());
  EXPECT_TRUE(left_maps(temp / "run").empty());
  EXPECT_TRUE(test::listing(temp.path()).empty()) << "a leftover without a keyframe";
}

// Two missions with the same result do not disturb each other; only what dead processes left is found.
TEST(MapJournal, OfALivingProcessIsLeftAlone) {
  const TempFolder temp;
  const KeyframeMap map = map_of(2);
  MapJournal one(temp / "run", ignore), two(temp / "run", ignore);
  for (MapJournal* const journal : {&one, &two}) {
    journal->update(map);
    wait_until_saved(*journal, 2);
  }
  EXPECT_NE(one.folder(), two.folder());
  EXPECT_TRUE(left_maps(temp / "run").empty());
  EXPECT_THROW(WorkFolder::taken_over(one.folder()), Error);
  one.finish(map, temp / "one.map");
  two.finish(map, temp / "two.map");
  EXPECT_EQ(test::read_bytes(temp / "one.map"), test::read_bytes(temp / "two.map"));
}

TEST(MapJournal, ForeignFoldersAreLeftAlone) {
  const TempFolder temp;
  test::write_bytes(temp / "run.mapping-abcdef/index", "mine");
  test::write_bytes(temp / "run.mapping-notes/saved.map", "mine");
  EXPECT_TRUE(left_maps(temp / "run").empty());
  EXPECT_THROW(WorkFolder::taken_over(temp / "run.mapping-abcdef"), Error);
  EXPECT_EQ(test::read_bytes(temp / "run.mapping-abcdef/index"), "mine");
  EXPECT_EQ(test::read_bytes(temp / "run.mapping-notes/saved.map"), "mine");
}

// Files cannot grow beyond a limit while an instance exists, as on a full disk.
class FileLimit {
 public:
  explicit FileLimit(rlim_t bytes) {
    getrlimit(RLIMIT_FSIZE, &before_);
    handler_ = signal(SIGXFSZ, SIG_IGN);
    const rlimit limit{bytes, before_.rlim_max};
    setrlimit(RLIMIT_FSIZE, &limit);
  }
  ~FileLimit() {
    setrlimit(RLIMIT_FSIZE, &before_);
    signal(SIGXFSZ, handler_);
  }
  FileLimit(const FileLimit&) = delete;
  FileLimit& operator=(const FileLimit&) = delete;

 private:
  rlimit before_{};
  void (*handler_)(int) = nullptr;
};

TEST(MapJournal, AFullDiskLosesNothingThatWasSaved) {
  const TempFolder temp;
  std::atomic<int> warnings = 0;
  const auto warn = [&](const std::string& message) {
    EXPECT_THAT(message, testing::HasSubstr("mapping goes on"));
    ++warnings;
  };
  KeyframeMap map = map_of(2);
  {
    MapJournal journal(temp / "run", warn);
    journal.update(map);
    wait_until_saved(journal, 2);
    const FileLimit limit(fs::file_size(journal.folder() / "saved.map") + 1000);
    for (int i = 2; i < 5; ++i) {
      add_view(map, i);
      journal.update(map);
    }
    while (warnings == 0) std::this_thread::sleep_for(std::chrono::milliseconds(5));
    EXPECT_THROW(journal.finish(map, temp / "saved.map"), Error);
    EXPECT_EQ(journal.saved_keyframes(), 2);
    EXPECT_FALSE(fs::exists(temp / "saved.map"));
  }
  EXPECT_EQ(warnings, 1);
  ASSERT_EQ(left_maps(temp / "run").size(), 1u) << "it remains after an error";
  (void)recover_map(WorkFolder::taken_over(left_maps(temp / "run")[0].folder), temp / "saved.map");
  verify_map(temp / "saved.map");
  EXPECT_EQ(expect_beginning(open_map(temp / "saved.map", kTinyRig, {}), map), 2);
}

// The corrections that come with a new image of a keyframe do not reach the index before the image does.
TEST(MapJournal, AFullDiskDoesNotSeparateAnImageFromItsPoses) {
  const TempFolder temp;
  const auto begun = [] {
    KeyframeMap map = map_of(2);
    map.link({1, 0, at(1).inverse() * at(0), 1e6 * Matrix6d::Identity(), true});
    return map;
  };
  std::atomic<int> warnings = 0;
  KeyframeMap map = map_of(2);
  {
    MapJournal journal(temp / "run", [&](const std::string&) { ++warnings; });
    journal.update(map);
    wait_until_saved(journal, 2);
    const FileLimit limit(fs::file_size(journal.folder() / "saved.map") + 1000);
    map.link({1, 0, at(1).inverse() * at(0), 1e6 * Matrix6d::Identity(), true});
    journal.update(map);
    Frame better = frame_of(77);  // of the same view
    better.index = 0, better.timestamp_s = 0;
    map.replace_frame(0, better, {Eigen::Matrix3d::Identity(), {1e-3, 0, 0}});
    journal.update(map);
    while (warnings == 0) std::this_thread::sleep_for(std::chrono::milliseconds(5));
    EXPECT_THROW(journal.finish(map, temp / "saved.map"), Error);
  }
  ASSERT_EQ(left_maps(temp / "run").size(), 1u);
  (void)recover_map(WorkFolder::taken_over(left_maps(temp / "run")[0].folder), temp / "saved.map");
  EXPECT_EQ(expect_beginning(open_map(temp / "saved.map", kTinyRig, {}), begun()), 2);
}

TEST(MapJournal, SavesWhatWaitedOnceTheDiskHasSpace) {
  const TempFolder temp;
  std::atomic<int> warnings = 0;
  KeyframeMap map = map_of(2);
  MapJournal journal(temp / "run", [&](const std::string&) { ++warnings; });
  journal.update(map);
  wait_until_saved(journal, 2);
  {
    const FileLimit limit(fs::file_size(journal.folder() / "saved.map") + 7000);
    for (int i = 2; i < 5; ++i) {
      add_view(map, i);
      journal.update(map);
    }
    while (warnings == 0) std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  wait_until_saved(journal, 5);
  journal.finish(map, temp / "saved.map");
  journal.remove();
  verify_map(temp / "saved.map");
  EXPECT_EQ(expect_beginning(open_map(temp / "saved.map", kTinyRig, {}), map), 5);
}

}  // namespace
}  // namespace fringeslam
