// SPDX-License-Identifier: Apache-2.0
#include "pipeline/spine/nn_crust.h"

#include <gtest/gtest.h>

#include <numeric>

#include "tests/support/shapes.h"

namespace bendloop::pipeline {
namespace {

using tests::Points;
using tests::Random;
using tests::Uniform;

struct Shuffled {
  Points points;
  std::vector<int> rank;  // place on the curve of points[i]
};

Shuffled Shuffle(const Points& curve, Random& random) {
  Shuffled result;
  result.rank.resize(curve.size());
  std::iota(result.rank.begin(), result.rank.end(), 0);
  std::shuffle(result.rank.begin(), result.rank.end(), random);
  for (const int r : result.rank) result.points.push_back(curve[static_cast<std::size_t>(r)]);
  return result;
}

// The curve's ranks next to rank r, -1 for an end, sorted.
CurveNeighbours RanksBeside(const Shuffled& s, const std::vector<CurveNeighbours>& found, int i) {
  CurveNeighbours n = found[static_cast<std::size_t>(i)];
  for (int& j : n) j = j < 0 ? -1 : s.rank[static_cast<std::size_t>(j)];
  std::sort(n.begin(), n.end());
  return n;
}

void ExpectSymmetric(const std::vector<CurveNeighbours>& found) {
  for (int i = 0; i < static_cast<int>(found.size()); ++i) {
    const auto& mine = found[static_cast<std::size_t>(i)];
    EXPECT_TRUE(mine[0] < 0 || mine[0] != mine[1]);
    for (const int j : mine) {
      if (j < 0) continue;
      EXPECT_NE(j, i);
      const auto& n = found[static_cast<std::size_t>(j)];
      EXPECT_TRUE(n[0] == i || n[1] == i);
    }
  }
}

TEST(NnCrust, RecoversTheOrderOfASpine) {
  Random random(1);
  for (int run = 0; run < 20; ++run) {
    const hal::Tube tube = tests::RandomTube({.bends = 1 + run % 6}, random);
    Points curve;
    const double r = tube.pipe_radius_mm;
    double next = 0;
    for (const auto& s : hal::SpineSegments(tube.program, tube.X_WT)) {
      while (next < s.from_start_mm + s.length_mm) {
        curve.push_back(s.PointAt(next - s.from_start_mm) + 0.02 * r * tests::RandomUnit(random));
        next += r * Uniform(random, 0.3, 0.5);
      }
    }
    const Shuffled shuffled = Shuffle(curve, random);
    const auto found = NnCrust(shuffled.points, 1.5 * r);
    ExpectSymmetric(found);
    const int last = static_cast<int>(curve.size()) - 1;
    for (int i = 0; i <= last; ++i) {
      const int rank = shuffled.rank[static_cast<std::size_t>(i)];
      CurveNeighbours expected{rank - 1, rank == last ? -1 : rank + 1};
      std::sort(expected.begin(), expected.end());
      EXPECT_EQ(RanksBeside(shuffled, found, i), expected) << "run " << run << " rank " << rank;
    }
  }
}

TEST(NnCrust, AClosedCurveHasNoEnds) {
  Random random(2);
  Points curve;
  for (int i = 0; i < 60; ++i) {
    const double a = 2 * tests::kPi * i / 60;
    curve.emplace_back(10 * std::cos(a), 10 * std::sin(a), 0);
  }
  for (const auto& n : NnCrust(Shuffle(curve, random).points, 2)) {
    EXPECT_GE(n[0], 0);
    EXPECT_GE(n[1], 0);
  }
}

TEST(NnCrust, LongEdgesAreGaps) {
  Random random(3);
  Points curve;
  for (int i = 0; i < 40; ++i) curve.emplace_back(i + (i >= 20 ? 5 : 0), 0, 0);
  const Shuffled shuffled = Shuffle(curve, random);
  const auto found = NnCrust(shuffled.points, 3);
  for (int i = 0; i < 40; ++i) {
    const auto n = RanksBeside(shuffled, found, i);
    const int rank = shuffled.rank[static_cast<std::size_t>(i)];
    const bool end = rank == 0 || rank == 19 || rank == 20 || rank == 39;
    EXPECT_EQ(n[0] < 0, end) << rank;
    EXPECT_GE(n[1], 0);
    if (rank < 20) {
      EXPECT_LT(n[1], 20);
    }
  }
}

TEST(NnCrust, NeighbouringCurvesStayApart) {
  Random random(4);
  Points curve;
  for (int side = 0; side < 2; ++side) {
    for (int i = 0; i < 40; ++i) curve.emplace_back(i, 2.5 * side, 0.1 * side);
  }
  const Shuffled shuffled = Shuffle(curve, random);
  const auto found = NnCrust(shuffled.points, 4);
  ExpectSymmetric(found);
  for (int i = 0; i < 80; ++i) {
    const int rank = shuffled.rank[static_cast<std::size_t>(i)];
    if (rank % 40 == 0 || rank % 40 == 39) continue;
    EXPECT_EQ(RanksBeside(shuffled, found, i), (CurveNeighbours{rank - 1, rank + 1}));
  }
}

TEST(NnCrust, TakesFewPoints) {
  EXPECT_TRUE(NnCrust({}, 1).empty());
  EXPECT_EQ(NnCrust(Points{{1, 2, 3}}, 1)[0], (CurveNeighbours{-1, -1}));
  const auto pair = NnCrust(Points{{0, 0, 0}, {1, 0, 0}}, 1.5);
  EXPECT_EQ(pair[0], (CurveNeighbours{1, -1}));
  EXPECT_EQ(pair[1], (CurveNeighbours{0, -1}));
  ExpectSymmetric(NnCrust(Points(7, {1, 2, 3}), 1));
}

}  // namespace
}  // namespace bendloop::pipeline
