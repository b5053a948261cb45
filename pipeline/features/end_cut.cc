// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/end_cut.h"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <map>
#include <numbers>
#include <vector>

#include "hal/angles.h"
#include "pipeline/features/end_border.h"
#include "pipeline/features/end_columns.h"
#include "pipeline/features/posterior.h"
#include "pipeline/features/sampling.h"
#include "pipeline/math/dense_solve.h"
#include "pipeline/math/quantiles.h"
#include "pipeline/math/simd.h"

namespace bendloop::pipeline {
namespace {

struct EndCutSettings {
  // [of r_P] From the border into the tube: where the gaps between samples are looked at; and how
  // far beyond the end that was found the long side of a cut may lie. By trial.
  double window = 3.0, beyond = 2.0;
  // Of the turn: a plane is not told by lines that cross less.
  double least_seen = 0.3;
  std::size_t sectors = 24, least_brackets = 6;
  // Of the mean gap: a border that rises by less across a column is level in it.
  double level = 0.25;
  // Columns that stand against a plane by more count no further [-log likelihood]: something lies
  // on the tube there, or hides it.
  double saturated = 12.0;
  // Of the rays that meet the wall: so many return nothing.
  double lost = 0.05;
  // Slopes before the scan, 1 sigma: any that a saw makes. Samples that leave more than a tenth of
  // it open tell nothing of the cut; its pull on others is below a hundredth of their sigma's
  // reach.
  double usual_slope = 0.5;
  // Of all columns: so many may a laser line cross, which sees one side of the tube.
  double crossed = 0.5;
  // [sigma] From a square cut; closer ones are taken for it.
  double oblique = 5.0;
  // Steps of the walk, and of one that says whether the end may be oblique at all, from so many
  // sigma on.
  int walk = 1500, short_walk = 500;
  double may_be_oblique = 2.5;
  // [of the mean gap] The walk's first steps.
  double first_step = 0.1;
  // Samples of an end: so many tell where about the plane is, and then all that lie beside it are
  // asked (end_border.h); laser lines should have theirs whole.
  std::size_t enough_samples = 12'000, enough_of_lines = 40'000;
  // [of the mean gap] Lines are blurred by so much, one after the other, before they are taken as
  // they are: what they leave free may be a needle, which a walk finds only by and by.
  std::array<double, 4> blurs = {0.3, 0.1, 0.03, 0.01};
  int blurred_walk = 250;
  double far = 6.0;  // [sigma]
  // Of the variance after the last blur: less is none.
  double least_moved = 1e-3;
  // [of the mean gap] Sides that are contradicted by more, and how many of all may be.
  double wrong = 0.1, most_wrong = 0.15;
};
constexpr EndCutSettings kCut;

// A table of even steps: `places` count them, and become what is said there, straight between two.
BENDLOOP_LOOP void LookUpBody(const double* table, double last, std::size_t count, double* places) {
  for (std::size_t i = 0; i < count; ++i) {
    double place = places[i] > 0 ? places[i] : 0.0;
    place = place < last ? place : last;
    const int at = static_cast<int>(place);
    places[i] = table[at] + (place - at) * (table[at + 1] - table[at]);
  }
}
BENDLOOP_MULTIVERSION(void, LookUp,
                      (const double* table, double last, std::size_t count, double* places),
                      (table, last, count, places))

// The logarithm of the normal distribution and of a part that is always there, from a table.
class LogNormalCdf {
 public:
  explicit LogNormalCdf(double floor) {
    for (std::size_t i = 0; i < kSize; ++i) {
      const double z = kFrom + kStep * static_cast<double>(i);
      table_[i] = std::log(floor + (1.0 - floor) * 0.5 * std::erfc(-z * std::numbers::sqrt2 / 2.0));
    }
    table_[kSize] = table_[kSize - 1];
  }
  // The sum over sigmas, which are lost.
  double Sum(std::span<double> z) const {
    for (double& of : z) of = (of - kFrom) * (1.0 / kStep);
    LookUp(table_.data(), static_cast<double>(kSize - 1), z.size(), z.data());
    double sum = 0;
    for (const double log : z) sum += log;
    return sum;
  }

