// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/end_lines.h"

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <utility>

#include "pipeline/features/pass_lines.h"
#include "pipeline/math/quantiles.h"

namespace bendloop::pipeline {
namespace {

struct LineSettings {
  // Of the length-weighted mean gap: samples nearer to each other are of one laser line.
  double one_crossing = 0.25;
  // Of their length: how much rounds of lines differ; those of scattered samples differ by the root
  // of their number, 0.4 of six. By trial.
  double even = 0.12;
  std::size_t most_period = 6;
  // Of the usual gap: how much those of one sweep differ; of passes that nobody knows, which come
  // one between the other. By trial: a hand's do by a tenth, and of scattered samples a third do
  // not differ by more than the former.
  double even_gap = 0.45, even_gap_of_all = 0.2;
  // Of the places where lines cross strips.
  double most_lost = 0.1;
  // Lines of a strip that tell of the next: the hand's pace changes.
  std::size_t most_lines = 14;
  // Strips of a pass, tried from the most on: as narrow as its rays lie apart, they are crossed by
  // every line.
  std::array<std::size_t, 8> strips = {96, 64, 48, 32, 24, 16, 12, 8};
  // Of the strips with samples: so many are crossed evenly, or the strips are too narrow.
  double least_even = 0.85;
  std::size_t least_lines = 5;
  // A pass whose directions from the axis have a shorter mean went round the tube; seen from one
  // side it is pi / 4.
  double one_sided = 0.3;
  // [of r_P] From the middle of a pass: further aside, rays come in along the wall.
  double limb = 0.97;
  // Of how far the wall comes in: so near to the least radius is the tip.
  double tip = 0.25;
};
constexpr LineSettings kLines;

// A sample of a strip, by its place among all.
struct Placed {
  double at_mm = 0;  // beyond the end
  std::uint32_t index = 0;
};

// A line in a strip: mean place of its samples.
struct LineCrossing {
  double at_mm = 0;
  std::size_t first = 0, samples = 0;  // of the strip
};

double AtMm(double at_mm) { return at_mm; }
double AtMm(const Placed& sample) { return sample.at_mm; }

template <class At>
double OneLineMm(std::span<const At> at) {
  double sum = 0, sum2 = 0;
  for (std::size_t i = 1; i < at.size(); ++i) {
    const double gap = AtMm(at[i]) - AtMm(at[i - 1]);
    sum += gap;
    sum2 += gap * gap;
  }
  return kLines.one_crossing * sum2 / std::max(sum, 1e-12);
}

// Of lines in their order: the shortest period after which all comes again.
std::optional<LinePattern> PatternOf(std::span<const double> lines) {
  const std::size_t n = lines.size();
  for (std::size_t period = 1; period <= kLines.most_period && n >= 2 * period + 4; ++period) {
    const auto count = static_cast<double>(n - period);
    double mean = 0, square = 0;
    for (std::size_t i = 0; i + period < n; ++i) {
      const double length = lines[i + period] - lines[i];
      mean += length / count;
      square += length * length / count;
    }
    const double scatter = std::sqrt(std::max(0.0, square - mean * mean));
    if (scatter > kLines.even * mean) continue;
    return LinePattern{lines.back(), lines[n - period] + mean, mean, scatter, 1};
  }
  return std::nullopt;
}

// The samples of a pass in the narrowest strips; wider ones are several of these.
class Strips {
 public:
  // So many that each number of strips to try is a part of it.
  static constexpr std::size_t kNarrowest = 192;

  explicit Strips(std::span<const EndSample> samples) {
    Eigen::Vector2d view = Eigen::Vector2d::Zero();
    double narrowest = 1.0;
    for (const EndSample& sample : samples) {
      view += sample.Direction();
      narrowest = std::min(narrowest, sample.of_radius);
    }
    from_one_side_ = view.norm() > kLines.one_sided * static_cast<double>(samples.size());
    view.normalize();
    if (narrowest < 1.0) LookAtTip(samples, view, narrowest);
    Part(samples, view);
  }
  bool from_one_side() const { return from_one_side_; }
  // The samples of strip `k` of `count`, by place along the tube; until the next is asked for.
  std::span<const Placed> Of(std::size_t k, std::size_t count) {
    const std::size_t together = kNarrowest / count, first = k * together;
    for (std::size_t i = first; i < first + together; ++i) Sort(i);
    if (together == 1) return {placed_.data() + begin_[k], begin_[k + 1] - begin_[k]};
    merged_.assign(placed_.begin() + begin_[first], placed_.begin() + begin_[first + together]);
    other_.resize(merged_.size());
    // Neighbours in pairs, then these.
    for (std::size_t width = 1; width < together; width *= 2) {
      for (std::size_t i = 0; i < together; i += 2 * width) {
        const auto at = [&](std::size_t strip) {
          return static_cast<std::ptrdiff_t>(begin_[first + std::min(strip, together)] -
                                             begin_[first]);
        };
        std::merge(merged_.begin() + at(i), merged_.begin() + at(i + width),
                   merged_.begin() + at(i + width), merged_.begin() + at(i + 2 * width),
                   other_.begin() + at(i), IsBefore);
      }
      merged_.swap(other_);
    }
    return merged_;
  }

