// SPDX-License-Identifier: Apache-2.0
#include <signal.h>
#include <spdlog/pattern_formatter.h>
#include <spdlog/sinks/stdout_sinks.h>
#include <spdlog/spdlog.h>

#include <cstdio>
#include <exception>
#include <memory>
#include <new>
#include <string>
#include <utility>

#include "firmware-host/acquisition/realtime.h"
#include "firmware-host/cell/service_unit.h"
#include "firmware-host/cell/tube_rules.h"
#include "firmware-host/console/message.h"
#include "firmware-host/console/printable.h"
#include "firmware-host/console/standard_output.h"
#include "firmware-host/daemon/daemon.h"
#include "firmware-host/daemon/daemon_settings.h"
#include "firmware-host/workers/spare_memory.h"

namespace {

using bendloop::hal::Error;
using bendloop::hal::ExitCode;

int Report(const Error& error) {
  bendloop::host::TellPerson("bendloopd", error.message);
  return ExitCode(error.kind);
}

// What scanners, benders and files say stands in the log: it must not move a terminal's cursor, nor
// begin a line of its own.
class PrintableMessage : public spdlog::custom_flag_formatter {
 public:
  void format(const spdlog::details::log_msg& message, const std::tm&,
              spdlog::memory_buf_t& out) override {
    const std::string text =
        bendloop::host::Printable({message.payload.data(), message.payload.size()});
    out.append(text.data(), text.data() + text.size());
  }
  std::unique_ptr<custom_flag_formatter> clone() const override {
    return std::make_unique<PrintableMessage>();
  }
};

extern "C" void OnSignal(int) { bendloop::host::Daemon::RequestStop(); }

extern "C" void OnHangUp(int) { bendloop::host::Daemon::NoteHangUp(); }

void CatchSignals() {
  struct sigaction action {};
  action.sa_handler = OnSignal;
  sigaction(SIGTERM, &action, nullptr);
  sigaction(SIGINT, &action, nullptr);
  // A terminal that was closed, or who expects the settings to be read again: no reason to end.
  action.sa_handler = OnHangUp;
  sigaction(SIGHUP, &action, nullptr);
  signal(SIGPIPE, SIG_IGN);
}

int CheckOnly(const bendloop::host::DaemonOptions& options) {
  const auto settings = bendloop::host::LoadDaemonSettings(options);
  if (!settings) return Report(settings.error());
  const bendloop::host::ServiceTimes service = bendloop::host::TimesOfUnit();
  for (const std::string& remark : bendloop::host::RemarksOn(settings->cell, service)) {
    bendloop::host::TellPerson("bendloopd", "note: " + remark);
  }
  std::printf("%s: ok, cell '%s', part '%s', %zu bends\n", options.config.c_str(),
              settings->cell.name.c_str(), settings->plan.part.c_str(),
              settings->plan.nominal.bend_count());
  return 0;
}

int Main(int argc, char** argv) {
  const auto options = bendloop::host::ParseDaemonOptions(argc, argv);
  if (!options) return Report(options.error());
  if (!*options) return 0;
  if ((*options)->check_only) return CheckOnly(**options);
  spdlog::set_default_logger(spdlog::stderr_logger_mt("bendloopd"));
  auto formatter = std::make_unique<spdlog::pattern_formatter>();
  formatter->add_flag<PrintableMessage>('*').set_pattern("%Y-%m-%dT%H:%M:%S.%e%z %l %*");
  spdlog::set_formatter(std::move(formatter));
  bendloop::host::KeepMemory();
  const bendloop::host::SpareMemory spare;
  CatchSignals();
  auto daemon = bendloop::host::Daemon::Start(**options);
  if (!daemon) return Report(daemon.error());
  return (*daemon)->Run();
}

}  // namespace

int main(int argc, char** argv) {
  try {
    return bendloop::host::FinishOutput("bendloopd", Main(argc, argv));
  } catch (const std::bad_alloc&) {
    // At the start, or while new settings were taken up: systemd starts it anew.
    return Report({bendloop::hal::ErrorKind::kDevice, "out of memory"});
  } catch (const std::exception& error) {
    return Report({bendloop::hal::ErrorKind::kInternal,
                   std::string("internal error: ") + error.what() + "; please report it"});
  }
}
