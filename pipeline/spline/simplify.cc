// SPDX-License-Identifier: Apache-2.0
#include "pipeline/spline/simplify.h"

#include <algorithm>
#include <limits>

namespace bendloop::pipeline {
namespace {

struct Shortcut {
  double worst2 = 0;  // squared distances
  double sum2 = 0;
};

Shortcut Measure(std::span<const Eigen::Vector3d> chain, std::size_t i, std::size_t j,
                 double give_up2) {
  Shortcut result;
  const Eigen::Vector3d a = chain[i];
  const Eigen::Vector3d ab = chain[j] - a;
  const double length2 = ab.squaredNorm();
  for (std::size_t k = i + 1; k < j; ++k) {
    const Eigen::Vector3d ap = chain[k] - a;
    const double along = length2 > 0 ? std::clamp(ap.dot(ab) / length2, 0.0, 1.0) : 0.0;
    const double d2 = (ap - along * ab).squaredNorm();
    result.worst2 = std::max(result.worst2, d2);
    result.sum2 += d2;
    if (d2 > give_up2) break;
  }
  return result;
}

}  // namespace

std::vector<std::size_t> Simplify(std::span<const Eigen::Vector3d> chain, double epsilon_mm) {
  const std::size_t n = chain.size();
  if (n < 2) return n == 1 ? std::vector<std::size_t>{0} : std::vector<std::size_t>{};
  constexpr auto kUnreached = std::numeric_limits<std::size_t>::max();
  std::vector<std::size_t> segments(n, kUnreached);
  std::vector<double> error(n, 0.0);
  std::vector<std::size_t> previous(n, 0);
  segments[0] = 0;
  const double epsilon2 = epsilon_mm * epsilon_mm;
  // A shortcut that misses a point by this many tolerances will not become valid again: the curve
  // has left the direction for good. Keeps the search near linear on straights with noise (by
  // trial).
  constexpr double kHopeless = 4.0;
  const double give_up2 = kHopeless * kHopeless * epsilon2;
  // Vertices come in the order of the chain, so each is final when it is reached.
  for (std::size_t i = 0; i + 1 < n; ++i) {
    for (std::size_t j = i + 1; j < n; ++j) {
      const Shortcut shortcut = Measure(chain, i, j, give_up2);
      if (shortcut.worst2 > give_up2) break;
      if (shortcut.worst2 > epsilon2) continue;
      const std::size_t count = segments[i] + 1;
      const double sum2 = error[i] + shortcut.sum2;
      if (count < segments[j] || (count == segments[j] && sum2 < error[j])) {
        segments[j] = count;
        error[j] = sum2;
        previous[j] = i;
      }
    }
  }
  std::vector<std::size_t> vertices{n - 1};
  while (vertices.back() != 0) vertices.push_back(previous[vertices.back()]);
  std::reverse(vertices.begin(), vertices.end());
  return vertices;
}

}  // namespace bendloop::pipeline
