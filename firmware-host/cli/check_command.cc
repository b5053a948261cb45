// SPDX-License-Identifier: Apache-2.0
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <memory>
#include <string>
#include <vector>

#include "config/load.h"
#include "drivers/session/session_check.h"
#include "drivers/session/session_database.h"
#include "drivers/session/session_source.h"
#include "firmware-host/cell/part_plan.h"
#include "firmware-host/cell/run_context.h"
#include "firmware-host/cell/scan_state.h"
#include "firmware-host/cell/service_needs.h"
#include "firmware-host/cell/service_unit.h"
#include "firmware-host/cell/tube_rules.h"
#include "firmware-host/cli/command.h"
#include "firmware-host/cli/foreign_file.h"
#include "firmware-host/console/printable.h"
#include "firmware-host/text/table.h"
#include "hal/clock.h"
#include "pipeline/points/input_checks.h"

namespace bendloop::host {
namespace {

constexpr const char* kCheckFooter = R"(
Examples:
  bendloop check /etc/bendloop/cell.toml
  bendloop check cells/*.toml parts/*.toml sessions/*.session
  bendloop check --unit-drop-in /etc/bendloop/cell.toml
                              prints what lets the service reach this cell's
                              devices and addresses, and no others

Cell files are checked with the part and the register map that they name,
sessions to their last profile and against their checksums, and whether a
replay by a cell with the usual [scan] takes them. All files are checked; each problem is told with file, line, key and the mend. Exit code 3
when there is any.)";

// Why a replay would refuse the scan in a sound session, by the profiles and events as it takes
// them; empty: it would not.
std::string WhyNotReplayed(const std::string& file) {
  const config::ScanConfig usual;  // which cell will replay it, nobody knows
  ScanState scan(
      {.is_live = false, .max_seconds = usual.max_seconds, .min_profiles = usual.min_profiles});
  hal::SteadyClock clock;
  drivers::SessionSource source(file, drivers::ReplayPace::kMax, clock);
  const auto info = source.Open();
  if (!info) return info.error().message;
  (void)source.Start();
  hal::LaserProfile profile(info->max_points);
  hal::ScanEvent event;
  for (ScanStep step = ScanStep::kNothing; step != ScanStep::kEnded;) {
    const auto status = source.Read(profile, event, std::chrono::nanoseconds(0));
    if (!status) return status.error().message;
    if (*status == hal::ReadStatus::kProfile) step = scan.Take(profile);
    if (*status == hal::ReadStatus::kEvent) step = scan.Take(event);
    if (*status == hal::ReadStatus::kEnd) step = scan.TakeEnd();
    if (step == ScanStep::kBroke) return scan.reason();
    if (*status == hal::ReadStatus::kEnd && step == ScanStep::kNothing) {
      return "it holds no scan: no profile lies between scan_start and scan_end";
    }
  }
  if (scan.points() >= pipeline::kMinPoints) return {};
  return "the scan has " + std::to_string(scan.points()) + " points, expected at least " +
         std::to_string(pipeline::kMinPoints) + ": scan the whole tube";
}

hal::Result<std::string> CheckSessionFile(const std::string& file) {
  const auto summary = drivers::CheckSession(file);
  if (!summary) return hal::Fail(summary.error());
  for (const std::string& warning : summary->warnings) {
    Note(warning);
  }
  std::vector<std::string> problems = summary->problems;
  if (const auto context = summary->meta.find(kContextKey); context != summary->meta.end()) {
    const auto read = ReadRunContext(context->second, file + ": meta 'context'");
    if (!read) problems.push_back(read.error().message);
  }
  if (const auto times = CheckRecordedTimes(summary->meta, file); !times) {
    problems.push_back(times.error().message);
  }
  if (problems.empty()) {
    const std::string why = WhyNotReplayed(file);
    if (!why.empty()) problems.push_back(file + ": no replay takes it: " + why);
  }
  if (!problems.empty()) {
    std::string message;
    for (const std::string& problem : problems) {
      message += (message.empty() ? "" : "\n") + problem;
    }
    if (summary->problems_left_out > 0) {
      message += "\n" + file + ": and " + std::to_string(summary->problems_left_out) + " more";
    }
    return hal::Fail(hal::ErrorKind::kBadInput, message);
  }
  return "session, " + std::to_string(summary->profiles) + " profiles, " +
         std::to_string(summary->points) + " points";
}

// A register's step beside what the part may deviate: rounding alone must not make scrap. Empty:
// fine.
std::string TooCoarse(const config::CellConfig& cell) {
  if (cell.bender.link == config::BenderKind::kNone) return "";
  const hal::RegisterMap& map = cell.bender.register_map;
  struct Step {
    const char* name;
    const hal::RegisterField& field;
    double tolerance;
  };
  for (const Step& step : {Step{"length", map.row_length_mm, cell.part.tolerance.length_mm},
                           Step{"rotation", map.row_rotation_deg, cell.part.tolerance.rotation_deg},
                           Step{"angle", map.row_angle_deg, cell.part.tolerance.angle_deg}}) {
    if (step.field.type == hal::RegisterType::kFloat32) continue;
    if (std::abs(step.field.scale) <= step.tolerance) continue;
    return "the register map's " + std::string(step.name) + " has a scale of " +
           Fixed(step.field.scale, 3) + ", coarser than the part's tolerance of " +
           Fixed(step.tolerance, 3) + "; use registers with a smaller scale";
  }
  return "";
}

// What the file is, when it is right.
hal::Result<std::string> CheckFile(const std::string& file) {
  if (drivers::LooksLikeDatabase(file)) return CheckSessionFile(file);
  if (const std::string why = WhyForeign(file); !why.empty()) {
    return hal::Fail(hal::ErrorKind::kBadInput, why);
  }
  const auto kind = config::ValidateFile(file);
  if (!kind) return hal::Fail(kind.error());
  // Beyond keys and types: can this be bent?
  if (*kind == config::FileKind::kCell) {
    const auto cell = config::LoadCell(file);
    if (!cell) return hal::Fail(cell.error());
    if (const auto plan = MakePartPlan(*cell); !plan) return hal::Fail(plan.error());
    if (const std::string why = TooCoarse(*cell); !why.empty()) {
      return hal::Fail(hal::ErrorKind::kBadInput, file + ": " + why);
    }
    for (const std::string& remark : RemarksOn(*cell, TimesOfUnit())) {
      Note(file + ": " + remark);
    }
  }
  if (*kind == config::FileKind::kPart) {
    const auto part = config::LoadPart(file);
    if (!part) return hal::Fail(part.error());
    if (const auto nominal = NominalProgram(*part); !nominal) return hal::Fail(nominal.error());
    if (auto material = pipeline::Check(MaterialOf(*part)); !material) {
      return hal::Fail(material.error().kind, file + ": " + material.error().message);
    }
  }
  return std::string(config::Name(*kind));
}

int PrintDropIn(const std::string& file) {
  if (drivers::LooksLikeDatabase(file)) {
    return Report({hal::ErrorKind::kUsage, file + ": is a session, expected a cell file"});
  }
  if (const std::string why = WhyForeign(file); !why.empty()) {
    return Report({hal::ErrorKind::kBadInput, why});
  }
  const auto cell = config::LoadCell(file);
  if (!cell) return Report(cell.error());
  std::error_code error;
  std::cout << UnitDropIn(NeedsOf(*cell), std::filesystem::absolute(file, error).string());
  return 0;
}

int Check(const std::vector<std::string>& files) {
  int code = 0;
  for (const std::string& file : files) {
    const auto kind = CheckFile(file);
    if (kind) {
      std::cout << Printable(file) << ": ok (" << *kind << ")\n" << std::flush;
    } else {
      code = std::max(code, Report(kind.error()));
    }
  }
  return code;
}

}  // namespace

CLI::App* AddCheckCommand(CLI::App& app, Run& run) {
  auto files = std::make_shared<std::vector<std::string>>();
  CLI::App* command =
      app.add_subcommand("check", "Validate cell, part, register-map and session files");
  command->footer(kCheckFooter);
  command->add_option("files", *files, "Any of them")->required()->type_name("FILE...");
  auto drop_in = std::make_shared<bool>(false);
  command->add_flag(
      "--unit-drop-in", *drop_in,
      "Print a drop-in for bendloopd.service with what the cell needs, and only that");
  command->callback([files, drop_in, &run] {
    run = [files, drop_in] {
      if (!*drop_in) return Check(*files);
      if (files->size() == 1) return PrintDropIn(files->front());
      return Report({hal::ErrorKind::kUsage, "--unit-drop-in takes one cell file"});
    };
  });
  return command;
}

}  // namespace bendloop::host
