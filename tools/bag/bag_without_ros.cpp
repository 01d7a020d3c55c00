// SPDX-License-Identifier: Apache-2.0
// Stands in for bag_ros.cpp where librosbag-storage is not installed.
#include "core/types/error.h"
#include "tools/bag/bag.h"

namespace fringeslam::tools {

bool has_bags() { return false; }

void require_bags(const std::string& what) {
  throw Error(what +
              ": this program was built without ROS bags; install librosbag-storage-dev, libsensor-msgs-dev, "
              "libnav-msgs-dev and libtf2-msgs-dev (tools/setup --ros) and build it again");
}

struct BagWriter::Impl {};
BagWriter::BagWriter(std::filesystem::path file) { require_bags(file.string()); }
BagWriter::~BagWriter() = default;
void BagWriter::text(const BagPlace&, const std::string&) {}
void BagWriter::image(const BagPlace&, BagImage) {}
void BagWriter::lens(const BagPlace&, const BagLens&) {}
void BagWriter::cloud(const BagPlace&, const BagCloud&) {}
void BagWriter::transforms(const BagPlace&, const std::vector<BagTransform>&) {}
void BagWriter::path(const BagPlace&, const BagPath&) {}
void BagWriter::close() {}

void read_bag(const std::filesystem::path& file, const std::vector<std::string>&,
              const std::function<void(const std::vector<BagTopic>&)>&, const std::function<void(const BagMessage&)>&) {
  require_bags(file.string());
}

}  // namespace fringeslam::tools
