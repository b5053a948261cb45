// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "firmware-host/alarms/alarm_board.h"
#include "firmware-host/cell/bender_desk.h"
#include "firmware-host/daemon/part_keeper.h"
#include "firmware-host/daemon/part_setter.h"
#include "firmware-host/daemon/plc_desk.h"
#include "firmware-host/daemon/setter_desk.h"
#include "firmware-host/daemon/state_store.h"

namespace bendloop::host {

// What setters and the PLC ask of the running cell, granted between two parts. From the cell's
// thread.
class Requests {
 public:
  // All outlive it.
  struct Ports {
    StateStore& store;
    PartSetter& parts;
    PartKeeper& keeper;
    AlarmBoard& alarms;
    PlcDesk& plc;
  };
  struct Served {
    bool any = false;
    // Who asks for what a correction that waits for the bender stands in the way of; "": nobody.
    std::string in_the_way_of;
  };

  explicit Requests(const Ports& ports) : ports_(ports) {}

  // It is done when Serve comes: a commit that runs must not keep the caller waiting.
  void PlcAcknowledges() { plc_acknowledges_ = true; }
  // Grants what is asked for. While a correction waits nothing that it stands in the way of: that
  // is left for when it has ended. May block for the bender's timeouts.
  Served Serve(BenderDesk& desk, bool correction_waits);

 private:
  void AcknowledgeForPlc(BenderDesk& desk);
  void BeginLotForPlc(SetterDesk& setters);
  SetterAnswer Grant(SetterDesk& setters, const SetterRequest& request);

  Ports ports_;
  bool plc_acknowledges_ = false;  // and it is not done yet
};

}  // namespace bendloop::host
