// SPDX-License-Identifier: Apache-2.0
#include "source_text.h"

#include <algorithm>
#include <cctype>
#include <fstream>
#include <sstream>
#include <utility>

namespace bendloop::house {
namespace {

bool IsWord(char c) { return std::isalnum(static_cast<unsigned char>(c)) != 0 || c == '_'; }
bool IsBlank(char c) { return std::isspace(static_cast<unsigned char>(c)) != 0; }

// Comments, preprocessor lines and what stands in quotation marks become blanks; lines stay.
std::string CodeOnly(std::string_view text) {
  std::string code(text);
  const auto blank = [&code](std::size_t from, std::size_t to) {
    for (std::size_t i = from; i < std::min(to, code.size()); ++i) {
      if (code[i] != '\n') code[i] = ' ';
    }
    return std::min(to, code.size());
  };
  const auto after = [&text](std::string_view what, std::size_t from) {
    const std::size_t found = text.find(what, from);
    return found == std::string_view::npos ? text.size() : found + what.size();
  };
  bool line_is_empty = true;
  for (std::size_t i = 0; i < text.size();) {
    const char c = text[i];
    if (c == '\n') {
      line_is_empty = true;
      ++i;
    } else if (text.substr(i, 2) == "//") {
      i = blank(i, std::min(text.find('\n', i), text.size()));
    } else if (text.substr(i, 2) == "/*") {
      i = blank(i, after("*/", i + 2));
    } else if (c == '#' && line_is_empty) {
      std::size_t end = text.find('\n', i);
      while (end != std::string_view::npos && text[end - 1] == '\\') end = text.find('\n', end + 1);
      i = blank(i, std::min(end, text.size()));
    } else if (text.substr(i, 2) == "R\"") {
      const std::size_t open = text.find('(', i);
      const std::string close = ")" + std::string(text.substr(i + 2, open - i - 2)) + "\"";
      i = blank(i, after(close, open));
    } else if (c == '"' || (c == '\'' && (i == 0 || !IsWord(text[i - 1])))) {  // 1'000 is a number
      std::size_t end = i + 1;
      while (end < text.size() && text[end] != c) end += text[end] == '\\' ? 2 : 1;
      i = blank(i, end + 1);
      line_is_empty = false;
    } else {
      line_is_empty = line_is_empty && IsBlank(c);
      ++i;
    }
  }
  return code;
}

bool StartsWithWord(std::string_view head, std::string_view word) {
  return head.starts_with(word) && (head.size() == word.size() || !IsWord(head[word.size()]));
}

// What stands before a brace, read for what the brace opens.
class Head {
 public:
  explicit Head(std::string_view text) : text_(text) {
    int depth = 0;
    for (std::size_t i = 0; i < text.size(); ++i) {
      const char c = text[i];
      if (c == ')' || c == ']') --depth;
      if (depth == 0) {
        if (c == '(' && parameters_ == 0 && i > 0 && !StartsWithWord(text, "alignas")) {
          parameters_ = i;
        }
        const bool single_colon =
            c == ':' && text.substr(i, 2) != "::" && (i == 0 || text[i - 1] != ':');
        if (single_colon && parameters_ > 0) has_initialisers_ = true;
        if (c == '=' && parameters_ == 0 && text.find("operator") == std::string_view::npos) {
          is_value_ = true;
        }
      }
      if (c == '(' || c == '[') ++depth;
    }
  }

  bool IsScope() const {
    return StartsWithWord(text_, "namespace") || StartsWithWord(text_, "extern") ||
           (parameters_ == 0 && !is_value_ &&
            (HasWord("class") || HasWord("struct") || HasWord("union") || HasWord("enum")));
  }
  bool IsFunction() const { return parameters_ > 0 && !is_value_; }
  // The brace belongs to a member initialiser and not to the body.
  bool EndsInInitialiser() const {
    return IsFunction() && has_initialisers_ && (IsWord(text_.back()) || text_.back() == '>');
  }
  std::string Name() const {
    std::size_t end = parameters_;
    while (end > 0 && IsBlank(text_[end - 1])) --end;
    std::size_t begin = text_.substr(0, end).rfind("operator");
    if (begin == std::string_view::npos) begin = end;
    while (begin > 0 &&
           (IsWord(text_[begin - 1]) || text_[begin - 1] == ':' || text_[begin - 1] == '~')) {
      --begin;
    }
    return std::string(text_.substr(begin, end - begin));
  }

