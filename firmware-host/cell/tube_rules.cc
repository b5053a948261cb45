// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cell/tube_rules.h"

#include "firmware-host/cell/bender_desk.h"

namespace bendloop::host {

LedgerRules LedgerRulesOf(const config::CellConfig& cell) {
  LedgerRules rules;
  rules.counted = config::TubesOf(cell) == config::TubeSource::kCounted;
  rules.parts_between.reset();
  if (cell.scan.parts_between) {
    rules.parts_between = static_cast<std::uint64_t>(*cell.scan.parts_between);
  }
  rules.count_modulus = CountModulus(cell.bender.register_map);
  return rules;
}

std::string WhyNothingIsCorrected(const config::CellConfig& cell) {
  if (!cell.correction.enabled || cell.bender.link == config::BenderKind::kNone) return "";
  if (config::TubesOf(cell) != config::TubeSource::kAuto) return "";
  return "corrections are off: register map " + cell.bender.register_map_file.string() +
         " has no state.parts_bent, so that a second scan of a tube cannot be told from one of the "
         "next; add it to the PLC and the map, or write [scan] tubes = \"each-scan\" where the "
         "cell makes sure of that";
}

}  // namespace bendloop::host
