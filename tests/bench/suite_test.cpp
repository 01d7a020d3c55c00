// SPDX-License-Identifier: Apache-2.0
#include "bench/suite.h"

#include <gmock/gmock.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "bench/yardstick.h"
#include "core/types/error.h"
#include "tests/support/matchers.h"
#include "tests/support/temp_folder.h"

namespace fringeslam::bench {
namespace {

using support::error_of;
using testing::ElementsAre;
using testing::HasSubstr;

Row row(double low, double high, Limit direction = Limit::most) {
  Row row;
  row.id = "a.row";
  row.value = (low + high) / 2;
  row.interval_low = low, row.interval_high = high;
  row.direction = direction;
  return row;
}

TEST(Suite, WorseIsApartOnTheWrongSide) {
  EXPECT_TRUE(is_worse(row(3, 4), row(1, 2)));
  EXPECT_FALSE(is_worse(row(1.5, 4), row(1, 2))) << "they overlap";
  EXPECT_FALSE(is_worse(row(1, 2), row(3, 4))) << "it became better";
  EXPECT_TRUE(is_worse(row(1, 2, Limit::least), row(3, 4, Limit::least)));
  EXPECT_FALSE(is_worse(row(3, 4, Limit::least), row(1, 2, Limit::least)));
  EXPECT_FALSE(is_worse(row(3, 3), row(1, 1))) << "one value each gives no interval";
}

TEST(Suite, NamesIdsWithoutARow) {
  Row pose, part;
  pose.id = "pose.bound", part.id = "speed.megapixel.map";
  EXPECT_THAT(ids_without_row({"pose.bound", "pose.nees", "pose.boundary", "speed.megapixel"}, {pose, part}),
              ElementsAre("pose.nees", "pose.boundary"));
  EXPECT_THAT(ids_without_row({"captures.boards"}, {}), ElementsAre("captures.boards"));
}

TEST(Row, ExtremesOfNothingOrOfNanAreNan) {
  const double values[] = {2, -1, 3};
  EXPECT_EQ(least_of({values, values + 3}), -1);
  EXPECT_EQ(greatest_of({values, values + 3}), 3);
  for (const std::vector<double>& unknown :
       {std::vector<double>{}, std::vector<double>{NAN}, std::vector<double>{1, NAN}, std::vector<double>{NAN, 1}}) {
    EXPECT_TRUE(std::isnan(least_of(unknown)));
    EXPECT_TRUE(std::isnan(greatest_of(unknown)));
    EXPECT_FALSE(bound_row("a", least_of(unknown), 0, "", -1e9, Limit::least).pass);
    EXPECT_FALSE(bound_row("a", greatest_of(unknown), 0, "", 1e9, Limit::most).pass);
  }
}

TEST(Row, NoWrongResultsAmongNoneFail) {
  EXPECT_TRUE(wrong_row("a", 0, 5, "poses").pass);
  EXPECT_FALSE(wrong_row("a", 1, 5, "poses").pass);
  EXPECT_FALSE(wrong_row("a", 0, 0, "poses").pass);
}

TEST(Suite, MachinesOfDifferentSpeedAreComparedByTheYardstick) {
  const auto time = [](double low, double high, double yardstick) {
    Row result = row(low, high);
    result.unit = "ms";
    scale(result, yardstick);
    return result;
  };
  EXPECT_FALSE(is_worse(time(3, 4, 3), time(1, 2, 1))) << "the machine is three times as slow";
  EXPECT_TRUE(is_worse(time(3, 4, 1), time(1, 2, 1)));
  EXPECT_TRUE(is_worse(time(1, 2, 0.4), time(1, 2, 1)));
  const test::TempFolder temp;
  test::write_bytes(temp / "rows.json", nlohmann::ordered_json::array({to_json(time(3, 4, 3))}).dump());
  EXPECT_FALSE(is_worse(time(1, 2, 1), read_baseline(temp / "rows.json")[0]));
}

TEST(Suite, ABaselineIsWhatWasWritten) {
  const test::TempFolder temp;
  test::write_bytes(temp / "rows.json", nlohmann::ordered_json::array({to_json(row(1, 2))}).dump());
  const std::vector<Row> rows = read_baseline(temp / "rows.json");
  ASSERT_EQ(rows.size(), 1u);
  EXPECT_EQ(rows[0].id, "a.row");
  EXPECT_EQ(rows[0].interval_high, 2);
  test::write_bytes(temp / "nan.json", nlohmann::ordered_json::array({to_json(row(NAN, NAN))}).dump());
  EXPECT_TRUE(std::isnan(read_baseline(temp / "nan.json")[0].value));
  test::write_bytes(temp / "other.json", "{\"a\": 1}");
  EXPECT_THAT(error_of([&] { read_baseline(temp / "other.json"); }), HasSubstr("other.json:1: contains no rows"));
  EXPECT_THAT(error_of([&] { read_baseline(temp / "none.json"); }), HasSubstr("does not exist"));
}

TEST(Suite, IsReadByName) {
  const std::filesystem::path suites = FRINGESLAM_SOURCE_DIR "/bench/accuracy/suites";
  EXPECT_TRUE(read_suite(suites, "ci").quick);
  EXPECT_FALSE(read_suite(suites, "full").rows.empty());
  EXPECT_THAT(error_of([&] { read_suite(suites, "nightly"); }), HasSubstr("no suite 'nightly'; available: ci, full"));
  const test::TempFolder temp;
  test::write_bytes(temp / "odd.yaml", "quick: true\nrow: [a]\nrows: [b]\n");
  EXPECT_THAT(error_of([&] { read_suite(temp.path(), "odd"); }), HasSubstr("odd.yaml:2: unknown key 'row'"));
}

}  // namespace
}  // namespace fringeslam::bench
