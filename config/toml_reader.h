// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "config/field_visitor.h"
#include "config/toml_document.h"

namespace bendloop::config {

// Fills a struct from one table of a document. Whatever does not fit is reported to the document
// and leaves the value as it was; Finish reports the keys that nobody asked for.
class TomlReader final : public FieldVisitor {
 public:
  // `path` of the table, empty for the root; relative paths start at `directory`.
  TomlReader(TomlDocument& document, const toml::table& table, std::string path,
             std::filesystem::path directory);

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
  bool Chosen(std::string_view key, bool is_chosen) override;
  void IntegerOrWord(std::string_view key, std::optional<std::int64_t>& value, std::int64_t min,
                     std::int64_t max, std::string_view word) override;

  void Finish();

 private:
  void DoInteger(std::string_view key, std::int64_t& value, std::int64_t min, std::int64_t max,
                 Need need) override;
  void DoEnum(std::string_view key, std::size_t& index, std::span<const Word> words,
              Need need) override;

  std::string PathOf(std::string_view key) const;
  // The node, or nullptr; a required one that is missing is reported as `expected`.
  const toml::node* Find(std::string_view key, Need need, std::string_view expected);
  void Wrong(std::string_view key, const toml::node& found, std::string_view expected);

  TomlDocument& document_;
  const toml::table& table_;
  std::string path_;
  std::filesystem::path directory_;
  std::set<std::string, std::less<>> known_;
};

// The word of `words` that `typed` was probably meant to be, or an empty text.
std::string_view Nearest(std::string_view typed, const std::vector<std::string_view>& words);

// "1.5", "0.001", "100": as short as it reads back the same.
std::string NumberText(double value);

}  // namespace bendloop::config
