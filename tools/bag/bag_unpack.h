// SPDX-License-Identifier: Apache-2.0
// Fringe images of a ROS bag that another program recorded, as the folder that core/import reads.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "core/import/import_file.h"

namespace fringeslam::tools {

// Writes the images of a bag to folder/000000/00.png, 01.png … (.exr for floating point, .jpg for JPEG), one folder for
// each stack, and their times to image_times.txt there. Returns warnings. Throws Error naming the file if the images
// cannot be read, do not fill whole stacks, or are not in order of time.
std::vector<std::string> unpack_bag(const std::filesystem::path& file, const BagSelection& selection,
                                    const std::filesystem::path& folder);

}  // namespace fringeslam::tools
