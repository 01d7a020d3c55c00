// SPDX-License-Identifier: Apache-2.0
#include "core/import/projected.h"

#include <algorithm>

#include "core/import/file_names.h"
#include "core/io/files.h"

namespace fringeslam {

namespace fs = std::filesystem;

namespace {

constexpr const char* kProjected = "projected";

fs::path existing_image(const YamlMap& entry, const fs::path& folder, const std::string& name) {
  const fs::path file = beside(entry, folder, name);
  if (file.empty() || fs::is_directory(file))
    throw entry.error(kProjected, name + " is not an image next to this file or in " + folder.string() +
                                      "; name the images that the projector showed");
  return file;
}

std::vector<fs::path> numbered_images(const YamlMap& entry, const fs::path& folder, const std::string& format) {
  constexpr Range kNumbers{0, 1000000};
  int number = entry.integer_or("projected_first", entry.integer_or("first", 0, kNumbers), kNumbers);
  std::vector<fs::path> files = {existing_image(entry, folder, numbered(entry, kProjected, format, number))};
  while (true) {
    const fs::path next = beside(entry, folder, numbered(entry, kProjected, format, ++number));
    if (next.empty()) return files;
    files.push_back(next);
  }
}

std::vector<fs::path> images_in(const YamlMap& entry, const fs::path& folder) {
  std::vector<fs::path> files;
  for (const auto& item : fs::directory_iterator(folder)) {
    if (item.is_regular_file() && is_image(item.path())) files.push_back(item.path());
  }
  if (files.empty()) throw entry.error(kProjected, folder.string() + " contains no images");
  std::sort(files.begin(), files.end(), [](const fs::path& a, const fs::path& b) {
    return natural_order_less(a.filename().string(), b.filename().string());
  });
  return files;
}

// The channel that the image uses; all used channels must be equal, because each of three different ones is a pattern.
cv::Mat projected_levels(const fs::path& file) {
  cv::Mat levels;
  for (const GreyFrom channel : {GreyFrom::red, GreyFrom::green, GreyFrom::blue}) {
    const cv::Mat one = read_as_grey(file, channel);
    double low = 0, high = 0;
    cv::minMaxLoc(one, &low, &high);
    if (low == 0 && high == 0 && channel != GreyFrom::blue) continue;
    if (levels.empty()) levels = one;
    const bool unused = low == 0 && high == 0;
    if (!unused && cv::norm(levels, one, cv::NORM_INF) > 0)
      throw Error(file.string() +
                  ": its colour channels differ; store the pattern of each channel as a grey image and list these");
  }
  return levels;
}

}  // namespace

std::vector<fs::path> projected_files(const YamlMap& entry, const fs::path& folder) {
  const std::vector<std::string> names = entry.texts(kProjected);
  if (is_numbered(names)) return numbered_images(entry, folder, names[0]);
  if (names.size() == 1) {
    const fs::path found = beside(entry, folder, names[0]);
    if (fs::is_directory(found)) return images_in(entry, found);
  }
  std::vector<fs::path> files;
  for (const std::string& name : names) files.push_back(existing_image(entry, folder, name));
  return files;
}

RecognizedPattern recognize_file(const YamlMap& entry, const fs::path& file, const cv::Size& projector) {
  cv::Mat levels;
  try {
    levels = projected_levels(file);
  } catch (const Error& e) {
    throw entry.error(kProjected, e.what());
  }
  try {
    return recognize_pattern(levels, projector);
  } catch (const Error& e) {
    throw entry.error(kProjected, file.string() + ": " + e.what());
  }
}

}  // namespace fringeslam
