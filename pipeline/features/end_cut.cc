// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/end_cut.h"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <vector>

#include "hal/angles.h"
#include "pipeline/features/posterior.h"
#include "pipeline/features/sampling.h"
#include "pipeline/math/dense_solve.h"
#include "pipeline/math/quantiles.h"

namespace bendloop::pipeline {
namespace {

struct EndCutSettings {
  // [of r_P] From the border into the tube: where the gaps between samples are looked at; and how
  // far beyond the end that was found the long side of a cut may lie. By trial.
  double window = 3.0, beyond = 2.0;
  // Samples of a column in its window: fewer tell nothing of its gaps, more make it wide.
  double in_column = 12.0;
  std::size_t least_columns = 12, most_columns = 96;
  std::size_t least_in_column = 5;
  // Of the turn: a plane is not told by less.
  double least_seen = 0.3;
  // Of a column's mean gap: a point with a longer one behind it is a flier (fit/tube_ends.cc).
  double lone_gap = 4.0;
  // Of the mean gap: a border that rises by less across a column is level in it.
  double level = 0.25;
  // Columns that stand against a plane by more count no further [-log likelihood]: something lies
  // on the tube there, or hides it.
  double saturated = 12.0;
  // Of the mean gap: how much deeper than the longest gap the plane may lie, 1 sigma.
  double beyond_longest = 0.1;
  // Slopes before the scan: ends are cut square to a degree or two, or mitred by any angle; so this
  // is the half width of a Cauchy distribution, a degree.
  double usual_slope = 0.0175;
  // Neighbouring columns have their points as far apart as this, in mean gaps: in 0.5 if one does
  // not know of the other, in next to nothing if laser lines cross both.
  double one_line = 0.25;
  // Of the length-weighted mean gap: samples nearer to each other are of one laser line.
  double one_crossing = 0.25;
  // Of their length: how much runs of gaps that are those of laser lines differ; those of scattered
  // samples differ by the root of their number, 0.4 of six. By trial.
  double even = 0.12;
  std::size_t most_passes = 6;
  // Of all columns: so many may a laser line cross, which sees one side of the tube.
  double crossed = 0.5;
  // [sigma] From a square cut; closer ones are taken for it.
  double oblique = 5.0;
  // Steps of the walk, and of one that says whether the end may be oblique at all, from so many
  // sigma on.
  int walk = 1500, short_walk = 500;
  double may_be_oblique = 2.5;
  // Samples of an end: so many tell as much of it as all.
  std::size_t enough_samples = 12'000;
};
constexpr EndCutSettings kCut;

// A narrow part of the turn.
struct Column {
  double cosine = 1, sine = 0;  // of its middle
  double last_mm = 0;           // where its samples stop
  double mean_gap_mm = 0;
  // Of laser lines, which follow each other in the same order again and again: where the next would
  // have been, and 1 sigma of that.
  std::optional<double> next_mm;
  double last_sigma_mm = 0, next_sigma_mm = 0;
};

// The logarithm of the normal distribution, no less than -kCut.saturated, from a table.
class LogNormalCdf {
 public:
  LogNormalCdf() {
    for (std::size_t i = 0; i < kSize; ++i) {
      const double z = kFrom + kStep * static_cast<double>(i);
      table_[i] =
          std::max(std::log(0.5 * std::erfc(-z * std::numbers::sqrt2 / 2.0)), -kCut.saturated);
    }
  }
  double operator()(double z) const {
    const double place = (z - kFrom) / kStep;
    if (!(place > 0)) return table_.front();
    if (!(place < static_cast<double>(kSize - 1))) return table_.back();
    const auto at = static_cast<std::size_t>(place);
    return table_[at] + (place - static_cast<double>(at)) * (table_[at + 1] - table_[at]);
  }

