// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cell/bender_carrier.h"

#include "drivers/canopen_bender/canopen_bender.h"
#include "drivers/isotp_bender/isotp_bender.h"
#include "drivers/modbus_bender/modbus_bender.h"

namespace bendloop::host {
namespace {

using config::BenderKind;

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
  if (bender.link == BenderKind::kModbusRtu) link.serial = LineOf(bender);
  return link;
}

}  // namespace

std::unique_ptr<drivers::RegisterCarrier> MakeBenderCarrier(const config::BenderConfig& bender,
                                                            hal::Clock& clock) {
  if (bender.link == BenderKind::kCanopen) {
    return drivers::MakeCanopenCarrier(bender.register_map,
                                       {.interface = bender.can_interface,
                                        .node_id = bender.can_node_id,
                                        .vendor_id = bender.can_vendor_id,
                                        .product_code = bender.can_product_code,
                                        .response_timeout = bender.response_timeout,
                                        .heartbeat_timeout = bender.heartbeat_timeout},
                                       clock);
  }
  if (bender.link == BenderKind::kCanIsotp) {
    return drivers::MakeIsotpCarrier(bender.register_map,
                                     {.channel = {.interface = bender.can_interface,
                                                  .request_id = bender.can_request_id,
                                                  .reply_id = bender.can_reply_id},
                                      .unit_id = bender.unit_id,
                                      .response_timeout = bender.response_timeout});
  }
  return drivers::MakeModbusCarrier(bender.register_map, ModbusOf(bender), clock);
}

std::string BenderCarrierName(const config::BenderConfig& bender) {
  switch (bender.link) {
    case BenderKind::kCanopen:
      return "canopen " + bender.can_interface + " node " + std::to_string(bender.can_node_id);
    case BenderKind::kCanIsotp:
      return "can " + bender.can_interface;
    case BenderKind::kModbusRtu:
      return "modbus " + bender.device;
    default:
      return "modbus " + bender.host + ":" + std::to_string(bender.port);
  }
}

}  // namespace bendloop::host
