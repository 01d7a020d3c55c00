// SPDX-License-Identifier: Apache-2.0
#include "core/map/openvdb_file.h"

#include <openvdb/io/Archive.h>
#include <openvdb/openvdb.h>

#include <cstdio>
#include <memory>
#include <sstream>
#include <string_view>

#include "core/base/fnv.h"

namespace fringeslam {

namespace {

using DistanceLeaf = openvdb::FloatTree::LeafNodeType;
static_assert(DistanceLeaf::DIM == kBrickEdge);

std::unique_ptr<DistanceLeaf> leaf_of(const Brick& brick, const VoxelScale& scale, float min_weight) {
  const auto metres_per_step = static_cast<float>(scale.truncation_m / static_cast<double>(kDistanceSteps));
  const openvdb::Coord corner(kBrickEdge * brick.index[0], kBrickEdge * brick.index[1], kBrickEdge * brick.index[2]);
  auto leaf = std::make_unique<DistanceLeaf>(corner, static_cast<float>(scale.truncation_m));
  for (openvdb::Index i = 0; i < DistanceLeaf::SIZE; ++i) {
    const auto voxel = static_cast<uint64_t>(brick.voxels[i]);
    const float weight = voxel_weight(voxel);
    if (weight > 0 && weight >= min_weight) leaf->setValueOn(i, voxel_distance(voxel) * metres_per_step);
  }
  return leaf;
}

// A file in memory. It has the table of grids that openvdb::io::Stream omits, and programs read a grid without it only
// by reading all.
class MemoryFile : public openvdb::io::Archive {
 public:
  std::string bytes_of(const openvdb::GridBase::ConstPtr& grid) const {
    std::ostringstream stream;
    constexpr bool kSeekable = true;
    write(stream, openvdb::GridCPtrVec{grid}, kSeekable);
    std::string bytes = std::move(stream).str();
    // OpenVDB identifies each file by a random number; a hash of the content makes equal files equal.
    const std::string random = getUniqueTag();
    const size_t at = bytes.find(random);
    bytes.replace(at, random.size(), identifier(fnv1a(std::string_view(bytes).substr(at + random.size()))));
    return bytes;
  }

 private:
  static std::string identifier(uint64_t hash) {
    char text[37];
    std::snprintf(text, sizeof text, "00000000-0000-0000-%04x-%012llx", static_cast<unsigned>(hash >> 48),
                  static_cast<unsigned long long>(hash & 0xffffffffffff));
    return text;
  }
};

std::string file_of(const std::vector<Brick>& bricks, const VoxelScale& scale, double min_weight) {
  openvdb::initialize();
  const auto grid = openvdb::FloatGrid::create(static_cast<float>(scale.truncation_m));
  grid->setName("surface");
  grid->setGridClass(openvdb::GRID_LEVEL_SET);
  grid->setCreator("FringeSLAM");
  grid->setTransform(openvdb::math::Transform::createLinearTransform(scale.voxel_m));
  for (const Brick& brick : bricks) {
    auto leaf = leaf_of(brick, scale, static_cast<float>(min_weight));
    if (!leaf->isEmpty()) grid->tree().addLeaf(leaf.release());
  }
  return MemoryFile().bytes_of(grid);
}

}  // namespace
}  // namespace fringeslam

void fringeslam_openvdb_file(const std::vector<fringeslam::Brick>& bricks, const fringeslam::VoxelScale& scale,
                             double min_weight, std::string& bytes) {
  bytes = fringeslam::file_of(bricks, scale, min_weight);
}
