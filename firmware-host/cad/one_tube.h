// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "firmware-host/cad/cad_tube.h"

namespace bendloop::host {

// Whether both have the same rows, wall, ends and openings, each seen from the end that suits: one
// part that an assembly holds twice.
bool IsSamePart(const CadTube& a, const CadTube& b);

// Takes bodies within a tube into it: a bar that fills its bore (what flows in it, a mandrel) is
// left out, and of two bars on one centre line the inner is the bore. Both are told. A sleeve about
// a tube stays a tube of its own.
void TakeInnerBodies(std::vector<CadTube>& tubes);

// What a centre line among `tubes` that goes along `tube` says of it: whether it agrees, in a
// sentence; empty where the file has none.
std::string CentreLineNote(const std::vector<CadTube>& tubes, const CadTube& tube);

}  // namespace bendloop::host
