// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/end_evidence.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numbers>

#include "pipeline/features/end_samples.h"
#include "pipeline/features/end_series.h"
#include "pipeline/features/even_table.h"
#include "pipeline/features/sampling.h"
#include "pipeline/math/dense_solve.h"
#include "pipeline/math/quantiles.h"

namespace bendloop::pipeline {
namespace {

struct EvidenceSettings {
  // Of the turn: a border is not told by lines that cross less.
  double least_seen = 0.3;
  std::size_t least_brackets = 6;
  // Of the mean gap: a border that rises by less across a column is level in it.
  double level = 0.25;
  // Sides that stand against a border by more count no further [-log likelihood]: something lies
  // on the tube there, or hides it.
  double saturated = 12.0;
  // Of the rays that meet the wall: so many return nothing.
  double lost = 0.05;
  // Of all columns: so many may a laser line cross, which sees one side of the tube.
  double crossed = 0.5;
};
constexpr EvidenceSettings kEvidence;

const EvenTable& TableOfHits() {
  static const EvenTable table = LogNormalCdf(std::exp(-kEvidence.saturated));
  return table;
}
const EvenTable& TableOfMisses() {
  static const EvenTable table = LogNormalCdf(kEvidence.lost);
  return table;
}

// The samples of so many columns are of one laser line, whose place they tell with errors of their
// own: a plane beyond the line lies beyond the greatest of them no more often than not only where
// that is taken for as far beyond the line as the greatest of so many errors is [sigma]. Without it
// each column would push the plane away from lines once more.
double GreatestError(double columns) {
  const double log_half = -std::numbers::ln2 / std::max(1.0, columns);
  double low = 0, high = 5;
  for (int i = 0; i < 40; ++i) {
    const double z = 0.5 * (low + high);
    (std::log(0.5 * std::erfc(-z * std::numbers::sqrt2 / 2.0)) < log_half ? low : high) = z;
  }
  return low;
}

// The samples without what a series puts them further out.
std::vector<EndSample> Levelled(std::span<const EndSample> samples,
                                const Eigen::VectorXd& series_mm) {
  std::vector<EndSample> level(samples.begin(), samples.end());
  for (EndSample& sample : level) {
    sample.beyond_mm -=
        SeriesOf(series_mm, std::cos(sample.around_rad), std::sin(sample.around_rad));
  }
  return level;
}

}  // namespace

double LogOfHits(std::span<const double> clear) { return TableOfHits().Sum(clear); }

double LogOfMisses(std::span<const double> clear) { return TableOfMisses().Sum(clear); }

void AddSide(const EndSide& side, double sigma_mm, PlaneLanes& lanes) {
  const double scale = side.is_beyond ? 1.0 / sigma_mm : -1.0 / sigma_mm;
  const auto misses = static_cast<std::int32_t>(TableOfHits().at.size());
  lanes.Add(side.cosine, side.sine, side.at_mm, scale,
            side.is_beyond || side.is_whole ? 0 : misses);
}

double LogOfSides(const PlaneLanes& sides, const double* x, double more) {
  static const EvenTable table = [] {
    EvenTable both = TableOfHits();
    both.size = both.at.size();
    const EvenTable& misses = TableOfMisses();
    both.at.insert(both.at.end(), misses.at.begin(), misses.at.end());
    return both;
  }();
  return table.Sum(sides, x, more);
}

void EndEvidence::AddLines(const LineBracket& lines) {
  for (const bool is_beyond : {true, false}) {
    const double around = is_beyond ? lines.last_rad : lines.next_rad;
    sides.push_back({std::cos(around), std::sin(around), is_beyond ? lines.last_mm : lines.next_mm,
                     is_beyond ? lines.last_sigma_mm : lines.next_sigma_mm, is_beyond,
                     !is_beyond && lines.next_is_told, !is_beyond && lines.next_is_whole});
  }
}

std::vector<RoughEndPlace> EndEvidence::RoughPlaces() const {
  std::vector<RoughEndPlace> places;
  for (std::size_t i = 0; i + 1 < sides.size(); i += 2) {
    const EndSide &last = sides[i], &next = sides[i + 1];
    places.push_back({last.cosine, last.sine, 0.5 * (last.at_mm + next.at_mm)});
  }
  for (const EndStop& stop : columns) {
    places.push_back({stop.cosine, stop.sine, stop.last_mm + 0.5 * stop.mean_gap_mm});
  }
  return places;
}

Eigen::Vector3d RoughEndPlane(const EndEvidence& evidence, double r_mm) {
  const std::vector<RoughEndPlace> places = evidence.RoughPlaces();
  std::vector<double> ends;
  for (const RoughEndPlace& place : places) ends.push_back(place.at_mm);
  Eigen::Vector3d plane(Median(ends), 0.0, 0.0);
  double reach_mm = 0.5 * r_mm;
  for (int i = 0; i < 10; ++i) {
    Eigen::Matrix3d matrix = 1e-3 * Eigen::Vector3d(1e-9, 1.0, 1.0).asDiagonal();
    Eigen::Vector3d right = Eigen::Vector3d::Zero();
    std::vector<double> off;
    for (const RoughEndPlace& place : places) {
      const Eigen::Vector3d row(1.0, place.cosine, place.sine);
      const double residual = place.at_mm - row.dot(plane);
      off.push_back(std::abs(residual));
      if (off.back() >= reach_mm) continue;
      const double weight = std::pow(1.0 - std::pow(residual / reach_mm, 2), 2);
      matrix += weight * row * row.transpose();
      right += weight * place.at_mm * row;
    }
    plane = SolveSymmetric(matrix, right);
    reach_mm = std::max(6.0 * Median(off), 0.02 * r_mm);
  }
  return plane;
}

std::optional<EndEvidence> LookAtEndLines(std::span<const EndSample> samples, double r_mm,
                                          double window_mm, double smear_mm, double sigma_mm,
                                          bool knows_passes) {
  std::map<unsigned, std::vector<EndSample>> passes;
  std::vector<EndSample>* own = nullptr;
  for (std::size_t i = 0; i < samples.size(); ++i) {
    if (i == 0 || samples[i].pass != samples[i - 1].pass) own = &passes[samples[i].pass];
    own->push_back(samples[i]);
  }
  EndEvidence evidence;
  evidence.knows_passes = knows_passes;
  EndSectors seen{};
  std::vector<double> gaps_mm;
  std::size_t most = 0;
  for (const auto& [pass, of_pass] : passes) {
    const auto brackets = FindLineBrackets(of_pass, window_mm, smear_mm, knows_passes);
    most = std::max(most, brackets.size());
    for (const LineBracket& lines : brackets) {
      evidence.AddLines(lines);
      gaps_mm.push_back(lines.next_mm - lines.last_mm);
      seen[EndSectorOf(lines.last_rad)] = true;
    }
  }
  const auto sectors = std::count(seen.begin(), seen.end(), true);
  if (gaps_mm.size() < kEvidence.least_brackets ||
      static_cast<double>(sectors) < kEvidence.least_seen * static_cast<double>(kEndSectors)) {
    return std::nullopt;
  }
  evidence.gap_mm = Median(std::move(gaps_mm));
  evidence.lines_greatest = GreatestError(static_cast<double>(most));
  // Noise moves samples around the tube, too, where an oblique border goes along it.
  const Eigen::Vector3d rough = RoughEndPlane(evidence, r_mm);
  const double around_mm = sigma_mm * rough.tail<2>().norm() / r_mm;
  // Where the next lines were due is known of each pass at once, and not of each strip.
  const double greatest_of_next = GreatestError(static_cast<double>(kToldOfNext));
  for (EndSide& side : evidence.sides) {
    side.sigma_mm = std::max(std::hypot(side.sigma_mm, around_mm), kSampling.least * r_mm);
    if (knows_passes && !side.is_beyond) {
      side.at_mm -= (evidence.lines_greatest - greatest_of_next) * side.sigma_mm;
    }
  }
  return evidence;
}

std::optional<EndEvidence> EndColumnsAbout(std::span<const EndSample> samples, double window_mm,
                                           double smear_mm, const Eigen::Vector2d& slope_mm,
                                           bool may_be_lines) {
  return EndColumnsAlong(samples, window_mm, smear_mm,
                         Eigen::Vector3d(0.0, slope_mm[0], slope_mm[1]), may_be_lines);
}

std::optional<EndEvidence> EndColumnsAlong(std::span<const EndSample> samples, double window_mm,
                                           double smear_mm, const Eigen::VectorXd& series_mm,
                                           bool may_be_lines) {
  std::vector<EndSample> level;
  if (!series_mm.isZero()) level = Levelled(samples, series_mm);
  const bool is_plane = OrderOf(series_mm) <= 1;
  EndColumns columns(level.empty() ? samples : level, window_mm, smear_mm, !is_plane);
  if (!columns.AreEnough()) return std::nullopt;
  EndEvidence evidence;
  for (const EndColumn& column : columns.seen()) {
    if (column.lines) {
      evidence.AddLines(*column.lines);
      continue;
    }
    evidence.columns.push_back({std::cos(column.around_rad), std::sin(column.around_rad),
                                column.last_mm, column.mean_gap_mm});
  }
  evidence.gap_mm = columns.MeanGapMm();
  evidence.width_rad = columns.width_rad();
  if (may_be_lines) columns.LookAtSharedLines(RoughEndPlane(evidence, window_mm).tail<2>());
  evidence.gaps_before = columns.gaps_before();
  evidence.columns_of_line = columns.columns_of_line();
  evidence.share_lines = columns.share_lines();
  evidence.stops = columns.MakeStops(smear_mm);
  evidence.stops_or_hidden = columns.MakeStops(smear_mm, -std::log(kEvidence.lost));
  evidence.lines_greatest =
      GreatestError(kEvidence.crossed * static_cast<double>(columns.seen().size()));
  return evidence;
}

std::optional<EndEvidence> LookAtEndColumns(std::span<const EndSample> samples, double r_mm,
                                            double window_mm, double smear_mm,
                                            Eigen::Vector2d& slope_mm) {
  for (int pass = 0;; ++pass) {
    auto evidence = EndColumnsAbout(samples, window_mm, smear_mm, slope_mm);
    if (!evidence) return std::nullopt;
    const Eigen::Vector2d rise_mm = RoughEndPlane(*evidence, r_mm).tail<2>();
    if (pass == 2 || rise_mm.norm() * evidence->width_rad < kEvidence.level * evidence->gap_mm) {
      return evidence;
    }
    slope_mm += rise_mm;
  }
}

}  // namespace bendloop::pipeline
