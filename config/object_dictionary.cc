// SPDX-License-Identifier: Apache-2.0
#include "config/object_dictionary.h"

#include <algorithm>
#include <charconv>
#include <map>
#include <optional>
#include <set>

#include "config/load.h"
#include "config/toml_document.h"
#include "hal/text.h"

namespace bendloop::config {
namespace {

using hal::Lower;
using hal::Trimmed;

constexpr std::size_t kMaxDictionaryProblems = 20;
constexpr std::uint64_t kMaxSubs = 254;
constexpr std::size_t kMaxObjects = 100000;

std::optional<std::uint64_t> Digits(std::string_view text, int base) {
  std::uint64_t value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value, base);
  if (text.empty() || error != std::errc() || end != text.data() + text.size()) return {};
  return value;
}

// CiA 306: 0x is hexadecimal, a leading 0 octal.
std::optional<std::uint64_t> Number(std::string_view text) {
  if (text.size() > 2 && text[0] == '0' && (text[1] == 'x' || text[1] == 'X')) {
    return Digits(text.substr(2), 16);
  }
  if (text.size() > 1 && text[0] == '0') return Digits(text.substr(1), 8);
  return Digits(text, 10);
}

// "2001" and "2001sub3" are objects; other sections are not.
std::optional<hal::ObjectAddress> AddressOf(const std::string& section) {
  if (section.size() < 4) return {};
  const auto index = Digits(std::string_view(section).substr(0, 4), 16);
  if (!index || *index == 0) return {};
  hal::ObjectAddress address{static_cast<std::uint16_t>(*index), 0};
  if (section.size() == 4) return address;
  if (section.compare(4, 3, "sub") != 0 || section.size() > 9) return {};
  const auto sub = Digits(std::string_view(section).substr(7), 16);
  if (!sub) return {};
  address.sub = static_cast<std::uint8_t>(*sub);
  return address;
}

struct Entry {
  std::string value;
  std::uint32_t line = 0;
};

struct Section {
  std::uint32_t line = 0;
  std::map<std::string, Entry> entries;  // by key in lower case
};

class EdsReader {
 public:
  explicit EdsReader(std::string_view name) : name_(name) {}

  hal::Result<ObjectDictionary> Read(std::string_view text) {
    if (text.size() > kMaxFileBytes) {
      return hal::Fail(hal::ErrorKind::kBadInput, name_ + ": found " + std::to_string(text.size()) +
                                                      " bytes, expected at most " +
                                                      std::to_string(kMaxFileBytes));
    }
    Split(text);
    ObjectDictionary dictionary;
    dictionary.file = name_;
    if (problem_count_ == 0) Gather(dictionary);
    if (problem_count_ == 0 && dictionary.objects.empty()) {
      Report(1,
             "found no object, expected an EDS file with sections such as [1000] and [2000sub1]");
    }
    if (problem_count_ > 0) return hal::Fail(hal::ErrorKind::kBadInput, Problems());
    return dictionary;
  }

 private:
  void Report(std::uint32_t line, const std::string& what) {
    ++problem_count_;
    if (problems_.size() < kMaxDictionaryProblems) {
      problems_.push_back(name_ + ":" + std::to_string(line) + ": " + what);
    }
  }

  std::string Problems() const {
    std::string text;
    if (problem_count_ > 1) {
      text = name_ + ": " + std::to_string(problem_count_) + " problems" +
             (problem_count_ > problems_.size()
                  ? ", the first " + std::to_string(problems_.size()) + " are:\n"
                  : std::string(":\n"));
    }
    for (std::size_t i = 0; i < problems_.size(); ++i) text += (i > 0 ? "\n" : "") + problems_[i];
    return text;
  }

  void Split(std::string_view text) {
    Section* section = nullptr;
    for (std::uint32_t line = 1; !text.empty(); ++line) {
      const std::size_t end = std::min(text.find('\n'), text.size());
      const std::string_view content = Trimmed(text.substr(0, end));
      text.remove_prefix(std::min(end + 1, text.size()));
      if (content.empty() || content.front() == ';') continue;
      if (content.front() == '[' && content.back() == ']') {
        section = Open(Lower(content.substr(1, content.size() - 2)), line);
      } else {
        Add(section, content, line);
      }
    }
  }

  Section* Open(const std::string& name, std::uint32_t line) {
    const auto [place, is_new] = sections_.try_emplace(name);
    if (!is_new) {
      Report(line, "[" + Printable(name) +
                       "]: found this section a second time, expected it once (" + name_ + ":" +
                       std::to_string(place->second.line) + ")");
    }
    place->second.line = line;
    return &place->second;
  }

