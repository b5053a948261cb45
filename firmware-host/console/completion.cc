// SPDX-License-Identifier: Apache-2.0
#include <sstream>
#include <string>
#include <vector>

#include "firmware-host/console/manual.h"

namespace bendloop::host {
namespace {

std::vector<const CLI::App*> CommandsBelow(const CLI::App& app) {
  return app.get_subcommands([](const CLI::App*) { return true; });
}

// Those that --help shows.
std::vector<const CLI::Option*> ShownOptions(const CLI::App& app) {
  std::vector<const CLI::Option*> shown;
  for (const CLI::Option* option : app.get_options()) {
    if (!option->get_group().empty()) shown.push_back(option);
  }
  return shown;
}

std::vector<std::string> Names(const CLI::Option& option) {
  std::vector<std::string> names;
  for (const std::string& name : option.get_snames()) names.push_back("-" + name);
  for (const std::string& name : option.get_lnames()) names.push_back("--" + name);
  return names;
}

bool TakesValue(const CLI::Option& option) { return option.get_items_expected_max() > 0; }

// Of an option that takes one of some words: "mm m in"; empty where it may be anything.
std::string Choices(const CLI::Option& option) {
  const std::string type = option.get_type_name();  // TEXT:{mm,m,in}
  const std::size_t begin = type.find('{');
  const std::size_t end = type.find('}');
  if (begin == std::string::npos || end == std::string::npos) return "";
  std::string words = type.substr(begin + 1, end - begin - 1);
  for (char& c : words) c = c == ',' ? ' ' : c;
  return words;
}

std::string Joined(const std::vector<std::string>& words) {
  std::string text;
  for (const std::string& word : words) text += (text.empty() ? "" : " ") + word;
  return text;
}

// Every command with the words that lead to it: "bendloop lot show".
struct Place {
  std::string path;
  const CLI::App* app;
};

void Collect(const CLI::App& app, const std::string& path, std::vector<Place>& places) {
  places.push_back({path, &app});
  for (const CLI::App* command : CommandsBelow(app)) {
    Collect(*command, path + " " + command->get_name(), places);
  }
}

std::vector<Place> PlacesOf(const CLI::App& app) {
  std::vector<Place> places;
  Collect(app, app.get_name(), places);
  return places;
}

std::string FunctionName(std::string path) {
  for (char& c : path) c = c == ' ' || c == '-' ? '_' : c;
  return "_" + path;
}

// Between single quotes of a shell.
std::string Quoted(const std::string& text) {
  std::string out;
  for (const char c : text) {
    if (c == '\'') {
      out += "'\\''";
    } else {
      out += c == '\n' ? ' ' : c;
    }
  }
  return out;
}

// For _arguments and _describe of zsh, where brackets and colons separate.
std::string ZshText(const std::string& text) {
  std::string out;
  for (const char c : text) {
    if (c == '[' || c == ']' || c == ':' || c == '\\') out += '\\';
    out += c;
  }
  return Quoted(out);
}

// What completes a value: words, nothing (a number), or files.
std::string ZshAction(const CLI::Option& option) {
  if (const std::string words = Choices(option); !words.empty()) return "(" + Quoted(words) + ")";
  const std::string type = option.get_type_name();
  for (const char* number : {"INT", "UINT", "FLOAT", "N"}) {
    if (type.substr(0, type.find(':')) == number) return " ";
  }
  return "_files";
}

std::string ZshArguments(const CLI::App& app, const std::string& indent) {
  std::string out;
  for (const CLI::Option* option : ShownOptions(app)) {
    const std::string what = option->get_name();
    if (option->get_positional()) {
      const bool many = option->get_items_expected_max() > 1;
      out += " \\\n" + indent + "'" + (many ? "*:" : ":") + ZshText(what) + ":" +
             ZshAction(*option) + "'";
      continue;
    }
    const std::vector<std::string> names = Names(*option);
    for (const std::string& name : names) {
      const bool is_long = name.rfind("--", 0) == 0;
      out += " \\\n" + indent + "'(" + Joined(names) + ")" + name;
      out += TakesValue(*option) && is_long ? "=[" : "[";
      out += ZshText(option->get_description()) + "]";
      if (TakesValue(*option)) out += ":" + ZshText(what) + ":" + ZshAction(*option);
      out += "'";
    }
  }
  return out;
}

}  // namespace

std::string BashCompletion(const CLI::App& app) {
  const std::vector<Place> places = PlacesOf(app);
  const std::string name = app.get_name();
  std::ostringstream out;
  out << "# shellcheck shell=bash\n# Completion for " << name << ", made from its command line.\n"
      << FunctionName(name) << "() {\n"
      << "  local at=" << name << " word words=\n"
      << "  for word in \"${COMP_WORDS[@]:1:COMP_CWORD-1}\"; do\n"
      << "    case \"$at $word\" in\n";
  for (const Place& place : places) {
    if (place.app != &app) out << "      '" << place.path << "') at=\"$at $word\" ;;\n";
  }
  out << "      *) ;;\n    esac\n  done\n  COMPREPLY=()\n"
      << "  # The value of an option: words where it takes only these, otherwise files.\n"
      << "  case \"$at ${COMP_WORDS[COMP_CWORD-1]}\" in\n";
  std::ostringstream words;
  for (const Place& place : places) {
    std::vector<std::string> all;
    for (const CLI::App* command : CommandsBelow(*place.app)) all.push_back(command->get_name());
    for (const CLI::Option* option : ShownOptions(*place.app)) {
      if (option->get_positional()) continue;
      for (const std::string& word : Names(*option)) {
        all.push_back(word);
        if (!TakesValue(*option)) continue;
        const std::string choices = Choices(*option);
        out << "    '" << place.path << " " << word << "') ";
        out << (choices.empty() ? "return" : "words='" + Quoted(choices) + "'") << " ;;\n";
      }
    }
    words << "      '" << place.path << "') words='" << Quoted(Joined(all)) << "' ;;\n";
  }
  out << "    *) ;;\n  esac\n  if [ -z \"$words\" ]; then\n    case \"$at\" in\n"
      << words.str() << "      *) ;;\n    esac\n  fi\n"
      << "  mapfile -t COMPREPLY < <(compgen -W \"$words\" -- \"${COMP_WORDS[COMP_CWORD]}\")\n}\n"
      << "complete -o bashdefault -o default -F " << FunctionName(name) << " " << name << "\n";
  return out.str();
}

std::string ZshCompletion(const CLI::App& app) {
  std::ostringstream out;
  out << "#compdef " << app.get_name() << "\n# Made from its command line.\n";
  for (const Place& place : PlacesOf(app)) {
    const auto commands = CommandsBelow(*place.app);
    out << FunctionName(place.path) << "() {\n";
    if (commands.empty()) {
      out << "  _arguments -s" << ZshArguments(*place.app, "    ") << "\n}\n";
      continue;
    }
    out << "  local context state state_descr line\n  typeset -A opt_args\n  _arguments -s -C"
        << ZshArguments(*place.app, "    ") << " \\\n"
        << "    '1: :->command' '*:: :->rest'\n  case $state in\n    command)\n"
        << "      local -a commands=(\n";
    for (const CLI::App* command : commands) {
      out << "        '" << command->get_name() << ":" << ZshText(command->get_description())
          << "'\n";
    }
    out << "      )\n      _describe command commands ;;\n    rest)\n      case $words[1] in\n";
    for (const CLI::App* command : commands) {
      out << "        " << command->get_name() << ") "
          << FunctionName(place.path + " " + command->get_name()) << " ;;\n";
    }
    out << "      esac ;;\n  esac\n}\n";
  }
  out << FunctionName(app.get_name()) << " \"$@\"\n";
  return out.str();
}

}  // namespace bendloop::host
