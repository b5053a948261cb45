// SPDX-License-Identifier: Apache-2.0
// What benders make is no lines and arcs: the number of bends must not follow from that.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "hal/angles.h"
#include "hal/clock.h"
#include "pipeline/reconstruction.h"
#include "pipeline/tube/representations.h"
#include "pipeline/tube_model.h"
#include "tests/support/real_tube.h"
#include "tests/support/synthetic_cloud.h"

namespace bendloop::pipeline {
namespace {

hal::Tube FourBends() {
  hal::Tube tube;
  tube.pipe_radius_mm = 5;
  tube.program.rows = {{45, 0, 60, 15},
                       {55, 80, 35, 15},
                       {40, -120, 90, 15},
                       {60, 30, 20, 15},
                       {50, 0, 0, std::nullopt}};
  return tube;
}

struct RealCase {
  const char* name;
  tests::Form form;
  tests::RealScan scan;
};

class RealTube : public testing::TestWithParam<RealCase> {};

TEST_P(RealTube, HasTheBendsThatWereMade) {
  std::mt19937_64 random(7);
  const auto cloud = tests::ScanRealTube(FourBends(), GetParam().form, GetParam().scan, random);
  const hal::SteadyClock clock;
  const auto measured = Reconstruct(cloud.points_W, {}, clock);
  ASSERT_TRUE(measured) << measured.error().message;
  EXPECT_EQ(measured->tube.program.bend_count(), 4U);
}

// Not what its points lie off lines and arcs, which was told, and by which ends and openings were
// looked for.
TEST(RealTubes, NoiseIsThatOfTheSamples) {
  constexpr double kNoiseMm = 0.015;
  std::mt19937_64 random(3);
  const tests::Form form{.bow = 0.0015, .dents = {{.along = 0.3, .depth_r = 0.12}}};
  const auto cloud = tests::ScanRealTube(FourBends(), form, {.noise_mm = kNoiseMm}, random);
  const hal::SteadyClock clock;
  const auto measured = Reconstruct(cloud.points_W, {}, clock);
  ASSERT_TRUE(measured) << measured.error().message;
  EXPECT_NEAR(measured->noise_mm, kNoiseMm, 0.1 * kNoiseMm);
}

INSTANTIATE_TEST_SUITE_P(
    , RealTube,
    testing::Values(RealCase{"Bowed2000", {.bow = 0.0005}, {}},
                    RealCase{"Bowed667", {.bow = 0.0015}, {}},
                    RealCase{"Bowed300", {.bow = 0.0033}, {}},
                    RealCase{"Eased", {.easing_r = 0.7}, {}},
                    RealCase{"EasedByRamps", {.easing_r = 0.8, .ramps = true}, {}},
                    RealCase{"Dented", {.dents = {{.along = 0.45, .depth_r = 0.08}}}, {}},
                    RealCase{"Drifting", {}, {.drift_mm = 0.1, .drift_deg = 0.02}},
                    RealCase{"HeavyTails", {}, {.heavy_tail = 0.5}},
                    RealCase{"ThinEnd", {}, {.thinning = 100}}),
    [](const auto& tube) { return std::string(tube.param.name); });

// The tubes that tests/bench draws with these seeds, and their scans.
tests::RealCloud DrawnScan(std::uint64_t seed, const tests::Form& form,
                           const tests::RealScan& scan = {}, unsigned long long draws = 10,
                           std::array<double, 2> straight_r = {4, 14}) {
  std::mt19937_64 random(seed);
  const hal::Tube tube = tests::RandomTube({.pipe_radius_mm = 5,
                                            .bends = 5,
                                            .min_bend_radius = 2,
                                            .max_bend_radius = 4,
                                            .min_straight = straight_r[0],
                                            .max_straight = straight_r[1],
                                            .min_angle_deg = 15,
                                            .max_angle_deg = 100},
                                           random);
  // What it draws of form and scan: two more since there are wrinkles and seams.
  random.discard(draws + 3 * form.dents.size());
  return tests::ScanRealTube(tube, form, scan, random);
}

// A hundredth of the samples are enough for bends as clear as these, and for where the tube ends.
TEST(ThinTube, HasTheBendsAndTheEndOfItsThinPart) {
  const hal::SteadyClock clock;
  for (const std::uint64_t seed : {51'000'669, 51'000'137, 52'000'745}) {
    SCOPED_TRACE(seed);
    const auto cloud = DrawnScan(seed, {}, {.thinning = 100});
    const auto measured = Reconstruct(cloud.points_W, {}, clock);
    ASSERT_TRUE(measured) << measured.error().message;
    ASSERT_EQ(measured->tube.program.bend_count(), 5U);
    // Which way round it is told is open.
    double found_mm = 0, true_mm = 0;
    for (const hal::BendRow& row : measured->tube.program.rows) found_mm += row.length_mm;
    for (const hal::BendRow& row : cloud.truth.program.rows) true_mm += row.length_mm;
    EXPECT_NEAR(found_mm, true_mm, 5.0) << "the points at the end are 1 mm apart along it";
  }
}

// Some 15 samples are all that there is of its last bend, of 85 degrees: that the tube goes on
// behind it is told.
TEST(ThinTube, TellsThatItGoesOnWhereItBendsAway) {
  const auto cloud = DrawnScan(213'000'020, {}, {.thinning = 100}, 12);
  const hal::SteadyClock clock;
  const auto measured = Reconstruct(cloud.points_W, {}, clock);
  ASSERT_TRUE(measured) << measured.error().message;
  if (measured->tube.program.bend_count() == 5U) return;
  EXPECT_GT(measured->first_end.continues_mm + measured->last_end.continues_mm, 30);
  EXPECT_FALSE(measured->warnings.empty());
}

// Some 11 samples are all that there is of its last 21 mm.
TEST(ThinTube, IsNoSurerOfItsEndThanItsLastSamplesTell) {
  const hal::SteadyClock clock;
  for (const std::uint64_t seed : {213'000'069, 213'000'001, 213'000'002, 213'000'003}) {
    SCOPED_TRACE(seed);
    const auto cloud = DrawnScan(seed, {}, {.thinning = 70}, 12);
    const auto measured = Reconstruct(cloud.points_W, {}, clock);
    ASSERT_TRUE(measured) << measured.error().message;
    ASSERT_EQ(measured->tube.program.bend_count(), 5U);
    const auto& rows = measured->tube.program.rows;
    const double first_mm = cloud.truth.program.rows.front().length_mm;
    const bool is_reversed =
        std::abs(rows.front().length_mm - first_mm) > std::abs(rows.back().length_mm - first_mm);
    const std::size_t end = is_reversed ? 0 : 5;
    EXPECT_NEAR(rows[end].length_mm, cloud.truth.program.rows.back().length_mm,
                4 * measured->sigma.rows[end].length_mm);
  }
}

// What sits there lies off the tube, and few samples show the bend before it.
TEST(ThinTube, HasTheBendBeforeWhatSitsOnItsThinEnd) {
  const hal::SteadyClock clock;
  for (const int seed : {3, 4, 5}) {
    SCOPED_TRACE(seed);
    std::mt19937_64 random(static_cast<std::uint64_t>(seed));
    const auto cloud =
        tests::ScanRealTube(FourBends(), {.easing_r = 0.5, .at_end = tests::EndFitting::kNut},
                            {.points = 60'000, .noise_mm = 0.02, .thinning = 50}, random);
    const auto measured = Reconstruct(cloud.points_W, {}, clock);
    ASSERT_TRUE(measured) << measured.error().message;
    EXPECT_EQ(measured->tube.program.bend_count(), 4U);
  }
}

// As few as 1.6 samples a mm there, of which the fitting has a quarter.
TEST(ThinTube, HasTheNominalsBendBeforeAnyFittingOnItsThinEnd) {
  const hal::SteadyClock clock;
  using enum tests::EndFitting;
  for (const tests::EndFitting fitting : {kNut, kFlange, kFlare, kBead}) {
    SCOPED_TRACE(static_cast<int>(fitting));
    std::mt19937_64 random(1);
    const auto cloud = tests::ScanRealTube(FourBends(), {.at_end = fitting},
                                           {.points = 30'000, .thinning = 60}, random);
    ReconstructionOptions options;
    options.nominal = cloud.truth.program;
    const auto measured = Reconstruct(cloud.points_W, options, clock);
    ASSERT_TRUE(measured) << measured.error().message;
    EXPECT_EQ(measured->tube.program.bend_count(), 4U);
  }
}

// Straights of 25 to 40 pipe radii that bow by L / 500, as tests/bench draws it; `others`: numbers
// that it draws beside them.
tests::RealCloud LongBowedScan(std::uint64_t seed, std::uint64_t others) {
  std::mt19937_64 random(seed);
  const hal::Tube tube = tests::RandomTube({.pipe_radius_mm = 5,
                                            .bends = 5,
                                            .min_bend_radius = 2,
                                            .max_bend_radius = 4,
                                            .min_straight = 25,
                                            .max_straight = 40,
                                            .min_angle_deg = 15,
                                            .max_angle_deg = 100},
                                           random);
  random.discard(1);
  const double s_bow = 0.002 * std::uniform_real_distribution<double>(0, 0.3)(random);
  random.discard(others);
  return tests::ScanRealTube(tube, {.bow = 0.002, .s_bow = s_bow}, {.points = 48'000}, random);
}

// What a first solution of their bows comes to beside a slight bend that is none may lie half a
// tube aside (the first), bows make a bend of 35 degrees as tight as the joint to a neighbour (the
// second), and the best-fit lines of such straights pass each other so far that no tube of them
// meets the points (the third).
TEST(LongBowedTube, IsNotLost) {
  const hal::SteadyClock clock;
  for (const auto& [seed, others] :
       {std::pair{51'000'046, 8}, {103'000'347, 10}, {131'000'467, 10}}) {
    SCOPED_TRACE(seed);
    const auto cloud =
        LongBowedScan(static_cast<std::uint64_t>(seed), static_cast<std::uint64_t>(others));
    const auto measured = ReconstructModel(cloud.points_W, TubeModel::kAuto, {}, clock);
    ASSERT_TRUE(measured) << measured.error().message;
    EXPECT_EQ(measured->tube.program.bend_count(), 5U);
    if (seed != 51'000'046) continue;
    const auto all = static_cast<double>(measured->fit.samples + measured->fit.outliers);
    EXPECT_GT(static_cast<double>(measured->fit.samples), 0.98 * all);
  }
}

// Dents in a bend part it into three, and what sits on an end looks like a bend: no machine makes
// such, and the drawing has none.
TEST(DrawnTube, HasNoBendThatNoMachineMakes) {
  struct Case {
    std::uint64_t seed;
    tests::Form form;
  };
  const std::vector<Case> cases = {
      {131'000'176,
       {.dents = {{.along = 0.3997017, .around_rad = -1.3631685, .depth_r = 0.1047009}}}},
      {101'000'021,
       {.dents = {{.along = 0.6646877, .around_rad = 1.0986056, .depth_r = 0.1603605}}}},
      {132'000'287,
       {.dents = {{.along = 0.8964653, .around_rad = 1.8474479, .depth_r = 0.1574027},
                  {.along = 0.8779574, .around_rad = -2.5065441, .depth_r = 0.1140157},
                  {.along = 0.8438685, .around_rad = 0.2551144, .depth_r = 0.1930959}}}},
      {132'000'552, {.at_end = tests::EndFitting::kFlare}}};
  const hal::SteadyClock clock;
  for (const Case& a_case : cases) {
    SCOPED_TRACE(a_case.seed);
    const auto cloud = DrawnScan(a_case.seed, a_case.form);
    ReconstructionOptions options;
    options.nominal = cloud.truth.program;
    const auto measured = Reconstruct(cloud.points_W, options, clock);
    ASSERT_TRUE(measured) << measured.error().message;
    ASSERT_EQ(measured->tube.program.bend_count(), 5U);
    // Nor has what is dented another radius.
    const auto sum_mm = [](const hal::BendProgram& program) {
      double sum = 0;
      for (std::size_t i = 0; i < 5; ++i) sum += *program.rows[i].bend_radius_mm;
      return sum;
    };
    EXPECT_NEAR(sum_mm(measured->tube.program), sum_mm(cloud.truth.program), 0.4);
  }
}

// Bends that ease over more than the straights between them are long, as far as the drawing has
// them: no free form.
TEST(DrawnTube, StaysATubeWhereItsBendsHaveNoRoomToEase) {
  const hal::SteadyClock clock;
  for (const std::uint64_t seed : {132'000'433, 131'000'027}) {
    SCOPED_TRACE(seed);
    const auto cloud = DrawnScan(seed, {.easing_r = 1.5});
    ReconstructionOptions options;
    options.nominal = cloud.truth.program;
    const auto measured = ReconstructModel(cloud.points_W, TubeModel::kAuto, options, clock);
    ASSERT_TRUE(measured) << measured.error().message;
    EXPECT_EQ(measured->tube.program.bend_count(), 5U);
  }
}

// Fittings whose samples bend the spine's nodes aside.
TEST(FittedTube, HasNoBendInWhatSitsOnItsEnd) {
  const hal::SteadyClock clock;
  using enum tests::EndFitting;
  struct Drawn {
    std::uint64_t seed;
    tests::EndFitting at_end;
    unsigned long long draws;
  };
  for (const Drawn& drawn : std::vector<Drawn>{{21'000'016, kNut, 10},
                                               {23'000'030, kFlare, 10},
                                               {211'000'001, kFlare, 12},
                                               {211'000'003, kFlare, 12},
                                               {211'000'015, kFlare, 12}}) {
    SCOPED_TRACE(drawn.seed);
    const auto cloud = DrawnScan(drawn.seed, {.at_end = drawn.at_end}, {}, drawn.draws);
    const auto measured = Reconstruct(cloud.points_W, {}, clock);
    ASSERT_TRUE(measured) << measured.error().message;
    EXPECT_EQ(measured->tube.program.bend_count(), 5U);
  }
}

// One that is hardly thicker than the tube lies within reach of its fit: four of these had a
// bend more that led into it.
TEST(FittedTube, HasNoBendInACapOnItsEnd) {
  const hal::SteadyClock clock;
  for (std::uint64_t seed = 31'000'001; seed <= 31'000'012; ++seed) {
    SCOPED_TRACE(seed);
    const auto cloud = DrawnScan(seed, {.at_end = tests::EndFitting::kCap}, {}, 10);
    const auto measured = Reconstruct(cloud.points_W, {}, clock);
    ASSERT_TRUE(measured) << measured.error().message;
    EXPECT_EQ(measured->tube.program.bend_count(), 5U);
    const double longer_mm = std::max(measured->first_end.length_mm, measured->last_end.length_mm);
    EXPECT_NEAR(longer_mm, 2.5 * measured->tube.pipe_radius_mm,
                0.3 * measured->tube.pipe_radius_mm);
  }
}

// The angle of the tube's last bend, whichever way round it was found; its angle is no other's.
struct LastAngle {
  double error_deg, sigma_deg;
};
LastAngle LastAngleOf(const Measurement& measured, const hal::Tube& truth) {
  const std::size_t last = truth.program.bend_count() - 1;
  const double was_deg = truth.program.rows[last].angle_deg;
  const auto &rows = measured.tube.program.rows, &sigma = measured.sigma.rows;
  const std::size_t k = std::abs(rows[last].angle_deg - was_deg) < 5 ? last : 0;
  return {rows[k].angle_deg - was_deg, sigma[k].angle_deg};
}

// What is not flared looks like dents beside what is: without it the rest has no straight.
TEST(FittedTube, KeepsTheAngleBesideAFlare) {
  const hal::SteadyClock clock;
  for (const std::uint64_t seed : {181'000'133, 181'000'688, 152'000'088}) {
    SCOPED_TRACE(seed);
    const auto cloud = DrawnScan(seed, {.at_end = tests::EndFitting::kFlare}, {}, 12);
    ReconstructionOptions options;
    options.nominal = cloud.truth.program;
    const auto measured = Reconstruct(cloud.points_W, options, clock);
    ASSERT_TRUE(measured) << measured.error().message;
    ASSERT_EQ(measured->tube.program.bend_count(), 5U);
    const LastAngle angle = LastAngleOf(*measured, cloud.truth);
    EXPECT_NEAR(angle.error_deg, 0, 5 * angle.sigma_deg);
    EXPECT_LT(angle.sigma_deg, 0.1);
  }
}

// Bends of it pass its end at 2.6 pipe radii, from spine to axis.
TEST(CompactTube, HasNoFittingWhereAnotherPartOfItPassesItsEnd) {
  const hal::SteadyClock clock;
  hal::Tube tube;
  tube.pipe_radius_mm = 5;
  tube.program.rows = {{12.89, 0, 93.48, 16.05},     {9.85, -17.65, 95.13, 16.05},
                       {8.28, -5.75, 94.37, 16.05},  {11.57, 138.3, 39.82, 16.05},
                       {5.67, -65.29, 88.27, 16.05}, {13.05, 0, 0, std::nullopt}};
  for (std::uint64_t seed = 1; seed <= 12; ++seed) {
    SCOPED_TRACE(seed);
    std::mt19937_64 random(seed);
    // Where it lies among the cubes of points.
    tube.X_WT.orientation =
        Eigen::AngleAxisd(0.5 * static_cast<double>(seed), Eigen::Vector3d::UnitX()) *
        Eigen::AngleAxisd(0.3 * static_cast<double>(seed), Eigen::Vector3d::UnitY());
    const auto cloud = tests::ScanRealTube(tube, {}, {}, random);
    const auto measured = Reconstruct(cloud.points_W, {}, clock);
    ASSERT_TRUE(measured) << measured.error().message;
    EXPECT_EQ(measured->first_end.length_mm, 0);
    EXPECT_EQ(measured->last_end.length_mm, 0);
    EXPECT_THAT(measured->warnings, testing::IsEmpty());
  }
}

// A nut of 12.5 mm hides a quarter of the last straight, which bows there, too: the best-fit line
// of all of it nobody knows as well as that of the rest.
TEST(FittedTube, KnowsNotHowItBowsUnderWhatSitsOnItsEnd) {
  const hal::SteadyClock clock;
  double squares = 0;
  constexpr int kTubes = 5;
  for (std::uint64_t seed = 1; seed <= kTubes; ++seed) {
    SCOPED_TRACE(seed);
    std::mt19937_64 random(seed);
    const auto cloud = tests::ScanRealTube(
        FourBends(), {.bow = 0.002, .at_end = tests::EndFitting::kNut}, {}, random);
    ReconstructionOptions options;
    options.nominal = cloud.truth.program;
    const auto measured = Reconstruct(cloud.points_W, options, clock);
    ASSERT_TRUE(measured) << measured.error().message;
    ASSERT_EQ(measured->tube.program.bend_count(), 4U);
    const LastAngle angle = LastAngleOf(*measured, cloud.truth);
    const double error = angle.error_deg / angle.sigma_deg;
    EXPECT_LT(std::abs(error), 4) << angle.error_deg << " degrees";
    EXPECT_LT(angle.sigma_deg, 0.15);
    squares += error * error;
  }
  EXPECT_LT(squares, 2 * kTubes);
}

// Cells of the surface may part a deep one, and take the wall opposite it for pressed in.
TEST(DentedTube, HasEachDentOnce) {
  const hal::SteadyClock clock;
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    SCOPED_TRACE(seed);
    std::mt19937_64 random(seed);
    const auto part = static_cast<double>(seed) / 11.0;
    const auto cloud = tests::ScanRealTube(
        FourBends(), {.dents = {{.along = part, .around_rad = 6.0 * part, .depth_r = 0.17}}}, {},
        random);
    ReconstructionOptions options;
    options.nominal = cloud.truth.program;
    const auto measured = Reconstruct(cloud.points_W, options, clock);
    ASSERT_TRUE(measured) << measured.error().message;
    ASSERT_EQ(measured->dents.size(), 1U);
    EXPECT_NEAR(measured->dents.front().depth_mm, 0.85, 4 * measured->dents.front().sigma_mm);
  }
}

// Two, `at_mm` of the spine and 9 mm further, about on the other side.
std::vector<tests::Dent> TwoDents(double at_mm, double around_rad, double next_rad,
                                  double depth_r) {
  constexpr double kLengthMm = 303.7;  // of FourBends()
  return {{.along = at_mm / kLengthMm, .around_rad = around_rad, .depth_r = depth_r},
          {.along = (at_mm + 9) / kLengthMm, .around_rad = next_rad, .depth_r = 0.7 * depth_r}};
}

// Beside the dents nothing asks for more bends.
TEST(DentedTube, HasTheNominalsBendsWhereTwoDentsLookLikeMore) {
  struct Case {
    double ovality;
    std::vector<tests::Dent> dents;
  };
  const std::vector<Case> cases = {{0, TwoDents(176, 0.3, 3.3, 0.12)},
                                   {0, TwoDents(245, 2.3, 5.3, 0.17)},
                                   {0.05, TwoDents(184, -1.8, 1.2, 0.17)}};
  const hal::SteadyClock clock;
  for (const Case& a_case : cases) {
    SCOPED_TRACE(a_case.dents.front().along);
    std::mt19937_64 random(1);
    const auto cloud =
        tests::ScanRealTube(FourBends(), {.ovality = a_case.ovality, .dents = a_case.dents},
                            {.points = 40'000, .noise_mm = 0.02}, random);
    ReconstructionOptions options;
    options.nominal = cloud.truth.program;
    const auto measured = Reconstruct(cloud.points_W, options, clock);
    ASSERT_TRUE(measured) << measured.error().message;
    ASSERT_EQ(measured->tube.program.bend_count(), 4U);
    const auto &rows = measured->tube.program.rows, &was = cloud.truth.program.rows;
    // Which way round it is told is open.
    const bool is_reversed = std::abs(rows[0].angle_deg - was[0].angle_deg) > 5;
    for (std::size_t i = 0; i < 4; ++i) {
      EXPECT_NEAR(rows[i].angle_deg, was[is_reversed ? 3 - i : i].angle_deg,
                  5 * measured->sigma.rows[i].angle_deg);
    }
  }
}

// A bend that the drawing does not have is no dent, even where there are some.
TEST(DentedTube, HasTheBendThatItsNominalLacks) {
  const hal::SteadyClock clock;
  for (const auto& [after_mm, depth_r] : {std::pair{12.0, 0.12}, {25.0, 0.2}}) {
    SCOPED_TRACE(after_mm);
    hal::Tube tube = FourBends();
    hal::BendProgram nominal = tube.program;
    nominal.rows[3].rotation_deg += 180;
    tube.program.rows[3].length_mm -= after_mm;
    tube.program.rows.insert(tube.program.rows.begin() + 3, {after_mm, 180, 3, 15.0});
    std::mt19937_64 random(1);
    const auto cloud =
        tests::ScanRealTube(tube, {.dents = TwoDents(189 + after_mm, 1, -2, depth_r)},
                            {.points = 40'000, .noise_mm = 0.02}, random);
    ReconstructionOptions options;
    options.nominal = nominal;
    const auto measured = Reconstruct(cloud.points_W, options, clock);
    ASSERT_TRUE(measured) << measured.error().message;
    EXPECT_GT(measured->tube.program.bend_count(), 4U);
    EXPECT_FALSE(measured->warnings.empty());
  }
}

// They may be one, as a dent parts it.
TEST(BendUponBend, IsToldWhereNoNominalHasIt) {
  hal::Tube tube = FourBends();
  tube.program.rows[2].length_mm = 2;
  std::mt19937_64 random(7);
  const auto cloud = tests::ScanRealTube(tube, {}, {}, random);
  const hal::SteadyClock clock;
  const auto told = [&](const ReconstructionOptions& options) {
    const auto measured = Reconstruct(cloud.points_W, options, clock);
    EXPECT_TRUE(measured);
    return measured && std::any_of(measured->warnings.begin(), measured->warnings.end(),
                                   [](const std::string& warning) {
                                     return warning.find("clamp") != std::string::npos;
                                   });
  };
  EXPECT_TRUE(told({}));
  ReconstructionOptions as_drawn;
  as_drawn.nominal = tube.program;
  EXPECT_FALSE(told(as_drawn));
}

// The search shows such bends by three each, of which none is one as long as the others are there.
TEST(EasedTube, HasItsBendsThoughTheyEaseOverMoreThanTheirArcs) {
  const auto cloud = DrawnScan(3'000'098, {.easing_r = 1.5, .ramps = true});
  const hal::SteadyClock clock;
  const auto measured = Reconstruct(cloud.points_W, {}, clock);
  ASSERT_TRUE(measured) << measured.error().message;
  EXPECT_EQ(measured->tube.program.bend_count(), 5U);
}

// Bends of about the same angle hide what they ease over in a wider radius.
TEST(EasedTube, HasTheRadiiOfItsDieThoughItsBendsTurnAlike) {
  const auto cloud = DrawnScan(21'000'035, {.easing_r = 0.4, .ramps = true});
  const hal::SteadyClock clock;
  const auto measured = Reconstruct(cloud.points_W, {}, clock);
  ASSERT_TRUE(measured) << measured.error().message;
  ASSERT_EQ(measured->tube.program.bend_count(), 5U);
  const double radius_mm = *cloud.truth.program.rows[0].bend_radius_mm;
  for (std::size_t i = 0; i < 5; ++i) {
    EXPECT_NEAR(*measured->tube.program.rows[i].bend_radius_mm, radius_mm,
                4 * *measured->sigma.rows[i].bend_radius_mm);
  }
}

// Straights of four easing lengths have room for three quarters of what their bends' kernels would
// turn; the fit gives the rest to the radius of the die.
TEST(EasedTube, KnowsItsRadiiNoBetterThanWhatItHasNoRoomFor) {
  const hal::SteadyClock clock;
  hal::Tube tube;
  tube.pipe_radius_mm = 5;
  tube.program.rows = {{33, 0, 64, 13.8},    {42, -129, 38, 13.8}, {30, -141, 89, 13.8},
                       {26, -123, 18, 13.8}, {29, -85, 71, 13.8},  {46, 0, 0, std::nullopt}};
  double squares = 0, values = 0;
  for (std::uint64_t seed = 1; seed <= 6; ++seed) {
    SCOPED_TRACE(seed);
    std::mt19937_64 random(seed);
    const auto cloud = tests::ScanRealTube(tube, {.easing_r = 1.5}, {}, random);
    const auto measured = Reconstruct(cloud.points_W, {}, clock);
    ASSERT_TRUE(measured) << measured.error().message;
    ASSERT_EQ(measured->tube.program.bend_count(), 5U);
    for (std::size_t i = 0; i < 5; ++i) {
      const double off_mm = *measured->tube.program.rows[i].bend_radius_mm - 13.8;
      squares += std::pow(off_mm / *measured->sigma.rows[i].bend_radius_mm, 2);
      values += 1;
    }
  }
  EXPECT_LT(std::sqrt(squares / values), 1.6);
  EXPECT_GT(std::sqrt(squares / values), 0.5);
}

// Slight bends that ease, between bows, hardly know their radii: one of 17 degrees looked better as
// two, of 9 and 7, than with a radius that had lost its way.
TEST(EasedTube, HasASlightBendBetweenBowsOnce) {
  const auto cloud = DrawnScan(93'000'571,
                               {.bow = 0.00186,
                                .s_bow = 0.000075,
                                .easing_r = 0.871,
                                .ovality = 0.0465,
                                .dents = {{.along = 0.612, .around_rad = -0.353, .depth_r = 0.16}}},
                               {.points = 129'346, .noise_mm = 0.01766});
  const hal::SteadyClock clock;
  const auto measured = Reconstruct(cloud.points_W, {}, clock);
  ASSERT_TRUE(measured) << measured.error().message;
  EXPECT_EQ(measured->tube.program.bend_count(), 5U);
}

// Two of its bends were shown by three each, with nothing between those, and a straight between two
// that is hardly longer than the pipe is wide: six of them as one were none.
TEST(EasedTube, HasItsBendsWhereStraightsBetweenThemAreShort) {
  const auto cloud = DrawnScan(
      311'000'265,
      {.bow = 0.00098171401591701, .s_bow = 0.00020068441854474, .easing_r = 0.5184966647948},
      {.noise_mm = 0.005}, 12);
  const hal::SteadyClock clock;
  const auto measured = Reconstruct(cloud.points_W, {}, clock);
  ASSERT_TRUE(measured) << measured.error().message;
  EXPECT_EQ(measured->tube.program.bend_count(), 5U);
}

// Bows led the seven bends astray that were found of it. Its nominal explains the points far
// better.
TEST(LongBowedTube, IsItsNominalWhereBowsLeadAstray) {
  const auto cloud = DrawnScan(311'000'163, {.bow = 0.002, .s_bow = 0.00057605087436081},
                               {.points = 48'000}, 12, {25, 40});
  ReconstructionOptions options;
  options.nominal = cloud.truth.program;
  const hal::SteadyClock clock;
  const auto measured = Reconstruct(cloud.points_W, options, clock);
  ASSERT_TRUE(measured) << measured.error().message;
  ASSERT_EQ(measured->tube.program.bend_count(), 5U);
  for (std::size_t i = 0; i < 5; ++i) {
    EXPECT_LT(measured->sigma.rows[i].angle_deg, 0.05);
    EXPECT_NEAR(measured->tube.program.rows[i].angle_deg, cloud.truth.program.rows[i].angle_deg,
                5 * measured->sigma.rows[i].angle_deg);
  }
}

// Passes that are displaced move straights, and hardly turn them: by the scatter of patches of the
// surface alone angles and rotations were twice as exact as they said.
class DriftedTube : public testing::TestWithParam<std::size_t> {};

TEST_P(DriftedTube, KnowsItsRowsAsWellAsItSaysAndHasFewDents) {
  const hal::SteadyClock clock;
  double of_angles = 0, of_rotations = 0, of_lengths = 0;
  int tubes = 0, dents = 0;
  for (unsigned seed = 1; seed <= 32; ++seed) {
    std::mt19937_64 random(seed);
    const auto cloud = tests::ScanRealTube(
        FourBends(), {}, {.points = GetParam(), .drift_mm = 0.1, .drift_deg = 0.02}, random);
    const auto measured = Reconstruct(cloud.points_W, {}, clock);
    ASSERT_TRUE(measured) << measured.error().message;
    if (measured->tube.program.bend_count() != 4) continue;
    const auto& truth = cloud.truth.program.rows;
    const auto& first = measured->tube.program.rows.front();
    const bool is_reversed = std::abs(first.angle_deg - truth[0].angle_deg) > 10;
    const auto program =
        is_reversed ? ReverseProgram(measured->tube.program) : measured->tube.program;
    const auto sigma = is_reversed ? ReverseProgram(measured->sigma) : measured->sigma;
    for (std::size_t i = 0; i < 4; ++i) {
      of_angles +=
          std::pow((program.rows[i].angle_deg - truth[i].angle_deg) / sigma.rows[i].angle_deg, 2) /
          4;
      if (i == 0) continue;
      const double off_deg =
          hal::WrapRotationDeg(program.rows[i].rotation_deg - truth[i].rotation_deg);
      of_rotations += std::pow(off_deg / sigma.rows[i].rotation_deg, 2) / 3;
      const double off_mm = program.rows[i].length_mm - truth[i].length_mm;
      of_lengths += std::pow(off_mm / sigma.rows[i].length_mm, 2) / 3;
    }
    ++tubes;
    dents += static_cast<int>(measured->dents.size());
  }
  ASSERT_GT(tubes, 28);
  EXPECT_GT(std::sqrt(of_angles / tubes), 0.7);
  EXPECT_LT(std::sqrt(of_angles / tubes), 1.3);
  EXPECT_GT(std::sqrt(of_rotations / tubes), 0.7);
  EXPECT_LT(std::sqrt(of_rotations / tubes), 1.3);
  EXPECT_GT(std::sqrt(of_lengths / tubes), 0.6);
  EXPECT_LT(std::sqrt(of_lengths / tubes), 1.3);
  EXPECT_LE(dents, 12);
}
INSTANTIATE_TEST_SUITE_P(Points, DriftedTube, testing::Values(24'000, 100'000));

// A thousand times more points, or a thirtieth of the noise, never turn a right structure into a
// wrong one.
class SameTube : public testing::TestWithParam<std::tuple<int, int>> {};

TEST_P(SameTube, HasTheSameBendsHoweverWellItIsSeen) {
  const auto [noise_um, points] = GetParam();
  const tests::Form form = {
      .bow = 0.001, .easing_r = 0.5, .dents = {{.along = 0.3, .around_rad = 1.0, .depth_r = 0.06}}};
  std::mt19937_64 random(7);
  const auto cloud = tests::ScanRealTube(
      FourBends(), form, {.points = static_cast<std::size_t>(points), .noise_mm = 1e-3 * noise_um},
      random);
  const hal::SteadyClock clock;
  const auto measured = Reconstruct(cloud.points_W, {}, clock);
  ASSERT_TRUE(measured) << measured.error().message;
  const auto& rows = measured->tube.program.rows;
  ASSERT_EQ(rows.size(), 5U);
  const bool reversed = std::abs(rows[0].angle_deg - 60) > 5;
  for (std::size_t i = 0; i < 4; ++i) {
    EXPECT_NEAR(rows[reversed ? 3 - i : i].angle_deg, cloud.truth.program.rows[i].angle_deg, 0.3);
  }
}

INSTANTIATE_TEST_SUITE_P(, SameTube,
                         testing::Combine(testing::Values(100, 30, 10, 3),
                                          testing::Values(10'000, 100'000, 1'000'000)),
                         [](const auto& seen) {
                           return "Noise" + std::to_string(std::get<0>(seen.param)) + "umPoints" +
                                  std::to_string(std::get<1>(seen.param));
                         });

}  // namespace
}  // namespace bendloop::pipeline