  void Add(Section* section, std::string_view content, std::uint32_t line) {
    const std::size_t equals = content.find('=');
    if (equals == std::string_view::npos || section == nullptr) {
      return Report(line, "found '" + Printable(content) +
                              "', expected a [section], then lines of the form key=value; comments "
                              "begin with ;");
    }
    const std::string key = Lower(Trimmed(content.substr(0, equals)));
    const Entry entry{std::string(Trimmed(content.substr(equals + 1))), line};
    if (!section->entries.try_emplace(key, entry).second) {
      Report(line,
             "found key '" + Printable(key) + "' a second time in its section, expected it once");
    }
  }

  // A number of `section`, `otherwise` if it is not there or empty.
  std::uint64_t NumberOf(const std::string& name, const Section& section, const char* key,
                         std::uint64_t most, std::uint64_t otherwise) {
    const auto found = section.entries.find(Lower(key));
    if (found == section.entries.end() || found->second.value.empty()) return otherwise;
    const auto number = Number(found->second.value);
    if (number && *number <= most) return *number;
    Report(found->second.line, "[" + name + "] " + key + ": found '" +
                                   Printable(found->second.value) +
                                   "', expected a number from 0 to " + std::to_string(most));
    return otherwise;
  }

  void Gather(ObjectDictionary& dictionary) {
    if (const auto info = sections_.find("deviceinfo"); info != sections_.end()) {
      dictionary.vendor_number = static_cast<std::uint32_t>(
          NumberOf("DeviceInfo", info->second, "VendorNumber", 0xffffffff, 0));
      dictionary.product_number = static_cast<std::uint32_t>(
          NumberOf("DeviceInfo", info->second, "ProductNumber", 0xffffffff, 0));
    }
    for (const auto& [name, section] : sections_) {
      if (const auto address = AddressOf(name)) AddObject(dictionary, name, section, *address);
    }
    auto& objects = dictionary.objects;
    const auto order = [](const DictionaryObject& a, const DictionaryObject& b) {
      return std::pair(a.address.index, a.address.sub) < std::pair(b.address.index, b.address.sub);
    };
    // A sub-index with a section of its own comes before one of a compact array.
    std::stable_sort(objects.begin(), objects.end(), order);
    objects.erase(std::unique(objects.begin(), objects.end(),
                              [](const auto& a, const auto& b) { return a.address == b.address; }),
                  objects.end());
  }

  void AddObject(ObjectDictionary& dictionary, const std::string& name, const Section& section,
                 hal::ObjectAddress address) {
    DictionaryObject object;
    object.address = address;
    object.line = section.line;
    constexpr std::uint64_t kVar = 7;
    constexpr std::uint64_t kDomainObject = 2;
    constexpr std::uint64_t kDomainType = 15;
    const std::uint64_t kind = NumberOf(name, section, "ObjectType", 0xff, kVar);
    object.data_type = static_cast<std::uint16_t>(
        NumberOf(name, section, "DataType", 0xffff, kind == kDomainObject ? kDomainType : 0));
    const std::uint64_t compact = NumberOf(name, section, "CompactSubObj", kMaxSubs, 0);
    if (const auto access = section.entries.find("accesstype"); access != section.entries.end()) {
      const std::string word = Lower(access->second.value);
      if (!std::set<std::string>{"ro", "wo", "rw", "rwr", "rww", "const", ""}.contains(word)) {
        Report(access->second.line, "[" + name + "] AccessType: found '" +
                                        Printable(access->second.value) +
                                        "', expected ro, wo, rw, rwr, rww or const");
      }
      object.readable = word != "wo" && !word.empty();
      object.writable = word == "wo" || word.compare(0, 2, "rw") == 0;
    }
    if (dictionary.objects.size() + compact > kMaxObjects) {
      return Report(object.line, "[" + name + "]: found more than " + std::to_string(kMaxObjects) +
                                     " objects, expected fewer");
    }
    // A record's or an array's own section tells nothing; its sub-indices have theirs.
    if (object.data_type != 0 && compact == 0) dictionary.objects.push_back(object);
    for (std::uint64_t sub = 1; sub <= compact && address.sub == 0; ++sub) {
      object.address.sub = static_cast<std::uint8_t>(sub);
      dictionary.objects.push_back(object);
    }
  }

  const std::string name_;
  std::map<std::string, Section> sections_;  // by name in lower case
  std::vector<std::string> problems_;        // the first kMaxDictionaryProblems
  std::size_t problem_count_ = 0;
};

}  // namespace

const DictionaryObject* ObjectDictionary::Find(hal::ObjectAddress address) const {
  const auto found = std::find_if(objects.begin(), objects.end(),
                                  [&](const auto& object) { return object.address == address; });
  return found == objects.end() ? nullptr : &*found;
}

hal::Result<ObjectDictionary> ParseObjectDictionary(std::string_view eds, std::string_view name) {
  return EdsReader(name).Read(eds);
}

hal::Result<ObjectDictionary> LoadObjectDictionary(const std::filesystem::path& file) {
  const hal::Result<std::string> text = ReadTextFile(file);
  if (!text) return hal::Fail(text.error());
  return ParseObjectDictionary(*text, file.string());
}

}  // namespace bendloop::config
