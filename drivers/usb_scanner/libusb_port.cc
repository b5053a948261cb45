// SPDX-License-Identifier: Apache-2.0
#include "drivers/usb_scanner/libusb_port.h"

#include <libusb-1.0/libusb.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "drivers/scanner_wire/wire_format.h"
#include "hal/clock.h"

namespace bendloop::drivers {
namespace {

using hal::ErrorKind;
using hal::Fail;
using hal::Result;
using std::chrono::nanoseconds;

constexpr std::size_t kMostOutBytes = 512;
constexpr std::chrono::milliseconds kCloseTimeout{1000};
// Between looks at the bus where nobody tells of arrivals.
constexpr std::chrono::milliseconds kLookPeriod{100};

nanoseconds Now() { return hal::SteadyClock().Now(); }

std::string Where(libusb_device* device) {
  char path[32];
  std::snprintf(path, sizeof path, "/dev/bus/usb/%03d/%03d", libusb_get_bus_number(device),
                libusb_get_device_address(device));
  return path;
}

std::string SerialOf(libusb_device_handle* handle, std::uint8_t index) {
  std::array<unsigned char, 128> text{};
  if (index == 0) return {};
  const int size =
      libusb_get_string_descriptor_ascii(handle, index, text.data(), static_cast<int>(text.size()));
  return size > 0 ? std::string(reinterpret_cast<const char*>(text.data()),
                                static_cast<std::size_t>(size))
                  : std::string();
}

hal::Error UsbError(const std::string& name, const std::string& what, int code) {
  return {ErrorKind::kDevice, name + ": " + what + ": " + libusb_strerror(code)};
}

int HandleEvents(libusb_context* context, nanoseconds timeout) {
  timeval limit{static_cast<time_t>(timeout.count() / 1'000'000'000),
                static_cast<suseconds_t>(timeout.count() % 1'000'000'000 / 1000)};
  return libusb_handle_events_timeout_completed(context, &limit, nullptr);
}

UsbEnd EndOf(const libusb_transfer& usb) {
  switch (usb.status) {
    case LIBUSB_TRANSFER_COMPLETED:
      return UsbEnd::kData;
    case LIBUSB_TRANSFER_STALL:
      return UsbEnd::kStall;
    case LIBUSB_TRANSFER_CANCELLED:
      return UsbEnd::kCancelled;
    case LIBUSB_TRANSFER_NO_DEVICE:
      return UsbEnd::kGone;
    default:
      return UsbEnd::kError;
  }
}

// A device that fits, opened.
struct Candidate {
  libusb_device* device;
  libusb_device_handle* handle;
  std::string serial;
};

// What was seen on the bus.
struct Look {
  std::vector<Candidate> found;
  std::string others;                // serial numbers of those that do not fit
  std::optional<hal::Error> closed;  // one that might, but does not open

  // What to say where not exactly one was found.
  hal::Error Trouble(const std::string& name) const {
    if (found.size() > 1) {
      std::string serials;
      for (const Candidate& one : found) {
        serials += (serials.empty() ? "'" : ", '") + one.serial + "'";
      }
      return {ErrorKind::kDevice, name + ": " + std::to_string(found.size()) +
                                      " are plugged in (serial " + serials +
                                      "); say which with [scanner] serial in the cell file"};
    }
    if (closed) return *closed;
    return {ErrorKind::kDevice,
            name + ": is not plugged in" +
                (others.empty()
                     ? std::string("; check its cable and power, and [scanner] usb_id in the cell "
                                   "file")
                     : " (but serial " + others + "); check [scanner] serial in the cell file")};
  }
};

Look LookFor(const UsbMatch& match, const std::string& name, std::span<libusb_device*> bus) {
  Look look;
  for (libusb_device* const device : bus) {
    libusb_device_descriptor about{};
    if (libusb_get_device_descriptor(device, &about) != 0) continue;
    if (about.idVendor != match.vendor || about.idProduct != match.product) continue;
    libusb_device_handle* handle = nullptr;
    if (const int code = libusb_open(device, &handle); code != 0) {
      look.closed =
          code == LIBUSB_ERROR_ACCESS
              ? hal::Error{ErrorKind::kDevice, name + ": no access to " + Where(device) +
                                                   "; install config/70-bendloop-scanner.rules "
                                                   "and run as a member of group bendloop"}
              : UsbError(name, "cannot open " + Where(device), code);
      continue;
    }
    std::string serial = SerialOf(handle, about.iSerialNumber);
    if (!match.serial.empty() && serial != match.serial) {
      look.others += (look.others.empty() ? "" : ", ") + ("'" + serial + "'");
      libusb_close(handle);
      continue;
    }
    look.found.push_back({device, handle, std::move(serial)});
  }
  return look;
}

}  // namespace

LibusbPort::LibusbPort() : wake_(eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC)) { out_.port = this; }

LibusbPort::~LibusbPort() {
  Close();
  if (wake_ >= 0) close(wake_);
}

Result<std::string> LibusbPort::Open(const UsbMatch& match, std::size_t transfers,
                                     std::size_t bytes, nanoseconds arrival_timeout) {
  Close();
  const std::string name = NameOf(match);
  const nanoseconds deadline = Now() + arrival_timeout;
  while (true) {
    // A context of its own for each look: where no udev runs, only a new one sees what is new.
    if (const int code = libusb_init(&context_); code != 0) {
      context_ = nullptr;
      return Fail(UsbError(name, "libusb does not start", code));
    }
    auto serial = OpenOnce(match, name);
    if (serial) {
      if (auto ready = Prepare(transfers, bytes, name); !ready) {
        Close();
        return Fail(ready.error());
      }
      return serial;
    }
    const nanoseconds left = deadline - Now();
    if (left > nanoseconds(0)) AwaitArrival(match, std::min<nanoseconds>(left, kLookPeriod));
    Close();
    if (left <= nanoseconds(0)) return Fail(serial.error());
  }
}

Result<std::string> LibusbPort::OpenOnce(const UsbMatch& match, const std::string& name) {
  libusb_device** list = nullptr;
  const ssize_t count = libusb_get_device_list(context_, &list);
  if (count < 0) return Fail(UsbError(name, "no look at the bus", static_cast<int>(count)));
  Look look = LookFor(match, name, {list, static_cast<std::size_t>(count)});
  std::vector<Candidate>& found = look.found;
  Result<std::string> result = Fail(look.Trouble(name));
  if (found.size() == 1) {
    auto taken = Take(found[0].device, found[0].handle, name);
    if (taken) {
      result = std::move(found[0].serial);
      found.clear();
    } else {
      result = Fail(taken.error());
    }
  }
  for (const Candidate& one : found) libusb_close(one.handle);
  libusb_free_device_list(list, 1);
  return result;
}

Result<void> LibusbPort::Take(libusb_device* device, libusb_device_handle* handle,
                              const std::string& name) {
  libusb_config_descriptor* config = nullptr;
  if (const int code = libusb_get_active_config_descriptor(device, &config); code != 0) {
    return Fail(UsbError(name, "its descriptors cannot be read", code));
  }
  Pipes pipes;
  for (int i = 0; i < config->bNumInterfaces && pipes.interface_number < 0; ++i) {
    if (config->interface[i].num_altsetting < 1) continue;
    const libusb_interface_descriptor& face = config->interface[i].altsetting[0];
    if (face.bInterfaceClass != kWireUsbClass || face.bInterfaceSubClass != kWireUsbSubclass ||
        face.bInterfaceProtocol != kWireUsbProtocol) {
      continue;
    }
    Pipes here;
    for (int e = 0; e < face.bNumEndpoints; ++e) {
      const libusb_endpoint_descriptor& end = face.endpoint[e];
      if ((end.bmAttributes & LIBUSB_TRANSFER_TYPE_MASK) != LIBUSB_TRANSFER_TYPE_BULK) continue;
      const bool is_in = (end.bEndpointAddress & LIBUSB_ENDPOINT_IN) != 0;
      std::uint8_t& pipe = is_in ? here.in : here.out;
      if (pipe == 0) pipe = end.bEndpointAddress;
    }
    if (here.in != 0 && here.out != 0) {
      pipes = here;
      pipes.interface_number = face.bInterfaceNumber;
    }
  }
  libusb_free_config_descriptor(config);
  if (pipes.interface_number < 0) {
    return Fail(ErrorKind::kDevice, name + ": " + Where(device) +
                                        " has no interface of class ff, subclass 42, protocol 1 "
                                        "with a bulk IN and a bulk OUT endpoint; is it a scanner?");
  }
  (void)libusb_set_auto_detach_kernel_driver(handle, 1);
  if (const int code = libusb_claim_interface(handle, pipes.interface_number); code != 0) {
    return Fail(code == LIBUSB_ERROR_BUSY
                    ? hal::Error{ErrorKind::kDevice, name + ": is in use by another program"}
                    : UsbError(name, "its interface cannot be claimed", code));
  }
  // Whoever had it before may have left halts and half-done transfers.
  (void)libusb_clear_halt(handle, pipes.in);
  (void)libusb_clear_halt(handle, pipes.out);
  handle_ = handle;
  pipes_ = pipes;
  return {};
}

Result<void> LibusbPort::Prepare(std::size_t transfers, std::size_t bytes,
                                 const std::string& name) {
  gone_ = false;
  ended_.clear();
  const auto make = [this](Transfer& transfer, std::size_t size, std::uint8_t endpoint) {
    transfer.port = this;
    transfer.buffer.resize(size);
    transfer.in_flight = false;
    transfer.usb = libusb_alloc_transfer(0);
    if (transfer.usb == nullptr) return false;
    libusb_fill_bulk_transfer(transfer.usb, handle_, endpoint, transfer.buffer.data(),
                              static_cast<int>(size), &LibusbPort::OnEnded, &transfer, 0);
    return true;
  };
  bool made = make(out_, kMostOutBytes, pipes_.out);
  for (std::size_t i = 0; i < transfers; ++i) {
    in_.push_back(std::make_unique<Transfer>());
    in_.back()->index = i;
    made = make(*in_.back(), bytes, pipes_.in) && made;
  }
  out_.index = UsbCompletion::kOut;
  if (!made) return Fail(ErrorKind::kDevice, name + ": no memory for its transfers");
  waiting_.assign(1, {wake_, POLLIN, 0});
  if (const libusb_pollfd** const all = libusb_get_pollfds(context_); all != nullptr) {
    for (const libusb_pollfd* const* one = all; *one != nullptr; ++one) {
      waiting_.push_back({(*one)->fd, (*one)->events, 0});
    }
    libusb_free_pollfds(all);
  }
  return {};
}

void LibusbPort::AwaitArrival(const UsbMatch& match, nanoseconds timeout) {
  bool arrived = false;
  libusb_hotplug_callback_handle callback = 0;
  const auto on_arrival = [](libusb_context*, libusb_device*, libusb_hotplug_event,
                             void* user) -> int {
    *static_cast<bool*>(user) = true;
    return 1;
  };
  const bool told = libusb_has_capability(LIBUSB_CAP_HAS_HOTPLUG) != 0 &&
                    libusb_hotplug_register_callback(
                        context_, LIBUSB_HOTPLUG_EVENT_DEVICE_ARRIVED, LIBUSB_HOTPLUG_NO_FLAGS,
                        match.vendor, match.product, LIBUSB_HOTPLUG_MATCH_ANY, on_arrival, &arrived,
                        &callback) == LIBUSB_SUCCESS;
  const nanoseconds deadline = Now() + timeout;
  for (nanoseconds left = timeout; left > nanoseconds(0) && !arrived; left = deadline - Now()) {
    if (HandleEvents(context_, left) != 0) break;
  }
  if (told && !arrived) libusb_hotplug_deregister_callback(context_, callback);
}

void LibusbPort::Close() {
  if (context_ == nullptr) return;
  const auto in_flight = [this] {
    return out_.in_flight ||
           std::any_of(in_.begin(), in_.end(), [](const auto& one) { return one->in_flight; });
  };
  if (handle_ != nullptr) {
    for (const auto& one : in_) {
      if (one->in_flight) libusb_cancel_transfer(one->usb);
    }
    if (out_.in_flight) libusb_cancel_transfer(out_.usb);
    const nanoseconds deadline = Now() + kCloseTimeout;
    while (in_flight() && Now() < deadline) {
      if (HandleEvents(context_, std::chrono::milliseconds(50)) != 0) break;
    }
    libusb_release_interface(handle_, pipes_.interface_number);
    libusb_close(handle_);  // ends whatever the kernel still holds
    handle_ = nullptr;
  }
  for (const auto& one : in_) {
    if (one->usb != nullptr) libusb_free_transfer(one->usb);
  }
  in_.clear();
  if (out_.usb != nullptr) libusb_free_transfer(std::exchange(out_.usb, nullptr));
  out_.in_flight = false;
  libusb_exit(context_);
  context_ = nullptr;
}

bool LibusbPort::Start(Transfer& transfer) {
  if (gone_ || libusb_submit_transfer(transfer.usb) != 0) {
    gone_ = true;
    return false;
  }
  transfer.in_flight = true;
  return true;
}

bool LibusbPort::Submit(std::size_t transfer) { return Start(*in_[transfer]); }

std::span<const std::uint8_t> LibusbPort::Buffer(std::size_t transfer) const {
  return in_[transfer]->buffer;
}

bool LibusbPort::SendOut(std::span<const std::uint8_t> bytes) {
  const std::size_t size = std::min(bytes.size(), out_.buffer.size());
  std::copy_n(bytes.begin(), size, out_.buffer.begin());
  out_.usb->length = static_cast<int>(size);
  return Start(out_);
}

void LibusbPort::CancelIn() {
  for (const auto& one : in_) {
    if (one->in_flight) libusb_cancel_transfer(one->usb);
  }
}

bool LibusbPort::ClearHalt(UsbPipe pipe) {
  const int code = libusb_clear_halt(handle_, pipe == UsbPipe::kIn ? pipes_.in : pipes_.out);
  if (code == LIBUSB_ERROR_NO_DEVICE || code == LIBUSB_ERROR_NOT_FOUND) gone_ = true;
  return !gone_;
}

void LibusbPort::OnEnded(libusb_transfer* usb) {
  Transfer& transfer = *static_cast<Transfer*>(usb->user_data);
  LibusbPort& port = *transfer.port;
  transfer.in_flight = false;
  const UsbCompletion completion{transfer.index, static_cast<std::size_t>(usb->actual_length),
                                 EndOf(*usb)};
  if (completion.end == UsbEnd::kGone) port.gone_ = true;
  port.ended_.push_back(completion);
}

void LibusbPort::Wait(std::chrono::milliseconds timeout) {
  // A device that is gone leaves descriptors that are always ready.
  poll(waiting_.data(), gone_ ? 1 : waiting_.size(), static_cast<int>(timeout.count()));
  eventfd_t count = 0;
  (void)eventfd_read(wake_, &count);
  (void)HandleEvents(context_, nanoseconds(0));
}

void LibusbPort::Wake() { (void)eventfd_write(wake_, 1); }

std::optional<UsbCompletion> LibusbPort::TakeEnded() {
  if (ended_.empty()) return std::nullopt;
  const UsbCompletion completion = ended_.front();
  ended_.pop_front();
  return completion;
}

}  // namespace bendloop::drivers
