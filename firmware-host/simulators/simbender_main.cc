// SPDX-License-Identifier: Apache-2.0
#include <CLI/CLI.hpp>
#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "config/load.h"
#include "config/object_dictionary.h"
#include "drivers/simulated_bender/misbehaviour.h"
#include "drivers/simulated_bender/rule_mutant.h"
#include "drivers/simulated_bender/simulated_bender.h"
#include "firmware-host/result/program_json.h"
#include "firmware-host/simulators/plc_console.h"
#include "firmware-host/simulators/simulator_main.h"

namespace bendloop::host {
namespace {

using drivers::SimulatedBender;

constexpr std::uintmax_t kMaxProgramBytes = 4 << 20;

// Rows as in a result ("tube"), a tray part, or bare: {"rows": [...]}.
hal::Result<hal::BendProgram> ReadProgram(const std::string& file) {
  std::error_code no_size;
  const auto size = std::filesystem::file_size(file, no_size);
  std::ifstream in(file);
  if (no_size || !in || size > kMaxProgramBytes) {
    return hal::Fail(
        hal::ErrorKind::kBadInput,
        file + ": cannot be read; expected a JSON file of at most 4 MiB with \"rows\"");
  }
  const Json json = Json::parse(in, nullptr, false);
  if (json.is_discarded()) {
    return hal::Fail(hal::ErrorKind::kBadInput, file + ": is not JSON");
  }
  std::optional<hal::Error> error;
  const JsonReader reader(json, file, error);
  hal::BendProgram program = ReadRows((reader.Has("tube") ? reader.At("tube") : reader).At("rows"));
  if (error) return hal::Fail(*error);
  for (const hal::BendRow& row : program.rows) {
    if (!std::isfinite(row.length_mm + row.rotation_deg + row.angle_deg)) {
      return hal::Fail(hal::ErrorKind::kBadInput,
                       file + ": a row without length, rotation or angle");
    }
  }
  return program;
}

hal::Result<void> Say(SimulatedBender& bender, const hal::RegisterMap& map,
                      std::string_view words) {
  const auto orders = PlcOrderOf(words, map.orders);
  if (!orders) return hal::Fail(orders.error());
  bender.Say(*orders);
  return {};
}

// "PROGRAM.json PART": another program at the panel, keyed in.
hal::Result<void> Load(SimulatedBender& bender, const std::string& words) {
  const std::size_t blank = words.rfind(' ');
  hal::ProgramBlock block;
  const char* const end = words.data() + words.size();
  if (blank == std::string::npos ||
      std::from_chars(words.data() + blank + 1, end, block.part_number).ptr != end) {
    return hal::Fail(hal::ErrorKind::kUsage,
                     "load \"" + words + "\": expected a program's file and its part number");
  }
  auto program = ReadProgram(words.substr(0, blank));
  if (!program) return hal::Fail(program.error());
  block.program = std::move(*program);
  return bender.Load(block);
}

// The operator's words, one a line; false: end.
bool Obey(SimulatedBender& bender, const hal::RegisterMap& map, const std::string& line) {
  if (line == "quit") return false;
  if (line.empty()) return true;
  const std::size_t blank = std::min(line.find(' '), line.size());
  const std::string verb = line.substr(0, blank);
  const std::string rest = line.substr(std::min(blank + 1, line.size()));
  const auto tell = [](const hal::Result<void>& done) {
    std::cout << (done ? "ok" : "error " + done.error().message) << std::endl;
  };
  if (line == "bend") {
    const auto part = bender.Bend();
    if (part) {
      std::cout << "bent " << part->file.filename().string() << std::endl;
    } else {
      std::cout << "error " << part.error().message << std::endl;
    }
  } else if (verb == "misbehave") {
    tell(bender.Misbehave(rest));
  } else if (verb == "say") {
    tell(Say(bender, map, rest));
  } else if (verb == "load") {
    tell(Load(bender, rest));
  } else if (line == "told") {
    std::cout << "told " << Told(bender.Heard(), map.report) << std::endl;
  } else if (line == "status") {
    const hal::ProgramBlock active = bender.Active();
    std::cout << "active part " << active.part_number << " sequence " << active.sequence << " rows "
              << active.program.rows.size() << " accepted " << bender.commits_accepted()
              << " rejected " << bender.commits_rejected() << std::endl;
  } else {
    std::cout
        << "error \"" << line
        << "\": expected bend, status, say FIELD VALUE, told, load FILE PART, misbehave FAULT "
           "or quit"
        << std::endl;
  }
  return true;
}

struct Options {
  drivers::SimulatedBenderOptions bender;
  drivers::IsotpChannel can;
  drivers::SimulatedNode node;
  std::string eds_file;
  unsigned heartbeat_ms = 100;
  std::string map_file;
  std::string program_file;
  std::vector<std::string> faults;
  std::vector<std::string> broken;
  std::vector<std::string> said;
  unsigned cycle_ms = 200;
};

void Describe(CLI::App& app) {
  app.description(
      "A CNC tube bender that is not there: a Modbus server (TCP, RTU, CAN) or a CANopen node with "
      "a "
      "program, a press and its moods. Prints \"listening PORT\", then obeys one command a line on "
      "standard input:\n"
      "  bend                 run one cycle; prints \"bent part-0001.json\" when the part is on "
      "the "
      "tray\n"
      "  status               print the active program's numbers\n"
      "  say FIELD VALUE      the PLC says something to the cell (below)\n"
      "  told                 print what the cell has told the PLC\n"
      "  load FILE PART       load another part's program at the panel\n"
      "  misbehave FAULT      do something wrong (below)\n"
      "  quit                 or the end of input: switch off");
  app.footer(
      "What the PLC can say (--say \"FIELD VALUE\"), as drivers/README.md has it:\n" +
      std::string(PlcOrderHelp()) + "Faults:\n" + std::string(drivers::MisbehaviourHelp()) +
      "Rules that it can break (\"misbehave break RULE\", --break RULE), with their numbers in "
      "drivers/README.md, \"What the PLC must do\":\n" +
      drivers::RuleMutantHelp() +
      "\nExample:\n"
      "  bendloop-simbender --map config/register-maps/default.toml \\\n"
      "    --program nominal.json --pipe-radius 10 --springback-20 0.8 \\\n"
      "    --springback-120 3.1 --tray /tmp/tray");
}

void AddCarrierOptions(CLI::App& app, Options& options) {
  app.add_option("--port", options.bender.port, "TCP port on 127.0.0.1; 0 picks a free one")
      ->capture_default_str();
  app.add_flag("--rtu", options.bender.rtu,
               "Modbus RTU on a pseudo-terminal; prints \"listening /dev/pts/N\", which a cell "
               "file names as its bender's device");
  app.add_option("--can", options.can.interface,
                 "Modbus in ISO-TP messages on this CAN interface; prints "
                 "\"listening can0\"");
  app.add_option("--can-request-id", options.can.request_id,
                 "CAN identifier of requests; above 0x7ff extended")
      ->capture_default_str()
      ->check(CLI::Range(0, 0x1fffffff));
  app.add_option("--can-reply-id", options.can.reply_id, "of replies")
      ->capture_default_str()
      ->check(CLI::Range(0, 0x1fffffff));
  auto* node_interface =
      app.add_option("--canopen", options.node.interface,
                     "a CANopen node on this CAN interface; prints \"listening can0\"");
  app.add_option("--node", options.node.node_id, "with --canopen: its id")
      ->default_str("1")
      ->check(CLI::Range(1, 127));
  node_interface->needs(
      app.add_option("--object-dictionary", options.eds_file, "with --canopen: EDS file"));
  app.add_option("--heartbeat-ms", options.heartbeat_ms,
                 "with --canopen: between heartbeats; 0: none")
      ->capture_default_str()
      ->check(CLI::Range(0u, 60000u));
  app.add_flag("!--no-block", options.node.sdo.block, "with --canopen: decline SDO block transfer");
  app.add_option("--unit", options.bender.unit_id, "with --rtu: its unit id")
      ->capture_default_str()
      ->check(CLI::Range(1, 247));
}

void AddBenderOptions(CLI::App& app, Options& options) {
  app.add_option("--map", options.map_file, "register map (TOML)")->required();
  app.add_option("--program", options.program_file,
                 "program that is active at start: JSON with \"rows\" or \"tube\", as in a result")
      ->required();
  app.add_option("--part-number", options.bender.program.part_number, "of that program")
      ->default_val(1u);
  app.add_option("--sequence", options.bender.program.sequence,
                 "of that program; 0: keyed in by hand")
      ->capture_default_str();
  app.add_option("--pipe-radius", options.bender.pipe_radius_mm, "of the tube [mm]")
      ->required()
      ->check(CLI::Range(0.1, 1000.0).description("0.1 to 1000"));
  auto& physics = options.bender.physics;
  app.add_option("--springback-20", physics.springback_20_deg, "of a bend of 20 degrees [deg]");
  app.add_option("--springback-120", physics.springback_120_deg, "of a bend of 120 degrees [deg]");
  app.add_option("--elongation", physics.elongation_percent, "of the arcs [%]");
  app.add_option("--twist", physics.twist_deg, "added to every rotation [deg]");
  app.add_option("--spring-out", physics.radius_spring_out, "growth of bend radii [1 = 100 %]");
  app.add_option("--scatter-angle", physics.sigma_angle_deg, "1 sigma, part to part [deg]");
  app.add_option("--scatter-rotation", physics.sigma_rotation_deg, "1 sigma [deg]");
  app.add_option("--scatter-length", physics.sigma_length_mm, "1 sigma [mm]");
  app.add_option("--bend-radius", physics.default_bend_radius_mm,
                 "of the tool, where the program says none [mm]; default: the first one it says");
  app.add_option("--seed", physics.seed, "of the scatter")->capture_default_str();
  app.add_option("--tray", options.bender.tray, "folder for bent parts");
  app.add_option("--cycle-ms", options.cycle_ms, "time that one part takes")
      ->default_val(200u)
      ->check(CLI::Range(0u, 600000u));
  app.add_option("--misbehave", options.faults,
                 "a fault from the start, e.g. --misbehave \"late 500\"");
  app.add_option("--say", options.said,
                 "what the PLC says from the start, e.g. --say \"part_number 1002\"");
  app.add_option("--break", options.broken,
                 "a rule that it breaks from the start, e.g. --break takes-wrong-crc");
}

// The CANopen node, its map bound to its dictionary.
hal::Result<drivers::SimulatedNode> NodeOf(const Options& options, hal::RegisterMap& map) {
  const auto dictionary = config::LoadObjectDictionary(options.eds_file);
  if (!dictionary) return hal::Fail(dictionary.error());
  if (auto bound = config::BindObjects(map, *dictionary); !bound) return hal::Fail(bound.error());
  drivers::SimulatedNode node = options.node;
  node.heartbeat = std::chrono::milliseconds(options.heartbeat_ms);
  node.vendor_id = dictionary->vendor_number;
  node.product_code = dictionary->product_number;
  return node;
}

hal::Result<std::unique_ptr<SimulatedBender>> Start(Options& options) {
  drivers::SimulatedBenderOptions& bender = options.bender;
  bender.cycle = std::chrono::milliseconds(options.cycle_ms);
  if (!options.can.interface.empty()) bender.can = options.can;
  auto map = config::LoadRegisterMap(options.map_file);
  if (!map) return hal::Fail(map.error());
  const bool is_node = !options.node.interface.empty();
  if (map->of_objects() != is_node) {
    return hal::Fail(hal::ErrorKind::kUsage, options.map_file +
                                                 ": a map of CANopen objects goes with "
                                                 "--canopen and --object-dictionary, one of "
                                                 "registers with all others");
  }
  if (is_node) {
    auto node = NodeOf(options, *map);
    if (!node) return hal::Fail(node.error());
    bender.canopen = std::move(*node);
  }
  bender.map = std::move(*map);
  auto program = ReadProgram(options.program_file);
  if (!program) return hal::Fail(program.error());
  bender.program.program = std::move(*program);
  return SimulatedBender::Start(bender);
}

hal::Result<void> Run(CLI::App& app, int argc, char** argv) {
  Options options;
  options.bender.program.sequence = 1;
  Describe(app);
  AddCarrierOptions(app, options);
  AddBenderOptions(app, options);
  app.parse(argc, argv);
  auto bender = Start(options);
  if (!bender) return hal::Fail(bender.error());
  for (const std::string& rule : options.broken) options.faults.push_back("break " + rule);
  const hal::RegisterMap& map = options.bender.map;
  for (const std::string& words : options.said) {
    if (auto done = Say(**bender, map, words); !done) return hal::Fail(done.error());
  }
  for (const std::string& fault : options.faults) {
    if (auto done = (*bender)->Misbehave(fault); !done) return hal::Fail(done.error());
  }
  if ((*bender)->device().empty()) {
    std::cout << "listening " << (*bender)->port() << std::endl;
  } else {
    std::cout << "listening " << (*bender)->device() << std::endl;
  }
  std::string line;
  while (std::getline(std::cin, line) && Obey(**bender, map, line)) {
  }
  return {};
}

}  // namespace
}  // namespace bendloop::host

int main(int argc, char** argv) {
  return bendloop::host::SimulatorMain("bendloop-simbender", bendloop::host::Run, argc, argv);
}
