// SPDX-License-Identifier: Apache-2.0
#include "config/toml_reader.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <numeric>
#include <utility>

namespace bendloop::config {
namespace {

std::string Found(const toml::node& node) {
  if (const auto* text = node.as_string()) return "the text '" + Printable(text->get(), 40) + "'";
  if (const auto* number = node.as_integer()) return std::to_string(number->get());
  if (const auto* number = node.as_floating_point()) return NumberText(number->get());
  if (const auto* flag = node.as_boolean()) return flag->get() ? "true" : "false";
  if (node.is_table()) return "a table";
  if (node.is_array()) return "an array";
  return "a date or time";
}

std::string RangeText(std::string_view what, const std::string& min, const std::string& max) {
  return std::string(what) + " from " + min + " to " + max;
}

// An integer is a number too.
std::optional<double> AsNumber(const toml::node& node) {
  if (const auto* number = node.as_floating_point()) return number->get();
  if (const auto* number = node.as_integer()) return static_cast<double>(number->get());
  return std::nullopt;
}

std::size_t EditDistance(std::string_view a, std::string_view b) {
  std::vector<std::size_t> row(b.size() + 1);
  std::iota(row.begin(), row.end(), std::size_t{0});
  for (std::size_t i = 0; i < a.size(); ++i) {
    std::size_t diagonal = std::exchange(row[0], i + 1);
    for (std::size_t j = 0; j < b.size(); ++j) {
      const std::size_t above = row[j + 1];
      row[j + 1] = std::min({above + 1, row[j] + 1, diagonal + (a[i] == b[j] ? 0 : 1)});
      diagonal = above;
    }
  }
  return row.back();
}

}  // namespace

std::string NumberText(double value) {
  char buffer[40];
  const auto end = std::to_chars(buffer, buffer + sizeof buffer, value);
  return {buffer, end.ptr};
}

std::string_view Nearest(std::string_view typed, const std::vector<std::string_view>& words) {
  if (typed.size() > 64) return {};
  std::string_view best;
  std::size_t best_distance = std::max<std::size_t>(2, typed.size() / 3) + 1;
  for (const std::string_view word : words) {
    std::size_t distance = EditDistance(typed, word);
    // The unit forgotten ("length" for "length_mm"), or the other way round.
    const std::size_t less = std::min(typed.size(), word.size());
    const std::size_t more = std::max(typed.size(), word.size());
    if (less >= 4 && more > less && typed.substr(0, less) == word.substr(0, less)) distance = 1;
    if (distance < best_distance && distance < word.size()) {
      best = word;
      best_distance = distance;
    }
  }
  return best;
}

TomlReader::TomlReader(TomlDocument& document, const toml::table& table, std::string path,
                       std::filesystem::path directory)
    : document_(document),
      table_(table),
      path_(std::move(path)),
      directory_(std::move(directory)) {}

std::string TomlReader::PathOf(std::string_view key) const {
  return path_.empty() ? std::string(key) : path_ + "." + std::string(key);
}

const toml::node* TomlReader::Find(std::string_view key, Need need, std::string_view expected) {
  known_.emplace(key);
  const auto found = table_.find(key);
  if (found == table_.end()) {
    if (need == Need::kRequired) {
      document_.Report(PathOf(key), "found nothing, expected " + std::string(expected));
    }
    return nullptr;
  }
  document_.SetLine(PathOf(key), found->first.source().begin.line);
  return &found->second;
}

void TomlReader::Wrong(std::string_view key, const toml::node& found, std::string_view expected) {
  document_.Report(PathOf(key), "found " + Found(found) + ", expected " + std::string(expected));
}

bool TomlReader::Chosen(std::string_view key, bool /*is_chosen*/) { return table_.contains(key); }

bool TomlReader::Present(std::string_view key, bool /*has_value*/) {
  known_.emplace(key);
  return table_.contains(key);
}

void TomlReader::Number(std::string_view key, double& value, Range range, Need need) {
  const std::string expected =
      RangeText("a number", NumberText(range.min),
                (range.below_max ? "less than " : "") + NumberText(range.max));
  const toml::node* node = Find(key, need, expected);
  if (node == nullptr) return;
  const std::optional<double> number = AsNumber(*node);
  if (!number || !(*number >= range.min && *number <= range.max) ||
      (range.below_max && *number == range.max)) {
    return Wrong(key, *node, expected);
  }
  value = *number;
}

void TomlReader::DoInteger(std::string_view key, std::int64_t& value, std::int64_t min,
                           std::int64_t max, Need need) {
  const std::string expected =
      RangeText("a whole number", std::to_string(min), std::to_string(max));
  const toml::node* node = Find(key, need, expected);
  if (node == nullptr) return;
  const auto* number = node->as_integer();
  if (number == nullptr || number->get() < min || number->get() > max) {
    return Wrong(key, *node, expected);
  }
  value = number->get();
}

void TomlReader::IntegerOrWord(std::string_view key, std::optional<std::int64_t>& value,
                               std::int64_t min, std::int64_t max, std::string_view word) {
  const std::string expected =
      RangeText("a whole number", std::to_string(min), std::to_string(max)) + " or '" +
      std::string(word) + "'";
  const toml::node* node = Find(key, Need::kOptional, expected);
  if (node == nullptr) return;
  if (const auto* text = node->as_string(); text != nullptr && text->get() == word) {
    value.reset();
    return;
  }
  const auto* number = node->as_integer();
  if (number == nullptr || number->get() < min || number->get() > max) {
    return Wrong(key, *node, expected);
  }
  value = number->get();
}

void TomlReader::Bool(std::string_view key, bool& value) {
  const toml::node* node = Find(key, Need::kOptional, "true or false");
  if (node == nullptr) return;
  if (const auto* flag = node->as_boolean()) {
    value = flag->get();
  } else {
    Wrong(key, *node, "true or false");
  }
}

void TomlReader::Text(std::string_view key, std::string& value, Need need) {
  static constexpr std::string_view kExpected = "a text of 1 to 255 bytes in quotes";
  const toml::node* node = Find(key, need, kExpected);
  if (node == nullptr) return;
  const auto* text = node->as_string();
  if (text == nullptr || text->get().empty() || text->get().size() > 255) {
    return Wrong(key, *node, kExpected);
  }
  const auto is_control = [](unsigned char c) { return c < 0x20 || c == 0x7f; };
  if (std::any_of(text->get().begin(), text->get().end(), is_control)) {
    return Wrong(key, *node, "a text without line breaks and control characters");
  }
  value = text->get();
}

void TomlReader::Path(std::string_view key, std::filesystem::path& value, Need need) {
  std::string text;
  Text(key, text, need);
  if (!text.empty()) value = (directory_ / text).lexically_normal();
}

void TomlReader::DoEnum(std::string_view key, std::size_t& index, std::span<const Word> words,
                        Need need) {
  std::string expected;
  std::vector<std::string_view> supported;
  for (const Word& word : words) {
    if (!word.supported) continue;
    if (!expected.empty()) expected += ", ";
    expected += "'" + std::string(word.word) + "'";
    supported.push_back(word.word);
  }
  if (supported.size() > 1) expected = "one of " + expected;
  const toml::node* node = Find(key, need, expected);
  if (node == nullptr) return;
  const auto* text = node->as_string();
  if (text == nullptr) return Wrong(key, *node, expected);
  for (std::size_t i = 0; i < words.size(); ++i) {
    if (words[i].word != text->get()) continue;
    if (words[i].supported) {
      index = i;
    } else {
      document_.Report(PathOf(key), "found '" + text->get() +
                                        "', which is not yet supported, expected " + expected);
    }
    return;
  }
  if (const std::string_view near = Nearest(text->get(), supported); !near.empty()) {
    expected += "; did you mean '" + std::string(near) + "'?";
  }
  Wrong(key, *node, expected);
}

void TomlReader::Points(std::string_view key, std::vector<Eigen::Vector3d>& value, Range range,
                        std::size_t max_points) {
  const std::string expected = "an array of at most " + std::to_string(max_points) +
                               " points [x, y, z], each number from " + NumberText(range.min) +
                               " to " + NumberText(range.max);
  const toml::node* node = Find(key, Need::kRequired, expected);
  if (node == nullptr) return;
  const auto* array = node->as_array();
  if (array == nullptr) return Wrong(key, *node, expected);
  if (array->size() > max_points) {
    return document_.Report(
        PathOf(key), "found " + std::to_string(array->size()) + " points, expected " + expected);
  }
  std::vector<Eigen::Vector3d> points;
  for (std::size_t i = 0; i < array->size(); ++i) {
    const std::string path = PathOf(key) + "[" + std::to_string(i + 1) + "]";
    const toml::node& entry = *array->get(i);
    document_.SetLine(path, entry.source().begin.line);
    const auto* triple = entry.as_array();
    if (triple == nullptr || triple->size() != 3) {
      const std::string found =
          triple == nullptr ? Found(entry) : "an array of " + std::to_string(triple->size());
      document_.Report(path, "found " + found + ", expected three numbers [x, y, z]");
      continue;
    }
    Eigen::Vector3d point = Eigen::Vector3d::Zero();
    for (int axis = 0; axis < 3; ++axis) {
      const toml::node& coordinate = *triple->get(static_cast<std::size_t>(axis));
      const std::optional<double> number = AsNumber(coordinate);
      if (number && *number >= range.min && *number <= range.max) {
        point[axis] = *number;
      } else {
        document_.Report(path,
                         "found " + Found(coordinate) + " for " + "xyz"[axis] + ", expected " +
                             RangeText("a number", NumberText(range.min), NumberText(range.max)));
      }
    }
    points.push_back(point);
  }
  value = std::move(points);
}

void TomlReader::Table(std::string_view key, Need need, const Body& body) {
  const toml::node* node = Find(key, need, "a table [" + PathOf(key) + "]");
  if (node == nullptr) return;
  const auto* table = node->as_table();
  if (table == nullptr) return Wrong(key, *node, "a table [" + PathOf(key) + "]");
  TomlReader reader(document_, *table, PathOf(key), directory_);
  body(reader);
  reader.Finish();
}

void TomlReader::Tables(std::string_view key, std::size_t& size, std::size_t max_size,
                        const EntryBody& body) {
  size = 0;
  const std::string expected = "tables headed [[" + PathOf(key) + "]]";
  const toml::node* node = Find(key, Need::kOptional, expected);
  if (node == nullptr) return;
  const auto* array = node->as_array();
  if (array == nullptr) return Wrong(key, *node, expected);
  if (array->size() > max_size) {
    return document_.Report(PathOf(key), "found " + std::to_string(array->size()) +
                                             ", expected at most " + std::to_string(max_size));
  }
  for (std::size_t i = 0; i < array->size(); ++i) {
    const std::string path = PathOf(key) + "[" + std::to_string(i + 1) + "]";
    const toml::node& entry = *array->get(i);
    document_.SetLine(path, entry.source().begin.line);
    const auto* table = entry.as_table();
    if (table == nullptr) {
      document_.Report(path, "found " + Found(entry) + ", expected " + expected);
      continue;
    }
    TomlReader reader(document_, *table, path, directory_);
    ++size;
    body(reader, size - 1);
    reader.Finish();
  }
}

void TomlReader::Finish() {
  std::vector<std::string_view> known(known_.begin(), known_.end());
  for (const auto& [key, node] : table_) {
    if (known_.contains(key.str())) continue;
    const std::string path = PathOf(Printable(key.str(), 40));
    document_.SetLine(path, key.source().begin.line);
    std::string expected;
    if (const std::string_view near = Nearest(key.str(), known); !near.empty()) {
      expected = "a key that bendloop knows; did you mean '" + std::string(near) + "'?";
    } else {
      for (const std::string_view word : known) {
        expected += (expected.empty() ? "one of " : ", ") + std::string(word);
      }
    }
    document_.Report(path, "found an unknown key, expected " + expected);
  }
}

}  // namespace bendloop::config