 private:
  static bool IsBefore(const Placed& a, const Placed& b) { return a.at_mm < b.at_mm; }
  // The samples by strips, one behind the other.
  void Part(std::span<const EndSample> samples, const Eigen::Vector2d& view) {
    std::vector<std::uint8_t> strip_of(samples.size(), kNarrowest);
    std::array<std::uint32_t, kNarrowest + 1> count{};
    for (std::size_t i = 0; i < samples.size(); ++i) {
      const double place = PlaceOf(samples[i], view);
      if (place < 0) continue;
      const auto k = static_cast<std::size_t>(place * static_cast<double>(kNarrowest));
      strip_of[i] = static_cast<std::uint8_t>(std::min(k, kNarrowest - 1));
      ++count[strip_of[i]];
    }
    for (std::size_t k = 0; k < kNarrowest; ++k) begin_[k + 1] = begin_[k] + count[k];
    placed_.resize(begin_[kNarrowest]);
    std::array<std::uint32_t, kNarrowest + 1> next = begin_;
    for (std::size_t i = 0; i < samples.size(); ++i) {
      if (strip_of[i] == kNarrowest) continue;
      placed_[next[strip_of[i]]++] = {samples[i].beyond_mm, static_cast<std::uint32_t>(i)};
    }
  }
  // When they are asked for: of scattered samples the first few say that they are no lines.
  void Sort(std::size_t k) {
    if (!is_sorted_[k]) {
      std::sort(placed_.begin() + begin_[k], placed_.begin() + begin_[k + 1], IsBefore);
    }
    is_sorted_[k] = true;
  }
  // [of r_P] Rays lie evenly across the view, also where the wall has come in.
  static double Aside(const EndSample& sample, const Eigen::Vector2d& view) {
    const Eigen::Vector2d direction = sample.Direction();
    return (view.x() * direction.y() - view.y() * direction.x()) * sample.of_radius;
  }
  // Where the wall has come in, lines end further inward than before: beside that no strip tells
  // where the last one is.
  void LookAtTip(std::span<const EndSample> samples, const Eigen::Vector2d& view,
                 double narrowest) {
    const double tip = narrowest + kLines.tip * (1.0 - narrowest);
    double reach = 0;
    for (const EndSample& sample : samples) {
      if (sample.of_radius > tip) continue;
      reach = std::max(reach, std::abs(Aside(sample, view)));
    }
    limb_ = std::min(limb_, kLines.limb * reach);
  }
  // [0, 1): rays lie evenly there. Less than 0: at the limb.
  double PlaceOf(const EndSample& sample, const Eigen::Vector2d& view) const {
    if (!from_one_side_) {
      const double turn = sample.around_rad * 0.5 / std::numbers::pi;
      return turn - std::floor(turn);
    }
    const double aside = Aside(sample, view) / limb_;
    return view.dot(sample.Direction()) > 0 && std::abs(aside) < 1 ? 0.5 + 0.5 * aside : -1.0;
  }

