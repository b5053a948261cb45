// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cell/service_needs.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <string>

#include "firmware-host/cell/service_times.h"

namespace bendloop::host {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

config::CellConfig NetworkCell() {
  config::CellConfig cell;
  cell.scanner.kind = config::ScannerKind::kStream;
  cell.scanner.host = "192.168.10.20";
  cell.bender.link = config::BenderKind::kModbusTcp;
  cell.bender.host = "192.168.10.30";
  return cell;
}

TEST(ServiceNeeds, AreTheAddressesAndDevicesOfTheCell) {
  config::CellConfig cell = NetworkCell();
  EXPECT_THAT(NeedsOf(cell).addresses, ElementsAre("192.168.10.20", "192.168.10.30"));
  EXPECT_FALSE(NeedsOf(cell).usb || NeedsOf(cell).serial || NeedsOf(cell).can);

  cell.bender.host = cell.scanner.host;
  EXPECT_THAT(NeedsOf(cell).addresses, ElementsAre("192.168.10.20"));

  cell.scanner.kind = config::ScannerKind::kUsb;
  cell.bender.link = config::BenderKind::kCanopen;
  EXPECT_THAT(NeedsOf(cell).addresses, IsEmpty()) << "hosts that nobody calls";
  EXPECT_TRUE(NeedsOf(cell).usb && NeedsOf(cell).can);

  cell.bender.link = config::BenderKind::kModbusRtu;
  EXPECT_TRUE(NeedsOf(cell).serial);
  EXPECT_FALSE(NeedsOf(cell).can);
}

TEST(ServiceNeeds, OfThisMachineNothingIsNeeded) {
  config::CellConfig cell = NetworkCell();
  cell.scanner.host = "127.0.0.1";
  cell.bender.host = "::1";
  EXPECT_THAT(NeedsOf(cell).addresses, IsEmpty());
}

TEST(ServiceNeeds, DropInGrantsThemAndNoOthers) {
  const std::string network = UnitDropIn(NeedsOf(NetworkCell()), "/etc/bendloop/cell.toml");
  EXPECT_THAT(network, HasSubstr("IPAddressAllow=192.168.10.20\nIPAddressAllow=192.168.10.30\n"));
  EXPECT_THAT(network, HasSubstr("\"BENDLOOP_GRANTED=192.168.10.20 192.168.10.30\"\n"));
  EXPECT_THAT(network, HasSubstr("PrivateDevices=true"));
  EXPECT_THAT(network, Not(HasSubstr("AF_CAN")));
  EXPECT_THAT(network, Not(HasSubstr("char-")));

  const std::string devices = UnitDropIn({.usb = true, .serial = true, .can = true}, "x");
  EXPECT_THAT(devices, HasSubstr("AF_CAN AF_NETLINK"));
  EXPECT_THAT(devices, HasSubstr("char-usb_device rw\nDeviceAllow=char-ttyS rw"));
  EXPECT_THAT(devices, Not(HasSubstr("PrivateDevices")));
  EXPECT_THAT(devices, Not(HasSubstr("IPAddressAllow")));
}

TEST(ServiceNeeds, DropInGivesTheTimeThatAStopMayTake) {
  config::CellConfig cell = NetworkCell();
  EXPECT_THAT(UnitDropIn(NeedsOf(cell), "x"), Not(HasSubstr("TimeoutStopSec")));
  cell.bender.commit_timeout = std::chrono::seconds(60);
  const auto seconds = std::chrono::ceil<std::chrono::seconds>(LongestStop(cell)).count();
  EXPECT_GT(seconds, 60);
  EXPECT_THAT(UnitDropIn(NeedsOf(cell), "x"),
              HasSubstr("\nTimeoutStopSec=" + std::to_string(seconds) + "\n"));
}

TEST(ServiceNeeds, DropInGivesTheMemoryThatALongQueueTakes) {
  config::CellConfig cell = NetworkCell();
  EXPECT_THAT(UnitDropIn(NeedsOf(cell), "x"), Not(HasSubstr("MemoryMax")));
  cell.scanner.queue_profiles += 1 << 14;  // of 147456 bytes each
  EXPECT_THAT(UnitDropIn(NeedsOf(cell), "x"),
              HasSubstr("\nMemoryMax=" + std::to_string(kUnitMemoryMb + 2304 + 1) + "M\n"));
}

TEST(ServiceNeeds, WhatIsNotGrantedIsToldWithTheMend) {
  const ServiceNeeds needs = NeedsOf(NetworkCell());
  EXPECT_TRUE(CheckGranted(needs, nullptr)) << "no service";
  EXPECT_TRUE(CheckGranted(needs, "usb 192.168.10.30 192.168.10.20"));
  EXPECT_TRUE(CheckGranted({}, ""));
  const auto refused = CheckGranted(needs, "usb serial can 192.168.10.2");
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().kind, hal::ErrorKind::kBadInput);
  EXPECT_THAT(refused.error().message, HasSubstr("the cell needs 192.168.10.20: bendloop check"));
  EXPECT_FALSE(CheckGranted({.can = true}, "usb serial"));
}

}  // namespace
}  // namespace bendloop::host
