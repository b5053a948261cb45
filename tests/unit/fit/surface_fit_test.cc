// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/surface_fit.h"

#include <ceres/ceres.h>
#include <gtest/gtest.h>

#include <numeric>

#include "pipeline/fit/correlations.h"
#include "pipeline/fit/normal_equations.h"
#include "pipeline/fit/tube_parameters.h"
#include "tests/support/shapes.h"

namespace bendloop::pipeline {
namespace {

using tests::Points;
using tests::Random;
using tests::Uniform;

hal::Tube SomeTube(int bends, Random& random) {
  return tests::RandomTube({.pipe_radius_mm = Uniform(random, 2, 12),
                            .bends = bends,
                            .min_bend_radius = 2.5,
                            .min_straight = 4,
                            .max_straight = 12,
                            .min_angle_deg = 25,
                            .max_angle_deg = 120},
                           random);
}

// Off by up to a twentieth of the pipe radius and a degree, everywhere.
hal::Tube Perturbed(hal::Tube tube, Random& random) {
  const double r = tube.pipe_radius_mm;
  tube.pipe_radius_mm *= Uniform(random, 0.97, 1.03);
  for (std::size_t i = 0; i + 1 < tube.program.rows.size(); ++i) {
    hal::BendRow& row = tube.program.rows[i];
    row.length_mm += 0.05 * r * Uniform(random, -1, 1);
    if (i > 0) row.rotation_deg += Uniform(random, -0.5, 0.5);
    row.angle_deg += Uniform(random, -0.5, 0.5);
    row.bend_radius_mm = *row.bend_radius_mm * Uniform(random, 0.97, 1.03);
  }
  tube.X_WT.position_mm += 0.05 * r * tests::RandomUnit(random);
  return tube;
}

SurfaceFitOptions Wide(const hal::Tube& tube) {
  return {.reach_mm = 0.6 * tube.pipe_radius_mm,
          .min_sigma_mm = 1e-4 * tube.pipe_radius_mm,
          .max_steps = 100};
}

// Points that move together are worth less than they weigh; what is known without them is not.
TEST(NormalEquations, ARadiusThatNoPointTellsIsKnownAsBeforeWhateverPointsAreWorth) {
  Random random(1);
  const hal::Tube tube = SomeTube(2, random);
  const TubeParameters parameters(tube, true);
  const EasedSpine spine = SpineOf(tube.program, tube.X_WT, {});
  CondensedSum tells_nothing = CondensedSum::Zero();
  tells_nothing(kPipeRadiusState, kPipeRadiusState) = 100;
  tells_nothing(kLocalState, kLocalState) = 100 * 0.05 * 0.05;
  const std::vector<CondensedSum> sums(spine.segments.size(), tells_nothing);
  const double known_mm = 0.01 * tube.pipe_radius_mm;
  const FitPriors priors{UsualBendRadius{*tube.program.rows[0].bend_radius_mm, known_mm}};
  const NormalEquations equations(parameters, spine, sums, priors, 0.04);
  for (const double design_effect : {1.0, 9.0}) {
    const Eigen::MatrixXd covariance = equations.Covariance(parameters, tube, design_effect);
    const int radius = parameters.bend_radius(0);
    EXPECT_NEAR(std::sqrt(covariance(radius, radius)), known_mm, 0.01 * known_mm);
  }
}

// With exact points the least squares end where all distances are nothing, which they do only if
// cost and Jacobian say the same.
TEST(SurfaceFit, RecoversATubeFromExactPoints) {
  Random random(1);
  for (int run = 0; run < 12; ++run) {
    const hal::Tube tube = SomeTube(1 + run % 4, random);
    tests::CloudOptions options{.points = 3000, .noise_mm = 0};
    if (run % 3 == 0) options.view_W = tests::RandomUnit(random);
    const auto blocks =
        tests::Blocks(tests::SyntheticCloud(tube, options, random), tube.pipe_radius_mm);
    const SurfaceFit fit = FitSurface(Perturbed(tube, random), blocks, Wide(tube));
    EXPECT_NEAR(fit.tube.pipe_radius_mm, tube.pipe_radius_mm, 1e-6) << run;
    ASSERT_EQ(fit.tube.program.rows.size(), tube.program.rows.size());
    for (std::size_t i = 0; i + 1 < tube.program.rows.size(); ++i) {
      const auto& row = fit.tube.program.rows[i];
      const auto& truth = tube.program.rows[i];
      // The first length keeps the start's place along the first straight: not determined.
      if (i > 0) {
        EXPECT_NEAR(row.length_mm, truth.length_mm, 2e-6) << run;
        EXPECT_NEAR(std::remainder(row.rotation_deg - truth.rotation_deg, 360.0), 0, 1e-5) << run;
      }
      EXPECT_NEAR(row.angle_deg, truth.angle_deg, 1e-5) << run;
      EXPECT_NEAR(*row.bend_radius_mm, *truth.bend_radius_mm, 2e-5) << run;
    }
    EXPECT_LT(fit.sigma_mm, 1e-3 * tube.pipe_radius_mm);
  }
}

TEST(SurfaceFit, FixedPipeRadiusStays) {
  Random random(2);
  const hal::Tube tube = SomeTube(2, random);
  const auto blocks = tests::Blocks(tests::SyntheticCloud(tube, {}, random), tube.pipe_radius_mm);
  SurfaceFitOptions options = Wide(tube);
  options.free_pipe_radius = false;
  const SurfaceFit fit = FitSurface(tube, blocks, options);
  EXPECT_EQ(fit.tube.pipe_radius_mm, tube.pipe_radius_mm);
  EXPECT_EQ(fit.pipe_radius_sigma_mm, 0);
}

TEST(SurfaceFit, OutliersDoNotPull) {
  Random random(3);
  for (int run = 0; run < 4; ++run) {
    const hal::Tube tube = SomeTube(2, random);
    const double noise = 0.01 * tube.pipe_radius_mm;
    Points points = tests::SyntheticCloud(tube, {.noise_mm = noise}, random);
    // A seam that stands out on one side, up to half a radius.
    for (std::size_t i = 0; i < 600; ++i) {
      const auto segments = hal::SpineSegments(tube.program, tube.X_WT);
      const Eigen::Vector3d on = segments[0].PointAt(Uniform(random, 0, segments[0].length_mm));
      points.push_back(on + tube.pipe_radius_mm * Uniform(random, 1.1, 1.5) * segments[0].normal);
    }
    const SurfaceFit fit = FitSurface(tube, tests::Blocks(points, tube.pipe_radius_mm),
                                      {.reach_mm = 0.3 * tube.pipe_radius_mm});
    EXPECT_NEAR(fit.sigma_mm / noise, 1, 0.15);
    EXPECT_NEAR((fit.tube.pipe_radius_mm - tube.pipe_radius_mm) / noise, 0, 0.2);
    for (std::size_t i = 0; i < 2; ++i) {
      EXPECT_NEAR(fit.tube.program.rows[i].angle_deg, tube.program.rows[i].angle_deg, 0.1);
    }
  }
}

// The spread of the results over many scans is the one that each scan reports.
TEST(SurfaceFit, SigmaIsTheSpreadOfRepeatedScans) {
  Random random(4);
  const hal::Tube tube = SomeTube(2, random);
  constexpr int kRuns = 60;
  struct Sum {
    double error = 0, chi2 = 0;
  };
  std::map<std::string, Sum> sums;
  for (int run = 0; run < kRuns; ++run) {
    const auto points = tests::SyntheticCloud(
        tube, {.points = 2000, .noise_mm = 0.0125 * tube.pipe_radius_mm}, random);
    const SurfaceFit fit = FitSurface(tube, tests::Blocks(points, tube.pipe_radius_mm),
                                      {.reach_mm = 0.2 * tube.pipe_radius_mm});
    const auto add = [&sums](const std::string& name, double error, double sigma) {
      ASSERT_GT(sigma, 0) << name;
      sums[name].error += error / sigma;
      sums[name].chi2 += error * error / (sigma * sigma);
    };
    add("pipe radius", fit.tube.pipe_radius_mm - tube.pipe_radius_mm, fit.pipe_radius_sigma_mm);
    for (std::size_t i = 0; i < 2; ++i) {
      const auto& row = fit.tube.program.rows[i];
      const auto& truth = tube.program.rows[i];
      const auto& sigma = fit.sigma.rows[i];
      const std::string bend = " of bend " + std::to_string(i + 1);
      if (i > 0) {
        add("rotation" + bend, std::remainder(row.rotation_deg - truth.rotation_deg, 360.0),
            sigma.rotation_deg);
      }
      add("length" + bend, row.length_mm - truth.length_mm, sigma.length_mm);
      add("angle" + bend, row.angle_deg - truth.angle_deg, sigma.angle_deg);
      add("bend radius" + bend, *row.bend_radius_mm - *truth.bend_radius_mm, *sigma.bend_radius_mm);
    }
  }
  double total = 0;
  for (const auto& [name, sum] : sums) {
    // Chi-square of 60 degrees of freedom, each side beyond one in a thousand.
    EXPECT_GT(sum.chi2 / kRuns, 0.5) << name;
    EXPECT_LT(sum.chi2 / kRuns, 1.7) << name;
    EXPECT_LT(std::abs(sum.error) / std::sqrt(kRuns), 3.5) << "biased: " << name;
    total += sum.chi2 / kRuns;
  }
  total /= static_cast<double>(sums.size());
  EXPECT_GT(total, 0.7);
  EXPECT_LT(total, 1.25);
}

// Over many scans of a tube with a shallow bend, values go together as each scan says, and what it
// says of several together holds.
TEST(Correlations, AreThoseOfRepeatedScans) {
  Random random(7);
  hal::Tube tube;
  tube.pipe_radius_mm = 5;
  tube.program.rows = {
      {40, 0, 60, 20.0}, {30, 30, 4, 150.0}, {25, 80, 70, 20.0}, {40, 0, 0, std::nullopt}};
  tube.X_WT = tests::RandomPose(100, random);
  constexpr int kRuns = 80;
  constexpr Eigen::Index kColumns = 4;
  Eigen::MatrixXd values(kRuns, 3 * kColumns);
  Eigen::VectorXd planes(kRuns), lengths(kRuns);
  JointUncertainty first;
  for (int run = 0; run < kRuns; ++run) {
    const auto points = tests::SyntheticCloud(tube, {.points = 1500, .noise_mm = 0.1}, random);
    const SurfaceFit fit =
        FitSurface(tube, tests::Blocks(points, tube.pipe_radius_mm), {.reach_mm = 1});
    const auto& rows = fit.tube.program.rows;
    for (int i = 0; i < 3; ++i) {
      const auto& row = rows[static_cast<std::size_t>(i)];
      values.row(run).segment<kColumns>(kColumns * i) << row.length_mm, row.rotation_deg,
          row.angle_deg, *row.bend_radius_mm;
    }
    planes[run] = rows[1].rotation_deg + rows[2].rotation_deg;
    lengths[run] = rows[1].length_mm + rows[2].length_mm +
                   *rows[1].bend_radius_mm * rows[1].angle_deg / tests::kDegrees;
    if (run == 0) first = FindCorrelations(fit, fit.tube.program, fit.sigma);
  }
  const auto spread = [](const Eigen::VectorXd& of) {
    return std::sqrt((of.array() - of.mean()).square().sum() / (kRuns - 1));
  };
  // Fisher's z has a standard deviation of 1/sqrt(runs - 3).
  const double tolerance = 4 / std::sqrt(kRuns - 3);
  const Eigen::MatrixXd centred = values.rowwise() - values.colwise().mean();
  int found = 0;
  for (const Correlation& c : first.correlations) {
    if (c.first.row > 2 || c.second.row > 2) continue;  // the last length is no part of the fit
    const auto column = [&](const RowValue& v) {
      return centred.col(kColumns * static_cast<Eigen::Index>(v.row) +
                         static_cast<Eigen::Index>(v.kind));
    };
    const auto a = column(c.first), b = column(c.second);
    const double seen = a.dot(b) / (a.norm() * b.norm());
    EXPECT_NEAR(std::atanh(seen), std::atanh(c.coefficient), tolerance)
        << c.first.row << ' ' << static_cast<int>(c.first.kind) << " with " << c.second.row << ' '
        << static_cast<int>(c.second.kind) << ": " << seen << " is not " << c.coefficient;
    ++found;
  }
  EXPECT_GE(found, 4);

  ASSERT_EQ(first.known_together.size(), 1U);
  const KnownTogether& run = first.known_together.front();
  EXPECT_EQ(run.first_bend, 1U);
  EXPECT_EQ(run.last_bend, 1U);
  const RowValue before{1, RowValueKind::kRotation}, behind{2, RowValueKind::kRotation};
  EXPECT_NE(std::find(run.values.begin(), run.values.end(), before), run.values.end());
  EXPECT_NE(std::find(run.values.begin(), run.values.end(), behind), run.values.end());
  // A sigma from 80 runs is known to 8 %.
  EXPECT_NEAR(run.plane_sigma_deg / spread(planes), 1, 0.3);
  EXPECT_NEAR(run.length_sigma_mm / spread(lengths), 1, 0.3);
  EXPECT_NEAR(run.length_mm, 55 + 150 * 4 / tests::kDegrees, 5 * run.length_sigma_mm);
  // Across the shallow bend its plane tells where the tube goes on.
  const double sideways_deg = spread(values.col(kColumns + 1)) * 4 / tests::kDegrees;
  EXPECT_NEAR(run.direction_sigma_deg / sideways_deg, 1, 0.3);
}

// Noise that is no thin part of the pipe radius tells nothing about neighbours, however the points
// lie in blocks; laser lines that are displaced as a whole do.
TEST(SurfaceFit, NeighboursMoveTogetherOnlyWhereTheyDo) {
  Random random(10);
  hal::Tube tube;
  tube.pipe_radius_mm = 2;
  tube.program.rows = {{20, 0, 60, 8.0}, {25, 30, 40, 8.0}, {20, 0, 0, std::nullopt}};
  tests::CloudOptions options{.points = 12000, .noise_mm = 0.12};
  const auto effect = [&] {
    const auto points = tests::SyntheticCloud(tube, options, random);
    const auto blocks = tests::Blocks(points, tube.pipe_radius_mm * 2 / 3);
    return FitSurface(tube, blocks, {.reach_mm = 0.4 * tube.pipe_radius_mm}).design_effect;
  };
  EXPECT_LT(effect(), 1.15);
  options.stripes_mm = 0.4;
  EXPECT_LT(effect(), 1.15);
  options.noise_mm = 0.03;
  options.profile_error_mm = 0.03;
  EXPECT_GT(effect(), 1.5);
}

// Where nobody sees the bend its radius is anything, and so is where it begins and ends; the
// straights say how far it turns.
TEST(SurfaceFit, SaysThatAHiddenBendIsNotKnown) {
  Random random(8);
  hal::Tube tube;
  tube.pipe_radius_mm = 5;
  tube.program.rows = {
      {40, 0, 60, 20.0}, {50, 30, 8, 20.0}, {45, 80, 70, 20.0}, {40, 0, 0, std::nullopt}};
  auto points = tests::SyntheticCloud(tube, {.points = 8000, .noise_mm = 0.05}, random);
  const hal::SpineSegment hidden = hal::SpineSegments(tube.program, tube.X_WT)[3];
  const Eigen::Vector3d middle = hidden.PointAt(0.5 * hidden.length_mm);
  std::erase_if(points, [&](const Eigen::Vector3d& p) { return (p - middle).norm() < 2.2 * 5; });
  const SurfaceFit fit =
      FitSurface(tube, tests::Blocks(points, tube.pipe_radius_mm), {.reach_mm = 1});
  const auto& sigma = fit.sigma.rows;
  EXPECT_GT(*sigma[1].bend_radius_mm, 5);
  EXPECT_LT(*sigma[1].bend_radius_mm, 50);
  EXPECT_GT(sigma[1].length_mm, 0.3);
  EXPECT_GT(sigma[2].length_mm, 0.3);
  EXPECT_LT(sigma[1].angle_deg, 0.1);
  EXPECT_LT(sigma[1].rotation_deg, 1);
  EXPECT_LT(*sigma[0].bend_radius_mm, 0.1);
}

TEST(Correlations, TurnAroundWithTheTube) {
  JointUncertainty joint;
  joint.correlations = {{{1, RowValueKind::kRotation}, {2, RowValueKind::kRotation}, -0.95},
                        {{2, RowValueKind::kBendRadius}, {3, RowValueKind::kLength}, -0.97}};
  joint.known_together = {{.first_bend = 1, .last_bend = 2, .values = {{1, RowValueKind::kAngle}}}};
  const JointUncertainty reversed = Reversed(joint, 4);
  ASSERT_EQ(reversed.correlations.size(), 2U);
  EXPECT_EQ(reversed.correlations[0].first, (RowValue{1, RowValueKind::kLength}));
  EXPECT_EQ(reversed.correlations[0].second, (RowValue{1, RowValueKind::kBendRadius}));
  EXPECT_EQ(reversed.correlations[1].first, (RowValue{2, RowValueKind::kRotation}));
  EXPECT_EQ(reversed.correlations[1].second, (RowValue{3, RowValueKind::kRotation}));
  EXPECT_EQ(reversed.known_together[0].first_bend, 1U);
  EXPECT_EQ(reversed.known_together[0].last_bend, 2U);
  EXPECT_EQ(reversed.known_together[0].values[0], (RowValue{2, RowValueKind::kAngle}));
  EXPECT_EQ(Reversed(reversed, 4).correlations[0].first, joint.correlations[0].first);
}

// The distances of single points from the surface, for a solver that knows nothing of our sums.
struct PointDistances {
  const TubeParameters* parameters;
  const Points* points;