  bool from_one_side_ = true;
  double limb_ = kLines.limb;
  std::vector<Placed> placed_;                         // strip by strip
  std::array<std::uint32_t, kNarrowest + 1> begin_{};  // of each
  std::array<bool, kNarrowest> is_sorted_{};
  std::vector<Placed> merged_, other_;
};

// Lines of a strip, the last ones only. `strip`: by place along the tube; `crossings`: has room.
void FindCrossings(std::span<const Placed> strip, std::vector<LineCrossing>& crossings) {
  const double one_line_mm = OneLineMm(strip);
  crossings.clear();
  for (std::size_t i = strip.size(); i > 0 && crossings.size() < kLines.most_lines;) {
    LineCrossing crossing;
    std::size_t k = i;
    for (; k > 0 && (k == i || strip[k].at_mm - strip[k - 1].at_mm < one_line_mm); --k) {
      crossing.at_mm += strip[k - 1].at_mm;
    }
    crossing.first = k;
    crossing.samples = i - k;
    crossing.at_mm /= static_cast<double>(crossing.samples);
    crossings.push_back(crossing);
    i = k;
  }
  std::reverse(crossings.begin(), crossings.end());
}

// As the remainder has it, which costs more than all the rest.
double LessThanHalfATurn(double off_rad) {
  return std::abs(off_rad) <= std::numbers::pi ? off_rad
                                               : std::remainder(off_rad, 2.0 * std::numbers::pi);
}

// Around: the mean of its samples, from the last of them, so that no turn ends within.
double AroundRad(const LineCrossing& crossing, std::span<const Placed> strip,
                 std::span<const EndSample> samples) {
  const std::size_t end = crossing.first + crossing.samples;
  const double zero_rad = samples[strip[end - 1].index].around_rad;
  double sum = 0;
  for (std::size_t k = end; k > crossing.first; --k) {
    sum += LessThanHalfATurn(samples[strip[k - 1].index].around_rad - zero_rad);
  }
  return zero_rad + sum / static_cast<double>(crossing.samples);
}

// Lines of one sweep: a gap after the other, but for one longer gap at most (a hole, a lost ray).
struct Sweep {
  double gap_mm = 0;
  double scatter_mm = 0;  // 1 sigma of a gap
};
std::optional<Sweep> SweepOf(std::span<const LineCrossing> crossings, double even_gap) {
  if (crossings.size() < kLines.least_lines) return std::nullopt;
  std::vector<double> gaps_mm;
  gaps_mm.reserve(crossings.size() - 1);
  for (std::size_t i = 1; i < crossings.size(); ++i) {
    gaps_mm.push_back(crossings[i].at_mm - crossings[i - 1].at_mm);
  }
  const double usual_mm = Median(gaps_mm);
  double count = 0, sum = 0, square = 0;
  for (const double gap_mm : gaps_mm) {
    const double off_mm = gap_mm - usual_mm;
    if (std::abs(off_mm) > even_gap * usual_mm) continue;
    count += 1;
    sum += off_mm;
    square += off_mm * off_mm;
  }
  if (count + 1 < static_cast<double>(gaps_mm.size())) return std::nullopt;
  const double mean = sum / count;
  return Sweep{usual_mm + mean, std::sqrt(std::max(0.0, square / count - mean * mean))};
}

bool MayBeFace(const LineCrossing& crossing, std::span<const Placed> strip,
               std::span<const EndSample> samples) {
  const auto own = strip.subspan(crossing.first, crossing.samples);
  return std::all_of(own.begin(), own.end(),
                     [&](const Placed& sample) { return samples[sample.index].may_be_face; });
}

// What a strip says, and where lines cross it.
struct StripOfLines {
  LineBracket bracket;
  std::vector<StripCrossing> crossings;
};
std::optional<StripOfLines> BracketOf(std::span<const Placed> strip,
                                      std::span<const EndSample> samples, double smear_mm,
                                      double even_gap, std::vector<LineCrossing>& crossings) {
  FindCrossings(strip, crossings);
  const auto sweep = SweepOf(crossings, even_gap);
  if (!sweep) return std::nullopt;
  // A line that meets the face of the cut has passed the border; what may have is left open.
  const LineCrossing &beyond = crossings.back(), &last = MayBeFace(beyond, strip, samples)
                                                             ? crossings[crossings.size() - 2]
                                                             : beyond;
  StripOfLines found;
  LineBracket& bracket = found.bracket;
  bracket.last_rad = AroundRad(last, strip, samples);
  bracket.last_mm = last.at_mm;
  // Even lines say that noise does not move them as far as it might.
  const auto sigma_mm = [&](const LineCrossing& of) {
    return std::min(smear_mm / std::sqrt(static_cast<double>(of.samples)),
                    sweep->scatter_mm / std::numbers::sqrt2);
  };
  bracket.last_sigma_mm = sigma_mm(last);
  double around = 0;
  for (const LineCrossing& crossing : crossings) {
    const double around_rad = AroundRad(crossing, strip, samples);
    around += LessThanHalfATurn(around_rad - bracket.last_rad);
    found.crossings.push_back(
        {crossing.at_mm, {std::cos(around_rad), std::sin(around_rad)}, sigma_mm(crossing)});
  }
  bracket.next_rad = bracket.last_rad + around / static_cast<double>(crossings.size());
  bracket.next_mm = beyond.at_mm + sweep->gap_mm;
  bracket.next_sigma_mm = std::hypot(bracket.last_sigma_mm, sweep->scatter_mm);
  return found;
}

// The brackets of strips side by side, by what all of them say of each line; without those that
// have lost their last one. None: so many lines are not seen in strips that they cross that these
// are too narrow.
std::optional<std::vector<LineBracket>> Together(std::vector<StripOfLines> strips) {
  std::vector<std::vector<StripCrossing>> crossings;
  for (StripOfLines& strip : strips) crossings.push_back(std::move(strip.crossings));
  const PassLines lines(std::move(crossings));
  if (lines.lost_part() > kLines.most_lost) return std::nullopt;
  std::vector<LineBracket> brackets;
  std::vector<std::size_t> shared;
  for (std::size_t k = 0; k < strips.size(); ++k) {
    if (lines.HasLostNext(k)) continue;
    LineBracket& bracket = brackets.emplace_back(strips[k].bracket);
    const auto next = lines.After(k);
    if (!next) continue;
    bracket.next_mm = next->at_mm;
    bracket.next_sigma_mm = next->sigma_mm;
    if (!next->is_shared) continue;
    bracket.next_is_whole = true;
    shared.push_back(brackets.size() - 1);
  }
  // The outermost ones and those between.
  for (std::size_t i = 1; i < shared.size(); ++i) {
    const std::size_t parts = kToldOfNext - 1, last = shared.size() - 1;
    brackets[shared[i]].next_is_told = (i * parts) / last == ((i - 1) * parts) / last;
  }
  return brackets;
}

// The same where lines of other passes lie between.
std::optional<std::vector<LineBracket>> Apart(std::span<const StripOfLines> strips) {
  std::vector<LineBracket> brackets;
  for (const StripOfLines& strip : strips) brackets.push_back(strip.bracket);
  return brackets;
}

// Without those whose last line the strips beside it do not miss: a ray was lost there.
std::vector<LineBracket> WithoutLost(std::span<const LineBracket> brackets) {
  std::vector<LineBracket> kept;
  for (std::size_t k = 0; k < brackets.size(); ++k) {
    const LineBracket& own = brackets[k];
    const double later_mm = own.last_mm + 0.5 * (own.next_mm - own.last_mm);
    const bool before = k == 0 || brackets[k - 1].last_mm > later_mm;
    const bool after = k + 1 == brackets.size() || brackets[k + 1].last_mm > later_mm;
    if (!before || !after) kept.push_back(own);
  }
  return kept;
}

}  // namespace

std::optional<LinePattern> FindLinePattern(std::span<const double> at) {
  const double one_line_mm = OneLineMm(at);
  std::vector<double> lines;
  std::size_t samples_of_last = 1;
  for (std::size_t i = 0; i < at.size();) {
    double middle = 0;
    std::size_t end = i;
    for (; end < at.size() && (end == i || at[end] - at[end - 1] < one_line_mm); ++end)
      middle += at[end];
    samples_of_last = end - i;
    lines.push_back(middle / static_cast<double>(samples_of_last));
    i = end;
  }
  auto pattern = PatternOf(lines);
  if (pattern) pattern->samples_of_last = samples_of_last;
  return pattern;
}

std::vector<LineBracket> FindLineBrackets(std::span<const EndSample> samples, double window_mm,
                                          double smear_mm, bool knows_passes) {
  Strips strips(samples);
  const bool is_one_pass = knows_passes && strips.from_one_side();
  const double even_gap = is_one_pass ? kLines.even_gap : kLines.even_gap_of_all;
  std::vector<LineCrossing> crossings;  // of a strip, for its room
  for (const std::size_t count : kLines.strips) {
    std::vector<StripOfLines> found;
    std::size_t with_samples = 0;
    // As soon as too many are not even, the others need no look.
    const double most_uneven = (1.0 - kLines.least_even) * static_cast<double>(count);
    for (std::size_t k = 0; k < count; ++k) {
      if (static_cast<double>(with_samples - found.size()) > most_uneven) break;
      const std::span<const Placed> strip = strips.Of(k, count);
      if (strip.empty()) continue;
      const double from_mm = strip.back().at_mm - window_mm;
      const auto first = std::partition_point(
          strip.begin(), strip.end(), [&](const Placed& sample) { return sample.at_mm < from_mm; });
      const std::span<const Placed> own(first, strip.end());
      if (own.size() < kLines.least_lines) continue;
      ++with_samples;
      if (auto strip_of = BracketOf(own, samples, smear_mm, even_gap, crossings)) {
        found.push_back(std::move(*strip_of));
      }
    }
    if (static_cast<double>(found.size()) >=
        kLines.least_even * static_cast<double>(with_samples)) {
      const auto brackets = is_one_pass ? Together(std::move(found)) : Apart(found);
      if (brackets) return WithoutLost(*brackets);
    }
  }
  return {};
}

}  // namespace bendloop::pipeline
