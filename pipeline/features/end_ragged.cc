// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/end_ragged.h"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "pipeline/features/end_series.h"
#include "pipeline/math/dense_solve.h"

namespace bendloop::pipeline {
namespace {

struct RaggedSettings {
  // Turns of the last terms that are tried.
  std::array<int, 8> orders = {1, 2, 3, 4, 6, 8, 10, 12};
  // [of r_P] Raggedness from there down to the noise, each so many times less than the one before;
  // so many in a row that are less likely end it.
  double most = 0.15, step = 1.3;
  int most_worse = 3;
  // Samples that a sector has before the border, at least, and sectors that are seen.
  double of_sector = 12.0, least_seen = 0.75;
  // [of the raggedness] Deeper samples say nothing of where the border is. [of r_P] It lies no
  // deeper than that before the plane.
  double deep = 6.0, deepest = 1.5;
  double of_number = 1.0;  // samples within the raggedness that each number of a series takes
  // Steps to the likeliest series, and [mm] of one that is none.
  int most_steps = 40;
  double no_step_mm = 1e-5;
  // Places of a sector at which the border's area is summed.
  int places = 4;
  // Twice the logarithm of the odds that a plane and noise do not explain the samples on a third of
  // the turn.
  double certain_of_third = 6.0;
  // [of the raggedness] The border reaches so far below its series.
  double below = 2.5;
  std::size_t arcs = 12;  // of a third of the turn, that are looked at
  // [of r_P] Pieces of the wall before a plane in which samples may be missing, each so many times
  // as long as the one before; and [sigma] by how many more than by chance.
  double first_piece = 0.02, longer = 1.6, last_piece = 0.4, missing = 2.0, missing_all_round = 3.5;
  double by_noise = 0.4;  // [of the noise] So much of the wall before a plane noise leaves empty.
};
constexpr RaggedSettings kRagged;

using SectorCounts = std::array<double, kEndSectors>;

struct RaggedSample {
  std::size_t sector;
  double cosine, sine, beyond_mm;  // of the plane
};

// log Phi(z), and its derivative.
struct LogPhi {
  double log, slope;
};
LogPhi LogPhiAt(double z) {
  if (z < -8.0) {  // asymptotically
    const double tail = 1.0 - 1.0 / (z * z);
    return {-0.5 * z * z - std::log(-z * std::sqrt(2.0 * std::numbers::pi)) + std::log(tail),
            -z / tail};
  }
  const double phi = std::exp(-0.5 * z * z) / std::sqrt(2.0 * std::numbers::pi);
  const double part = 0.5 * std::erfc(-z / std::numbers::sqrt2);
  return {std::log(part), phi / part};
}

// Samples about a ragged border, and the wall before it by sectors. Those far before it tell only
// how many there are.
class RaggedLikelihood {
 public:
  RaggedLikelihood(std::vector<RaggedSample> samples, const SectorCounts& count, double window_mm,
                   double r_mm)
      : samples_(About(std::move(samples), r_mm)),
        terms_(1 + 2 * kRagged.orders.back(), static_cast<Eigen::Index>(samples_.size())),
        count_(count),
        window_mm_(window_mm),
        r_mm_(r_mm) {
    constexpr auto kSectors = static_cast<Eigen::Index>(kEndSectors);
    constexpr double kPlaces = static_cast<double>(kSectors) * kRagged.places;
    of_sectors_ = Eigen::MatrixXd::Zero(terms_.rows(), kSectors);
    for (Eigen::Index i = 0; i < kSectors * kRagged.places; ++i) {
      const double around = 2.0 * std::numbers::pi * (static_cast<double>(i) + 0.5) / kPlaces;
      of_sectors_.col(i / kRagged.places) +=
          SeriesAt(std::cos(around), std::sin(around), kRagged.orders.back()) / kRagged.places;
    }
    for (std::size_t i = 0; i < samples_.size(); ++i) {
      terms_.col(static_cast<Eigen::Index>(i)) =
          SeriesAt(samples_[i].cosine, samples_[i].sine, kRagged.orders.back());
    }
  }

