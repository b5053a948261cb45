// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cell/tube_rules.h"

#include <utility>

#include "firmware-host/cell/bender_desk.h"

namespace bendloop::host {
namespace {

// Empty, or why `parts_between` has no effect though the cell file has it.
std::string WhyNothingLiesBetween(const config::CellConfig& cell) {
  if (cell.scan.parts_between == 0) return "";
  const std::string found = "[scan] parts_between has no effect: ";
  if (cell.bender.link == config::BenderKind::kNone) {
    return found + "the cell has no bender; leave it out";
  }
  switch (config::TubesOf(cell)) {
    case config::TubeSource::kCounted:
      return "";
    case config::TubeSource::kEachScan:
      return found +
             "each scan is taken for a new tube (a bender that the daemon simulates counts nothing "
             "else); leave it out, or write tubes = \"counted\"";
    case config::TubeSource::kAuto:
      break;
  }
  return found + "register map " + cell.bender.register_map_file.string() +
         " has no state.parts_bent; add it to the PLC and the map, or leave it out";
}

}  // namespace

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

std::vector<std::string> RemarksOn(const config::CellConfig& cell, const ServiceTimes& service) {
  std::vector<std::string> remarks;
  for (std::string& remark : std::vector{WhyNothingIsCorrected(cell), WhyNothingLiesBetween(cell),
                                         WhyStopIsTooShort(cell, service)}) {
    if (!remark.empty()) remarks.push_back(std::move(remark));
  }
  return remarks;
}

}  // namespace bendloop::host
