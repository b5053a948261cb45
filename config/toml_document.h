// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <toml++/toml.h>

#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "hal/result.h"

namespace bendloop::config {

// A parsed TOML text and everything that was found wrong with it.
class TomlDocument {
 public:
  // `name` stands for the file in messages. Errors: syntax and duplicate keys, with line and
  // column; texts too large or too deeply nested.
  static hal::Result<TomlDocument> Parse(std::string_view text, std::string name);

  const toml::table& root() const { return root_; }
  // `NAME:LINE`, for messages that name a second place.
  std::string Place(std::string_view path) const;

  // Remembers where `path` ("scanner.port", "row[2].angle_deg") stands.
  void SetLine(const std::string& path, std::uint32_t line) { lines_[path] = line; }
  // Line of `path`, or of the nearest table around it.
  std::uint32_t Line(std::string_view path) const;

  // `complaint` reads "found ..., expected ...".
  void Report(std::string_view path, std::string_view complaint);
  // Whether nothing was reported at `path` or below it.
  bool IsGood(std::string_view path) const;
  std::size_t problem_count() const { return problem_count_; }
  // Fails with every problem, in the order of the file.
  hal::Result<void> Finish() const;

 private:
  struct Problem {
    std::uint32_t line = 0;
    std::string path;
    std::string text;
  };

  toml::table root_;
  std::string name_;
  std::map<std::string, std::uint32_t, std::less<>> lines_;
  std::vector<Problem> problems_;  // the first kMaxProblems
  std::size_t problem_count_ = 0;
};

// The file's text; kBadInput when it cannot be read or is longer than kMaxFileBytes.
hal::Result<std::string> ReadTextFile(const std::filesystem::path& file);

// `text` fit for one line of a message: control characters escaped, long texts cut.
std::string Printable(std::string_view text, std::size_t max_bytes = 60);

}  // namespace bendloop::config
