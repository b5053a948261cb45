// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/end_columns.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "pipeline/math/quantiles.h"

namespace bendloop::pipeline {
namespace {

struct ColumnSettings {
  // Samples of a column in its window: fewer tell nothing of its gaps, more make it wide.
  double in_column = 12.0;
  std::size_t least_columns = 12, most_columns = 96;
  std::size_t least_in_column = 5;
  // Of the turn: a plane is not told by less.
  double least_seen = 0.3;
  // Of a column's mean gap: a point with a longer one behind it is a flier (fit/tube_ends.cc).
  double lone_gap = 4.0;
  // Columns that stand against a plane by more count no further [-log likelihood]: something lies
  // on the tube there, or hides it.
  double saturated = 12.0;
  // Of the mean gap: how much deeper than the longest gap the plane may lie, 1 sigma.
  double beyond_longest = 0.1;
  // Neighbouring columns have their points as far apart as this, in mean gaps: in 0.5 if one does
  // not know of the other, in next to nothing if laser lines cross both.
  double one_line = 0.25;
  // Rings that are thought of as borders, and what part of the columns they cross at least.
  int rings = 100, least_rings = 20;
  double least_crossed = 0.7;
  // More columns than that say the same, or it is chance: by how near to a ring the nearest of them
  // stop, and by how their sums differ from ring to ring, which tells it less well.
  double by_chance = 1.5, sums_by_chance = 2.5;
  std::size_t most_steps = 20'000;  // of a table
  double ahead = 2.0;               // [sigma of a round] That is certain of a next line.
  double all_of_it = 9.0;           // [sigma]
};
constexpr ColumnSettings kColumns;

// Mean distance between a point of one column and the nearest of the next, in mean gaps. Both are
// sorted.
double ApartInGaps(const std::vector<double>& here, const std::vector<double>& next,
                   double mean_gap_mm) {
  double sum = 0;
  auto above = next.begin();
  for (const double at : here) {
    while (above != next.end() && *above < at) ++above;
    double nearest = 1e300;
    if (above != next.end()) nearest = *above - at;
    if (above != next.begin()) nearest = std::min(nearest, at - *(above - 1));
    sum += std::min(nearest, mean_gap_mm);
  }
  return sum / (static_cast<double>(here.size()) * mean_gap_mm);
}

// How the columns' rarities at many rings differ from those of columns that do not know of each
// other.
class RingSums {
 public:
  void Begin() {
    sums_.setZero();
    count_ = 0;
    least_.fill(kNone);
    crossed_.fill(0.0);
  }
  // `direction`: of the column, from the axis; `part`: where around it is, from 0 to 1.
  void Add(double rarity, const Eigen::Vector2d& direction, double part) {
    const Eigen::Vector2d evenly = std::numbers::sqrt2 * direction;
    sums_ += (rarity - 1.0) * Eigen::Vector3d(1.0, evenly.x(), evenly.y());
    count_ += 1;
    const auto k = static_cast<std::size_t>(part * static_cast<double>(kParts));
    least_[k] = std::min(least_[k], rarity);
    crossed_[k] += 1;
  }
  double count() const { return count_; }
  void End() {
    rings_ += 1;
    sums_ /= std::sqrt(count_);
    mean_ += sums_;
    square_ += sums_.cwiseAbs2();
    nearest_ += count_ * *std::min_element(least_.begin(), least_.end());
    for (std::size_t k = 0; k < kParts; ++k) {
      if (crossed_[k] > 0) nearest_of_part_ += least_[k] * crossed_[k] / kParts;
    }
  }
  double rings() const { return rings_; }
  // Columns that say the same; 1: each says its own.
  double Columns() const {
    const double by_nearest = std::max(nearest_, nearest_of_part_) / rings_;
    const Eigen::Vector3d variance = (square_ - mean_.cwiseAbs2() / rings_) / (rings_ - 1.0);
    const double by_sums = variance.mean();
    return std::max(by_nearest > kColumns.by_chance ? by_nearest : 1.0,
                    by_sums > kColumns.sums_by_chance ? by_sums : 1.0);
  }

 private:
  static constexpr double kNone = 1e300;
  static constexpr std::size_t kParts = 8;  // of the turn

