// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace bendloop::pipeline {

// Places around an end, side by side for loops that take four at once: how far a plane is beyond
// each, times a scale. Each asks one of several tables.
struct PlaneLanes {
  std::vector<double> cosine, sine, at, scale;
  std::vector<std::int32_t> table;  // where it begins
  std::size_t filled = 0;           // how many of them are none

  explicit PlaneLanes(std::size_t room = 0);

  bool empty() const { return at.empty(); }
  void Add(double cosine_of, double sine_of, double at_mm, double by, std::int32_t table_of);
  void Fill();  // with some that are none, to whole fours; then no more are added
};

// A table of even steps.
struct EvenTable {
  double from = 0, per_step = 1;  // where it begins, and 1 / step
  std::vector<double> at;         // with its last number twice
  std::size_t size = 0;           // of several, one behind the other: of each; 0: there is one

  // The sum of what it says at `places`: straight between two steps, at its ends as there.
  double Sum(std::span<const double> places) const;
  // The same of a plane that meets the axis at x[0] and rises by the others towards cosine and
  // sine; `more` is added to each.
  double Sum(const PlaneLanes& lanes, const double* x, double more) const;
  // Of the first `count`, each scaled by `by` beside its own.
  double SumFirst(const PlaneLanes& lanes, std::size_t count, const double* x, double by) const;
};

// The logarithm of the standard normal distribution and of a part `floor` that is always there, of
// places from -6 to 6.
EvenTable LogNormalCdf(double floor);

}  // namespace bendloop::pipeline
