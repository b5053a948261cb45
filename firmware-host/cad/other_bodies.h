// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "firmware-host/cad/cad_tube.h"

namespace bendloop::host {

// A sentence for each other body about the axis of an end of `tube`, near that end (nuts, flanges,
// sleeves), by its name, where it lies and how wide it is; and one with the number of all others
// that are no tubes. `tubes` are those of `shape`.
struct OtherBodyNotes {
  std::vector<std::string> placed, placed_reversed;  // as counted from either end
  std::vector<std::string> notes;
};
OtherBodyNotes NotesOfOtherBodies(const CadShape& shape, const std::vector<CadTube>& tubes,
                                  const CadTube& tube);

}  // namespace bendloop::host
