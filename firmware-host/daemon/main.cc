// SPDX-License-Identifier: Apache-2.0
#include <signal.h>
#include <spdlog/sinks/stdout_sinks.h>
#include <spdlog/spdlog.h>

#include <cstdio>
#include <exception>

#include "config/load.h"
#include "firmware-host/acquisition/realtime.h"
#include "firmware-host/cell/part_plan.h"
#include "firmware-host/cell/tube_rules.h"
#include "firmware-host/daemon/daemon.h"

namespace {

using bendloop::hal::Error;
using bendloop::hal::ExitCode;

int Report(const Error& error) {
  std::fprintf(stderr, "bendloopd: %s\n", error.message.c_str());
  return ExitCode(error.kind);
}

extern "C" void OnSignal(int) { bendloop::host::Daemon::RequestStop(); }

void CatchSignals() {
  struct sigaction action {};
  action.sa_handler = OnSignal;
  sigaction(SIGTERM, &action, nullptr);
  sigaction(SIGINT, &action, nullptr);
  signal(SIGPIPE, SIG_IGN);
}

int CheckOnly(const bendloop::host::DaemonOptions& options) {
  const auto cell = bendloop::config::LoadCell(options.config);
  if (!cell) return Report(cell.error());
  const auto plan = bendloop::host::MakePartPlan(*cell);
  if (!plan) return Report(plan.error());
  for (const std::string& remark : bendloop::host::RemarksOn(*cell)) {
    std::fprintf(stderr, "bendloopd: note: %s\n", remark.c_str());
  }
  std::printf("%s: ok, cell '%s', part '%s', %zu bends\n", options.config.c_str(),
              cell->name.c_str(), plan->part.c_str(), plan->nominal.bend_count());
  return 0;
}

int Main(int argc, char** argv) {
  const auto options = bendloop::host::ParseDaemonOptions(argc, argv);
  if (!options) return Report(options.error());
  if (!*options) return 0;
  if ((*options)->check_only) return CheckOnly(**options);
  spdlog::set_default_logger(spdlog::stderr_logger_mt("bendloopd"));
  spdlog::set_pattern("%Y-%m-%dT%H:%M:%S.%e%z %l %v");
  bendloop::host::KeepMemory();
  CatchSignals();
  auto daemon = bendloop::host::Daemon::Start(**options);
  if (!daemon) return Report(daemon.error());
  return (*daemon)->Run();
}

}  // namespace

int main(int argc, char** argv) {
  try {
    return Main(argc, argv);
  } catch (const std::exception& error) {
    return Report({bendloop::hal::ErrorKind::kInternal,
                   std::string("internal error: ") + error.what() + "; please report it"});
  }
}
