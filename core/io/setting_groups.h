// SPDX-License-Identifier: Apache-2.0
// `--set group.key=value` for any settings struct S whose for_each_group(visit) calls visit(name, options) for each
// options group.
#pragma once

#include <algorithm>
#include <cstdio>
#include <string>
#include <vector>

#include "core/io/yaml.h"

namespace fringeslam {

// Formats one help line per field.
class HelpWriter {
 public:
  explicit HelpWriter(const char* group) : group_(group) {}
  void field(const char* name, double& value, Range, const char* help) { line(name, to_text(value), help); }
  void field(const char* name, int& value, Range, const char* help) { line(name, std::to_string(value), help); }
  void field(const char* name, bool& value, const char* help) { line(name, value ? "true" : "false", help); }
  template <NamedEnum E>
  void field(const char* name, E& value, const char* help) {
    choice(name, to_string(value), choice_names<E>(), help);
  }
  const std::string& str() const { return text_; }

 private:
  void choice(const char* name, const char* value, const std::vector<std::string>& names, const char* help) {
    std::string list;
    for (const std::string& known : names) list += (list.empty() ? "" : ", ") + known;
    line(name, value, std::string(help) + " (" + list + ")");
  }
  void line(const char* name, const std::string& value, const std::string& help) {
    char head[128];
    std::snprintf(head, sizeof head, "  %-34s %-8s ", (std::string(group_) + "." + name).c_str(), value.c_str());
    text_ += head + help + "\n";
  }
  const char* group_;
  std::string text_;
};

// Applies settings of the form group.key=value. Throws Error for a malformed, unknown or out-of-range setting and
// suggests the closest known name.
template <class S>
void apply_settings(S& settings, const std::vector<std::string>& sets) {
  std::vector<std::string> names;
  settings.for_each_group([&](const char* name, auto&) { names.push_back(name); });
  for (const std::string& set : sets) {
    const std::string where = "--set " + set;
    const size_t equals = set.find('='), dot = set.find('.');
    if (equals == std::string::npos || dot == std::string::npos || dot > equals)
      throw Error(where + ": must look like stage.key=value, for example decode.min_modulation_dn=4");
    const std::string group = set.substr(0, dot);
    if (std::find(names.begin(), names.end(), group) == names.end()) {
      const std::string nearest = nearest_name(group, names);
      throw Error(where + ": unknown stage '" + group + "'" +
                  (nearest.empty() ? "; see --help" : "; did you mean '" + nearest + "'?"));
    }
    const YamlMap map = YamlMap::parse(set.substr(dot + 1, equals - dot - 1) + ": " + set.substr(equals + 1), where);
    settings.for_each_group([&](const char* name, auto& options) {
      if (group == name) map.read(options);
    });
    map.finish();
  }
}

// Formats the settings for --help, one line each: "decode.min_modulation_dn  3  minimum modulation …".
template <class S>
std::string groups_help(S settings) {
  std::string text = "Settings for --set, with their defaults:\n";
  settings.for_each_group([&](const char* name, auto& options) {
    HelpWriter writer(name);
    options.describe(writer);
    text += writer.str();
  });
  return text;
}

}  // namespace fringeslam
