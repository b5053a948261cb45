// SPDX-License-Identifier: Apache-2.0
#include "config/toml_document.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <fstream>
#include <system_error>
#include <utility>

#include "config/load.h"

namespace bendloop::config {
namespace {

constexpr std::size_t kMaxTomlProblems = 100;
constexpr int kMaxDepth = 16;     // of brackets; our files need 3
constexpr int kMaxKeyParts = 16;  // of a dotted key; ours have 2

// The parser recurses for every bracket and every part of a dotted key, and so do the tables that
// it makes: without this a file of 1 MB of dots would overflow the stack. Returns the line that
// nests too deeply, or 0. Strings and comments are skipped; where they are malformed the parser
// will say so.
std::uint32_t TooDeepLine(std::string_view text) {
  std::uint32_t line = 1;
  int depth = 0;
  int parts = 0;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const char c = text[i];
    if (c == '\n') {
      ++line;
      parts = 0;
    } else if (c == '#') {
      i = std::min(text.find('\n', i), text.size()) - 1;
    } else if (c == '"' || c == '\'') {
      const bool triple = text.substr(i, 3) == std::string(3, c);
      i += triple ? 3 : 1;
      for (; i < text.size(); ++i) {
        if (text[i] == '\n') ++line;
        if (c == '"' && text[i] == '\\') {
          if (++i < text.size() && text[i] == '\n') ++line;
        } else if (triple ? text.substr(i, 3) == std::string(3, c)
                          : text[i] == c || text[i] == '\n') {
          break;
        }
      }
      if (triple) i += 2;
      while (triple && i + 1 < text.size() && text[i + 1] == c) ++i;  // """ends with a quote""""
    } else if (c == '[' || c == '{') {
      parts = 0;
      if (++depth > kMaxDepth) return line;
    } else if (c == ']' || c == '}') {
      parts = 0;
      depth = std::max(0, depth - 1);
    } else if (c == '=' || c == ',') {
      parts = 0;
    } else if (c == '.') {
      if (++parts >= kMaxKeyParts) return line;
    }
  }
  return 0;
}

}  // namespace

std::string Printable(std::string_view text, std::size_t max_bytes) {
  static constexpr char kHex[] = "0123456789abcdef";
  std::string out;
  for (const char c : text) {
    if (out.size() >= max_bytes) return out + "...";
    const auto byte = static_cast<unsigned char>(c);
    if (byte < 0x20 || byte >= 0x7f) {
      out += {'\\', 'x', kHex[byte >> 4], kHex[byte & 15]};
    } else {
      out += c;
    }
  }
  return out;
}

hal::Result<std::string> ReadTextFile(const std::filesystem::path& file) {
  const auto fail = [&](const std::string& why) {
    return hal::Fail(hal::ErrorKind::kBadInput, file.string() + ": " + why);
  };
  std::error_code error;
  const auto status = std::filesystem::status(file, error);
  if (!std::filesystem::exists(status)) {
    return fail("no such file, expected a TOML file (relative paths start at the current folder)");
  }
  if (std::filesystem::is_directory(status)) return fail("found a folder, expected a TOML file");
  std::ifstream stream(file, std::ios::binary);
  if (!stream) return fail("cannot be opened: " + std::generic_category().message(errno));
  std::string text(kMaxFileBytes + 1, '\0');
  stream.read(text.data(), static_cast<std::streamsize>(text.size()));
  if (stream.bad()) return fail("cannot be read");
  text.resize(static_cast<std::size_t>(stream.gcount()));
  if (text.empty()) {
    return fail(
        "the file is empty (0 bytes), expected a configuration file; copy or write it again");
  }
  if (text.size() > kMaxFileBytes) {
    return fail("found more than " + std::to_string(kMaxFileBytes) +
                " bytes, expected a configuration file; is this the right file?");
  }
  return text;
}

hal::Result<TomlDocument> TomlDocument::Parse(std::string_view text, std::string name) {
  const auto fail = [&](const std::string& where, const std::string& why) {
    return hal::Fail(hal::ErrorKind::kBadInput, name + where + ": " + why);
  };
  if (text.size() > kMaxFileBytes) {
    return fail("", "found " + std::to_string(text.size()) + " bytes, expected at most " +
                        std::to_string(kMaxFileBytes));
  }
  if (const std::size_t zero = text.find('\0'); zero != std::string_view::npos) {
    return fail("", "found a zero byte at byte " + std::to_string(zero) +
                        ", expected TOML text; is this the right file?");
  }
  if (const std::uint32_t line = TooDeepLine(text); line != 0) {
    return fail(":" + std::to_string(line),
                "found deeper nesting than any configuration has, expected at most " +
                    std::to_string(kMaxDepth) + " levels");
  }
  TomlDocument document;
  document.name_ = name;
  try {
    document.root_ = toml::parse(text, name);
  } catch (const toml::parse_error& error) {
    const toml::source_position at = error.source().begin;
    const bool is_cut = error.description().find("end-of-file") != std::string_view::npos;
    return fail(":" + std::to_string(at.line) + ":" + std::to_string(at.column),
                Printable(error.description(), 300) +
                    (is_cut ? ", expected more; was the file copied to its end?" : ""));
  }
  return document;
}

std::uint32_t TomlDocument::Line(std::string_view path) const {
  for (;;) {
    if (const auto found = lines_.find(path); found != lines_.end()) return found->second;
    const std::size_t cut = path.find_last_of(".[");
    if (cut == std::string_view::npos) return 1;
    path = path.substr(0, cut);
  }
}

std::string TomlDocument::Place(std::string_view path) const {
  return name_ + ":" + std::to_string(Line(path));
}

void TomlDocument::Report(std::string_view path, std::string_view complaint) {
  ++problem_count_;
  if (problems_.size() >= kMaxTomlProblems) return;
  std::string text = Place(path) + ": ";
  if (!path.empty()) text += "key '" + std::string(path) + "': ";
  problems_.push_back({Line(path), std::string(path), text + std::string(complaint)});
}

bool TomlDocument::IsGood(std::string_view path) const {
  return std::none_of(problems_.begin(), problems_.end(), [&](const Problem& problem) {
    return problem.path.compare(0, path.size(), path) == 0 &&
           (problem.path.size() == path.size() || problem.path[path.size()] == '.' ||
            problem.path[path.size()] == '[');
  });
}

hal::Result<void> TomlDocument::Finish() const {
  if (problem_count_ == 0) return {};
  std::vector<Problem> sorted = problems_;
  std::stable_sort(sorted.begin(), sorted.end(),
                   [](const Problem& a, const Problem& b) { return a.line < b.line; });
  std::string message;
  if (problem_count_ > 1) {
    message = name_ + ": " + std::to_string(problem_count_) + " problems";
    if (problem_count_ > sorted.size()) {
      message += ", the first " + std::to_string(sorted.size()) + " are";
    }
    message += ":\n";
  }
  for (std::size_t i = 0; i < sorted.size(); ++i) {
    if (i > 0) message += '\n';
    message += sorted[i].text;
  }
  return hal::Fail(hal::ErrorKind::kBadInput, message);
}

}  // namespace bendloop::config
