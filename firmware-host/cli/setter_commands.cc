// SPDX-License-Identifier: Apache-2.0
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <iostream>
#include <memory>
#include <optional>
#include <sstream>

#include "config/load.h"
#include "firmware-host/cell/part_plan.h"
#include "firmware-host/cell/part_shelf.h"
#include "firmware-host/cell/tube_rules.h"
#include "firmware-host/cli/command.h"
#include "firmware-host/console/wrap.h"
#include "firmware-host/daemon/setter_box.h"
#include "firmware-host/daemon/state_store.h"
#include "firmware-host/ledger/moment.h"
#include "firmware-host/result/program_json.h"
#include "firmware-host/text/table.h"
#include "hal/clock.h"
#include "pipeline/correction/tube_values.h"

namespace bendloop::host {
namespace {

// The cell of the appliance itself; others are named.
constexpr const char* kInstalledCell = "/etc/bendloop/cell.toml";

struct SetterArguments {
  std::string config;
  std::string part;
  std::uint32_t part_number = 0;  // 0: the cell file's own, of a daemon the one that is set
  double patience_s = 30;
  bool json = false;
  bool send = false;
};

constexpr const char* kLotFooter = R"(
Examples:
  bendloop lot show                        what the correction has learnt, and
                                           of how many parts
  bendloop lot new                         another coil: springback and stretch
                                           are open again
  bendloop lot hold                        measure and learn, change no program
  bendloop lot release --config cell.toml  of a cell that is not installed
  bendloop lot show --part-number 1002     another part of the cell's parts_dir

Each part of the cell's parts_dir has a lot of its own. Without a number 'show'
is of the cell file's part, and what is asked for is of the part that the PLC
has set; where no daemon runs, of the cell file's. With a daemon the request
reaches it through requests/ in its state directory and is granted between two
parts; without one it is done at once. Who asked, when and what became of it
stand in requests.log. Exit codes: 1 refused; 3 a bad file; 4 no answer from
daemon or bender.)";

constexpr const char* kUndoFooter = R"(
Examples:
  bendloop undo
  bendloop undo --config cell.toml

The program before the last one that was sent becomes the bender's again, by the
same commit protocol: the bender must be idle and hold what was sent last. The
lot is held afterwards, because it would make the same correction again;
'bendloop lot release' ends that. A second undo takes back the first.
Exit codes: 1 refused, nothing was sent; 4 no answer from daemon or bender.)";

constexpr const char* kFirstFooter = R"(
Examples:
  bendloop first-program --part part.toml            print it
  bendloop first-program --part part.toml --json     the same for programs
  bendloop first-program --send                      send it to the cell's bender

The nominal with springback and stretch made up for, as the part file's
[material] tells them: angles that open to the nominal, straights shorter by
what their bends will add. Sending goes by the commit protocol, to an idle
bender that holds a program of this part; a new lot begins. Exit codes: 1
refused, nothing was sent; 3 a bad file; 4 no answer from daemon or bender.)";

constexpr const char* kAcknowledgeFooter = R"(
Examples:
  bendloop acknowledge
  bendloop acknowledge --config cell.toml

Somebody has seen the alarms. A bender that was seen to break a rule of drivers/README.md gets no
program from then on, restarts or not: look at what it holds, have its PLC mended, then acknowledge.
Exit codes: 3 a bad file; 4 no answer from the daemon.)";

int Tell(const SetterAnswer& answer, bool json) {
  if (answer.error && !json) return Report({*answer.error, answer.text});
  const int code = answer.error ? hal::ExitCode(*answer.error) : 0;
  if (json) {
    std::cout << Dump({{"schema", "bendloop.answer/1"}, {"exit_code", code}, {"text", answer.text}},
                      2)
              << std::endl;
  } else {
    std::cout << answer.text << std::endl;
  }
  return code;
}

// The parts of a cell, for a command.
class CellParts {
 public:
  using Part = std::shared_ptr<const PartPlan>;

  static hal::Result<CellParts> Open(config::CellConfig cell) {
    auto own = MakePartPlan(cell);
    if (!own) return hal::Fail(own.error());
    return CellParts(std::move(cell), std::make_shared<const PartPlan>(std::move(*own)));
  }
  const PartPlan& own() const { return *own_; }
  // 0: the cell file's own.
  hal::Result<Part> Of(std::uint32_t number) const {
    const PartShelf::Choice choice = PartShelf(cell_, own_, clock_).Select(number);
    if (!choice.part) return hal::Fail(hal::ErrorKind::kBadInput, choice.detail);
    return choice.part;
  }
  // As the state directory's files count them.
  std::uint32_t LotFileOf(const PartPlan& part) const {
    return host::LotFileOf(part.part_number, own_->part_number);
  }