  Eigen::Vector3d sums_ = Eigen::Vector3d::Zero();  // of a ring
  double count_ = 0;
  std::array<double, kParts> least_{}, crossed_{};
  double rings_ = 0, nearest_ = 0, nearest_of_part_ = 0;
  Eigen::Vector3d mean_ = Eigen::Vector3d::Zero(), square_ = Eigen::Vector3d::Zero();
};

}  // namespace

GapsBeforeBorder::GapsBeforeBorder(std::vector<double> gaps)
    : gaps_(std::move(gaps)), longer_(gaps_.size() + 1) {
  std::sort(gaps_.begin(), gaps_.end());
  for (std::size_t i = gaps_.size(); i > 0; --i) longer_[i - 1] = longer_[i] + gaps_[i - 1];
}

// A border lies in a longer gap more often, and anywhere in it.
double GapsBeforeBorder::Rarity(double missing) const {
  if (missing <= 0 || gaps_.empty()) return 0.0;
  const auto first = std::upper_bound(gaps_.begin(), gaps_.end(), missing) - gaps_.begin();
  const auto i = static_cast<std::size_t>(first);
  const auto count = static_cast<double>(gaps_.size());
  const double part = (longer_[i] - missing * (count - static_cast<double>(i))) / longer_[0];
  return -std::log(std::max(part, 0.5 / count));
}

EndStops::EndStops(std::vector<double> gaps, double smear, double columns_of_line, double hidden) {
  std::sort(gaps.begin(), gaps.end());
  const double longest = gaps.back();
  const auto n = static_cast<double>(gaps.size());
  const double step = 0.25 * smear;
  table_.per_step = 1.0 / step;
  table_.from = -8.0 * smear;
  std::size_t shorter = 0;
  double of_gaps = 0;
  for (double at = table_.from; table_.at.size() < kColumns.most_steps; at += step) {
    const double z = at / smear;
    // So far beyond it the normal distribution is 1 to the last digit.
    const bool is_beyond = z > kColumns.all_of_it;
    const double passes = is_beyond ? 1.0 : 0.5 * std::erfc(-z * std::numbers::sqrt2 / 2.0);
    // Samples are missing up to the plane, where noise moves some of them beyond it.
    const double density =
        is_beyond ? 0.0 : std::exp(-0.5 * z * z) / std::sqrt(2.0 * std::numbers::pi);
    const double missing = smear * (z * passes + density);
    const std::size_t before = shorter;
    while (shorter < gaps.size() && gaps[shorter] < missing) ++shorter;
    if (shorter > before) {
      of_gaps = std::log((n - static_cast<double>(shorter) + 0.5) / (n + 0.5));
    }
    const double beyond = std::max(0.0, missing - longest) / kColumns.beyond_longest;
    const double of_noise = is_beyond ? 0.0 : std::log(std::max(passes, 1e-30));
    const double log = of_noise + of_gaps / columns_of_line - beyond;
    const double least = z > 0 && hidden > 0 ? -hidden : -kColumns.saturated;
    table_.at.push_back(std::max(log, least));
    if (z > 0 && log < least) break;
  }
  table_.at.push_back(table_.at.back());
}

EndColumns::EndColumns(std::span<const EndSample> samples, double window_mm, double smear_mm,
                       bool ahead)
    : ahead_(ahead) {
  const double wanted = static_cast<double>(samples.size()) / kColumns.in_column;
  count_ = std::min(kColumns.most_columns, static_cast<std::size_t>(wanted));
  if (count_ < kColumns.least_columns) {
    count_ = 0;
    return;
  }
  std::vector<std::vector<double>> at(count_);
  for (auto& column : at) column.reserve(samples.size() / count_ * 2);
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
  share_lines_ = Median(apart) < kColumns.one_line;
  if (share_lines_) columns_of_line_ = static_cast<double>(seen_.size());
  std::erase_if(at, [](const std::vector<double>& column) { return column.empty(); });
  at_ = std::move(at);
  gaps_before_ = GapsBeforeBorder(gaps_);
}

// Lines that lie along the border are shared most by a square one: where it may be the border, too,
// it is asked.
void EndColumns::LookAtSharedLines(const Eigen::Vector2d& rise_mm) {
  auto columns = ColumnsOfLine(rise_mm);
  if (rise_mm.norm() < MeanGapMm()) {
    if (const auto square = ColumnsOfLine(Eigen::Vector2d::Zero())) {
      columns = std::max(columns.value_or(1.0), *square);
    }
  }
  if (columns) columns_of_line_ = std::min(*columns, static_cast<double>(seen_.size()));
}

// Rings behind the border, parallel to it, are borders of which all is known. Columns that do not
// know of each other stop before them by chance each; those that the same laser lines cross all
// stop at the last line, so that the nearest of them stops farther off, and all together differ
// more from ring to ring. None: there are too few rings.
std::optional<double> EndColumns::ColumnsOfLine(const Eigen::Vector2d& rise_mm) const {
  std::vector<Eigen::Vector2d> directions;
  std::vector<double> off_mm;
  double last_mm = 1e300, first_mm = 1e300;
  for (std::size_t k = 0; k < seen_.size(); ++k) {
    const double around = seen_[k].around_rad;
    directions.emplace_back(std::cos(around), std::sin(around));
    off_mm.push_back(rise_mm.dot(directions.back()));
    last_mm = std::min(last_mm, at_[k].back() - off_mm[k]);
    first_mm = std::min(first_mm, at_[k].front() - off_mm[k]);
  }
  RingSums sums;
  for (int ring = 0; ring < kColumns.rings; ++ring) {
    const double ring_mm = last_mm + (first_mm - last_mm) * ring / kColumns.rings;
    sums.Begin();
    for (std::size_t k = 0; k < seen_.size(); ++k) {
      const double here_mm = ring_mm + off_mm[k];
      const auto next = std::upper_bound(at_[k].begin(), at_[k].end(), here_mm);
      if (next == at_[k].begin() || next == at_[k].end()) continue;
      const double missing = (here_mm - *(next - 1)) / seen_[k].mean_gap_mm;
      sums.Add(gaps_before_.Rarity(missing), directions[k],
               static_cast<double>(k) / static_cast<double>(seen_.size()));
    }
    if (sums.count() >= kColumns.least_crossed * static_cast<double>(seen_.size())) sums.End();
  }
  if (sums.rings() < kColumns.least_rings) return std::nullopt;
  return sums.Columns();
}

double EndColumns::width_rad() const {
  return 2.0 * std::numbers::pi / static_cast<double>(count_);
}

bool EndColumns::AreEnough() const {
  return seen_.size() >= 6 &&
         static_cast<double>(seen_.size()) >= kColumns.least_seen * static_cast<double>(count_);
}

double EndColumns::MeanGapMm() const {
  std::vector<double> gaps_mm;
  for (const EndColumn& column : seen_) gaps_mm.push_back(column.mean_gap_mm);
  return Median(std::move(gaps_mm));
}

// `at`: becomes sorted, and what lies beyond where the column stops or before its window goes.
void EndColumns::Take(std::size_t k, double window_mm, double smear_mm, std::vector<double>& at) {
  std::sort(at.begin(), at.end());
  const auto mean_gap = [&] {
    const double from = std::max(at.front(), at.back() - window_mm);
    const auto first = std::lower_bound(at.begin(), at.end(), from);
    return (at.back() - *first) /
           static_cast<double>(std::max<std::ptrdiff_t>(1, at.end() - first - 1));
  };
  while (at.size() >= kColumns.least_in_column &&
         at.back() - at[at.size() - 2] > kColumns.lone_gap * mean_gap()) {
    at.pop_back();
  }
  if (at.size() >= kColumns.least_in_column) {
    at.erase(at.begin(), std::lower_bound(at.begin(), at.end(), at.back() - window_mm));
  }
  const double mean_gap_mm = at.empty() ? 0.0 : mean_gap();
  if (at.size() < kColumns.least_in_column || !(mean_gap_mm > 0)) {
    at.clear();
    return;
  }
  for (std::size_t i = 1; i < at.size(); ++i) gaps_.push_back((at[i] - at[i - 1]) / mean_gap_mm);
  const double turn = (static_cast<double>(k) + 0.5) * width_rad();
  EndColumn& column = seen_.emplace_back();
  column.around_rad = turn;
  column.last_mm = at.back();
  column.mean_gap_mm = mean_gap_mm;
  const auto pattern = FindLinePattern(at);
  const auto is_ahead = [&] {
    return pattern->next_mm > pattern->last_mm + kColumns.ahead * pattern->scatter_mm;
  };
  if (pattern && (!ahead_ || is_ahead())) {
    const double last_sigma_mm =
        smear_mm / std::sqrt(static_cast<double>(pattern->samples_of_last));
    column.last_mm = pattern->last_mm;
    column.lines = {turn, pattern->last_mm, last_sigma_mm,
                    turn, pattern->next_mm, std::hypot(last_sigma_mm, pattern->scatter_mm)};
  }
}

// A column's few gaps tell their mean roughly; those beside it see about as many samples.
void EndColumns::Smooth() {
  std::vector<double> mean_mm(seen_.size());
  const std::size_t n = seen_.size();
  for (std::size_t k = 0; k < n; ++k) {
    for (std::size_t i = n - 2; i <= n + 2; ++i) mean_mm[k] += seen_[(k + i) % n].mean_gap_mm / 5.0;
  }
  for (std::size_t k = 0; k < n; ++k) seen_[k].mean_gap_mm = mean_mm[k];
}

}  // namespace bendloop::pipeline
