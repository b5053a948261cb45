// SPDX-License-Identifier: Apache-2.0
#include "config/map_objects.h"

#include <algorithm>
#include <optional>
#include <vector>

#include "config/object_dictionary.h"
#include "config/plc_fields.h"

namespace bendloop::config {
namespace {

using hal::RegisterField;
using hal::RegisterMap;
using hal::RegisterType;

struct ObjectType {
  std::uint16_t number;  // CiA 301
  const char* name;
  std::optional<RegisterType> type;  // that a field can have
  double most = 0;
};

constexpr std::uint16_t kVisibleString = 0x0009;
constexpr std::uint16_t kOctetString = 0x000a;
constexpr std::uint16_t kDomain = 0x000f;

constexpr ObjectType kTypes[] = {{0x0003, "INTEGER16", RegisterType::kInt16, 32767},
                                 {0x0004, "INTEGER32", RegisterType::kInt32, 2147483647},
                                 {0x0005, "UNSIGNED8", RegisterType::kUint8, 255},
                                 {0x0006, "UNSIGNED16", RegisterType::kUint16, 65535},
                                 {0x0007, "UNSIGNED32", RegisterType::kUint32, 4294967295},
                                 {0x0001, "BOOLEAN", {}},
                                 {0x0002, "INTEGER8", {}},
                                 {0x0008, "REAL32", {}},
                                 {kVisibleString, "VISIBLE_STRING", {}},
                                 {kOctetString, "OCTET_STRING", {}},
                                 {kDomain, "DOMAIN", {}}};

const ObjectType* TypeOf(std::uint16_t number) {
  const auto* found = std::find_if(std::begin(kTypes), std::end(kTypes),
                                   [&](const ObjectType& type) { return type.number == number; });
  return found == std::end(kTypes) ? nullptr : found;
}

double MostOf(RegisterType type) {
  for (const ObjectType& known : kTypes) {
    if (known.type == type) return known.most;
  }
  return 0;
}

std::string TypeName(std::uint16_t number) {
  const ObjectType* known = TypeOf(number);
  return "DataType " + std::to_string(number) +
         (known ? std::string(" (") + known->name + ")" : "");
}

class Binder {
 public:
  Binder(RegisterMap& map, const ObjectDictionary& dictionary)
      : map_(map), dictionary_(dictionary) {}

  hal::Result<void> Bind() {
    VisitPlaces(map_, [&](const MapPlace& place) { BindPlace(place); });
    if (problems_.empty()) {
      CheckHolds("active.row_count", map_.active.row_count, map_.max_rows);
      CheckHolds("staging.row_count", map_.staging.row_count, map_.max_rows);
      CheckHolds(
          "state.mode", map_.mode,
          std::max({map_.mode_not_ready, map_.mode_idle, map_.mode_bending, map_.mode_fault}));
      CheckHolds("commit.reply", map_.reply, std::max(map_.reply_accepted, map_.reply_rejected));
      CheckSame("active.sequence", map_.active.sequence, map_.staging.sequence);
      CheckSame("commit.reply_sequence", map_.reply_sequence, map_.staging.sequence);
      if (map_.commit) CheckSame("commit.sequence", *map_.commit, map_.staging.sequence);
      CheckSame("active.part_number", map_.active.part_number, map_.staging.part_number);
    }
    if (next_ > 65536) {
      problems_ += (problems_.empty() ? "" : "\n") + dictionary_.file +
                   ": the rows of register map \"" + map_.name + "\" take " +
                   std::to_string(2 * next_) + " bytes, expected at most 131072";
    }
    if (problems_.empty()) return {};
    return hal::Fail(hal::ErrorKind::kBadInput, problems_);
  }

 private:
  void Report(const DictionaryObject* object, const MapPlace& place, const std::string& what) {
    problems_ += (problems_.empty() ? "" : "\n") + dictionary_.file + ":" +
                 std::to_string(object ? object->line : 1) + ": [" + hal::Name(place.object()) +
                 "]: " + what + " for '" + place.path + "' of register map \"" + map_.name + "\"";
  }

  void BindPlace(const MapPlace& place) {
    const DictionaryObject* object = dictionary_.Find(place.object());
    if (object == nullptr) return Report(object, place, "found no such object, expected one");
    if ((!place.is_written || place.is_read_back) && !object->readable) {
      Report(object, place, "found an object that cannot be read, expected AccessType ro or rw");
    }
    if (place.is_written && !object->writable) {
      Report(object, place, "found an object that cannot be written, expected AccessType rw");
    }
    if (place.text != nullptr) return BindText(*object, place);
    if (place.field == nullptr) {
      if (object->data_type != kDomain && object->data_type != kOctetString) {
        Report(
            object, place,
            "found " + TypeName(object->data_type) + ", expected 15 (DOMAIN) or 10 (OCTET_STRING)");
      }
      place.area->rows_address =
          AddressFor(place.object(), std::uint32_t{map_.max_rows} * map_.row_stride);
      return;
    }
    const ObjectType* type = TypeOf(object->data_type);
    const bool is_crc = place.path.ends_with(".crc");
    if (type == nullptr || !type->type || (is_crc && type->type != RegisterType::kUint32)) {
      return Report(object, place,
                    "found " + TypeName(object->data_type) + ", expected " +
                        (is_crc ? "7 (UNSIGNED32)"
                                : "5, 6 or 7 (UNSIGNED8, 16, 32), 3 or 4 "
                                  "(INTEGER16, 32)"));
    }
    place.field->type = *type->type;
    place.field->address = AddressFor(place.object(), RegisterCount(*type->type));
  }

