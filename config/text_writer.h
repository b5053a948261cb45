// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "config/field_visitor.h"

namespace bendloop::config {

// Writes every field of a struct as `path.key = value`, one a line, in the order of its Visit
// function. Changes nothing.
class TextWriter final : public FieldVisitor {
 public:
  // Keys and tables whose path is in `left_out` are skipped.
  explicit TextWriter(std::vector<std::string_view> left_out = {});

  const std::string& text() const { return text_; }

  void Number(std::string_view key, double& value, Range range, Need need) override;
  void Bool(std::string_view key, bool& value) override;
  void Text(std::string_view key, std::string& value, Need need) override;
  void Path(std::string_view key, std::filesystem::path& value, Need need) override;
  void Points(std::string_view key, std::vector<Eigen::Vector3d>& value, Range range,
              std::size_t max_points) override;
  void Table(std::string_view key, Need need, const Body& body) override;
  void Tables(std::string_view key, std::size_t& size, std::size_t max_size,
              const EntryBody& body) override;
  bool Present(std::string_view key, bool has_value) override;
  bool Chosen(std::string_view /*key*/, bool is_chosen) override { return is_chosen; }
  void IntegerOrWord(std::string_view key, std::optional<std::int64_t>& value, std::int64_t min,
                     std::int64_t max, std::string_view word) override;

 private:
  void DoInteger(std::string_view key, std::int64_t& value, std::int64_t min, std::int64_t max,
                 Need need) override;
  void DoEnum(std::string_view key, std::size_t& index, std::span<const Word> words,
              Need need) override;
  void Write(std::string_view key, std::string_view value);
  bool IsLeftOut(const std::string& path) const;

  std::vector<std::string_view> left_out_;
  std::string path_;
  std::string text_;
};

}  // namespace bendloop::config
