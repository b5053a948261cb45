// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <span>
#include <string>

#include "drivers/scanner_wire/wire_decoder.h"
#include "hal/result.h"

namespace bendloop::drivers {

// Brings bytes to a scanner and back: TCP, a pair of USB pipes, or a test's. Errors are kDevice,
// name the scanner, and are final until Open().
class ByteCarrier {
 public:
  virtual ~ByteCarrier() = default;

  // Of the scanner, as messages begin: "scanner at 192.168.0.20:7420".
  virtual std::string name() const = 0;
  // Closes first what is open.
  virtual hal::Result<void> Open() = 0;
  virtual void Close() = 0;
  virtual bool is_open() const = 0;
  // Sends all of it or fails. With no time to wait it is handed over and not waited for.
  virtual hal::Result<void> Send(std::span<const std::uint8_t> bytes,
                                 std::chrono::nanoseconds timeout) = 0;
  // Gives what came to `decoder`, which has no whole message left, and waits for it at most
  // `timeout`; false if nothing came. Allocates nothing and takes no lock unless it fails.
  virtual hal::Result<bool> Receive(WireDecoder& decoder, std::chrono::nanoseconds timeout) = 0;
  // What went by since Open(), for the log; "" if nothing is worth a word.
  virtual std::string Remarks() const { return {}; }
};

}  // namespace bendloop::drivers
