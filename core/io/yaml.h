// SPDX-License-Identifier: Apache-2.0
// Strict YAML reader: every error states file:line, and a key that is never read is an error that suggests the closest
// known key.
//
//   YamlMap file = YamlMap::load("rig.yaml");
//   const int width = file.map("camera").integer("width_px", {1, 16384});
//   file.finish();   // rejects unknown keys in this map and all maps below
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/io/yaml_value.h"
#include "core/types/error.h"
#include "core/types/options.h"
#include "core/types/pose.h"

namespace fringeslam {

// Source of random numbers, indexed by address, for distributions given in place of numbers.
class RandomSource {
 public:
  virtual ~RandomSource() = default;
  virtual double uniform(uint64_t address, uint32_t attempt) const = 0;  // in (0, 1)
  virtual double normal(uint64_t address, uint32_t attempt) const = 0;   // standard
};

class YamlMap {
 public:
  static YamlMap load(const std::filesystem::path& file);
  // Parses YAML text; `name` replaces the file name in errors.
  static YamlMap parse(const std::string& text, const std::string& name);

  bool has(const std::string& key) const;
  // Like has(), but finish() still rejects the key if nothing reads it.
  bool contains(const std::string& key) const;
  double number(const std::string& key, Range range) const;
  double number_or(const std::string& key, double fallback, Range range) const;
  int integer(const std::string& key, Range range) const;
  int integer_or(const std::string& key, int fallback, Range range) const;
  // Integer from 0 to 2^64 - 1, without loss of precision.
  uint64_t seed(const std::string& key) const;
  bool boolean_or(const std::string& key, bool fallback) const;
  std::string text(const std::string& key) const;
  std::string text_or(const std::string& key, const std::string& fallback) const;
  std::string choice(const std::string& key, const std::vector<std::string>& choices) const;
  // The value of an enum given by its name.
  template <NamedEnum E>
  E choice(const std::string& key) const {
    return choices(E())[choice_index(key, choice_names<E>())].value;
  }
  template <NamedEnum E>
  E choice_or(const std::string& key, E fallback) const {
    return has(key) ? choice<E>(key) : fallback;
  }
  // Like choice(), but always throws on error, even while errors are collected: use it in attempt() for keys that
  // determine which other keys are read.
  std::string kind(const std::string& key, const std::vector<std::string>& choices) const;
  // List of numbers; `count` 0 accepts any non-zero length.
  std::vector<double> numbers(const std::string& key, size_t count, Range range) const;
  Eigen::Vector3d vector3(const std::string& key, Range range) const;
  Eigen::Vector3d vector3_or(const std::string& key, const Eigen::Vector3d& fallback, Range range) const;
  // Pose given as {translation_m: [x, y, z], rotation_deg: [alpha, beta, gamma]}, or with rotation_matrix: 9 numbers in
  // row-major order.
  Pose pose(const std::string& key) const;
  Pose as_pose() const;  // this map itself as a pose

  // List of strings; a single string is a list of one.
  std::vector<std::string> texts(const std::string& key) const;

  YamlMap map(const std::string& key) const;
  std::vector<YamlMap> maps(const std::string& key) const;
  std::vector<std::string> keys() const;
  // The keys of the map `key`, which is not marked as read; none if it is missing or not a map.
  std::vector<std::string> keys_in(const std::string& key) const;
  // Returns a value as YAML on one line.
  std::string yaml(const std::string& key) const;

  // Reads the fields that are present into a self-describing options struct (core/types/options.h).
  template <class Options>
  void read(Options& options) const {
    FieldReader reader{*this};
    options.describe(reader);
  }

  // Creates an error "file:line: message" about one key or about the whole map.
  Error error(const std::string& key, const std::string& message) const;
  Error error(const std::string& message) const;
  // Folder of the file; relative paths in the file are resolved against it.
  std::filesystem::path folder() const;
  std::filesystem::path path(const std::string& key) const;
  std::vector<std::filesystem::path> paths(const std::string& key) const;
  // Path of an existing regular file; throws Error for folders and devices.
  std::filesystem::path file(const std::string& key) const;
  // Adds a file that the values of the map led to in another way.
  void note_file(const std::filesystem::path& file) const;
  // Returns the paths that path() and file() have returned, or refused, for this map and all others of its file, and those
  // that were noted.
  std::vector<std::filesystem::path> asked_files() const;

