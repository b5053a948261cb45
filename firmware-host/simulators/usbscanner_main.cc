// SPDX-License-Identifier: Apache-2.0
#include <poll.h>
#include <sys/signalfd.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <iostream>
#include <memory>
#include <sstream>
#include <string>
#include <vector>

#include "drivers/session/session_source.h"
#include "firmware-host/simulators/gadget_service.h"
#include "firmware-host/simulators/scan_operator.h"
#include "firmware-host/simulators/simulator_main.h"

namespace bendloop::host {
namespace {

using drivers::ReplayPace;
using drivers::ScannerDevice;
using drivers::ScanPace;
using drivers::SessionSource;
using hal::ErrorKind;
using hal::Fail;
using hal::Result;

constexpr int kReportMs = 20;

struct Options {
  drivers::UsbGadgetOptions gadget;
  std::string firmware = "1.0";
  std::string calibration = "none";
  std::uint32_t max_points = 4096;
  std::string usb_id = "1209:0001";
  std::string pace_name = "real";
  ScanPace pace = ScanPace::kRealTime;
  std::vector<std::string> sessions;
  bool forever = false;
  double drift_ppm = 0;
  std::string capture;
};

// Who stands beside the scanner.
class Operator {
 public:
  Operator(GadgetService& service, const Options& options, hal::Clock& clock)
      : service_(service), options_(options), clock_(clock) {}

  Result<void> Scan(const std::string& file) {
    auto session = std::make_unique<SessionSource>(file, ReplayPace::kMax, clock_);
    const auto info = session->Open();
    if (!info) return Fail(info.error());
    if (info->max_points > options_.max_points) {
      return Fail(ErrorKind::kBadInput,
                  file + ": has profiles of " + std::to_string(info->max_points) +
                      " points, the scanner says at most " + std::to_string(options_.max_points) +
                      "; raise --max-points");
    }
    (void)session->Start();
    tally_.Begin(file);
    std::cout << "scanning " << Name(file) << std::endl;
    service_.WithDevice(
        [&](ScannerDevice& device) { device.Trigger(std::move(session), options_.pace); });
    return {};
  }

  // One command line; false: switch off.
  bool Obey(const std::string& line) {
    std::istringstream words(line);
    std::string verb;
    words >> verb;
    if (verb.empty()) return true;
    if (verb == "quit") return false;
    Result<void> done;
    if (verb == "scan") {
      std::string file;
      std::getline(words >> std::ws, file);
      done = Scan(file);
    } else if (verb == "misbehave") {
      done = Misbehave(words);
    } else if (line == "go on") {
      service_.WithDevice([](ScannerDevice& device) { device.GoOn(); });
    } else if (verb == "drift") {
      double ppm = 0;
      words >> ppm;
      service_.WithDevice([&](ScannerDevice& device) { device.set_clock_drift_ppm(ppm); });
    } else if (verb == "unplug") {
      service_.Unplug();
    } else if (verb == "plug") {
      done = service_.Plug();
    } else {
      done = Fail(ErrorKind::kUsage, "\"" + verb +
                                         "\": expected scan FILE, misbehave FAULT, go on, "
                                         "drift PPM, unplug, plug or quit");
    }
    if (!done) {
      std::cout << "error " << done.error().message << std::endl;
    } else if (verb != "scan") {
      std::cout << "ok" << std::endl;
    }
    return true;
  }

  void Report() {
    std::size_t finished = 0;
    std::size_t abandoned = 0;
    service_.WithDevice([&](ScannerDevice& device) {
      finished = device.scans_finished();
      abandoned = device.scans_abandoned();
    });
    tally_.Report(finished, abandoned,
                  [this](const char* what, const std::string& file) { Say(what, file); });
  }

 private:
  static std::string Name(const std::string& file) {
    return std::filesystem::path(file).filename().string();
  }

  void Say(const char* what, const std::string& file) {
    std::cout << what << Name(file) << std::endl;
    if (!options_.forever) return;
    if (auto again = Scan(file); !again)
      std::cout << "error " << again.error().message << std::endl;
  }

  Result<void> Misbehave(std::istringstream& words) {
    std::string fault;
    std::getline(words, fault);
    const auto parsed = drivers::ParseScannerFault(fault, true);
    if (!parsed) return Fail(parsed.error());
    service_.WithDevice([&](ScannerDevice& device) { device.Misbehave(*parsed); });
    return {};
  }

