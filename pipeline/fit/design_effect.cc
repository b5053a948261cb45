// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/design_effect.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <vector>

#include "pipeline/fit/sides.h"
#include "pipeline/math/circle_sectors.h"
#include "pipeline/math/simd.h"

namespace bendloop::pipeline {
namespace {

struct PatchSettings {
  // [of r_P] Of a patch along the spine; with eight around it is about as wide as long. By trial.
  double long_part = 2.0 / 3.0;
  // Rows of patches of a segment: bounds the memory.
  double most_rows = 1024;
  // Fewer slopes of sides tell nothing of how they scatter.
  double least_slopes = 10;
};
constexpr PatchSettings kPatch;
constexpr double kDirection = 2;   // numbers of a line's
constexpr int kPatchesAround = 8;  // a power of two: numbers wrap by their bits

// How a segment is parted: all round the centre of a bend, or along a line.
struct PatchRows {
  double bend_radius_mm = 0;  // 0: a line
  double from_mm = 0, per_mm = 0;
  double rows = 1;
};

BENDLOOP_LOOP std::int32_t NumberOf(double row, double last_row, double outward, double z) {
  const auto at = static_cast<std::int32_t>(row < last_row ? row : last_row);
  const auto around = static_cast<std::int32_t>(0.25 * kPatchesAround * QuarterTurns(outward, z));
  return at * kPatchesAround + (around & (kPatchesAround - 1));
}

BENDLOOP_LOOP void NumberPatchesBody(const PatchRows& grid, const double* x, const double* y,
                                     const double* z, std::size_t count, std::int32_t* number) {
  const double last = grid.rows - 1.0;
  if (grid.bend_radius_mm > 0) {
    const double bend_mm = grid.bend_radius_mm, per_quarter = 0.25 * grid.rows;
    for (std::size_t i = 0; i < count; ++i) {
      const double outward = std::sqrt(x[i] * x[i] + y[i] * y[i]) - bend_mm;
      number[i] = NumberOf(per_quarter * QuarterTurns(x[i], y[i]), last, outward, z[i]);
    }
  } else {
    const double from_mm = grid.from_mm, per_mm = grid.per_mm;
    for (std::size_t i = 0; i < count; ++i) {
      number[i] = NumberOf(per_mm * (x[i] - from_mm), last, y[i], z[i]);
    }
  }
}
BENDLOOP_MULTIVERSION(void, NumberPatches,
                      (const PatchRows& grid, const double* x, const double* y, const double* z,
                       std::size_t count, std::int32_t* number),
                      (grid, x, y, z, count, number))

struct Range {
  double low, high;
};
BENDLOOP_LOOP Range RangeOfBody(const double* values, std::size_t count) {
  double low = values[0], high = values[0];
#pragma omp simd reduction(min : low) reduction(max : high)
  for (std::size_t i = 0; i < count; ++i) {
    low = values[i] < low ? values[i] : low;
    high = values[i] > high ? values[i] : high;
  }
  return {low, high};
}
BENDLOOP_MULTIVERSION(Range, RangeOf, (const double* values, std::size_t count), (values, count))

PatchRows RowsOf(const SegmentPoints& points, double bend_radius_mm, double patch_mm) {
  const auto rows = [patch_mm](double long_mm) {
    return std::clamp(std::ceil(long_mm / patch_mm), 1.0, kPatch.most_rows);
  };
  if (bend_radius_mm > 0) {
    return {.bend_radius_mm = bend_radius_mm,
            .rows = rows(2.0 * std::numbers::pi * bend_radius_mm)};
  }
  const Range along = RangeOf(points.x.data(), points.size);
  const double long_mm = along.high - along.low;
  const double count = rows(long_mm);
  return {.from_mm = along.low, .per_mm = long_mm > 0 ? count / long_mm : 0.0, .rows = count};
}

struct Patch {
  double n = 0, sum = 0, sum2 = 0;
};

void AddSides(const PatchRows& grid, std::span<const Patch> patches,
              std::span<DesignEffect::Side> sides) {
  for (std::size_t i = 0; i < patches.size(); ++i) {
    const Patch& patch = patches[i];
    const double row = static_cast<double>(i / kPatchesAround) + 0.5;
    const double at_mm = grid.from_mm + (grid.per_mm > 0 ? row / grid.per_mm : 0.0);
    DesignEffect::Side& side = sides[i % kPatchesAround];
    side.n += patch.n;
    side.at_mm += patch.n * at_mm;
    side.at_mm2 += patch.n * at_mm * at_mm;
    side.sum += patch.sum;
    side.at_sum += patch.sum * at_mm;
  }
}

// Sum of squares of the slopes, by what independent points would leave of them, and their freedom
// beyond a straight's direction.
std::array<double, 2> Slopes(std::span<const DesignEffect::Side> sides) {
  double squares = 0, count = 0;
  for (const DesignEffect::Side& side : sides) {
    if (side.n < 2) continue;
    const double apart_mm2 = side.at_mm2 - side.at_mm * side.at_mm / side.n;
    if (!(apart_mm2 > 0)) continue;
    const double pull = side.at_sum - side.at_mm * side.sum / side.n;
    squares += pull * pull / apart_mm2;
    count += 1;
  }
  return count > kDirection ? std::array{squares, count - kDirection} : std::array{0.0, 0.0};
}

}  // namespace

void DesignEffect::Add(std::span<const SegmentPoints> points, std::span<const SegmentFrame> frames,
                       double pipe_radius_mm, double limit_mm) {
  sides.resize(std::max(sides.size(), frames.size() * kPatchesAround));
  std::vector<Patch> all;
  std::array<std::int32_t, kBatch> number;
  for (std::size_t k = 0; k < frames.size(); ++k) {
    const SegmentPoints& of = points[k];
    if (of.size == 0) continue;
    const PatchRows grid = RowsOf(of, frames[k].bend_radius_mm, kPatch.long_part * pipe_radius_mm);
    all.assign(static_cast<std::size_t>(grid.rows) * kPatchesAround, {});
    for (std::size_t first = 0; first < of.size; first += kBatch) {
      const std::size_t count = std::min(kBatch, of.size - first);
      NumberPatches(grid, of.x.data() + first, of.y.data() + first, of.z.data() + first, count,
                    number.data());
      const double* distance = of.distance.data() + first;
      for (std::size_t i = 0; i < count; ++i) {
        const double d = distance[i];
        if (std::abs(d) > limit_mm) continue;
        Patch& patch = all[static_cast<std::size_t>(number[i])];
        patch.n += 1;
        patch.sum += d;
        patch.sum2 += d * d;
      }
    }
    if (grid.bend_radius_mm == 0) AddSides(grid, all, std::span(sides).subspan(k * kPatchesAround));
    for (const Patch& patch : all) {
      if (patch.n < 2) continue;
      const double of_mean = patch.sum * patch.sum / patch.n;
      between += of_mean;
      within += patch.sum2 - of_mean;
      patches += 1;
      freedom += patch.n - 1;
    }
  }
}

void DesignEffect::Add(const DesignEffect& other) {
  sides.resize(std::max(sides.size(), other.sides.size()));
  for (std::size_t i = 0; i < other.sides.size(); ++i) {
    sides[i].n += other.sides[i].n;
    sides[i].at_mm += other.sides[i].at_mm;
    sides[i].at_mm2 += other.sides[i].at_mm2;
    sides[i].sum += other.sides[i].sum;
    sides[i].at_sum += other.sides[i].at_sum;
  }
  between += other.between;
  within += other.within;
  patches += other.patches;
  freedom += other.freedom;
}

double DesignEffect::Value() const {
  if (freedom < 1 || within <= 0) return 1.0;
  return std::max(1.0, (between / patches) / (within / freedom));
}

double DesignEffect::OfDirections() const {
  double squares = 0, slopes = 0;
  for (std::size_t first = 0; first < sides.size(); first += kPatchesAround) {
    const auto [of_segment, count] = Slopes(std::span(sides).subspan(first, kPatchesAround));
    squares += of_segment;
    slopes += count;
  }
  if (slopes < kPatch.least_slopes || within <= 0) return Value();
  return std::clamp((squares / slopes) / (within / freedom), 1.0, Value());
}

double DesignEffect::SidesMm2() const {
  if (freedom < 1) return 0.0;
  const double noise_mm2 = within / freedom;
  double sum_mm2 = 0, straights = 0;
  for (std::size_t first = 0; first < sides.size(); first += kPatchesAround) {
    std::array<SideMean, kPatchesAround> means;
    for (std::size_t i = 0; i < means.size(); ++i) {
      const Side& side = sides[first + i];
      if (side.n > 0) means[i] = {side.n, side.sum / side.n, noise_mm2 / side.n};
    }
    const auto beyond_mm2 = BeyondNoiseMm2(means);
    if (!beyond_mm2) continue;
    sum_mm2 += *beyond_mm2;
    straights += 1;
  }
  return straights > 0 ? std::max(0.0, sum_mm2 / straights) : 0.0;
}

}  // namespace bendloop::pipeline
