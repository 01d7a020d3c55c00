// SPDX-License-Identifier: Apache-2.0
#include "core/io/yaml.h"

#include <yaml-cpp/yaml.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <charconv>
#include <cmath>
#include <set>
#include <sstream>

#include "core/base/fnv.h"
#include "core/io/input_file.h"
#include "core/io/yaml_guard.h"

namespace fringeslam {

namespace {

constexpr Range kAnything{-1e300, 1e300};

double nearest_to_zero(Range range) { return std::clamp(0.0, range.low, range.high); }

// A value that was read as a path, and the file it refers to.
struct AskedPath {
  YAML::Node text;
  std::filesystem::path file;
};
struct AskedPaths {
  std::vector<AskedPath> all;
  std::vector<std::filesystem::path> noted;
  size_t relative = 0;           // number of entries already made relative
  std::filesystem::path folder;  // to this folder
};

// Returns a value as YAML on one line.
std::string flow_text(const YAML::Node& value) {
  YAML::Emitter out;
  out << YAML::Flow << value;
  return out.c_str();
}

}  // namespace

struct YamlMap::Node {
  YAML::Node yaml;
  std::string file;
  std::string path;  // position of this map in the file: the address prefix of its random draws
  std::shared_ptr<const RandomSource> draws;
  std::shared_ptr<AskedPaths> asked_paths = std::make_shared<AskedPaths>();
  std::vector<std::string>* errors = nullptr;      // collects errors; null: errors are thrown
  std::shared_ptr<std::vector<YamlValue>> values;  // if set, receives what is read
  size_t above_values = 0;                         // length of the part of `path` above the map that records
  bool absent = false;                             // placeholder for a map reported as missing
  bool given_up = false;                           // an error prevented the rest from being read
  std::set<std::string> asked;
  std::vector<std::shared_ptr<Node>> children;
  // Values that were merged from another file.
  struct Foreign {
    YAML::Node value;
    std::string file;
  };
  std::vector<Foreign> foreign;
  // Values that set() put in place with all their parts, and where they were given.
  struct Change {
    YAML::Node value;
    std::string place;
  };
  std::shared_ptr<std::vector<Change>> changes = std::make_shared<std::vector<Change>>();

  const std::string& file_of(const YAML::Node& node) const {
    for (const Foreign& other : foreign) {
      if (node.is(other.value)) return other.file;
    }
    return file;
  }

  // Returns the result of `read`, or the stand-in if it fails while errors are collected.
  template <class Value, class Read>
  Value tolerant(Value stand_in, const Read& read) const {
    if (!errors) return read();
    try {
      return read();
    } catch (const Error& e) {
      if (!absent) errors->push_back(e.what());
      return stand_in;
    }
  }

  void note_change(const YAML::Node& value, const std::string& place) {
    // The node of a map or list refers to another value once this one is replaced, so a node of its own is noted. An
    // assigned handle becomes one of the other node, while the node that it was a handle of refers to the value.
    const YAML::Node noted(YAML::NodeType::Null);
    YAML::Node handle(noted);
    handle = value;
    changes->push_back({noted, place});
    for (const auto& part : value) note_change(value.IsMap() ? part.second : YAML::Node(part), place);
  }

  // Returns where a value was given that set() put in place; empty: it was not.
  std::string change_of(const YAML::Node& node) const {
    for (const Change& change : *changes) {
      if (node.is(change.value)) return change.place;
    }
    return "";
  }

  std::string where(const YAML::Node& node) const {
    if (const std::string change = change_of(node); !change.empty()) return change + ": ";
    return place_in_file(node) + ": ";
  }

  std::string place_in_file(const YAML::Node& node) const {
    const YAML::Mark mark = node.Mark();
    return file_of(node) + (mark.is_null() ? "" : ":" + std::to_string(mark.line + 1));
  }

  YAML::Node find(const std::string& key) {
    asked.insert(key);
    return lookup(key);
  }

