// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "drivers/canopen_bender/can_port.h"
#include "drivers/canopen_bender/node_watch.h"
#include "drivers/canopen_bender/sdo_client.h"
#include "hal/clock.h"
#include "hal/result.h"

namespace bendloop::drivers {

using CanPortOpener = std::function<hal::Result<std::unique_ptr<CanPort>>()>;

// One node of a CANopen network, read and written by SDO. Each transfer ends within the response
// timeout after its last progress. After one that failed the node may still answer it late, and SDO
// numbers nothing: before the next transfer another object is asked for until its own answer comes,
// and what comes before that is thrown away; for that it has twice the time. Errors are kDevice,
// one line, and name the node.
class CanopenNode {
 public:
  // `name` stands for the node in messages: "can0 node 5".
  CanopenNode(std::string name, std::uint8_t node_id, CanPortOpener open,
              std::chrono::milliseconds response_timeout,
              std::chrono::milliseconds heartbeat_timeout, hal::Clock& clock);

  // The identifiers that a port for this node has to let through.
  static std::vector<std::uint32_t> Identifiers(std::uint8_t node_id);

  // Opens the port; does nothing when it is open.
  hal::Result<void> Open();
  // At most `max_size` bytes.
  hal::Result<std::vector<std::uint8_t>> Upload(ObjectId object, std::size_t max_size, bool block);
  hal::Result<void> Download(ObjectId object, std::vector<std::uint8_t> data, bool block);

  const std::string& name() const { return name_; }
  const NodeWatch& watch() const { return watch_; }

 private:
  hal::Result<void> Transfer(const std::string& what);
  hal::Result<void> Run(const std::string& what, std::chrono::milliseconds timeout);
  hal::Result<void> Prepare(const std::string& what);
  hal::Result<void> Drain(const std::string& what);
  hal::Result<void> Resynchronise();
  // Waits for a frame and does what it says; true: the transfer got further.
  hal::Result<bool> Take(std::chrono::nanoseconds wait);
  SdoClient::Mode ModeOf(bool block) const;
  hal::Error Fault(const std::string& what, const std::string& why) const;

  const std::string name_;
  const std::uint8_t node_id_;
  const CanPortOpener open_;
  const std::chrono::milliseconds response_timeout_;
  hal::Clock& clock_;
  std::unique_ptr<CanPort> port_;
  NodeWatch watch_;
  SdoClient client_;
  bool unsure_ = false;     // an answer may still be under way
  std::size_t probe_ = 0;   // which object is asked for next, then
  bool no_blocks_ = false;  // the node declined block transfer
};

}  // namespace bendloop::drivers
