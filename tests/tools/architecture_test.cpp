// SPDX-License-Identifier: Apache-2.0
#include "tests/tools/architecture.h"

#include <gmock/gmock.h>

#include <regex>

#include "tests/support/temp_folder.h"

namespace fringeslam {
namespace {

using test::violations;
using testing::ElementsAre;
using testing::IsEmpty;

class Tree {
 public:
  void add(const std::string& file, const std::string& text) { test::write_bytes(temp_ / file, text); }
  std::vector<std::string> violations() const { return test::violations(temp_.path()); }

 private:
  test::TempFolder temp_;
};

TEST(Architecture, ThisTreeHasNoWrongArrow) { EXPECT_THAT(violations(FRINGESLAM_SOURCE_DIR), IsEmpty()); }

TEST(Architecture, TheScanReadsThisTree) {
  // Ensures that the test above cannot pass because the scan reads no files.
  for (const std::string file : {"core/types/pose.h", "sim/light/ray_scene.cpp", "tools/main.cpp"})
    EXPECT_TRUE(test::fs::exists(test::fs::path(FRINGESLAM_SOURCE_DIR) / file)) << file;
}

// `render` checks the inputs of tum_rgbd.cpp and euroc.cpp.
TEST(Architecture, VerbsThatReplaceAFolderCheckTheirInputs) {
  const std::regex replaces("StagedFolder \\w+\\([^;]*\"[a-z]");
  std::vector<std::string> unchecked;
  for (const auto& entry : test::fs::directory_iterator(test::fs::path(FRINGESLAM_SOURCE_DIR) / "tools")) {
    if (entry.path().extension() != ".cpp") continue;
    const std::string text = test::read_bytes(entry.path());
    if (std::regex_search(text, replaces) && text.find("require_not_an_input(") == text.npos)
      unchecked.push_back(entry.path().filename());
  }
  EXPECT_THAT(unchecked, testing::UnorderedElementsAre("euroc.cpp", "tum_rgbd.cpp"));
}

TEST(Architecture, AllowedArrowsPass) {
  Tree tree;
  tree.add("core/types/pose.h", "#include <Eigen/Core>\n#include <opencv2/core/utility.hpp>\n#include <vector>\n");
  tree.add("core/patterns/patterns.cpp", "#include \"core/patterns/patterns.h\"\n#include \"core/types/error.h\"\n");
  tree.add("core/rig/rig.h", "#include \"core/patterns/patterns.h\"\n#include \"core/types/rig_model.h\"\n");
  tree.add("core/io/yaml.cpp", "#include <yaml-cpp/yaml.h>\n#include \"core/io/yaml.h\"\n");
  tree.add("core/motion/refine.cpp", "#include <ceres/ceres.h>\n#include \"core/motion/refine.h\"\n");
  tree.add("core/mapper/pipeline.h", "#include \"core/decode/decode.h\"\n#include \"core/registration/icp.h\"\n");
  tree.add("sim/light/ray_scene.cpp",
           "#include <embree3/rtcore.h>\n#include \"core/rig/rig.h\"\n#include \"sim/random.h\"\n");
  tree.add("hw/camera.cpp", "#include <arv.h>\n#include \"core/rig/rig.h\"\n");
  tree.add("bench/speed/decode.cpp", "#include \"core/score/score.h\"\n#include \"sim/virtual_rig.h\"\n");
  tree.add("tools/run.cpp",
           "#include \"core/mapper/pipeline.h\"\n#include \"hw/hardware_rig.h\"\n#include \"sim/a.h\"\n");
  tree.add("tests/core/any_test.cpp", "#include \"core/registration/icp.h\"\n");
  EXPECT_THAT(tree.violations(), IsEmpty());
}

TEST(Architecture, WrongArrowsAreReported) {
  Tree tree;
  tree.add("core/decode/decode.h", "#pragma once\n#include \"core/types/pose.h\"\n#include \"core/depth/depth.h\"\n");
  tree.add("core/depth/depth.cpp", "#include \"core/io/yaml.h\"\n");
  tree.add("core/registration/icp.cpp", "#include \"sim/scene/scene.h\"\n");
  tree.add("core/mapper/pipeline.cpp", "#include \"core/score/score.h\"\n#include \"core/rig/rig.h\"\n");
  tree.add("core/io/files.cpp", "#include \"core/decode/decode.h\"\n");
  tree.add("core/score/score.cpp", "  #  include \"core/registration/icp.h\"  // with extra blanks\n");
  tree.add("core/types/pose.cpp", "#include \"core/patterns/patterns.h\"\n");
  tree.add("core/unknown/a.cpp", "#include \"core/types/pose.h\"\n");
  tree.add("hw/camera.cpp", "#include \"sim/scene/scene.h\"\n");
  tree.add("sim/virtual_rig.cpp", "#include \"core/score/score.h\"\n#include <core/mapper/pipeline.h>\n");
  tree.add("bench/main.cpp", "#include \"tools/settings.h\"\n");
  EXPECT_THAT(
      tree.violations(),
      ElementsAre("bench/main.cpp:1: tools/settings.h (bench may not include tools)",
                  "core/decode/decode.h:3: core/depth/depth.h (core/decode may not include core/depth)",
                  "core/depth/depth.cpp:1: core/io/yaml.h (core/depth may not include core/io)",
                  "core/io/files.cpp:1: core/decode/decode.h (core/io may not include core/decode)",
                  "core/mapper/pipeline.cpp:1: core/score/score.h (core/mapper may not include core/score)",
                  "core/mapper/pipeline.cpp:2: core/rig/rig.h (core/mapper may not include core/rig)",
                  "core/registration/icp.cpp:1: sim/scene/scene.h (core/registration may not include sim)",
                  "core/score/score.cpp:1: core/registration/icp.h (core/score may not include core/registration)",
                  "core/types/pose.cpp:1: core/patterns/patterns.h (core/types may not include core/patterns)",
                  "core/unknown/a.cpp:1: core/types/pose.h (core/unknown may not include core/types)",
                  "hw/camera.cpp:1: sim/scene/scene.h (hw may not include sim)",
                  "sim/virtual_rig.cpp:1: core/score/score.h (sim may not include core/score)",
                  "sim/virtual_rig.cpp:2: core/mapper/pipeline.h (sim may not include core/mapper)"));
}

TEST(Architecture, LibrariesInTheWrongPlaceAreReported) {
  Tree tree;
  tree.add("core/depth/depth.cpp", "#include <ceres/ceres.h>\n#include <openvdb/openvdb.h>\n");
  tree.add("core/map/mesh.h", "#include <Eigen/SVD>\n#include <openvdb/openvdb.h>\n");
  tree.add("core/registration/reference/engines.h", "#include <pcl/point_cloud.h>\n");
  tree.add("core/motion/refine.h", "#include <ceres/ceres.h>\n");
  tree.add("core/io/files.h", "#include <OpenImageIO/imageio.h>\n#include <yaml-cpp/yaml.h>\n");
  tree.add("core/types/pinhole.cpp", "#include <opencv2/imgproc.hpp>\n");
  tree.add("sim/scene/import.h", "#include <assimp/scene.h>\n#include <embree3/rtcore.h>\n");
  tree.add("sim/view.cpp", "#include <SDL2/SDL.h>\n#include <arv.h>\n#include <httplib.h>\n");
  tree.add("tools/mesh.cpp", "#include <assimp/scene.h>\n#include <embree3/rtcore.h>\n");
  tree.add("tools/picture.h", "#include <opencv2/imgproc.hpp>\n");
  EXPECT_THAT(
      tree.violations(),
      ElementsAre("core/depth/depth.cpp:1: ceres/ceres.h (library not allowed in this folder)",
                  "core/depth/depth.cpp:2: openvdb/openvdb.h (library not allowed in this folder)",
                  "core/io/files.h:1: OpenImageIO/imageio.h (heavy library in a header)",
                  "core/io/files.h:2: yaml-cpp/yaml.h (heavy library in a header)",
                  "core/map/mesh.h:1: Eigen/SVD (headers may use only Eigen/Core and opencv2/core)",
                  "core/map/mesh.h:2: openvdb/openvdb.h (heavy library in a header)",
                  "core/motion/refine.h:1: ceres/ceres.h (heavy library in a header)",
                  "core/registration/reference/engines.h:1: pcl/point_cloud.h (heavy library in a header)",
                  "core/types/pinhole.cpp:1: opencv2/imgproc.hpp (core/types may use only Eigen and opencv2/core)",
                  "sim/scene/import.h:1: assimp/scene.h (heavy library in a header)",
                  "sim/scene/import.h:2: embree3/rtcore.h (heavy library in a header)",
                  "sim/view.cpp:1: SDL2/SDL.h (library not allowed in this folder)",
                  "sim/view.cpp:2: arv.h (library not allowed in this folder)",
                  "sim/view.cpp:3: httplib.h (library not allowed in this folder)",
                  "tools/mesh.cpp:1: assimp/scene.h (library not allowed in this folder)",
                  "tools/mesh.cpp:2: embree3/rtcore.h (library not allowed in this folder)",
                  "tools/picture.h:1: opencv2/imgproc.hpp (headers may use only Eigen/Core and opencv2/core)"));
}

TEST(Architecture, RelativeNamesAreReported) {
  Tree tree;
  tree.add("core/depth/depth.cpp", "#include \"depth.h\"\n#include \"../decode/decode.h\"\n");
  EXPECT_THAT(tree.violations(),
              ElementsAre("core/depth/depth.cpp:1: depth.h (path not relative to the source root)",
                          "core/depth/depth.cpp:2: ../decode/decode.h (path not relative to the source root)"));
}

}  // namespace
}  // namespace fringeslam
