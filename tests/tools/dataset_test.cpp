// SPDX-License-Identifier: Apache-2.0
// A recording replays the same images and timestamps; the error for a damaged one names the file.
#include "core/rig/dataset.h"

#include <gmock/gmock.h>

#include <limits>
#include <opencv2/core.hpp>

#include "core/io/files.h"
#include "core/types/centikelvin.h"
#include "tests/support/temp_folder.h"
#include "tests/tools/fake_rig.h"

namespace fringeslam {
namespace {

using test::message_of;
using testing::HasSubstr;
using testing::StartsWith;

class Recording : public testing::TestWithParam<int> {  // parameter: pixel type
 protected:
  void SetUp() override { test::record(folder_, stacks_); }
  test::fs::path image(int stack, int number) const {
    return folder_ / "stacks" / stack_name(stack) /
           ("0" + std::to_string(number) + (GetParam() == CV_32FC1 ? ".exr" : ".png"));
  }
  std::string capture_error() const {
    ReplayRig rig(folder_);
    return message_of([&] {
      while (rig.capture(test::short_sequence())) continue;
    });
  }

  test::TempFolder temp_;
  test::fs::path folder_ = temp_ / "recording";
  std::vector<FringeStack> stacks_ = test::noise_stacks(GetParam());
};

TEST_P(Recording, ReplaysTheSameImagesAndTimes) {
  ReplayRig rig(folder_);
  EXPECT_TRUE(rig.sequence() == test::short_sequence());
  EXPECT_EQ(rig.info().stacks, 2);
  EXPECT_EQ(to_yaml(rig.model()), to_yaml(test::rig_of(stacks_)));
  for (const FringeStack& recorded : stacks_) {
    const auto replayed = rig.capture(rig.sequence());
    ASSERT_TRUE(replayed);
    EXPECT_EQ(replayed->index, recorded.index);
    EXPECT_EQ(replayed->timestamp_s, recorded.timestamp_s);
    EXPECT_EQ(replayed->exposure_s, recorded.exposure_s);
    EXPECT_EQ(replayed->exposure_time_s, recorded.exposure_time_s);
    EXPECT_TRUE(replayed->patterns == recorded.patterns);
    ASSERT_EQ(replayed->images.size(), recorded.images.size());
    for (size_t i = 0; i < recorded.images.size(); ++i) {
      ASSERT_EQ(replayed->images[i].type(), GetParam());
      EXPECT_EQ(cv::countNonZero(replayed->images[i] != recorded.images[i]), 0);
    }
  }
  EXPECT_FALSE(rig.capture(rig.sequence()));
}

TEST_P(Recording, MissingImageIsNamedAtOnce) {
  test::fs::remove(image(1, 3));
  // The missing image may be a PNG or an EXR file, so only its number is compared.
  const std::string stem = (image(1, 3).parent_path() / "03").string();
  EXPECT_THAT(message_of([&] { ReplayRig rig(folder_); }), StartsWith(stem));
}

TEST_P(Recording, TruncatedImageIsNamed) {
  const std::string whole = test::read_bytes(image(1, 3));
  for (const double share : {0.0, 0.1, 0.5, 0.9}) {
    test::write_bytes(image(1, 3), whole);
    test::truncate_file(image(1, 3), share);
    EXPECT_THAT(capture_error(), StartsWith(image(1, 3).string() + ": ")) << share << " of the file remains";
  }
}

TEST_P(Recording, DamagedImageIsNamed) {
  test::write_bytes(image(0, 2), "this is no image");
  EXPECT_THAT(capture_error(), StartsWith(image(0, 2).string() + ": "));
}

TEST_P(Recording, FolderInPlaceOfAnImageIsNamed) {
  test::fs::remove(image(0, 2));
  test::fs::create_directory(image(0, 2));
  EXPECT_THAT(capture_error(), StartsWith(image(0, 2).string() + ": "));
}

TEST_P(Recording, ImageOfAnotherSizeIsNamed) {
  const cv::Mat small(49, 53, GetParam(), cv::Scalar(7));
  if (GetParam() == CV_32FC1)
    write_exr(image(1, 4), {{"Y", small}});
  else
    write_png(image(1, 4), small);
  const std::string message = capture_error();
  EXPECT_THAT(message, StartsWith(image(1, 4).string() + ": "));
  EXPECT_THAT(message, HasSubstr("53x49"));
}

INSTANTIATE_TEST_SUITE_P(Dataset, Recording, testing::Values(CV_8UC1, CV_16UC1, CV_32FC1), [](const auto& test) {
  return test.param == CV_8UC1 ? "EightBits" : test.param == CV_16UC1 ? "SixteenBits" : "Float";
});

class EightBitRecording : public testing::Test {
 protected:
  void SetUp() override { test::record(folder_, test::noise_stacks(CV_8UC1)); }
  // Returns the error after replacing text in one of the dataset's files.
  std::string error_after(const std::string& name, const std::string& from, const std::string& to) const {
    test::write_bytes(folder_ / name, test::replaced(test::read_bytes(folder_ / name), from, to));
    return message_of([&] {
      ReplayRig rig(folder_);
      while (rig.capture(test::short_sequence())) continue;
    });
  }