 private:
  static constexpr std::size_t kSize = 481;
  static constexpr double kFrom = -6.0, kStep = 0.025;
  std::array<double, kSize + 1> table_{};
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

// Numbers of several sides side by side, for loops that take some of them at once.
struct SideLanes {
  std::vector<double> cosine, sine, at, scale;  // scale: 1 / sigma, negative before the plane
  std::vector<double> clear;                    // in sigmas, or mean gaps

  void Add(double c, double s, double at_mm, double by) {
    cosine.push_back(c);
    sine.push_back(s);
    at.push_back(at_mm);
    scale.push_back(by);
    clear.push_back(0.0);
  }
};
BENDLOOP_LOOP void FindClearBody(double x0, double x1, double x2, double more, std::size_t count,
                                 const double* cosine, const double* sine, const double* at,
                                 const double* scale, double* clear) {
  for (std::size_t i = 0; i < count; ++i) {
    clear[i] = (x0 + cosine[i] * x1 + sine[i] * x2 - at[i]) * scale[i] + more;
  }
}
BENDLOOP_MULTIVERSION(void, FindClear,
                      (double x0, double x1, double x2, double more, std::size_t count,
                       const double* cosine, const double* sine, const double* at,
                       const double* scale, double* clear),
                      (x0, x1, x2, more, count, cosine, sine, at, scale, clear))

// A place around the end that says whether the plane lies beyond, or before it.
struct EndSide {
  double cosine = 1, sine = 0, at_mm = 0;
  double sigma_mm = 0;
  bool is_beyond = true;  // the plane lies beyond

  // How far the plane is on the right side [mm].
  double Clear(const Eigen::Vector3d& x) const {
    const double off = x[0] + cosine * x[1] + sine * x[2] - at_mm;
    return is_beyond ? off : -off;
  }
};

// A column of scattered samples.
struct Stop {
  double cosine = 1, sine = 0, last_mm = 0, mean_gap_mm = 1;
};

// What is known of an end, for all planes x: at the axis, and by how much it rises towards cosine
// and sine, all in mm.
struct Evidence {
  std::vector<EndSide> sides;  // of laser lines
  double lines_greatest = 0;   // GreatestError
  std::vector<Stop> columns;   // of scattered samples
  std::optional<EndStops> stops;
  double gap_mm = 0;  // mean gap between samples
  LogNormalCdf hit{std::exp(-kCut.saturated)}, missed{kCut.lost};

  void AddLines(const LineBracket& lines) {
    for (const bool is_beyond : {true, false}) {
      const double around = is_beyond ? lines.last_rad : lines.next_rad;
      sides.push_back({std::cos(around), std::sin(around),
                       is_beyond ? lines.last_mm : lines.next_mm,
                       is_beyond ? lines.last_sigma_mm : lines.next_sigma_mm, is_beyond});
    }
  }
};

// The logarithm of the likelihood of planes.
class PlaneLikelihood {
 public:
  // `blur_mm`: laser lines are as uncertain as this, at least.
  PlaneLikelihood(const Evidence& evidence, double blur_mm) : evidence_(evidence) {
    for (const EndSide& side : evidence.sides) {
      const double scale = 1.0 / std::max(side.sigma_mm, blur_mm);
      (side.is_beyond ? hits_ : missed_)
          .Add(side.cosine, side.sine, side.at_mm, side.is_beyond ? scale : -scale);
    }
    for (const Stop& stop : evidence.columns) {
      stops_.Add(stop.cosine, stop.sine, stop.last_mm, 1.0 / stop.mean_gap_mm);
    }
  }
  double Log(const Eigen::VectorXd& x) {
    const double greatest = evidence_.lines_greatest;
    const double sum = evidence_.hit.Sum(ClearOf(hits_, x, greatest)) +
                       evidence_.missed.Sum(ClearOf(missed_, x, greatest));
    if (!evidence_.stops) return sum;
    double of_stops = 0;
    for (const double clear : ClearOf(stops_, x, 0.0)) of_stops += (*evidence_.stops)(clear);
    return sum + of_stops;
  }

