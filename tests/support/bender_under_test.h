// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <string>

#include "hal/bend_program.h"
#include "hal/bender_link.h"
#include "hal/register_map.h"

namespace bendloop::test {

// How long a link under test waits for an answer: where one must come, however the machine is
// loaded; and where none does, which costs a test this much each time.
constexpr std::chrono::milliseconds kPatient{10'000}, kImpatient{500};

// A link with the bender at its other end, seen from the bender's side.
class BenderUnderTest {
 public:
  virtual ~BenderUnderTest() = default;
  virtual hal::BenderLink& link() = 0;
  virtual hal::ProgramBlock Active() = 0;
  virtual hal::ProgramBlock Staged() = 0;
  virtual void Say(const hal::PlcOrders& orders) = 0;
  virtual hal::CellReport Heard() = 0;
  virtual const hal::RegisterMap& map() const = 0;
  virtual void Misbehave(const std::string& command) = 0;
};

}  // namespace bendloop::test
