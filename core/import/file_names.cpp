// SPDX-License-Identifier: Apache-2.0
#include "core/import/file_names.h"

#include <algorithm>
#include <cctype>
#include <set>

#include "core/io/files.h"

namespace fringeslam {

namespace fs = std::filesystem;

bool is_numbered(const std::vector<std::string>& names) {
  return names.size() == 1 && names[0].find_first_of("{%") != std::string::npos;
}

std::string numbered(const YamlMap& map, const std::string& key, const std::string& format, int number) {
  const size_t brace = format.find('{'), percent = format.find('%');
  const bool python = brace != std::string::npos;
  const size_t begin = python ? brace : percent, end = format.find_first_of(python ? "}" : "d", begin);
  const Error malformed =
      map.error(key, "'" + format + "' must contain one number field such as {:02d} or %02d; or list the files");
  if (begin == std::string::npos || end == std::string::npos) throw malformed;
  std::string field = format.substr(begin + 1, end - begin - 1);  // ":02d", "02"
  if (python) {
    if (field.starts_with(":")) field.erase(0, 1);
    if (field.ends_with("d")) field.pop_back();
  }
  const bool zeros = field.starts_with("0");
  if (field.size() > 3 || !std::all_of(field.begin(), field.end(), [](unsigned char c) { return std::isdigit(c); }))
    throw malformed;
  const size_t width = field.empty() ? 0 : static_cast<size_t>(std::stoi(field));
  std::string digits = std::to_string(number);
  if (digits.size() < width) digits.insert(0, width - digits.size(), zeros ? '0' : ' ');
  const std::string before = format.substr(0, begin), after = format.substr(end + 1);
  if ((before + after).find_first_of("{}%") != std::string::npos) throw malformed;
  return before + digits + after;
}

bool natural_order_less(const std::string& a, const std::string& b) {
  size_t i = 0, j = 0;
  const auto is_digit = [](char c) { return std::isdigit(static_cast<unsigned char>(c)) != 0; };
  const auto number_at = [&](const std::string& text, size_t& at) {
    std::string digits;
    for (; at < text.size() && is_digit(text[at]); ++at) digits += text[at];
    digits.erase(0, std::min(digits.find_first_not_of('0'), digits.size()));
    return digits;
  };
  while (i < a.size() && j < b.size()) {
    if (is_digit(a[i]) && is_digit(b[j])) {
      const std::string left = number_at(a, i), right = number_at(b, j);
      if (left.size() != right.size()) return left.size() < right.size();
      if (left != right) return left < right;
    } else if (a[i] != b[j]) {
      return a[i] < b[j];
    } else {
      ++i, ++j;
    }
  }
  return a.size() - i != b.size() - j ? a.size() - i < b.size() - j : a < b;
}

bool is_image(const fs::path& file) {
  static const std::set<std::string> kExtensions = {".png", ".bmp",  ".tif", ".tiff", ".exr",
                                                    ".jpg", ".jpeg", ".pgm", ".ppm",  ".webp"};
  return kExtensions.count(lower_extension(file)) > 0;
}

fs::path beside(const YamlMap& map, const fs::path& folder, const std::string& name) {
  for (const fs::path& candidate : {map.folder() / name, folder / name}) {
    if (fs::exists(candidate)) return candidate;
  }
  return {};
}

}  // namespace fringeslam
