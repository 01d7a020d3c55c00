// SPDX-License-Identifier: Apache-2.0
#include "tools/authoring/scene_list.h"

#include <gmock/gmock.h>

#include <utility>

#include "core/io/staged.h"
#include "tests/support/matchers.h"
#include "tests/support/temp_folder.h"

namespace fringeslam::tools {
namespace {

using testing::HasSubstr;

TEST(SceneList, ASceneThatCannotBeReadIsListedWithTheReason) {
  const test::TempFolder temp;
  for (const auto& [name, text] : {std::pair("c", "description: Boxes\n"), std::pair("a", "description: [\n"),
                                   std::pair("b", "description: {}\n")}) {
    std::filesystem::create_directory(temp / name);
    write_text(temp / name / "scene.yaml", text);
  }
  const std::vector<ListedScene> scenes = list_scenes(temp.path());
  ASSERT_EQ(scenes.size(), 3u);
  for (const size_t i : {0u, 1u})
    EXPECT_THAT(scenes[i].description,
                testing::AllOf(testing::StartsWith("cannot be read: "), HasSubstr("scene.yaml")));
  EXPECT_EQ(scenes[2].folder.filename(), "c");
  EXPECT_EQ(scenes[2].description, "Boxes");
}

TEST(SceneList, AFolderWithoutScenesIsRefused) {
  const test::TempFolder temp;
  EXPECT_THAT(support::error_of([&] { list_scenes(temp.path()); }), HasSubstr("contains no folder with a scene.yaml"));
  EXPECT_THAT(support::error_of([&] { list_scenes(temp / "none"); }), HasSubstr("is not a folder"));
}

}  // namespace
}  // namespace fringeslam::tools
