// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <vector>

#include "tests/support/lot_controllers.h"

namespace bendloop::support {

// What became of one tube of a lot.
struct RunPart {
  hal::BendProgram tube;  // as it truly is
  TubeFate fate;
  bool in_tolerance = false;
  std::optional<double> forecast;  // made with the program that bent it
  // Largest change of the program that this tube's measurement led to, in scatters of the bender.
  double move = 0;
};

inline constexpr pipeline::RowTolerances kLotTolerance{0.5, 0.5, 0.4};

// A lot of so many tubes at a bender, whose belt holds its overlap. `before_part(n)`, n from 1, may
// change the bender.
std::vector<RunPart> RunLot(LotBender& bender, const LotControllerKind& kind, unsigned parts,
                            void (*before_part)(LotBender&, unsigned) = nullptr,
                            const pipeline::RowTolerances& tolerance = kLotTolerance);

// The tube's value less the nominal's, each in scatters of the bender, worst first row first.
std::vector<double> OffInScatters(const LotBender& bender, const hal::BendProgram& tube);

}  // namespace bendloop::support