  void BindText(const DictionaryObject& object, const MapPlace& place) {
    if (object.data_type != kDomain && object.data_type != kOctetString &&
        object.data_type != kVisibleString) {
      Report(&object, place,
             "found " + TypeName(object.data_type) +
                 ", expected 9 (VISIBLE_STRING), 10 (OCTET_STRING) or 15 (DOMAIN)");
    }
    place.text->address = AddressFor(place.object(), place.text->registers());
  }

  // The same object is kept in the same registers.
  std::uint16_t AddressFor(hal::ObjectAddress object, std::uint32_t count) {
    for (const auto& [known, address] : addresses_) {
      if (known == object) return address;
    }
    const auto address = static_cast<std::uint16_t>(next_);
    addresses_.emplace_back(object, address);
    next_ += count;
    return address;
  }

  void CheckHolds(const std::string& path, RegisterField& field, std::uint32_t most) {
    if (most <= MostOf(field.type)) return;
    Report(dictionary_.Find(field.object), {path, &field},
           "found a type that holds up to " +
               std::to_string(static_cast<long>(MostOf(field.type))) +
               ", expected one that holds " + std::to_string(most));
  }

  void CheckSame(const std::string& path, RegisterField& field, const RegisterField& other) {
    if (field.type == other.type) return;
    Report(dictionary_.Find(field.object), {path, &field},
           "found another type than [" + hal::Name(other.object) + "] has, expected the same");
  }

  RegisterMap& map_;
  const ObjectDictionary& dictionary_;
  std::vector<std::pair<hal::ObjectAddress, std::uint16_t>> addresses_;
  std::uint32_t next_ = 0;
  std::string problems_;
};

// What the PLC reads and says.
void VisitPlcPlaces(RegisterMap& map, const std::function<void(const MapPlace&)>& visit) {
  hal::ReportFields& report = map.report;
  for (const auto& [key, field] : FieldsOf(report)) {
    if (*field) visit({"report." + std::string(key), &**field, nullptr, true, false});
  }
  if (report.identity) {
    visit({"report.identity", nullptr, nullptr, true, false, &*report.identity});
  }
  hal::OrderFields& orders = map.orders;
  for (const auto& [key, field] : FieldsOf(orders)) {
    if (*field) visit({"orders." + std::string(key), &**field});
  }
  if (orders.identity) {
    visit({"orders.identity", nullptr, nullptr, false, false, &*orders.identity});
  }
}

}  // namespace

void VisitPlaces(RegisterMap& map, const std::function<void(const MapPlace&)>& visit) {
  const auto field = [&](const char* path, RegisterField& f) { visit({path, &f}); };
  const auto optional = [&](const char* path, std::optional<RegisterField>& f) {
    if (f) visit({path, &*f});
  };
  const auto area = [&](const std::string& path, hal::ProgramArea& a, bool written) {
    visit({path + ".part_number", &a.part_number, nullptr, written, written});
    visit({path + ".sequence", &a.sequence, nullptr, written, written});
    visit({path + ".row_count", &a.row_count, nullptr, written, written});
    visit({path + ".crc", &a.crc, nullptr, written, written});
    visit({path + ".rows", nullptr, &a, written, written});
  };
  field("state.mode", map.mode);
  optional("state.fault_code", map.fault_code);
  optional("state.heartbeat", map.heartbeat);
  optional("state.parts_bent", map.parts_bent);
  if (map.commit) visit({"commit.sequence", &*map.commit, nullptr, true, false});
  field("commit.reply_sequence", map.reply_sequence);
  field("commit.reply", map.reply);
  optional("commit.reply_code", map.reply_code);
  VisitPlcPlaces(map, visit);
  area("active", map.active, false);
  area("staging", map.staging, true);
}

void CheckOneKind(TomlDocument& document, RegisterMap& map) {
  VisitPlaces(map, [&](const MapPlace& place) {
    const bool is_object = place.object().index != 0;
    if (is_object == map.of_objects() || !document.IsGood(place.path)) return;
    document.Report(place.path, std::string("found an ") + (is_object ? "object" : "address") +
                                    ", expected " +
                                    (is_object ? "an address" : "an object (index, sub)") +
                                    " as in 'state.mode' (" + document.Place("state.mode") + ")");
  });
}

void CheckObjects(TomlDocument& document, RegisterMap& map) {
  std::vector<MapPlace> places;
  VisitPlaces(map, [&](const MapPlace& place) {
    if (place.object().index == 0) return;  // reported
    const auto same = std::find_if(places.begin(), places.end(), [&](const MapPlace& other) {
      return other.object() == place.object();
    });
    // A controller with a single program has no commit: what is staged is what it bends.
    const bool shared = !map.commit && place.path.starts_with("staging.");
    if (same == places.end() || shared) return places.push_back(place);
    document.Report(place.path, "found object " + hal::Name(place.object()) +
                                    ", expected another one than '" + same->path + "' has (" +
                                    document.Place(same->path) + ")");
  });
  if (document.root().contains("words")) {
    document.Report("words", "found a table, expected none: CANopen has its own order of bytes");
  }
  map.high_word_first = false;  // CANopen is little-endian
  map.high_byte_first = false;
}

hal::Result<void> BindObjects(RegisterMap& map, const ObjectDictionary& dictionary) {
  return Binder(map, dictionary).Bind();
}

}  // namespace bendloop::config
