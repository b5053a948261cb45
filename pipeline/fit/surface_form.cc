// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/surface_form.h"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <optional>

#include "hal/tube_features.h"
#include "pipeline/fit/along_wall.h"
#include "pipeline/fit/long_bends.h"
#include "pipeline/fit/sides.h"
#include "pipeline/fit/surface_pass.h"
#include "pipeline/math/circle_sectors.h"
#include "pipeline/math/quantiles.h"

namespace bendloop::pipeline {
namespace {

constexpr int kSides = 16;  // of the turn

struct FormSettings {
  // Of the whole tube: dents and bows are known better than a scan's noise.
  std::size_t enough_points = 40'000;
  // [of r_P] Beside a bend, where its easing or its own ovality begins, a straight is not looked
  // at.
  double beside_bend = 0.5;
  // [of r_P] Shorter ones have no straightness.
  double shortest = 2.5;
  // A straight with fewer points has none either.
  double least_points = 60;
  // [of r_P] Of a cell of the surface along the spine; around it is a sixteenth of the turn.
  double cell = 0.5;
  // [of what sides of straights disagree by] Of less a pass of the scan may be displaced, which
  // another one sees beside it. By trial.
  double beyond_sides = 3.0;
  // [cells] So far from its middle nothing is another dent.
  int slope_cells = 6;
  // [cells] The surface about a dent is looked at from here to there along the spine.
  int near_cells = 4, far_cells = 8;
  // Points in and next to a cell that tell of it.
  double least_in_cells = 8;
  std::size_t most_dents = 20;
  // Of the spine, wall inside of a bend: of one as tight as fits let it be there would be none.
  double least_part = 0.1;
  // [sigma] How far off points of a side may be that tell of it.
  double side_sigmas = 4.0;
};
constexpr FormSettings kForm;

// Points of one straight or bend in cells, row by row along it; distances less the straight's long
// bends.
struct Cells {
  double from_mm = 0, row_mm = 1;
  int rows = 0;
  std::vector<double> count, sum_mm;

  void Resize(double low_mm, double high_mm, double cell_mm) {
    from_mm = low_mm;
    rows = std::max(1, static_cast<int>(std::ceil((high_mm - low_mm) / cell_mm)));
    row_mm = (high_mm - low_mm) / rows;
    count.assign(static_cast<std::size_t>(rows * kSides), 0.0);
    sum_mm.assign(count.size(), 0.0);
  }
  static std::size_t At(int row, int side) {
    return static_cast<std::size_t>(row * kSides + ((side % kSides) + kSides) % kSides);
  }
  void Add(double along_mm, double outward, double z, double distance_mm) {
    const int row = static_cast<int>(std::floor((along_mm - from_mm) / row_mm));
    if (row < 0 || row >= rows) return;
    const std::size_t at = At(row, static_cast<int>(AzimuthSector<kSides>(outward, z)));
    count[at] += 1;
    sum_mm[at] += distance_mm;
  }
};

// The sides of a straight.
class Sides {
 public:
  void Add(double outward, double z, double distance_mm) {
    const std::size_t side = AzimuthSector<kSides>(outward, z);
    count_[side] += 1;
    sum_mm_[side] += distance_mm;
    squares_mm2_[side] += distance_mm * distance_mm;
  }

  std::optional<double> BeyondNoise() const {
    std::array<SideMean, kSides> sides;
    for (std::size_t i = 0; i < kSides; ++i) {
      if (count_[i] < 2) continue;
      const double mean = sum_mm_[i] / count_[i];
      const double variance = squares_mm2_[i] / count_[i] - mean * mean;
      sides[i] = {count_[i], mean, variance / (count_[i] - 1)};
    }
    return BeyondNoiseMm2(sides);
  }

