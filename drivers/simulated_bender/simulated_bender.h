// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "drivers/isotp_bender/isotp_bender.h"
#include "drivers/simulated_bender/bending_physics.h"
#include "drivers/simulated_bender/canopen_front.h"
#include "hal/bend_program.h"
#include "hal/register_map.h"
#include "hal/result.h"

namespace bendloop::drivers {

struct SimulatedBenderOptions {
  std::uint16_t port = 0;  // on 127.0.0.1; 0 picks a free one
  bool rtu = false;        // instead: Modbus RTU on a pseudo-terminal, which device() names
  std::optional<IsotpChannel> can;  // or a CAN channel
  // or a CANopen node; the map is then one of objects, bound to its dictionary
  std::optional<SimulatedNode> canopen;
  std::uint8_t unit_id = 1;  // RTU; over TCP it answers any
  hal::RegisterMap map;
  hal::ProgramBlock program;  // active at start; its crc is computed
  double pipe_radius_mm = 0;
  BendingPhysics physics;
  std::filesystem::path tray;  // where bent parts are laid; empty: nowhere
  std::chrono::milliseconds cycle{200};
};

struct BentPart {
  std::uint32_t serial = 0;
  hal::ProgramBlock commanded;
  hal::BendProgram tube;       // as it truly is
  std::filesystem::path file;  // on the tray; empty without one
};

// A bender on a Modbus TCP port, RTU line, CAN channel or CANopen network: active program, staging
// area, state, handshake, heartbeat, and a press that bends. It serves any number of clients on its
// own thread from Start until Stop. All calls may come from any thread.
class SimulatedBender {
 public:
  static hal::Result<std::unique_ptr<SimulatedBender>> Start(SimulatedBenderOptions options);
  ~SimulatedBender();  // stops
  SimulatedBender(const SimulatedBender&) = delete;
  SimulatedBender& operator=(const SimulatedBender&) = delete;

  std::uint16_t port() const;         // 0 on a serial line
  const std::string& device() const;  // "/dev/pts/3", "can0"; empty over TCP
  void Stop();

  // Runs one cycle of the active program: mode bending for `cycle`, then the part lies on the tray.
  hal::Result<BentPart> Bend();
  // What it would bend now, decoded from its own registers.
  hal::ProgramBlock Active() const;
  hal::ProgramBlock Staged() const;
  // The PLC's side of the cell's contract: what it says (empty fields stay), and what it was told.
  void Say(const hal::PlcOrders& orders);
  hal::CellReport Heard() const;
  // An operator loads another program.
  hal::Result<void> Load(const hal::ProgramBlock& block);
  std::uint32_t commits_accepted() const;
  std::uint32_t commits_rejected() const;

  // A fault on demand, as the simulator's operator types it; `Misbehave("help")` lists them in the
  // error. kUsage if there is no such fault.
  hal::Result<void> Misbehave(std::string_view command);

 private:
  class Impl;
  explicit SimulatedBender(std::unique_ptr<Impl> impl);
  static hal::Result<std::unique_ptr<SimulatedBender>> Begin(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace bendloop::drivers