  test::TempFolder temp_;
  test::fs::path folder_ = temp_ / "recording";
};

TEST_F(EightBitRecording, OtherPixelTypeWithinAStackIsNamed) {
  const test::fs::path file = folder_ / "stacks/000000/02.png";
  write_png(file, cv::Mat(50, 53, CV_16UC1, cv::Scalar(7)));
  EXPECT_THAT(error_after("dataset.yaml", "seed: 1", "seed: 1"),
              StartsWith(file.string() + ": has a different pixel type"));
}

TEST_F(EightBitRecording, ColourImageIsNamed) {
  const test::fs::path file = folder_ / "stacks/000000/02.png";
  write_png(file, cv::Mat(50, 53, CV_8UC3, cv::Scalar(7, 8, 9)));
  EXPECT_THAT(error_after("dataset.yaml", "seed: 1", "seed: 1"), StartsWith(file.string() + ": has 3 channels"));
}

TEST_F(EightBitRecording, BrokenDatasetFileSaysFileAndLine) {
  const std::string file = (folder_ / "dataset.yaml").string();
  const std::string whole = test::read_bytes(file);
  const auto error = [&](const std::string& from, const std::string& to) {
    test::write_bytes(file, whole);
    return error_after("dataset.yaml", from, to);
  };
  EXPECT_THAT(error("fringeslam-dataset-1", "fringeslam-dataset-9"), StartsWith(file + ":1: "));
  EXPECT_THAT(error("seed: 1", "seed: -1"), StartsWith(file + ":3: "));
  EXPECT_THAT(error("stacks: 2", "stacks: 0"), StartsWith(file + ":4: "));
  EXPECT_THAT(error("stacks: 2", "stacks: 2.5"), StartsWith(file + ":4: "));
  EXPECT_THAT(error("truth: false", "truth: perhaps"), StartsWith(file + ":5: "));
  EXPECT_THAT(error("stacks: 2", "stacks: 3"), HasSubstr("000002"));
}

TEST_F(EightBitRecording, BrokenStackFileSaysFileAndLine) {
  const std::string file = (folder_ / "stacks/000001/stack.yaml").string();
  const std::string whole = test::read_bytes(file);
  EXPECT_THAT(error_after("stacks/000001/stack.yaml", "timestamp_s: ", "timestamp_s: .nan #"),
              StartsWith(file + ":1: "));
  test::write_bytes(file, whole);
  EXPECT_THAT(error_after("stacks/000001/stack.yaml", "exposure_s: [", "exposure_s: [0.1, "),
              StartsWith(file + ":2: "));
  test::write_bytes(file, whole);
  EXPECT_THAT(error_after("stacks/000001/stack.yaml", "exposure_time_s: [", "exposure_time_s: [0.1, "),
              StartsWith(file + ":3: "));
  test::fs::remove(file);
  EXPECT_THAT(error_after("dataset.yaml", "seed: 1", "seed: 1"), StartsWith(file + ": "));
}

TEST_F(EightBitRecording, ImpossibleImageTimesAreNamed) {
  const std::string file = (folder_ / "stacks/000001/stack.yaml").string();
  const std::string whole = test::read_bytes(file), without = whole.substr(0, whole.find("exposure_time_s"));
  const auto error = [&](const std::string& times_s) {
    test::write_bytes(file, without + "exposure_time_s: [" + times_s + "]\n");
    return error_after("dataset.yaml", "seed: 1", "seed: 1");
  };
  EXPECT_THAT(error("0, 0, 0, 0, 0, 0"), HasSubstr("exposure_time_s has the same time twice"));
  EXPECT_THAT(error("100, 101, 102, 103, 104, 105"),
              HasSubstr("exposure_time_s is from 100 to 105 s, but timestamp_s is "));
}

TEST_F(EightBitRecording, APartOfTheSequenceHasItsOwnTimes) {
  PatternSequence part = test::short_sequence();
  part.patterns.erase(part.patterns.begin(), part.patterns.begin() + 4);
  const FringeStack recorded = test::noise_stacks(CV_8UC1)[0];
  const auto replayed = ReplayRig(folder_).capture(part);
  ASSERT_TRUE(replayed);
  EXPECT_TRUE(replayed->patterns == part);
  EXPECT_EQ(replayed->timestamp_s, recorded.timestamp_s);
  EXPECT_THAT(replayed->exposure_time_s,
              testing::ElementsAre(recorded.exposure_time_s[4], recorded.exposure_time_s[5]));
}

TEST_F(EightBitRecording, WithoutExposureTimesUsesTheCameraRate) {
  const test::fs::path file = folder_ / "stacks/000000/stack.yaml";
  const std::string whole = test::read_bytes(file);
  test::write_bytes(file, whole.substr(0, whole.find("exposure_time_s")));
  const auto replayed = ReplayRig(folder_).capture(test::short_sequence());
  ASSERT_TRUE(replayed);
  EXPECT_EQ(replayed->exposure_time_s, exposure_times_s(replayed->timestamp_s, 6, test::tiny_rig().timing));
}

TEST_F(EightBitRecording, AnotherSequenceIsRefused) {
  ReplayRig rig(folder_);
  PatternSequence other = test::short_sequence();
  other.patterns[0].shift_rad += 1e-12;
  EXPECT_THAT(message_of([&] { rig.capture(other); }), StartsWith((folder_ / "patterns.yaml").string() + ": "));
}

// A recording with thermal images. Parameter: true if all temperatures are multiples of 0.01 K.
class ThermalRecording : public testing::TestWithParam<bool> {
 protected:
  void SetUp() override {
    RigModel rig = test::tiny_rig();
    rig.thermal.emplace().lens = {16, 12, 20, 20, 7.5, 5.5, {}};
    cv::RNG random(5);
    for (FringeStack& stack : stacks_) {
      stack.thermal_c.create(12, 16);
      for (float& t : stack.thermal_c) {
        t = random.uniform(-40.0f, 330.0f);
        if (hundredths()) t = celsius(centikelvin(static_cast<double>(t)));
      }
    }
    test::fs::create_directories(folder_);
    test::FakeRig fake(rig, stacks_);
    RecordingRig recording(fake, folder_);
    while (recording.capture(test::short_sequence())) continue;
    recording.finish("warm", 1, false);
  }
  bool hundredths() const { return GetParam(); }
  test::fs::path image(int stack) const {
    return folder_ / "stacks" / stack_name(stack) / (hundredths() ? "thermal.png" : "thermal.exr");
  }
  std::string replay_error() const {
    return message_of([&] {
      ReplayRig rig(folder_);
      while (rig.capture(test::short_sequence())) continue;
    });
  }