 private:
  std::array<double, kSides> count_{}, sum_mm_{}, squares_mm2_{};
};

// The cells' means, each with those beside it; NaN where there are too few points.
struct SmoothCells {
  explicit SmoothCells(const Cells& cells);
  std::vector<double> mean_mm;
  std::vector<double> sigmas;  // of a mean: times the noise of a point
};

SmoothCells::SmoothCells(const Cells& cells)
    : mean_mm(cells.count.size(), std::nan("")), sigmas(cells.count.size(), 0.0) {
  for (int row = 0; row < cells.rows; ++row) {
    for (int side = 0; side < kSides; ++side) {
      double count = 0, sum = 0, points = 0, squares = 0;
      for (int i = std::max(0, row - 1); i <= std::min(cells.rows - 1, row + 1); ++i) {
        for (int k = side - 1; k <= side + 1; ++k) {
          const double weight = (i == row ? 1.0 : 0.5) * (k == side ? 1.0 : 0.5);
          points += cells.count[Cells::At(i, k)];
          count += weight * cells.count[Cells::At(i, k)];
          squares += weight * weight * cells.count[Cells::At(i, k)];
          sum += weight * cells.sum_mm[Cells::At(i, k)];
        }
      }
      if (points < kForm.least_in_cells) continue;
      mean_mm[Cells::At(row, side)] = sum / count;
      sigmas[Cells::At(row, side)] = std::sqrt(squares) / count;
    }
  }
}

// How much further in a cell lies than the same side does before and behind it.
double DepthAt(const std::vector<double>& smooth, int rows, int row, int side) {
  const double here = smooth[Cells::At(row, side)];
  if (std::isnan(here)) return 0;
  std::array<double, 2 * kForm.far_cells + 1> around{};
  std::size_t count = 0;
  for (int i = std::max(0, row - kForm.far_cells); i < std::min(rows, row + kForm.far_cells + 1);
       ++i) {
    if (std::abs(i - row) < kForm.near_cells) continue;
    const double there = smooth[Cells::At(i, side)];
    if (!std::isnan(there)) around[count++] = there;
  }
  // Without any, as in a short bend: from the surface itself.
  if (count < 3) return -here;
  const auto middle = around.begin() + static_cast<std::ptrdiff_t>(count / 2);
  std::nth_element(around.begin(), middle, around.begin() + static_cast<std::ptrdiff_t>(count));
  return *middle - here;
}

// A straight, or all pieces of a bend: a wall that goes on from piece to piece.
struct Stretch {
  std::size_t first = 0, count = 1;  // of the spine's segments
  std::span<const hal::SpineSegment> Of(const EasedSpine& spine) const {
    return std::span(spine.segments).subspan(first, count);
  }
};

struct Depths {
  std::vector<double> mm;
  std::vector<double> sigmas;  // of each: times the noise of a point
  const Cells* cells;
  Stretch stretch;
};

// Cells about the deepest that are half as deep and joined to it; takes them out.
int TakeHalfAsDeep(Depths& depths, int row, int side, double half_mm) {
  const std::size_t at = Cells::At(row, side);
  if (!(depths.mm[at] > half_mm)) return 0;
  depths.mm[at] = 0;
  int cells = 1;
  if (row > 0) cells += TakeHalfAsDeep(depths, row - 1, side, half_mm);
  if (row + 1 < depths.cells->rows) cells += TakeHalfAsDeep(depths, row + 1, side, half_mm);
  cells += TakeHalfAsDeep(depths, row, side + 1, half_mm);
  return cells + TakeHalfAsDeep(depths, row, side - 1, half_mm);
}

// The place in the middle of a cell.
DentFound DentAt(const EasedSpine& spine, const Depths& depths, int row, int side,
                 double pipe_radius_mm) {
  const Cells& cells = *depths.cells;
  const auto segments = depths.stretch.Of(spine);
  double along_mm = std::max(0.0, cells.from_mm + (row + 0.5) * cells.row_mm);
  std::size_t piece = 0;
  while (piece + 1 < segments.size() && along_mm > segments[piece].length_mm) {
    along_mm -= segments[piece++].length_mm;
  }
  const hal::SpineSegment& segment = segments[piece];
  along_mm = std::min(along_mm, segment.length_mm);
  // QuarterTurns() counts from -y: a side's middle in the frame (outward, normal).
  const double turn = (side + 0.5) * 2.0 * std::numbers::pi / kSides - 0.5 * std::numbers::pi;
  const Eigen::Vector3d tangent = segment.TangentAt(along_mm);
  Eigen::Vector3d outward = segment.normal.cross(tangent);
  if (segment.is_arc()) outward = -outward;
  const Eigen::Vector3d direction = std::cos(turn) * outward + std::sin(turn) * segment.normal;
  DentFound dent;
  dent.along_mm = segment.from_start_mm + along_mm;
  dent.around_deg =
      hal::AroundDeg(hal::AroundZero(spine.segments, depths.stretch.first + piece, spine.pieces),
                     tangent, direction);
  dent.position_mm = segment.PointAt(along_mm) + pipe_radius_mm * direction;
  return dent;
}

// How much of the wall is beside a length of the spine, about a place and so far before and behind.
double WallPart(const EasedSpine& spine, const DentFound& about, double half_mm) {
  const auto tangent_at = [&spine](double along_mm) {
    const hal::SpineSegment& segment = spine.segments[hal::SegmentAt(spine.segments, along_mm)];
    return segment.TangentAt(along_mm - segment.from_start_mm);
  };
  const hal::SurfaceFrame middle = hal::FrameAt(spine.segments, about.along_mm, 0.0, spine.pieces);
  const Eigen::Vector3d outward = (about.position_mm - middle.spine_mm).normalized();
  const double from_mm = std::max(0.0, about.along_mm - half_mm);
  const double to_mm = std::min(spine.length_mm(), about.along_mm + half_mm);
  const double r_mm = (about.position_mm - middle.spine_mm).norm();
  const auto shorter_mm = [&](double along_mm) {
    return ShorterByMm(middle.tangent, tangent_at(along_mm), outward, r_mm);
  };
  const double part = 1.0 - (shorter_mm(to_mm) - shorter_mm(from_mm)) / (to_mm - from_mm);
  return std::max(kForm.least_part, part);
}

std::vector<DentFound> FindDents(const EasedSpine& spine, std::vector<Depths> stretches,
                                 double pipe_radius_mm, double noise_mm, double sides_mm,
                                 const DentInCells& in_cells) {
  std::vector<double> magnitudes;
  for (const Depths& depths : stretches) {
    for (const double depth : depths.mm) {
      if (depth != 0) magnitudes.push_back(std::abs(depth));
    }
  }
  const double scatter_mm = 1.4826 * Median(magnitudes);
  const double least_mm =
      std::max({in_cells.least * pipe_radius_mm, in_cells.scatter_sigmas * scatter_mm,
                kForm.beyond_sides * sides_mm});
  const double cell_mm2 =
      kForm.cell * pipe_radius_mm * 2.0 * std::numbers::pi * pipe_radius_mm / kSides;
  std::vector<DentFound> dents;
  while (dents.size() < kForm.most_dents) {
    Depths* deepest = nullptr;
    std::size_t at = 0;
    double depth_mm = least_mm;
    for (Depths& depths : stretches) {
      for (std::size_t i = 0; i < depths.mm.size(); ++i) {
        if (depths.mm[i] > depth_mm &&
            depths.mm[i] > in_cells.noise_sigmas * noise_mm * depths.sigmas[i]) {
          deepest = &depths, at = i, depth_mm = depths.mm[i];
        }
      }
    }
    if (!deepest) break;
    const int row = static_cast<int>(at) / kSides, side = static_cast<int>(at) % kSides;
    DentFound dent = DentAt(spine, *deepest, row, side, pipe_radius_mm);
    dent.depth_mm = depth_mm;
    dent.sigma_mm = scatter_mm;
    const int cells = TakeHalfAsDeep(*deepest, row, side, 0.5 * depth_mm);
    const double half_mm = std::sqrt(cells * cell_mm2 / std::numbers::pi);
    dent.size_mm = 2.0 * half_mm * std::sqrt(WallPart(spine, dent, half_mm));
    // Its slopes are no dents of their own.
    for (int i = std::max(0, row - kForm.slope_cells);
         i <= std::min(deepest->cells->rows - 1, row + kForm.slope_cells); ++i) {
      for (int k = side - kForm.slope_cells; k <= side + kForm.slope_cells; ++k) {
        deepest->mm[Cells::At(i, k)] = 0;
      }
    }
    dents.push_back(dent);
  }
  return dents;
}

// What a stretch's points are laid on: from where to where along it.
struct Extent {
  double low_mm = 0, high_mm = 0;
};

// Takes the points of a straight or a bend to cells. A straight's long bends are found and taken
// off.
class StretchForm {
 public:
  StretchForm(std::span<const SegmentPoints> points, const Stretch& stretch,
              std::span<const hal::SpineSegment> segments, const Extent& extent,
              double pipe_radius_mm, double noise_mm)
      : stretch_(stretch) {
    cells_.Resize(extent.low_mm, extent.high_mm, kForm.cell * pipe_radius_mm);
    const bool is_long = !segments.front().is_arc() &&
                         extent.high_mm - extent.low_mm > kForm.shortest * pipe_radius_mm &&
                         static_cast<double>(points.front().size) > kForm.least_points;
    if (is_long) {
      bends_.emplace(points.front(), extent.low_mm, extent.high_mm, pipe_radius_mm, noise_mm);
    }
    double before_mm = 0;
    for (std::size_t k = 0; k < segments.size(); ++k) {
      Add(points[k], segments[k], before_mm);
      before_mm += segments[k].length_mm;
    }
  }

