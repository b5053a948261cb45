// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/daemon/requests.h"

#include <spdlog/spdlog.h>

#include <cstdint>
#include <optional>
#include <utility>

#include "firmware-host/daemon/setter_box.h"
#include "firmware-host/ledger/moment.h"

namespace bendloop::host {

Requests::Served Requests::Serve(BenderDesk& desk, bool correction_waits) {
  Served served;
  served.any = plc_acknowledges_;
  AcknowledgeForPlc(desk);
  SetterDesk setters({[this](std::uint32_t number) { return ports_.parts.Of(number); }, &desk,
                      [this](const PartPlan& part) { return ports_.keeper.Lot(part); },
                      [this](const PartPlan& part, const pipeline::LotState& lot) {
                        return ports_.keeper.SetLot(part, lot);
                      },
                      ports_.store.requests_log()});
  if (ports_.parts.is_known() && ports_.plc.AsksForLot()) {
    if (correction_waits) {
      served.in_the_way_of = "the PLC asked for a new lot";
    } else {
      BeginLotForPlc(setters);
      served.any = true;
    }
  }
  const auto may_be_granted = [&](const SetterRequest& request) {
    if (!correction_waits || !EndsWaiting(request.wish)) return true;
    served.in_the_way_of = request.who + " asked for '" + Name(request.wish) + "'";
    return false;
  };
  const auto grant = [&](const SetterRequest& request) {
    served.any = true;
    return Grant(setters, request);
  };
  SetterBox(ports_.store.directory()).Serve(may_be_granted, grant);
  return served;
}

void Requests::AcknowledgeForPlc(BenderDesk& desk) {
  if (!plc_acknowledges_) return;
  const auto unlocked = desk.Acknowledge("the PLC");
  plc_acknowledges_ = false;  // not before: where memory is short it is done at the next turn
  spdlog::warn("the PLC acknowledges all alarms{}",
               unlocked ? "" : ", but corrections stay locked: " + unlocked.error().message);
  if (!unlocked) return;
  ports_.alarms.Acknowledge();
  ports_.plc.Acknowledged();
}

void Requests::BeginLotForPlc(SetterDesk& setters) {
  const SetterAnswer answer =
      setters.Grant({SetterWish::kNewLot, "the PLC", UtcText(SystemMoment().unix_ms), 0});
  spdlog::warn("the PLC asked for a new lot: {}{}", answer.error ? "refused, " : "", answer.text);
  if (!answer.error) ports_.plc.LotBegun();
}

SetterAnswer Requests::Grant(SetterDesk& setters, const SetterRequest& request) {
  SetterAnswer answer = setters.Grant(request);
  if (request.wish == SetterWish::kAcknowledge && !answer.error) ports_.alarms.Acknowledge();
  const std::string of_part =
      request.part_number == 0 ? "" : " of part " + std::to_string(request.part_number);
  spdlog::warn("{} asked for '{}'{}: {}{}", request.who, Name(request.wish), of_part,
               answer.error ? "refused, " : "", answer.text);
  return answer;
}

}  // namespace bendloop::host