 private:
  static constexpr std::size_t kSize = 481;
  static constexpr double kFrom = -6.0, kStep = 0.025;
  std::array<double, kSize> table_{};
};

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

// How samples along a column follow each other if they are those of laser lines in so many passes:
// after as many lines all comes again.
struct LinePattern {
  double last_mm = 0, next_mm = 0;
  double sigma_mm = 0;  // of the next, by how unlike the rounds are
  double samples_of_last = 1;
};
// `at`: sorted.
std::optional<LinePattern> FindPattern(std::span<const double> at) {
  double sum = 0, sum2 = 0;
  for (std::size_t i = 1; i < at.size(); ++i) {
    const double gap = at[i] - at[i - 1];
    sum += gap;
    sum2 += gap * gap;
  }
  // Samples of one line, each line by its middle.
  const double apart_mm = kCut.one_crossing * sum2 / std::max(sum, 1e-12);
  std::vector<double> lines;
  double samples_of_last = 1;
  for (std::size_t i = 0; i < at.size();) {
    double middle = 0;
    std::size_t end = i;
    for (; end < at.size() && (end == i || at[end] - at[end - 1] < apart_mm); ++end)
      middle += at[end];
    samples_of_last = static_cast<double>(end - i);
    lines.push_back(middle / samples_of_last);
    i = end;
  }
  const std::size_t n = lines.size();
  for (std::size_t period = 1; period <= kCut.most_passes && n >= 2 * period + 4; ++period) {
    const auto count = static_cast<double>(n - period);
    double mean = 0, square = 0;
    for (std::size_t i = 0; i + period < n; ++i) {
      const double length = lines[i + period] - lines[i];
      mean += length / count;
      square += length * length / count;
    }
    const double scatter = std::sqrt(std::max(0.0, square - mean * mean));
    if (scatter > kCut.even * mean) continue;
    const double gap_mm = lines[n - period] - lines[n - period - 1];
    return LinePattern{lines.back(), lines.back() + gap_mm, scatter, samples_of_last};
  }
  return std::nullopt;
}

// What a column says of a plane by how far, in mean gaps, it lies beyond the column's last sample:
// the logarithm of the likelihood, from a table.
class Stops {
 public:
  // `gaps`: between samples. `smear`: 1 sigma by which noise displaces a sample. Both in mean gaps.
  // Columns that the same laser lines cross have the same gaps and tell of their length once,
  // together; of the longest each.
  Stops(std::vector<double> gaps, double smear, double columns_of_line) {
    std::sort(gaps.begin(), gaps.end());
    const double longest = gaps.back();
    const auto n = static_cast<double>(gaps.size());
    step_ = 0.25 * smear;
    from_ = -8.0 * smear;
    std::size_t shorter = 0;
    for (double at = from_; table_.size() < kMost; at += step_) {
      const double z = at / smear;
      const double passes = 0.5 * std::erfc(-z * std::numbers::sqrt2 / 2.0);
      // Samples are missing up to the plane, where noise moves some of them beyond it.
      const double density = std::exp(-0.5 * z * z) / std::sqrt(2.0 * std::numbers::pi);
      const double missing = smear * (z * passes + density);
      while (shorter < gaps.size() && gaps[shorter] < missing) ++shorter;
      const double within =
          std::log((n - static_cast<double>(shorter) + 0.5) / (n + 0.5)) / columns_of_line;
      const double beyond = std::max(0.0, missing - longest) / kCut.beyond_longest;
      const double log = std::log(std::max(passes, 1e-30)) + within - beyond;
      table_.push_back(std::max(log, -kCut.saturated));
      if (z > 0 && log < -kCut.saturated) break;
    }
  }
  double operator()(double beyond) const {
    const double place = (beyond - from_) / step_;
    if (!(place > 0)) return table_.front();
    const auto at = static_cast<std::size_t>(place);
    if (at + 1 >= table_.size()) return table_.back();
    const double part = place - static_cast<double>(at);
    return table_[at] + part * (table_[at + 1] - table_[at]);
  }

 private:
  static constexpr std::size_t kMost = 20'000;
  double from_ = 0, step_ = 1;
  std::vector<double> table_;
};

// Mean distance between a point of one column and the nearest of the next, in mean gaps.
double ApartInGaps(const std::vector<double>& here, const std::vector<double>& next,
                   double mean_gap_mm) {
  double sum = 0;
  for (const double at : here) {
    const auto above = std::lower_bound(next.begin(), next.end(), at);
    double nearest = 1e300;
    if (above != next.end()) nearest = *above - at;
    if (above != next.begin()) nearest = std::min(nearest, at - *(above - 1));
    sum += std::min(nearest, mean_gap_mm);
  }
  return sum / (static_cast<double>(here.size()) * mean_gap_mm);
}

// The columns with what they tell together.
class Columns {
 public:
  Columns(std::span<const EndSample> samples, double window_mm, double smear_mm) {
    const double wanted = static_cast<double>(samples.size()) / kCut.in_column;
    count_ = std::min(kCut.most_columns, static_cast<std::size_t>(wanted));
    if (count_ < kCut.least_columns) {
      count_ = 0;
      return;
    }
    std::vector<std::vector<double>> at(count_);
    for (const EndSample& sample : samples) {
      const double turn = sample.around_rad / (2.0 * std::numbers::pi);
      const double part = (turn - std::floor(turn)) * static_cast<double>(count_);
      at[std::min(count_ - 1, static_cast<std::size_t>(part))].push_back(sample.beyond_mm);
    }
    std::vector<double> apart;
    for (std::size_t k = 0; k < count_; ++k) Take(k, window_mm, smear_mm, at[k]);
    Smooth();
    for (std::size_t k = 0; k < count_; ++k) {
      const auto& next = at[(k + 1) % count_];
      if (at[k].empty() || next.empty()) continue;
      const double mean_gap_mm = (at[k].back() - at[k].front()) / static_cast<double>(at[k].size());
      if (mean_gap_mm > 0) apart.push_back(ApartInGaps(at[k], next, mean_gap_mm));
    }
    if (Median(apart) < kCut.one_line) columns_of_line_ = static_cast<double>(seen_.size());
  }

