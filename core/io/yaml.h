// SPDX-License-Identifier: Apache-2.0
// Strict reading of YAML files: every error says file:line, and a key that nobody asked for is an
// error that names the nearest key that was asked for.
//
//   YamlMap file = YamlMap::load("rig.yaml");
//   const int width = file.map("camera").integer("width_px", {1, 16384});
//   file.finish();   // refuses unknown keys, here and in every map below
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/types/error.h"
#include "core/types/options.h"
#include "core/types/pose.h"

namespace fringeslam {

// Random numbers by address, for the distributions that may stand in place of numbers.
class Draws {
 public:
  virtual ~Draws() = default;
  virtual double uniform(uint64_t address, uint32_t attempt) const = 0;  // in (0, 1)
  virtual double normal(uint64_t address, uint32_t attempt) const = 0;   // standard
};

class YamlMap {
 public:
  static YamlMap load(const std::filesystem::path& file);
  // `name` stands for the file name in errors.
  static YamlMap parse(const std::string& text, const std::string& name);

  bool has(const std::string& key) const;
  double number(const std::string& key, Range range) const;
  double number_or(const std::string& key, double fallback, Range range) const;
  int integer(const std::string& key, Range range) const;
  int integer_or(const std::string& key, int fallback, Range range) const;
  // A whole number from 0 to 2^64 - 1, to the last digit.
  uint64_t seed(const std::string& key) const;
  bool boolean_or(const std::string& key, bool fallback) const;
  std::string text(const std::string& key) const;
  std::string text_or(const std::string& key, const std::string& fallback) const;
  std::string choice(const std::string& key, const std::vector<std::string>& choices) const;
  // A choice on which depends what else is read: throws even while errors are collected, to be caught by attempt().
  std::string kind(const std::string& key, const std::vector<std::string>& choices) const;
  // `count` 0 accepts any length but none.
  std::vector<double> numbers(const std::string& key, size_t count, Range range) const;
  Eigen::Vector3d vector3(const std::string& key, Range range) const;
  Eigen::Vector3d vector3_or(const std::string& key, const Eigen::Vector3d& fallback, Range range) const;
  // {translation_m: [x, y, z], rotation_deg: [alpha, beta, gamma]}, or rotation_matrix: 9 numbers by row.
  Pose pose(const std::string& key) const;
  Pose as_pose() const;  // this map itself

  // A list of texts, or one text for a list of one.
  std::vector<std::string> texts(const std::string& key) const;

  YamlMap map(const std::string& key) const;
  std::vector<YamlMap> maps(const std::string& key) const;
  std::vector<std::string> keys() const;

  // Reads the fields that are present into an options struct (core/types/options.h).
  template <class Options>
  void read(Options& options) const {
    FieldReader reader{*this};
    options.describe(reader);
  }

  // "file:line: message", to be thrown for what is wrong with a key or with the whole map.
  Error error(const std::string& key, const std::string& message) const;
  Error error(const std::string& message) const;
  // The folder of the file, against which paths in it are resolved.
  std::filesystem::path folder() const;
  std::filesystem::path path(const std::string& key) const;
  std::vector<std::filesystem::path> paths(const std::string& key) const;
  // The path of a file that is there: neither a folder nor a device.
  std::filesystem::path file(const std::string& key) const;

  void finish() const;

  // Replaces the value at a path such as light.ambient_lux or objects.2.count by a YAML value; maps on the way that are
  // missing are made. Throws Error when something on the way has no such entry.
  void set(const std::string& path, const std::string& value);
  // This map with `changes` over it, except some of their keys: maps come together, everything else, and poses, is
  // replaced, in this map too. What is drawn and what errors do goes by `changes`, whose other keys count as read.
  YamlMap changed_by(const YamlMap& changes, const std::vector<std::string>& except) const;

  // From now on what is wrong with this map, or with one below it, is added to `errors` and a permitted value stands in
  // for it, so that one reading finds all that is wrong.
  void collect_errors(std::vector<std::string>& errors);
  // Runs `read` on this map; while errors are collected, what it throws is added to them, unless others came up in it
  // before, of which it may be a consequence. The rest of the map is then not looked at.
  void attempt(const std::function<void()>& read) const;
  // Throws it, or adds it to those that are collected.
  void report(const Error& error) const;

  // From now on a number in this map, or below it, may be {uniform: [a, b]}, {log_uniform: [a, b]}, {normal: [mean,
  // sigma]} (truncated to what is permitted) or {choice: [...]}, and a text a choice. What is drawn depends on the
  // place in the file and nothing else.
  // `place` is put before the places in this file: that of the file itself among several.
  void draw_from(std::shared_ptr<const Draws> draws, const std::string& place = "");
  // These keys of the map as YAML, with what was drawn in place of distributions; what was read as a path is written
  // relative to `folder`.
  std::string dump(const std::vector<std::string>& keys, const std::filesystem::path& folder) const;

 private:
  struct FieldReader {
    const YamlMap& map;
    void field(const char* name, double& value, Range range, const char*) { value = map.number_or(name, value, range); }
    void field(const char* name, int& value, Range range, const char*) { value = map.integer_or(name, value, range); }
    void field(const char* name, bool& value, const char*) { value = map.boolean_or(name, value); }
    void field(const char* name, std::string& value, const std::vector<std::string>& choices, const char*) {
      if (map.has(name)) value = map.choice(name, choices);
    }
  };
  struct Node;
  explicit YamlMap(std::shared_ptr<Node> node);
  YamlMap absent_map(const std::string& key) const;
  std::shared_ptr<Node> node_;
};

// A text as a YAML scalar that reads back as the same text.
std::string yaml_quoted(const std::string& text);

// Writes `describe()`d options as the lines of a YAML map.
class YamlOptionsWriter {
 public:
  explicit YamlOptionsWriter(int indent) : indent_(static_cast<size_t>(indent), ' ') {}
  void field(const char* name, double& value, Range, const char*) { line(name, to_text(value)); }
  void field(const char* name, int& value, Range, const char*) { line(name, std::to_string(value)); }
  void field(const char* name, bool& value, const char*) { line(name, value ? "true" : "false"); }
  void field(const char* name, std::string& value, const std::vector<std::string>&, const char*) { line(name, value); }
  const std::string& str() const { return text_; }

 private:
  void line(const char* name, const std::string& value) { text_ += indent_ + name + ": " + value + "\n"; }
  std::string indent_, text_;
};

}  // namespace fringeslam
