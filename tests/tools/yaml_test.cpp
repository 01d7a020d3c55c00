// SPDX-License-Identifier: Apache-2.0
// Every error of the YAML reader reports its location and a remedy.
#include "core/io/yaml.h"

#include <gmock/gmock.h>

#include <array>
#include <ostream>
#include <vector>

#include "core/io/setting_groups.h"
#include "core/mapper/pipeline.h"
#include "core/score/trajectory_score.h"
#include "tests/support/temp_folder.h"

namespace fringeslam {
namespace {

using test::message_of;
using testing::AllOf;
using testing::HasSubstr;
using testing::Not;
using testing::StartsWith;

constexpr const char* kGood =
    "# a comment, so that the first key is not on line 1\n"
    "width_px: 640\n"
    "scale: 0.5\n"
    "name: thesis\n"
    "lens:\n"
    "  axis: columns\n"
    "  bits: 8\n"
    "  centre: [1, 2, 3]\n"
    "parts:\n"
    "  - {size: 1}\n"
    "  - {size: 2}\n";

// Reads a file with the keys above; `lens.bits` and `blur` are optional.
void read_all(const YamlMap& map) {
  map.integer("width_px", {1, 1000});
  map.number("scale", {0, 1});
  map.text("name");
  map.boolean_or("blur", false);
  const YamlMap lens = map.map("lens");
  lens.choice("axis", {"columns", "rows"});
  lens.integer_or("bits", 8, {0, 16});
  lens.numbers("centre", 3, {-10, 10});
  for (const YamlMap& part : map.maps("parts")) part.number("size", {0, 10});
  map.finish();
}

std::string error_of(const std::string& text) {
  return message_of([&] { read_all(YamlMap::parse(text, "some/rig.yaml")); });
}

struct Broken {
  std::string name, from, to;
  int line;
  std::string says;
};

// Prints the name in test output.
void PrintTo(const Broken& broken, std::ostream* out) { *out << broken.name; }

class BrokenYaml : public testing::TestWithParam<Broken> {};

TEST_P(BrokenYaml, SaysFileAndLine) {
  const Broken& broken = GetParam();
  const std::string message = error_of(test::replaced(kGood, broken.from, broken.to));
  EXPECT_THAT(message, StartsWith("some/rig.yaml:" + std::to_string(broken.line) + ": "));
  EXPECT_THAT(message, HasSubstr(broken.says));
}

INSTANTIATE_TEST_SUITE_P(
    Yaml, BrokenYaml,
    testing::Values(
        Broken{"MissingKey", "width_px: 640\n", "", 2, "'width_px' is missing"},
        Broken{"MissingKeyOfAMap", "  axis: columns\n", "", 6, "'axis' is missing"},
        Broken{"EmptyValue", "width_px: 640", "width_px:", 2, "'width_px' is missing"},
        Broken{"UnknownKey", "name: thesis", "name: thesis\nblurr: true", 5, "did you mean 'blur'"},
        Broken{"UnknownKeyOfAMap", "  bits: 8", "  bitz: 8", 7, "'bitz'; did you mean 'bits'"},
        Broken{"UnknownKeyOfAListEntry", "{size: 2}", "{size: 2, sise: 3}", 11, "'sise'; did you mean 'size'"},
        Broken{"DuplicateKey", "name: thesis", "scale: 0.7", 4, "'scale' is a duplicate key"},
        Broken{"DuplicateKeyOfAMap", "  bits: 8", "  axis: rows", 7, "'axis' is a duplicate key"},
        Broken{"NotANumber", "scale: 0.5", "scale: .nan", 3, "'scale' is nan"},
        Broken{"Infinite", "scale: 0.5", "scale: .inf", 3, "'scale' is inf"},
        Broken{"NanInAList", "[1, 2, 3]", "[1, .nan, 3]", 8, "'centre' is nan"},
        Broken{"Negative", "width_px: 640", "width_px: -640", 2, "'width_px' is -640; it must lie in [1, 1000]"},
        Broken{"TooLarge", "width_px: 640", "width_px: 1001", 2, "[1, 1000]"},
        Broken{"Fraction", "width_px: 640", "width_px: 640.5", 2, "whole number"},
        Broken{"TextForANumber", "scale: 0.5", "scale: half", 3, "'scale' must be a number"},
        Broken{"NumberWithAUnit", "scale: 0.5", "scale: 0.5 m", 3, "'scale' must be a number"},
        Broken{"ListForANumber", "scale: 0.5", "scale: [0.5]", 3, "'scale' must be a number"},
        Broken{"TextInAList", "[1, 2, 3]", "[1, two, 3]", 8, "'centre' must be a number"},
        Broken{"ListTooShort", "[1, 2, 3]", "[1, 2]", 8, "list of 3 numbers"},
        Broken{"NumberForAList", "[1, 2, 3]", "7", 8, "list of 3 numbers"},
        Broken{"NotTrueOrFalse", "name: thesis", "name: thesis\nblur: maybe", 5, "true or false"},
        Broken{"MapForAText", "name: thesis", "name: {a: 1}", 4, "'name' must be a string"},
        Broken{"NoSuchChoice", "axis: columns", "axis: colums", 6, "did you mean 'columns'"},
        Broken{"ListEntryIsNoMap", "{size: 2}", "2", 11, "must be a map"},
        Broken{"OpenBracket", "[1, 2, 3]", "[1, 2, 3", 9, "not valid YAML"},
        Broken{"BadIndent", "  bits: 8", " bits: 8", 7, "not valid YAML"},
        Broken{"Tab", "  bits: 8", "\tbits: 8", 7, "not valid YAML"}),
    [](const auto& test) { return test.param.name; });

TEST(Yaml, ReadsAGoodFile) { EXPECT_NO_THROW(read_all(YamlMap::parse(kGood, "rig.yaml"))); }

TEST(Yaml, AKeyLikeNoOtherGetsNoSuggestion) {
  const std::string message = error_of(std::string(kGood) + "zzyzxqqq: 1\n");
  EXPECT_THAT(message, StartsWith("some/rig.yaml:12: unknown key 'zzyzxqqq'"));
  EXPECT_THAT(message, Not(HasSubstr("did you mean")));
}

// A misspelt required key is an unknown key: the message names it and the nearest known key.
TEST(Yaml, AMisspeltRequiredKeyIsNamed) {
  const std::string message = error_of(test::replaced(kGood, "scale: 0.5", "scael: 0.5"));
  EXPECT_THAT(message, HasSubstr("'scale'"));
  EXPECT_THAT(message, HasSubstr("'scael'"));
}

TEST(Yaml, AMapForAListAndAListForAMapAreRefused) {
  const YamlMap map = YamlMap::parse("a: [1]\nb: {c: 1}\n", "f.yaml");
  EXPECT_THAT(message_of([&] { map.map("a"); }), StartsWith("f.yaml:1: 'a' must be a map"));
  EXPECT_THAT(message_of([&] { map.maps("b"); }), StartsWith("f.yaml:2: 'b' must be a list"));
}

TEST(Yaml, AFileThatIsNoMapIsRefused) {
  for (const std::string& text : {std::string(), std::string("# nothing\n"), std::string("just text"),
                                  std::string("- 1\n- 2\n"), std::string("42")})
    EXPECT_THAT(error_of(text), StartsWith("some/rig.yaml:1: must be a YAML map")) << text;
}

TEST(Yaml, BinaryDataIsRefused) {
  EXPECT_THAT(error_of(std::string("\x89PNG\r\n\x1a\n\0\0\0\rIHDR", 16)), StartsWith("some/rig.yaml:"));
  EXPECT_THAT(error_of(std::string("\0\1\2\3\4\5\6\7", 8)), StartsWith("some/rig.yaml:"));
}

// Refuses input that would exhaust stack, memory or time, or that would be ignored silently.
TEST(Yaml, ExcessiveValuesAreRefused) {
  const auto refused = [](const std::string& text, int line, const std::string& says) {
    EXPECT_THAT(message_of([&] { YamlMap::parse(text, "f.yaml"); }),
                AllOf(StartsWith("f.yaml:" + std::to_string(line) + ": "), HasSubstr(says)));
  };
  refused("a:\n  " + std::string(1000, '['), 2, "more than 64 nested maps and lists");
  refused("a:\n  " + std::string(15 << 20, '{'), 2, "more than 10000 brackets are open");
  std::string flat = "a:\n  {";
  for (int i = 0; i < 7 << 20; ++i) flat += "a,";
  refused(flat, 2, "more than 1000000 values between two brackets");
  std::string path = "a";
  for (int i = 0; i < 5000; ++i) path += ".a";
  YamlMap map = YamlMap::parse("b: 1\n", "f.yaml");
  EXPECT_EQ(message_of([&] { map.set(path, "1"); }),
            "f.yaml: the key path " + path.substr(0, 40) + "... has more than 64 parts");
  refused("a: 1\nb: &b [1, 2]\nc: 3\n", 2, "anchors and aliases (&name, *name) are not supported");
  refused("a: 1\n--- # the next\nb: 2\n", 2, "a second document");
  std::string list = "a: [";
  for (int i = 0; i < 1000000; ++i) list += "1,";
  refused(list + "]\n", 1, "more than 1000000 values");
  std::string keys;
  for (int i = 0; i <= 1000; ++i) keys += "key" + std::to_string(i) + ": 1\n";
  refused(keys, 1001, "the map has more than 1000 keys");
  EXPECT_THAT(message_of([&] { YamlMap::parse("a: " + std::string(17 << 20, 'x') + "\n", "f.yaml"); }),
              HasSubstr("f.yaml: is larger than 16 MiB"));
  EXPECT_THAT(message_of([&] { YamlMap::load("/dev/zero"); }), StartsWith("/dev/zero: is not a regular file"));
}

TEST(Yaml, LargeValuesAreRead) {
  EXPECT_NO_THROW(YamlMap::parse("a: " + std::string(62, '[') + std::string(62, ']') + "\n", "f.yaml"));
  std::string keys;
  for (int i = 0; i < 1000; ++i) keys += "key" + std::to_string(i) + ": 1\n";
  EXPECT_NO_THROW(YamlMap::parse(keys, "f.yaml"));
}

TEST(Yaml, AMessageIsOneLineForAnyQuotedText) {
  EXPECT_EQ(message_of([] { YamlMap::parse("\"a\\n\\e[2Jb\\0\": 1\n", "f.yaml").finish(); }),
            "f.yaml:1: unknown key 'a  [2Jb '");
}

TEST(Yaml, ASingleLineHasNoControlCharacters) {
  EXPECT_EQ(single_line("\u00e9\n\x1b]0;\x7f\xc2\x9b"
                        "1m\xc2\x80\u00a0\xc2"),
            "\u00e9  ]0;   1m  \u00a0\xc2");
}

TEST(Yaml, ReplacedScalarsLeaveTheRestUnchanged) {
  const auto replaced = [](const std::string& text) {
    return with_replaced_scalars(text, "a.yaml", [](const std::string& section, const std::string& value) {
      return value == "old" ? std::optional(section + "'\"\\\n$1\u00e9") : std::nullopt;
    });
  };
  const auto expect = [&](const std::string& before, const std::string& old, const std::string& section,
                          const std::string& after) {
    const std::string result = replaced(before + old + after);
    EXPECT_EQ(result, before + "\"" + section + "'\\\"\\\\\\n$1\u00e9\"" + after);
  };
  for (const std::string old : {"old", "'old'", "\"old\"", "\"\\x6Fld\"", "\"ol\\\n    d\""}) {
    expect("# old: old\n\u00e9: ''\nold: ", old, "old", " # old\n");
    expect("\xEF\xBB\xBF{a: {old: [it's, 'it''s', \"\\\"\", ", old, "a", "], c: older}}");
    expect("a:\r\n- text\r\n  of lines\r\n- b: ", old, "a", "\r\n");
  }
  EXPECT_EQ(replaced("a: ~\n"), "a: ~\n");
  EXPECT_EQ(message_of([&] { (void)replaced("a: 1\nb: |-\n  old\n"); }),
            "a.yaml:2: this value cannot be replaced; write it on one line, or in quotes");
  EXPECT_THAT(message_of([&] { (void)replaced("a: [old"); }), HasSubstr("a.yaml:"));
  EXPECT_THAT(message_of([&] { (void)replaced("\"\xff\": old\n"); }), HasSubstr("a.yaml:1: "));
}

TEST(Yaml, MissingFileAndFolderAreNamed) {
  const test::TempFolder temp;
  const std::string missing = (temp / "none.yaml").string();
  EXPECT_THAT(message_of([&] { YamlMap::load(missing); }), StartsWith(missing + ": cannot be opened"));
  const std::string folder = temp.path().string();
  EXPECT_THAT(message_of([&] { YamlMap::load(folder); }), StartsWith(folder + ": is a folder"));
}

TEST(Yaml, PosesAreChecked) {
  const auto pose_error = [](const std::string& lines) {
    return message_of([&] { YamlMap::parse("mount:\n" + lines, "f.yaml").pose("mount"); });
  };
  EXPECT_THAT(pose_error("  rotation_matrix: [1, 0, 0, 0, 1, 0, 0, 0, -1]\n"), StartsWith("f.yaml:2: "));
  EXPECT_THAT(pose_error("  rotation_matrix: [1, 0, 0, 0, 1, 0.01, 0, 0, 1]\n"), HasSubstr("right-handed rotation"));
  EXPECT_THAT(pose_error("  rotation_deg: [0, 0, 9]\n  rotation_matrix: [1, 0, 0, 0, 1, 0, 0, 0, 1]\n"),
              HasSubstr("not both"));
  EXPECT_THAT(pose_error("  translation_m: [0, .nan, 0]\n"), StartsWith("f.yaml:2: 'translation_m' is nan"));
}

enum class Speed { slow, quick };

constexpr auto choices(Speed) { return std::to_array<Choice<Speed>>({{Speed::slow, "slow"}, {Speed::quick, "quick"}}); }

struct Options {
  double size_m = 1 / 3.0;
  int count = 7;
  bool fast = true;
  Speed mode = Speed::slow;

