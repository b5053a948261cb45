// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace bendloop::config {

enum class Need : std::uint8_t { kOptional, kRequired };

// Inclusive, or without `max` itself.
struct Range {
  double min = 0;
  double max = 0;
  bool below_max = false;
};

// A word of the file and its place in an enum; without a place it is known but not supported yet.
template <class E>
struct Choice {
  std::string_view word;
  std::optional<E> value;
};

// Walks over the keys of a configuration struct. Each struct has one Visit function that names
// every key once, with its range; reading a file, writing the effective text and the digest all use
// it. An optional key that a reader does not find keeps its value, the default of the struct.
class FieldVisitor {
 public:
  using Body = std::function<void(FieldVisitor&)>;
  // Called for every entry of an array of tables; may be called once more for each new entry.
  using EntryBody = std::function<void(FieldVisitor&, std::size_t)>;

  virtual ~FieldVisitor() = default;

  virtual void Number(std::string_view key, double& value, Range range,
                      Need need = Need::kOptional) = 0;
  virtual void Bool(std::string_view key, bool& value) = 0;
  virtual void Text(std::string_view key, std::string& value, Need need = Need::kOptional) = 0;
  virtual void Path(std::string_view key, std::filesystem::path& value,
                    Need need = Need::kOptional) = 0;
  virtual void Points(std::string_view key, std::vector<Eigen::Vector3d>& value, Range range,
                      std::size_t max_points) = 0;
  virtual void Table(std::string_view key, Need need, const Body& body) = 0;
  // `size` is set by a reader, which refuses more than `max_size`.
  virtual void Tables(std::string_view key, std::size_t& size, std::size_t max_size,
                      const EntryBody& body) = 0;
  // Whether a reader finds the key, or a writer has something to write.
  virtual bool Present(std::string_view key, bool has_value) = 0;

  // Between two ways to say the same: whether a reader finds the key of one, or a writer has it.
  virtual bool Chosen(std::string_view key, bool is_chosen) = 0;

  // A whole number, or `word` in quotes: no value.
  virtual void IntegerOrWord(std::string_view key, std::optional<std::int64_t>& value,
                             std::int64_t min, std::int64_t max, std::string_view word) = 0;

  template <std::integral T>
  void Integer(std::string_view key, T& value, std::int64_t min, std::int64_t max,
               Need need = Need::kOptional) {
    std::int64_t wide = static_cast<std::int64_t>(value);
    DoInteger(key, wide, min, max, need);
    value = static_cast<T>(wide);
  }

  template <class E, std::size_t N>
  void Enum(std::string_view key, E& value, const Choice<E> (&choices)[N],
            Need need = Need::kOptional) {
    std::vector<Word> words;
    std::size_t index = 0;
    for (std::size_t i = 0; i < N; ++i) {
      words.push_back({choices[i].word, choices[i].value.has_value()});
      if (choices[i].value == value) index = i;
    }
    DoEnum(key, index, words, need);
    if (choices[index].value) value = *choices[index].value;
  }

  void OptionalNumber(std::string_view key, std::optional<double>& value, Range range) {
    if (!Present(key, value.has_value())) return;
    if (!value) value = 0;
    Number(key, *value, range);
  }

  template <class T>
  void OptionalTable(std::string_view key, std::optional<T>& value,
                     const std::function<void(FieldVisitor&, T&)>& body) {
    if (!Present(key, value.has_value())) return;
    if (!value) value.emplace();
    Table(key, Need::kOptional, [&](FieldVisitor& v) { body(v, *value); });
  }

 protected:
  struct Word {
    std::string_view word;
    bool supported = true;
  };

  virtual void DoInteger(std::string_view key, std::int64_t& value, std::int64_t min,
                         std::int64_t max, Need need) = 0;
  virtual void DoEnum(std::string_view key, std::size_t& index, std::span<const Word> words,
                      Need need) = 0;
};

}  // namespace bendloop::config