 private:
  static std::span<double> ClearOf(SideLanes& lanes, const Eigen::VectorXd& x, double more) {
    FindClear(x[0], x[1], x[2], more, lanes.at.size(), lanes.cosine.data(), lanes.sine.data(),
              lanes.at.data(), lanes.scale.data(), lanes.clear.data());
    return lanes.clear;
  }

  const Evidence& evidence_;
  SideLanes hits_, missed_, stops_;
};

// Without the sides that every plane of a density is far on the right side of: they say no more.
void Forget(const Posterior& planes, double blur_mm, Evidence& evidence) {
  std::erase_if(evidence.sides, [&](const EndSide& side) {
    const Eigen::Vector3d row(1.0, side.cosine, side.sine);
    const double spread_mm = std::sqrt(std::max(0.0, row.dot(planes.covariance * row)));
    return side.Clear(planes.mean) > kCut.far * (spread_mm + std::max(side.sigma_mm, blur_mm));
  });
}

// Where the plane roughly is: least squares that leave out what lies far off.
Eigen::Vector3d RoughPlane(const Evidence& evidence, double r_mm) {
  struct Target {
    Eigen::Vector3d row;
    double at_mm;
  };
  std::vector<Target> targets;
  std::vector<double> ends;
  for (std::size_t i = 0; i + 1 < evidence.sides.size(); i += 2) {
    const EndSide &last = evidence.sides[i], &next = evidence.sides[i + 1];
    targets.push_back({{1.0, last.cosine, last.sine}, 0.5 * (last.at_mm + next.at_mm)});
  }
  for (const Stop& stop : evidence.columns) {
    targets.push_back({{1.0, stop.cosine, stop.sine}, stop.last_mm + 0.5 * stop.mean_gap_mm});
  }
  for (const Target& target : targets) ends.push_back(target.at_mm);
  Eigen::Vector3d plane(Median(ends), 0.0, 0.0);
  double reach_mm = 0.5 * r_mm;
  for (int i = 0; i < 10; ++i) {
    Eigen::Matrix3d matrix = 1e-3 * Eigen::Vector3d(1e-9, 1.0, 1.0).asDiagonal();
    Eigen::Vector3d right = Eigen::Vector3d::Zero();
    std::vector<double> off;
    for (const Target& target : targets) {
      const double residual = target.at_mm - target.row.dot(plane);
      off.push_back(std::abs(residual));
      if (off.back() >= reach_mm) continue;
      const double weight = std::pow(1.0 - std::pow(residual / reach_mm, 2), 2);
      matrix += weight * target.row * target.row.transpose();
      right += weight * target.at_mm * target.row;
    }
    plane = SolveSymmetric(matrix, right);
    reach_mm = std::max(6.0 * Median(off), 0.02 * r_mm);
  }
  return plane;
}

// The laser lines of all passes, where they cross enough of the turn.
std::optional<Evidence> LookAtLines(std::span<const EndSample> samples, double r_mm,
                                    double window_mm, double smear_mm, double sigma_mm) {
  std::map<unsigned, std::vector<EndSample>> passes;
  for (const EndSample& sample : samples) passes[sample.pass].push_back(sample);
  Evidence evidence;
  std::vector<bool> seen(kCut.sectors);
  std::vector<double> gaps_mm;
  std::size_t most = 0;
  for (const auto& [pass, own] : passes) {
    const auto brackets = FindLineBrackets(own, window_mm, smear_mm);
    most = std::max(most, brackets.size());
    for (const LineBracket& lines : brackets) {
      evidence.AddLines(lines);
      gaps_mm.push_back(lines.next_mm - lines.last_mm);
      const double turn = lines.last_rad / (2.0 * std::numbers::pi);
      const double sector = (turn - std::floor(turn)) * static_cast<double>(kCut.sectors);
      seen[std::min(kCut.sectors - 1, static_cast<std::size_t>(sector))] = true;
    }
  }
  const auto sectors = std::count(seen.begin(), seen.end(), true);
  if (gaps_mm.size() < kCut.least_brackets ||
      static_cast<double>(sectors) < kCut.least_seen * static_cast<double>(kCut.sectors)) {
    return std::nullopt;
  }
  evidence.gap_mm = Median(std::move(gaps_mm));
  evidence.lines_greatest = GreatestError(static_cast<double>(most));
  // Noise moves samples around the tube, too, where an oblique border goes along it.
  const Eigen::Vector3d rough = RoughPlane(evidence, r_mm);
  const double around_mm = sigma_mm * rough.tail<2>().norm() / r_mm;
  for (EndSide& side : evidence.sides) {
    side.sigma_mm = std::max(std::hypot(side.sigma_mm, around_mm), kSampling.least * r_mm);
  }
  return evidence;
}

// All samples in columns, about a rough plane so that the border is level within each; the plane's
// slope goes to `slope_mm`.
std::optional<Evidence> LookAtColumns(std::span<const EndSample> samples, double r_mm,
                                      double window_mm, double smear_mm,
                                      Eigen::Vector2d& slope_mm) {
  const std::size_t stride = StrideTo(samples.size(), kCut.enough_samples);
  std::vector<EndSample> enough;
  for (std::size_t i = 0; i < samples.size(); i += stride) enough.push_back(samples[i]);
  std::optional<Evidence> evidence;
  for (int pass = 0; pass < 3; ++pass) {
    const EndColumns columns(Levelled(enough, slope_mm), window_mm, smear_mm);
    if (!columns.AreEnough()) return std::nullopt;
    evidence.emplace();
    for (const EndColumn& column : columns.seen()) {
      if (column.lines) {
        evidence->AddLines(*column.lines);
        continue;
      }
      evidence->columns.push_back({std::cos(column.around_rad), std::sin(column.around_rad),
                                   column.last_mm, column.mean_gap_mm});
    }
    evidence->gap_mm = columns.MeanGapMm();
    evidence->stops = columns.MakeStops(smear_mm);
    evidence->lines_greatest =
        GreatestError(kCut.crossed * static_cast<double>(columns.seen().size()));
    const Eigen::Vector2d rise_mm = RoughPlane(*evidence, r_mm).tail<2>();
    if (pass == 2 || rise_mm.norm() * columns.width_rad() < kCut.level * evidence->gap_mm) break;
    slope_mm += rise_mm;
  }
  return evidence;
}

// Samples of the tube near one of its ends, all of them; how far around the tube is asked only of
// those that are taken.
class SamplesNear {
 public:
  SamplesNear(const hal::Tube& tube, bool at_start, const EndAxis& axis, double sigma_mm,
              double window_mm, std::span<const PointBlock> blocks) {
    const auto segments = hal::SpineSegments(tube.program, tube.X_WT);
    const std::size_t at = at_start ? 0 : segments.size() - 1;
    const hal::SpineSegment& straight = segments[at];
    const Eigen::Vector3d &end = axis.end_mm, &outward = axis.outward;
    const Eigen::Vector3d tangent = at_start ? Eigen::Vector3d(-outward) : outward;
    const Eigen::Vector3d quarter = tangent.cross(hal::AroundZero(segments, at)).normalized();
    const Eigen::Vector3d zero = quarter.cross(tangent);
    const double r_mm = tube.pipe_radius_mm, reach_mm = kSampling.on_surface * sigma_mm;
    const double beyond_mm = kCut.beyond * r_mm;
    const double around_mm = std::hypot(std::max(window_mm + r_mm, beyond_mm), 1.5 * r_mm);
    const double least_mm = std::max(0.0, r_mm - reach_mm), most_mm = r_mm + reach_mm;
    const double from_mm = std::max(-window_mm - r_mm, -straight.length_mm);
    for (const PointBlock& block : blocks) {
      const double near_mm = around_mm + block.half_diagonal_mm;
      if ((block.center_mm - end).squaredNorm() > near_mm * near_mm) continue;
      for (std::size_t i = 0; i < block.points.size(); ++i) {
        const Eigen::Vector3d from = block.points[i] - end;
        const double at_mm = from.dot(outward);
        if (at_mm < from_mm || at_mm > beyond_mm) continue;
        const double x = from.dot(zero), y = from.dot(quarter);
        const double square = x * x + y * y;
        if (square > most_mm * most_mm || square < least_mm * least_mm) continue;
        const bool known = i < block.to_sensor.size() && block.to_sensor[i].known();
        all_.push_back({x, y, at_mm, known ? PassOf(block.to_sensor[i]) : kMostPasses});
      }
    }
  }

