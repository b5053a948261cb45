// SPDX-License-Identifier: Apache-2.0
#include "pipeline/spline/simplify.h"

#include <gtest/gtest.h>

#include "tests/support/shapes.h"

namespace bendloop::pipeline {
namespace {

using tests::Points;
using tests::Random;
using tests::Uniform;

double Distance(const Eigen::Vector3d& p, const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  const Eigen::Vector3d ab = b - a;
  const double t =
      ab.squaredNorm() > 0 ? std::clamp((p - a).dot(ab) / ab.squaredNorm(), 0.0, 1.0) : 0.0;
  return (p - a - t * ab).norm();
}

struct Quality {
  bool valid = true;
  double sum2 = 0;
};

Quality Judge(const Points& chain, const std::vector<std::size_t>& kept, double epsilon) {
  Quality quality;
  for (std::size_t s = 0; s + 1 < kept.size(); ++s) {
    for (std::size_t k = kept[s] + 1; k < kept[s + 1]; ++k) {
      const double d = Distance(chain[k], chain[kept[s]], chain[kept[s + 1]]);
      quality.valid = quality.valid && d <= epsilon;
      quality.sum2 += d * d;
    }
  }
  return quality;
}

// A walk that turns at random, as a spine with noise does.
Points Walk(std::size_t count, double turn, double noise, Random& random) {
  Points chain;
  Eigen::Vector3d at = Eigen::Vector3d::Zero();
  Eigen::Vector3d direction = tests::RandomUnit(random);
  for (std::size_t i = 0; i < count; ++i) {
    chain.push_back(at + noise * tests::RandomUnit(random));
    if (Uniform(random, 0, 1) < 0.5) {
      direction = (direction + turn * tests::RandomUnit(random)).normalized();
    }
    at += Uniform(random, 0.5, 1.5) * direction;
  }
  return chain;
}

TEST(Simplify, IsTheBestOfAllSubsets) {
  Random random(1);
  for (int run = 0; run < 300; ++run) {
    const std::size_t n = 2 + static_cast<std::size_t>(run) % 10;
    const Points chain = Walk(n, 0.8, 0.1, random);
    const double epsilon = Uniform(random, 0.1, 0.5);
    const auto kept = Simplify(chain, epsilon);
    ASSERT_GE(kept.size(), 2U);
    EXPECT_EQ(kept.front(), 0U);
    EXPECT_EQ(kept.back(), n - 1);
    EXPECT_TRUE(std::is_sorted(kept.begin(), kept.end()));
    const Quality quality = Judge(chain, kept, epsilon);
    EXPECT_TRUE(quality.valid) << run;
    for (unsigned mask = 0; mask < (1U << (n - 2)); ++mask) {
      std::vector<std::size_t> other{0};
      for (std::size_t k = 1; k + 1 < n; ++k) {
        if ((mask >> (k - 1)) & 1U) other.push_back(k);
      }
      other.push_back(n - 1);
      if (other.size() > kept.size()) continue;
      const Quality alternative = Judge(chain, other, epsilon);
      if (!alternative.valid) continue;
      ASSERT_EQ(other.size(), kept.size()) << "fewer segments would do, run " << run;
      ASSERT_GE(alternative.sum2, quality.sum2 * (1 - 1e-12)) << "closer would do, run " << run;
    }
  }
}

TEST(Simplify, PassesEveryPointOfLongChains) {
  Random random(2);
  for (int run = 0; run < 10; ++run) {
    const Points chain = Walk(300, 0.3, 0.05, random);
    for (const double epsilon : {0.05, 0.2, 1.0}) {
      const auto kept = Simplify(chain, epsilon);
      EXPECT_EQ(kept.front(), 0U);
      EXPECT_EQ(kept.back(), chain.size() - 1);
      EXPECT_TRUE(Judge(chain, kept, epsilon).valid);
    }
  }
}

TEST(Simplify, KnownCases) {
  Points straight, corner;
  for (int i = 0; i <= 20; ++i) straight.emplace_back(i, 2.0 * i, -i);
  EXPECT_EQ(Simplify(straight, 1e-6), (std::vector<std::size_t>{0, 20}));
  for (int i = 0; i <= 10; ++i) corner.emplace_back(i, 0, 0);
  for (int i = 1; i <= 10; ++i) corner.emplace_back(10, i, 0);
  EXPECT_EQ(Simplify(corner, 0.01), (std::vector<std::size_t>{0, 10, 20}));
  // A half circle of radius 10 at tolerance e: a segment spans at most 4 acos(1 - e / R) / 2.
  Points arc;
  for (int i = 0; i <= 180; ++i) {
    const double a = i / tests::kDegrees;
    arc.emplace_back(10 * std::cos(a), 10 * std::sin(a), 0);
  }
  const double widest_deg = 2 * std::acos(1 - 0.1 / 10) * tests::kDegrees;
  EXPECT_EQ(Simplify(arc, 0.1).size() - 1,
            static_cast<std::size_t>(std::ceil(180 / std::floor(widest_deg))));
}

TEST(Simplify, TakesShortChains) {
  EXPECT_TRUE(Simplify({}, 1).empty());
  EXPECT_EQ(Simplify(Points{{1, 2, 3}}, 1), std::vector<std::size_t>{0});
  EXPECT_EQ(Simplify(Points{{1, 2, 3}, {1, 2, 3}}, 1), (std::vector<std::size_t>{0, 1}));
  // Points on one place do not divide by nothing.
  EXPECT_EQ(Simplify(Points(5, {1, 2, 3}), 1), (std::vector<std::size_t>{0, 4}));
}

}  // namespace
}  // namespace bendloop::pipeline
