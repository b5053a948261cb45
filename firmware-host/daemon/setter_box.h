// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>

#include "firmware-host/daemon/setter_desk.h"
#include "hal/clock.h"

namespace bendloop::host {

// How a command asks the running daemon: a file in requests/ of the state directory, whose rights
// say who may ask, and whose owner is who asked. No port of the machine is open for it.
//   requests/NAME.request.json  written by the command, removed by the daemon when it is taken
//   requests/NAME.answer.json   written by the daemon, removed by the command
class SetterBox {
 public:
  explicit SetterBox(const std::filesystem::path& state_dir) : box_(state_dir / "requests") {}

  // Of the command: waits for the daemon, which answers between two parts. kDevice when it does not
  // take the request in that time; it is withdrawn then. `part_number` as in SetterRequest.
  hal::Result<SetterAnswer> Ask(SetterWish wish, std::uint32_t part_number,
                                std::chrono::nanoseconds patience, hal::Clock& clock) const;
  // Of the daemon: answers what lies in the box and may be granted now; the rest stays in it. Where
  // memory ends in the middle of granting, that is answered, and thrown.
  void Serve(const std::function<bool(const SetterRequest&)>& may_be_granted,
             const std::function<SetterAnswer(const SetterRequest&)>& grant) const;

 private:
  std::filesystem::path box_;
};

// The name of this process' user; of sudo's caller where there is one.
std::string OwnUser();

}  // namespace bendloop::host
