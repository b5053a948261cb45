// SPDX-License-Identifier: Apache-2.0
#include "drivers/simulated_scanner/simulate_session.h"

#include <cmath>
#include <cstdio>
#include <string>

#include "drivers/session/session_writer.h"
#include "hal/clock.h"

namespace bendloop::drivers {
namespace {

using hal::ErrorKind;
using hal::Fail;
using hal::Result;

std::string Text(double value) {
  char text[32];
  std::snprintf(text, sizeof(text), "%.10g", value);
  return text;
}

Result<void> InRange(const char* name, double value, Limits limits) {
  if (limits.Hold(value)) return {};
  return Fail(ErrorKind::kUsage, std::string("virtual scan: ") + name + " is " + Text(value) +
                                     ", expected " + limits.Text());
}

}  // namespace

std::string Limits::Text() const { return drivers::Text(low) + " to " + drivers::Text(high); }

Result<void> CheckScan(const hal::Tube& tube, const VirtualScanOptions& options) {
  if (!(tube.pipe_radius_mm > 0) || !std::isfinite(tube.pipe_radius_mm)) {
    return Fail(ErrorKind::kBadInput, "virtual scan: the pipe radius is " +
                                          Text(tube.pipe_radius_mm) + " mm, expected more than 0");
  }
  if (tube.program.rows.empty()) {
    return Fail(ErrorKind::kBadInput, "virtual scan: the tube has no rows, expected at least one");
  }
  for (std::size_t i = 0; i < tube.program.rows.size(); ++i) {
    const hal::BendRow& row = tube.program.rows[i];
    const double bend_radius_mm = row.bend_radius_mm.value_or(0);
    if (!(row.length_mm >= 0 && row.length_mm < 1e6) || !std::isfinite(row.rotation_deg) ||
        !(row.angle_deg >= 0 && row.angle_deg < 360) ||
        !(bend_radius_mm >= 0 && bend_radius_mm < 1e6)) {
      return Fail(ErrorKind::kBadInput, "virtual scan: row " + std::to_string(i + 1) +
                                            ": expected a length of 0 to 1e6 mm, an angle of 0 to "
                                            "less than 360 degrees and a bend "
                                            "radius of 0 to 1e6 mm");
    }
    if (row.angle_deg > 0 && i + 1 < tube.program.rows.size() &&
        bend_radius_mm < tube.pipe_radius_mm) {
      return Fail(ErrorKind::kBadInput, "virtual scan: row " + std::to_string(i + 1) +
                                            ": the bend radius is " + Text(bend_radius_mm) +
                                            " mm, expected at least the pipe radius, " +
                                            Text(tube.pipe_radius_mm) + " mm");
    }
  }
  auto checked = InRange("noise_mm", options.noise_mm, kNoiseMm);
  if (checked) checked = InRange("noise_growth", options.noise_growth, kNoiseGrowth);
  if (checked) checked = InRange("outlier_fraction", options.outlier_fraction, kFraction);
  if (checked) checked = InRange("mixed_pixel_fraction", options.mixed_pixel_fraction, kFraction);
  if (checked) checked = InRange("dropout_fraction", options.dropout_fraction, kFraction);
  if (checked) checked = InRange("pose_noise_mm", options.pose_noise_mm, kNoiseMm);
  if (checked) checked = InRange("wall_mm", options.wall_mm, kWallMm);
  if (checked) checked = InRange("rays", options.rays, kRays);
  if (checked) checked = InRange("fan_half_angle_deg", options.fan_half_angle_deg, {0, 80});
  if (checked) checked = InRange("near_mm", options.near_mm, {0, options.far_mm});
  if (checked) checked = InRange("far_mm", options.far_mm, {1, 2000});
  if (checked) {
    checked = InRange("profiles_per_second", options.profiles_per_second, kProfilesPerSecond);
  }
  if (checked) {
    checked = InRange("profile_spacing_mm", options.path.profile_spacing_mm, kSpacingMm);
  }
  if (checked) checked = InRange("standoff_mm", options.path.standoff_mm, {1, 2000});
  if (checked) checked = InRange("overrun_mm", options.path.overrun_mm, {0, 1000});
  if (checked) checked = InRange("jitter_mm", options.path.jitter_mm, kNoiseMm);
  if (checked) checked = InRange("jitter_deg", options.path.jitter_deg, {0, 45});
  if (checked) checked = InRange("clamps", options.clutter.clamps, {0, 100});
  if (checked) checked = InRange("table_gap_mm", options.clutter.table_gap_mm, kTableGapMm);
  return checked;
}

Result<SimulatedSession> SimulateSession(const hal::Tube& tube,
                                         const SimulateSessionOptions& options,
                                         const std::string& path) {
  if (auto checked = CheckScan(tube, options.scan); !checked) return Fail(checked.error());
  SimulatedSession session;
  session.tube = options.lay_on_table ? LayOnTable(tube, options.scan.seed) : tube;
  const VirtualScan scan(session.tube, options.scan);

  const hal::ManualClock clock;
  auto writer = SessionWriter::Create(path, clock, {.replace = true, .sync = false});
  if (!writer) return Fail(writer.error());
  std::map<std::string, std::string> meta = {
      {"part", options.part},
      {"scanner", "simulated"},
      {"scanner_serial", "seed " + std::to_string(options.scan.seed)},
      {"start", options.start},
      {"software", options.software},
      {"noise_mm", Text(options.scan.noise_mm)},
      {"outlier_fraction", Text(options.scan.outlier_fraction)},
  };
  if (options.scan.noise_growth > 0) meta["noise_growth"] = Text(options.scan.noise_growth);
  meta.insert(options.more_meta.begin(), options.more_meta.end());
  if (auto done = writer->SetMeta(meta); !done) return Fail(done.error());
  if (auto done = writer->Write(scan.StartEvent()); !done) return Fail(done.error());
  hal::LaserProfile profile(scan.max_points());
  for (std::size_t i = 0; i < scan.profile_count(); ++i) {
    scan.Make(i, profile);
    if (auto done = writer->Write(profile); !done) return Fail(done.error());
    ++session.profiles;
    session.points += profile.points.size();
  }
  if (auto done = writer->Write(scan.EndEvent()); !done) return Fail(done.error());
  if (auto done = writer->Finish(); !done) return Fail(done.error());
  return session;
}

}  // namespace bendloop::drivers
