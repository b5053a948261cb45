// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>

namespace bendloop::drivers {

// What a scanner should not do, done once before the next profile.
struct Misbehaviour {
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
    kUnplug,   // the cable is out for `amount` milliseconds
  };
  Kind kind = Kind::kGap;
  std::uint32_t amount = 1;
  std::uint32_t after = 0;  // so many more profiles
};

// "gap", "repeat", "garbage", "corrupt", "bad-pose", "stall", "fault", "flood", "mute", "cut",
// "halt", "unplug".
std::optional<Misbehaviour::Kind> MisbehaviourFromName(const std::string& name);

// "unplug 200 after 50": name, amount (1 if not given) and after (0).
std::optional<Misbehaviour> ParseMisbehaviour(const std::string& words);

}  // namespace bendloop::drivers