 private:
  CellParts(config::CellConfig cell, Part own) : cell_(std::move(cell)), own_(std::move(own)) {}

  config::CellConfig cell_;
  Part own_;
  hal::SteadyClock clock_;
};

// Without a daemon: by itself, with the state directory held.
hal::Result<SetterAnswer> DoAlone(SetterWish wish, std::uint32_t part_number,
                                  const config::CellConfig& cell, const CellParts& parts,
                                  StateStore& store, hal::Clock& clock) {
  const auto asked = parts.Of(part_number);
  if (!asked) return hal::Fail(asked.error());
  const PartPlan& plan = **asked;
  // One that is damaged is not written over.
  auto lot = store.Lot(plan.config_digest, parts.LotFileOf(plan));
  if (!lot) return hal::Fail(lot.error());
  BenderDesk::Options options;
  options.journal = store.journal();
  options.pipe_radius_mm = plan.pipe_radius_mm;
  options.commit = plan.commit;
  options.ledger = LedgerRulesOf(cell);
  // A simulated bender lives in the daemon's process: without it there is none.
  config::BenderConfig bender = cell.bender;
  if (!config::IsReal(bender.link)) bender.link = config::BenderKind::kNone;
  auto desk = BenderDesk::Open(bender, options, clock);
  if (!desk) return hal::Fail(desk.error());
  SetterDesk setter({[&](std::uint32_t) -> hal::Result<SetterPorts::Part> { return *asked; },
                     desk->get(), [&](const PartPlan&) { return *lot; },
                     [&](const PartPlan& part, const pipeline::LotState& kept) {
                       return store.KeepLot(kept, part.config_digest, parts.LotFileOf(part));
                     },
                     store.requests_log()});
  return setter.Grant({wish, OwnUser(), UtcText(SystemMoment().unix_ms), part_number});
}

int Ask(SetterWish wish, const SetterArguments& arguments) {
  const auto cell = config::LoadCell(arguments.config);
  if (!cell) return Report(cell.error());
  const auto parts = CellParts::Open(*cell);
  if (!parts) return Report(parts.error());
  hal::SteadyClock clock;
  auto store = StateStore::Open(cell->state_dir);
  hal::Result<SetterAnswer> answer;
  if (store) {
    answer = DoAlone(wish, arguments.part_number, *cell, *parts, *store, clock);
  } else {
    answer = SetterBox(cell->state_dir)
                 .Ask(wish, arguments.part_number,
                      std::chrono::nanoseconds(std::llround(arguments.patience_s * 1e9)), clock);
  }
  if (!answer) return Report(answer.error());
  return Tell(*answer, arguments.json);
}

Json LotSummary(const PartPlan& part, const pipeline::LotState& lot) {
  Json json = {{"schema", "bendloop.lot-summary/1"},
               {"part", part.part},
               {"part_number", part.part_number},
               {"number", lot.number},
               {"parts", lot.parts},
               {"held", lot.held},
               {"parts_of_all_lots", lot.parts_of_all_lots},
               {"slips", lot.slips},
               {"jumps", lot.jumps}};
  if (lot.hypotheses.empty()) return json;
  using Layout = pipeline::LotLayout;
  const pipeline::LotHypothesis& best = lot.hypotheses.front();
  json["temperament"] = pipeline::Name(best.temperament);
  json["latest_event"] = {{"kind", pipeline::Name(best.event)}, {"parts_since", best.parts_since}};
  json["scatter"] = {{"length_mm", Number(best.scatter.length_mm)},
                     {"rotation_deg", Number(best.scatter.rotation_deg)},
                     {"angle_deg", Number(best.scatter.angle_deg)}};
  json["coil"] = {{"angle_off_at_70_deg", Number(best.mean[Layout::kConstant])},
                  {"more_at_120_deg", Number(best.mean[Layout::kSlope])},
                  {"stretch_off_percent", Number(best.mean[Layout::kStretch])},
                  {"drift_deg_per_part", Number(best.mean[Layout::kDrift])}};
  Json values = Json::array();
  const pipeline::TubeValues layout(lot.base.bend_count());
  for (std::size_t j = 0; j < layout.size(); ++j) {
    values.push_back({{"name", pipeline::NameOf(layout[j], layout.bends())},
                      {"off", Number(best.mean[std::size_t(Layout::Level(j))])},
                      {"drift_per_part", Number(best.mean[std::size_t(Layout::Drift(j))])}});
  }
  json["values"] = values;
  return json;
}

