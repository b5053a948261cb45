// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "firmware-host/cad/cad_tube.h"

namespace bendloop::host {

// Tells of each tube which others of the list begin where it ends, in line and of its diameter: two
// parts, or one that is welded from them. Which they are no file says, so they are not joined.
void NoteEndToEnd(std::vector<CadTube>& tubes);

}  // namespace bendloop::host
