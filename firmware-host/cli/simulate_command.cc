// SPDX-License-Identifier: Apache-2.0
#include <array>
#include <filesystem>
#include <iostream>
#include <memory>
#include <optional>
#include <string>
#include <tuple>
#include <vector>

#include "config/load.h"
#include "drivers/session/session_database.h"
#include "drivers/simulated_bender/bending_physics.h"
#include "drivers/simulated_scanner/simulate_session.h"
#include "firmware-host/cell/part_plan.h"
#include "firmware-host/cli/command.h"
#include "firmware-host/console/output_file.h"
#include "firmware-host/console/version.h"
#include "firmware-host/result/program_json.h"
#include "firmware-host/simulators/scan_options.h"
#include "pipeline/correction/material.h"

namespace bendloop::host {
namespace {

struct SimulateArguments {
  std::string part;
  std::string out;
  drivers::VirtualScanOptions scan;
  int views = 3;
  bool all_around = false;
  std::vector<std::string> clutter;
  std::optional<double> springback_20_deg;
  std::optional<double> springback_120_deg;
  std::optional<double> elongation_percent;
  double scatter_angle_deg = 0;
  double scatter_rotation_deg = 0;
  double scatter_length_mm = 0;
  std::uint32_t serial = 1;
  std::vector<std::array<double, 4>> dents;
  // Of an end, "first" or "last".
  std::vector<std::tuple<std::string, double, double>> bevels, burrs;
  std::vector<std::tuple<std::string, double, int, double>> waves;
  bool force = false;
};

constexpr const char* kSimulateFooter = R"(
Examples:
  bendloop simulate --part part.toml --out part.session
  bendloop simulate --part part.toml --out noisy.session --seed 7 --noise 0.1
  bendloop simulate --part part.toml --out shiny.session --noise-growth 2
  bendloop simulate --part part.toml --out bad.session --springback-120 6 \
    --clutter table,clamps
  bendloop simulate --part part.toml --out dented.session --dent 120,90,0.5,4
  bendloop simulate --part part.toml --out coped.session --wave last,1.5,2,30 \
    --bevel first,1,0.5

The tube is bent from the part's first program: the nominal with its [material]
made up for. So it comes out at the nominal unless springback, elongation or
scatter say otherwise. Its ends, holes and slots are the part's. The true rows stand in the session's meta, "true_rows".)";

// The file behind a link. What stands there is replaced only if it is a session, or empty.
hal::Result<std::filesystem::path> SessionToWrite(const std::string& out, bool force) {
  auto file = FollowLinks(out);
  if (!file) return file;
  std::error_code none;
  const bool in_the_way = std::filesystem::is_regular_file(*file, none) &&
                          std::filesystem::file_size(*file, none) > 0 &&
                          !drivers::LooksLikeSession(file->string());
  if (in_the_way && !force) {
    return hal::Fail(hal::ErrorKind::kUsage,
                     "--out: '" + out +
                         "' is no session and is not written over; name another file, or --force");
  }
  return file;
}

void SetEdges(const SimulateArguments& arguments, hal::TubeFeatures& features) {
  const auto edge_of = [&](const std::string& end) -> hal::EndEdge& {
    return end == "first" ? features.first_edge : features.last_edge;
  };
  for (const auto& [end, length_mm, depth_mm] : arguments.bevels) {
    edge_of(end).bevel_mm = length_mm;
    edge_of(end).bevel_depth_mm = depth_mm;
  }
  for (const auto& [end, height_mm, length_mm] : arguments.burrs) {
    edge_of(end).burr_mm = height_mm;
    edge_of(end).burr_length_mm = length_mm;
  }
  for (const auto& [end, height_mm, waves, around_deg] : arguments.waves) {
    edge_of(end).wave_mm = height_mm;
    edge_of(end).waves = waves;
    edge_of(end).wave_around_deg = around_deg;
  }
}

void AddEdgeOptions(CLI::App& command, SimulateArguments& a) {
  const CLI::Validator is_end(
      [](std::string& text) {
        const std::string end = text.substr(0, text.find(','));
        return end == "first" || end == "last" ? "" : "'" + end + "' is neither first nor last";
      },
      "");
  command
      .add_option("--bevel", a.bevels,
                  "Of an end: along the tube, and how far the wall comes in [mm]")
      ->delimiter(',')
      ->type_name("END,LENGTH,DEPTH");
  command
      .add_option("--burr", a.burrs,
                  "Of an end, all round: how far it stands out, and its length [mm]")
      ->delimiter(',')
      ->type_name("END,HEIGHT,LENGTH");
  command
      .add_option("--wave", a.waves,
                  "Of an end that no plane is: how far its border goes beyond the plane [mm], how "
                  "often in a turn, and where [degrees]")
      ->delimiter(',')
      ->type_name("END,HEIGHT,WAVES,AROUND");
  for (const char* name : {"--bevel", "--burr", "--wave"}) {
    command.get_option(name)->check(is_end.application_index(0));
  }
}

int Simulate(SimulateArguments& arguments) {
  const auto part = config::LoadPart(arguments.part);
  if (!part) return Report(part.error());
  const auto nominal = NominalProgram(*part);
  if (!nominal) return Report(nominal.error());
  const pipeline::Material material = MaterialOf(*part);
  const auto commanded = pipeline::InitialProgram(*nominal, material);
  if (!commanded) return Report(commanded.error());

  drivers::BendingPhysics physics;
  physics.springback_20_deg = arguments.springback_20_deg.value_or(material.springback_at_20_deg);
  physics.springback_120_deg =
      arguments.springback_120_deg.value_or(material.springback_at_120_deg);
  physics.elongation_percent = arguments.elongation_percent.value_or(material.elongation_percent);
  physics.sigma_angle_deg = arguments.scatter_angle_deg;
  physics.sigma_rotation_deg = arguments.scatter_rotation_deg;
  physics.sigma_length_mm = arguments.scatter_length_mm;
  physics.seed = arguments.scan.seed;
  if (auto checked = drivers::CheckBendingPhysics(physics); !checked) {
    return Report({hal::ErrorKind::kUsage, checked.error().message});
  }
  hal::Tube tube;
  tube.pipe_radius_mm = part->pipe_radius_mm;
  tube.program = drivers::BendTube(*commanded, physics, arguments.serial);

  drivers::SimulateSessionOptions options;
  options.scan = arguments.scan;
  options.scan.path.views_deg = drivers::SpreadViewsDeg(arguments.views, arguments.all_around);
  for (const std::string& what : arguments.clutter) {
    if (what == kClutterTable) options.scan.clutter.table = true;
    if (what == kClutterClamps) options.scan.clutter.clamps = 2;
    if (what == kClutterSecondTube) options.scan.clutter.second_tube = true;
  }
  options.scan.features = CutsOf(*part, hal::SpineLength(tube.program));
  for (const auto& [along_mm, around_deg, depth_mm, width_mm] : arguments.dents) {
    options.scan.features.dents.push_back({along_mm, around_deg, depth_mm, width_mm});
  }
  SetEdges(arguments, options.scan.features);
  options.part = part->name;
  options.software = kSoftware;
  options.more_meta["true_rows"] = Dump(RowsJson(tube.program));
  const auto out = SessionToWrite(arguments.out, arguments.force);
  if (!out) return Report(out.error());
  const auto session = drivers::SimulateSession(tube, options, out->string());
  if (!session) return Report(session.error());
  std::cout << arguments.out << ": " << session->profiles << " profiles, " << session->points
            << " points, " << tube.program.bend_count() << " bends\n";
  return 0;
}

}  // namespace

