// SPDX-License-Identifier: Apache-2.0
#include "drivers/stream_scanner/stream_scanner.h"

#include <memory>
#include <utility>

#include "drivers/stream_scanner/tcp_connection.h"

namespace bendloop::drivers {
namespace {

using std::chrono::nanoseconds;

class TcpCarrier final : public ByteCarrier {
 public:
  TcpCarrier(std::string host, std::uint16_t port, nanoseconds connect_timeout)
      : host_(std::move(host)), port_(port), connect_timeout_(connect_timeout) {}

  std::string name() const override { return "scanner at " + host_ + ":" + std::to_string(port_); }
  hal::Result<void> Open() override {
    Close();  // a scanner serves one host at a time
    auto connection = TcpConnection::Connect(host_, port_, connect_timeout_);
    if (!connection) return hal::Fail(connection.error());
    connection_ = std::move(*connection);
    return {};
  }
  void Close() override { connection_.Close(); }
  bool is_open() const override { return connection_.is_open(); }
  hal::Result<void> Send(std::span<const std::uint8_t> bytes, nanoseconds timeout) override {
    return connection_.Send(bytes, timeout);
  }
  hal::Result<bool> Receive(WireDecoder& decoder, nanoseconds timeout) override {
    const auto received = connection_.Receive(decoder.Writable(), timeout);
    if (!received) return hal::Fail(received.error());
    decoder.Commit(*received);
    return *received > 0;
  }

 private:
  const std::string host_;
  const std::uint16_t port_;
  const nanoseconds connect_timeout_;
  TcpConnection connection_;
};

WireScannerOptions WireOptions(const StreamScannerOptions& options) {
  WireScannerOptions wire;
  wire.answer_timeout = options.connect_timeout;
  wire.settings = options.settings;
  wire.patience = options.patience;
  return wire;
}

}  // namespace

StreamScanner::StreamScanner(const StreamScannerOptions& options)
    : WireScanner(std::make_unique<TcpCarrier>(options.host, options.port, options.connect_timeout),
                  WireOptions(options)) {}

}  // namespace bendloop::drivers
