// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/simulators/gadget_service.h"

#include <sys/eventfd.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <vector>

namespace bendloop::host {
namespace {

using namespace std::chrono_literals;
using drivers::ScannerFault;
using drivers::UsbGadget;

constexpr std::size_t kChunk = 65536;
constexpr auto kTurn = 100ms;

}  // namespace

GadgetService::GadgetService(UsbGadget& gadget, drivers::ScannerDevice& device,
                             const std::string& capture)
    : gadget_(gadget), device_(device), wake_(eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)) {
  if (!capture.empty()) capture_.open(capture, std::ios::binary);
  watch_ = std::thread([this] { Watch(); });
  receive_ = std::thread([this] { Receive(); });
  send_ = std::thread([this] { Send(); });
}

GadgetService::~GadgetService() {
  stop_ = true;
  (void)eventfd_write(wake_, 1);
  changed_.notify_all();
  gadget_.Unplug();  // ends blocked transfers
  for (std::thread* one : {&watch_, &receive_, &send_}) one->join();
  close(wake_);
}

void GadgetService::WithDevice(const std::function<void(drivers::ScannerDevice&)>& action) {
  const std::lock_guard lock(mutex_);
  action(device_);
  changed_.notify_all();
}

hal::Result<void> GadgetService::Plug() { return gadget_.Plug(); }

void GadgetService::Unplug() {
  gadget_.Unplug();
  const std::lock_guard lock(mutex_);
  enabled_ = false;
  device_.HostWent();
}

void GadgetService::Watch() {
  while (!stop_) {
    const UsbGadget::Event event = gadget_.WaitForHost(kTurn, wake_);
    if (event == UsbGadget::Event::kNone) continue;
    const std::lock_guard lock(mutex_);
    enabled_ = event == UsbGadget::Event::kEnabled;
    if (enabled_) {
      device_.HostCame();
    } else {
      device_.HostWent();
    }
    changed_.notify_all();
  }
}

void GadgetService::Receive() {
  std::array<std::uint8_t, 512> bytes{};
  while (!stop_) {
    const std::size_t got = gadget_.Read(bytes);
    std::unique_lock lock(mutex_);
    if (got > 0) {
      device_.Receive({bytes.data(), got});
      changed_.notify_all();
    } else {
      changed_.wait_for(lock, kTurn, [this] { return stop_ || enabled_; });
    }
  }
}

void GadgetService::Send() {
  std::vector<std::uint8_t> chunk;
  chunk.reserve(kChunk);
  while (!stop_) {
    std::unique_lock lock(mutex_);
    chunk.clear();
    if (enabled_) {
      device_.Work();
      const auto waiting = device_.Waiting();
      chunk.assign(waiting.begin(),
                   waiting.begin() + static_cast<std::ptrdiff_t>(std::min(waiting.size(), kChunk)));
      // What is under way when the cable is pulled is lost.
      device_.Sent(chunk.size());
    }
    if (chunk.empty()) {
      const auto fault = device_.TakeCarrierFault();
      if (!fault) {
        const auto due = enabled_ ? device_.UntilDue() : std::chrono::nanoseconds(kTurn);
        if (due > 0ns) changed_.wait_for(lock, std::min<std::chrono::nanoseconds>(due, kTurn));
        continue;
      }
      lock.unlock();
      Do(*fault);
      continue;
    }
    lock.unlock();
    if (gadget_.Write(chunk)) {
      if (capture_.is_open()) {
        capture_.write(reinterpret_cast<const char*>(chunk.data()),
                       static_cast<std::streamsize>(chunk.size()));
        capture_.flush();
      }
    } else {
      // The watch learns why; until then there is nobody to talk to.
      lock.lock();
      changed_.wait_for(lock, 1ms);
    }
  }
}

void GadgetService::Do(const ScannerFault& fault) {
  if (fault.kind == ScannerFault::Kind::kHalt) {
    (void)gadget_.Halt();
    return;
  }
  Unplug();
  std::unique_lock lock(mutex_);
  const std::chrono::milliseconds out(fault.kind == ScannerFault::Kind::kUnplug ? fault.amount : 1);
  changed_.wait_for(lock, out, [this] { return stop_.load(); });
  lock.unlock();
  if (!stop_) (void)gadget_.Plug();
}

}  // namespace bendloop::host