  const Cells& cells() const { return cells_; }
  const std::optional<LongBends>& bends() const { return bends_; }
  Depths DepthsOfCells() const {
    SmoothCells smooth(cells_);
    Depths depths{std::vector<double>(smooth.mean_mm.size(), 0.0), std::move(smooth.sigmas),
                  &cells_, stretch_};
    for (int row = 0; row < cells_.rows; ++row) {
      for (int side = 0; side < kSides; ++side) {
        depths.mm[Cells::At(row, side)] = DepthAt(smooth.mean_mm, cells_.rows, row, side);
      }
    }
    return depths;
  }

 private:
  void Add(const SegmentPoints& points, const hal::SpineSegment& segment, double before_mm) {
    for (Eigen::Index i = 0; i < static_cast<Eigen::Index>(points.size); ++i) {
      const double x = points.x[i], y = points.y[i], z = points.z[i];
      if (segment.is_arc()) {
        // Local y counts from the bend's centre; the arc begins at -y.
        const double along_mm = before_mm + segment.bend_radius_mm * std::atan2(x, -y);
        cells_.Add(along_mm, std::sqrt(x * x + y * y) - segment.bend_radius_mm, z,
                   points.distance[i]);
        continue;
      }
      const double rho = std::max(1e-9, std::sqrt(y * y + z * z));
      const double off_mm = bends_ ? bends_->OffMm(x, y / rho, z / rho) : 0.0;
      cells_.Add(x, y, z, points.distance[i] - off_mm);
    }
  }

