// SPDX-License-Identifier: Apache-2.0
#include "drivers/canopen_bender/node_watch.h"

#include <linux/can/error.h>

#include <cstdio>
#include <utility>

namespace bendloop::drivers {
namespace {

struct EmergencyName {
  std::uint16_t mask;
  std::uint16_t code;
  const char* text;
};

// CiA 301, table of emergency error codes; the narrow ones first.
constexpr EmergencyName kEmergencyNames[] = {{0xffff, 0x8110, "CAN overrun, frames lost"},
                                             {0xffff, 0x8120, "CAN in error passive mode"},
                                             {0xffff, 0x8130, "heartbeat or node guarding error"},
                                             {0xffff, 0x8140, "recovered from bus-off"},
                                             {0xffff, 0x8150, "CAN identifier collision"},
                                             {0xffff, 0x8210, "PDO not processed, too short"},
                                             {0xffff, 0x8220, "PDO too long"},
                                             {0xff00, 0x0000, "no error"},
                                             {0xff00, 0x1000, "generic error"},
                                             {0xff00, 0x2100, "current at the input"},
                                             {0xff00, 0x2200, "current inside the device"},
                                             {0xff00, 0x2300, "current at the output"},
                                             {0xf000, 0x2000, "current"},
                                             {0xff00, 0x3100, "mains voltage"},
                                             {0xff00, 0x3200, "voltage inside the device"},
                                             {0xff00, 0x3300, "output voltage"},
                                             {0xf000, 0x3000, "voltage"},
                                             {0xff00, 0x4100, "ambient temperature"},
                                             {0xff00, 0x4200, "device temperature"},
                                             {0xf000, 0x4000, "temperature"},
                                             {0xf000, 0x5000, "device hardware"},
                                             {0xff00, 0x6100, "internal software"},
                                             {0xff00, 0x6200, "user software"},
                                             {0xff00, 0x6300, "data set"},
                                             {0xf000, 0x6000, "device software"},
                                             {0xf000, 0x7000, "additional modules"},
                                             {0xff00, 0x8100, "communication"},
                                             {0xff00, 0x8200, "protocol error"},
                                             {0xf000, 0x8000, "monitoring"},
                                             {0xff00, 0x9000, "external error"},
                                             {0xff00, 0xf000, "additional functions"},
                                             {0xff00, 0xff00, "device specific"}};

constexpr std::uint8_t kBootUp = 0;
constexpr std::uint8_t kGuardToggle = 0x80;

const char* ControllerText(std::uint8_t detail) {
  if (detail & (CAN_ERR_CRTL_RX_PASSIVE | CAN_ERR_CRTL_TX_PASSIVE)) {
    return "the CAN controller is error passive (bit rate, wiring or termination)";
  }
  if (detail & CAN_ERR_CRTL_RX_OVERFLOW) return "the CAN controller lost received frames";
  if (detail & CAN_ERR_CRTL_TX_OVERFLOW) return "the CAN controller lost frames to send";
  if (detail & (CAN_ERR_CRTL_RX_WARNING | CAN_ERR_CRTL_TX_WARNING)) {
    return "the CAN controller counts many bus errors";
  }
  return "";
}

}  // namespace

std::string NmtStateText(std::uint8_t state) {
  switch (state) {
    case kBootUp:
      return "boot-up";
    case 0x04:
      return "stopped";
    case 0x05:
      return "operational";
    case 0x7f:
      return "pre-operational";
    default:
      break;
  }
  char text[16];
  std::snprintf(text, sizeof text, "state 0x%02x", state);
  return text;
}

std::string EmergencyText(std::uint16_t code) {
  const char* name = "a code that CiA 301 does not name";
  for (const EmergencyName& known : kEmergencyNames) {
    if ((code & known.mask) != known.code) continue;
    name = known.text;
    break;
  }
  char text[96];
  std::snprintf(text, sizeof text, "0x%04X, %s", code, name);
  return text;
}

void NodeWatch::Receive(const CanFrame& frame, Time now) {
  if (frame.kind == CanFrame::Kind::kError) return TakeBusReport(frame);
  if (frame.id == kCobHeartbeat + node_id_ && frame.size >= 1) {
    nmt_state_ = static_cast<std::uint8_t>(frame.data[0] & ~kGuardToggle);
    last_heartbeat_ = now;
    ++heartbeats_;
    if (frame.data[0] == kBootUp) {
      restarted_ = true;
      emergency_ = 0;  // what is still wrong is told again
    }
  } else if (frame.id == kCobEmcy + node_id_ && frame.size >= 3) {
    emergency_ = static_cast<std::uint16_t>(frame.data[0] | frame.data[1] << 8);
    error_register_ = frame.data[2];
  }
}

void NodeWatch::TakeBusReport(const CanFrame& frame) {
  bus_remark_.clear();
  if (frame.id & CAN_ERR_RESTARTED) bus_failure_.reset();
  if (frame.id & CAN_ERR_BUSOFF) {
    bus_failure_ =
        "the CAN controller went off the bus after too many errors: check bit rate, wiring and "
        "termination (it comes back by itself with \"ip link set can0 type can restart-ms 100\")";
  } else if (frame.id & CAN_ERR_TX_TIMEOUT) {
    bus_failure_ = "the CAN driver gave up sending (transmit timeout)";
  } else if (frame.id & CAN_ERR_ACK) {
    bus_remark_ = "nobody on the bus acknowledges our frames";
  } else if (frame.id & CAN_ERR_CRTL) {
    bus_remark_ = ControllerText(frame.data[1]);
  } else if (frame.id & (CAN_ERR_PROT | CAN_ERR_TRX | CAN_ERR_BUSERROR)) {
    bus_remark_ = "there are bus errors (bit rate, wiring or termination)";
  }
}

void NodeWatch::Listened(Time now, bool without_pause) {
  const bool paused = !without_pause && (!listened_ || now - *listened_ > timeout_);
  if (last_heartbeat_ && paused) last_heartbeat_ = now;
  listened_ = now;
}

bool NodeWatch::lost(Time now) const {
  return timeout_.count() > 0 && last_heartbeat_ && now - *last_heartbeat_ > timeout_;
}

bool NodeWatch::TakeRestart() { return std::exchange(restarted_, false); }

std::optional<std::string> NodeWatch::TakeBusFailure() {
  return std::exchange(bus_failure_, std::nullopt);
}

std::string NodeWatch::Remarks(Time now) const {
  std::string text;
  if (lost(now)) {
    const auto away = std::chrono::duration_cast<std::chrono::milliseconds>(now - *last_heartbeat_);
    text += "; its heartbeat stays away for " + std::to_string(away.count()) + " ms";
  } else if (nmt_state_ && *nmt_state_ != 0x05) {
    text += "; its heartbeat says " + NmtStateText(*nmt_state_);
    if (*nmt_state_ == 0x04) text += ", where it answers nothing until an NMT master starts it";
  }
  if (emergency_ != 0) {
    char reg[32];
    std::snprintf(reg, sizeof reg, " (error register 0x%02x)", error_register_);
    text += "; it reports emergency " + EmergencyText(emergency_) + reg;
  }
  if (!bus_remark_.empty()) text += "; " + bus_remark_;
  return text;
}

}  // namespace bendloop::drivers
