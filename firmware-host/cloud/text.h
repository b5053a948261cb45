// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>

#include "hal/text.h"

// What all readers of text need; numbers as scanners and spreadsheets write them.
namespace bendloop::host {

inline bool IsBlank(char c) { return c == ' ' || c == '\t'; }
using hal::Lower;
using hal::Trimmed;

// Lines that end in LF, CRLF or, in old files, CR alone; counts them from 1.
class Lines {
 public:
  explicit Lines(std::string_view bytes, std::size_t first_line = 1);

  // The next line without its end; false at the end of the text.
  bool Next(std::string_view& line);
  std::size_t number() const { return number_; }  // of the line last returned
  std::size_t offset() const { return offset_; }  // of the byte after it
  std::string_view rest() const { return bytes_.substr(offset_); }

 private:
  std::string_view bytes_;
  std::size_t offset_ = 0;
  std::size_t number_;
  char end_ = '\n';
};

// The next run of non-blank characters, taken from the front of `text`; empty at its end.
std::string_view NextWord(std::string_view& text);

// The whole of `text` as a number; "nan", "inf" and "1.#QNAN" are numbers, a leading + and
// exponents are allowed, a decimal comma if asked for.
std::optional<double> NumberFrom(std::string_view text, bool decimal_comma = false);
// The whole of `text` as a count that fits 64 bits.
std::optional<std::size_t> CountFrom(std::string_view text);

// What was found, in quotes, shortened and printable, for a message.
std::string Found(std::string_view text);

}  // namespace bendloop::host
