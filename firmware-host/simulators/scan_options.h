// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

#include "drivers/simulated_scanner/simulate_session.h"

namespace bendloop::host {

// A number of the command line within `limits`; CLI11 says the option's name before the words.
inline CLI::Validator Within(drivers::Limits limits) {
  return {[limits](std::string& text) {
            double value = 0;
            if (CLI::detail::lexical_cast(text, value) && limits.Hold(value)) return std::string();
            return "found " + text + ", expected " + limits.Text();
          },
          limits.Text()};
}

// What may be in view beside the tube.
inline constexpr const char* kClutterTable = "table";
inline constexpr const char* kClutterClamps = "clamps";
inline constexpr const char* kClutterSecondTube = "second-tube";

inline void AddClutterOption(CLI::App& app, std::vector<std::string>& clutter) {
  app.add_option("--clutter", clutter, "In view as well: table, clamps, second-tube (with commas)")
      ->delimiter(',')
      ->check(CLI::IsMember({kClutterTable, kClutterClamps, kClutterSecondTube}).description(""))
      ->type_name("WHAT");
}

// What every program that scans virtually may be told about sensor and hand.
inline void AddScanOptions(CLI::App& app, drivers::VirtualScanOptions& scan) {
  const auto add = [&app](const char* name, auto& value, const char* help, drivers::Limits limits) {
    app.add_option(name, value, help)->check(Within(limits))->capture_default_str();
  };
  add("--noise", scan.noise_mm, "1 sigma along the ray [mm]", drivers::kNoiseMm);
  add("--noise-growth", scan.noise_growth, "At grazing incidence: noise / cos(incidence)^this",
      drivers::kNoiseGrowth);
  add("--outliers", scan.outlier_fraction, "Share of the points that are fliers",
      drivers::kFraction);
  add("--dropouts", scan.dropout_fraction, "Share of the points that are missing",
      drivers::kFraction);
  add("--pose-noise", scan.pose_noise_mm, "1 sigma of the sensor's position [mm]",
      drivers::kNoiseMm);
  add("--jitter", scan.path.jitter_mm, "Of an unsteady hand, 1 sigma [mm]", drivers::kNoiseMm);
  add("--spacing", scan.path.profile_spacing_mm, "Between profiles [mm]", drivers::kSpacingMm);
  add("--rays", scan.rays, "Points of one laser line at most", drivers::kRays);
  add("--cut-wall", scan.wall_mm,
      "Thickness of the wall, seen where the tube is cut [mm]; 0: nothing returns from there",
      drivers::kWallMm);
  add("--table-gap", scan.clutter.table_gap_mm,
      "The tube lies on posts, so far above the table [mm]", drivers::kTableGapMm);
}

}  // namespace bendloop::host