  const std::vector<Column>& seen() const { return seen_; }
  double width_rad() const { return 2.0 * std::numbers::pi / static_cast<double>(count_); }
  bool AreEnough() const {
    return seen_.size() >= 6 &&
           static_cast<double>(seen_.size()) >= kCut.least_seen * static_cast<double>(count_);
  }
  double MeanGapMm() const {
    std::vector<double> gaps_mm;
    for (const Column& column : seen_) gaps_mm.push_back(column.mean_gap_mm);
    return Median(std::move(gaps_mm));
  }
  // What the columns say, each by how far a plane lies beyond its last sample.
  Stops MakeStops(double smear_mm) const {
    return {gaps_, smear_mm / MeanGapMm(), columns_of_line_};
  }

 private:
  // `at`: becomes sorted, and what lies beyond where the column stops or before its window goes.
  void Take(std::size_t k, double window_mm, double smear_mm, std::vector<double>& at) {
    std::sort(at.begin(), at.end());
    const auto mean_gap = [&] {
      const double from = std::max(at.front(), at.back() - window_mm);
      const auto first = std::lower_bound(at.begin(), at.end(), from);
      return (at.back() - *first) /
             static_cast<double>(std::max<std::ptrdiff_t>(1, at.end() - first - 1));
    };
    while (at.size() >= kCut.least_in_column &&
           at.back() - at[at.size() - 2] > kCut.lone_gap * mean_gap()) {
      at.pop_back();
    }
    if (at.size() >= kCut.least_in_column) {
      at.erase(at.begin(), std::lower_bound(at.begin(), at.end(), at.back() - window_mm));
    }
    const double mean_gap_mm = at.empty() ? 0.0 : mean_gap();
    if (at.size() < kCut.least_in_column || !(mean_gap_mm > 0)) {
      at.clear();
      return;
    }
    for (std::size_t i = 1; i < at.size(); ++i) gaps_.push_back((at[i] - at[i - 1]) / mean_gap_mm);
    const double turn =
        (static_cast<double>(k) + 0.5) * 2.0 * std::numbers::pi / static_cast<double>(count_);
    Column& column = seen_.emplace_back();
    column.cosine = std::cos(turn);
    column.sine = std::sin(turn);
    column.last_mm = at.back();
    column.mean_gap_mm = mean_gap_mm;
    if (const auto pattern = FindPattern(at)) {
      column.last_mm = pattern->last_mm;
      column.next_mm = pattern->next_mm;
      column.last_sigma_mm = smear_mm / std::sqrt(pattern->samples_of_last);
      column.next_sigma_mm = std::hypot(column.last_sigma_mm, pattern->sigma_mm);
    }
  }

  // A column's few gaps tell their mean roughly; those beside it see about as many samples.
  void Smooth() {
    std::vector<double> mean_mm(seen_.size());
    const std::size_t n = seen_.size();
    for (std::size_t k = 0; k < n; ++k) {
      for (std::size_t i = n - 2; i <= n + 2; ++i)
        mean_mm[k] += seen_[(k + i) % n].mean_gap_mm / 5.0;
    }
    for (std::size_t k = 0; k < n; ++k) seen_[k].mean_gap_mm = mean_mm[k];
  }

