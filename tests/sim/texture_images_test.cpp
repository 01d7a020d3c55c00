// SPDX-License-Identifier: Apache-2.0
// TextureImages: threads that live longer than a set of textures never see its pixels in the next set.
#include "sim/light/texture_images.h"

#include <gtest/gtest.h>

#include <barrier>
#include <memory>
#include <opencv2/core.hpp>
#include <thread>
#include <vector>

#include "core/io/files.h"
#include "tests/support/temp_folder.h"

namespace fringeslam::sim {
namespace {

TEST(TextureImages, ThreadsThatOutliveThemSeeTheNextOnes) {
  const test::TempFolder temp;
  constexpr int kSets = 60, kThreads = 4;
  for (int set = 0; set < kSets; ++set)
    write_png(temp / (std::to_string(set) + ".png"), cv::Mat(64, 64, CV_8UC1, cv::Scalar(4 * set)));
  std::unique_ptr<TextureImages> textures;
  size_t texture = 0;
  std::vector<std::vector<float>> seen(kSets, std::vector<float>(kThreads));
  std::barrier step(kThreads + 1);
  std::vector<std::thread> threads;
  for (int thread = 0; thread < kThreads; ++thread) {
    threads.emplace_back([&, thread] {
      for (int set = 0; set < kSets; ++set) {
        step.arrive_and_wait();
        seen[set][thread] = textures->luminance(texture, 0.5f, 0.5f, 0.01f);
        step.arrive_and_wait();
      }
    });
  }
  for (int set = 0; set < kSets; ++set) {
    textures = std::make_unique<TextureImages>();
    texture = textures->add((temp / (std::to_string(set) + ".png")).string());
    step.arrive_and_wait();
    step.arrive_and_wait();
    textures.reset();
  }
  for (std::thread& thread : threads) thread.join();
  for (int set = 0; set < kSets; ++set) {
    for (int thread = 0; thread < kThreads; ++thread)
      EXPECT_EQ(seen[set][thread], seen[set][0]) << "set " << set << ", thread " << thread;
    if (set > 0) {
      EXPECT_GT(seen[set][0], seen[set - 1][0]) << "set " << set;
    }
  }
}

}  // namespace
}  // namespace fringeslam::sim
