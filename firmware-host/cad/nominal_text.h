// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "firmware-host/cad/cad_tube.h"
#include "firmware-host/result/json.h"
#include "hal/tube.h"

namespace bendloop::host {

// A tube that was chosen, as it is written.
struct Nominal {
  std::string file;
  CadTube tube;
  hal::Tube program;  // rounded as the part file has it
};

// The body's name as it is shown; empty where it has none ("", "None").
std::string BodyName(const CadTube& tube);
// That, or what the file is called.
std::string PartName(const CadTube& tube, const std::string& file);

// "first end: cut 15.000 degrees oblique; 12.000 mm of it carry a fitting", one sentence each:
// ends, openings, notes.
std::vector<std::string> Remarks(const CadTube& tube);

// Rows and remarks for a person.
std::string NominalText(const Nominal& nominal);
// `bendloop.nominal/1`; `bendloop convert` reads it, too.
Json NominalJson(const Nominal& nominal);
// One line a tube: number, name, size, bends.
std::string TubeList(const std::vector<CadTube>& tubes);

}  // namespace bendloop::host