int ShowLot(const SetterArguments& arguments) {
  const auto cell = config::LoadCell(arguments.config);
  if (!cell) return Report(cell.error());
  const auto parts = CellParts::Open(*cell);
  if (!parts) return Report(parts.error());
  const auto part = parts->Of(arguments.part_number);
  if (!part) return Report(part.error());
  // Written whole or not at all: it may be read beside the daemon.
  const auto lot = ReadLotOf(cell->state_dir, (*part)->config_digest, parts->LotFileOf(**part));
  if (!lot) return Report(lot.error());
  const pipeline::LotState none;
  const Json json = LotSummary(**part, *lot ? **lot : none);
  if (arguments.json) {
    std::cout << Dump(json, 2) << std::endl;
    return 0;
  }
  const std::string of_part = "part " + std::to_string((*part)->part_number) + ": ";
  if (!*lot) {
    std::cout << of_part << "no lot yet: its next tube begins one" << std::endl;
    return 0;
  }
  std::ostringstream text;
  text << of_part << "lot " << (*lot)->number << ", " << (*lot)->parts
       << ((*lot)->parts == 1 ? " part" : " parts")
       << ((*lot)->held ? ", HELD: no program is changed" : "") << "; of all lots "
       << (*lot)->parts_of_all_lots << " parts, " << (*lot)->slips << " slips, " << (*lot)->jumps
       << " jumps\n";
  if (json.contains("temperament")) {
    // What is not finite is null.
    const auto plain = [](const Json& number) {
      return number.is_number() ? Fixed(number.get<double>(), 3) : "-";
    };
    const auto shown = [](const Json& number) {
      return number.is_number() ? Signed(number.get<double>(), 3) : "-";
    };
    const Json& scatter = json["scatter"];
    const Json& coil = json["coil"];
    text << "the bender is " << json["temperament"].get<std::string>()
         << "; scatter from part to part: length " << plain(scatter["length_mm"])
         << " mm, rotation " << plain(scatter["rotation_deg"]) << ", angle "
         << plain(scatter["angle_deg"]) << " degrees\n"
         << "off the part file's springback: " << shown(coil["angle_off_at_70_deg"])
         << " degrees at 70, " << shown(coil["more_at_120_deg"]) << " more at 120, drift "
         << shown(coil["drift_deg_per_part"]) << " a part; stretch "
         << shown(coil["stretch_off_percent"]) << " %\n";
    Table table({{""}, {"off", Align::kDecimal}, {"drift a part", Align::kDecimal}});
    for (const Json& value : json["values"]) {
      table.Add(
          {value["name"].get<std::string>(), shown(value["off"]), shown(value["drift_per_part"])});
    }
    text << table.Render(false);
  }
  std::cout << WrapLines(text.str(), kPlainColumns) << std::flush;
  return 0;
}

struct PlainPart {
  std::string name;
  hal::BendProgram nominal;
  pipeline::Material material;
};

// Of the part file, or of the cell's part.
hal::Result<PlainPart> MaterialAndNominal(const SetterArguments& arguments) {
  if (arguments.config.empty()) {
    const auto part = config::LoadPart(arguments.part);
    if (!part) return hal::Fail(part.error());
    const auto nominal = NominalProgram(*part);
    if (!nominal) return hal::Fail(nominal.error());
    return PlainPart{part->name, *nominal, MaterialOf(*part)};
  }
  auto cell = config::LoadCell(arguments.config);
  if (!cell) return hal::Fail(cell.error());
  const auto parts = CellParts::Open(std::move(*cell));
  if (!parts) return hal::Fail(parts.error());
  const auto part = parts->Of(arguments.part_number);
  if (!part) return hal::Fail(part.error());
  return PlainPart{(*part)->part, (*part)->nominal, (*part)->correction.material};
}

int FirstProgram(SetterArguments arguments) {
  const bool of_cell = arguments.send || arguments.part_number != 0;
  if (of_cell && !arguments.part.empty()) {
    return Report(
        {hal::ErrorKind::kUsage,
         "--send and --part-number go by the cell's parts: leave out --part; try bendloop "
         "first-program --help"});
  }
  if (of_cell && arguments.config.empty()) arguments.config = kInstalledCell;
  if (arguments.part.empty() == arguments.config.empty()) {
    return Report({hal::ErrorKind::kUsage,
                   "expected either --part or --config; try bendloop first-program --help"});
  }
  if (arguments.send) return Ask(SetterWish::kFirstProgram, arguments);
  const auto part = MaterialAndNominal(arguments);
  if (!part) return Report(part.error());
  const auto first = pipeline::InitialProgram(part->nominal, part->material);
  if (!first) return Report(first.error());
  if (arguments.json) {
    std::cout << Dump({{"schema", "bendloop.first-program/1"},
                       {"part", part->name},
                       {"rows", RowsJson(*first)}},
                      2)
              << std::endl;
    return 0;
  }
  Table table({{"row", Align::kRight},
               {"length mm", Align::kDecimal},
               {"rotation deg", Align::kDecimal},
               {"angle deg", Align::kDecimal},
               {"CLR mm", Align::kDecimal}});
  for (std::size_t i = 0; i < first->rows.size(); ++i) {
    const hal::BendRow& row = first->rows[i];
    table.Add({std::to_string(i + 1), Fixed(row.length_mm, 3), Fixed(row.rotation_deg, 3),
               Fixed(row.angle_deg, 3), row.bend_radius_mm ? Fixed(*row.bend_radius_mm, 3) : ""});
  }
  std::cout << table.Render(false) << std::flush;
  return 0;
}

