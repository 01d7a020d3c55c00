// SPDX-License-Identifier: Apache-2.0
#include "bench/datasets/describe.h"

#include <gmock/gmock.h>

#include <nlohmann/json.hpp>

#include "tests/datasets/dataset_files.h"

namespace fringeslam::datasets {
namespace {

using testing::HasSubstr;
using OrderedJson = nlohmann::ordered_json;

Contents small_contents() {
  Contents contents;
  contents.program_version = "1.2.3";
  contents.tars = {{"train-000000.tar", std::string(64, 'a'), 2048}, {"test-000000.tar", std::string(64, 'b'), 1024}};
  contents.index = {"index.csv", std::string(64, 'c'), 100};
  contents.samples = {8, 0, 4};
  contents.worlds = {2, 0, 1};
  contents.scenes = {"small"}, contents.rigs = {"thesis"};
  return contents;
}

TEST(Croissant, HasTheRequiredProperties) {
  const test::TempFolder temp;
  const std::string published = test::replaced(test::kSmallDataset, "seed: 5",
                                               "seed: 5\npublication: {license: 'https://example.org/l', url: "
                                               "'https://example.org', creator: Us, date: 2026-01-31}");
  const OrderedJson json = croissant(read_spec(test::write_dataset(temp.path(), published)), small_contents());
  for (const char* key : {"@context", "@type", "conformsTo", "description", "license", "name", "url", "creator",
                          "datePublished", "distribution", "recordSet"})
    EXPECT_TRUE(json.contains(key)) << key;
  EXPECT_EQ(json["conformsTo"], "http://mlcommons.org/croissant/1.0");
  // All identifiers are unique, and all references point to one.
  std::multiset<std::string> defined, referenced;
  const std::function<void(const OrderedJson&)> walk = [&](const OrderedJson& node) {
    if (node.is_object() && node.contains("@id"))
      (node.size() == 1 ? referenced : defined).insert(node["@id"].get<std::string>());
    for (const OrderedJson& child : node) {
      if (child.is_structured()) walk(child);
    }
  };
  walk(json["distribution"]);
  walk(json["recordSet"]);
  for (const std::string& id : defined) EXPECT_EQ(defined.count(id), 1u) << id;
  for (const std::string& id : referenced) EXPECT_EQ(defined.count(id), 1u) << id;
  EXPECT_EQ(defined.count("samples/light.ambient_lux"), 1u);
  // Every term without prefix that is not one of schema.org's is defined in the context.
  for (const char* term : {"recordSet", "field", "dataType", "source", "fileObject", "extract", "column", "includes",
                           "references", "data", "key"})
    EXPECT_TRUE(json["@context"].contains(term)) << term;
}

TEST(Datasheet, StatesSplitsPartsAndLaws) {
  const test::TempFolder temp;
  Contents contents = small_contents();
  contents.refused = 1;
  const std::string text = datasheet(read_spec(test::write_dataset(temp.path())), contents);
  for (const char* part : {"| train | 2 | 8 |", "| test | 1 | 4 |", "`light.ambient_lux` | log_uniform [10, 1000]",
                           "`objects.1.count` | 6", "License: not stated", "1 of 6 trials have no samples",
                           "`depth.exr`", "fringeslam 1.2.3"})
    EXPECT_THAT(text, HasSubstr(part));
  EXPECT_THAT(text, testing::Not(HasSubstr("phase.exr")));
  EXPECT_THAT(text, testing::Not(HasSubstr("| validation")));
}

}  // namespace
}  // namespace fringeslam::datasets
