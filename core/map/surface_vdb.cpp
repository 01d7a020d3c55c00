// SPDX-License-Identifier: Apache-2.0
#include "core/map/surface_vdb.h"

#include "core/base/module.h"
#include "core/map/openvdb_file.h"
#include "core/types/error.h"

namespace fringeslam {

namespace {

#ifdef FRINGESLAM_OPENVDB_MODULE
auto loaded_writer() {
  std::string why;
  void* function = load_from_module(FRINGESLAM_OPENVDB_MODULE, "fringeslam_openvdb_file", why);
  if (!function) throw Error("OpenVDB cannot be loaded: " + why + "; install FringeSLAM again");
  return reinterpret_cast<decltype(&fringeslam_openvdb_file)>(function);
}
#else
auto loaded_writer() { return &fringeslam_openvdb_file; }
#endif

}  // namespace

std::string to_vdb(const std::vector<Brick>& bricks, const VoxelScale& scale, double min_weight) {
  static const auto write = loaded_writer();
  std::string bytes;
  write(bricks, scale, min_weight, bytes);
  return bytes;
}

}  // namespace fringeslam
