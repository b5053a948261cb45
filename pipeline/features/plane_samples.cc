// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/plane_samples.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace bendloop::pipeline {
namespace {

constexpr double kNone = 1e300;
constexpr double kInACell = 2.0;  // samples, on the average
constexpr int kMostCells = 1024;  // each way: a few samples far away would ask for millions

}  // namespace

PlaneSamples::PlaneSamples(std::span<const Eigen::Vector2d> samples) {
  if (samples.empty()) return;
  Eigen::Vector2d high_mm = low_mm_ = samples.front();
  for (const Eigen::Vector2d& sample : samples) {
    low_mm_ = low_mm_.cwiseMin(sample);
    high_mm = high_mm.cwiseMax(sample);
  }
  const Eigen::Vector2d size_mm = high_mm - low_mm_;
  cell_mm_ = std::max(std::sqrt(kInACell * size_mm.prod() / static_cast<double>(samples.size())),
                      size_mm.maxCoeff() / kMostCells);
  if (!(cell_mm_ > 0)) cell_mm_ = 1.0;  // all in one place
  cells_ = (size_mm / cell_mm_).cast<int>() + Cell::Ones();
  begin_.assign(static_cast<std::size_t>(cells_.prod()) + 1, 0);
  std::vector<std::size_t> at;
  at.reserve(samples.size());
  for (const Eigen::Vector2d& sample : samples) {
    const Cell cell = CellOf(sample);
    at.push_back(static_cast<std::size_t>(cell.y() * cells_.x() + cell.x()));
    begin_[at.back() + 1] += 1;
  }
  std::partial_sum(begin_.begin(), begin_.end(), begin_.begin());
  std::vector<std::uint32_t> next(begin_.begin(), begin_.end() - 1);
  samples_.resize(samples.size());
  for (std::size_t i = 0; i < samples.size(); ++i) samples_[next[at[i]]++] = samples[i];
}

PlaneSamples::Cell PlaneSamples::CellOf(const Eigen::Vector2d& place) const {
  const Eigen::Vector2d cell = ((place - low_mm_) / cell_mm_).array().floor();
  return cell.cwiseMax(0.0).cwiseMin((cells_ - Cell::Ones()).cast<double>()).cast<int>();
}

template <class Nearest>
double PlaneSamples::Search(const Eigen::Vector2d& place, Nearest nearest) const {
  if (samples_.empty()) return std::sqrt(nearest.Most());
  const Cell own = CellOf(place);
  const auto look_into = [&](int x, int y) {
    const auto at = static_cast<std::size_t>(y * cells_.x() + x);
    for (std::uint32_t i = begin_[at]; i < begin_[at + 1]; ++i) {
      nearest.Take((samples_[i] - place).squaredNorm());
    }
  };
  // Ring after ring of cells; what is in the ring after this one is as far as this ring is wide.
  // From a place beside all cells it is further.
  for (int ring = 0; ring <= cells_.maxCoeff(); ++ring) {
    if (nearest.Most() <= std::pow(cell_mm_ * (ring - 1), 2) && ring > 0) break;
    for (int y = std::max(0, own.y() - ring); y <= std::min(cells_.y() - 1, own.y() + ring); ++y) {
      const bool whole = std::abs(y - own.y()) == ring;
      const int step = whole || ring == 0 ? 1 : 2 * ring;
      for (int x = own.x() - ring; x <= own.x() + ring; x += step) {
        if (x >= 0 && x < cells_.x()) look_into(x, y);
      }
    }
  }
  return std::sqrt(nearest.Most());
}

double PlaneSamples::NearestMm(const Eigen::Vector2d& place) const {
  struct First {
    double first = kNone;
    void Take(double square) { first = std::min(first, square); }
    double Most() const { return first; }
  };
  return Search(place, First{});
}

double PlaneSamples::NearestOtherMm(const Eigen::Vector2d& sample) const {
  struct Second {  // the first is the sample itself
    double first = kNone, second = kNone;
    void Take(double square) {
      if (square < first) {
        second = first;
        first = square;
      } else {
        second = std::min(second, square);
      }
    }
    double Most() const { return second; }
  };
  return Search(sample, Second{});
}

}  // namespace bendloop::pipeline
