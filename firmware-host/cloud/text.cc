// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cloud/text.h"

#include <fast_float/fast_float.h>

#include <algorithm>
#include <charconv>
#include <cstring>
#include <limits>

namespace bendloop::host {

Lines::Lines(std::string_view bytes, std::size_t first_line)
    : bytes_(bytes), number_(first_line - 1) {
  // The first line's end tells the file's style: a lone CR counts only where no LF follows, as
  // binary data after a header may begin with any byte.
  const std::size_t end = bytes.find_first_of("\r\n");
  if (end != std::string_view::npos && bytes[end] == '\r' &&
      (end + 1 >= bytes.size() || bytes[end + 1] != '\n')) {
    end_ = '\r';
  }
}

bool Lines::Next(std::string_view& line) {
  if (offset_ >= bytes_.size()) return false;
  const char* begin = bytes_.data() + offset_;
  const std::size_t left = bytes_.size() - offset_;
  const void* end = std::memchr(begin, end_, left);
  const std::size_t size =
      end ? static_cast<std::size_t>(static_cast<const char*>(end) - begin) : left;
  offset_ += end ? size + 1 : size;
  ++number_;
  line = {begin, size};
  if (!line.empty() && line.back() == '\r') line.remove_suffix(1);
  return true;
}

std::string_view NextWord(std::string_view& text) {
  std::size_t begin = 0;
  while (begin < text.size() && IsBlank(text[begin])) ++begin;
  std::size_t end = begin;
  while (end < text.size() && !IsBlank(text[end])) ++end;
  const std::string_view word = text.substr(begin, end - begin);
  text.remove_prefix(end);
  return word;
}

std::optional<double> NumberFrom(std::string_view text, bool decimal_comma) {
  if (text.size() > 1 && text[0] == '+' && text[1] != '-') text.remove_prefix(1);
  const char* const end = text.data() + text.size();
  double value = 0;
  auto result = fast_float::from_chars(text.data(), end, value);
  if (decimal_comma && result.ptr != end && end[-1] != ',') {
    result = fast_float::from_chars_advanced(
        text.data(), end, value, fast_float::parse_options{fast_float::chars_format::general, ','});
  }
  if (result.ec == std::errc() && result.ptr == end) return value;
  if (result.ptr == end && result.ec == std::errc::result_out_of_range) {
    return value;  // infinite or 0, as the number's size demands
  }
  // How one widespread C library wrote NaN and infinity.
  if (text.find("1.#") != std::string_view::npos && text.size() < 12) {
    return std::numeric_limits<double>::quiet_NaN();
  }
  return std::nullopt;
}

std::optional<std::size_t> CountFrom(std::string_view text) {
  std::size_t count = 0;
  const char* const end = text.data() + text.size();
  const auto result = std::from_chars(text.data(), end, count);
  if (text.empty() || result.ec != std::errc() || result.ptr != end) return std::nullopt;
  return count;
}

std::string Found(std::string_view text) {
  constexpr std::size_t kLongest = 40;
  std::string found = "\"";
  for (const char c : text.substr(0, kLongest)) {
    found += c >= ' ' && c <= '~' ? c : '?';
  }
  if (text.size() > kLongest) found += "...";
  return found + "\"";
}

}  // namespace bendloop::host
