// SPDX-License-Identifier: Apache-2.0
// fringeslam report, and report.html written at the end of a run. tests/report tests the page in a browser.
#include <gmock/gmock.h>

#include <nlohmann/json.hpp>

#include "tests/tools/child.h"

namespace fringeslam {
namespace {

using nlohmann::json;
using test::read_bytes;
using test::run_program;
using test::run_successfully;
using testing::HasSubstr;
using testing::Not;

json data_of(const std::string& page) {
  const std::string start = "<script type=\"application/json\" id=\"data\">";
  const size_t first = page.find(start) + start.size();
  return json::parse(page.substr(first, page.find("</script>", first) - first));
}

class ReportVerb : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    temp_ = new test::TempFolder;
    test::write_small_scene(*temp_ / "scene");
    run_successfully({"run", at("scene"), "--out", at("run"), "--quiet", "--set", "render.samples_per_pixel=1"});
  }
  static void TearDownTestSuite() { delete temp_; }
  static std::string at(const std::string& name) { return (*temp_ / name).string(); }
  // Returns a copy of the run folder that a test may damage.
  static std::string copy(const std::string& name) {
    test::fs::copy(at("run"), at(name), test::fs::copy_options::recursive);
    return at(name);
  }
  static std::string refused(const std::string& run, const std::string& page = at("none.html")) {
    const test::Finished finished = run_program({"report", run, "--out", page});
    EXPECT_EQ(finished.exit_code, 2);
    EXPECT_FALSE(test::fs::exists(at("none.html")));
    EXPECT_EQ(std::count(finished.err.begin(), finished.err.end(), '\n'), 1) << finished.err;
    return finished.err;
  }

  static test::TempFolder* temp_;
};
test::TempFolder* ReportVerb::temp_ = nullptr;

TEST_F(ReportVerb, OutputHasTheNameOfAPage) {
  const std::string before = read_bytes(at("run/frames.json"));
  const std::set<std::string> files = test::listing(temp_->path());
  EXPECT_THAT(refused(at("run"), at("run/frames.json")), HasSubstr("the name must end in .html"));
  EXPECT_THAT(refused(at("run"), ""), HasSubstr(": is empty; give it a value or leave it out"));
  EXPECT_EQ(read_bytes(at("run/frames.json")), before);
  EXPECT_EQ(test::listing(temp_->path()), files);
}

TEST_F(ReportVerb, WritesWhatTheRunWrote) {
  run_successfully({"report", at("run"), "--out", at("again.html"), "--quiet"});
  const std::string page = read_bytes(at("again.html"));
  EXPECT_TRUE(page == read_bytes(at("run/report.html")));
  const json data = data_of(page);
  const json score = json::parse(read_bytes(at("run/score.json")));
  EXPECT_EQ(data["name"], "small");
  EXPECT_EQ(data["summary"]["ate_mm"], score["trajectory"]["ate_rmse_mm"]);
  EXPECT_EQ(data["motions"], score["pairs"]);
  ASSERT_EQ(data["views"].size(), 2u);
  for (const json& view : data["views"]) {
    for (const std::string picture : {"texture", "depth", "error"})
      EXPECT_THAT(view["pictures"][picture].get<std::string>(), testing::StartsWith("data:image/"));
  }
  EXPECT_GT(data["map"]["triangles"], 1000);
  EXPECT_FALSE(data["map"]["error"].is_null());
  EXPECT_LT(page.size(), 3'000'000u);
}

TEST_F(ReportVerb, IsLeftOutOnRequest) {
  run_successfully(
      {"run", at("scene"), "--out", at("bare"), "--quiet", "--no-report", "--set", "render.samples_per_pixel=1"});
  EXPECT_FALSE(test::fs::exists(at("bare/report.html")));
  EXPECT_TRUE(test::fs::exists(at("bare/overview.png")));
}

TEST_F(ReportVerb, NamesWhatIsWrongWithARun) {
  EXPECT_THAT(refused(at("scene")), HasSubstr("is not a run"));
  EXPECT_THAT(refused(at("nowhere")), HasSubstr("is not a run folder"));
  const std::string cut = copy("cut");
  test::truncate_file(cut + "/mesh.ply", 0.5);
  EXPECT_THAT(refused(cut), HasSubstr("cut/mesh.ply: the file is truncated"));
  const std::string foreign = copy("foreign");
  test::write_bytes(foreign + "/mesh.ply",
                    "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
                    "property float z\nend_header\n1 2 3\n");
  EXPECT_THAT(refused(foreign), HasSubstr("foreign/mesh.ply: is not a map written by fringeslam run"));
  const std::string torn = copy("torn");
  test::truncate_file(torn + "/frames.json", 0.5);
  EXPECT_THAT(refused(torn), HasSubstr("torn/frames.json"));
  const std::string fewer = copy("fewer");
  test::write_bytes(fewer + "/trajectory.tum", "0 0 0 0 0 0 0 1\n");
  EXPECT_THAT(refused(fewer), HasSubstr("holds 1 poses, but 2 views"));
  const std::string strange = copy("strange");
  test::write_bytes(strange + "/frames.json", "[{\"index\": \"one\"}]");
  EXPECT_THAT(refused(strange), HasSubstr("is not in a run's format"));
}

TEST_F(ReportVerb, EscapesNames) {
  const std::string run = copy("named");
  const std::string config = read_bytes(run + "/config.yaml");
  test::write_bytes(run + "/config.yaml",
                    test::replaced(config, "name: \"small\"", "name: \"</script><!--<script>\\\"&\\xff\""));
  run_successfully({"report", run, "--quiet"});
  const std::string page = read_bytes(run + "/report.html");
  EXPECT_THAT(page, HasSubstr("<title>&lt;/script&gt;&lt;!--&lt;script&gt;\"&amp;"));
  EXPECT_THAT(page, Not(HasSubstr("</script><!--")));
  EXPECT_THAT(data_of(page)["name"].get<std::string>(), testing::StartsWith("</script><!--<script>\"&"));
}

TEST_F(ReportVerb, DoesWithoutTruth) {
  const std::string run = copy("untold");
  for (const char* name : {"/truth", "/truth.tum", "/score.json"}) test::fs::remove_all(run + name);
  run_successfully({"report", run, "--quiet"});
  const json data = data_of(read_bytes(run + "/report.html"));
  EXPECT_EQ(data["has_truth"], false);
  EXPECT_TRUE(data["summary"]["ate_mm"].is_null());
  EXPECT_TRUE(data["map"]["error"].is_null());
  ASSERT_EQ(data["motions"].size(), 1u);
  EXPECT_EQ(data["motions"][0]["estimated"].size(), 6u);
}

}  // namespace
}  // namespace fringeslam
