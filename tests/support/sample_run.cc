// SPDX-License-Identifier: Apache-2.0
#include "tests/support/sample_run.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

#include "hal/spine.h"

namespace bendloop::host {
namespace {

constexpr double kRadius = 10;

// Signed distance of a point from the surface of a tube, by its nearest segment.
double SurfaceDistance(const std::vector<hal::SpineSegment>& spine, const Eigen::Vector3d& p) {
  double nearest = 1e300;
  for (const auto& segment : spine) {
    const int steps = std::max(1, static_cast<int>(segment.length_mm));
    double best_along = 0, best = 1e300;
    for (int i = 0; i <= steps; ++i) {
      const double along = segment.length_mm * i / steps;
      const double d = (segment.PointAt(along) - p).norm();
      if (d < best) best = d, best_along = along;
    }
    // The foot lies where the tangent is square to the way to the point.
    for (int i = 0; i < 3; ++i) {
      best_along += (p - segment.PointAt(best_along)).dot(segment.TangentAt(best_along));
      best_along = std::clamp(best_along, 0.0, segment.length_mm);
    }
    nearest = std::min(nearest, (segment.PointAt(best_along) - p).norm());
  }
  return nearest - kRadius;
}

pipeline::Deviation MakeDeviation(double nominal, double measured, double sigma, double tolerance) {
  const double deviation = measured - nominal;
  const auto state = std::abs(deviation) > tolerance + 2 * sigma ? pipeline::ToleranceState::kOut
                     : std::abs(deviation) < tolerance - 2 * sigma
                         ? pipeline::ToleranceState::kIn
                         : pipeline::ToleranceState::kUndecided;
  return {nominal, measured, deviation, sigma, tolerance, state};
}

pipeline::AxisCorrection MakeAxis(double commanded, const pipeline::Deviation& d,
                                  std::uint32_t flags = 0) {
  const double wanted = -0.8 * d.deviation;
  const double applied = flags ? 0 : wanted;
  return {commanded, -d.deviation, 0.8, wanted, applied, commanded + applied, d.sigma, flags};
}

}  // namespace

hal::BendProgram SampleNominal() {
  return {{{80, 0, 90, 40.0},
           {60, 90, 45, 40.0},
           {100, -90, 60, 40.0},
           {50, 180, 30, 40.0},
           {70, 0, 0, std::nullopt}}};
}

RunResult SampleRun(int index, double angle_error_deg, std::size_t surface_samples) {
  std::mt19937 random(static_cast<unsigned>(index));
  std::normal_distribution<double> gauss;
  std::uniform_real_distribution<double> uniform;
  const hal::BendProgram nominal = SampleNominal();

  RunResult run;
  run.part = "manifold-return";
  run.session = "2024-05-06_part-" + std::to_string(index);
  run.time = "2024-05-06T07:0" + std::to_string(index % 10) + ":09Z";
  run.software = "bendloop 0.1.0";
  run.nominal = nominal;
  auto& m = run.measurement;
  m.tube.pipe_radius_mm = kRadius + 0.012;
  m.tube.program = nominal;
  m.sigma = nominal;
  for (std::size_t i = 0; i < nominal.rows.size(); ++i) {
    auto& row = m.tube.program.rows[i];
    const bool last = i + 1 == nominal.rows.size();
    row.length_mm += 0.2 * angle_error_deg * (i % 2 ? 1 : -1);
    if (!last) row.angle_deg += (i == 1 ? 1.0 : 0.1) * angle_error_deg;
    if (!last && i > 0) row.rotation_deg += 0.15 * angle_error_deg;
    if (row.bend_radius_mm) row.bend_radius_mm = *row.bend_radius_mm + 0.1;
    m.sigma.rows[i] = {0.04, last || i == 0 ? 0 : 0.02, last ? 0 : 0.015,
                       last ? std::nullopt : std::optional(0.08)};
  }
  m.pipe_radius_sigma_mm = 0.001;
  m.noise_mm = 0.03;
  m.coverage = 0.964;
  m.longest_gap_mm = 14;
  m.fit = {11874, 126, 0.0202, 0.0301, 0.0594};
  m.warnings = {"the clamp hides 14 mm of row 3"};
  m.timing = {{"projection", 38.1}, {"fit", 9.4}, {"inspection", 1.2}, {"total", 48.7}};
  m.tube.X_WT.position_mm = {300, -120, 85};
  m.tube.X_WT.orientation = Eigen::AngleAxisd(0.7, Eigen::Vector3d(1, 2, 3).normalized());

  auto& in = run.inspection.emplace();
  in.direction.state = pipeline::DirectionState::kForward;
  in.direction.message = "measured in the nominal's order";
  in.measured = m.tube;
  in.sigma = m.sigma;
  in.alignment.X_NW = m.tube.X_WT.Inverse();  // lies on the nominal at its start
  in.alignment.rms_mm = 0.4;
  in.alignment.max_mm = 1.1;
  in.pipe_radius_mm = MakeDeviation(kRadius, m.tube.pipe_radius_mm, 0.001, 0.1);

  const auto spine_N = hal::SpineSegments(nominal, hal::Pose{});
  const auto spine_W = hal::SpineSegments(m.tube.program, m.tube.X_WT);
  const double length = hal::SpineLength(m.tube.program);
  double sum2 = 0;
  for (std::size_t i = 0; i < surface_samples; ++i) {
    double along =
        length * (static_cast<double>(i) + uniform(random)) / static_cast<double>(surface_samples);
    std::size_t s = 0;
    while (s + 1 < spine_W.size() && along > spine_W[s].from_start_mm + spine_W[s].length_mm) ++s;
    const auto& segment = spine_W[s];
    along -= segment.from_start_mm;
    // Seen from one side, as a scanner sees it.
    const double turn = std::numbers::pi * 1.3 * uniform(random);
    const Eigen::Vector3d t = segment.TangentAt(along);
    const Eigen::Vector3d u = t.unitOrthogonal();
    const Eigen::Vector3d out = std::cos(turn) * u + std::sin(turn) * t.cross(u);
    const double noise = 0.03 * gauss(random);
    const Eigen::Vector3d p = segment.PointAt(along) + (m.tube.pipe_radius_mm + noise) * out;
    m.surface.push_back({p, noise});
    const double distance = SurfaceDistance(spine_N, in.alignment.X_NW * p);
    in.surface.distance_mm.push_back(distance);
    in.surface.max_abs_mm = std::max(in.surface.max_abs_mm, std::abs(distance));
    sum2 += distance * distance;
  }
  in.surface.rms_mm =
      std::sqrt(sum2 / static_cast<double>(std::max<std::size_t>(surface_samples, 1)));
  in.surface.p99_abs_mm = 0.97 * in.surface.max_abs_mm;
  in.surface.p95_abs_mm = 0.9 * in.surface.max_abs_mm;
  in.surface.tolerance_mm = 1.5;
  in.surface.state =
      in.surface.p99_abs_mm > 1.5 ? pipeline::ToleranceState::kOut : pipeline::ToleranceState::kIn;
  for (std::size_t s = 0; s < spine_N.size(); ++s) {
    auto& point = in.envelope.emplace_back();
    point.name =
        s == 0 ? "start" : "bend " + std::to_string((s + 1) / 2) + (s % 2 ? " entry" : " exit");
    point.nominal_mm = spine_N[s].start_mm;
    point.measured_mm = in.alignment.X_NW * spine_W[s].start_mm;
    point.distance_mm = (point.nominal_mm - point.measured_mm).norm();
    point.sigma_mm = 0.03;
    point.state =
        point.distance_mm > 1 ? pipeline::ToleranceState::kOut : pipeline::ToleranceState::kIn;
    in.envelope_max_mm = std::max(in.envelope_max_mm, point.distance_mm);
  }

  auto& commanded = run.commanded.emplace();
  commanded = {17, static_cast<std::uint32_t>(100 + index), nominal, 0xC0FFEE};
  auto& correction = run.correction.emplace();
  correction.corrected = nominal;
  correction.changes_anything = true;
  bool all_in = true;
  for (std::size_t i = 0; i < nominal.rows.size(); ++i) {
    const auto &n = nominal.rows[i], &r = m.tube.program.rows[i], &s = m.sigma.rows[i];
    auto& row = in.rows.emplace_back();
    row.length_mm = MakeDeviation(n.length_mm, r.length_mm, s.length_mm, 0.5);
    row.rotation_deg = MakeDeviation(n.rotation_deg, r.rotation_deg, s.rotation_deg, 0.5);
    row.angle_deg = MakeDeviation(n.angle_deg, r.angle_deg, s.angle_deg, 0.5);
    const bool last = i + 1 == nominal.rows.size();
    if (i == 0 || last) row.rotation_deg.state = pipeline::ToleranceState::kNotJudged;
    if (last) row.angle_deg.state = pipeline::ToleranceState::kNotJudged;
    if (n.bend_radius_mm) {
      row.bend_radius_mm = MakeDeviation(*n.bend_radius_mm, *r.bend_radius_mm, 0.08, 1.0);
    }
    for (const auto* d : {&row.length_mm, &row.rotation_deg, &row.angle_deg}) {
      if (d->state != pipeline::ToleranceState::kOut) continue;
      all_in = false;
      in.reasons.push_back("row " + std::to_string(i + 1) + " is out of tolerance");
    }
    auto& out = correction.rows.emplace_back();
    out.length_mm = MakeAxis(n.length_mm, row.length_mm, i == 3 ? pipeline::kFlagDeadband : 0u);
    out.rotation_deg = MakeAxis(n.rotation_deg, row.rotation_deg,
                                i == 0 || last ? pipeline::kFlagNotCorrected : 0u);
    out.angle_deg = MakeAxis(n.angle_deg, row.angle_deg, last ? pipeline::kFlagNotCorrected : 0u);
    correction.corrected.rows[i].length_mm = out.length_mm.corrected;
    correction.corrected.rows[i].rotation_deg = out.rotation_deg.corrected;
    correction.corrected.rows[i].angle_deg = out.angle_deg.corrected;
  }
  in.verdict = all_in ? pipeline::Verdict::kPass : pipeline::Verdict::kFail;
  correction.notices = {"row 4: the change of length is within the uncertainty; none is made"};

  auto& checks = run.interlocks.emplace().checks;
  checks.push_back(
      {pipeline::InterlockKind::kBendCount, true, 4, 4, "4 bends, as the nominal has"});
  checks.push_back({pipeline::InterlockKind::kCoverage, true, 0.964, 0.9,
                    "96.4 % of the spine seen, 90 % needed"});
  checks.push_back({pipeline::InterlockKind::kBenderReady, true, std::nan(""), std::nan(""),
                    "the bender is idle and its heartbeat is alive"});
  run.bender = CommitReport{CommitOutcome::kCommitted, "", commanded.sequence + 1,
                            hal::ProgramBlock{17, commanded.sequence + 1, correction.corrected, 7}};
  return run;
}

}  // namespace bendloop::host
