// SPDX-License-Identifier: Apache-2.0
#include "tools/settings.h"

#include "core/io/setting_groups.h"

namespace fringeslam::tools {

namespace {

template <class Options>
std::string group_yaml(const char* name, Options& options) {
  YamlOptionsWriter writer(2);
  options.describe(writer);
  return std::string(name) + ":\n" + writer.str();
}

}  // namespace

Settings parse_settings(const std::vector<std::string>& sets) {
  Settings settings;
  apply_settings(settings, sets);
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

std::string settings_help() { return groups_help(Settings()); }

}  // namespace fringeslam::tools
