// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "hal/bend_program.h"
#include "hal/bender_link.h"
#include "hal/register_map.h"

namespace bendloop::test {

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
