// SPDX-License-Identifier: Apache-2.0
#include "pipeline/spine/thin_parts.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>

#include "hal/spine.h"
#include "hal/tube.h"
#include "pipeline/spine/mls_projection.h"

namespace bendloop::pipeline {
namespace {

constexpr double kPipeMm = 5, kNoiseMm = 0.05;
using Chance = std::mt19937_64;

// Straight, a right angle, straight: 210 mm or so.
hal::Tube OneBend() {
  hal::Tube tube;
  tube.pipe_radius_mm = kPipeMm;
  tube.program.rows = {{90, 0, 90, 15}, {100, 0, 0, std::nullopt}};
  return tube;
}

hal::SpineSegment SegmentAt(const hal::Tube& tube, double along_mm) {
  const auto segments = hal::SpineSegments(tube.program, tube.X_WT);
  std::size_t k = 0;
  while (k + 1 < segments.size() && along_mm > segments[k + 1].from_start_mm) ++k;
  return segments[k];
}

// Points all round it, so many a pipe radius of its length.
void InsertScan(const hal::Tube& tube, double from_mm, double to_mm, double per_radius,
                Chance& chance, SampleGrid& grid) {
  std::uniform_real_distribution<double> along(from_mm, to_mm), turn(0, 2 * std::numbers::pi);
  std::normal_distribution<double> noise(0, kNoiseMm);
  std::int32_t block = 0;
  for (int i = 0; i < per_radius * (to_mm - from_mm) / kPipeMm; ++i) {
    const double at_mm = along(chance), phi = turn(chance);
    const hal::SpineSegment segment = SegmentAt(tube, at_mm);
    const double in_segment_mm = at_mm - segment.from_start_mm;
    const Eigen::Vector3d side = segment.normal.cross(segment.TangentAt(in_segment_mm));
    grid.Insert(
        segment.PointAt(in_segment_mm) +
            (kPipeMm + noise(chance)) * (std::cos(phi) * side + std::sin(phi) * segment.normal),
        block);
  }
}

SpinePolygon Nodes(const hal::Tube& tube, double from_mm, double to_mm) {
  SpinePolygon nodes;
  for (double at_mm = from_mm; at_mm <= to_mm; at_mm += 2) {
    const hal::SpineSegment segment = SegmentAt(tube, at_mm);
    const double in_segment_mm = at_mm - segment.from_start_mm;
    nodes.push_back(
        {segment.PointAt(in_segment_mm), segment.TangentAt(in_segment_mm), kNoiseMm, 100});
  }
  return nodes;
}

double FarthestOffMm(const SpinePolygon& nodes, const hal::Tube& tube) {
  const SpinePolygon spine = Nodes(tube, 0, hal::SpineLength(tube.program));
  double most_mm = 0;
  for (const SpineNode& node : nodes) {
    double least_mm = std::numeric_limits<double>::infinity();
    for (const SpineNode& there : spine) {
      const Eigen::Vector3d off = node.position_mm - there.position_mm;
      least_mm = std::min(least_mm, (off - off.dot(there.tangent) * there.tangent).norm());
    }
    most_mm = std::max(most_mm, least_mm);
  }
  return most_mm;
}

struct ThinParts : testing::Test {
  hal::Tube tube = OneBend();
  double length_mm = hal::SpineLength(tube.program);
  SampleGrid grid{MlsProjection::BlockMm(kPipeMm)};
  Chance chance{5};
  std::vector<SpinePolygon> Followed(std::vector<SpinePolygon> polygons) {
    FollowThinParts(grid, kPipeMm, polygons);
    return polygons;
  }
};

// Five samples a pipe radius are a hundredth of the others.
TEST_F(ThinParts, AreFollowedThroughABendToTheEnd) {
  InsertScan(tube, 0, 70, 500, chance, grid);
  InsertScan(tube, 70, length_mm, 5, chance, grid);
  const auto polygons = Followed({Nodes(tube, 2, 66)});
  ASSERT_EQ(polygons.size(), 1U);
  const SpineNode end = Nodes(tube, length_mm, length_mm).front();
  EXPECT_LT((polygons[0].back().position_mm - end.position_mm).norm(), kPipeMm);
  EXPECT_LT(FarthestOffMm(polygons[0], tube), 0.15 * kPipeMm);
}

TEST_F(ThinParts, AreFollowedFromNodeToNode) {
  InsertScan(tube, 0, length_mm, 5, chance, grid);
  SpinePolygon with_gap = Nodes(tube, 2, 70);
  const SpinePolygon rest = Nodes(tube, 130, length_mm - 1);
  with_gap.insert(with_gap.end(), rest.begin(), rest.end());
  const auto polygons = Followed({with_gap});
  double widest_mm = 0;
  for (std::size_t i = 1; i < polygons[0].size(); ++i) {
    widest_mm =
        std::max(widest_mm, (polygons[0][i].position_mm - polygons[0][i - 1].position_mm).norm());
  }
  EXPECT_LT(widest_mm, 1.2 * kPipeMm);
  EXPECT_LT(FarthestOffMm(polygons[0], tube), 0.15 * kPipeMm);
}

TEST_F(ThinParts, TakeThePiecesThatLieOnThem) {
  InsertScan(tube, 0, 70, 500, chance, grid);
  InsertScan(tube, 70, length_mm, 10, chance, grid);
  const auto polygons = Followed({Nodes(tube, 2, 66), Nodes(tube, 150, 175)});
  EXPECT_EQ(polygons.size(), 1U) << LengthOf(polygons[0]) << " mm followed";
}

TEST_F(ThinParts, OfATubeThatEndsAreNone) {
  InsertScan(tube, 0, length_mm, 50, chance, grid);
  const SpinePolygon all = Nodes(tube, 3, length_mm - 4);
  EXPECT_EQ(Followed({all})[0].size(), all.size());
}

TEST_F(ThinParts, AreNoTableThatTheTubeLiesOn) {
  InsertScan(tube, 0, 90, 100, chance, grid);
  std::uniform_real_distribution<double> across(-8 * kPipeMm, 8 * kPipeMm), along(0, 180);
  const hal::SpineSegment first = SegmentAt(tube, 0);
  const Eigen::Vector3d side = first.normal.cross(first.tangent);
  std::int32_t block = 0;
  for (int i = 0; i < 4000; ++i) {
    grid.Insert(first.start_mm + along(chance) * first.tangent + across(chance) * side -
                    kPipeMm * first.normal,
                block);
  }
  const SpinePolygon all = Nodes(tube, 3, 86);
  EXPECT_EQ(Followed({all})[0].size(), all.size());
}

// What a clamp hides stays a gap.
TEST_F(ThinParts, AreNotWhereNoSamplesAre) {
  InsertScan(tube, 0, 30, 100, chance, grid);
  InsertScan(tube, 45, 90, 100, chance, grid);
  SpinePolygon nodes = Nodes(tube, 3, 27);
  const SpinePolygon rest = Nodes(tube, 48, 86);
  nodes.insert(nodes.end(), rest.begin(), rest.end());
  EXPECT_EQ(Followed({nodes})[0].size(), nodes.size());
}

}  // namespace
}  // namespace bendloop::pipeline
