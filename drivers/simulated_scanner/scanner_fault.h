// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>

#include "hal/result.h"

namespace bendloop::drivers {

// What a scanner should not do, done once before the next profile.
struct ScannerFault {
  enum class Kind : std::uint8_t {
    kGap,      // leaves out `amount` profiles
    kRepeat,   // sends the next profile twice
    kGarbage,  // `amount` random bytes between messages
    kCorrupt,  // one wrong byte in the next profile's message
    kBadPose,  // a whole message with a pose that is none
    kStall,    // no profiles for `amount` milliseconds
    kFault,    // a fault event
    kFlood,    // the next profile `amount` times at once
    kMute,     // says nothing at all for `amount` milliseconds, not even replies
    kCut,      // half a message, then the connection is closed or the cable pulled
    kHalt,     // USB: the IN pipe stalls
    kUnplug,   // USB: the cable is out for `amount` milliseconds
  };
  Kind kind = Kind::kGap;
  std::uint32_t amount = 1;
  std::uint32_t after = 0;  // so many more profiles
};

// One line a fault, for help texts; with `usb` those of a cable, too.
std::string ScannerFaultHelp(bool usb);

// "stall 200 after 50": name, amount (1 if not given) and after (0). kUsage, naming all faults, for
// anything else.
hal::Result<ScannerFault> ParseScannerFault(const std::string& words, bool usb);

}  // namespace bendloop::drivers
