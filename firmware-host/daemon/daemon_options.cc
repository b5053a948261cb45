// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/daemon/daemon_options.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <charconv>
#include <iostream>

#include "firmware-host/console/command_line.h"
#include "firmware-host/console/version.h"

namespace bendloop::host {
namespace {

constexpr const char* kFooter = R"(
Examples:
  bendloopd --config /etc/bendloop/cell.toml
  bendloopd --config cell.toml --check-only
  bendloopd --config cell.toml --bender 127.0.0.1:1502 --scanner 127.0.0.1:7420

Runs until SIGTERM. State, results and recordings go to the cell's state_dir;
`bendloop status` asks the running daemon. Exit codes: 0 stopped, 2 wrong usage,
3 bad configuration, 4 device failure at start, 5 internal error.)";

}  // namespace

hal::Result<Endpoint> ParseEndpoint(const std::string& text, const std::string& what) {
  const std::size_t colon = text.rfind(':');
  Endpoint endpoint;
  if (colon != std::string::npos && colon > 0) {
    endpoint.host = text.substr(0, colon);
    const char* begin = text.data() + colon + 1;
    const char* end = text.data() + text.size();
    const auto [stop, error] = std::from_chars(begin, end, endpoint.port);
    if (error == std::errc() && stop == end && endpoint.port > 0) return endpoint;
  }
  return hal::Fail(hal::ErrorKind::kUsage,
                   what + ": found '" + text + "', expected HOST:PORT, e.g. 127.0.0.1:1502");
}

hal::Result<std::optional<DaemonOptions>> ParseDaemonOptions(int argc, char** argv) {
  DaemonOptions options;
  std::string bender;
  std::string scanner;
  CLI::App app{"bendloopd: measures each scanned tube and corrects the bender's program",
               "bendloopd"};
  DressCommandLine(app, BuildText());
  app.footer(kFooter);
  app.add_option("--config", options.config, "Cell file (TOML, schema bendloop.cell/1)")
      ->required()
      ->type_name("CELL.toml");
  app.add_option("--bender", bender, "Reach the bender here instead, over Modbus TCP")
      ->type_name("HOST:PORT");
  app.add_option("--scanner", scanner,
                 "Reach the scanner here instead, over TCP; or on USB: usb, or usb:SERIAL")
      ->type_name("HOST:PORT");
  app.add_option("--parts", options.parts, "End after so many scans (0: never)")->type_name("N");
  app.add_option("--status-port", options.status_port,
                 "Port on 127.0.0.1 for /status and /metrics (0: any free one)")
      ->type_name("PORT");
  app.add_flag("--check-only", options.check_only, "Check the configuration and exit");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    if (error.get_exit_code() == 0) {
      app.exit(error, std::cout, std::cerr);
      return std::optional<DaemonOptions>();
    }
    return hal::Fail(hal::ErrorKind::kUsage, WhatIsWrong(app, error));
  }
  if (!bender.empty()) {
    auto endpoint = ParseEndpoint(bender, "--bender");
    if (!endpoint) return hal::Fail(endpoint.error());
    options.bender = *endpoint;
  }
  if (scanner == "usb" || scanner.rfind("usb:", 0) == 0) {
    options.usb_scanner = scanner.substr(std::min<std::size_t>(scanner.size(), 4));
  } else if (!scanner.empty()) {
    auto endpoint = ParseEndpoint(scanner, "--scanner");
    if (!endpoint) return hal::Fail(endpoint.error());
    options.scanner = *endpoint;
  }
  return std::optional<DaemonOptions>(options);
}

void ApplyOverrides(const DaemonOptions& options, config::CellConfig& cell) {
  if (options.bender) {
    cell.bender.link = config::BenderKind::kModbusTcp;
    cell.bender.host = options.bender->host;
    cell.bender.port = options.bender->port;
  }
  if (options.scanner) {
    cell.scanner.kind = config::ScannerKind::kStream;
    cell.scanner.host = options.scanner->host;
    cell.scanner.port = options.scanner->port;
  }
  if (options.usb_scanner) {
    cell.scanner.kind = config::ScannerKind::kUsb;
    cell.scanner.serial = *options.usb_scanner;
  }
}

}  // namespace bendloop::host
