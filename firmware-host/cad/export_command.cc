// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cad/export_command.h"

#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <ostream>
#include <string>

#include "config/load.h"
#include "firmware-host/cad/dxf.h"
#include "firmware-host/cad/step_file.h"
#include "firmware-host/cad/tube_chain.h"
#include "firmware-host/console/command_line.h"
#include "firmware-host/console/message.h"
#include "firmware-host/console/output_file.h"
#include "firmware-host/console/whole_file.h"
#include "firmware-host/convert/tube_table.h"

namespace bendloop::host {
namespace {

struct ExportArguments {
  std::string file;
  std::string step, dxf, csv;
  std::string name;
  std::optional<double> pipe_diameter_mm, wall_mm, bend_radius_mm;
};

struct Exported {
  hal::Tube tube;
  std::optional<double> wall_mm;
  std::string name = "tube";
};

hal::Result<hal::Tube> NominalOf(const config::PartConfig& part) {
  hal::Tube tube;
  tube.program = part.rows;
  if (!part.xyz_mm.empty()) {
    pipeline::ControlPolygon polygon;
    polygon.points_mm = part.xyz_mm;
    polygon.bend_radii_mm.assign(part.xyz_mm.size() - 2, part.bend_radius_mm);
    auto made = pipeline::TubeFromPolygon(polygon);
    if (!made) return made;
    tube = std::move(*made);
  }
  tube.pipe_radius_mm = part.pipe_radius_mm;
  return tube;
}

// A part file's nominal, or whatever `bendloop convert` reads: a result's measured tube.
hal::Result<Exported> LoadTube(const ExportArguments& arguments, std::ostream& err) {
  Exported exported;
  if (std::filesystem::path(arguments.file).extension() == ".toml") {
    const auto part = config::LoadPart(arguments.file);
    if (!part) return hal::Fail(part.error());
    auto tube = NominalOf(*part);
    if (!tube) return hal::Fail(tube.error().kind, arguments.file + ": " + tube.error().message);
    exported = {std::move(*tube), part->wall_mm, part->name};
  } else {
    const auto text = ReadWholeFile(arguments.file, kMaxTableBytes);
    if (!text) return hal::Fail(text.error());
    TableReadOptions options;
    options.bend_radius_mm = arguments.bend_radius_mm;
    auto table = ReadTubeTable(*text, arguments.file, options);
    if (!table) return hal::Fail(table.error());
    for (const std::string& note : table->notes) err << "bendloop: note: " << note << "\n";
    exported.tube = std::move(table->tube);
    exported.name = std::filesystem::path(arguments.file).stem().string();
  }
  if (arguments.pipe_diameter_mm) exported.tube.pipe_radius_mm = *arguments.pipe_diameter_mm / 2;
  if (arguments.wall_mm) exported.wall_mm = arguments.wall_mm;
  if (!arguments.name.empty()) exported.name = arguments.name;
  for (std::size_t i = 0; i + 1 < exported.tube.program.rows.size(); ++i) {
    if (exported.tube.program.rows[i].bend_radius_mm.value_or(0) > 0) continue;
    return hal::Fail(hal::ErrorKind::kUsage, arguments.file + ": bend " + std::to_string(i + 1) +
                                                 " has no bend radius; give --bend-radius MM");
  }
  return exported;
}

nlohmann::json Numbers(const Eigen::Vector3d& p) { return {p.x(), p.y(), p.z()}; }

// bendloop-cad's `bendloop.cad-tube/1`.
std::string TubeJson(const Exported& exported, const Spine& spine) {
  nlohmann::json segments = nlohmann::json::array();
  Eigen::Vector3d at = spine.start;
  const auto line = [&](const Eigen::Vector3d& to) {
    if ((to - at).norm() > 1e-6) {
      segments.push_back({{"from", Numbers(at)}, {"to", Numbers(to)}});
    }
  };
  for (const SpineArc& arc : spine.arcs) {
    line(arc.from);
    segments.push_back({{"from", Numbers(arc.from)},
                        {"to", Numbers(arc.to)},
                        {"centre", Numbers(arc.centre)},
                        {"axis", Numbers(arc.normal)},
                        {"angle_deg", arc.angle_rad * 180 / M_PI}});
    at = arc.to;
  }
  line(spine.end);
  nlohmann::json tube = {{"schema", "bendloop.cad-tube/1"},
                         {"name", exported.name},
                         {"pipe_radius_mm", exported.tube.pipe_radius_mm},
                         {"segments", std::move(segments)}};
  if (exported.wall_mm) tube["wall_mm"] = *exported.wall_mm;
  return tube.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

hal::Result<void> Export(const ExportArguments& arguments, std::ostream& err) {
  if (arguments.step.empty() && arguments.dxf.empty() && arguments.csv.empty()) {
    return hal::Fail(hal::ErrorKind::kUsage,
                     "expected --step, --dxf or --csv; try bendloop export --help");
  }
  const auto exported = LoadTube(arguments, err);
  if (!exported) return hal::Fail(exported.error());
  const Spine spine = SpineOf(exported->tube);
  if (!arguments.step.empty()) {
    if (auto written = WriteStepFile(TubeJson(*exported, spine), arguments.step); !written)
      return written;
  }
  if (!arguments.dxf.empty()) {
    auto written = WriteOutputFile(arguments.dxf, DxfText(spine, exported->tube));
    if (!written) return written;
  }
  if (!arguments.csv.empty()) {
    TableWriteOptions options;
    options.to = TableKind::kXyz;
    options.format = TableFormat::kCsv;
    const auto text = WriteTubeTable(exported->tube, options);
    if (!text) return hal::Fail(text.error());
    if (auto written = WriteOutputFile(arguments.csv, *text); !written) return written;
  }
  return {};
}

constexpr const char* kExportFooter = R"(
Examples:
  bendloop export result.json --step tube.step         the measured tube
  bendloop export part.toml --step tube.step --dxf tube.dxf --csv corners.csv
  bendloop export lra.txt --pipe-diameter 10 --wall 1 --step tube.step

FILE is a result, a part file or any table that bendloop convert reads. STEP
(AP214, mm) has the centre line of lines and arcs, and the outer surface, or the
whole solid where the wall is known; a result's tube lies where it was scanned.
DXF has centre line and corners; CSV the corners, both ends included. STEP needs
OpenCASCADE (bendloop-cad): exit code 4 where it is not installed.)";

}  // namespace

CLI::App* AddExportCommand(CLI::App& app, std::function<int()>& run, std::ostream& err) {
  auto a = std::make_shared<ExportArguments>();
  CLI::App* command = app.add_subcommand("export", "A tube to CAD: STEP, DXF, CSV of its corners");
  command->add_option("FILE", a->file, "Result, part file or table")->required();
  command->add_option("--step", a->step, "STEP file to write")->type_name("FILE");
  command->add_option("--dxf", a->dxf, "DXF file to write")->type_name("FILE");
  command->add_option("--csv", a->csv, "CSV file of the corners to write")->type_name("FILE");
  command->add_option("--name", a->name, "Of the body in STEP");
  command->add_option("--pipe-diameter", a->pipe_diameter_mm, "Outer, in mm, where FILE has none")
      ->check(NumberWithin(1, 1000));
  command->add_option("--wall", a->wall_mm, "In mm, where FILE has none")
      ->check(NumberWithin(0.05, 100));
  command->add_option("--bend-radius", a->bend_radius_mm, "CLR in mm where a table has none")
      ->check(NumberWithin(1, 10000));
  command->footer(kExportFooter);
  command->callback([a, &run, &err] {
    run = [a, &err] {
      const auto done = Export(*a, err);
      if (done) return 0;
      err << MessageText("bendloop", done.error().message, 0);
      return hal::ExitCode(done.error().kind);
    };
  });
  return command;
}

}  // namespace bendloop::host
