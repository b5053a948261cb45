// SPDX-License-Identifier: Apache-2.0
#include "drivers/usb_gadget/usb_gadget.h"

#include <endian.h>
#include <fcntl.h>
#include <linux/usb/functionfs.h>
#include <poll.h>
#include <sys/mount.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <system_error>
#include <utility>

#include "drivers/scanner_wire/wire_format.h"

namespace bendloop::drivers {
namespace {

namespace fs = std::filesystem;
using hal::ErrorKind;
using hal::Fail;
using hal::Result;

std::string Reason(int code) { return std::generic_category().message(code); }

struct [[gnu::packed]] Pipes {
  usb_interface_descriptor interface;
  usb_endpoint_descriptor_no_audio in;
  usb_endpoint_descriptor_no_audio out;
};
struct [[gnu::packed]] SuperPipes {
  usb_interface_descriptor interface;
  usb_endpoint_descriptor_no_audio in;
  usb_ss_ep_comp_descriptor in_more;
  usb_endpoint_descriptor_no_audio out;
  usb_ss_ep_comp_descriptor out_more;
};
struct [[gnu::packed]] Descriptors {
  usb_functionfs_descs_head_v2 head;
  __le32 full_count;
  __le32 high_count;
  __le32 super_count;
  Pipes full;
  Pipes high;
  SuperPipes super;
};

usb_interface_descriptor Interface() {
  usb_interface_descriptor one{};
  one.bLength = USB_DT_INTERFACE_SIZE;
  one.bDescriptorType = USB_DT_INTERFACE;
  one.bNumEndpoints = 2;
  one.bInterfaceClass = kWireUsbClass;
  one.bInterfaceSubClass = kWireUsbSubclass;
  one.bInterfaceProtocol = kWireUsbProtocol;
  return one;
}

usb_endpoint_descriptor_no_audio Bulk(std::uint8_t address, std::uint16_t packet) {
  usb_endpoint_descriptor_no_audio one{};
  one.bLength = USB_DT_ENDPOINT_SIZE;
  one.bDescriptorType = USB_DT_ENDPOINT;
  one.bEndpointAddress = address;
  one.bmAttributes = USB_ENDPOINT_XFER_BULK;
  one.wMaxPacketSize = htole16(packet);
  return one;
}

Descriptors MakeDescriptors() {
  constexpr std::uint8_t kIn = USB_DIR_IN | 1;
  constexpr std::uint8_t kOut = USB_DIR_OUT | 2;
  usb_ss_ep_comp_descriptor more{};
  more.bLength = USB_DT_SS_EP_COMP_SIZE;
  more.bDescriptorType = USB_DT_SS_ENDPOINT_COMP;
  Descriptors all{};
  all.head.magic = htole32(FUNCTIONFS_DESCRIPTORS_MAGIC_V2);
  all.head.length = htole32(sizeof all);
  all.head.flags =
      htole32(FUNCTIONFS_HAS_FS_DESC | FUNCTIONFS_HAS_HS_DESC | FUNCTIONFS_HAS_SS_DESC);
  all.full_count = all.high_count = htole32(3);
  all.super_count = htole32(5);
  all.full = {Interface(), Bulk(kIn, 64), Bulk(kOut, 64)};
  all.high = {Interface(), Bulk(kIn, 512), Bulk(kOut, 512)};
  all.super = {Interface(), Bulk(kIn, 1024), more, Bulk(kOut, 1024), more};
  return all;
}

Result<void> WriteText(const fs::path& file, const std::string& text) {
  const int opened = open(file.c_str(), O_WRONLY | O_CLOEXEC);
  int why = opened < 0 ? errno : 0;
  if (opened >= 0) {
    const std::string line = text + "\n";
    if (write(opened, line.data(), line.size()) < 0) why = errno;
    close(opened);
  }
  if (why == 0) return {};
  return Fail(ErrorKind::kDevice, file.string() + ": cannot write '" + text + "': " + Reason(why));
}

std::string Hex(std::uint16_t number) {
  char text[8];
  std::snprintf(text, sizeof text, "0x%04x", static_cast<unsigned>(number));
  return text;
}

}  // namespace

UsbGadget::UsbGadget(const UsbGadgetOptions& options)
    : options_(options),
      name_("bendloop-" + options.serial),
      gadget_(options.configfs / "usb_gadget" / name_),
      mount_(options.mounts / name_) {}

UsbGadget::~UsbGadget() { Remove(); }

Result<std::unique_ptr<UsbGadget>> UsbGadget::Create(const UsbGadgetOptions& options) {
  if (options.serial.empty() || options.serial.find_first_of("/. \n") != std::string::npos) {
    return Fail(ErrorKind::kUsage, "USB gadget: serial '" + options.serial +
                                       "', expected letters, digits, '-' and '_'");
  }
  std::unique_ptr<UsbGadget> gadget(new UsbGadget(options));
  gadget->udc_ = options.udc;
  if (gadget->udc_.empty()) {
    std::error_code none;
    for (const auto& port : fs::directory_iterator("/sys/class/udc", none)) {
      gadget->udc_ = port.path().filename().string();
      break;
    }
  }
  if (gadget->udc_.empty()) {
    return Fail(ErrorKind::kDevice,
                "USB gadget: /sys/class/udc is empty: this machine has no USB device port (a "
                "Raspberry Pi: dtoverlay=dwc2; for a try: modprobe dummy_hcd)");
  }
  if (auto made = gadget->Make(); !made) return Fail(made.error());
  if (auto opened = gadget->OpenPipes(); !opened) return Fail(opened.error());
  return gadget;
}

Result<void> UsbGadget::Make() {
  std::error_code error;
  const fs::path all = gadget_.parent_path();
  if (!fs::exists(all, error)) {
    (void)mount("none", options_.configfs.c_str(), "configfs", 0, nullptr);
    if (!fs::exists(all, error)) {
      return Fail(ErrorKind::kDevice, all.string() +
                                          ": is not there; modprobe libcomposite, and mount -t "
                                          "configfs none " +
                                          options_.configfs.string());
    }
  }
  Remove();
  const fs::path strings = gadget_ / "strings/0x409";
  const fs::path config = gadget_ / "configs/c.1";
  const fs::path function = gadget_ / ("functions/ffs." + name_);
  fs::create_directory(gadget_, error);
  if (!error) fs::create_directory(strings, error);
  if (!error) fs::create_directory(config, error);
  if (!error) fs::create_directory(function, error);
  if (!error) fs::create_directory_symlink(function, config / function.filename(), error);
  if (error) {
    return Fail(ErrorKind::kDevice, gadget_.string() + ": cannot be made: " + error.message() +
                                        " (root and modprobe usb_f_fs are needed)");
  }
  const std::pair<fs::path, std::string> texts[] = {{gadget_ / "idVendor", Hex(options_.vendor)},
                                                    {gadget_ / "idProduct", Hex(options_.product)},
                                                    {gadget_ / "bcdDevice", "0x0100"},
                                                    {strings / "manufacturer", options_.maker},
                                                    {strings / "product", options_.model},
                                                    {strings / "serialnumber", options_.serial}};
  for (const auto& [file, text] : texts) {
    if (auto written = WriteText(file, text); !written) return written;
  }
  fs::create_directories(mount_, error);
  if (mount(name_.c_str(), mount_.c_str(), "functionfs", 0, nullptr) != 0) {
    return Fail(ErrorKind::kDevice,
                mount_.string() + ": cannot mount functionfs: " + Reason(errno));
  }
  mounted_ = true;
  return {};
}

Result<void> UsbGadget::OpenPipes() {
  const auto fail = [this](const char* file) {
    return Fail(ErrorKind::kDevice, (mount_ / file).string() + ": " + Reason(errno));
  };
  control_ = open((mount_ / "ep0").c_str(), O_RDWR | O_CLOEXEC);
  const Descriptors descriptors = MakeDescriptors();
  usb_functionfs_strings_head strings{};
  strings.magic = htole32(FUNCTIONFS_STRINGS_MAGIC);
  strings.length = htole32(sizeof strings);
  if (control_ < 0 || write(control_, &descriptors, sizeof descriptors) < 0 ||
      write(control_, &strings, sizeof strings) < 0) {
    return fail("ep0");
  }
  // Not blocking: says at once when the host has not enabled it; a transfer itself blocks all the
  // same.
  in_ = open((mount_ / "ep1").c_str(), O_RDWR | O_CLOEXEC | O_NONBLOCK);
  if (in_ < 0) return fail("ep1");
  out_ = open((mount_ / "ep2").c_str(), O_RDWR | O_CLOEXEC | O_NONBLOCK);
  if (out_ < 0) return fail("ep2");
  return {};
}

void UsbGadget::Remove() {
  Unplug();
  for (int* one : {&in_, &out_, &control_}) {
    if (*one >= 0) close(std::exchange(*one, -1));
  }
  std::error_code error;
  if (!fs::exists(gadget_, error)) return;
  // A directory of configfs is removed by itself, not by what it holds.
  fs::remove(gadget_ / "configs/c.1" / ("ffs." + name_), error);
  for (const std::string& folder :
       {std::string("configs/c.1"), "functions/ffs." + name_, std::string("strings/0x409")}) {
    rmdir((gadget_ / folder).c_str());
  }
  rmdir(gadget_.c_str());
  umount2(mount_.c_str(), MNT_DETACH);
  rmdir(mount_.c_str());
}

Result<void> UsbGadget::Plug() { return WriteText(gadget_ / "UDC", udc_); }

void UsbGadget::Unplug() { (void)WriteText(gadget_ / "UDC", ""); }

UsbGadget::Event UsbGadget::WaitForHost(std::chrono::milliseconds timeout, int wake) {
  std::array<pollfd, 2> waiting = {pollfd{control_, POLLIN, 0}, pollfd{wake, POLLIN, 0}};
  if (poll(waiting.data(), waiting.size(), static_cast<int>(timeout.count())) <= 0 ||
      (waiting[0].revents & POLLIN) == 0) {
    return Event::kNone;
  }
  usb_functionfs_event event{};
  if (read(control_, &event, sizeof event) != sizeof event) return Event::kNone;
  switch (event.type) {
    case FUNCTIONFS_ENABLE:
      return Event::kEnabled;
    case FUNCTIONFS_DISABLE:
    case FUNCTIONFS_UNBIND:
      return Event::kDisabled;
    case FUNCTIONFS_SETUP:
      // No request is known; the wrong direction refuses it.
      if ((event.u.setup.bRequestType & USB_DIR_IN) != 0) {
        (void)!read(control_, nullptr, 0);
      } else {
        (void)!write(control_, nullptr, 0);
      }
      return Event::kNone;
    default:
      return Event::kNone;
  }
}

std::size_t UsbGadget::Read(std::span<std::uint8_t> bytes) {
  const ssize_t got = read(out_, bytes.data(), bytes.size());
  return got > 0 ? static_cast<std::size_t>(got) : 0;
}

bool UsbGadget::Write(std::span<const std::uint8_t> bytes) {
  while (!bytes.empty()) {
    const ssize_t sent = write(in_, bytes.data(), bytes.size());
    if (sent < 0 && errno == EINTR) continue;
    if (sent <= 0) return false;
    bytes = bytes.subspan(static_cast<std::size_t>(sent));
  }
  return true;
}

bool UsbGadget::Halt() {
  // To read from a pipe that goes the other way is how FunctionFS halts it; not before the last
  // packet has left.
  std::uint8_t byte = 0;
  for (int i = 0; i < 1000; ++i) {
    if (read(in_, &byte, 1) >= 0) return false;
    if (errno == EBADMSG) return true;
    if (errno != EAGAIN && errno != EINTR) return false;
    usleep(1000);
  }
  return false;
}

}  // namespace bendloop::drivers