  struct At {
    double log = 0;
    Eigen::VectorXd gradient;
    Eigen::MatrixXd information;
  };
  At Of(const Eigen::VectorXd& x, double ragged_mm) const {
    const auto n = x.size();
    const int order = static_cast<int>(n - 1) / 2;
    const Eigen::VectorXd certainty = SeriesCertainties(order, r_mm_).cwiseAbs2();
    At at{-0.5 * x.dot(certainty.cwiseProduct(x)), -certainty.cwiseProduct(x),
          certainty.asDiagonal()};
    for (std::size_t i = 0; i < samples_.size(); ++i) {
      const auto terms = terms_.col(static_cast<Eigen::Index>(i)).head(n);
      const double z = (terms.dot(x) - samples_[i].beyond_mm) / ragged_mm;
      if (z > kRagged.deep) continue;
      const auto [log, slope] = LogPhiAt(z);
      at.log += log;
      at.gradient += slope / ragged_mm * terms;
      at.information.selfadjointView<Eigen::Lower>().rankUpdate(
          terms, slope * (z + slope) / (ragged_mm * ragged_mm));
    }
    AddAreas(x, at);
    at.information = at.information.selfadjointView<Eigen::Lower>();
    return at;
  }
  // The likeliest series, from `x` on.
  At Climb(double ragged_mm, Eigen::VectorXd& x) {
    At at = Of(x, ragged_mm);
    for (int i = 0; i < kRagged.most_steps; ++i) {
      Eigen::VectorXd step = SolveSymmetric(at.information, at.gradient);
      const double most = step.cwiseAbs().maxCoeff();
      if (!(most > kRagged.no_step_mm)) break;
      At next = at;
      for (int half = 0; half < 8; ++half, step *= 0.5) {
        next = Of(x + step, ragged_mm);
        if (next.log > at.log) break;
      }
      if (!(next.log > at.log)) break;
      x += step;
      at = std::move(next);
    }
    return at;
  }

 private:
  // As many samples as a sector has lie on as much wall as the border leaves of it, wherever that
  // is: its density is not known but by them.
  void AddAreas(const Eigen::VectorXd& x, At& at) const {
    for (std::size_t i = 0; i < kEndSectors; ++i) {
      if (count_[i] < kRagged.of_sector) continue;
      const auto mean = of_sectors_.col(static_cast<Eigen::Index>(i)).head(x.size());
      const double length_mm = std::max(0.05 * window_mm_, window_mm_ + mean.dot(x));
      at.log -= count_[i] * std::log(length_mm);
      at.gradient -= count_[i] / length_mm * mean;
    }
  }

  static std::vector<RaggedSample> About(std::vector<RaggedSample> samples, double r_mm) {
    std::erase_if(samples, [r_mm](const RaggedSample& sample) {
      return sample.beyond_mm < -kRagged.deepest * r_mm;
    });
    return samples;
  }

  std::vector<RaggedSample> samples_;
  Eigen::MatrixXd terms_, of_sectors_;  // of the longest series: of each sample, means of sectors
  SectorCounts count_;
  double window_mm_, r_mm_;
};

// The wall before a plane, without what is hidden.
struct RaggedWall {
  std::vector<RaggedSample> samples;
  SectorCounts count{};