  // Returns file:line of this map, or of one of its values, or the file if the line is unknown.
  std::string place() const;
  std::string place(const std::string& key) const;

  void finish() const;

  // Replaces the value at a path such as light.ambient_lux or objects.2.count by a YAML value; missing intermediate
  // maps are created. Errors in the value, or about its key, are reported at `place`, by default at this file.
  // Throws Error if an element of the path does not exist.
  void set(const std::string& path, const std::string& value, const std::string& place = "");
  // Merges `changes` over this map, except for the keys in `except`. Maps are merged recursively; all other values, and
  // poses, are replaced. This map is modified as well. The result uses the random draws and the error collection of
  // `changes`, all of whose keys are marked as read.
  YamlMap changed_by(const YamlMap& changes, const std::vector<std::string>& except) const;

  // From now on, errors in this map and the maps below are appended to `errors` and a permitted value is returned
  // instead, so that one pass finds all errors.
  void collect_errors(std::vector<std::string>& errors);
  // Runs `read`. While errors are collected, an exception from it is recorded unless `read` already recorded errors of
  // which it may be a consequence; the rest of the map is then not checked.
  void attempt(const std::function<void()>& read) const;
  // Throws `error`, or records it while errors are collected.
  void report(const Error& error) const;

  // From now on, a number in this map or below may be {uniform: [a, b]}, {log_uniform: [a, b]}, {normal: [mean, sigma]}
  // (truncated to the permitted range) or {choice: [...]}, and a string may be a choice. The value drawn depends only
  // on the position in the file. `place` is a prefix for these positions that distinguishes files.
  void draw_from(std::shared_ptr<const RandomSource> draws, const std::string& place = "");
  // From now on, appends the numbers and drawn values that are read from this map or below to `values`.
  void record_values(std::shared_ptr<std::vector<YamlValue>> values);
  // Writes these keys as YAML with drawn values in place of distributions; values read as paths are written relative to
  // `folder`, or as absolute paths if it is the root folder.
  std::string dump(const std::vector<std::string>& keys, const std::filesystem::path& folder) const;

 private:
  struct FieldReader {
    const YamlMap& map;
    void field(const char* name, double& value, Range range, const char*) { value = map.number_or(name, value, range); }
    void field(const char* name, int& value, Range range, const char*) { value = map.integer_or(name, value, range); }
    void field(const char* name, bool& value, const char*) { value = map.boolean_or(name, value); }
    template <NamedEnum E>
    void field(const char* name, E& value, const char*) {
      value = map.choice_or(name, value);
    }
  };
  struct Node;
  explicit YamlMap(std::shared_ptr<Node> node);
  YamlMap absent_map(const std::string& key) const;
  // Index of the choice() among the choices.
  size_t choice_index(const std::string& key, const std::vector<std::string>& choices) const;
  std::shared_ptr<Node> node_;
};

// Quotes a string as a YAML scalar that reads back unchanged.
std::string yaml_quoted(const std::string& text);

// Gets the section (top-level key) and the value of a scalar that is not a key; returns its new value, or nothing to keep it.
using ScalarReplacement =
    std::function<std::optional<std::string>(const std::string& section, const std::string& value)>;
// Returns YAML text with other values for some of its scalars; comments and layout stay as they are. Throws Error with
// name:line if the text is not valid YAML, or if a scalar to replace is neither in quotes nor plain on one line.
std::string with_replaced_scalars(const std::string& text, const std::string& name,
                                  const ScalarReplacement& replacement);

// Writes self-describing options as lines of a YAML map.
class YamlOptionsWriter {
 public:
  explicit YamlOptionsWriter(int indent) : indent_(static_cast<size_t>(indent), ' ') {}
  void field(const char* name, double& value, Range, const char*) { line(name, to_text(value)); }
  void field(const char* name, int& value, Range, const char*) { line(name, std::to_string(value)); }
  void field(const char* name, bool& value, const char*) { line(name, value ? "true" : "false"); }
  template <NamedEnum E>
  void field(const char* name, E& value, const char*) {
    line(name, to_string(value));
  }
  const std::string& str() const { return text_; }

 private:
  void line(const char* name, const std::string& value) { text_ += indent_ + name + ": " + value + "\n"; }
  std::string indent_, text_;
};

}  // namespace fringeslam
