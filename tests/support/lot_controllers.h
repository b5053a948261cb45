// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "pipeline/correction/correction.h"
#include "tests/support/lot_bender.h"

namespace bendloop::support {

// Whoever makes programs out of measured tubes.
class LotController {
 public:
  virtual ~LotController() = default;
  // The program after `tube`, which `commanded` bent, was measured; the bender holds `active`.
  virtual hal::BendProgram Next(const hal::BendProgram& commanded, const LotBender::Scan& scan,
                                const hal::BendProgram& active) = 0;
  // For the next tube; empty: it makes none.
  virtual std::optional<double> forecast() const { return std::nullopt; }
};

struct LotControllerKind {
  std::string name;
  std::unique_ptr<LotController> (*make)(const LotBender& bender,
                                         const pipeline::RowTolerances& tolerance);
};
// This one first; then a gain of 1, damping of 50 %, an EWMA of 0.3, the decaying gain with a
// deadband that bendloop had until November 2026, and last the oracle, which is shown what the
// bender truly is as soon as a tube was measured.
const std::vector<LotControllerKind>& LotControllers();

}  // namespace bendloop::support