  RaggedWall(std::span<const EndSample> all, const RaggedAbout& about) {
    for (const EndSample& sample : all) {
      const std::size_t sector = EndSectorOf(sample.around_rad);
      if (about.hidden[sector]) continue;
      const Eigen::Vector2d out = sample.Direction();
      const double beyond_mm =
          sample.beyond_mm - about.plane_mm[0] - about.plane_mm.tail<2>().dot(out);
      if (beyond_mm < -about.window_mm) continue;
      count[sector] += 1;
      samples.push_back({sector, out[0], out[1], beyond_mm});
    }
    std::erase_if(samples, [&](const RaggedSample& sample) { return !Tells(sample.sector); });
  }
  bool Tells(std::size_t sector) const { return count[sector] >= kRagged.of_sector; }
  bool IsSeen() const {
    double seen = 0;
    for (std::size_t i = 0; i < kEndSectors; ++i) seen += Tells(i) ? 1 : 0;
    return seen >= kRagged.least_seen * static_cast<double>(kEndSectors);
  }
  // A third of the turn, from the sector on; nothing: too little of it is seen.
  std::optional<RaggedWall> Third(std::size_t first) const {
    RaggedWall third = *this;
    const auto is_in = [first](std::size_t sector) {
      return (sector + kEndSectors - first) % kEndSectors < kEndSectors / 3;
    };
    std::size_t seen = 0;
    for (std::size_t i = 0; i < kEndSectors; ++i) {
      if (!is_in(i)) third.count[i] = 0;
      seen += third.Tells(i) ? 1 : 0;
    }
    if (2 * seen < kEndSectors / 3) return std::nullopt;
    std::erase_if(third.samples, [&](const RaggedSample& sample) { return !is_in(sample.sector); });
    return third;
  }
};

// The likeliest raggedness with a series of this order, from where the border is hardly a border to
// where it is sharp.
struct Likeliest {
  Eigen::VectorXd series;
  RaggedLikelihood::At at;
  double ragged_mm = 0;
};
Likeliest LikeliestOf(RaggedLikelihood& likelihood, int order, double least_mm, double most_mm) {
  Likeliest best{Eigen::VectorXd::Zero(1 + 2 * order), {-1e300, {}, {}}, 0.0};
  Eigen::VectorXd series = best.series;
  int worse = 0;
  for (double ragged_mm = most_mm; ragged_mm >= least_mm && worse < kRagged.most_worse;
       ragged_mm /= kRagged.step) {
    auto at = likelihood.Climb(ragged_mm, series);
    worse = at.log < best.at.log ? worse + 1 : 0;
    if (worse == 0) best = {series, std::move(at), ragged_mm};
  }
  return best;
}

// Whether no third of the turn has a border that a plane and noise explain.
bool IsRaggedAllRound(const RaggedWall& wall, const RaggedAbout& about, double r_mm) {
  for (std::size_t arc = 0; arc < kRagged.arcs; ++arc) {
    const auto third = wall.Third(arc * kEndSectors / kRagged.arcs);
    if (!third) return false;
    RaggedLikelihood likelihood(third->samples, third->count, about.window_mm, r_mm);
    const Likeliest any = LikeliestOf(likelihood, 1, about.smear_mm, kRagged.most * r_mm);
    Eigen::VectorXd plane = any.series;
    const double of_plane = likelihood.Climb(about.smear_mm, plane).log;
    if (2.0 * (any.at.log - of_plane) < kRagged.certain_of_third) return false;
  }
  return true;
}

// How many samples lie about a border, as far as it is ragged.
double SamplesAbout(const RaggedWall& wall, const Likeliest& border) {
  const int order = OrderOf(border.series);
  const auto about =
      std::count_if(wall.samples.begin(), wall.samples.end(), [&](const RaggedSample& sample) {
        const double off_mm =
            SeriesAt(sample.cosine, sample.sine, order).dot(border.series) - sample.beyond_mm;
        return off_mm < kRagged.below * border.ragged_mm;
      });
  return std::max(10.0, static_cast<double>(about));
}

// Whether samples are missing right before the plane.
bool IsMissingBefore(const RaggedWall& wall, const RaggedAbout& about, double sigmas, double r_mm) {
  double deep = 0;
  const double last_mm = std::min(kRagged.last_piece * r_mm, 0.5 * about.window_mm);
  std::vector<double> before_mm;
  for (const RaggedSample& sample : wall.samples) {
    if (-sample.beyond_mm > last_mm) {
      deep += 1;
    } else {
      before_mm.push_back(-sample.beyond_mm);
    }
  }
  const double per_mm = deep / (about.window_mm - last_mm);
  for (double piece_mm = kRagged.first_piece * r_mm; piece_mm < last_mm;
       piece_mm *= kRagged.longer) {
    const auto found = static_cast<double>(std::count_if(before_mm.begin(), before_mm.end(),
                                                         [&](double at) { return at < piece_mm; }));
    const double expected = per_mm * (piece_mm - kRagged.by_noise * about.smear_mm);
    if (expected - found > sigmas * std::sqrt(std::max(1.0, per_mm * piece_mm))) {
      return true;
    }
  }
  return false;
}

// Corrects the first three terms of the series by how many samples there are, and says how sure
// they are.
void CountPlane(const RaggedWall& wall, const RaggedAbout& about, double ragged_mm,
                Posterior& series) {
  const int order = OrderOf(series.mean);
  SectorCounts mean_mm{}, beyond{};
  double deepest_mm = 0;
  const double width = 2.0 * std::numbers::pi / static_cast<double>(kEndSectors);
  for (std::size_t i = 0; i < kEndSectors; ++i) {
    for (int k = 0; k < kRagged.places; ++k) {
      const double around = width * (static_cast<double>(i) + (k + 0.5) / kRagged.places);
      const double at_mm = SeriesAt(std::cos(around), std::sin(around), order).dot(series.mean);
      mean_mm[i] += at_mm / kRagged.places;
      deepest_mm = std::min(deepest_mm, at_mm);
    }
  }
  const double from_mm = std::max(-0.5 * about.window_mm, deepest_mm - kRagged.below * ragged_mm);
  for (const RaggedSample& sample : wall.samples) {
    if (sample.beyond_mm > from_mm) beyond[sample.sector] += 1;
  }
  Eigen::Matrix3d matrix = Eigen::Matrix3d::Zero(), variance = Eigen::Matrix3d::Zero();
  Eigen::Vector3d right = Eigen::Vector3d::Zero();
  for (std::size_t i = 0; i < kEndSectors; ++i) {
    const double before = wall.count[i] - beyond[i];
    if (!wall.Tells(i) || before < 1.0) continue;
    const double around = width * (static_cast<double>(i) + 0.5);
    const Eigen::Vector3d row(1.0, std::cos(around), std::sin(around));
    const double per_mm = before / (about.window_mm + from_mm);
    const double length_mm = beyond[i] / per_mm;
    const double of_beyond = std::max(1.0, beyond[i]) / (per_mm * per_mm);
    matrix += row * row.transpose();
    right += (from_mm + length_mm - mean_mm[i]) * row;
    variance += (of_beyond + length_mm * length_mm / before) * row * row.transpose();
  }
  const Eigen::Matrix3d inverse = matrix.inverse();
  series.mean.head<3>() += inverse * right;
  // What else the series says of the plane is not asked for any more.
  series.covariance.topRows(3).setZero();
  series.covariance.leftCols(3).setZero();
  series.covariance.topLeftCorner<3, 3>() = inverse * variance * inverse;
}

}  // namespace

bool MissesSamplesBefore(std::span<const EndSample> samples, const RaggedAbout& about,
                         double r_mm) {
  return IsMissingBefore(RaggedWall(samples, about), about, kRagged.missing, r_mm);
}

bool MissesSamplesAllRound(std::span<const EndSample> samples, const RaggedAbout& about,
                           double r_mm) {
  const RaggedWall wall(samples, about);
  for (std::size_t arc = 0; arc < kRagged.arcs; ++arc) {
    const auto third = wall.Third(arc * kEndSectors / kRagged.arcs);
    if (third && !IsMissingBefore(*third, about, kRagged.missing_all_round, r_mm)) return false;
  }
  return true;
}

std::optional<RaggedBorder> FitRaggedBorder(std::span<const EndSample> samples,
                                            const RaggedAbout& about, double pipe_radius_mm) {
  const RaggedWall wall(samples, about);
  if (!wall.IsSeen()) return std::nullopt;
  RaggedLikelihood likelihood(wall.samples, wall.count, about.window_mm, pipe_radius_mm);
  Eigen::VectorXd plane = Eigen::VectorXd::Zero(3);
  // Where a number has no sample about the border its likelihood has edges, and no curvature.
  const double per_mm = static_cast<double>(wall.samples.size()) / about.window_mm;
  const auto least_mm = [&](double numbers) {
    return std::max(about.smear_mm, kRagged.of_number * numbers / per_mm);
  };
  double best = -2.0 * likelihood.Climb(least_mm(3.0), plane).log, log_samples = 0;
  std::optional<RaggedBorder> border;
  for (const int order : kRagged.orders) {
    const Likeliest any =
        LikeliestOf(likelihood, order, least_mm(1.0 + 2.0 * order), kRagged.most * pipe_radius_mm);
    // Those about the border tell where it is.
    if (order == 1) log_samples = std::log(SamplesAbout(wall, any));
    const double bic = -2.0 * any.at.log + (2.0 * order - 1.0) * log_samples;
    if (!(bic < best)) continue;
    best = bic;
    border = RaggedBorder{{any.series, Inverse(any.at.information), 0.0}, any.ragged_mm};
  }
  if (!border) return std::nullopt;
  CountPlane(wall, about, border->ragged_mm, border->series);
  border->all_round = IsRaggedAllRound(wall, about, pipe_radius_mm);
  return border;
}

}  // namespace bendloop::pipeline
