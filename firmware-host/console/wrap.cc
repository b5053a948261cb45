// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/console/wrap.h"

#include <algorithm>
#include <iterator>
#include <utility>

namespace bendloop::host {
namespace {

constexpr std::size_t kLeastWords = 20;  // columns that are worth hanging words into

// Characters, not bytes: UTF-8 has continuation bytes of 10xxxxxx.
std::size_t Characters(std::string_view text) {
  return static_cast<std::size_t>(std::count_if(text.begin(), text.end(), [](char c) {
    return (static_cast<unsigned char>(c) & 0xC0) != 0x80;
  }));
}

// What nobody should have to look for on the next line.
bool IsUnit(std::string_view word) {
  while (!word.empty() && std::string_view(",;:.)").find(word.back()) != std::string_view::npos) {
    word.remove_suffix(1);
  }
  constexpr std::string_view kUnits[] = {"%", "mm", "deg", "degrees", "s", "ms"};
  return std::find(std::begin(kUnits), std::end(kUnits), word) != std::end(kUnits);
}

// The next word of `text`, with the unit of a number.
std::string_view TakeWord(std::string_view& text) {
  std::size_t end = std::min(text.find(' '), text.size());
  const bool is_number = end > 0 && text[end - 1] >= '0' && text[end - 1] <= '9';
  if (is_number && end < text.size()) {
    const std::size_t next = std::min(text.find(' ', end + 1), text.size());
    if (IsUnit(text.substr(end + 1, next - end - 1))) end = next;
  }
  const std::string_view word = text.substr(0, end);
  text.remove_prefix(std::min(end + 1, text.size()));
  return word;
}

// A line that is set already: what `columns` do not hold goes on under its last column of words.
std::string BreakLine(std::string_view line, std::size_t columns) {
  const std::size_t begin = line.find_first_not_of(' ');
  if (Characters(line) <= columns || begin == std::string_view::npos) return std::string(line);
  const std::size_t gap = line.rfind("  ");
  const std::size_t head = gap == std::string_view::npos || gap < begin ? begin : gap + 2;
  if (head + kLeastWords > columns) return std::string(line);
  std::string out;
  for (const std::string& words : WrapWords(line.substr(head), columns - head)) {
    out += out.empty() ? std::string(line.substr(0, head)) : "\n" + std::string(head, ' ');
    out += words;
  }
  return out;
}

// Whether a line that is too wide is of words only, and goes on in the next one.
bool GoesOn(std::string_view line, std::size_t columns) {
  const bool is_list = line.front() == ' ' || line.find("  ") != std::string_view::npos;
  return Characters(line) > columns && !is_list && line.back() != '.' && line.back() != ':';
}

}  // namespace

std::vector<std::string> WrapWords(std::string_view text, std::size_t columns) {
  std::vector<std::string> lines(1);
  while (!text.empty()) {
    const std::string_view word = TakeWord(text);
    if (word.empty()) continue;
    std::string& line = lines.back();
    if (line.empty()) {
      line = word;
    } else if (Characters(line) + 1 + Characters(word) <= columns) {
      line.append(" ").append(word);
    } else {
      lines.emplace_back(word);
    }
  }
  return lines;
}

std::string WrapLines(std::string_view text, std::size_t columns) {
  std::string out;
  for (std::size_t end = text.find('\n'); end != std::string_view::npos; end = text.find('\n')) {
    out += BreakLine(text.substr(0, end), columns) + "\n";
    text.remove_prefix(end + 1);
  }
  return out + BreakLine(text, columns);
}

std::string WrapProse(std::string_view text, std::size_t columns) {
  std::string out, rest;
  while (!text.empty()) {
    const std::size_t end = std::min(text.find('\n'), text.size());
    std::string line(text.substr(0, end));
    const bool is_last = end == text.size();
    text.remove_prefix(is_last ? end : end + 1);
    if (const std::string before = std::exchange(rest, ""); !before.empty()) {
      const bool is_of_it = !line.empty() && line.front() != ' ';
      is_of_it ? line.insert(0, before + " ") : out.append(before + "\n");
    }
    if (!line.empty() && GoesOn(line, columns)) {
      auto words = WrapWords(line, columns);
      rest = std::move(words.back());
      words.pop_back();
      for (const std::string& set : words) out += set + "\n";
      continue;
    }
    out += WrapLines(line, columns) + (is_last ? "" : "\n");
  }
  return out + rest;
}

}  // namespace bendloop::host
