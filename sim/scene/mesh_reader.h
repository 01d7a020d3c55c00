// SPDX-License-Identifier: Apache-2.0
// Reading of mesh files by assimp in a child process.
#pragma once

#include <cstdint>
#include <filesystem>

#include "sim/scene/raw_model.h"

namespace fringeslam::sim {

constexpr uint64_t kMostMeshBytes = uint64_t{4} << 30;  // of a mesh file, and of each file that it refers to

// Reads a mesh file in a child process. Throws Error with assimp's message, or if the child crashes or exceeds its time
// or memory limit.
RawModel read_model(const std::filesystem::path& file, double time_limit_s, double memory_limit_gib);

}  // namespace fringeslam::sim
