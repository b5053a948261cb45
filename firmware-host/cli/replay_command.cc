// SPDX-License-Identifier: Apache-2.0
#include <unistd.h>

#include <filesystem>
#include <iostream>
#include <memory>
#include <optional>

#include "config/digest.h"
#include "config/load.h"
#include "firmware-host/cell/part_plan.h"
#include "firmware-host/cell/replay.h"
#include "firmware-host/cli/command.h"
#include "firmware-host/console/message.h"
#include "firmware-host/console/temporary_folder.h"
#include "firmware-host/console/terminal.h"
#include "firmware-host/daemon/state_store.h"
#include "firmware-host/result/result_json.h"
#include "firmware-host/support/support_bundle.h"
#include "firmware-host/support/tar_file.h"
#include "firmware-host/text/progress.h"
#include "firmware-host/text/result_text.h"
#include "firmware-host/text/style.h"
#include "hal/clock.h"

namespace bendloop::host {
namespace {

struct ReplayArguments {
  std::string session;
  std::string config;
  std::string pace = "max";
  std::string of_bundle;
  std::string json;
  bool send = false;
  bool is_bundle = false;
};

constexpr const char* kReplayFooter = R"(
Examples:
  bendloop replay demo-out/sessions/part-0002.session \
    --config demo-out/cell.toml
  bendloop replay part.session --config cell.toml --pace recorded --json -
  bendloop replay support.tar.gz           the newest scan of a support bundle,
                                           with its own cell file

The session takes the daemon's own way, the bender included. With [bender]
link = "simulated" it starts a simulated bender that holds the program that bent
the part. A real bender is read and never written, but with --send: then it is
corrected under the same interlocks as by a live scan. The age of the recording
counts, the tube must not have been used by another scan, and the program that
the bender holds must be the one that bent it, or our own correction of it. The
same session and cell file give the same result, timing_ms aside.

Exit code 1 when the part is refused or out of tolerance; the reasons are
printed. A part that is undecided (too near a tolerance for what the samples
tell) is told so, with exit code 0: who takes parts for good by a script asks
for inspection.verdict == "pass" in the JSON.)";

int ReplayOne(const ReplayArguments& arguments) {
  auto cell = config::LoadCell(arguments.config);
  if (!cell) return Report(cell.error());
  ReplayOptions options;
  // The machine that a bundle is from is elsewhere.
  if (arguments.is_bundle && IsReal(cell->bender.link)) {
    options.config_digest = config::Digest(*cell);
    cell->bender.link = config::BenderKind::kSimulated;
  }
  options.session = arguments.session;
  options.send = arguments.send;
  options.recorded_pace = arguments.pace == "recorded";
  // A real bender is this cell's: its journal and lot are taken, and the daemon must not run.
  std::optional<StateStore> store;
  std::string lot_key;
  if (IsReal(cell->bender.link)) {
    const auto plan = MakePartPlan(*cell);
    if (!plan) return Report(plan.error());
    lot_key = plan->config_digest;
    auto opened = StateStore::Open(cell->state_dir);
    if (!opened) return Report(opened.error());
    store.emplace(std::move(*opened));
    options.journal = store->journal();
    auto lot = store->Lot(lot_key);
    if (!lot) return Report(lot.error());
    options.lot = std::move(*lot);
  }
  hal::SteadyClock clock;
  const auto replay = ReplaySession(*cell, options, clock);
  if (!replay) return Report(replay.error());
  for (const std::string& note : replay->notes) {
    Note(arguments.session + ": " + note);
  }
  const PartOutcome& outcome = replay->outcome;
  if (store && outcome.end == PartEnd::kCorrected && outcome.next) {
    if (auto kept = store->KeepLot(*outcome.next, lot_key); !kept) return Report(kept.error());
  }
  if (arguments.json != "-") {
    std::cout << RunText(outcome.result, ColourAllowed(STDOUT_FILENO),
                         SentenceColumns(STDOUT_FILENO))
              << std::flush;
  }
  if (!arguments.json.empty()) {
    const int code = WriteOutput(arguments.json, WriteResultJson(outcome.result));
    if (code != 0) return code;
  }
  for (const std::string& reason : outcome.reasons) TellPerson("bendloop", reason);
  return outcome.exit_code();
}

int ReplayOneOrBundle(ReplayArguments arguments) {
  std::error_code error;
  if (!std::filesystem::is_regular_file(arguments.session, error) || !IsTar(arguments.session)) {
    if (!arguments.config.empty()) return ReplayOne(arguments);
    return Report({hal::ErrorKind::kUsage,
                   "--config is required for a session; a support bundle brings its own"});
  }
  if (arguments.send) {
    return Report({hal::ErrorKind::kUsage, "--send: a support bundle's machine is elsewhere"});
  }
  const auto unpacked = TemporaryFolder::Make();
  if (!unpacked) return Report(unpacked.error());
  const auto bundle = UnpackSupportBundle(arguments.session, unpacked->path(), arguments.of_bundle);
  if (!bundle) return Report(bundle.error());
  Note(arguments.session + ": " + bundle->session.stem().string() +
       (arguments.config.empty() ? ", with its own cell file" : ""));
  arguments.session = bundle->session.string();
  if (arguments.config.empty()) arguments.config = bundle->cell.string();
  arguments.is_bundle = true;
  return ReplayOne(arguments);
}

}  // namespace

CLI::App* AddReplayCommand(CLI::App& app, Run& run) {
  auto arguments = std::make_shared<ReplayArguments>();
  CLI::App* command =
      app.add_subcommand("replay", "A recorded session through the daemon's own way, then exit");
  command->footer(kReplayFooter);
  command->add_option("session", arguments->session, "Recorded session, or a support bundle")
      ->required()
      ->type_name("SESSION");
  command->add_option("--config", arguments->config, "Cell file; a bundle brings its own")
      ->type_name("CELL.toml");
  command->add_option("--recording", arguments->of_bundle, "Of a bundle this one, not the newest")
      ->type_name("NAME");
  command->add_option("--pace", arguments->pace, "As fast as it goes, or as it was recorded")
      ->check(CLI::IsMember({"max", "recorded"}))
      ->capture_default_str();
  command->add_option("--json", arguments->json, "Write the result here, - for standard output")
      ->type_name("OUT");
  command->add_flag("--send", arguments->send,
                    "Write the correction to the cell's real bender, if the interlocks let it");
  command->callback(
      [arguments, &run] { run = [arguments] { return ReplayOneOrBundle(*arguments); }; });
  return command;
}

}  // namespace bendloop::host
