// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "drivers/canopen_bender/can_port.h"
#include "drivers/canopen_bender/object_table.h"
#include "drivers/register_bender/register_image.h"
#include "drivers/simulated_bender/misbehaviour.h"
#include "drivers/simulated_bender/sdo_server.h"
#include "hal/register_map.h"
#include "hal/result.h"

namespace bendloop::drivers {

// A CANopen node in place of a Modbus server.
struct SimulatedNode {
  std::string interface;  // "can0"
  std::uint8_t node_id = 1;
  std::uint32_t vendor_id = 0;  // object 1018
  std::uint32_t product_code = 0;
  std::chrono::milliseconds heartbeat{100};
  SdoServer::Options sdo;
  int socket = -1;  // carries struct can_frame; instead of the interface's, and taken over
};

// The node that a simulated bender shows to a bus: an SDO server over its registers, heartbeat,
// boot-up, emergencies, NMT commands. Without a thread: the owner polls.
class CanopenFront final : private SdoObjects {
 public:
  // The bender behind it, asked from within Handle.
  struct Bender {
    std::function<RegisterImage&()> image;  // with the state of this moment
    // Does `store` to the registers `range`, well or badly; false: no answer.
    std::function<bool(const RegisterRange& range, const std::function<void()>& store)> write;
  };

  // The map must be bound to its object dictionary.
  static hal::Result<std::unique_ptr<CanopenFront>> Open(const SimulatedNode& node,
                                                         const hal::RegisterMap& map);

  // Sends heartbeats, and an emergency when `fault` changes; gives SDO requests to `handle`.
  // Returns after at most 10 ms.
  void Poll(std::chrono::milliseconds timeout, std::uint32_t fault, bool silent,
            const std::function<void(const SdoData&)>& handle);
  // Does one request and answers it, well or badly.
  void Handle(const SdoData& request, const Misbehaviour& wrong, const Bender& bender);
  void Reboot();  // forgets transfers, tells the bus

  const std::string& device() const { return node_.interface; }

 private:
  CanopenFront(const SimulatedNode& node, const hal::RegisterMap& map,
               std::unique_ptr<CanPort> port);

  std::uint32_t Read(ObjectId object, std::vector<std::uint8_t>& bytes) override;
  std::uint32_t Write(ObjectId object, std::span<const std::uint8_t> bytes) override;
  const MappedObject* Find(ObjectId object) const;
  bool ReadStandard(ObjectId object, std::vector<std::uint8_t>& bytes) const;
  std::uint32_t NoSuch(ObjectId object) const;
  void ObeyNmt(const CanFrame& frame);
  void Send(std::uint32_t id, std::uint8_t size, const SdoData& data);

  const SimulatedNode node_;
  const std::vector<MappedObject> objects_;
  std::unique_ptr<CanPort> port_;
  SdoServer server_;
  const Bender* bender_ = nullptr;  // while a request is handled
  std::uint8_t nmt_state_ = 0x05;
  std::uint32_t fault_ = 0;
  std::chrono::steady_clock::time_point next_heartbeat_{};
};

}  // namespace bendloop::drivers
