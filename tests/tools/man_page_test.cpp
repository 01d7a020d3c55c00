// SPDX-License-Identifier: Apache-2.0
// Manual page and completion against `--help`, which is formatted by other code.
#include <gmock/gmock.h>

#include <regex>
#include <sstream>

#include "tests/tools/child.h"

namespace fringeslam {
namespace {

using test::run_successfully;
using testing::HasSubstr;

// Output of --help for one command.
struct CommandHelp {
  std::vector<std::string> words;  // without the program
  std::string text;
  std::vector<std::string> options, positionals, settings, subcommands;
};

CommandHelp help_of(const std::vector<std::string>& words) {
  std::vector<std::string> arguments = words;
  arguments.push_back("--help");
  CommandHelp command{words, run_successfully(arguments).out, {}, {}, {}, {}};
  std::istringstream lines(command.text);
  std::string section;
  for (std::string line; std::getline(lines, line);) {
    std::smatch match;
    if (!line.empty() && line[0] != ' ') section = line.substr(0, line.find(' '));
    if (!std::regex_search(line, match, std::regex("^  (?:-h,)?([a-z-][A-Za-z_.0-9-]*)"))) continue;
    if (section == "Options:") command.options.push_back(match[1]);
    if (section == "Positionals:") command.positionals.push_back(match[1]);
    if (section == "Subcommands:") command.subcommands.push_back(match[1]);
    if (section == "Settings") command.settings.push_back(match[1]);
  }
  return command;
}

// The commands that --help of a command lists, recursively, after the command itself.
std::vector<CommandHelp> commands_below(const std::vector<std::string>& words) {
  std::vector<CommandHelp> all = {help_of(words)};
  for (const std::string& name : std::vector<std::string>(all[0].subcommands)) {
    std::vector<std::string> longer = words;
    longer.push_back(name);
    for (const CommandHelp& command : commands_below(longer)) all.push_back(command);
  }
  return all;
}

// Read once for all tests, because each start of the program takes a while.
const std::vector<CommandHelp>& all_commands() {
  static const std::vector<CommandHelp> all = commands_below({});
  return all;
}

std::string line_of(const std::vector<std::string>& words) {
  std::string line = "fringeslam";
  for (const std::string& word : words) line += " " + word;
  return line;
}

// The page as text without formatting: fonts removed, escaped characters replaced.
std::string plain_text(const std::string& page) {
  const std::string fonts = std::regex_replace(page, std::regex("\\\\f[BIR]|\\\\&"), "");
  return std::regex_replace(std::regex_replace(fonts, std::regex("\\\\-"), "-"), std::regex("\\\\e"), "\\");
}

// The part of the page about one command, from its heading to the next.
std::string section_of(const std::string& text, const CommandHelp& command) {
  const std::string heading = command.words.empty() ? ".SH OPTIONS\n" : ".SS \"" + line_of(command.words) + "\"\n";
  const size_t begin = text.find(heading);
  if (begin == std::string::npos) return "";
  return text.substr(begin, text.find("\n.S", begin + heading.size()) - begin);
}

TEST(ManPage, DescribesEveryCommandOptionAndSetting) {
  const std::string text = plain_text(run_successfully({"--man"}).out);
  int options = 0, settings = 0;
  const std::vector<CommandHelp>& commands = all_commands();
  for (const CommandHelp& command : commands) {
    const std::string section = section_of(text, command), line = line_of(command.words);
    ASSERT_NE(section, "") << line;
    if (!command.subcommands.empty() && !command.words.empty()) continue;
    for (const std::string& option : command.options) {
      const std::regex tag("\n\\.TP\n(-h, )?" + option + "[ \n]");
      EXPECT_TRUE(std::regex_search(section, tag)) << line << " " << option;
    }
    for (const std::string& name : command.positionals)
      EXPECT_TRUE(std::regex_search(section, std::regex("\n\\.TP\n" + name + "(\\.\\.\\.)?\n"))) << line << " " << name;
    for (const std::string& name : command.settings) EXPECT_THAT(section, HasSubstr("\n.TP\n" + name + "=")) << line;
    options += static_cast<int>(command.options.size());
    settings += static_cast<int>(command.settings.size());
  }
  // Help texts without sections would pass everything above.
  EXPECT_GT(commands.size(), 30u);
  EXPECT_GT(options, 150);
  EXPECT_GT(settings, 150);
}

TEST(ManPage, IsFormattedWithoutWarnings) {
  const test::TempFolder temp;
  test::write_bytes(temp / "fringeslam.1", run_successfully({"--man"}).out);
  const auto shell = [&](const std::string& command) {
    return std::system(("cd " + test::quoted(temp.path().string()) + " && { " + command + "; } >out 2>&1").c_str());
  };
  if (shell("command -v groff") != 0) GTEST_SKIP() << "groff is not installed";
  EXPECT_EQ(shell("LC_ALL=C.UTF-8 groff -man -Tutf8 -ww -z -rLL=80n fringeslam.1"), 0);
  EXPECT_EQ(test::read_bytes(temp / "out"), "");
}

std::string joined(const std::vector<std::string>& words) {
  std::string text;
  for (const std::string& word : words) text += (text.empty() ? "" : " ") + word;
  return text;
}

// Returns the output of a shell script; `before` runs before the completion function is loaded. The program is found in
// `folder`.
std::string shell_output(const std::string& shell, const std::string& before, const std::string& script,
                         const test::fs::path& folder) {
  const test::TempFolder temp;
  const std::string all = "PATH=" + test::quoted(folder.string()) + ":$PATH; " + before +
                          "source " FRINGESLAM_SOURCE_DIR "/tools/completion/fringeslam; " + script;
  const std::string out = (temp / "out").string();
  EXPECT_EQ(std::system((shell + " -c " + test::quoted(all) + " > " + test::quoted(out)).c_str()), 0);
  return test::read_bytes(out);
}

// Script for bash that prints, on a line, what is proposed for the last of these words.
std::string completion_of(const std::string& words) {
  return "COMP_WORDS=(" + words +
         "); COMP_CWORD=$((${#COMP_WORDS[@]} - 1)); COMPREPLY=(); _fringeslam; echo \"${COMPREPLY[*]}\"\n";
}

// A program that prints the help texts in place of the real one, at once.
class Completion : public testing::Test {
 protected:
  void SetUp() override {
    std::string program = "#!/bin/sh\ncase \"$*\" in\n";
    for (const CommandHelp& command : all_commands()) {
      const test::fs::path file = temp_ / (joined(command.words) + ".txt");
      test::write_bytes(file, command.text);
      // The real program ignores a positional argument before --help.
      for (const std::string argument : {"", "x", "scenes/loop", "boxes_and_foam"}) {
        std::vector<std::string> words = command.words;
        if (!argument.empty()) words.push_back(argument);
        words.push_back("--help");
        program += test::quoted(joined(words)) + "|";
      }
      program.back() = ')';
      program += " exec cat " + test::quoted(file.string()) + " ;;\n";
    }
    test::write_bytes(temp_ / "fringeslam", program + "esac\nexit 2\n");
    test::fs::permissions(temp_ / "fringeslam", test::fs::perms::owner_all);
  }
  // Returns what bash proposes for the last word of each line.
  std::vector<std::string> completed(const std::vector<std::string>& lines) const {
    std::string script;
    for (const std::string& line : lines) script += completion_of(line);
    std::istringstream out(shell_output("bash", "", script, temp_.path()));
    std::vector<std::string> proposed;
    for (std::string line; std::getline(out, line);) proposed.push_back(line);
    return proposed;
  }
  test::TempFolder temp_;
};

TEST_F(Completion, ProposesEveryCommandAndOption) {
  std::vector<std::string> lines, expected;
  for (const CommandHelp& command : all_commands()) {
    lines.push_back(line_of(command.words) + " --");
    expected.push_back(joined(command.options));
    if (command.subcommands.empty()) continue;
    lines.push_back(line_of(command.words) + " ''");
    expected.push_back(joined(command.subcommands));
  }
  EXPECT_EQ(completed(lines), expected);
  EXPECT_GT(lines.size(), 30u);
}

TEST_F(Completion, ProposesSettingsAndValues) {
  const std::vector<std::pair<std::string, std::string>> cases = {
      {"fringeslam eval", "evaluate"},
      {"fringeslam scene pre", "preview"},
      {"fringeslam run scenes/loop --no-r", "--no-report"},
      {"fringeslam run boxes_and_foam --no-r", "--no-report"},
      {"fringeslam --quiet --threads 2 run scenes/loop --no-r", "--no-report"},
      {"fringeslam scene check x --se", "--seed"},
      {"fringeslam run x --set icp.st", "icp.stride="},
      {"fringeslam calibrate rig x --set calibration.wi", "calibration.window="},
      {"fringeslam capture --live --set icp.st", "icp.stride="},
      {"fringeslam patterns --axis ''", "columns rows both"},
      {"fringeslam score x --align s", "se3 sim3"},
      {"fringeslam run nothing-like", ""}};
  std::vector<std::string> lines, expected;
  for (const auto& [line, proposal] : cases) lines.push_back(line), expected.push_back(proposal);
  EXPECT_EQ(completed(lines), expected);
}

TEST_F(Completion, CallsTheProgram) {
  const test::fs::path folder = test::fs::path(FRINGESLAM_PROGRAM).parent_path();
  EXPECT_EQ(shell_output("bash", "", completion_of("fringeslam run boxes_and_foam --no-r"), folder), "--no-report\n");
}

// zsh calls the same function with its emulation of bash's completion, which selects the matching words itself.
TEST_F(Completion, WorksInZsh) {
  if (std::system("command -v zsh >/dev/null") != 0) GTEST_SKIP() << "zsh is not installed";
  const auto proposed = [&](const std::string& words) {
    return shell_output("zsh -f", "autoload -U +X compinit bashcompinit && compinit -D -u && bashcompinit; ",
                        "complete_words() { emulate -L sh; setopt kshglob noshglob braceexpand; COMP_WORDS=(\"$@\"); "
                        "COMP_CWORD=$(($# - 1)); _fringeslam; echo \" ${COMPREPLY[*]} \"; }; complete_words " +
                            words,
                        temp_.path());
  };
  EXPECT_THAT(proposed("fringeslam scene pre"), HasSubstr(" preview "));
  EXPECT_THAT(proposed("fringeslam --threads 2 run scenes/loop --no-r"), HasSubstr(" --no-report "));
  EXPECT_THAT(proposed("fringeslam run x --set icp.st"), HasSubstr(" icp.stride= "));
}

}  // namespace
}  // namespace fringeslam
