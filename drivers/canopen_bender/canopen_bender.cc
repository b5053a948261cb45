// SPDX-License-Identifier: Apache-2.0
#include "drivers/canopen_bender/canopen_bender.h"

#include <algorithm>
#include <cstdio>
#include <optional>
#include <utility>
#include <vector>

#include "drivers/canopen_bender/object_table.h"
#include "drivers/register_bender/register_bender.h"

namespace bendloop::drivers {
namespace {

using hal::ErrorKind;
using Ranges = std::vector<RegisterRange>;

constexpr ObjectId kVendorId{0x1018, 1};
constexpr ObjectId kProductCode{0x1018, 2};

// The registers of `object` that are asked for, from its first one.
std::uint32_t Wanted(const Ranges& ranges, const MappedObject& object) {
  std::uint32_t wanted = 0;
  for (const RegisterRange& range : ranges) {
    if (range.space != object.range.space || range.count == 0) continue;
    if (range.address != object.range.address) continue;  // whole fields, rows from the first one
    wanted = std::max(wanted, std::min(range.count, object.range.count));
  }
  return wanted;
}

class CanopenCarrier final : public RegisterCarrier {
 public:
  CanopenCarrier(const hal::RegisterMap& map, const CanopenBenderOptions& options,
                 hal::Clock& clock, CanPortOpener open)
      : objects_(ObjectsOf(map)),
        options_(options),
        node_(options.interface + " node " + std::to_string(options.node_id), options.node_id,
              std::move(open), options.response_timeout, options.heartbeat_timeout, clock) {}

  std::string carrier() const override { return "CANopen"; }
  std::string peer() const override { return node_.name(); }

  hal::Result<void> Connect() override {
    if (auto open = node_.Open(); !open) return open;
    if (identified_) return {};
    if (auto ok = Identify(kVendorId, options_.vendor_id, "vendor id"); !ok) return ok;
    if (auto ok = Identify(kProductCode, options_.product_code, "product code"); !ok) return ok;
    identified_ = true;
    return {};
  }

  hal::Result<void> Read(const Ranges& ranges, RegisterImage& image) override {
    if (auto ok = Connect(); !ok) return ok;
    for (const MappedObject& object : objects_) {
      const std::size_t wanted = Wanted(ranges, object);
      if (wanted == 0) continue;
      const auto bytes = Upload(object);
      if (!bytes) return hal::Fail(bytes.error());
      const std::size_t least = object.is_rows ? 2 * wanted : object.bytes;
      if (bytes->size() < least) {
        return hal::Fail(ErrorKind::kDevice, "bender " + peer() + ": read " +
                                                 hal::Name(object.object) + ": " +
                                                 std::to_string(bytes->size()) +
                                                 " bytes came, expected " + std::to_string(least));
      }
      FromBytes(*bytes,
                image.At(object.range.space, static_cast<std::uint16_t>(object.range.address)));
    }
    return {};
  }

  hal::Result<void> Write(const Ranges& ranges, const RegisterImage& image) override {
    if (auto ok = Connect(); !ok) return ok;
    for (const MappedObject& object : objects_) {
      const std::size_t wanted = Wanted(ranges, object);
      if (wanted == 0) continue;
      const auto* from =
          image.At(object.range.space, static_cast<std::uint16_t>(object.range.address));
      const std::size_t size = object.is_rows ? 2 * wanted : object.bytes;
      if (auto ok = node_.Download(object.object, ToBytes(from, size), object.is_rows); !ok) {
        identified_ = false;
        return ok;
      }
    }
    return {};
  }

  Signs signs() const override {
    Signs signs;
    if (options_.heartbeat_timeout.count() > 0) signs.heartbeat = node_.watch().heartbeats();
    signs.fault_code = node_.watch().emergency();
    return signs;
  }

 private:
  hal::Result<std::vector<std::uint8_t>> Upload(const MappedObject& object) {
    auto bytes = node_.Upload(object.object, object.bytes, object.is_rows);
    if (!bytes) identified_ = false;  // whoever answers next may be another one
    return bytes;
  }

  hal::Result<void> Identify(ObjectId object, std::uint32_t expected, const char* what) {
    if (expected == 0) return {};
    const auto bytes = node_.Upload(object, 4, false);
    if (!bytes) return hal::Fail(bytes.error());
    std::uint32_t found = 0;
    for (std::size_t i = bytes->size(); i > 0; --i) found = found << 8 | (*bytes)[i - 1];
    if (found == expected) return {};
    char numbers[64];
    std::snprintf(numbers, sizeof numbers, " 0x%08X, expected 0x%08X", found, expected);
    return hal::Fail(ErrorKind::kDevice,
                     "bender " + peer() + ": another device: its " + what + " (object " +
                         hal::Name(object) + ") is" + numbers +
                         " as in the object dictionary file; mend can_node_id or "
                         "object_dictionary in the cell file");
  }

  const std::vector<MappedObject> objects_;
  const CanopenBenderOptions options_;
  CanopenNode node_;
  bool identified_ = false;
};

}  // namespace

std::unique_ptr<RegisterCarrier> MakeCanopenCarrier(const hal::RegisterMap& map,
                                                    const CanopenBenderOptions& options,
                                                    hal::Clock& clock, CanPortOpener open) {
  return std::make_unique<CanopenCarrier>(map, options, clock, std::move(open));
}

std::unique_ptr<RegisterCarrier> MakeCanopenCarrier(const hal::RegisterMap& map,
                                                    const CanopenBenderOptions& options,
                                                    hal::Clock& clock) {
  return MakeCanopenCarrier(
      map, options, clock,
      [interface = options.interface, ids = CanopenNode::Identifiers(options.node_id)] {
        return OpenCanPort(interface, ids);
      });
}

std::unique_ptr<hal::BenderLink> MakeCanopenBender(hal::RegisterMap map,
                                                   const CanopenBenderOptions& options,
                                                   hal::Clock& clock, CanPortOpener open) {
  auto carrier = MakeCanopenCarrier(map, options, clock, std::move(open));
  return MakeRegisterBender(std::move(map), std::move(carrier));
}

std::unique_ptr<hal::BenderLink> MakeCanopenBender(hal::RegisterMap map,
                                                   const CanopenBenderOptions& options,
                                                   hal::Clock& clock) {
  auto carrier = MakeCanopenCarrier(map, options, clock);
  return MakeRegisterBender(std::move(map), std::move(carrier));
}

}  // namespace bendloop::drivers
