// SPDX-License-Identifier: Apache-2.0
#include "tools/command_line.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <limits>
#include <string_view>

#include "core/types/error.h"
#include "tools/man_page.h"

namespace fringeslam::tools {

namespace {

std::vector<std::string> split(const std::string& text, const std::string& separator) {
  std::vector<std::string> parts;
  size_t begin = 0;
  for (size_t end; (end = text.find(separator, begin)) != std::string::npos; begin = end + separator.size())
    parts.push_back(text.substr(begin, end - begin));
  parts.push_back(text.substr(begin));
  return parts;
}

// Sorted by name: CLI11 sorts them by address.
std::vector<std::string> sorted_names(const std::set<CLI::Option*>& options) {
  std::vector<std::string> names;
  for (const CLI::Option* option : options) names.push_back(option->get_name());
  std::sort(names.begin(), names.end());
  return names;
}

OptionHelp help_of(const CLI::Option& option) {
  OptionHelp help;
  help.positional = option.get_positional();
  help.names = help.positional ? std::vector{option.get_name(true)} : split(option.get_name(false, true), ",");
  help.required = option.get_required();
  help.environment = option.get_envname();
  help.needs = sorted_names(option.get_needs());
  help.excludes = sorted_names(option.get_excludes());
  help.help = option.get_description();
  if (option.get_type_size() == 0) return help;  // flag
  help.default_value = option.get_default_str();
  help.repeated = option.get_expected_max() > 1;
  help.value_optional = option.get_expected_min() == 0;
  // CLI11 appends the checks to the type: "INT:INT in [0 - 1024]", "TEXT:{none,se3}", "TEXT:FILE".
  const std::vector<std::string> type = split(option.get_type_name(), ":");
  help.value = type.front();
  for (size_t i = 1; i < type.size(); ++i) {
    const std::string& check = type[i];
    if (check.starts_with("{")) help.choices = split(check.substr(1, check.size() - 2), ",");
    if (const size_t open = check.find('['); open != std::string::npos) {
      const std::vector<std::string> limits = split(check.substr(open + 1, check.size() - open - 2), " - ");
      help.range = limits.front() + " to " + limits.back();
    }
  }
  return help;
}

// Accepts decimal digits and rewrites them in their shortest form, because CLI11 takes a leading zero for octal and 0x for
// hexadecimal.
template <class Integer>
CLI::Validator decimal() {
  const auto shorten = [](std::string& text) {
    Integer value = 0;
    const auto [end, failure] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (failure != std::errc() || end != text.data() + text.size())
      return "'" + text + "' is not a whole number from " + std::to_string(std::numeric_limits<Integer>::min()) +
             " to " + std::to_string(std::numeric_limits<Integer>::max());
    text = std::to_string(value);
    return std::string();
  };
  return CLI::Validator(shorten, "");
}

constexpr const char* kEmptyValue = "is empty; give it a value or leave it out";

// Throws if `--out=` is given, for which CLI11 would use the next argument.
void refuse_equals_without_value(int argc, char** argv) {
  for (int i = 1; i < argc && std::string_view(argv[i]) != "--"; ++i) {
    const std::string_view word = argv[i];
    if (word.starts_with("--") && word.find('=') == word.size() - 1)
      throw CLI::ValidationError(std::string(word.substr(0, word.size() - 1)), kEmptyValue);
  }
}

// Throws if a value is empty, such as that of a script's unset variable: the verbs would take it for one that is not given.
void refuse_empty_values(const CLI::App& app) {
  for (const CLI::Option* option : app.get_options()) {
    const std::vector<std::string>& values = option->results();
    if (option->get_type_size() != 0 && std::find(values.begin(), values.end(), "") != values.end())
      throw CLI::ValidationError(option->get_name(), kEmptyValue);
  }
  for (const CLI::App* subcommand : app.get_subcommands()) refuse_empty_values(*subcommand);
}

}  // namespace

Option Option::required() const { return Option(option_->required()); }

Option Option::check_range(int low, int high) const { return Option(option_->check(CLI::Range(low, high))); }

Option Option::check_range(double low, double high) const {
  // CLI::Range accepts what it cannot compare.
  const auto is_number = [](const std::string& text) {
    double value = 0;
    return CLI::detail::lexical_cast(text, value) && std::isnan(value) ? "'" + text + "' is not a number"
                                                                       : std::string();
  };
  return Option(option_->check(CLI::Range(low, high))->check(CLI::Validator(is_number, "")));
}

Option Option::check_non_negative() const { return Option(option_->check(decimal<uint64_t>().description("NUMBER"))); }

Option Option::check_one_of(const std::vector<std::string>& values) const {
  return Option(option_->check(CLI::IsMember(values)));
}

Option Option::check_existing_file() const {
  // An empty name is refused like that of any other option.
  const auto check = [](const std::string& text) { return text.empty() ? std::string() : CLI::ExistingFile(text); };
  return Option(option_->check(CLI::Validator(check, "FILE")));
}

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
  return Option(app_->add_option(name, value, help)->transform(decimal<int>()));
}

Option Command::add_option(const std::string& name, uint64_t& value, const std::string& help) const {
  return Option(app_->add_option(name, value, help)->transform(decimal<uint64_t>()));
}

Option Command::add_option(const std::string& name, double& value, const std::string& help) const {
  return Option(app_->add_option(name, value, help));
}

Option Command::add_option(const std::string& name, std::optional<int>& value, const std::string& help) const {
  return Option(app_->add_option(name, value, help)->transform(decimal<int>()));
}

Option Command::add_option(const std::string& name, std::optional<uint64_t>& value, const std::string& help) const {
  return Option(app_->add_option(name, value, help)->transform(decimal<uint64_t>()));
}

Option Command::add_option(const std::string& name, std::vector<std::string>& value, const std::string& help) const {
  CLI::Option* const option = app_->add_option(name, value, help);
  // One value each time, so that the argument behind it is not one more.
  if (name.starts_with('-')) option->allow_extra_args(false);
  return Option(option);
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

std::string Command::get_help() const { return app_->get_description(); }

std::string Command::get_footer() const { return app_->get_footer(); }

std::vector<OptionHelp> Command::options() const {
  std::vector<OptionHelp> all;
  for (const CLI::Option* option : app_->get_options()) {
    if (!option->get_group().empty()) all.push_back(help_of(*option));
  }
  return all;
}

bool Command::hidden() const { return app_->get_group().empty(); }

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
  const auto print_man_page = [this, version] { throw CLI::CallForVersion(man_page(root(), version), 0); };
  app_->add_flag_callback("--man", print_man_page, "Print the manual page, for `man -l -`");
  app_->fallthrough();
}

CommandLine::~CommandLine() = default;

std::optional<int> CommandLine::parse(int argc, char** argv) {
  try {
    refuse_equals_without_value(argc, argv);
    app_->parse(argc, argv);
    refuse_empty_values(*app_);
  } catch (const CLI::ParseError& e) {
    if (e.get_exit_code() == 0) return app_->exit(e);  // --help, --version, --man
    const std::string program = app_->get_name();
    std::fprintf(stderr, "%s: %s; see %s --help\n", program.c_str(), single_line(e.what()).c_str(), program.c_str());
    return 2;
  }
  return std::nullopt;
}

}  // namespace fringeslam::tools