  Stretch stretch_;
  Cells cells_;
  std::optional<LongBends> bends_;
};

std::optional<double> SidesOf(const SegmentPoints& points, const Extent& extent, double limit_mm) {
  Sides sides;
  for (Eigen::Index i = 0; i < static_cast<Eigen::Index>(points.size); ++i) {
    if (points.x[i] < extent.low_mm || points.x[i] > extent.high_mm) continue;
    if (std::abs(points.distance[i]) > limit_mm) continue;
    sides.Add(points.y[i], points.z[i], points.distance[i]);
  }
  return sides.BeyondNoise();
}

}  // namespace

SurfaceForm FindForm(const BowedTubeState& state, double noise_mm,
                     std::span<const PointBlock> blocks, double reach_mm,
                     const DentInCells& in_cells) {
  const double r_mm = state.tube.pipe_radius_mm;
  const EasedSpine spine = SpineOf(state);
  const OwnedBlocks few = Thinned(blocks, StrideTo(CountPoints(blocks), kForm.enough_points));
  const SurfaceAssignment points = PointsOf(state, spine, 0.0, few, reach_mm);
  SurfaceForm form;
  std::vector<StretchForm> stretches;
  stretches.reserve(spine.segments.size());
  double sides_mm2 = 0, straights = 0;
  for (std::size_t k = 0; k < spine.segments.size();) {
    const bool is_line = spine.is_line(k);
    const Stretch stretch{k, is_line ? 1 : spine.pieces};
    const auto segments = stretch.Of(spine);
    const auto of_stretch = std::span(points.segments).subspan(k, stretch.count);
    k += stretch.count;
    Extent extent;
    for (const hal::SpineSegment& segment : segments) extent.high_mm += segment.length_mm;
    if (is_line) {
      if (stretch.first > 0) extent.low_mm += kForm.beside_bend * r_mm;
      if (k < spine.segments.size()) extent.high_mm -= kForm.beside_bend * r_mm;
    }
    if (!(extent.high_mm > extent.low_mm + 1e-6)) {
      if (is_line) form.straights.emplace_back();
      continue;
    }
    const StretchForm& found =
        stretches.emplace_back(of_stretch, stretch, segments, extent, r_mm, noise_mm);
    if (!is_line) continue;
    form.straights.push_back(found.bends() ? found.bends()->Form(1.0) : StraightForm{});
    const auto sides = SidesOf(of_stretch.front(), extent, kForm.side_sigmas * noise_mm);
    if (!sides) continue;
    sides_mm2 += *sides;
    straights += 1;
  }
  form.sides_mm2 = straights > 0 ? std::max(0.0, sides_mm2 / straights) : 0.0;
  std::vector<Depths> depths;
  for (const StretchForm& stretch : stretches) depths.push_back(stretch.DepthsOfCells());
  form.dents =
      FindDents(spine, std::move(depths), r_mm, noise_mm, std::sqrt(form.sides_mm2), in_cells);
  return form;
}

}  // namespace bendloop::pipeline
