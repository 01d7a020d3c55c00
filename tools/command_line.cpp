// SPDX-License-Identifier: Apache-2.0
#include "tools/command_line.h"

#include <CLI/CLI.hpp>
#include <cstdio>

namespace fringeslam::tools {

Option Option::required() const { return Option(option_->required()); }

Option Option::check_range(int low, int high) const { return Option(option_->check(CLI::Range(low, high))); }

Option Option::check_range(double low, double high) const { return Option(option_->check(CLI::Range(low, high))); }

Option Option::check_non_negative() const { return Option(option_->check(CLI::NonNegativeNumber)); }

Option Option::check_one_of(const std::vector<std::string>& values) const {
  return Option(option_->check(CLI::IsMember(values)));
}

Option Option::check_existing_file() const { return Option(option_->check(CLI::ExistingFile)); }

Option Option::expected(int least, int most) const { return Option(option_->expected(least, most)); }

Option Option::delimiter(char between_values) const { return Option(option_->delimiter(between_values)); }

Option Option::needs(Option other) const { return Option(option_->needs(other.option_)); }

Option Option::excludes(Option other) const { return Option(option_->excludes(other.option_)); }

Option Option::envname(const std::string& variable) const { return Option(option_->envname(variable)); }

Option Option::type_name(const std::string& text) const { return Option(option_->type_name(text)); }

Option Option::default_str(const std::string& text) const { return Option(option_->default_str(text)); }

Option Option::capture_default_str() const { return Option(option_->capture_default_str()); }

std::string Option::get_name() const { return option_->get_name(); }

size_t Option::count() const { return option_->count(); }

Command Command::add_subcommand(const std::string& name, const std::string& help) const {
  return Command(app_->add_subcommand(name, help));
}

Command Command::group(const std::string& heading) const { return Command(app_->group(heading)); }

void Command::require_subcommand(int count) const { app_->require_subcommand(count); }

void Command::footer(const std::string& text) const { app_->footer(text); }

Option Command::add_option(const std::string& name, std::string& value, const std::string& help) const {
  return Option(app_->add_option(name, value, help));
}

Option Command::add_option(const std::string& name, int& value, const std::string& help) const {
  return Option(app_->add_option(name, value, help));
}

Option Command::add_option(const std::string& name, uint64_t& value, const std::string& help) const {
  return Option(app_->add_option(name, value, help));
}

Option Command::add_option(const std::string& name, double& value, const std::string& help) const {
  return Option(app_->add_option(name, value, help));
}

Option Command::add_option(const std::string& name, std::optional<int>& value, const std::string& help) const {
  return Option(app_->add_option(name, value, help));
}

Option Command::add_option(const std::string& name, std::optional<uint64_t>& value, const std::string& help) const {
  return Option(app_->add_option(name, value, help));
}

Option Command::add_option(const std::string& name, std::vector<std::string>& value, const std::string& help) const {
  return Option(app_->add_option(name, value, help));
}

Option Command::add_option(const std::string& name, std::vector<double>& value, const std::string& help) const {
  return Option(app_->add_option(name, value, help));
}

Option Command::add_option(const std::string& name, std::function<void(const std::string&)> assign,
                           const std::string& help) const {
  return Option(app_->add_option_function<std::string>(name, std::move(assign), help));
}

Option Command::add_flag(const std::string& name, bool& value, const std::string& help) const {
  return Option(app_->add_flag(name, value, help));
}

std::string Command::get_name() const { return app_->get_name(); }

std::vector<Command> Command::subcommands() const {
  std::vector<Command> all;
  for (CLI::App* subcommand : app_->get_subcommands({})) all.emplace_back(subcommand);
  return all;
}

bool Command::parsed() const { return app_->parsed(); }

CommandLine::CommandLine(const std::string& program, const std::string& help, const std::string& version)
    : app_(std::make_unique<CLI::App>(help)) {
  app_->name(program);
  app_->set_version_flag("--version", version);
  app_->fallthrough();
}

CommandLine::~CommandLine() = default;

std::optional<int> CommandLine::parse(int argc, char** argv) {
  try {
    app_->parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    if (e.get_exit_code() == 0) return app_->exit(e);  // --help, --version
    const std::string program = app_->get_name();
    std::fprintf(stderr, "%s: %s; see %s --help\n", program.c_str(), e.what(), program.c_str());
    return 2;
  }
  return std::nullopt;
}

}  // namespace fringeslam::tools