  std::size_t size() const { return all_.size(); }
  // Every so many of them.
  std::vector<EndSample> Every(std::size_t stride) const {
    std::vector<EndSample> samples;
    samples.reserve(all_.size() / stride + 1);
    for (std::size_t i = 0; i < all_.size(); i += stride) samples.push_back(all_[i].Sample());
    return samples;
  }
  // Those from `below_mm` before a plane to `above_mm` beyond it.
  std::vector<EndSample> Band(const Eigen::Vector3d& plane_mm, double below_mm,
                              double above_mm) const {
    std::vector<EndSample> samples;
    for (const Near& near : all_) {
      const double out = 1.0 / std::sqrt(near.x * near.x + near.y * near.y);
      const double off_mm =
          near.at_mm - plane_mm[0] - out * (plane_mm[1] * near.x + plane_mm[2] * near.y);
      if (off_mm > -below_mm && off_mm < above_mm) samples.push_back(near.Sample());
    }
    return samples;
  }

 private:
  struct Near {
    double x, y, at_mm;
    unsigned pass;

    EndSample Sample() const { return {std::atan2(y, x), at_mm, pass}; }
  };
  std::vector<Near> all_;
};

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

// Of what is roughly known of a plane, what more is known; none: nothing.
using BetterPlane = std::function<std::optional<Posterior>(const Posterior&)>;

// A walk that found no way says less than the one before.
bool HasMoved(const Posterior& walk, const Posterior& before) {
  return walk.covariance.trace() > kCut.least_moved * before.covariance.trace();
}

// Mean and spread of all planes; `better`: asked when where about they lie is known.
EndPlane PlaneAmong(Evidence evidence, const Eigen::Vector2d& slope_mm, double r_mm,
                    const BetterPlane& better = {}) {
  const double prior_mm = kCut.usual_slope * r_mm;
  WalkDice dice(3);
  const auto sample = [&](const Posterior& from, int walk, double blur_mm) {
    PlaneLikelihood likelihood(evidence, blur_mm);
    return SamplePosterior(from, walk, dice, [&](const Eigen::VectorXd& x) {
      const double steep = (x.tail<2>() + slope_mm).squaredNorm() / (prior_mm * prior_mm);
      return likelihood.Log(x) - 0.5 * steep;
    });
  };
  const double first_mm = kCut.first_step * evidence.gap_mm;
  Posterior posterior{RoughPlane(evidence, r_mm),
                      first_mm * first_mm * Eigen::Matrix3d::Identity()};
  if (!evidence.sides.empty()) {
    for (const double blur : kCut.blurs) {
      const Posterior blurred = sample(posterior, kCut.blurred_walk, blur * evidence.gap_mm);
      if (!HasMoved(blurred, posterior)) continue;
      posterior = blurred;
      Forget(posterior, blur * evidence.gap_mm, evidence);
    }
  }
  EndPlane plane;
  for (const int walk : {kCut.short_walk, kCut.walk}) {
    const Posterior sharp = sample(posterior, walk, 0.0);
    if (HasMoved(sharp, posterior)) posterior = sharp;
    plane = PlaneOf(posterior, slope_mm, r_mm);
    if (better && walk == kCut.short_walk) {
      Posterior whole = posterior;
      whole.mean.tail<2>() += slope_mm;
      if (const auto found = better(whole)) return PlaneOf(*found, Eigen::Vector2d::Zero(), r_mm);
    }
    if (plane.slope_sigmas < kCut.may_be_oblique) break;
  }
  return plane;
}

// Whether most of the lines stop where the plane is; else they stop at something that is none.
bool Agrees(const EndPlane& plane, const Evidence& lines, double r_mm) {
  const Eigen::Vector3d x(plane.at_mm, r_mm * plane.cosine, r_mm * plane.sine);
  const auto wrong = std::count_if(
      lines.sides.begin(), lines.sides.end(),
      [&](const EndSide& side) { return side.Clear(x) < -kCut.wrong * lines.gap_mm; });
  return static_cast<double>(wrong) < kCut.most_wrong * static_cast<double>(lines.sides.size());
}

// How far along the tube samples reach.
double DepthMm(std::span<const EndSample> samples) {
  const auto [low, high] = std::minmax_element(
      samples.begin(), samples.end(),
      [](const EndSample& a, const EndSample& b) { return a.beyond_mm < b.beyond_mm; });
  return high->beyond_mm - low->beyond_mm;
}

// `band`: of all samples, of which every `stride`-th is in `samples`.
std::optional<EndPlane> FitPlane(std::span<const EndSample> samples, std::size_t stride,
                                 const EndBand& band, double pipe_radius_mm, double window_mm,
                                 double sigma_mm) {
  const double smear_mm = kSampling.SmearMm(sigma_mm, pipe_radius_mm);
  Eigen::Vector2d slope_mm = Eigen::Vector2d::Zero();
  if (const auto lines = LookAtLines(samples, pipe_radius_mm, window_mm, smear_mm, sigma_mm)) {
    EndPlane plane = PlaneAmong(*lines, slope_mm, pipe_radius_mm);
    plane.of_lines = true;
    if (Agrees(plane, *lines, pipe_radius_mm)) return plane;
  }
  const auto evidence = LookAtColumns(samples, pipe_radius_mm, window_mm, smear_mm, slope_mm);
  if (!evidence) return std::nullopt;
  // Where laser lines are seen the columns have said all; a few samples look like some by chance.
  if (evidence->sides.size() > evidence->columns.size())
    return PlaneAmong(*evidence, slope_mm, pipe_radius_mm);
  const std::size_t all = samples.size() * stride;
  const double seen_mm2 = 2.0 * std::numbers::pi * pipe_radius_mm * DepthMm(samples);
  RoughEnd rough;
  rough.pipe_radius_mm = pipe_radius_mm;
  rough.smear_mm = smear_mm;
  rough.per_mm2 = static_cast<double>(all) / seen_mm2;
  rough.slope_mm = kCut.usual_slope * pipe_radius_mm;
  rough.is_thinned = all > kCut.enough_samples;
  return PlaneAmong(*evidence, slope_mm, pipe_radius_mm, [&](const Posterior& plane) {
    rough.plane = plane;
    return FitEndBorder(rough, band);
  });
}

}  // namespace

std::optional<EndPlane> FitEndPlane(std::span<const EndSample> samples, double pipe_radius_mm,
                                    double window_mm, double sigma_mm) {
  const EndBand band = [&](const Eigen::Vector3d& plane_mm, double below_mm, double above_mm) {
    std::vector<EndSample> taken;
    for (const EndSample& sample : samples) {
      const double off_mm = sample.beyond_mm - plane_mm[0] -
                            plane_mm[1] * std::cos(sample.around_rad) -
                            plane_mm[2] * std::sin(sample.around_rad);
      if (off_mm > -below_mm && off_mm < above_mm) taken.push_back(sample);
    }
    return taken;
  };
  return FitPlane(samples, 1, band, pipe_radius_mm, window_mm, sigma_mm);
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
    const EndAxis& axis = at_start ? ends.first : ends.last;
    const SamplesNear near(found, at_start, axis, sigma_mm, window_mm, blocks);
    const std::size_t stride = StrideTo(near.size(), kCut.enough_of_lines);
    const EndBand band = [&](const Eigen::Vector3d& plane_mm, double below_mm, double above_mm) {
      return near.Band(plane_mm, below_mm, above_mm);
    };
    const auto plane = FitPlane(near.Every(stride), stride, band, r_mm, window_mm, sigma_mm);
    if (!plane) continue;
    (at_start ? cuts.first : cuts.last) = Found(*plane);
    // Laser lines tell of an end's place at its axis whether it is square or not.
    const double sigma_of_square_mm = at_start ? ends.first_sigma_mm : ends.last_sigma_mm;
    const bool is_surer = plane->of_lines && (plane->slope_sigmas >= kCut.may_be_oblique ||
                                              plane->at_sigma_mm < sigma_of_square_mm);
    if (plane->slope_sigmas < kCut.oblique && !is_surer) continue;
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
