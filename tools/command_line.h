// SPDX-License-Identifier: Apache-2.0
// The parser of the command line: CLI11 behind an interface that is quick to compile.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace CLI {
class App;
class Option;
}  // namespace CLI

namespace fringeslam::tools {

// The description of an option or flag in help texts.
struct OptionHelp {
  std::vector<std::string> names;     // such as -h and --help; of a positional its name alone
  std::string value;                  // placeholder of the value, such as INT; empty for flags
  std::vector<std::string> choices;   // permitted values; empty: any
  std::string range;                  // such as "0 to 1024"; empty: not limited
  std::string default_value;          // empty: none is shown
  std::string environment;            // variable that gives the value, or empty
  std::vector<std::string> needs;     // options that must also be given, sorted
  std::vector<std::string> excludes;  // options that must not be given as well, sorted
  std::string help;
  bool positional = false;
  bool required = false;
  bool repeated = false;        // accepts several values
  bool value_optional = false;  // may be given without its value
};

// Handle of an option or flag; its command line must outlive it. The methods that change the option return it.
class Option {
 public:
  explicit Option(CLI::Option* option) : option_(option) {}

  Option required() const;
  Option check_range(int low, int high) const;  // closed intervals
  Option check_range(double low, double high) const;
  Option check_non_negative() const;
  Option check_one_of(const std::vector<std::string>& values) const;
  Option check_existing_file() const;
  Option expected(int least, int most) const;  // number of values
  Option delimiter(char between_values) const;
  Option needs(Option other) const;
  Option excludes(Option other) const;
  // Sets the environment variable that gives the value unless the command line does.
  Option envname(const std::string& variable) const;
  Option type_name(const std::string& text) const;
  Option default_str(const std::string& text) const;  // also the value of an option that is given without one
  Option capture_default_str() const;                 // shows the variable's present value in the help text

  std::string get_name() const;
  size_t count() const;  // after parsing: how often the option was given

 private:
  CLI::Option* option_;
};

// Handle of a command or subcommand; its command line must outlive it.
class Command {
 public:
  explicit Command(CLI::App* app) : app_(app) {}

  Command add_subcommand(const std::string& name, const std::string& help) const;
  Command group(const std::string& heading) const;  // in the parent's help text; empty: hides this subcommand there
  void require_subcommand(int count) const;
  void footer(const std::string& text) const;  // printed after the help text

  // Add an option or flag whose value is written to `value` on parsing; a name without dashes is positional.
  Option add_option(const std::string& name, std::string& value, const std::string& help) const;
  Option add_option(const std::string& name, int& value, const std::string& help) const;
  Option add_option(const std::string& name, uint64_t& value, const std::string& help) const;
  Option add_option(const std::string& name, double& value, const std::string& help) const;
  Option add_option(const std::string& name, std::optional<int>& value, const std::string& help) const;
  Option add_option(const std::string& name, std::optional<uint64_t>& value, const std::string& help) const;
  Option add_option(const std::string& name, std::vector<std::string>& value, const std::string& help) const;
  Option add_option(const std::string& name, std::vector<double>& value, const std::string& help) const;
  // Calls `assign` with the value on parsing.
  Option add_option(const std::string& name, std::function<void(const std::string&)> assign,
                    const std::string& help) const;
  Option add_flag(const std::string& name, bool& value, const std::string& help) const;

  std::string get_name() const;
  std::string get_help() const;
  std::string get_footer() const;
  std::vector<OptionHelp> options() const;   // in the order of their addition, with --help
  std::vector<Command> subcommands() const;  // in the order of their addition
  bool hidden() const;                       // true if help texts leave it out
  bool parsed() const;                       // after parsing: true if the command was given

 private:
  CLI::App* app_;
};

// The command line of a program, with the flags --help, --version and --man. Subcommands also accept the program's options.
class CommandLine {
 public:
  CommandLine(const std::string& program, const std::string& help, const std::string& version);
  ~CommandLine();

  Command root() const { return Command(app_.get()); }

  // Assigns the arguments to the variables of the options. Returns the exit code if the program must end: 0 after
  // printing the help text, the version or the manual page, 2 after reporting invalid arguments.
  std::optional<int> parse(int argc, char** argv);

 private:
  std::unique_ptr<CLI::App> app_;
};

}  // namespace fringeslam::tools
