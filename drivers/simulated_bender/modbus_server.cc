// SPDX-License-Identifier: Apache-2.0
#include "drivers/simulated_bender/modbus_server.h"

#include <arpa/inet.h>
#include <poll.h>
#include <pty.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <termios.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstddef>
#include <string>

#include "drivers/can_socket/can_socket.h"
#include "drivers/simulated_bender/modbus_framing.h"

namespace bendloop::drivers {
namespace {

constexpr std::size_t kMaxClients = 16;
constexpr std::chrono::milliseconds kPartialRequest{500};  // a request must be whole within

// Is the request as long as its function and counts say? libmodbus trusts them.
bool IsWhole(const ModbusRequest& request) {
  const std::size_t trailer = request.header == 1 ? 2 : 0;  // RTU's crc
  const std::size_t fixed = request.header + 5 + trailer;
  switch (request.function()) {
    case 0x03:
    case 0x04:
    case 0x06:
      return request.bytes.size() == fixed;
    case 0x10: {
      if (request.bytes.size() <= fixed) return false;
      const std::size_t data = 2u * Load16(request.bytes, request.header + 3);
      return request.bytes[request.header + 5] == data && request.bytes.size() == fixed + 1 + data;
    }
    default:
      return true;  // will be answered by an exception
  }
}

}  // namespace

RegisterRange ModbusRequest::range() const {
  const auto space = function() == 0x04 ? hal::RegisterSpace::kInput : hal::RegisterSpace::kHolding;
  const std::uint32_t count = function() == 0x06 ? 1 : Load16(bytes, header + 3);
  return {space, Load16(bytes, header + 1), count};
}

hal::Result<std::unique_ptr<ModbusServer>> ModbusServer::Listen(std::uint16_t port) {
  std::unique_ptr<ModbusServer> server(new ModbusServer);
  server->context_.reset(modbus_new_tcp("127.0.0.1", port));
  server->wake_ = eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC);
  if (server->context_ && server->wake_ >= 0) {
    server->listener_ = modbus_tcp_listen(server->context_.get(), kMaxClients);
  }
  sockaddr_in address{};
  socklen_t size = sizeof address;
  if (server->listener_ < 0 ||
      getsockname(server->listener_, reinterpret_cast<sockaddr*>(&address), &size) != 0) {
    return hal::Fail(hal::ErrorKind::kDevice, "cannot listen on 127.0.0.1:" + std::to_string(port) +
                                                  ": " + modbus_strerror(errno));
  }
  server->port_ = ntohs(address.sin_port);
  // libmodbus waits this long before it answers with some exceptions.
  modbus_set_response_timeout(server->context_.get(), 0, 1000);
  return server;
}

hal::Result<std::unique_ptr<ModbusServer>> ModbusServer::OpenLine(std::uint8_t unit_id) {
  std::unique_ptr<ModbusServer> server(new ModbusServer);
  termios raw{};
  cfmakeraw(&raw);
  char name[64] = "";
  server->wake_ = eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC);
  if (server->wake_ < 0 ||
      openpty(&server->line_, &server->far_line_, nullptr, &raw, nullptr) != 0 ||
      ttyname_r(server->far_line_, name, sizeof name) != 0) {
    return hal::Fail(hal::ErrorKind::kDevice,
                     std::string("cannot open a pseudo-terminal: ") + modbus_strerror(errno));
  }
  server->device_ = name;
  constexpr int kBaud = 115200;  // a pseudo-terminal has none
  server->context_.reset(modbus_new_rtu(name, kBaud, 'N', 8, 1));
  if (!server->context_ || modbus_set_slave(server->context_.get(), unit_id) != 0) {
    return hal::Fail(hal::ErrorKind::kUsage,
                     "unit " + std::to_string(unit_id) + ": 1 to 247 was expected for Modbus RTU");
  }
  modbus_set_response_timeout(server->context_.get(), 0, 1000);
  server->clients_.push_back({server->next_id_++, server->line_});
  return server;
}

hal::Result<std::unique_ptr<ModbusServer>> ModbusServer::OpenCan(const IsotpChannel& channel) {
  std::unique_ptr<ModbusServer> server(new ModbusServer);
  server->wake_ = eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC);
  server->context_.reset(modbus_new_tcp("127.0.0.1", 0));  // makes the answers, listens nowhere
  if (server->wake_ < 0 || !server->context_) {
    return hal::Fail(hal::ErrorKind::kDevice, modbus_strerror(errno));
  }
  const auto opened = channel.socket >= 0 ? CopySocket(channel.socket)
                                          : OpenIsotpSocket(channel.interface, channel.reply_id,
                                                            channel.request_id);
  if (!opened) return hal::Fail(opened.error());
  server->line_ = *opened;
  server->device_ = channel.interface;
  modbus_set_response_timeout(server->context_.get(), 0, 1000);
  server->clients_.push_back({server->next_id_++, server->line_});
  return server;
}