CLI::App* AddSimulateCommand(CLI::App& app, Run& run) {
  auto a = std::make_shared<SimulateArguments>();
  CLI::App* command =
      app.add_subcommand("simulate", "A recorded session of a virtual scan of a virtual tube");
  command->footer(kSimulateFooter);
  command->add_option("--part", a->part, "Part file")->required()->type_name("PART.toml");
  command->add_option("--out", a->out, "Session to write, over a session that is there")
      ->required()
      ->type_name("SESSION");
  command->add_flag("--force", a->force, "Write over a file of any kind");
  command->add_option("--seed", a->scan.seed, "Of everything random")->capture_default_str();
  AddScanOptions(*command, a->scan);
  command->add_option("--views", a->views, "Passes along the tube, from different sides")
      ->check(CLI::Range(1, 36))
      ->capture_default_str();
  command->add_flag("--all-around", a->all_around, "Views on all sides, not from above only");
  command->add_flag("--reverse", a->scan.path.reverse, "Scan from the tube's end");
  AddClutterOption(*command, a->clutter);
  command->add_option(
      "--springback-20", a->springback_20_deg,
      "True springback of a bend of 20 degrees [deg]; default: the part's material");
  command->add_option("--springback-120", a->springback_120_deg, "The same of 120 degrees [deg]");
  command->add_option("--elongation", a->elongation_percent, "True elongation [%]");
  command->add_option("--scatter-angle", a->scatter_angle_deg, "Of the bender, 1 sigma [deg]")
      ->capture_default_str();
  command->add_option("--scatter-rotation", a->scatter_rotation_deg, "1 sigma [deg]")
      ->capture_default_str();
  command->add_option("--scatter-length", a->scatter_length_mm, "1 sigma [mm]")
      ->capture_default_str();
  command->add_option("--serial", a->serial, "Which part of the scatter's sequence")
      ->check(CLI::Range(1, 1'000'000'000).description("1 or more"))
      ->capture_default_str();
  command
      ->add_option("--dent", a->dents,
                   "Pressed in: mm along the tube, degrees around, depth and width (1 sigma) [mm]; "
                   "may be given again")
      ->delimiter(',')
      ->type_name("ALONG,AROUND,DEPTH,WIDTH");
  AddEdgeOptions(*command, *a);
  command->callback([a, &run] { run = [a] { return Simulate(*a); }; });
  return command;
}

}  // namespace bendloop::host
