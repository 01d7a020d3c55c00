// SPDX-License-Identifier: Apache-2.0
#include "core/map/brick_map.h"

#include <gmock/gmock.h>
#include <openvdb/openvdb.h>

#include <algorithm>
#include <iterator>
#include <random>
#include <set>

namespace fringeslam {
namespace {

std::unique_ptr<BrickVoxels> filled(int64_t value) {
  auto voxels = std::make_unique<BrickVoxels>();
  voxels->fill(value);
  return voxels;
}

TEST(BrickMap, FindsWhatWasAdded) {
  BrickMap map;
  const BrickIndex corners[] = {{0, 0, 0}, {-1, 0, 5}, {kMaxBrick, -kMaxBrick, kMaxBrick}, {511, 512, -513}};
  int64_t value = 0;
  for (const BrickIndex& brick : corners) map.add(brick_key(brick), filled(++value));
  value = 0;
  for (const BrickIndex& brick : corners) {
    const int64_t* voxels = map.find(brick_key(brick));
    ASSERT_NE(voxels, nullptr);
    EXPECT_EQ(voxels[kBrickVoxels - 1], ++value);
  }
  EXPECT_EQ(map.find(brick_key({1, 0, 0})), nullptr);
  for (const Brick& brick : map.bricks()) EXPECT_EQ(brick.voxels, map.find(brick_key(brick.index)));
}

// Outputs of earlier versions, which stored the bricks in such a tree, stay the same to the byte.
TEST(BrickMap, HasTheOrderOfAnOpenVdbTree) {
  std::mt19937 random(7);
  std::set<BrickIndex> drawn;
  constexpr int32_t kNear[] = {0, 16, -16, 512, -512, 1024, -700, kMaxBrick - 40, 40 - kMaxBrick};
  while (drawn.size() < 5000) {
    const auto draw = [&] { return kNear[random() % std::size(kNear)] + static_cast<int32_t>(random() % 40) - 20; };
    drawn.insert({draw(), draw(), draw()});
  }
  std::vector<BrickIndex> indices(drawn.begin(), drawn.end());
  std::shuffle(indices.begin(), indices.end(), random);
  BrickMap map;
  openvdb::Int64Tree tree(0);
  for (const BrickIndex& brick : indices) {
    map.add(brick_key(brick), filled(1));
    tree.touchLeaf({kBrickEdge * brick[0], kBrickEdge * brick[1], kBrickEdge * brick[2]});
  }
  std::vector<const openvdb::Int64Tree::LeafNodeType*> leaves;
  tree.getNodes(leaves);
  const std::vector<Brick> bricks = map.bricks();
  ASSERT_EQ(bricks.size(), leaves.size());
  for (size_t i = 0; i < bricks.size(); ++i) {
    const openvdb::Coord& corner = leaves[i]->origin();
    ASSERT_EQ(bricks[i].index, (BrickIndex{corner.x() >> 3, corner.y() >> 3, corner.z() >> 3})) << i;
  }
}

}  // namespace
}  // namespace fringeslam
