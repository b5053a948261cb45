// SPDX-License-Identifier: Apache-2.0
#include "config/part_writer.h"

#include <cstdio>
#include <sstream>
#include <string_view>

#include "config/fields.h"
#include "config/toml_reader.h"

namespace bendloop::config {
namespace {

std::string Quoted(std::string_view text) {
  std::string quoted = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') {
      quoted += '\\';
      quoted += c;
    } else if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) {
      char code[8];
      std::snprintf(code, sizeof code, "\\u%04X", static_cast<unsigned>(c));
      quoted += code;
    } else {
      quoted += c;
    }
  }
  return quoted + '"';
}

// Plain keys stand before the tables of a struct, as its Visit function names them.
class TomlWriter final : public FieldVisitor {
 public:
  std::string text;

  void Number(std::string_view key, double& value, Range /*range*/, Need /*need*/) override {
    Write(key, NumberText(value));
  }
  void Bool(std::string_view key, bool& value) override { Write(key, value ? "true" : "false"); }
  void Text(std::string_view key, std::string& value, Need /*need*/) override {
    Write(key, Quoted(value));
  }
  void Path(std::string_view key, std::filesystem::path& value, Need /*need*/) override {
    Write(key, Quoted(value.string()));
  }
  void Points(std::string_view key, std::vector<Eigen::Vector3d>& value, Range /*range*/,
              std::size_t /*max_points*/) override {
    std::string list = "[\n";
    for (const Eigen::Vector3d& p : value) {
      list +=
          "  [" + NumberText(p.x()) + ", " + NumberText(p.y()) + ", " + NumberText(p.z()) + "],\n";
    }
    Write(key, list + "]");
  }
  void Table(std::string_view key, Need /*need*/, const Body& body) override {
    text += "\n[" + std::string(key) + "]\n";
    body(*this);
  }
  void Tables(std::string_view key, std::size_t& size, std::size_t /*max_size*/,
              const EntryBody& body) override {
    for (std::size_t i = 0; i < size; ++i) {
      text += "\n[[" + std::string(key) + "]]\n";
      body(*this, i);
    }
  }
  bool Present(std::string_view /*key*/, bool has_value) override { return has_value; }
  bool Chosen(std::string_view /*key*/, bool is_chosen) override { return is_chosen; }
  void IntegerOrWord(std::string_view key, std::optional<std::int64_t>& value, std::int64_t /*min*/,
                     std::int64_t /*max*/, std::string_view word) override {
    Write(key, value ? std::to_string(*value) : Quoted(word));
  }

 private:
  void DoInteger(std::string_view key, std::int64_t& value, std::int64_t /*min*/,
                 std::int64_t /*max*/, Need /*need*/) override {
    Write(key, std::to_string(value));
  }
  void DoEnum(std::string_view key, std::size_t& index, std::span<const Word> words,
              Need /*need*/) override {
    Write(key, Quoted(words[index].word));
  }
  void Write(std::string_view key, const std::string& value) {
    text += std::string(key) + " = " + value + "\n";
  }
};

}  // namespace

std::string PartToml(const PartConfig& part, const std::string& comment) {
  std::string head;
  std::istringstream lines(comment);
  for (std::string line; std::getline(lines, line);) {
    head += line.empty() ? "#\n" : "# " + line + "\n";
  }
  TomlWriter writer;
  PartConfig copy = part;  // visitors may change what they visit; this one does not
  VisitPart(writer, copy);
  return head + "schema = \"bendloop.part/1\"\n" + writer.text;
}

}  // namespace bendloop::config
