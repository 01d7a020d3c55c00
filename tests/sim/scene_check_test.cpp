// SPDX-License-Identifier: Apache-2.0
#include "sim/scene_check.h"

#include <gmock/gmock.h>

#include "tests/sim/test_scenes.h"

namespace fringeslam::sim {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

Scene board_at(double distance, std::vector<Pose> poses = {Pose{}}) {
  RigModel rig = coaxial_rig();
  rig.near_m = 0.7, rig.far_m = 1.4;
  Scene scene = world_of({grey_object(plane_mesh(3, 3), pose_from({{0, 0, 1e3 * distance}, {0, 0, 0}}))}, rig);
  scene.objects[0].name = "object 1";
  scene.trajectory.clear();
  for (const Pose& pose : poses) scene.trajectory.push_back({0.5 * static_cast<double>(scene.trajectory.size()), pose});
  return scene;
}

TEST(SceneCheck, AGoodSceneHasNoWarning) {
  const SceneCheck check = check_scene(board_at(1, {Pose{}, pose_from({{30, 0, 0}, {0, 0, 0}})}));
  EXPECT_THAT(check.warnings, IsEmpty());
  ASSERT_EQ(check.views.size(), 2u);
  EXPECT_NEAR(check.views[0].surface, 1, 1e-9);
  EXPECT_NEAR(check.views[0].lit, 1, 1e-9);
  EXPECT_NEAR(check.views[0].in_range, 1, 1e-9);
  // The image is 65 px wide; a camera translation of 30 mm shifts it by 6 px at 1 m.
  EXPECT_NEAR(check.views[1].overlap, 1 - 6 / 65.0, 0.07);
}

TEST(SceneCheck, SaysWhatIsOutOfRange) {
  EXPECT_THAT(check_scene(board_at(2)).warnings,
              ElementsAre(HasSubstr("view 0: only 0 % of the pixels are lit and between")));
}

TEST(SceneCheck, SaysWhereTheProjectorLightsNothing) {
  EXPECT_THAT(check_scene(board_at(1, {pose_from({{0, 0, 0}, {180, 0, 0}})})).warnings,
              ElementsAre(HasSubstr("view 0: only 0 % of the pixels see a surface lit by the projector")));
}

TEST(SceneCheck, SaysWhichViewsDoNotOverlap) {
  EXPECT_THAT(check_scene(board_at(1, {Pose{}, pose_from({{400, 0, 0}, {0, 0, 0}})})).warnings,
              ElementsAre(HasSubstr("view 1: only 0 % of the previous view's lit points are in the image")));
}

TEST(SceneCheck, SaysWhereTheRigStandsInSomething) {
  Scene scene = board_at(1);
  scene.objects.push_back(grey_object(box_mesh({3, 3, 3}), Pose{}));
  scene.objects[1].name = "object 2";
  EXPECT_THAT(check_scene(scene).warnings, testing::Contains(HasSubstr("view 0: the camera is inside object 2")));
  // A box behind the camera does not contain it.
  scene.objects[1].world_from_object.translation.z() = -4;
  EXPECT_THAT(check_scene(scene).warnings, IsEmpty());
}

}  // namespace
}  // namespace fringeslam::sim