ModbusServer::~ModbusServer() {
  HangUpAll();
  if (line_ >= 0) close(line_);
  if (far_line_ >= 0) close(far_line_);
  if (listener_ >= 0) close(listener_);
  if (wake_ >= 0) close(wake_);
}

void ModbusServer::Wake() { (void)eventfd_write(wake_, 1); }

void ModbusServer::Poll(std::chrono::milliseconds timeout,
                        const std::function<void(const ModbusRequest&)>& handle) {
  std::vector<pollfd> polled{{wake_, POLLIN, 0}, {listener_, POLLIN, 0}};
  const std::vector<Client> clients = clients_;
  for (const Client& client : clients) polled.push_back({client.socket, POLLIN, 0});
  if (poll(polled.data(), polled.size(), static_cast<int>(timeout.count())) <= 0) return;
  if (polled[0].revents != 0) {
    eventfd_t count = 0;
    (void)eventfd_read(wake_, &count);
  }
  if (polled[1].revents != 0) Accept();
  for (std::size_t i = 0; i < clients.size(); ++i) {
    if (polled[i + 2].revents == 0 || SocketOf(clients[i].id) < 0) continue;
    if (!Receive(clients[i], handle)) HangUp(clients[i].id);
  }
}

void ModbusServer::Accept() {
  const int socket = accept4(listener_, nullptr, nullptr, SOCK_CLOEXEC);
  if (socket < 0) return;
  if (clients_.size() >= kMaxClients) {
    close(socket);
    return;
  }
  clients_.push_back({next_id_++, socket});
}

bool ModbusServer::Receive(const Client& client,
                           const std::function<void(const ModbusRequest&)>& handle) {
  ModbusRequest request{client.id, {}, rtu() ? std::size_t{1} : std::size_t{7}};
  if (rtu()) {
    const auto frame = ReadRtuRequest(client.socket, kPartialRequest);
    if (!frame) return false;
    request.bytes = *frame;
    const std::uint8_t unit = request.bytes[0];
    if (unit != modbus_get_slave(context_.get()) && unit != MODBUS_BROADCAST_ADDRESS) return true;
  } else {
    const auto frame =
        line_ >= 0 ? ReadCanRequest(client.socket) : ReadTcpRequest(client.socket, kPartialRequest);
    if (!frame) return false;
    request.bytes = *frame;
  }
  if (IsWhole(request)) {
    handle(request);
  } else {
    ReplyException(request, kIllegalValue);
  }
  return true;
}

int ModbusServer::SocketOf(std::uint64_t client) const {
  const auto found = std::find_if(clients_.begin(), clients_.end(),
                                  [client](const Client& c) { return c.id == client; });
  return found == clients_.end() ? -1 : found->socket;
}

void ModbusServer::Execute(const ModbusRequest& request, RegisterImage& image) {
  modbus_mapping_t mapping{};
  mapping.nb_registers = kAddressSpaceSize;
  mapping.tab_registers = image.At(hal::RegisterSpace::kHolding, 0);
  mapping.nb_input_registers = kAddressSpaceSize;
  mapping.tab_input_registers = image.At(hal::RegisterSpace::kInput, 0);
  modbus_set_socket(context_.get(), SocketOf(request.client));
  modbus_reply(context_.get(), request.bytes.data(), static_cast<int>(request.bytes.size()),
               &mapping);
}

void ModbusServer::ReplyException(const ModbusRequest& request, std::uint8_t code) {
  modbus_set_socket(context_.get(), SocketOf(request.client));
  modbus_reply_exception(context_.get(), request.bytes.data(), code);
}

void ModbusServer::SendRaw(std::uint64_t client, const std::vector<std::uint8_t>& bytes) {
  const int socket = SocketOf(client);
  if (socket < 0) return;
  if (line_ >= 0) {
    (void)!write(socket, bytes.data(), bytes.size());
  } else {
    (void)!send(socket, bytes.data(), bytes.size(), MSG_NOSIGNAL);
  }
}

void ModbusServer::HangUp(std::uint64_t client) {
  if (line_ >= 0) return;  // nobody hangs up a serial line or a bus
  std::erase_if(clients_, [client](const Client& c) {
    if (c.id != client) return false;
    close(c.socket);
    return true;
  });
}

void ModbusServer::HangUpAll() {
  if (line_ >= 0) return;
  for (const Client& client : clients_) close(client.socket);
  clients_.clear();
}

}  // namespace bendloop::drivers
