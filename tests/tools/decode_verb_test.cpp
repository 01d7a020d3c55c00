// SPDX-License-Identifier: Apache-2.0
// fringeslam decode: the same coordinates in every format, and phases where no method yields coordinates.
#include <OpenImageIO/imageio.h>
#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <nlohmann/json.hpp>

#include "core/decode/decode.h"
#include "core/io/files.h"
#include "core/rig/dataset.h"
#include "core/rig/rig_file.h"
#include "tests/tools/child.h"

namespace fringeslam {
namespace {

using nlohmann::json;
using testing::HasSubstr;

cv::Mat1f read_npy(const test::fs::path& file) {
  const std::string bytes = test::read_bytes(file);
  EXPECT_EQ(bytes.substr(0, 8), std::string("\x93NUMPY\x01\x00", 8));
  const size_t header = static_cast<uint8_t>(bytes[8]) + 256U * static_cast<uint8_t>(bytes[9]);
  EXPECT_EQ((10 + header) % 64, 0U);
  const std::string text = bytes.substr(10, header);
  EXPECT_THAT(text, HasSubstr("'descr': '<f4'"));
  int rows = 0, cols = 0;
  const size_t shape = text.find("'shape': (");
  std::sscanf(text.c_str() + shape, "'shape': (%d, %d)", &rows, &cols);
  cv::Mat1f values(rows, cols);
  EXPECT_EQ(bytes.size(), 10 + header + values.total() * sizeof(float));
  std::memcpy(values.data, bytes.data() + 10 + header, values.total() * sizeof(float));
  return values;
}

cv::Mat1w read_png_16(const test::fs::path& file) {
  const auto in = OIIO::ImageInput::open(file.string());
  EXPECT_TRUE(in);
  cv::Mat1w image(in->spec().height, in->spec().width);
  EXPECT_TRUE(in->read_image(0, 0, 0, 1, OIIO::TypeDesc::UINT16, image.data));
  return image;
}

class DecodeVerb : public testing::Test {
 protected:
  void render(const std::string& patterns) const {
    const test::fs::path scene = test::fs::path(FRINGESLAM_SOURCE_DIR) / "scenes/step_gauge/scene.yaml";
    test::run_successfully(
        {"render", scene.string(), "--out", at("data"), "--quiet", "--with", "patterns=" + patterns});
  }
  std::string at(const std::string& name) const { return (temp_ / name).string(); }
  test::TempFolder temp_;
};

TEST_F(DecodeVerb, AllFormatsHoldTheDecodedCoordinates) {
  render("{axis: both, steps: 3, periods_px: [1040, 131, 16.5]}");
  test::run_successfully({"decode", at("data"), "--out", at("out"), "--quiet"});
  ReplayRig replay(temp_ / "data");
  const auto stack = replay.capture(replay.sequence());
  const json described = json::parse(test::read_bytes(temp_ / "out/decoded.json"));
  int both = 0;
  cv::Mat1b valid;
  for (const Axis axis : {Axis::columns, Axis::rows}) {
    DecodeContext context;
    context.axis = axis;
    const DecodedStack decoded = decode(*stack, replay.model(), {}, context);
    const std::string name = axis == Axis::columns ? "column" : "row";
    const cv::Mat1f values = read_npy(temp_ / ("out/000000/" + name + ".npy"));
    const cv::Mat1w png = read_png_16(temp_ / ("out/000000/" + name + ".png"));
    const json range = described["stacks"][0]["images"][name];
    const double low = range["png_low"], high = range["png_high"];
    ASSERT_EQ(values.size(), decoded.coordinate_px.size());
    if (valid.empty()) valid = cv::Mat1b::ones(values.size());
    for (int row = 0; row < values.rows; ++row) {
      for (int col = 0; col < values.cols; ++col) {
        const float expected = decoded.coordinate_px(row, col);
        if (expected != expected) {
          EXPECT_TRUE(std::isnan(values(row, col)));
          EXPECT_EQ(png(row, col), 0);
          valid(row, col) = 0;
        } else {
          EXPECT_EQ(values(row, col), expected);
          EXPECT_NEAR(low + (png(row, col) - 1) * (high - low) / 65534, static_cast<double>(expected), 0.01);
        }
      }
    }
    EXPECT_TRUE(test::fs::exists(temp_ / ("out/000000/" + name + "_wrapped_phase.exr")));
  }
  for (const uchar v : valid) both += v;
  const std::string csv = test::read_bytes(temp_ / "out/000000/correspondences.csv");
  EXPECT_GT(both, 1000);
  EXPECT_EQ(std::count(csv.begin(), csv.end(), '\n'), both + 1);
  EXPECT_THAT(csv, testing::StartsWith("camera_x_px,camera_y_px,projector_x_px,projector_x_sigma_px,projector_y_px,"
                                       "projector_y_sigma_px\n"));
}

TEST_F(DecodeVerb, OnePeriodOfAnUncalibratedRigHasRelativePhases) {
  render("{steps: 4, periods_px: [32]}");
  RigModel rig = read_rig(temp_ / "data/rig.yaml");
  rig.calibrated = false;
  write_text(temp_ / "data/rig.yaml", to_yaml(rig));
  const auto result = test::run_program({"decode", at("data"), "--out", at("out"), "--format", "npy", "--json"});
  ASSERT_EQ(result.exit_code, 0) << result.err;
  const json stack = json::parse(result.out)["stacks"][0];
  EXPECT_EQ(stack["columns"]["unwrapping"], "spatial");
  EXPECT_EQ(stack["columns"]["valid_pixels"], 0);
  const cv::Mat1f phase = read_npy(temp_ / "out/000000/relative_phase.npy");
  EXPECT_GT(std::count_if(phase.begin(), phase.end(), [](float v) { return v == v; }), 1000);
  EXPECT_FALSE(test::fs::exists(temp_ / "out/000000/column.exr"));
  EXPECT_EQ(test::run_program({"decode", at("data"), "--out", at("bad"), "--format", "tiff"}).exit_code, 2);
}

}  // namespace
}  // namespace fringeslam