  // Lookup without yaml-cpp's insertion of missing keys.
  YAML::Node lookup(const std::string& key) const {
    for (const auto& entry : yaml) {
      if (entry.first.IsScalar() && entry.first.Scalar() == key) return entry.second;
    }
    return YAML::Node(YAML::NodeType::Undefined);
  }

  YAML::Node require(const std::string& key) {
    const YAML::Node value = find(key);
    if (!value.IsDefined() || value.IsNull()) {
      std::vector<std::string> unasked;
      for (const auto& entry : yaml) {
        if (entry.first.IsScalar() && !asked.count(entry.first.Scalar())) unasked.push_back(entry.first.Scalar());
      }
      const std::string misspelt = nearest_name(key, unasked);
      throw Error(where(yaml) + "'" + key + "' is missing; " +
                  (misspelt.empty() ? "add it" : "is '" + misspelt + "' a misspelling of it?"));
    }
    return value;
  }

  std::shared_ptr<Node> child(const YAML::Node& value, const std::string& name) {
    auto node = std::make_shared<Node>();
    node->yaml.reset(value);
    node->file = file_of(value);
    node->foreign = foreign;
    node->changes = changes;
    node->path = path + "/" + name;
    node->draws = draws;
    node->asked_paths = asked_paths;
    node->errors = errors;
    node->values = values;
    node->above_values = above_values;
    node->absent = absent;
    children.push_back(node);
    return node;
  }

  void record(const std::string& key, YamlValue value) const {
    if (!values) return;
    value.path = (path + "/" + key).substr(above_values + 1);
    std::replace(value.path.begin(), value.path.end(), '/', '.');
    values->push_back(std::move(value));
  }

  // Returns a number. A distribution in its place is sampled and replaced by the drawn value.
  double to_number(YAML::Node value, const std::string& key, Range range, bool whole = false,
                   const std::string& element = "") const {
    if (value.IsMap() && draws) {
      const double drawn = draw(value, key, range, whole, path + "/" + key + element);
      if (values)
        record(key + element, {{}, fringeslam::to_text(drawn), flow_text(value), place_in_file(value), range, whole});
      value = fringeslam::to_text(drawn);
      return drawn;
    }
    const double number = given_number(value, key, range);
    if (values) record(key + element, {{}, value.Scalar(), {}, place_in_file(value), range, whole});
    return number;
  }

  double given_number(const YAML::Node& value, const std::string& key, Range range) const {
    double number = 0;
    if (!value.IsScalar() || !YAML::convert<double>::decode(value, number))
      throw Error(where(value) + "'" + key + "' must be a number");
    if (!range.contains(number)) throw Error(where(value) + range_error("'" + key + "'", number, range));
    return number;
  }

  // Returns a string. A choice in its place is sampled and replaced likewise.
  std::string to_text(const std::string& key);

