// SPDX-License-Identifier: Apache-2.0
#include <unistd.h>

#include <filesystem>
#include <iostream>
#include <memory>
#include <optional>
#include <utility>

#include "config/digest.h"
#include "config/load.h"
#include "firmware-host/acceptance/certificate.h"
#include "firmware-host/acceptance/robot.h"
#include "firmware-host/cell/bender_carrier.h"
#include "firmware-host/cell/part_plan.h"
#include "firmware-host/cli/acceptance_hands.h"
#include "firmware-host/cli/command.h"
#include "firmware-host/console/output_file.h"
#include "firmware-host/console/printable.h"
#include "firmware-host/console/terminal.h"
#include "firmware-host/console/version.h"
#include "firmware-host/daemon/state_store.h"
#include "firmware-host/ledger/moment.h"
#include "firmware-host/text/progress.h"
#include "firmware-host/text/style.h"

namespace bendloop::host {
namespace {

struct AcceptanceArguments {
  std::string config;
  std::string out;
  std::string operator_command;
  bool yes = false;
  bool restore = false;
};

constexpr const char* kFooter = R"(
Examples:
  bendloop acceptance --config cell.toml            asks before it writes, and for what hands must do
  bendloop acceptance --config cell.toml --yes      nobody is asked; what needs hands is not tried
  bendloop acceptance --config cell.toml --yes --operator ./rig.sh
  bendloop acceptance --config cell.toml --restore  after a run that was cut

Plays the rules of "What the PLC must do" (drivers/README.md) against the cell's PLC, with the machine in
set-up mode and no daemon running; puts back the program that it found; and writes a certificate.
Exit codes: 0 no rule is broken; 1 a rule is broken; 3 a bad file; 4 no answer from the bender, or the
program that was found could not be put back.)";

// The way to the cell's bender, and the bender itself where it is simulated.
struct Reached {
  std::unique_ptr<drivers::SimulatedBender> simulated;
  std::unique_ptr<drivers::RegisterCarrier> carrier;
};

hal::Result<Reached> Reach(const config::CellConfig& cell, hal::Clock& clock) {
  Reached reached;
  config::BenderConfig bender = cell.bender;
  if (bender.link == config::BenderKind::kNone) {
    return hal::Fail(hal::ErrorKind::kBadInput,
                     cell.file.string() + ": the cell has no bender (link = \"none\")");
  }
  if (bender.link == config::BenderKind::kSimulated) {
    const auto nominal = NominalProgram(cell.part);
    if (!nominal) return hal::Fail(nominal.error());
    drivers::SimulatedBenderOptions options;
    options.map = bender.register_map;
    options.program = {cell.part.part_number, 1, *nominal, 0};
    options.pipe_radius_mm = cell.part.pipe_radius_mm;
    auto started = drivers::SimulatedBender::Start(std::move(options));
    if (!started) return hal::Fail(started.error());
    reached.simulated = std::move(*started);
    bender.link = config::BenderKind::kModbusTcp;
    bender.host = "127.0.0.1";
    bender.port = reached.simulated->port();
  }
  reached.carrier = MakeBenderCarrier(bender, clock);
  return reached;
}

const char* LinkName(config::BenderKind link) {
  switch (link) {
    case config::BenderKind::kModbusTcp:
      return "modbus-tcp";
    case config::BenderKind::kModbusRtu:
      return "modbus-rtu";
    case config::BenderKind::kCanIsotp:
      return "can-isotp";
    case config::BenderKind::kCanopen:
      return "canopen";
    case config::BenderKind::kSimulated:
      return "simulated";
    case config::BenderKind::kNone:
      break;
  }
  return "none";
}

std::unique_ptr<HandSteps> HandsOf(const AcceptanceArguments& arguments, const Reached& reached) {
  if (!arguments.operator_command.empty()) {
    return std::make_unique<CommandHands>(arguments.operator_command);
  }
  if (reached.simulated) return std::make_unique<SimulatorHands>(*reached.simulated);
  if (arguments.yes) return std::make_unique<NoHands>();
  return std::make_unique<TerminalHands>();
}

// True: go on.
bool Consent(const Plc& plc) {
  std::cerr
      << "bendloop acceptance will, on " << plc.Name() << ":\n"
      << "  - write to the staging area and to the commit register some 150 times\n"
      << "  - make programs active that differ from the active one by up to half a degree;\n"
      << "    a PLC that breaks its rules may make wrong ones active, too\n"
      << "  - put back the program that it found\n"
      << "Nothing of this moves the machine, but whoever starts a cycle meanwhile bends such\n"
      << "a program: set-up mode, no tube, nobody at the cycle start.\n"
      << "Type yes to begin: ";
  std::string line;
  return std::getline(std::cin, line) && line == "yes";
}

// Exchanges that fail, at once; on a terminal where it is, too.
void Tell(const Exchange& exchange, bool terminal) {
  if (terminal) std::cerr << "\r\033[K";
  if (exchange.outcome == Outcome::kFailed) {
    std::cerr << "  exchange " << exchange.number << ", " << exchange.name << ": "
              << Printable(exchange.detail) << "\n";
  }
  if (terminal) std::cerr << "  " << exchange.number << " " << exchange.name << std::flush;
}

int Write(const AcceptanceArguments& arguments, const config::CellConfig& cell,
          const Acceptance& result) {
  CertificateHead head;
  head.date = UtcText(SystemMoment().unix_ms);
  head.software = kSoftware;
  head.cell = cell.name;
  head.link = LinkName(cell.bender.link);
  head.map_file = cell.bender.register_map_file.filename().string();
  head.map_digest = config::Digest(cell.bender.register_map);
  const std::string stem = arguments.out.empty()
                               ? (cell.state_dir / ("acceptance-" + head.date)).string()
                               : arguments.out;
  std::cout << CertificateText(head, result, ColourAllowed(STDOUT_FILENO),
                               TerminalColumns(STDOUT_FILENO))
            << std::flush;
  for (const auto& [name, text] :
       {std::pair(stem + ".json", Dump(CertificateJson(head, result), 1) + "\n"),
        std::pair(stem + ".html", CertificateHtml(head, result))}) {
    if (auto ok = WriteOutputFile(name, text); !ok) return Report(ok.error());
    std::cout << "  " << name << "\n";
  }
  if (result.Count(Outcome::kFailed) > 0) {
    return Report({hal::ErrorKind::kRefused, VerdictText(result)});
  }
  return result.passed() ? 0 : Report({hal::ErrorKind::kDevice, result.trouble});
}

int Accept(const AcceptanceArguments& arguments) {
  const auto cell = config::LoadCell(arguments.config);
  if (!cell) return Report(cell.error());
  const bool ask = !arguments.yes && cell->bender.link != config::BenderKind::kSimulated;
  if (ask && !arguments.restore && isatty(STDIN_FILENO) == 0) {
    return Report(
        {hal::ErrorKind::kUsage,
         "standard input is no terminal, so that nobody can be asked; --yes begins without "
         "asking"});
  }
  auto store = StateStore::Open(cell->state_dir, StateUser::kAcceptance);
  if (!store) return Report(store.error());
  hal::SteadyClock clock;
  auto reached = Reach(*cell, clock);
  if (!reached) return Report(reached.error());
  Plc plc(cell->bender.register_map, std::move(reached->carrier), clock);
  const RestoreFile file(store->acceptance());
  RobotOptions options;
  options.bench.reply_timeout = cell->bender.commit_timeout;
  if (arguments.restore) {
    const auto done = RestoreAfterCut(plc, file, options.bench);
    if (!done) return Report(done.error());
    std::cout << *done << std::endl;
    return 0;
  }
  if (ask && !Consent(plc)) {
    return Report({hal::ErrorKind::kRefused, "nothing was written"});
  }
  const bool terminal = isatty(STDERR_FILENO) != 0;
  options.on_exchange = [terminal](const Exchange& exchange) { Tell(exchange, terminal); };
  const auto hands = HandsOf(arguments, *reached);
  const auto result = RunAcceptance(plc, file, *hands, options);
  if (terminal) std::cerr << "\r\033[K";
  return result ? Write(arguments, *cell, *result) : Report(result.error());
}

}  // namespace

CLI::App* AddAcceptanceCommand(CLI::App& app, Run& run) {
  auto arguments = std::make_shared<AcceptanceArguments>();
  CLI::App* command =
      app.add_subcommand("acceptance", "Does the bender's PLC keep its side? A certificate");
  command->footer(kFooter);
  command->add_option("--config", arguments->config, "The cell file")
      ->type_name("CELL.toml")
      ->required();
  command
      ->add_option("--out", arguments->out,
                   "The certificate's files, without .json and .html (default: in state_dir)")
      ->type_name("STEM");
  command->add_flag("--yes", arguments->yes, "Begins without asking");
  command
      ->add_option("--operator", arguments->operator_command,
                   "Does what hands must do: called with cycle, guard, fault, idle, edit, "
                   "power-cycle, stop, start")
      ->type_name("COMMAND");
  command->add_flag("--restore", arguments->restore,
                    "Only puts back the program that a run left behind that was cut");
  command->callback([arguments, &run] { run = [arguments] { return Accept(*arguments); }; });
  return command;
}

}  // namespace bendloop::host
