// SPDX-License-Identifier: Apache-2.0
// The values that the page of a scene shows, and the changes that it orders.
#include "tools/authoring/watched_scene.h"

#include <gmock/gmock.h>

#include <nlohmann/json.hpp>
#include <set>

#include "core/io/staged.h"
#include "tests/support/temp_folder.h"

namespace fringeslam::tools {
namespace {

using nlohmann::json;

std::string small_planes(int count) {
  std::string text = "name: planes\nrig: {file: " FRINGESLAM_SOURCE_DIR
                     "/scenes/rigs/thesis.yaml}\npatterns: {steps: 3, periods_px: [16.5]}\n"
                     "materials: {a: {grain: plain, albedo: 0.2}}\nobjects:\n";
  for (int i = 0; i < count; ++i)
    text += "  - {shape: plane, size_m: [1, 1], material: a, pose: {translation_m: [0, 0, 0.1]}}\n";
  return text + "trajectory: {start: {translation_m: [0, 0, 0.25]}}\n";
}

TEST(SceneData, ListsTheCoordinatesOfAllThatCanBeDragged) {
  const test::TempFolder temp;
  write_text(temp / "scene.yaml", small_planes(2));
  std::vector<sim::SceneValue> values;
  sim::SceneLoadOptions reading;
  reading.values = &values;
  const sim::Scene scene = sim::load_scene(temp / "scene.yaml", reading);
  // Many numbers precede those of the scene.
  sim::SceneValue other;
  other.path = "light.ambient_lux";
  std::vector<sim::SceneValue> many(kMostNumbers, other);
  many.insert(many.end(), values.begin(), values.end());
  std::set<std::string> listed;
  const json data = json::parse(scene_data(scene, many).json);
  for (const json& value : data.at("values")) {
    if (value["path"] != other.path) listed.insert(value["path"].get<std::string>());
  }
  std::vector<std::string> expected;
  for (const char* place :
       {"objects.0.pose.translation_m.", "objects.1.pose.translation_m.", "trajectory.start.translation_m."}) {
    for (int axis = 0; axis < 3; ++axis) expected.push_back(place + std::to_string(axis));
  }
  EXPECT_THAT(listed, testing::ElementsAreArray(expected));
}

// Changes are ordered while others are being taken over.
TEST(WatchedScene, KeepsAllChangesOrdered) {
  constexpr int kOrdered = 60;
  const test::TempFolder temp;
  write_text(temp / "scene.yaml", small_planes(kOrdered));
  WatchedScene watched(temp / "scene.yaml", {});
  WatchedScene::State state = watched.state();
  WatchedScene::Changes expected;
  for (int i = 0; i < kOrdered; ++i) {
    expected.emplace_back("objects." + std::to_string(i) + ".pose.translation_m.2", "0.2");
    watched.change_value(expected.back().first, expected.back().second);
  }
  const auto height_m = [](const sim::Object& object) { return object.world_from_object.translation.z(); };
  const auto end = std::chrono::steady_clock::now() + std::chrono::minutes(1);
  const auto is_last = [&] { return state.scene && height_m(state.scene->scene.objects.back()) == 0.2; };
  while ((state.loading || !is_last()) && std::chrono::steady_clock::now() < end)
    state = watched.await_change(state.number, std::chrono::seconds(1), [] { return false; });
  ASSERT_TRUE(is_last()) << state.error;
  EXPECT_EQ(state.changes, expected);
  for (const sim::Object& object : state.scene->scene.objects) EXPECT_EQ(height_m(object), 0.2);
}

}  // namespace
}  // namespace fringeslam::tools