  std::size_t count_ = 0;
  std::vector<Column> seen_;
  std::vector<double> gaps_;  // in mean gaps
  double columns_of_line_ = 1;
};

// Where the plane roughly is: least squares that leave out what lies far off.
Eigen::Vector3d RoughPlane(const Columns& columns, double r_mm) {
  std::vector<double> ends;
  for (const Column& column : columns.seen()) ends.push_back(column.last_mm);
  Eigen::Vector3d plane(Median(ends), 0.0, 0.0);
  double reach_mm = 0.5 * r_mm;
  for (int i = 0; i < 10; ++i) {
    Eigen::Matrix3d matrix = Eigen::Matrix3d::Identity();
    matrix(0, 0) = 1e-9;
    matrix *= 1e-3;
    Eigen::Vector3d right = Eigen::Vector3d::Zero();
    std::vector<double> off;
    for (const Column& column : columns.seen()) {
      const Eigen::Vector3d row(1.0, r_mm * column.cosine, r_mm * column.sine);
      const double target = column.next_mm ? 0.5 * (column.last_mm + *column.next_mm)
                                           : column.last_mm + 0.5 * column.mean_gap_mm;
      const double residual = (target - row.dot(plane)) / reach_mm;
      off.push_back(std::abs(target - row.dot(plane)));
      if (std::abs(residual) >= 1) continue;
      const double weight = std::pow(1.0 - residual * residual, 2);
      matrix += weight * row * row.transpose();
      right += weight * target * row;
    }
    plane = SolveSymmetric(matrix, right);
    reach_mm = std::max(6.0 * Median(off), 0.02 * r_mm);
  }
  return plane;
}

// The samples without what a slope puts them further out.
std::vector<EndSample> Levelled(std::span<const EndSample> samples,
                                const Eigen::Vector2d& slope_mm) {
  std::vector<EndSample> level(samples.begin(), samples.end());
  if (slope_mm.isZero()) return level;
  for (EndSample& sample : level) {
    sample.beyond_mm -=
        slope_mm[0] * std::cos(sample.around_rad) + slope_mm[1] * std::sin(sample.around_rad);
  }
  return level;
}

// Samples of the tube near one of its ends.
std::vector<EndSample> SamplesNear(const hal::Tube& tube, bool at_start, double sigma_mm,
                                   double window_mm, std::span<const PointBlock> blocks) {
  const auto segments = hal::SpineSegments(tube.program, tube.X_WT);
  const std::size_t at = at_start ? 0 : segments.size() - 1;
  const hal::SpineSegment& straight = segments[at];
  const Eigen::Vector3d end = straight.PointAt(at_start ? 0.0 : straight.length_mm);
  const Eigen::Vector3d outward = at_start ? Eigen::Vector3d(-straight.tangent) : straight.tangent;
  const Eigen::Vector3d zero = hal::AroundZero(segments, at);
  const Eigen::Vector3d quarter = straight.tangent.cross(zero);
  const double r_mm = tube.pipe_radius_mm, reach_mm = kSampling.on_surface * sigma_mm;
  const double beyond_mm = kCut.beyond * r_mm;
  const double around_mm = std::hypot(std::max(window_mm + r_mm, beyond_mm), 1.5 * r_mm);
  std::vector<EndSample> samples;
  for (const PointBlock& block : blocks) {
    const double near_mm = around_mm + block.half_diagonal_mm;
    if ((block.center_mm - end).squaredNorm() > near_mm * near_mm) continue;
    for (const Eigen::Vector3d& point : block.points) {
      const Eigen::Vector3d from = point - end;
      const double at_mm = from.dot(outward);
      if (at_mm < -window_mm - r_mm || at_mm > beyond_mm || at_mm < -straight.length_mm) continue;
      const double x = from.dot(zero), y = from.dot(quarter);
      if (std::abs(std::hypot(x, y) - r_mm) > reach_mm) continue;
      samples.push_back({std::atan2(y, x), at_mm});
    }
  }
  const std::size_t stride = StrideTo(samples.size(), kCut.enough_samples);
  for (std::size_t i = 0; i * stride < samples.size(); ++i) samples[i] = samples[i * stride];
  samples.resize((samples.size() + stride - 1) / stride);
  return samples;
}

EndCutFound Found(const EndPlane& plane) {
  const double slope = std::hypot(plane.cosine, plane.sine);
  EndCutFound found;
  found.cut.obliquity_deg = std::atan(slope) * hal::kDegreesPerRadian;
  found.cut.around_deg = std::atan2(plane.sine, plane.cosine) * hal::kDegreesPerRadian;
  found.obliquity_sigma_deg = plane.slope_sigma / (1.0 + slope * slope) * hal::kDegreesPerRadian;
  found.around_sigma_deg =
      std::min(180.0, plane.slope_sigma / std::max(slope, 1e-9) * hal::kDegreesPerRadian);
  return found;
}

EndPlane PlaneOf(const Posterior& posterior, const Eigen::Vector2d& slope_mm, double r_mm) {
  const Eigen::Vector2d slope = (posterior.mean.tail<2>() + slope_mm) / r_mm;
  const Eigen::Matrix2d covariance = posterior.covariance.block<2, 2>(1, 1) / (r_mm * r_mm);
  EndPlane plane;
  plane.at_mm = posterior.mean[0];
  plane.at_sigma_mm = posterior.Sigma(0);
  plane.cosine = slope[0];
  plane.sine = slope[1];
  plane.slope_sigma = std::sqrt(0.5 * covariance.trace());
  plane.slope_sigmas = std::sqrt(std::max(0.0, slope.dot(covariance.inverse() * slope)));
  return plane;
}

}  // namespace

std::optional<EndPlane> FitEndPlane(std::span<const EndSample> samples, double pipe_radius_mm,
                                    double window_mm, double sigma_mm) {
  const double smear_mm = kSampling.SmearMm(sigma_mm, pipe_radius_mm);
  // About a rough plane, so that the border is level within each column.
  Eigen::Vector2d slope_mm = Eigen::Vector2d::Zero();
  std::optional<Columns> columns;
  Eigen::Vector3d rough;
  for (int pass = 0; pass < 3; ++pass) {
    columns.emplace(Levelled(samples, slope_mm), window_mm, smear_mm);
    if (!columns->AreEnough()) return std::nullopt;
    rough = RoughPlane(*columns, pipe_radius_mm);
    const Eigen::Vector2d rise_mm = pipe_radius_mm * rough.tail<2>();
    if (pass == 2 || rise_mm.norm() * columns->width_rad() < kCut.level * columns->MeanGapMm())
      break;
    slope_mm += rise_mm;
  }
  const Stops stops = columns->MakeStops(smear_mm);
  const LogNormalCdf log_cdf;
  const double greatest = GreatestError(kCut.crossed * static_cast<double>(columns->seen().size()));
  const double prior_mm = kCut.usual_slope * pipe_radius_mm;
  const auto log_density = [&](const Eigen::VectorXd& x) {
    // The slopes in the walk are lengths, so that all three numbers are alike.
    double log = -1.5 * std::log1p((x.tail<2>() + slope_mm).squaredNorm() / (prior_mm * prior_mm));
    for (const Column& column : columns->seen()) {
      const double at_mm = x[0] + column.cosine * x[1] + column.sine * x[2];
      if (!column.next_mm) {
        log += stops((at_mm - column.last_mm) / column.mean_gap_mm);
        continue;
      }
      log += log_cdf((at_mm - column.last_mm) / column.last_sigma_mm + greatest);
      log += log_cdf((*column.next_mm - at_mm) / column.next_sigma_mm + greatest);
    }
    return log;
  };
  rough.tail<2>() *= pipe_radius_mm;
  const Eigen::Vector3d scale = Eigen::Vector3d::Constant(0.1 * columns->MeanGapMm());
  EndPlane plane;
  for (const int walk : {kCut.short_walk, kCut.walk}) {
    plane = PlaneOf(SamplePosterior(rough, scale, walk, log_density), slope_mm, pipe_radius_mm);
    if (plane.slope_sigmas < kCut.may_be_oblique) break;
  }
  return plane;
}

EndCuts FindEndCuts(double sigma_mm, std::span<const PointBlock> blocks, TubeEnds& ends) {
  EndCuts cuts;
  const double r_mm = ends.tube.pipe_radius_mm;
  const hal::Tube found = ends.tube;
  auto& rows = ends.tube.program.rows;
  for (const bool at_start : {true, false}) {
    if (!(at_start ? ends.first_seen : ends.last_seen)) continue;
    const double straight_mm =
        at_start ? found.program.rows.front().length_mm : found.program.rows.back().length_mm;
    const double window_mm = std::min(kCut.window * r_mm, straight_mm);
    const auto plane = FitEndPlane(SamplesNear(found, at_start, sigma_mm, window_mm, blocks), r_mm,
                                   window_mm, sigma_mm);
    if (!plane) continue;
    (at_start ? cuts.first : cuts.last) = Found(*plane);
    if (plane->slope_sigmas < kCut.oblique) continue;
    if (at_start) {
      ends.tube.X_WT.position_mm -=
          plane->at_mm * (ends.tube.X_WT.orientation * Eigen::Vector3d::UnitX());
      rows.front().length_mm = std::max(0.0, rows.front().length_mm + plane->at_mm);
      ends.first_sigma_mm = plane->at_sigma_mm;
    } else {
      rows.back().length_mm = std::max(0.0, rows.back().length_mm + plane->at_mm);
      ends.last_sigma_mm = plane->at_sigma_mm;
    }
  }
  return cuts;
}

}  // namespace bendloop::pipeline
