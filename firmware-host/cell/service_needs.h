// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <string>
#include <vector>

#include "config/cell_config.h"
#include "hal/result.h"

namespace bendloop::host {

// What a cell needs of the machine beyond its own files and 127.0.0.1.
struct ServiceNeeds {
  bool usb = false;
  bool serial = false;
  bool can = false;
  std::vector<std::string> addresses = {};  // numeric, not of this machine; each once
  std::chrono::nanoseconds stop{};          // what a stop may last
  std::uint64_t memory_mb = 0;              // as MemoryMax
};
ServiceNeeds NeedsOf(const config::CellConfig& cell);

// The unit's MemoryMax: twice what a cell with the queue that none names takes at most
// (tests/ship/memory.sh).
inline constexpr std::uint64_t kUnitMemoryMb = 1024;

// The unit's environment says what it grants: "usb serial can", and addresses.
inline constexpr const char* kGrantedVariable = "BENDLOOP_GRANTED";

// A drop-in for bendloopd.service that grants what the cell needs and nothing else. `file` is the
// cell file, for the comment.
std::string UnitDropIn(const ServiceNeeds& needs, const std::string& file);

// kBadInput, with the mend, where the service that runs us does not grant what the cell needs: its
// packets would be dropped without a word. `granted` is the variable's text; nullptr: no service.
hal::Result<void> CheckGranted(const ServiceNeeds& needs, const char* granted);

}  // namespace bendloop::host
