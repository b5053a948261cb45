// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cell/bender_desk.h"

#include <utility>

#include "drivers/canopen_bender/canopen_bender.h"
#include "drivers/isotp_bender/isotp_bender.h"
#include "drivers/modbus_bender/modbus_bender.h"
#include "drivers/simulated_bender/simulated_bender.h"

namespace bendloop::host {

namespace {

drivers::SerialLine LineOf(const config::BenderConfig& bender) {
  drivers::SerialLine line{.device = bender.device,
                           .baud = bender.baud,
                           .parity = drivers::SerialParity::kNone,
                           .stop_bits = bender.stop_bits,
                           .rs485 = bender.rs485,
                           .delay_before_send = bender.rs485_delay_before_send,
                           .delay_after_send = bender.rs485_delay_after_send};
  if (bender.parity == config::SerialParity::kEven) line.parity = drivers::SerialParity::kEven;
  if (bender.parity == config::SerialParity::kOdd) line.parity = drivers::SerialParity::kOdd;
  return line;
}

drivers::ModbusBenderOptions ModbusOf(const config::BenderConfig& bender) {
  drivers::ModbusBenderOptions link;
  link.host = bender.host;
  link.port = bender.port;
  link.unit_id = bender.unit_id;
  link.connect_timeout = bender.connect_timeout;
  link.response_timeout = bender.response_timeout;
  link.byte_timeout = bender.byte_timeout;
  if (bender.link == config::BenderKind::kModbusRtu) link.serial = LineOf(bender);
  return link;
}

}  // namespace

struct BenderDesk::Simulator {
  std::unique_ptr<drivers::SimulatedBender> bender;
};

BenderDesk::BenderDesk(CommitJournal journal) : journal_(std::move(journal)) {}
BenderDesk::~BenderDesk() = default;

hal::Result<std::unique_ptr<BenderDesk>> BenderDesk::Open(const config::BenderConfig& bender,
                                                          const Options& options,
                                                          hal::Clock& clock) {
  auto journal = CommitJournal::Open(options.journal);
  if (!journal) return hal::Fail(journal.error());
  std::unique_ptr<BenderDesk> desk(new BenderDesk(std::move(*journal)));
  if (bender.link == config::BenderKind::kNone) {
    desk->name_ = "none";
    return desk;
  }
  const auto attach = [&](std::unique_ptr<hal::BenderLink> link) {
    desk->link_ = std::move(link);
    desk->protocol_ =
        std::make_unique<CommitProtocol>(*desk->link_, desk->journal_, clock, options.commit);
  };
  if (bender.link == config::BenderKind::kCanopen) {
    desk->name_ = "canopen " + bender.can_interface + " node " + std::to_string(bender.can_node_id);
    attach(drivers::MakeCanopenBender(bender.register_map,
                                      {.interface = bender.can_interface,
                                       .node_id = bender.can_node_id,
                                       .vendor_id = bender.can_vendor_id,
                                       .product_code = bender.can_product_code,
                                       .response_timeout = bender.response_timeout,
                                       .heartbeat_timeout = bender.heartbeat_timeout},
                                      clock));
    return desk;
  }
  if (bender.link == config::BenderKind::kCanIsotp) {
    desk->name_ = "can " + bender.can_interface;
    attach(drivers::MakeIsotpBender(bender.register_map,
                                    {.channel = {.interface = bender.can_interface,
                                                 .request_id = bender.can_request_id,
                                                 .reply_id = bender.can_reply_id},
                                     .unit_id = bender.unit_id,
                                     .response_timeout = bender.response_timeout}));
    return desk;
  }
  drivers::ModbusBenderOptions link = ModbusOf(bender);
  desk->name_ = "modbus " + bender.host + ":" + std::to_string(bender.port);
  if (link.serial) desk->name_ = "modbus " + bender.device;
  if (bender.link == config::BenderKind::kSimulated) {
    drivers::SimulatedBenderOptions simulated;
    simulated.map = bender.register_map;
    simulated.program = options.preload;
    simulated.pipe_radius_mm = options.pipe_radius_mm;
    auto started = drivers::SimulatedBender::Start(std::move(simulated));
    if (!started) return hal::Fail(started.error());
    link.host = "127.0.0.1";
    link.port = (*started)->port();
    desk->name_ = "simulated";
    desk->simulator_ = std::make_unique<Simulator>(Simulator{std::move(*started)});
  }
  attach(drivers::MakeModbusBender(bender.register_map, link, clock));
  return desk;
}

BenderReading BenderDesk::Read() {
  if (!link_) return {std::nullopt, "the cell has no bender"};
  if (!connected_) {
    if (const auto info = link_->Connect(); !info) return {std::nullopt, info.error().message};
    connected_ = true;
  }
  const auto state = link_->ReadState();
  if (!state) return {std::nullopt, state.error().message};
  protocol_->Observe(*state);
  auto active = link_->ReadActive();
  if (!active) return {std::nullopt, active.error().message};
  return {pipeline::BenderFacts{*state, std::move(*active)}, ""};
}

CommitReport BenderDesk::Commit(const CommitRequest& request) { return protocol_->Commit(request); }

std::optional<CommitReport> BenderDesk::Resume() {
  return protocol_ ? protocol_->Resume() : std::nullopt;
}

bool BenderDesk::SessionCommitted(const std::string& session) const {
  return journal_.SessionCommitted(session).value_or(false);
}

std::uint32_t BenderDesk::LastSequence() const { return journal_.LastSequence().value_or(0); }

void BenderDesk::NoteSequence(std::uint32_t sequence) {
  if (sequence > LastSequence()) static_cast<void>(journal_.NoteSequence(sequence));
}

}  // namespace bendloop::host
