// SPDX-License-Identifier: Apache-2.0
#include "config/text_writer.h"

#include <algorithm>
#include <utility>

#include "config/toml_reader.h"

namespace bendloop::config {

TextWriter::TextWriter(std::vector<std::string_view> left_out) : left_out_(std::move(left_out)) {}

bool TextWriter::IsLeftOut(const std::string& path) const {
  return std::find(left_out_.begin(), left_out_.end(), path) != left_out_.end();
}

void TextWriter::Write(std::string_view key, std::string_view value) {
  const std::string path = path_ + std::string(key);
  if (!IsLeftOut(path)) text_ += path + " = " + std::string(value) + "\n";
}

void TextWriter::Number(std::string_view key, double& value, Range /*range*/, Need /*need*/) {
  Write(key, NumberText(value));
}

void TextWriter::Bool(std::string_view key, bool& value) { Write(key, value ? "true" : "false"); }

void TextWriter::Text(std::string_view key, std::string& value, Need /*need*/) {
  Write(key, '"' + value + '"');
}

void TextWriter::Path(std::string_view key, std::filesystem::path& value, Need /*need*/) {
  Write(key, '"' + value.string() + '"');
}

void TextWriter::Points(std::string_view key, std::vector<Eigen::Vector3d>& value, Range /*range*/,
                        std::size_t /*max_points*/) {
  std::string text;
  for (const Eigen::Vector3d& p : value) {
    if (!text.empty()) text += ", ";
    text += "[" + NumberText(p.x()) + ", " + NumberText(p.y()) + ", " + NumberText(p.z()) + "]";
  }
  Write(key, "[" + text + "]");
}

void TextWriter::Table(std::string_view key, Need /*need*/, const Body& body) {
  const std::string outer = path_;
  const std::string path = path_ + std::string(key);
  if (IsLeftOut(path)) return;
  path_ = path + ".";
  body(*this);
  path_ = outer;
}

void TextWriter::Tables(std::string_view key, std::size_t& size, std::size_t /*max_size*/,
                        const EntryBody& body) {
  const std::string outer = path_;
  for (std::size_t i = 0; i < size; ++i) {
    path_ = outer + std::string(key) + "[" + std::to_string(i + 1) + "].";
    body(*this, i);
  }
  path_ = outer;
}

bool TextWriter::Present(std::string_view key, bool has_value) {
  if (!has_value) Write(key, "none");
  return has_value;
}

void TextWriter::IntegerOrWord(std::string_view key, std::optional<std::int64_t>& value,
                               std::int64_t /*min*/, std::int64_t /*max*/, std::string_view word) {
  Write(key, value ? std::to_string(*value) : '"' + std::string(word) + '"');
}

void TextWriter::DoInteger(std::string_view key, std::int64_t& value, std::int64_t /*min*/,
                           std::int64_t /*max*/, Need /*need*/) {
  Write(key, std::to_string(value));
}

void TextWriter::DoEnum(std::string_view key, std::size_t& index, std::span<const Word> words,
                        Need /*need*/) {
  Write(key, '"' + std::string(words[index].word) + '"');
}

}  // namespace bendloop::config
