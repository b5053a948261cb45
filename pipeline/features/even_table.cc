// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/even_table.h"

#include <cmath>
#include <cstddef>
#include <numbers>

#include "pipeline/math/simd.h"

namespace bendloop::pipeline {
namespace {

constexpr std::size_t kLanes = 4;  // that are taken at once

// Without a branch, so that several places are taken at once.
BENDLOOP_LOOP double SumTableBody(const double* table, double last, double from, double per_step,
                                  std::size_t count, const double* places) {
  double sum = 0;
#pragma omp simd reduction(+ : sum)
  for (std::size_t i = 0; i < count; ++i) {
    double place = (places[i] - from) * per_step;
    place = place > 0 ? place : 0.0;
    place = place < last ? place : last;
    const int at = static_cast<int>(place);
    sum += table[at] + (place - at) * (table[at + 1] - table[at]);
  }
  return sum;
}
BENDLOOP_MULTIVERSION(double, SumTable,
                      (const double* table, double last, double from, double per_step,
                       std::size_t count, const double* places),
                      (table, last, from, per_step, count, places))

struct PlaneTable {
  const double* table;
  double last, from, per_step;
  double x0, x1, x2, more;
};
BENDLOOP_LOOP double SumPlaneBody(const PlaneTable& of, const PlaneLanes& lanes,
                                  std::size_t count) {
  const double* const table = of.table;
  const double last = of.last, from = of.from, per_step = of.per_step;
  const double x0 = of.x0, x1 = of.x1, x2 = of.x2, more = of.more;
  const double *cosine = lanes.cosine.data(), *sine = lanes.sine.data();
  const double *at_mm = lanes.at.data(), *scale = lanes.scale.data();
  const std::int32_t* begin = lanes.table.data();
  double sum = 0;
#pragma omp simd reduction(+ : sum) simdlen(4)
  for (std::size_t i = 0; i < count; ++i) {
    const double clear = (x0 + cosine[i] * x1 + sine[i] * x2 - at_mm[i]) * scale[i] + more;
    double place = (clear - from) * per_step;
    place = place > 0 ? place : 0.0;
    place = place < last ? place : last;
    const int step = static_cast<int>(place), at = begin[i] + step;
    sum += table[at] + (place - step) * (table[at + 1] - table[at]);
  }
  return sum;
}
BENDLOOP_MULTIVERSION(double, SumPlane,
                      (const PlaneTable& of, const PlaneLanes& lanes, std::size_t count),
                      (of, lanes, count))

// Of a plane, scaled by `by` beside each lane's own scale.
PlaneTable TableOf(const EvenTable& table, const double* x, double by, double more) {
  const std::size_t one = table.size > 0 ? table.size : table.at.size();
  return {table.at.data(),
          static_cast<double>(one - 2),
          table.from / by,
          table.per_step * by,
          x[0],
          x[1],
          x[2],
          more};
}

}  // namespace

PlaneLanes::PlaneLanes(std::size_t room) {
  room += kLanes;  // those that are none
  for (std::vector<double>* numbers : {&cosine, &sine, &at, &scale}) numbers->reserve(room);
  table.reserve(room);
}

void PlaneLanes::Add(double cosine_of, double sine_of, double at_mm, double by,
                     std::int32_t table_of) {
  cosine.push_back(cosine_of);
  sine.push_back(sine_of);
  at.push_back(at_mm);
  scale.push_back(by);
  table.push_back(table_of);
}

void PlaneLanes::Fill() {
  constexpr double kFarMm = 1e100;  // beyond any table
  for (; at.size() % kLanes != 0; ++filled) Add(0.0, 0.0, -kFarMm, 1.0, 0);
}

double EvenTable::Sum(const PlaneLanes& lanes, const double* x, double more) const {
  if (lanes.empty()) return 0.0;
  const std::size_t one = size > 0 ? size : at.size();
  return SumPlane(TableOf(*this, x, 1.0, more), lanes, lanes.at.size()) -
         static_cast<double>(lanes.filled) * at[one - 1];
}

double EvenTable::SumFirst(const PlaneLanes& lanes, std::size_t count, const double* x,
                           double by) const {
  return count == 0 ? 0.0 : SumPlane(TableOf(*this, x, by, 0.0), lanes, count);
}

EvenTable LogNormalCdf(double floor) {
  constexpr std::size_t kSize = 481;
  constexpr double kFrom = -6.0, kStep = 0.025;
  EvenTable table{kFrom, 1.0 / kStep, {}};
  for (std::size_t i = 0; i < kSize; ++i) {
    const double z = kFrom + kStep * static_cast<double>(i);
    table.at.push_back(
        std::log(floor + (1.0 - floor) * 0.5 * std::erfc(-z * std::numbers::sqrt2 / 2.0)));
  }
  table.at.push_back(table.at.back());
  return table;
}

double EvenTable::Sum(std::span<const double> places) const {
  if (places.empty()) return 0.0;
  return SumTable(at.data(), static_cast<double>(at.size() - 2), from, per_step, places.size(),
                  places.data());
}

}  // namespace bendloop::pipeline
