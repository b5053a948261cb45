// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

#include "hal/result.h"

namespace bendloop::host {

// How the bender is reached: Modbus TCP on loopback, CANopen or ISO-TP on a CAN interface.
enum class DemoLink { kTcp, kCanopen, kCanIsotp };
// kUsb: bendloop-usbscanner, a real USB device on a device port of this machine that leads back to
// it (dummy_hcd).
enum class DemoScanner { kTcp, kUsb };

struct DemoOptions {
  std::filesystem::path out = "demo-out";
  std::filesystem::path part;  // part file; empty: the shipped demo part
  DemoLink link = DemoLink::kTcp;
  std::string can_interface = "can0";
  DemoScanner scanner = DemoScanner::kTcp;
  std::uint32_t parts = 3;
  std::uint64_t seed = 1;
  bool colour = true;
  bool quick = false;  // as fast as it goes, for tests
  // Between profiles: half a millimetre, as the tube's ends are known no better than that.
  double spacing_mm = 0.5;
  int rays = 640;  // of a profile
};

// The whole main job with three processes of our own: bendloop-simbender, bendloop-simscanner and
// bendloopd, over loopback or a CAN bus. kRefused when the second part is not better than the
// first.
hal::Result<void> RunDemo(const DemoOptions& options);

}  // namespace bendloop::host
