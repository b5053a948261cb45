// SPDX-License-Identifier: Apache-2.0
#include "drivers/modbus_bender/modbus_connection.h"

#include <arpa/inet.h>
#include <linux/serial.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <sys/select.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <utility>

#include "drivers/modbus_bender/isotp_socket.h"
#include "drivers/register_bender/can_interface.h"

namespace bendloop::drivers {
namespace {

using hal::ErrorKind;
using Bytes = std::vector<std::uint8_t>;

constexpr std::size_t kHeaderSize = 7;     // transaction 2, protocol 2, length 2, unit 1
constexpr std::size_t kRtuHeaderSize = 1;  // unit
constexpr std::size_t kRtuCrcSize = 2;
constexpr std::uint8_t kReadHolding = 0x03;
constexpr std::uint8_t kReadInput = 0x04;
constexpr std::uint8_t kWriteSingle = 0x06;
constexpr std::uint8_t kWriteMultiple = 0x10;
constexpr std::uint8_t kExceptionBit = 0x80;
constexpr std::chrono::milliseconds kFirstBackoff{100};

hal::Error Device(std::string message) { return {ErrorKind::kDevice, std::move(message)}; }

const char* ExceptionName(std::uint8_t code) {
  switch (code) {
    case 1:
      return "illegal function";
    case 2:
      return "illegal data address";
    case 3:
      return "illegal data value";
    case 4:
      return "device failure";
    case 5:
      return "acknowledge, still working";
    case 6:
      return "device busy";
    case 8:
      return "memory parity error";
    case 10:
      return "gateway path unavailable";
    case 11:
      return "gateway target does not respond";
    default:
      return "unknown exception";
  }
}

std::string Hex(const std::uint8_t* data, std::size_t size) {
  constexpr std::size_t kShown = 16;
  std::string text;
  for (std::size_t i = 0; i < std::min(size, kShown); ++i) {
    char byte[4];
    std::snprintf(byte, sizeof byte, "%02x ", data[i]);
    text += byte;
  }
  if (size > kShown) text += "... ";
  return text + "(" + std::to_string(size) + " bytes)";
}

void Append16(Bytes& bytes, std::uint32_t value) {
  bytes.push_back(static_cast<std::uint8_t>(value >> 8));
  bytes.push_back(static_cast<std::uint8_t>(value));
}

std::uint16_t Load16(const std::uint8_t* data) {
  return static_cast<std::uint16_t>(data[0] << 8 | data[1]);
}

std::string RangeName(const RegisterRange& range) {
  const std::string first = std::to_string(range.address);
  if (range.count == 1) return "register " + first;
  return "registers " + first + " to " + std::to_string(range.address + range.count - 1);
}

std::uint32_t WholeSeconds(std::chrono::milliseconds time) {
  return static_cast<std::uint32_t>(time.count() / 1000);
}
std::uint32_t Microseconds(std::chrono::milliseconds time) {
  return static_cast<std::uint32_t>(time.count() % 1000 * 1000);
}

bool IsNumericAddress(const std::string& host) {
  unsigned char address[sizeof(in6_addr)];
  return inet_pton(AF_INET, host.c_str(), address) == 1 ||
         inet_pton(AF_INET6, host.c_str(), address) == 1;
}

}  // namespace

void ModbusConnection::Free::operator()(modbus_t* context) const {
  modbus_close(context);
  modbus_free(context);
}

ModbusConnection::ModbusConnection(ModbusBenderOptions options, hal::Clock& clock)
    : options_(std::move(options)), clock_(clock) {
  if (options_.host == "localhost") options_.host = "127.0.0.1";
}

std::string ModbusConnection::carrier() const {
  return can() ? "Modbus on CAN" : rtu() ? "Modbus RTU" : "Modbus TCP";
}

std::string ModbusConnection::peer() const {
  if (can()) {
    char ids[32];
    std::snprintf(ids, sizeof ids, " 0x%x/0x%x", options_.can->request_id, options_.can->reply_id);
    return options_.can->interface + ids + " unit " + std::to_string(options_.unit_id);
  }
  if (rtu()) return options_.serial->device + " unit " + std::to_string(options_.unit_id);
  return options_.host + ":" + std::to_string(options_.port) + " unit " +
         std::to_string(options_.unit_id);
}

void ModbusConnection::Close() {
  if (connected_ && can()) close(can_socket_);
  if (connected_ && !can()) modbus_close(context_.get());
  connected_ = false;
}

hal::Result<void> ModbusConnection::MakeContext() {
  if (rtu()) {
    const SerialLine& line = *options_.serial;
    constexpr int kDataBits = 8;
    context_.reset(modbus_new_rtu(line.device.c_str(), line.baud, static_cast<char>(line.parity),
                                  kDataBits, line.stop_bits));
    if (context_ && modbus_set_slave(context_.get(), options_.unit_id) != 0) {
      context_.reset();
      return hal::Fail(ErrorKind::kBadInput, "bender unit " + std::to_string(options_.unit_id) +
                                                 ": 1 to 247 was expected for Modbus RTU");
    }
  } else if (IsNumericAddress(options_.host)) {
    context_.reset(modbus_new_tcp_pi(options_.host.c_str(), std::to_string(options_.port).c_str()));
  } else {
    return hal::Fail(ErrorKind::kBadInput, "bender host \"" + options_.host +
                                               "\": a numeric address such as 192.168.0.10 "
                                               "was expected");
  }
  if (context_) return {};
  return hal::Fail(ErrorKind::kInternal, std::string("libmodbus: ") + modbus_strerror(errno));
}

hal::Result<void> ModbusConnection::PrepareLine() {
  const SerialLine& line = *options_.serial;
  const int port = modbus_get_socket(context_.get());
  if (line.rs485) {
    serial_rs485 mode{};
    mode.flags = SER_RS485_ENABLED | SER_RS485_RTS_ON_SEND;
    mode.delay_rts_before_send = static_cast<std::uint32_t>(line.delay_before_send.count());
    mode.delay_rts_after_send = static_cast<std::uint32_t>(line.delay_after_send.count());
    if (ioctl(port, TIOCSRS485, &mode) != 0) {
      return hal::Fail(Device("bender " + peer() + ": the port cannot switch an RS-485 line (" +
                              modbus_strerror(errno) +
                              "); use a port that can, or one that switches by itself with rs485 "
                              "= false"));
    }
  }
  ListenUntilQuiet();
  modbus_flush(context_.get());
  return {};
}

void ModbusConnection::ListenUntilQuiet() {
  if (!quiet_at_) return;
  pollfd line{modbus_get_socket(context_.get()), POLLIN, 0};
  for (;;) {
    const auto left = std::chrono::ceil<std::chrono::milliseconds>(*quiet_at_ - clock_.Now());
    if (left.count() <= 0 || poll(&line, 1, static_cast<int>(left.count())) <= 0) break;
    if (line.revents != POLLIN || modbus_flush(context_.get()) < 0) break;
  }
  quiet_at_.reset();
}

// Opening asks nobody, so there is nothing to wait for and nothing to back off from.
hal::Result<void> ModbusConnection::ConnectCan() {
  const CanChannel& channel = *options_.can;
  const auto opened = OpenIsotpSocket(channel.interface, channel.request_id, channel.reply_id);
  if (!opened) return hal::Fail(Device("bender " + peer() + ": " + opened.error().message));
  can_socket_ = *opened;
  connected_ = true;
  return {};
}

hal::Result<void> ModbusConnection::Connect() {
  if (connected_) return {};
  if (can()) return ConnectCan();
  if (!context_) {
    if (auto ok = MakeContext(); !ok) return ok;
  }
  const std::chrono::nanoseconds now = clock_.Now();
  if (failed_connects_ > 1 && now < next_connect_) {
    const auto wait = std::chrono::ceil<std::chrono::milliseconds>(next_connect_ - now);
    return hal::Fail(Device("bender " + peer() + " is not reachable; next try in " +
                            std::to_string(wait.count()) + " ms"));
  }
  // libmodbus bounds connecting by its response timeout.
  modbus_set_response_timeout(context_.get(), WholeSeconds(options_.connect_timeout),
                              Microseconds(options_.connect_timeout));
  const int rc = modbus_connect(context_.get());
  const int error = errno;
  if (rc == 0 && modbus_get_socket(context_.get()) >= FD_SETSIZE) {
    modbus_close(context_.get());  // libmodbus waits with select()
    return hal::Fail(ErrorKind::kInternal, "bender " + peer() + ": too many open files");
  }
  const auto line = rc == 0 && rtu() ? PrepareLine() : hal::Result<void>{};
  if (rc != 0 || !line) {
    modbus_close(context_.get());
    ++failed_connects_;
    const int doublings = std::clamp(failed_connects_ - 2, 0, 16);
    next_connect_ = clock_.Now() + std::min<std::chrono::nanoseconds>(
                                       kFirstBackoff * (1 << doublings), options_.max_backoff);
    if (!line) return line;
    const std::string why =
        error == ETIMEDOUT || error == EINPROGRESS
            ? "no answer within " + std::to_string(options_.connect_timeout.count()) + " ms"
            : modbus_strerror(error);
    return hal::Fail(Device("bender " + peer() + ": cannot connect: " + why));
  }
  failed_connects_ = 0;
  connected_ = true;
  modbus_set_response_timeout(context_.get(), WholeSeconds(options_.response_timeout),
                              Microseconds(options_.response_timeout));
  modbus_set_byte_timeout(context_.get(), WholeSeconds(options_.byte_timeout),
                          Microseconds(options_.byte_timeout));
  return {};
}

hal::Result<Bytes> ModbusConnection::Transact(const Bytes& request, const std::string& what) {
  if (connected_) {
    // Nothing may be waiting now: bytes are an answer nobody asked for, an end of file is a
    // connection that the bender closed while we did not look. Both are cured by a new connection.
    pollfd idle{Socket(), POLLIN, 0};
    if (poll(&idle, 1, 0) != 0) Close();  // an RTU line is emptied when it is opened
  }
  if (auto ok = Connect(); !ok) return hal::Fail(ok.error());
  auto answer = Exchange(request, what);
  if (!answer) {
    Close();
    if (rtu()) quiet_at_ = clock_.Now() + options_.response_timeout;
  }
  return answer;
}

hal::Result<void> ModbusConnection::Send(const Bytes& request) {
  if (rtu()) {
    Bytes frame{options_.unit_id};
    frame.insert(frame.end(), request.begin(), request.end());
    if (modbus_send_raw_request(context_.get(), frame.data(), static_cast<int>(frame.size())) ==
        static_cast<int>(frame.size() + kRtuCrcSize)) {
      return {};
    }
    return hal::Fail(Device(modbus_strerror(errno)));
  }
  ++transaction_;
  // libmodbus gives raw requests transaction 0 and its own calls do not check the unit, so the
  // header is made and checked here; libmodbus connects, frames and times.
  Bytes frame;
  Append16(frame, transaction_);
  Append16(frame, 0);
  Append16(frame, static_cast<std::uint32_t>(request.size() + 1));
  frame.push_back(options_.unit_id);
  frame.insert(frame.end(), request.begin(), request.end());
  const ssize_t sent = send(Socket(), frame.data(), frame.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
  if (sent == static_cast<ssize_t>(frame.size())) return {};
  if (sent < 0 && can()) return hal::Fail(Device(CanTrouble(errno)));
  return hal::Fail(Device(sent < 0 ? modbus_strerror(errno) : "connection is stuck"));
}

// A message comes whole or not at all. Those that answer another transaction are late: they are
// passed over, and returned only if nothing better comes in time.
int ModbusConnection::ReceiveCan(std::uint8_t* answer, std::size_t size) const {
  const auto deadline = std::chrono::steady_clock::now() + options_.response_timeout;
  int strange = -1;
  for (;;) {
    const auto left =
        std::chrono::ceil<std::chrono::milliseconds>(deadline - std::chrono::steady_clock::now());
    pollfd message{can_socket_, POLLIN, 0};
    if (left.count() <= 0 || poll(&message, 1, static_cast<int>(left.count())) <= 0) break;
    const ssize_t received = recv(can_socket_, answer, size, MSG_DONTWAIT);
    if (received < 0 && errno != EAGAIN) return -1;
    if (received < 0) continue;
    strange = static_cast<int>(received);
    if (received > 1 && Load16(answer) == transaction_) return strange;
  }
  errno = ETIMEDOUT;
  return strange;
}

hal::Result<void> ModbusConnection::CheckHeader(const std::uint8_t* answer,
                                                std::size_t size) const {
  if (rtu()) return {};  // libmodbus has checked the crc
  if (Load16(answer) != transaction_) {
    return hal::Fail(Device("answer to transaction " + std::to_string(Load16(answer)) +
                            ", expected " + std::to_string(transaction_)));
  }
  if (Load16(answer + 2) != 0 || Load16(answer + 4) != size - kHeaderSize + 1) {
    return hal::Fail(Device("garbled Modbus header"));
  }
  if (answer[6] != options_.unit_id) {
    return hal::Fail(Device("answer from unit " + std::to_string(answer[6]) + ", expected unit " +
                            std::to_string(options_.unit_id)));
  }
  return {};
}

hal::Result<Bytes> ModbusConnection::Exchange(const Bytes& request, const std::string& what) {
  const std::string where = "bender " + peer() + ": " + what + ": ";
  if (auto sent = Send(request); !sent) {
    return hal::Fail(Device(where + "cannot send: " + sent.error().message));
  }
  std::uint8_t answer[MODBUS_TCP_MAX_ADU_LENGTH] = {};  // RTU's are shorter
  const int received = can() ? ReceiveCan(answer, sizeof answer)
                             : modbus_receive_confirmation(context_.get(), answer);
  if (received < 0) {
    if (errno == ETIMEDOUT) {
      return hal::Fail(Device(where + "no complete answer within " +
                              std::to_string(options_.response_timeout.count()) + " ms"));
    }
    if (errno == ECONNRESET) return hal::Fail(Device(where + "the bender closed the connection"));
    return hal::Fail(
        Device(where + "no valid answer: " + (can() ? CanTrouble(errno) : modbus_strerror(errno))));
  }
  const std::size_t header = rtu() ? kRtuHeaderSize : kHeaderSize;
  const std::size_t trailer = rtu() ? kRtuCrcSize : 0;
  // libmodbus says 0 for an RTU answer of another unit.
  const auto size = received > 0 ? static_cast<std::size_t>(received) : std::size_t{1};
  const std::string came = "; the answer was " + Hex(answer, size);
  const std::uint8_t unit = answer[header - 1];
  if (received == 0 || (rtu() && unit != options_.unit_id)) {
    return hal::Fail(Device(where + "answer from unit " + std::to_string(unit) +
                            ", expected unit " + std::to_string(options_.unit_id)));
  }
  if (size < header + 2 + trailer) return hal::Fail(Device(where + "answer too short" + came));
  if (auto ok = CheckHeader(answer, size); !ok) {
    return hal::Fail(Device(where + ok.error().message + came));
  }
  const std::uint8_t* const function = answer + header;
  if (*function == (request[0] | kExceptionBit)) {
    return hal::Fail(Device(where + "the bender answers exception " + std::to_string(function[1]) +
                            ", " + ExceptionName(function[1])));
  }
  if (*function != request[0]) {
    return hal::Fail(Device(where + "answer to function " + std::to_string(*function) +
                            ", expected " + std::to_string(request[0]) + came));
  }
  return Bytes(function, function + size - header - trailer);
}

hal::Result<void> ModbusConnection::Read(const RegisterRange& range, std::uint16_t* to) {
  const bool holding = range.space == hal::RegisterSpace::kHolding;
  Bytes request{holding ? kReadHolding : kReadInput};
  Append16(request, range.address);
  Append16(request, range.count);
  const std::string what = std::string("read ") + (holding ? "holding " : "input ") +
                           RangeName(range) + " (function " + std::to_string(request[0]) + ")";
  const auto answer = Transact(request, what);
  if (!answer) return hal::Fail(answer.error());
  if (answer->size() != 2 + 2 * range.count || (*answer)[1] != 2 * range.count) {
    Close();
    return hal::Fail(Device("bender " + peer() + ": " + what + ": answer of " +
                            std::to_string(answer->size() - 2) + " data bytes, expected " +
                            std::to_string(2 * range.count)));
  }
  for (std::uint32_t i = 0; i < range.count; ++i) to[i] = Load16(answer->data() + 2 + 2 * i);
  return {};
}

hal::Result<void> ModbusConnection::Write(const RegisterRange& range, const std::uint16_t* from) {
  const bool single = range.count == 1;
  Bytes request{single ? kWriteSingle : kWriteMultiple};
  Append16(request, range.address);
  if (!single) {
    Append16(request, range.count);
    request.push_back(static_cast<std::uint8_t>(2 * range.count));
  }
  for (std::uint32_t i = 0; i < range.count; ++i) Append16(request, from[i]);
  const std::string what =
      "write " + RangeName(range) + " (function " + std::to_string(request[0]) + ")";
  const auto answer = Transact(request, what);
  if (!answer) return hal::Fail(answer.error());
  // Both functions echo the first five bytes of the request.
  constexpr std::size_t kEcho = 5;
  if (answer->size() != kEcho || !std::equal(answer->begin(), answer->end(), request.begin())) {
    Close();
    return hal::Fail(Device("bender " + peer() + ": " + what + ": the echo is " +
                            Hex(answer->data(), answer->size()) + ", expected " +
                            Hex(request.data(), kEcho)));
  }
  return {};
}

}  // namespace bendloop::drivers
