// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "firmware-host/cad/cad_shape.h"

namespace bendloop::host {

// Bodies that are pieces of one tube become one body, of the first one's name or that of their
// assembly: programs that set a tube together from primitives write a solid for each straight and
// each bend, or a body for each line and each arc of a centre line. Joined is what meets end to
// end, tangent and of one radius, where one of the two is a bend; bodies of one straight or bend
// each, though they end before each other or reach into each other a little (two straights in line,
// of bodies of more, may be two parts); or curves that share an end. Free surfaces that are
// cylinders or tori become these on the way.
void JoinBodies(CadShape& shape);

}  // namespace bendloop::host
