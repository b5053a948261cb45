// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "firmware-host/cell/bender_desk.h"
#include "firmware-host/cell/part_plan.h"
#include "hal/result.h"

namespace bendloop::host {

// What a setter asks of the correction.
enum class SetterWish : std::uint8_t {
  kNewLot,
  kHoldLot,
  kReleaseLot,
  kUndo,
  kFirstProgram,
  kAcknowledge
};
// "lot new", "lot hold", "lot release", "undo", "first-program", "acknowledge"
const char* Name(SetterWish wish);
std::optional<SetterWish> WishNamed(const std::string& name);
// It changes the lot or the program that a correction was decided by: one that waits for the bender
// must not be sent after it.
bool EndsWaiting(SetterWish wish);

struct SetterRequest {
  SetterWish wish = SetterWish::kNewLot;
  std::string who;                // the user, as the machine knows him
  std::string time;               // ISO 8601
  std::uint32_t part_number = 0;  // whose lot and program; 0: the part that the cell makes now
};

// What became of it: done, or the error's kind with its reason.
struct SetterAnswer {
  std::optional<hal::ErrorKind> error;
  std::string text;  // one line for the setter
};

// What the desk needs of its cell, whoever runs it; all outlive it.
struct SetterPorts {
  using Part = std::shared_ptr<const PartPlan>;

  std::function<hal::Result<Part>(std::uint32_t number)> part;  // 0: as SetterRequest says
  BenderDesk* desk = nullptr;
  std::function<std::optional<pipeline::LotState>(const PartPlan&)> lot;
  std::function<hal::Result<void>(const PartPlan&, const pipeline::LotState&)> keep_lot;
  std::filesystem::path log;  // a JSON line for each request, flushed
};

// Where setters' wishes are granted: between two parts, by whoever holds the state directory.
class SetterDesk {
 public:
  explicit SetterDesk(SetterPorts ports) : ports_(std::move(ports)) {}
  // Journalled before anything is done and when it is done.
  SetterAnswer Grant(const SetterRequest& request);

 private:
  SetterAnswer Do(const SetterRequest& request);
  SetterAnswer NewLot();
  SetterAnswer HoldLot(bool held);
  SetterAnswer Undo(const SetterRequest& request);
  SetterAnswer Acknowledge(const SetterRequest& request);
  SetterAnswer SendFirstProgram(const SetterRequest& request);
  SetterAnswer Send(const SetterRequest& request, const hal::ProgramBlock& base,
                    const hal::BendProgram& program);
  hal::Result<hal::ProgramBlock> ActiveOfThisPart();
  SetterAnswer Keep(const pipeline::LotState& lot, const std::string& said);
  hal::Result<void> Log(const SetterRequest& request, const std::string& end) const;

  std::optional<pipeline::LotState> Lot() const { return ports_.lot(*plan_); }

  SetterPorts ports_;
  SetterPorts::Part plan_;  // of the request
};

}  // namespace bendloop::host