void AddPartNumber(CLI::App* command, const std::shared_ptr<SetterArguments>& arguments) {
  command
      ->add_option("--part-number", arguments->part_number,
                   "A part of the cell's parts_dir, by its number")
      ->check(CLI::PositiveNumber);
}

void AddConfig(CLI::App* command, const std::shared_ptr<SetterArguments>& arguments) {
  arguments->config = kInstalledCell;
  command->add_option("--config", arguments->config, "The cell file")
      ->type_name("CELL.toml")
      ->capture_default_str();
  command->add_flag("--json", arguments->json, "JSON instead of text");
}

void AddPatience(CLI::App* command, const std::shared_ptr<SetterArguments>& arguments) {
  command->add_option("--wait", arguments->patience_s, "Seconds to wait for a running daemon")
      ->check(CLI::Range(0.1, 3600.0))
      ->capture_default_str();
}

// A command that asks the daemon, or its state directory, for `wish` and has no options of its own.
CLI::App* AddWish(CLI::App& under, Run& run, const char* name, const char* what, const char* footer,
                  SetterWish wish) {
  auto arguments = std::make_shared<SetterArguments>();
  CLI::App* command = under.add_subcommand(name, what);
  command->footer(footer);
  AddConfig(command, arguments);
  if (wish != SetterWish::kAcknowledge) AddPartNumber(command, arguments);
  AddPatience(command, arguments);
  command->callback(
      [arguments, wish, &run] { run = [arguments, wish] { return Ask(wish, *arguments); }; });
  return command;
}

}  // namespace

CLI::App* AddLotCommand(CLI::App& app, Run& run) {
  auto arguments = std::make_shared<SetterArguments>();
  CLI::App* lot =
      app.add_subcommand("lot", "What the correction has learnt of a lot; its setter's say");
  lot->footer(kLotFooter);
  lot->require_subcommand(1);
  CLI::App* show = lot->add_subcommand("show", "What is known of the lot");
  show->footer(kLotFooter);
  AddConfig(show, arguments);
  AddPartNumber(show, arguments);
  show->callback([arguments, &run] { run = [arguments] { return ShowLot(*arguments); }; });
  AddWish(*lot, run, "new", "Another coil or tool: a new lot begins", kLotFooter,
          SetterWish::kNewLot);
  AddWish(*lot, run, "hold", "Change no program until 'release'", kLotFooter, SetterWish::kHoldLot);
  AddWish(*lot, run, "release", "Correct programs again", kLotFooter, SetterWish::kReleaseLot);
  return lot;
}

CLI::App* AddUndoCommand(CLI::App& app, Run& run) {
  return AddWish(app, run, "undo", "The bender's program before the last one sent", kUndoFooter,
                 SetterWish::kUndo);
}

CLI::App* AddAcknowledgeCommand(CLI::App& app, Run& run) {
  return AddWish(app, run, "acknowledge", "Send corrections again after an alarm",
                 kAcknowledgeFooter, SetterWish::kAcknowledge);
}

CLI::App* AddFirstProgramCommand(CLI::App& app, Run& run) {
  auto arguments = std::make_shared<SetterArguments>();
  CLI::App* command = app.add_subcommand(
      "first-program", "A part's first program: springback and stretch made up for");
  command->footer(kFirstFooter);
  command->add_option("--part", arguments->part, "The part file")->type_name("PART.toml");
  command->add_option("--config", arguments->config, "The cell file; its part")
      ->type_name("CELL.toml");
  AddPartNumber(command, arguments);
  command->add_flag("--send", arguments->send, "Send it to the cell's bender");
  command->add_flag("--json", arguments->json, "JSON instead of text");
  AddPatience(command, arguments);
  command->callback([arguments, &run] { run = [arguments] { return FirstProgram(*arguments); }; });
  return command;
}

}  // namespace bendloop::host
