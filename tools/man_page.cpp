// SPDX-License-Identifier: Apache-2.0
#include "tools/man_page.h"

#include <algorithm>
#include <cctype>
#include <sstream>

namespace fringeslam::tools {

namespace {

// Escapes text for troff: backslashes; hyphens, so that names can be copied; control characters at the start of a line.
std::string escaped(const std::string& text) {
  std::string out;
  for (const char c : text) {
    if (c == '\\')
      out += "\\e";
    else if (c == '-')
      out += "\\-";
    else if (c == '\n')
      out += ' ';
    else
      out += c;
  }
  return (out.starts_with('.') || out.starts_with('\'') ? "\\&" : "") + out;
}

std::string bold(const std::string& text) { return "\\fB" + escaped(text) + "\\fR"; }
std::string italic(const std::string& text) { return "\\fI" + escaped(text) + "\\fR"; }

// An argument of a macro; troff writes a quotation mark within one as two.
std::string quoted_argument(const std::string& text) {
  std::string out = "\"";
  for (const char c : escaped(text)) out += c == '"' ? "\"\"" : std::string(1, c);
  return out + "\"";
}

std::string upper(std::string text) {
  for (char& c : text) c = static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
  return text;
}

template <class Words, class Format>
std::string joined(const Words& words, const std::string& separator, Format format) {
  std::string text;
  for (const auto& word : words) text += (text.empty() ? "" : separator) + format(word);
  return text;
}

// Ends help texts, which have no full stop, as sentences.
std::string sentence(const std::string& text) {
  if (text.empty() || text.ends_with('.') || text.ends_with('?') || text.ends_with('!')) return text;
  return text + ".";
}

std::string value_of(const OptionHelp& option) {
  std::string value = option.choices.empty() ? italic(option.value) : joined(option.choices, "|", bold);
  if (option.repeated) value += "...";
  return option.value_optional && !option.value.starts_with('[') ? "[" + value + "]" : value;
}

// A paragraph with a hanging tag.
std::string tagged(const std::string& tag, const std::string& text) { return ".TP\n" + tag + "\n" + text + "\n"; }

std::string option_paragraph(const OptionHelp& option) {
  std::string tag = joined(option.names, ", ", bold);
  if (option.positional) {
    if (option.repeated) tag += "...";
  } else if (!option.value.empty()) {
    tag += " " + value_of(option);
  }
  std::string text = escaped(sentence(option.help));
  if (option.required && !option.positional) text += " Required.";
  if (!option.range.empty()) text += " " + escaped("Range: " + option.range + ".");
  if (!option.default_value.empty()) text += " Default: " + bold(option.default_value) + ".";
  if (!option.environment.empty()) text += " Environment variable: " + bold(option.environment) + ".";
  if (!option.needs.empty()) text += " Requires " + joined(option.needs, ", ", bold) + ".";
  if (!option.excludes.empty()) text += " Excludes " + joined(option.excludes, ", ", bold) + ".";
  return tagged(tag, text);
}

std::string option_paragraphs(const Command& command) {
  std::string positionals, others;
  for (const OptionHelp& option : command.options())
    (option.positional ? positionals : others) += option_paragraph(option);
  return positionals + others;
}

// Lines "  group.key  default  meaning" become paragraphs, other lines text.
std::string footer_paragraphs(const std::string& footer) {
  std::istringstream lines(footer);
  std::string text;
  for (std::string line; std::getline(lines, line);) {
    if (line.empty()) continue;
    std::istringstream words(line);
    std::string key, value, meaning;
    if (line.starts_with("  ") && words >> key >> value >> std::ws && std::getline(words, meaning))
      text += tagged(bold(key) + "=" + italic(value), escaped(sentence(meaning)));
    else
      text += ".PP\n" + escaped(line) + "\n";
  }
  return text;
}

// The command with its arguments, as typed.
std::string usage(const std::string& words, const Command& command) {
  std::string text = bold(words);
  const std::vector<OptionHelp> options = command.options();
  for (const OptionHelp& option : options) {
    if (option.required && !option.positional) text += " " + bold(option.names.back()) + " " + value_of(option);
  }
  if (std::any_of(options.begin(), options.end(), [](const OptionHelp& o) { return !o.positional && !o.required; }))
    text += " [" + italic("options") + "]";
  for (const OptionHelp& option : options) {
    if (!option.positional) continue;
    const std::string name = italic(option.names.back()) + (option.repeated ? "..." : "");
    text += option.required ? " " + name : " [" + name + "]";
  }
  return text;
}

// The sections of a command and of its subcommands; `words` is the command as typed.
std::string command_sections(const std::string& words, const Command& command) {
  const std::vector<Command> subcommands = command.subcommands();
  std::string text = ".SS " + quoted_argument(words) + "\n" + escaped(sentence(command.get_help())) + "\n";
  if (subcommands.empty()) {
    text +=
        ".PP\n" + usage(words, command) + "\n" + option_paragraphs(command) + footer_paragraphs(command.get_footer());
  }
  for (const Command& subcommand : subcommands) {
    if (!subcommand.hidden()) text += command_sections(words + " " + subcommand.get_name(), subcommand);
  }
  return text;
}

}  // namespace

std::string man_page(Command root, const std::string& version) {
  const std::string program = root.get_name(), summary = root.get_help();
  // The part of NAME after the hyphen starts in the middle of a sentence: without the program's own name.
  const size_t colon = summary.find(": ");
  const std::string purpose = colon == std::string::npos ? summary : summary.substr(colon + 2);
  std::string text = ".\\\" Generated by " + program + " --man.\n";
  text += ".TH " + upper(program) + " 1 \"\" " + quoted_argument(version) + " \"User Commands\"\n";
  text += ".SH NAME\n" + escaped(program) + " \\- " + escaped(purpose) + "\n";
  text += ".SH SYNOPSIS\n" + bold(program) + " [" + italic("options") + "] " + italic("command") + " [" +
          italic("arguments") + "]\n";
  text += ".SH DESCRIPTION\n" + escaped(sentence(summary)) + "\n.PP\nThe commands are:\n";
  for (const Command& command : root.subcommands()) {
    if (!command.hidden()) text += tagged(bold(command.get_name()), escaped(sentence(command.get_help())));
  }
  text += ".SH OPTIONS\nThese options precede or follow the command.\n" + option_paragraphs(root);
  text += ".SH COMMANDS\n";
  for (const Command& command : root.subcommands()) {
    if (!command.hidden()) text += command_sections(program + " " + command.get_name(), command);
  }
  text += ".SH EXIT STATUS\n";
  text += tagged("0", "Success.");
  text += tagged("1", "The command finished, but reports a failure, such as a run without a single pose.");
  text +=
      tagged("2", "Invalid arguments, files or devices; one line on standard error says what, where and what to do.");
  return text;
}

}  // namespace fringeslam::tools
