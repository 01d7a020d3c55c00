// SPDX-License-Identifier: Apache-2.0
// fringeslam twin: the twin of a rendered dataset measures like the dataset.
#include <gmock/gmock.h>

#include <nlohmann/json.hpp>

#include "core/io/files.h"
#include "core/rig/rig_file.h"
#include "tests/tools/child.h"

namespace fringeslam {
namespace {

using nlohmann::json;
using testing::HasSubstr;

TEST(Twin, OfARenderedDatasetMeasuresLikeIt) {
  const test::TempFolder temp;
  const test::fs::path scene = test::fs::path(FRINGESLAM_SOURCE_DIR) / "scenes/sphere_pair/scene.yaml";
  const std::string data = (temp / "data").string(), out = (temp / "twin").string();
  test::run_successfully({"render", scene.string(), "--out", data, "--quiet"});
  const auto result = test::run_program({"twin", data, "--out", out, "--json"});
  ASSERT_EQ(result.exit_code, 0) << result.err;
  std::map<std::string, double> ratio;
  const json document = json::parse(result.out);
  for (const json& row : document.at("comparison"))
    ratio[row.at("quantity")] = row.at("simulated").get<double>() / row.at("real").get<double>();
  for (const char* quantity : {"mean grey value", "modulation", "phase noise", "depth scatter"})
    EXPECT_NEAR(ratio.at(quantity), 1, 0.1) << quantity;
  EXPECT_GT(ratio.at("valid share of the surface"), 0.9);
  // The scene can be opened like any other.
  test::run_successfully({"render", out + "/scene", "--out", (temp / "again").string(), "--quiet"});
  EXPECT_TRUE(test::fs::exists(temp / "twin/twin.html"));

  RigModel rig = read_rig(temp / "data/rig.yaml");
  rig.calibrated = false;
  write_text(temp / "data/rig.yaml", to_yaml(rig));
  const auto refused = test::run_program({"twin", data, "--out", (temp / "none").string()});
  EXPECT_EQ(refused.exit_code, 2);
  EXPECT_THAT(refused.err, HasSubstr("its rig is not calibrated"));
}

}  // namespace
}  // namespace fringeslam
