// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/even_table.h"

#include <cstddef>

#include "pipeline/math/simd.h"

namespace bendloop::pipeline {
namespace {

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

}  // namespace

double EvenTable::Sum(std::span<const double> places) const {
  if (places.empty()) return 0.0;
  return SumTable(at.data(), static_cast<double>(at.size() - 2), from, per_step, places.size(),
                  places.data());
}

}  // namespace bendloop::pipeline
