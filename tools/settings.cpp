// SPDX-License-Identifier: Apache-2.0
#include "tools/settings.h"

#include <cstdio>
#include <map>

#include "core/rig/yaml.h"

namespace fringeslam::tools {

namespace {

std::vector<std::string> group_names() {
  std::vector<std::string> names;
  Settings().for_each_group([&](const char* name, auto&) { names.push_back(name); });
  return names;
}

// Writes one help line a field.
class HelpWriter {
 public:
  explicit HelpWriter(const char* group) : group_(group) {}
  void field(const char* name, double& value, Range, const char* help) { line(name, to_text(value), help); }
  void field(const char* name, int& value, Range, const char* help) { line(name, std::to_string(value), help); }
  void field(const char* name, bool& value, const char* help) { line(name, value ? "true" : "false", help); }
  void field(const char* name, std::string& value, const std::vector<std::string>&, const char* help) {
    line(name, value, help);
  }
  const std::string& str() const { return text_; }

 private:
  void line(const char* name, const std::string& value, const char* help) {
    char buffer[256];
    std::snprintf(buffer, sizeof buffer, "  %-34s %-8s %s\n", (std::string(group_) + "." + name).c_str(), value.c_str(),
                  help);
    text_ += buffer;
  }
  const char* group_;
  std::string text_;
};

template <class Options>
std::string group_yaml(const char* name, Options& options) {
  YamlOptionsWriter writer(2);
  options.describe(writer);
  return std::string(name) + ":\n" + writer.str();
}

}  // namespace

Settings parse_settings(const std::vector<std::string>& sets) {
  Settings settings;
  for (const std::string& set : sets) {
    const std::string where = "--set " + set;
    const size_t equals = set.find('='), dot = set.find('.');
    if (equals == std::string::npos || dot == std::string::npos || dot > equals)
      throw Error(where + ": must look like stage.key=value, for example decode.min_modulation_dn=4");
    const std::string group = set.substr(0, dot);
    const std::vector<std::string> names = group_names();
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
  settings.render.check();
  return settings;
}

std::string pipeline_yaml(Settings settings) {
  std::string text;
  settings.pipeline.for_each_stage([&](const char* name, auto& options) { text += group_yaml(name, options); });
  return text;
}

std::string render_yaml(Settings settings) { return group_yaml("render", settings.render); }

std::string mesh_yaml(Settings settings) { return group_yaml("mesh", settings.mesh); }

std::string settings_help() {
  std::string text = "Settings for --set, with their defaults:\n";
  Settings().for_each_group([&](const char* name, auto& options) {
    HelpWriter writer(name);
    options.describe(writer);
    text += writer.str();
  });
  return text;
}

}  // namespace fringeslam::tools