  test::TempFolder temp_;
  test::fs::path folder_ = temp_ / "recording";
  std::vector<FringeStack> stacks_ = test::noise_stacks(CV_8UC1);
};

TEST_P(ThermalRecording, ReplaysTheSameTemperatures) {
  ReplayRig rig(folder_);
  for (const FringeStack& recorded : stacks_) {
    const auto replayed = rig.capture(rig.sequence());
    ASSERT_TRUE(replayed);
    ASSERT_EQ(replayed->thermal_c.size(), recorded.thermal_c.size());
    EXPECT_EQ(cv::countNonZero(replayed->thermal_c != recorded.thermal_c), 0);
  }
}

TEST_P(ThermalRecording, ErrorsNameTheirCause) {
  const std::string whole = test::read_bytes(image(1));
  test::write_bytes(image(1), whole.substr(0, whole.size() / 2));
  EXPECT_THAT(replay_error(), StartsWith(image(1).string() + ": "));
  test::fs::remove(image(1));
  EXPECT_THAT(replay_error(), HasSubstr("thermal.png: is missing, although dataset.yaml declares thermal images"));
  write_png(folder_ / "stacks/000001/thermal.png", cv::Mat(13, 16, CV_16UC1, cv::Scalar(30000)));
  EXPECT_THAT(replay_error(), HasSubstr("is 16x13 but the thermal camera of rig.yaml has 16x12"));
  write_png(folder_ / "stacks/000001/thermal.png", cv::Mat(12, 16, CV_8UC1, cv::Scalar(30)));
  EXPECT_THAT(replay_error(), HasSubstr("is not a 16-bit image in hundredths of a kelvin"));
  test::write_bytes(folder_ / "rig.yaml", to_yaml(test::tiny_rig()));
  EXPECT_THAT(replay_error(), HasSubstr("rig.yaml: has no 'thermal' section"));
}

INSTANTIATE_TEST_SUITE_P(Dataset, ThermalRecording, testing::Bool(),
                         [](const auto& test) { return test.param ? "SixteenBits" : "Float"; });

TEST(Dataset, HasAThermalImageOfEveryStackOrOfNone) {
  const test::TempFolder temp;
  std::vector<FringeStack> stacks = test::noise_stacks(CV_8UC1);
  stacks[0].thermal_c = cv::Mat1f(12, 16, 20.0f);
  test::FakeRig fake(test::tiny_rig(), stacks);
  RecordingRig recording(fake, temp.path());
  recording.capture(test::short_sequence());
  EXPECT_THAT(message_of([&] { recording.capture(test::short_sequence()); }), HasSubstr("for every stack or for none"));
}

TEST(Dataset, HoldsOneSequence) {
  const test::TempFolder temp;
  test::FakeRig fake(test::tiny_rig(), test::noise_stacks(CV_8UC1));
  RecordingRig recording(fake, temp.path());
  recording.capture(test::short_sequence());
  PatternSequence other = test::short_sequence();
  other.patterns[0].period_px += 1;
  EXPECT_THAT(message_of([&] { recording.capture(other); }), HasSubstr("one pattern sequence"));
}

TEST(Dataset, IsNotRecordedIntoItself) {
  const test::TempFolder temp;
  test::record(temp / "dataset", test::noise_stacks(CV_8UC1), "noise", 1);
  const std::string whole = test::read_bytes(temp / "dataset/rig.yaml");
  ReplayRig replay(temp / "dataset");
  test::fs::create_directory(temp / "copy");
  RecordingRig copy(replay, temp / "copy");
  // The second one reads the dataset too, through the first.
  for (Rig* rig : {static_cast<Rig*>(&replay), static_cast<Rig*>(&copy)}) {
    EXPECT_THAT(message_of([&] { RecordingRig again(*rig, temp / "copy/../dataset"); }),
                HasSubstr("dataset: is the input of the rig to be recorded; choose another folder"));
  }
  EXPECT_EQ(test::read_bytes(temp / "dataset/rig.yaml"), whole);
}

TEST(Dataset, IsNoDatasetBeforeItIsFinished) {
  const test::TempFolder temp;
  test::FakeRig fake(test::tiny_rig(), test::noise_stacks(CV_8UC1));
  RecordingRig recording(fake, temp.path());
  while (recording.capture(test::short_sequence())) continue;
  EXPECT_THAT(message_of([&] { ReplayRig rig(temp.path()); }), StartsWith((temp / kDatasetFile).string() + ": "));
}

TEST(Dataset, AnySeedReadsBack) {
  for (const uint64_t seed : {uint64_t{0}, uint64_t{1} << 63, std::numeric_limits<uint64_t>::max()}) {
    const test::TempFolder temp;
    test::record(temp.path(), test::noise_stacks(CV_8UC1), "noise", seed);
    try {
      EXPECT_EQ(read_dataset_info(temp.path()).seed, seed);
    } catch (const Error& error) {
      ADD_FAILURE() << "seed " << seed << ": " << error.what();
    }
  }
}

TEST(Dataset, AnyNameReadsBack) {
  for (const std::string name : {"boxes: and foam", "run #3", "\"quoted\"", "~"}) {
    const test::TempFolder temp;
    test::record(temp.path(), test::noise_stacks(CV_8UC1), name);
    try {
      EXPECT_EQ(read_dataset_info(temp.path()).name, name);
    } catch (const Error& error) {
      ADD_FAILURE() << "name " << name << ": " << error.what();
    }
  }
}

}  // namespace
}  // namespace fringeslam
