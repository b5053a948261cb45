// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/console/command_line.h"

#include <algorithm>
#include <memory>
#include <sstream>
#include <string_view>
#include <vector>

#include "firmware-host/console/manual.h"
#include "firmware-host/console/suggestion.h"
#include "firmware-host/console/wrap.h"

namespace bendloop::host {
namespace {

constexpr std::size_t kNameColumns = 26;  // of option names, with the blanks around them

// CLI11's own writes each description in one line, however long.
class NarrowFormatter : public CLI::Formatter {
 public:
  std::string make_option(const CLI::Option* option, bool is_positional) const override {
    return Entry(make_option_name(option, is_positional) + make_option_opts(option),
                 make_option_desc(option));
  }
  std::string make_subcommand(const CLI::App* command) const override {
    return Entry(command->get_display_name(true), command->get_description());
  }
  std::string make_description(const CLI::App* app) const override {
    return WrapLines(app->get_description(), kPlainColumns) + "\n";
  }
  std::string make_footer(const CLI::App* app) const override {
    return WrapProse(CLI::Formatter::make_footer(app), kPlainColumns);
  }

 private:
  static std::string Entry(const std::string& name, const std::string& description) {
    std::string text;
    const auto names = WrapWords(name, kPlainColumns - 2);
    for (const std::string& line : names) text += (text.empty() ? "  " : "\n    ") + line;
    std::size_t column = names.size() > 1 ? kPlainColumns : 2 + names.back().size();
    for (const auto& line : WrapWords(description, kPlainColumns - kNameColumns)) {
      if (line.empty()) break;
      if (column + 1 > kNameColumns) {
        text += "\n";
        column = 0;
      }
      text += std::string(kNameColumns - column, ' ') + line;
      column = kPlainColumns;
    }
    return text + "\n";
  }
};

std::vector<std::string> Commands(const CLI::App& app) {
  std::vector<std::string> names;
  for (const CLI::App* command : app.get_subcommands([](const CLI::App*) { return true; })) {
    names.push_back(command->get_name());
  }
  return names;
}

std::vector<std::string> Options(const CLI::App& app) {
  std::vector<std::string> names;
  for (const CLI::Option* option : app.get_options()) {
    if (option->get_group().empty()) continue;  // not for people
    for (const std::string& name : option->get_lnames()) names.push_back("--" + name);
  }
  return names;
}

std::string DidYouMean(const std::string& word) {
  return word.empty() ? "" : "; did you mean " + word + "?";
}

// The word that `command` did not know; empty: it knew all.
std::string Unknown(const CLI::App& command) {
  const auto words = command.remaining();
  for (const std::string& word : words) {
    if (word.size() > 1 && word[0] == '-') {
      const std::string name = word.substr(0, word.find('='));
      return "no option " + name + DidYouMean(Nearest(name, Options(command)));
    }
  }
  if (words.empty()) return "";
  const auto commands = Commands(command);
  if (commands.empty()) return "one argument too many: " + words.front();
  return "no command " + words.front() + DidYouMean(Nearest(words.front(), commands));
}

}  // namespace

void DressCommandLine(CLI::App& app, const std::string& version) {
  app.formatter(std::make_shared<NarrowFormatter>());
  app.set_version_flag("-V,--version", version);
  // For the build, which makes the manual pages by it: not in --help.
  app.add_option_function<std::string>("--manual",
                                       [&app, version](const std::string& what) {
                                         throw CLI::CallForVersion(Manual(app, what, version), 0);
                                       })
      ->group("");
}

CLI::Validator NumberWithin(double low, double high) {
  std::ostringstream limits;
  limits << low << " to " << high;
  return {[low, high, expected = limits.str()](std::string& text) {
            double value = 0;
            const bool is_number = CLI::detail::lexical_cast(text, value);
            if (is_number && value >= low && value <= high) return std::string();
            return "found " + text + ", expected " + expected;
          },
          limits.str()};
}

std::string WhatIsWrong(const CLI::App& app, const CLI::ParseError& error) {
  const CLI::App* at = &app;
  std::string path = app.get_name();
  // To the last word that was understood: `lot show`.
  for (auto chosen = at->get_subcommands(); !chosen.empty(); chosen = at->get_subcommands()) {
    at = chosen.front();
    path += " " + at->get_name();
  }
  std::string wrong = Unknown(*at);
  if (wrong.empty()) wrong = error.what();
  if (wrong.back() != '?') wrong += ";";
  return wrong + " try " + path + " --help";
}

}  // namespace bendloop::host
