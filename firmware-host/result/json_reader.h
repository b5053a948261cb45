// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "firmware-host/result/json.h"
#include "hal/error.h"

namespace bendloop::host {

// A program has tens of rows; a file with more than this is not a result of ours.
inline constexpr std::size_t kMaxRows = 10'000;

// Reads typed values out of a JSON tree and keeps the first thing that was wrong, with the JSON
// pointer to it; after that every read gives a default. So a reader is straight code with one check
// at its end. Refers to the tree: keep that alive.
class JsonReader {
 public:
  JsonReader(const Json& json, std::string_view name, std::optional<hal::Error>& error)
      : json_(&json), path_(name), error_(&error) {}

  bool Has(const char* key) const;       // present and not null
  JsonReader At(const char* key) const;  // missing: an error
  JsonReader Item(std::size_t index) const;
  std::size_t Size(std::size_t at_most) const;  // of an array

  double Number() const;  // null is NaN
  std::optional<double> NumberOrNull() const;
  std::size_t Count() const;  // a whole number, not negative
  bool Bool() const;
  std::uint32_t Count32() const;
  std::string Text() const;
  std::vector<std::string> Texts() const;

  // The same for a key that may be missing.
  double NumberOr(const char* key, double missing) const;
  std::string TextOr(const char* key, std::string missing = {}) const;

  const Json& json() const { return *json_; }
  void WrongText(std::string_view expected) const;  // the same, showing the string found
  void Wrong(std::string_view expected) const;      // "NAME: /a/b: found a string, expected ..."

 private:
  JsonReader(const Json& json, std::string path, std::optional<hal::Error>* error)
      : json_(&json), path_(std::move(path)), error_(error) {}

  void Fail(const std::string& what) const;

  const Json* json_;
  std::string path_;
  std::optional<hal::Error>* error_;
};

}  // namespace bendloop::host
