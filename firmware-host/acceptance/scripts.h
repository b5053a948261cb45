// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "firmware-host/acceptance/bench.h"
#include "firmware-host/acceptance/hand_steps.h"

namespace bendloop::host {

// The robot's exchanges, in the order in which they are played. Each begins with a PLC that is idle
// and holds the bench's active program, and leaves it so.

// Reads only.
void PlayIdentity(Bench& bench);
// Why the PLC's registers make no sense: their words or bytes are the other way round than the map
// says (R3), or mode has a code that it does not name (R2). False: they make sense.
bool PlaySenseless(Bench& bench);
void PlayStaging(Bench& bench);     // every field's range, bits and order; commits nothing
void PlayCommits(Bench& bench);     // good programs
void PlayRejections(Bench& bench);  // bad ones, one rule at a time
void PlayWrapAround(Bench& bench);  // the largest sequence and what comes after it
void PlayHandSteps(Bench& bench, HandSteps& hands);

}  // namespace bendloop::host