  bool operator()(double const* const* x, double* distances_mm) const {
    const hal::Tube tube =
        parameters->TubeAt(Eigen::Map<const Eigen::VectorXd>(x[0], parameters->size()));
    const auto frames = SegmentFrames(hal::SpineSegments(tube.program, tube.X_WT));
    std::vector<std::int32_t> all(frames.size());
    std::iota(all.begin(), all.end(), 0);
    for (std::size_t i = 0; i < points->size(); ++i) {
      distances_mm[i] = NearestSegment((*points)[i], frames, all).distance_mm - tube.pipe_radius_mm;
    }
    return true;
  }
};

// Started where our fit ends, Ceres' Levenberg-Marquardt with numeric derivatives and equal weights
// stays there, but for the few points that our weights fade out.
TEST(SurfaceFit, AgreesWithCeres) {
  Random random(6);
  for (int run = 0; run < 4; ++run) {
    const hal::Tube tube = SomeTube(1 + run, random);
    const Points points = tests::SyntheticCloud(
        tube, {.points = 2000, .noise_mm = 0.01 * tube.pipe_radius_mm}, random);
    const SurfaceFit fit =
        FitSurface(Perturbed(tube, random), tests::Blocks(points, tube.pipe_radius_mm), Wide(tube));
    const TubeParameters parameters(fit.tube, true);
    Eigen::VectorXd x = parameters.Initial();
    auto* const cost = new ceres::DynamicNumericDiffCostFunction<PointDistances, ceres::CENTRAL>(
        new PointDistances{&parameters, &points});
    cost->AddParameterBlock(parameters.size());
    cost->SetNumResiduals(static_cast<int>(points.size()));
    ceres::Problem problem;
    problem.AddResidualBlock(cost, nullptr, x.data());
    ceres::Solver::Options options;
    options.linear_solver_type = ceres::DENSE_QR;
    options.function_tolerance = 1e-12;
    options.logging_type = ceres::SILENT;
    ceres::Solver::Summary summary;
    ceres::Solve(options, &problem, &summary);
    ASSERT_TRUE(summary.IsSolutionUsable());
    const hal::Tube theirs = parameters.TubeAt(x);
    EXPECT_NEAR(theirs.pipe_radius_mm, fit.tube.pipe_radius_mm, 0.1 * fit.pipe_radius_sigma_mm);
    for (std::size_t i = 0; i < parameters.bends(); ++i) {
      const hal::BendRow& row = theirs.program.rows[i];
      const hal::BendRow& ours = fit.tube.program.rows[i];
      const hal::BendRow& sigma = fit.sigma.rows[i];
      EXPECT_NEAR(row.length_mm, ours.length_mm, 0.1 * sigma.length_mm) << run;
      EXPECT_NEAR(row.angle_deg, ours.angle_deg, 0.1 * sigma.angle_deg) << run;
      EXPECT_NEAR(*row.bend_radius_mm, *ours.bend_radius_mm, 0.1 * *sigma.bend_radius_mm) << run;
      if (i > 0) {
        EXPECT_NEAR(row.rotation_deg, ours.rotation_deg, 0.1 * sigma.rotation_deg) << run;
      }
    }
  }
}

// Of many points most are looked at in one step or two, from where a part of them led: what these
// leave is far below the errors, whatever part it was.
TEST(SurfaceFit, ManyPointsAreFittedToTheEnd) {
  Random random(12);
  double sum2 = 0;
  int count = 0;
  for (int run = 0; run < 4; ++run) {
    const hal::Tube tube = SomeTube(8, random);
    const Points points =
        tests::SyntheticCloud(tube, {.points = kPointsAtOnce + 20'000, .noise_mm = 0.05}, random);
    const auto blocks = tests::Blocks(points, tube.pipe_radius_mm);
    const SurfaceFit fit = FitSurface(Perturbed(tube, random), blocks, Wide(tube));
    const std::span<const PointBlock> all = blocks;
    const std::vector<PointBlock> otherwise(all.rbegin(), all.rend());
    const SurfaceFit again = FitSurface(fit.tube, otherwise, Wide(tube));
    for (std::size_t i = 0; i < 8; ++i) {
      const hal::BendRow& a = fit.tube.program.rows[i];
      const hal::BendRow& b = again.tube.program.rows[i];
      const hal::BendRow& sigma = fit.sigma.rows[i];
      sum2 += std::pow((a.angle_deg - b.angle_deg) / sigma.angle_deg, 2) +
              std::pow((*a.bend_radius_mm - *b.bend_radius_mm) / *sigma.bend_radius_mm, 2);
      count += 2;
    }
  }
  EXPECT_LT(std::sqrt(sum2 / count), 0.05);
}

TEST(SurfaceFit, TakesTooFewPoints) {
  Random random(5);
  const hal::Tube tube = SomeTube(2, random);
  const SurfaceFit none = FitSurface(tube, {}, {.reach_mm = 1});
  EXPECT_EQ(none.used, 0U);
  EXPECT_EQ(none.tube.program, tube.program);
  const auto few = tests::Blocks(tests::SyntheticCloud(tube, {.points = 5}, random), 5);
  const SurfaceFit fit = FitSurface(tube, few, {.reach_mm = 1});
  EXPECT_EQ(fit.tube.program, tube.program);
}

}  // namespace
}  // namespace bendloop::pipeline