 private:
  bool HasWord(std::string_view word) const {
    for (std::size_t i = text_.find(word); i != std::string_view::npos;
         i = text_.find(word, i + 1)) {
      if ((i == 0 || !IsWord(text_[i - 1])) && StartsWithWord(text_.substr(i), word)) return true;
    }
    return false;
  }

  std::string_view text_;
  std::size_t parameters_ = 0;  // where they begin
  bool has_initialisers_ = false;
  bool is_value_ = false;
};

}  // namespace

std::vector<Include> IncludesOf(std::string_view text) {
  constexpr std::string_view kStart = "#include \"";
  std::vector<Include> includes;
  int line = 1;
  for (std::size_t begin = 0; begin < text.size(); ++line) {
    const std::size_t end = std::min(text.find('\n', begin), text.size());
    const std::string_view one = text.substr(begin, end - begin);
    if (one.starts_with(kStart)) {
      const std::string_view rest = one.substr(kStart.size());
      includes.push_back({std::string(rest.substr(0, rest.find('"'))), line});
    }
    begin = end + 1;
  }
  return includes;
}

std::vector<Function> FunctionsOf(std::string_view text) {
  const std::string code = CodeOnly(text);
  std::vector<Function> functions;
  const auto matching_brace = [&code](std::size_t open) {
    int depth = 0;
    for (std::size_t i = open; i < code.size(); ++i) {
      if (code[i] == '{') ++depth;
      if (code[i] == '}' && --depth == 0) return i;
    }
    return code.size() - 1;
  };
  const auto line_of = [&code](std::size_t at) {
    return 1 + static_cast<int>(
                   std::count(code.begin(), code.begin() + static_cast<std::ptrdiff_t>(at), '\n'));
  };
  std::size_t head_begin = 0;
  for (std::size_t i = 0; i < code.size(); ++i) {
    const std::string_view before = std::string_view(code).substr(head_begin, i - head_begin);
    if (code[i] == ';' || code[i] == '}') {
      // A semicolon within parentheses stands in a lambda of a default argument: there are none.
      head_begin = i + 1;
    } else if (code[i] == ':' && (before.ends_with("public") || before.ends_with("private") ||
                                  before.ends_with("protected"))) {
      head_begin = i + 1;
    } else if (code[i] == '{') {
      std::size_t first = head_begin;
      while (first < i && IsBlank(code[first])) ++first;
      std::size_t last = i;
      while (last > first && IsBlank(code[last - 1])) --last;
      const Head head(std::string_view(code).substr(first, last - first));
      if (head.IsScope()) {
        head_begin = i + 1;
        continue;
      }
      const std::size_t close = matching_brace(i);
      if (head.EndsInInitialiser()) {
        i = close;
        continue;
      }
      if (head.IsFunction()) {
        functions.push_back({head.Name(), line_of(first), line_of(close) - line_of(first) + 1});
        head_begin = close + 1;
      }
      i = close;
    }
  }
  return functions;
}

std::vector<SourceFile> ReadSources(const std::filesystem::path& root,
                                    const std::vector<std::string>& folders) {
  std::vector<SourceFile> files;
  for (const std::string& folder : folders) {
    for (const auto& entry : std::filesystem::recursive_directory_iterator(root / folder)) {
      const std::string extension = entry.path().extension().string();
      if (extension != ".h" && extension != ".cc") continue;
      std::ostringstream text;
      text << std::ifstream(entry.path()).rdbuf();
      files.push_back({entry.path().lexically_relative(root).generic_string(),
                       IncludesOf(text.str()), FunctionsOf(text.str())});
    }
  }
  std::sort(files.begin(), files.end(),
            [](const SourceFile& a, const SourceFile& b) { return a.path < b.path; });
  return files;
}

}  // namespace bendloop::house