  GadgetService& service_;
  const Options& options_;
  hal::Clock& clock_;
  ScanTally tally_;
};

// Obeys standard input until it ends or says quit, or a signal comes.
void Serve(Operator& person, int signals, bool forever) {
  CommandLines lines;
  std::array<pollfd, 2> waiting = {pollfd{STDIN_FILENO, POLLIN, 0}, pollfd{signals, POLLIN, 0}};
  while (true) {
    poll(waiting.data(), waiting.size(), kReportMs);
    person.Report();
    if (waiting[1].revents != 0) return;
    if (waiting[0].revents == 0) continue;
    const auto state = lines.Read([&](const std::string& line) { return person.Obey(line); });
    if (state == CommandLines::State::kQuit) return;
    if (state == CommandLines::State::kMore) continue;
    if (!forever) return;
    waiting[0].fd = -1;  // nobody there to listen to
  }
}

void Describe(CLI::App& app) {
  app.description(
      "A laser scanner that is really on USB: makes this machine's USB device port (a Raspberry "
      "Pi's, any board's, or dummy_hcd's) a scanner that speaks the scanner's wire protocol and "
      "plays "
      "session files. Needs root. Prints \"listening SERIAL\" when it is plugged in, then obeys "
      "one "
      "command a line on standard input:\n"
      "  scan FILE            play this session as soon as a host has started the scanner; prints "
      "\"scanning NAME\" and at its end \"scanned NAME\", or \"abandoned NAME\" if the host went "
      "away\n"
      "  misbehave FAULT [after N]  before the next profile, or N later; once (below)\n"
      "  go on                end a stall, or being mute, before its time\n"
      "  drift PPM            its clock runs fast by so much\n"
      "  unplug, plug         the cable\n"
      "  quit                 or the end of input: unplug and remove the device");
  app.footer("Faults:\n" + drivers::ScannerFaultHelp(true) +
             "Examples:\n"
             "  bendloop-usbscanner --session part.session --forever </dev/null\n"
             "  (echo scan part.session; cat) | bendloop-usbscanner --serial CELL3 --pace max");
}

void AddOptions(CLI::App& app, Options& options) {
  app.add_option("--session", options.sessions, "sessions to play at once, one after the other")
      ->type_name("FILE");
  app.add_flag("--forever", options.forever,
               "play each session again and again; go on when standard input ends");
  app.add_option("--pace", options.pace_name,
                 "real: as recorded; max: as fast as the host takes them")
      ->check(CLI::IsMember({"real", "max"}))
      ->capture_default_str();
  app.add_option("--serial", options.gadget.serial, "serial number")->capture_default_str();
  app.add_option("--model", options.gadget.model, "what it says it is")->capture_default_str();
  app.add_option("--usb-id", options.usb_id, "vendor and product number, in hexadecimal")
      ->type_name("VVVV:PPPP")
      ->capture_default_str();
  app.add_option("--max-points", options.max_points, "most points of a profile")
      ->check(CLI::Range(1, 16384))
      ->capture_default_str();
  app.add_option("--drift", options.drift_ppm, "its clock runs fast by so much [ppm]")
      ->capture_default_str();
  app.add_option("--capture", options.capture, "keep the bytes that the host gets in this file")
      ->type_name("FILE");
  app.add_option("--udc", options.gadget.udc,
                 "device port, of /sys/class/udc (default: the first)");
}

// What the options mean that are written as one word.
Result<void> Understand(Options& options) {
  unsigned vendor = 0;
  unsigned product = 0;
  char more = 0;
  if (std::sscanf(options.usb_id.c_str(), "%4x:%4x%c", &vendor, &product, &more) != 2) {
    return Fail(ErrorKind::kUsage,
                "--usb-id: found '" + options.usb_id + "', expected VVVV:PPPP, e.g. 1209:0001");
  }
  options.gadget.vendor = static_cast<std::uint16_t>(vendor);
  options.gadget.product = static_cast<std::uint16_t>(product);
  options.pace = options.pace_name == "max" ? ScanPace::kMax : ScanPace::kRealTime;
  return {};
}

Result<void> Run(CLI::App& app, int argc, char** argv) {
  Options options;
  Describe(app);
  AddOptions(app, options);
  app.parse(argc, argv);
  if (auto understood = Understand(options); !understood) return understood;

  // The device must not outlive us, so a signal ends us in order. Before any thread.
  sigset_t ends;
  sigemptyset(&ends);
  for (const int one : {SIGINT, SIGTERM, SIGHUP}) sigaddset(&ends, one);
  pthread_sigmask(SIG_BLOCK, &ends, nullptr);
  const int signals = signalfd(-1, &ends, SFD_CLOEXEC | SFD_NONBLOCK);

  auto gadget = drivers::UsbGadget::Create(options.gadget);
  if (!gadget) return Fail(gadget.error());
  hal::SteadyClock clock;
  ScannerDevice device({options.gadget.model, options.gadget.serial, options.firmware,
                        options.calibration, options.max_points},
                       clock);
  device.set_clock_drift_ppm(options.drift_ppm);
  GadgetService service(**gadget, device, options.capture);
  if (auto plugged = service.Plug(); !plugged) return Fail(plugged.error());
  std::cout << "listening " << options.gadget.serial << std::endl;
  Operator person(service, options, clock);
  for (const std::string& file : options.sessions) {
    if (auto begun = person.Scan(file); !begun) return Fail(begun.error());
  }
  Serve(person, signals, options.forever);
  return {};
}

}  // namespace
}  // namespace bendloop::host

int main(int argc, char** argv) {
  return bendloop::host::SimulatorMain("bendloop-usbscanner", bendloop::host::Run, argc, argv);
}
