// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <span>
#include <vector>

#include "drivers/simulated_bender/sdo_server.h"

namespace bendloop::test {

// Objects in memory; any below 0x3000 can be written.
class SdoStore final : public drivers::SdoObjects {
 public:
  struct Less {
    bool operator()(drivers::ObjectId a, drivers::ObjectId b) const {
      return a.index < b.index || (a.index == b.index && a.sub < b.sub);
    }
  };

  std::uint32_t Read(drivers::ObjectId object, std::vector<std::uint8_t>& bytes) override {
    const auto found = objects.find(object);
    if (found == objects.end()) return drivers::kAbortNoObject;
    bytes = found->second;
    return 0;
  }
  std::uint32_t Write(drivers::ObjectId object, std::span<const std::uint8_t> bytes) override {
    if (object.index >= 0x3000) return drivers::kAbortNoObject;
    ++writes;
    objects[object].assign(bytes.begin(), bytes.end());
    return 0;
  }

  std::map<drivers::ObjectId, std::vector<std::uint8_t>, Less> objects{{{0x1000, 0}, {1, 2, 3, 4}},
                                                                       {{0x1001, 0}, {0}},
                                                                       {{0x1018, 0}, {4}},
                                                                       {{0x1018, 1}, {9, 9, 0, 0}}};
  int writes = 0;
};

}  // namespace bendloop::test
