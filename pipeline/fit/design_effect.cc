// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/design_effect.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <vector>

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
  double least_freedom = 10;
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

}  // namespace

void DesignEffect::Add(std::span<const SegmentPoints> points, std::span<const SegmentFrame> frames,
                       double pipe_radius_mm, double limit_mm) {
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
    if (grid.bend_radius_mm == 0) AddSlopes(all);
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

void DesignEffect::AddSlopes(std::span<const Patch> patches_of_line) {
  double sides = 0, of_sides = 0;
  for (std::size_t side = 0; side < kPatchesAround; ++side) {
    double n = 0, at = 0, at2 = 0, sum = 0, at_sum = 0;
    for (std::size_t i = side; i < patches_of_line.size(); i += kPatchesAround) {
      const Patch& patch = patches_of_line[i];
      const auto row = static_cast<double>(i / kPatchesAround);
      n += patch.n;
      at += patch.n * row;
      at2 += patch.n * row * row;
      sum += patch.sum;
      at_sum += patch.sum * row;
    }
    if (n < 2) continue;
    const double apart = at2 - at * at / n;
    if (!(apart > 0)) continue;
    const double pull = at_sum - at * sum / n;
    of_sides += pull * pull / apart;
    sides += 1;
  }
  if (sides <= kDirection) return;
  slopes += of_sides;
  slopes_freedom += sides - kDirection;
}

void DesignEffect::Add(const DesignEffect& other) {
  slopes += other.slopes;
  slopes_freedom += other.slopes_freedom;
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
  if (slopes_freedom < kPatch.least_freedom || within <= 0) return Value();
  return std::clamp((slopes / slopes_freedom) / (within / freedom), 1.0, Value());
}

}  // namespace bendloop::pipeline