  double draw(const YAML::Node& value, const std::string& key, Range range, bool whole, const std::string& place) const;
};

double YamlMap::Node::draw(const YAML::Node& value, const std::string& key, Range range, bool whole,
                           const std::string& place) const {
  constexpr const char* kKinds = "uniform: [a, b], log_uniform: [a, b], normal: [mean, sigma] or choice: [...]";
  if (value.size() != 1 || !value.begin()->first.IsScalar() || !value.begin()->second.IsSequence())
    throw Error(where(value) + "'" + key + "' must be a number or a distribution, " + kKinds);
  const std::string kind = value.begin()->first.Scalar();
  std::vector<double> given;
  const YAML::Node list = value.begin()->second;  // the iterator yields a temporary copy
  for (const auto& entry : list) given.push_back(given_number(entry, key, kind == "normal" ? kAnything : range));
  const uint64_t address = fnv1a(place);
  if (kind == "choice") {
    if (given.empty()) throw Error(where(value) + "'choice' must not be empty");
    const auto n = static_cast<double>(given.size());
    return given[static_cast<size_t>(std::min(n - 1, std::floor(n * draws->uniform(address, 0))))];
  }
  if (given.size() != 2) throw Error(where(value) + "'" + kind + "' takes two numbers");
  const double a = given[0], b = given[1];
  if (kind == "uniform" || kind == "log_uniform") {
    if (b < a) throw Error(where(value) + "'" + kind + "' needs the smaller number first");
    if (kind == "log_uniform" && a <= 0) throw Error(where(value) + "'log_uniform' takes positive numbers");
    const double u = draws->uniform(address, 0);
    if (whole && kind == "uniform")
      return std::min(std::floor(b), std::ceil(a) + std::floor(u * (std::floor(b) - std::ceil(a) + 1)));
    const double drawn = kind == "uniform" ? a + u * (b - a) : a * std::pow(b / a, u);
    return whole ? std::round(drawn) : drawn;
  }
  if (kind != "normal") throw Error(where(value) + "'" + kind + "' is not a distribution; use one of " + kKinds);
  if (b < 0) throw Error(where(value) + "'normal' takes a mean and a non-negative sigma");
  // Truncated to the permitted range by rejection.
  constexpr uint32_t kTries = 1000;
  for (uint32_t attempt = 0; attempt < kTries; ++attempt) {
    double drawn = a + b * draws->normal(address, attempt);
    if (whole) drawn = std::round(drawn);
    if (range.contains(drawn)) return drawn;
  }
  throw Error(where(value) + "'" + key +
              "': this normal distribution almost never yields a permitted value; the range is [" +
              fringeslam::to_text(range.low) + ", " + fringeslam::to_text(range.high) + "]");
}

namespace {

constexpr Range kMetres{-1e4, 1e4};
constexpr Range kDegrees{-360, 360};

YAML::Node parse_yaml(const std::string& text, const std::string& name) {
  try {
    check_yaml(text, name);
    YAML::Node root = YAML::Load(text);
    if (!root.IsMap()) throw Error(name + ":1: must be a YAML map of `key: value` lines");
    return root;
  } catch (const YAML::Exception& e) {
    throw Error(name + ":" + std::to_string(e.mark.line + 1) + ": not valid YAML: " + e.msg);
  }
}

void refuse_duplicates(const YAML::Node& node, const std::string& file) {
  std::set<std::string> seen;
  for (const auto& entry : node) {
    const std::string line = file + ":" + std::to_string(entry.first.Mark().line + 1) + ": ";
    if (!entry.first.IsScalar()) throw Error(line + "a key must be a scalar");
    if (!seen.insert(entry.first.Scalar()).second)
      throw Error(line + "'" + entry.first.Scalar() + "' is a duplicate key; keep one of the two");
  }
}

}  // namespace

YamlMap::YamlMap(std::shared_ptr<Node> node) : node_(std::move(node)) { refuse_duplicates(node_->yaml, node_->file); }

YamlMap YamlMap::load(const std::filesystem::path& file) {
  return parse(read_input(file, kMostYamlBytes), file.string());
}

YamlMap YamlMap::parse(const std::string& text, const std::string& name) {
  auto node = std::make_shared<Node>();
  node->yaml.reset(parse_yaml(text, name));
  node->file = name;
  return YamlMap(node);
}

std::string yaml_quoted(const std::string& text) {
  YAML::Emitter out;
  out << YAML::DoubleQuoted << text;
  return out.c_str();
}

namespace {

// Returns the end of the scalar in YAML text; `begin` if it is neither in quotes nor plain on one line.
size_t end_of_scalar(const std::string& text, size_t begin, const std::string& value) {
  const char quote = begin < text.size() ? text[begin] : '\0';
  if (quote != '"' && quote != '\'')
    return text.compare(begin, value.size(), value) == 0 ? begin + value.size() : begin;
  for (size_t i = begin + 1; i < text.size(); ++i) {
    const bool escaping = quote == '"' ? text[i] == '\\' : text.compare(i, 2, "''") == 0;
    if (escaping)
      ++i;
    else if (text[i] == quote)
      return i + 1;
  }
  return begin;
}

}  // namespace

std::string with_replaced_scalars(const std::string& text, const std::string& name,
                                  const ScalarReplacement& replacement) {
  const std::string byte_order_mark = "\xEF\xBB\xBF";  // marks do not count it
  const size_t first = text.starts_with(byte_order_mark) ? byte_order_mark.size() : 0;
  std::string result;
  size_t copied = 0;
  const std::function<void(const YAML::Node&, const std::string&)> visit = [&](const YAML::Node& node,
                                                                               const std::string& section) {
    for (const auto& entry : node) {
      if (node.IsMap())
        visit(entry.second, section);
      else
        visit(entry, section);
    }
    if (!node.IsScalar()) return;
    const std::optional<std::string> value = replacement(section, node.Scalar());
    if (!value) return;
    const std::string written = yaml_quoted(*value), where = name + ":" + std::to_string(node.Mark().line + 1) + ": ";
    if (YAML::Load(written).Scalar() != *value) throw Error(where + "'" + *value + "' is not UTF-8 text");
    const size_t begin = std::min(text.size(), first + static_cast<size_t>(node.Mark().pos));
    const size_t end = end_of_scalar(text, begin, node.Scalar());
    if (end == begin) throw Error(where + "this value cannot be replaced; write it on one line, or in quotes");
    result.append(text, copied, begin - copied).append(written);
    copied = end;
  };
  for (const auto& entry : parse_yaml(text, name)) visit(entry.second, entry.first.Scalar());
  return result.append(text, copied);
}

bool YamlMap::has(const std::string& key) const { return node_->find(key).IsDefined(); }

bool YamlMap::contains(const std::string& key) const { return node_->lookup(key).IsDefined(); }

double YamlMap::number(const std::string& key, Range range) const {
  return node_->tolerant(nearest_to_zero(range), [&] { return node_->to_number(node_->require(key), key, range); });
}

double YamlMap::number_or(const std::string& key, double fallback, Range range) const {
  return has(key) ? number(key, range) : fallback;
}

int YamlMap::integer(const std::string& key, Range range) const {
  return node_->tolerant(static_cast<int>(nearest_to_zero(range)), [&] {
    const double value = node_->to_number(node_->require(key), key, range, true);
    if (value != std::floor(value)) throw error(key, "'" + key + "' must be a whole number");
    return static_cast<int>(value);
  });
}

int YamlMap::integer_or(const std::string& key, int fallback, Range range) const {
  return has(key) ? integer(key, range) : fallback;
}

uint64_t YamlMap::seed(const std::string& key) const {
  return node_->tolerant(uint64_t{0}, [&] {
    const std::string digits = text(key);
    uint64_t value = 0;
    const auto [end, failure] = std::from_chars(digits.data(), digits.data() + digits.size(), value);
    if (failure != std::errc() || end != digits.data() + digits.size())
      throw error(key, "'" + key + "' must be a whole number from 0 to 18446744073709551615");
    return value;
  });
}

bool YamlMap::boolean_or(const std::string& key, bool fallback) const {
  if (!has(key)) return fallback;
  return node_->tolerant(fallback, [&] {
    bool value = false;
    if (!YAML::convert<bool>::decode(node_->require(key), value))
      throw error(key, "'" + key + "' must be true or false");
    return value;
  });
}

std::string YamlMap::Node::to_text(const std::string& key) {
  YAML::Node value = require(key);
  if (draws && value.IsMap() && value.size() == 1 && value["choice"].IsSequence() && value["choice"].size() > 0) {
    const YAML::Node choices = value["choice"];
    const auto n = static_cast<double>(choices.size());
    const double u = draws->uniform(fnv1a(path + "/" + key), 0);
    const YAML::Node chosen = choices[static_cast<size_t>(std::min(n - 1, std::floor(n * u)))];
    if (chosen.IsScalar()) {
      if (values) record(key, {{}, chosen.Scalar(), flow_text(value), place_in_file(value), {}, false});
      value = chosen.Scalar();
    }
  }
  if (!value.IsScalar() || value.Scalar().empty()) throw Error(where(value) + "'" + key + "' must be a string");
  return value.Scalar();
}

std::string YamlMap::text(const std::string& key) const {
  return node_->tolerant(std::string(), [&] { return node_->to_text(key); });
}

std::string YamlMap::text_or(const std::string& key, const std::string& fallback) const {
  return has(key) ? text(key) : fallback;
}

std::string YamlMap::choice(const std::string& key, const std::vector<std::string>& choices) const {
  return node_->tolerant(choices.empty() ? std::string() : choices.front(), [&] { return kind(key, choices); });
}

size_t YamlMap::choice_index(const std::string& key, const std::vector<std::string>& choices) const {
  return static_cast<size_t>(std::find(choices.begin(), choices.end(), choice(key, choices)) - choices.begin());
}

std::string YamlMap::kind(const std::string& key, const std::vector<std::string>& choices) const {
  const std::string value = node_->to_text(key);
  std::string known;
  for (const std::string& candidate : choices) {
    if (candidate == value) return value;
    known += (known.empty() ? "" : ", ") + candidate;
  }
  const std::string nearest = nearest_name(value, choices);
  throw error(key, "'" + key + ": " + value + "' is not one of " + (known.empty() ? "(none)" : known) +
                       (nearest.empty() ? "" : "; did you mean '" + nearest + "'?"));
}

std::vector<double> YamlMap::numbers(const std::string& key, size_t count, Range range) const {
  return node_->tolerant(std::vector<double>(std::max<size_t>(count, 1), nearest_to_zero(range)), [&] {
    const YAML::Node value = node_->require(key);
    if (!value.IsSequence() || value.size() == 0 || (count != 0 && value.size() != count))
      throw error(key, "'" + key + "' must be a list of " + (count ? std::to_string(count) + " " : "") + "numbers");
    std::vector<double> result;
    for (size_t i = 0; i < value.size(); ++i)
      result.push_back(node_->to_number(value[i], key, range, false, "/" + std::to_string(i)));
    return result;
  });
}

Eigen::Vector3d YamlMap::vector3(const std::string& key, Range range) const {
  return Eigen::Vector3d(numbers(key, 3, range).data());
}

Eigen::Vector3d YamlMap::vector3_or(const std::string& key, const Eigen::Vector3d& fallback, Range range) const {
  return has(key) ? vector3(key, range) : fallback;
}

Pose YamlMap::pose(const std::string& key) const { return map(key).as_pose(); }

Pose YamlMap::as_pose() const {
  return node_->tolerant(Pose{}, [&] {
    const Eigen::Vector3d translation = vector3_or("translation_m", Eigen::Vector3d::Zero(), kMetres);
    const Eigen::Vector3d angles = vector3_or("rotation_deg", Eigen::Vector3d::Zero(), kDegrees);
    Pose pose = pose_from({Eigen::Vector3d::Zero(), angles});
    if (has("rotation_matrix")) {
      if (has("rotation_deg")) throw error("specify rotation_deg or rotation_matrix, not both");
      const std::vector<double> m = numbers("rotation_matrix", 9, {-1.001, 1.001});
      pose.rotation << m[0], m[1], m[2], m[3], m[4], m[5], m[6], m[7], m[8];
      const double defect = (pose.rotation.transpose() * pose.rotation - Eigen::Matrix3d::Identity()).norm();
      const double handedness = pose.rotation.col(0).cross(pose.rotation.col(1)).dot(pose.rotation.col(2));
      if (defect > 1e-6 || handedness < 0)
        throw error("rotation_matrix", "rotation_matrix is not a right-handed rotation");
    }
    pose.translation = translation;
    return pose;
  });
}

std::vector<std::string> YamlMap::texts(const std::string& key) const {
  return node_->tolerant(std::vector<std::string>(), [&] {
    const YAML::Node value = node_->require(key);
    if (value.IsScalar()) return std::vector<std::string>{node_->to_text(key)};
    std::vector<std::string> result;
    for (const auto& element : value) {
      if (!value.IsSequence() || !element.IsScalar())
        throw error(key, "'" + key + "' must be a string or a list of strings");
      result.push_back(element.Scalar());
    }
    if (result.empty()) throw error(key, "'" + key + "' must not be empty");
    return result;
  });
}

YamlMap YamlMap::absent_map(const std::string& key) const {
  auto node = node_->child(YAML::Node(YAML::NodeType::Map), key);
  node->absent = true;
  return YamlMap(node);
}

YamlMap YamlMap::map(const std::string& key) const {
  const auto read = [&] {
    const YAML::Node value = node_->require(key);
    if (!value.IsMap()) throw error(key, "'" + key + "' must be a map of `key: value` lines");
    return std::optional(YamlMap(node_->child(value, key)));
  };
  const std::optional<YamlMap> found = node_->tolerant(std::optional<YamlMap>(), read);
  return found ? *found : absent_map(key);
}

std::vector<YamlMap> YamlMap::maps(const std::string& key) const {
  return node_->tolerant(std::vector<YamlMap>(), [&] {
    const YAML::Node value = node_->require(key);
    if (!value.IsSequence()) throw error(key, "'" + key + "' must be a list");
    std::vector<YamlMap> result;
    for (size_t i = 0; i < value.size(); ++i) {
      const YAML::Node element = value[i];
      if (element.IsMap())
        result.push_back(YamlMap(node_->child(element, key + "/" + std::to_string(i))));
      else
        report(Error(node_->where(element) + "each entry of '" + key + "' must be a map"));
    }
    return result;
  });
}

namespace {

std::vector<std::string> keys_of(const YAML::Node& map) {
  std::vector<std::string> result;
  for (const auto& entry : map) result.push_back(entry.first.Scalar());
  return result;
}

}  // namespace

std::vector<std::string> YamlMap::keys() const { return keys_of(node_->yaml); }

std::vector<std::string> YamlMap::keys_in(const std::string& key) const {
  const YAML::Node map = node_->lookup(key);
  return map.IsDefined() && map.IsMap() ? keys_of(map) : std::vector<std::string>();
}

std::string YamlMap::yaml(const std::string& key) const { return flow_text(node_->require(key)); }

Error YamlMap::error(const std::string& key, const std::string& message) const {
  for (const auto& entry : node_->yaml) {
    const bool own = node_->file_of(entry.second) == node_->file && node_->change_of(entry.second).empty();
    if (entry.first.Scalar() == key) return Error(node_->where(own ? entry.first : entry.second) + message);
  }
  return error(message);
}

std::string YamlMap::place() const { return node_->place_in_file(node_->yaml); }

std::string YamlMap::place(const std::string& key) const { return node_->place_in_file(node_->require(key)); }

Error YamlMap::error(const std::string& message) const { return Error(node_->where(node_->yaml) + message); }

std::filesystem::path YamlMap::folder() const { return std::filesystem::path(node_->file).parent_path(); }

std::filesystem::path YamlMap::path(const std::string& key) const {
  const std::string name = text(key);
  const std::filesystem::path file = folder() / name;
  if (!name.empty()) node_->asked_paths->all.push_back({node_->find(key), file});
  return file;
}

std::vector<std::filesystem::path> YamlMap::paths(const std::string& key) const {
  std::vector<std::filesystem::path> files;
  for (const std::string& name : texts(key)) files.push_back(folder() / name);
  return files;
}

std::filesystem::path YamlMap::file(const std::string& key) const {
  const std::filesystem::path file = path(key);
  std::error_code failed;  // such as a name that is too long: that file does not exist either
  if (!std::filesystem::exists(file, failed))
    throw error(key, file.string() + (failed == std::errc::permission_denied ? " cannot be read: permission denied"
                                                                             : " does not exist"));
  if (!std::filesystem::is_regular_file(file, failed)) throw error(key, file.string() + " is not a regular file");
  return file;
}

void YamlMap::note_file(const std::filesystem::path& file) const { node_->asked_paths->noted.push_back(file); }

std::vector<std::filesystem::path> YamlMap::asked_files() const {
  std::vector<std::filesystem::path> files = node_->asked_paths->noted;
  for (const AskedPath& asked : node_->asked_paths->all) files.push_back(asked.file);
  return files;
}

namespace {

// Copies a value without its line marks.
YAML::Node without_marks(const YAML::Node& node) {
  if (node.IsScalar()) return YAML::Node(node.Scalar());
  YAML::Node copy(node.Type());
  for (const auto& entry : node) {
    if (node.IsMap())
      copy[entry.first.Scalar()] = without_marks(entry.second);
    else
      copy.push_back(without_marks(entry));
  }
  return copy;
}

bool is_pose(const YAML::Node& node) {
  return node.IsMap() && (node["translation_m"] || node["rotation_deg"] || node["rotation_matrix"]);
}

}  // namespace

void YamlMap::set(const std::string& path, const std::string& value, const std::string& place) {
  const YAML::Node parsed = parse_yaml("value: " + value, path + "=" + value);
  if (parsed.size() != 1) throw Error(path + "=" + value + ": must be one YAML value; give further keys by themselves");
  YAML::Node at;
  at.reset(node_->yaml);
  if (static_cast<size_t>(std::count(path.begin(), path.end(), '.')) >= kDeepestYaml)
    throw Error((place.empty() ? node_->file : place) + ": the key path " + path.substr(0, 40) + "... has more than " +
                std::to_string(kDeepestYaml) + " parts");
  size_t begin = 0;
  while (true) {
    const size_t end = std::min(path.find('.', begin), path.size());
    const std::string step = path.substr(begin, end - begin);
    const auto missing = [&](const std::string& what) {
      return Error((place.empty() ? node_->file + ": " + path : place) + ": " +
                   (begin > 0 ? path.substr(0, begin - 1) + " " : "") + what);
    };
    if (step.empty()) throw missing("is followed by an empty name");
    size_t number = 0;
    if (at.IsSequence()) {
      const auto [stop, failure] = std::from_chars(step.data(), step.data() + step.size(), number);
      if (failure != std::errc() || stop != step.data() + step.size() || number >= at.size())
        throw missing("is a list of " + std::to_string(at.size()) + "; its entries are numbered from 0");
    } else if (!at.IsMap()) {
      throw missing("is a scalar and has no sub-keys");
    }
    const auto change = [&](const YAML::Node& new_value) {
      if (at.IsSequence())
        at[number] = new_value;
      else
        at[step] = new_value;
      if (!place.empty()) node_->note_change(new_value, place);
    };
    if (end == path.size()) {
      change(without_marks(parsed["value"]));
      return;
    }
    if (at.IsMap() && !at[step]) change(YAML::Node(YAML::NodeType::Map));
    const YAML::Node next = at.IsSequence() ? at[number] : at[step];
    at.reset(next);
    begin = end + 1;
  }
}

YamlMap YamlMap::changed_by(const YamlMap& changes, const std::vector<std::string>& except) const {
  auto node = std::make_shared<Node>();
  node->yaml.reset(node_->yaml);  // a clone would lose its line marks
  node->file = node_->file;
  node->path = changes.node_->path;
  node->draws = changes.node_->draws;
  node->errors = changes.node_->errors;
  node->values = changes.node_->values;
  node->above_values = changes.node_->above_values;
  node->asked_paths = changes.node_->asked_paths;
  node->changes = changes.node_->changes;
  const std::function<void(YAML::Node, const YAML::Node&)> put = [&](YAML::Node under, const YAML::Node& over) {
    for (const auto& entry : over) {
      const std::string key = entry.first.Scalar();
      const YAML::Node value = entry.second;
      if (under[key] && under[key].IsMap() && value.IsMap() && !is_pose(value)) {
        put(under[key], value);
      } else {
        under[key] = value;  // the same node, so that a drawn value appears in both
        node->foreign.push_back({value, changes.node_->file});
      }
    }
  };
  for (const auto& entry : changes.node_->yaml) {
    const std::string key = entry.first.Scalar();
    changes.node_->asked.insert(key);
    if (std::find(except.begin(), except.end(), key) != except.end()) continue;
    YAML::Node one(YAML::NodeType::Map);
    one[key] = entry.second;
    put(node->yaml, one);
  }
  return YamlMap(node);
}

void YamlMap::record_values(std::shared_ptr<std::vector<YamlValue>> values) {
  node_->values = std::move(values);
  node_->above_values = node_->path.size();
}

void YamlMap::draw_from(std::shared_ptr<const RandomSource> draws, const std::string& place) {
  node_->draws = std::move(draws);
  node_->path = place;
}

std::string YamlMap::dump(const std::vector<std::string>& keys, const std::filesystem::path& folder) const {
  const auto whole = [](const std::filesystem::path& path) {
    return std::filesystem::absolute(path.empty() ? "." : path).lexically_normal();
  };
  // Paths of the whole file are converted once, not per map.
  AskedPaths& asked = *node_->asked_paths;
  if (asked.folder != folder) asked.relative = 0;
  asked.folder = folder;
  for (; asked.relative < asked.all.size(); ++asked.relative) {
    AskedPath& path = asked.all[asked.relative];
    const std::filesystem::path file = whole(path.file), base = whole(folder / "");
    path.text = (base == base.root_path() ? file : file.lexically_relative(base)).string();
  }
  // Emitted directly: a new node would take ownership of all nodes of the file.
  YAML::Emitter out;
  out << YAML::BeginMap;
  for (const auto& entry : node_->yaml) {
    if (std::find(keys.begin(), keys.end(), entry.first.Scalar()) != keys.end())
      out << YAML::Key << entry.first << YAML::Value << entry.second;
  }
  out << YAML::EndMap;
  return keys.empty() ? "" : std::string(out.c_str()) + "\n";
}

void YamlMap::collect_errors(std::vector<std::string>& errors) { node_->errors = &errors; }

void YamlMap::attempt(const std::function<void()>& read) const {
  if (!node_->errors) return read();
  const size_t before = node_->errors->size();
  try {
    read();
  } catch (const Error& e) {
    node_->given_up = true;
    if (!node_->absent && node_->errors->size() == before) node_->errors->push_back(e.what());
  }
}

void YamlMap::report(const Error& error) const {
  if (!node_->errors) throw error;
  if (!node_->absent) node_->errors->push_back(error.what());
}

void YamlMap::finish() const {
  if (node_->absent || node_->given_up) return;
  for (const std::string& key : keys()) {
    if (node_->asked.count(key)) continue;
    const std::string nearest = nearest_name(key, {node_->asked.begin(), node_->asked.end()});
    const Error unknown =
        error(key, "unknown key '" + key + "'" + (nearest.empty() ? "" : "; did you mean '" + nearest + "'?"));
    report(unknown);
  }
  for (const auto& child : node_->children) YamlMap(child).finish();
}

}  // namespace fringeslam
