// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>

#include "firmware-host/commit/commit_protocol.h"
#include "hal/bend_program.h"
#include "pipeline/correction/correction.h"
#include "pipeline/correction/interlocks.h"
#include "pipeline/inspection/inspection.h"
#include "pipeline/tube/measurement.h"

namespace bendloop::host {

// Everything that one scan of one part led to, as far as the run came.
struct RunResult {
  std::string part;      // name of the part; empty for a cloud without one
  std::string session;   // id of the session or name of the cloud's file
  std::string time;      // ISO 8601, when the scan started, from the session; never "now"
  std::string software;  // name and version
  std::string identity;  // of the tube, where somebody told it: a serial number, a barcode
  // The session whose tube this scan shows once more; empty: a tube of its own, as far as known.
  std::string repeat_of;

  pipeline::Measurement measurement;
  std::optional<hal::BendProgram> nominal;
  std::optional<pipeline::Inspection> inspection;
  std::optional<hal::ProgramBlock> commanded;  // the program that bent this part
  std::optional<pipeline::Correction> correction;
  std::optional<pipeline::InterlockReport> interlocks;
  std::optional<CommitReport> bender;
};

}  // namespace bendloop::host
