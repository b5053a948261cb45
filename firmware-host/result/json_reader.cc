// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/result/json_reader.h"

#include <limits>

namespace bendloop::host {
namespace {

const Json& Null() {
  static const Json null;
  return null;
}

}  // namespace

void JsonReader::Fail(const std::string& what) const {
  if (*error_) return;
  std::string message = path_ + what;
  // A key of the file may hold a line break; an error is one line.
  for (char& c : message) {
    if (static_cast<unsigned char>(c) < 0x20) c = '?';
  }
  *error_ = hal::Error{hal::ErrorKind::kBadInput, std::move(message)};
}

void JsonReader::Wrong(std::string_view expected) const {
  Fail(": found " + std::string(json_->type_name()) + ", expected " + std::string(expected));
}

void JsonReader::WrongText(std::string_view expected) const {
  Fail(": found " + Dump(*json_).substr(0, 60) + ", expected " + std::string(expected));
}

bool JsonReader::Has(const char* key) const {
  const auto it = json_->is_object() ? json_->find(key) : json_->end();
  return it != json_->end() && !it->is_null();
}

JsonReader JsonReader::At(const char* key) const {
  if (!json_->is_object()) {
    Wrong("an object with the key \"" + std::string(key) + "\"");
    return {Null(), path_ + "/" + key, error_};
  }
  const auto it = json_->find(key);
  if (it == json_->end()) {
    Fail(": key \"" + std::string(key) + "\" is missing from the object");
    return {Null(), path_ + "/" + key, error_};
  }
  return {*it, path_ + "/" + key, error_};
}

JsonReader JsonReader::Item(std::size_t index) const {
  const std::string path = path_ + "/" + std::to_string(index);
  if (!json_->is_array() || index >= json_->size()) {
    Wrong("an array of at least " + std::to_string(index + 1) + " values");
    return {Null(), path, error_};
  }
  return {(*json_)[index], path, error_};
}

std::size_t JsonReader::Size(std::size_t at_most) const {
  if (!json_->is_array()) {
    Wrong("an array");
    return 0;
  }
  if (json_->size() > at_most) {
    Wrong("at most " + std::to_string(at_most) + " values");
    return 0;
  }
  return json_->size();
}

double JsonReader::Number() const {
  return NumberOrNull().value_or(std::numeric_limits<double>::quiet_NaN());
}

std::optional<double> JsonReader::NumberOrNull() const {
  if (json_->is_number()) return json_->get<double>();
  if (!json_->is_null()) Wrong("a number or null");
  return std::nullopt;
}

std::size_t JsonReader::Count() const {
  if (json_->is_number_unsigned()) return json_->get<std::size_t>();
  Wrong("a whole number, 0 or more");
  return 0;
}

bool JsonReader::Bool() const {
  if (json_->is_boolean()) return json_->get<bool>();
  Wrong("true or false");
  return false;
}

std::string JsonReader::Text() const {
  if (json_->is_string()) return json_->get<std::string>();
  Wrong("a string");
  return {};
}

double JsonReader::NumberOr(const char* key, double missing) const {
  return Has(key) ? At(key).Number() : missing;
}

std::uint32_t JsonReader::Count32() const {
  const std::size_t value = Count();
  if (value > std::numeric_limits<std::uint32_t>::max()) {
    Wrong("a whole number below 2^32");
    return 0;
  }
  return static_cast<std::uint32_t>(value);
}

std::vector<std::string> JsonReader::Texts() const {
  std::vector<std::string> texts;
  for (std::size_t i = 0, n = Size(kMaxRows); i < n; ++i) texts.push_back(Item(i).Text());
  return texts;
}

std::string JsonReader::TextOr(const char* key, std::string missing) const {
  return Has(key) ? At(key).Text() : std::move(missing);
}

}  // namespace bendloop::host