  template <class Visitor>
  void describe(Visitor& v) {
    v.field("size_m", size_m, {0, 1}, "");
    v.field("count", count, {0, 100}, "");
    v.field("fast", fast, "");
    v.field("mode", mode, "how fast");
  }
};

TEST(Yaml, WrittenOptionsReadBackAsTheSame) {
  Options written{0.1 + 0.2, 12, false, Speed::quick}, read;
  YamlOptionsWriter writer(2);
  written.describe(writer);
  const YamlMap map = YamlMap::parse("options:\n" + writer.str(), "config.yaml");
  map.map("options").read(read);
  map.finish();
  EXPECT_EQ(read.size_m, written.size_m);
  EXPECT_EQ(read.count, 12);
  EXPECT_FALSE(read.fast);
  EXPECT_EQ(read.mode, Speed::quick);
  EXPECT_THAT(writer.str(), HasSubstr("\n  mode: quick\n"));
}

TEST(Yaml, EnumsAreReadByName) {
  const YamlMap map = YamlMap::parse("mode: quick\n", "f.yaml");
  EXPECT_EQ(map.choice<Speed>("mode"), Speed::quick);
  EXPECT_EQ(map.choice_or("mode", Speed::slow), Speed::quick);
  EXPECT_EQ(map.choice_or("other", Speed::quick), Speed::quick);
  const YamlMap wrong = YamlMap::parse("mode: quik\n", "f.yaml");
  Options options{.mode = Speed::quick};
  EXPECT_EQ(message_of([&] { wrong.read(options); }),
            "f.yaml:1: 'mode: quik' is not one of slow, quick; did you mean 'quick'?");
  EXPECT_EQ(message_of([&] { YamlMap::parse("mode: 1\n", "f.yaml").read(options); }),
            "f.yaml:1: 'mode: 1' is not one of slow, quick");
  EXPECT_EQ(options.mode, Speed::quick);
}

TEST(Yaml, AnUnknownEnumNameIsTheFirstWhileErrorsAreCollected) {
  YamlMap map = YamlMap::parse("mode: fast\n", "f.yaml");
  std::vector<std::string> errors;
  map.collect_errors(errors);
  EXPECT_EQ(map.choice<Speed>("mode"), Speed::slow);
  ASSERT_EQ(errors.size(), 1u);
  EXPECT_THAT(errors[0], StartsWith("f.yaml:1: 'mode: fast' is not one of slow, quick"));
}

TEST(Yaml, HelpListsTheNamesOfAnEnum) {
  Options options{.mode = Speed::quick};
  HelpWriter writer("stage");
  options.describe(writer);
  EXPECT_THAT(writer.str(), HasSubstr("  stage.mode                         quick    how fast (slow, quick)\n"));
}

// Names of the choices in settings files.
TEST(Yaml, StagesRefuseUnknownChoices) {
  PipelineOptions pipeline;
  TrajectoryOptions trajectory;
  const auto refusal = [](auto& options, const std::string& line) {
    return message_of([&] { YamlMap::parse(line, "f.yaml").read(options); });
  };
  EXPECT_THAT(
      refusal(pipeline.decode, "unwrapping: fast"),
      HasSubstr("auto, multifrequency, heterodyne, gray, micro, modulated, ensemble, geometric, predicted, spatial"));
  EXPECT_THAT(refusal(pipeline.decode, "unwrapping: none"), HasSubstr("is not one of"));
  EXPECT_THAT(refusal(pipeline.decode, "spatial_order: fast"), HasSubstr("quality, reliability"));
  EXPECT_THAT(refusal(pipeline.decode, "spatial_reference: spatial"),
              HasSubstr("auto, multifrequency, heterodyne, gray, micro, modulated, geometric, predicted, none"));
  EXPECT_THAT(refusal(pipeline.conditioning, "edges: sobel"), HasSubstr("canny_deriche, prewitt, roberts, log"));
  EXPECT_THAT(refusal(pipeline.conditioning, "background: sky"), HasSubstr("plane, depth, none"));
  EXPECT_THAT(refusal(pipeline.clusters, "method: all"), HasSubstr("depth_sampling, convex_hull, both"));
  EXPECT_THAT(refusal(pipeline.clusters, "starts: all"), HasSubstr("random, corners, both"));
  EXPECT_THAT(refusal(pipeline.landmarks, "outlines: all"), HasSubstr("clusters, regions"));
  EXPECT_THAT(refusal(pipeline.recognition, "search: all"), HasSubstr("best_bin_first, brute_force"));
  EXPECT_THAT(refusal(pipeline.tracking, "correspondences: all"), HasSubstr("landmarks, keypoints"));
  EXPECT_THAT(refusal(pipeline.tracking, "landmarks: all"), HasSubstr("keyframes, every_frame"));
  EXPECT_THAT(refusal(pipeline.tracking, "engine: gicp"),
              HasSubstr("point_to_plane, besl_mckay, zhang, pcl_icp, pcl_gicp"));
  EXPECT_THAT(refusal(trajectory, "align: umeyama"), HasSubstr("none, origin, se3, sim3"));
  EXPECT_THAT(refusal(trajectory, "relation: all"), HasSubstr("translation, rotation_deg, full"));
}

}  // namespace
}  // namespace fringeslam
