// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/console/manual.h"

#include <sstream>
#include <string_view>
#include <vector>

namespace bendloop::host {
namespace {

// For roff: it takes backslashes, and dots and quotes that begin a line, for its own, and makes
// hyphens of minus signs.
std::string Roff(std::string_view text) {
  std::string out;
  for (const char c : text) {
    if (out.empty() && (c == '.' || c == '\'')) out += "\\&";
    if (c == '\\') {
      out += "\\e";
    } else if (c == '-') {
      out += "\\-";
    } else {
      out += c == '\n' ? ' ' : c;
    }
  }
  return out;
}

std::vector<std::string> Lines(const std::string& text) {
  std::vector<std::string> lines;
  std::istringstream in(text);
  for (std::string line; std::getline(in, line);) lines.push_back(line);
  return lines;
}

bool IsSet(const std::string& line) { return !line.empty() && line[0] == ' '; }

// Text as a --help has it: paragraphs, headings above indented lists, and these lists, whose
// columns stay as they are.
std::string Prose(const std::string& text) {
  const std::vector<std::string> lines = Lines(text);
  std::string out;
  bool in_list = false;
  for (std::size_t i = 0; i < lines.size(); ++i) {
    const std::string& line = lines[i];
    if (in_list && !IsSet(line)) {
      out += ".fi\n";
      in_list = false;
    }
    const bool begins = i == 0 || lines[i - 1].empty();
    if (line.empty()) {
      if (!out.empty()) out += ".PP\n";
    } else if (IsSet(line)) {
      if (!in_list) out += ".nf\n";
      in_list = true;
      out += Roff(line) + "\n";
    } else if (begins && i + 1 < lines.size() && IsSet(lines[i + 1])) {
      out += ".SS " + Roff(line.substr(0, line.find_last_not_of(':') + 1)) + "\n";
    } else {
      out += Roff(line) + "\n";
    }
  }
  return out + (in_list ? ".fi\n" : "");
}

// For the NAME section, which lists of manual pages show: the first sentence, without the name.
std::string InShort(const CLI::App& app) {
  std::string text = app.get_description();
  const std::string own = app.get_name() + ": ";
  if (text.rfind(own, 0) == 0) text = text.substr(own.size());
  for (const char* end : {". ", ".\n", ": ", "\n"}) text = text.substr(0, text.find(end));
  return text;
}

std::string OptionEntries(const CLI::App& app) {
  const CLI::Formatter words;  // as --help takes them
  std::string out;
  for (const CLI::Option* option : app.get_options()) {
    if (option->get_group().empty()) continue;
    const bool positional = option->get_positional();
    out += ".TP\n\\fB" + Roff(words.make_option_name(option, positional)) + "\\fR" +
           Roff(words.make_option_opts(option)) + "\n" + Roff(option->get_description()) + "\n";
  }
  return out;
}

std::string UsageLine(const CLI::App& app, const std::string& name) {
  const std::string text = CLI::Formatter().make_usage(&app, name);
  const std::size_t begin = text.find_first_not_of('\n');
  const std::string before = "Usage: ";
  std::string usage = text.substr(begin, text.find_last_not_of('\n') + 1 - begin);
  if (usage.rfind(before, 0) == 0) usage = usage.substr(before.size());
  return ".B " + Roff(usage) + "\n";
}

std::vector<const CLI::App*> CommandsOf(const CLI::App& app) {
  return app.get_subcommands([](const CLI::App*) { return true; });
}

// The commands of `app`, of which those of `bendloop` have pages of their own.
std::string CommandEntries(const CLI::App& app, const std::string& name, bool have_pages) {
  std::string out;
  for (const CLI::App* command : CommandsOf(app)) {
    out += ".TP\n.B " + Roff(command->get_name()) + "\n" + Roff(command->get_description()) + "\n";
    if (!have_pages) {
      out += ".RS\n.PP\n" + UsageLine(*command, name + " " + command->get_name()) +
             OptionEntries(*command) + ".RE\n";
    }
  }
  return out;
}

// `path`: the words that one types, "bendloop demo".
std::string Page(const CLI::App& app, const std::string& path, char section,
                 const std::string& version) {
  std::string name = path;
  for (char& c : name) c = c == ' ' ? '-' : c;
  const bool is_program = name == path;
  std::string out = ".TH " + Roff(name) + " " + section + " \"\" \"" + Roff(version) + "\"\n";
  out += ".SH NAME\n" + Roff(name) + " \\- " + Roff(InShort(app)) + "\n";
  out += ".SH SYNOPSIS\n" + UsageLine(app, path);
  out += ".SH DESCRIPTION\n" + Prose(app.get_description());
  if (const auto commands = CommandEntries(app, path, is_program); !commands.empty()) {
    out += ".SH COMMANDS\n" + commands;
  }
  out += ".SH OPTIONS\n" + OptionEntries(app);
  const std::string footer = app.get_footer();
  const std::size_t begin = footer.find_first_not_of('\n');
  if (begin != std::string::npos) out += ".SH NOTES\n" + Prose(footer.substr(begin));
  out += ".SH SEE ALSO\n";
  if (is_program) {
    for (const CLI::App* command : CommandsOf(app)) {
      out += ".BR " + Roff(name + "-" + command->get_name()) + " (1),\n";
    }
  }
  return out + ".BR " + (name == "bendloop" ? "bendloopd (8)" : "bendloop (1)") +
         ",\n/usr/share/doc/bendloop/README.md\n";
}

}  // namespace

std::string Manual(const CLI::App& app, const std::string& what, const std::string& version) {
  const std::string line = version.substr(0, version.find('\n'));
  if (what == "man1" || what == "man8") return Page(app, app.get_name(), what[3], line);
  if (what == "bash") return BashCompletion(app);
  if (what == "zsh") return ZshCompletion(app);
  std::string names;
  for (const CLI::App* command : CommandsOf(app)) {
    if (what == "man1:" + command->get_name()) {
      return Page(*command, app.get_name() + " " + command->get_name(), '1', line);
    }
    names += command->get_name() + "\n";
  }
  if (what == "commands") return names;
  throw CLI::ValidationError("--manual", "found " + what +
                                             ", expected man1, man8, man1:COMMAND, commands, bash "
                                             "or zsh");
}

}  // namespace bendloop::host
