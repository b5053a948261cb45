// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/montecarlo_cases.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <random>
#include <span>

#include "hal/spine.h"
#include "tests/support/synthetic_cloud.h"

namespace bendloop::bench {
namespace {

using Random = std::mt19937_64;
using Points = std::vector<Eigen::Vector3d>;
using Range = std::array<double, 2>;

constexpr double kPi = std::numbers::pi;

enum class Views { kAny, kOne, kTwo, kAllRound };
enum class Scene { kTubeAlone, kTable, kClamp, kSecondTube, kSecondTubeAndNominal };

// What all tubes of a kind share; the rest is drawn from the ranges of the defaults.
struct Kind {
  const char* name;
  Range pipe_radius_mm = {2, 50};
  Range bends = {1, 14};
  Range angle_deg = {2, 250};    // mostly 10 to 120
  Range bend_radius = {1.5, 6};  // of r_P
  Range straight = {0, 15};      // of r_P, between bends; one in ten is nothing
  Range noise_mm = {0.02, 0.10};
  Views views = Views::kAny;
  bool stripes = false;
  Range profile_error_mm = {0, 0};
  double fliers = 0.01;
  double ovality = 0;
  Scene scene = Scene::kTubeAlone;
};

const std::vector<Kind>& Kinds() {
  static const std::vector<Kind> kinds = {
      {.name = "one view", .views = Views::kOne},
      {.name = "two views", .views = Views::kTwo},
      {.name = "all round", .views = Views::kAllRound},
      {.name = "stripes", .stripes = true},
      {.name = "pose errors", .stripes = true, .profile_error_mm = {0.02, 0.05}},
      {.name = "noisy wire", .pipe_radius_mm = {2, 4}, .noise_mm = {0.12, 0.12}},
      {.name = "fliers 5 %", .fliers = 0.05},
      {.name = "short straights", .straight = {0, 1}},
      {.name = "shallow bends", .angle_deg = {2, 10}},
      {.name = "beyond 180", .bends = {1, 4}, .angle_deg = {150, 250}, .bend_radius = {3, 6}},
      {.name = "tight bends", .bend_radius = {1.5, 2}},
      {.name = "oval 2.5 %", .ovality = 0.025},
      {.name = "clamp", .scene = Scene::kClamp},
      {.name = "table", .scene = Scene::kTable},
      {.name = "second tube", .scene = Scene::kSecondTube},
      {.name = "second, nominal", .scene = Scene::kSecondTubeAndNominal},
  };
  return kinds;
}

double Uniform(Random& random, double low, double high) {
  return std::uniform_real_distribution<double>(low, high)(random);
}
double Uniform(Random& random, const Range& range) { return Uniform(random, range[0], range[1]); }
double LogUniform(Random& random, const Range& range) {
  return std::exp(Uniform(random, std::log(range[0]), std::log(range[1])));
}
bool Chance(Random& random, double part) { return Uniform(random, 0, 1) < part; }

Eigen::Vector3d RandomUnit(Random& random) {
  std::normal_distribution<double> normal;
  return Eigen::Vector3d(normal(random), normal(random), normal(random)).normalized();
}

double DrawAngle(const Kind& kind, Random& random) {
  const bool all = kind.angle_deg[0] < 10 && kind.angle_deg[1] > 120;
  if (!all) return Uniform(random, kind.angle_deg);
  const double what = Uniform(random, 0, 1);
  if (what < 0.15) return Uniform(random, kind.angle_deg[0], 10);
  if (what > 0.88) return Uniform(random, 120, kind.angle_deg[1]);
  return Uniform(random, 10, 120);
}

// Bend by bend; one with which the tube touches itself is drawn again.
hal::Tube DrawTube(const Kind& kind, double r, int bends, Random& random) {
  const bool own_radii = Chance(random, 0.4);
  const double common = r * Uniform(random, kind.bend_radius);
  for (;;) {
    hal::Tube tube;
    tube.pipe_radius_mm = r;
    tube.program.rows.push_back({r * Uniform(random, 3, 15), 0, 0, std::nullopt});
    int tries = 0;
    while (static_cast<int>(tube.program.bend_count()) < bends && ++tries < 40 * bends) {
      hal::Tube longer = tube;
      hal::BendRow& row = longer.program.rows.back();
      const bool first = longer.program.rows.size() == 1;
      if (!first && static_cast<int>(tube.program.bend_count()) < bends) {
        row.length_mm = Chance(random, 0.1) ? 0.0 : r * Uniform(random, kind.straight);
      }
      row.rotation_deg = first ? 0.0 : Uniform(random, -180, 180);
      row.angle_deg = DrawAngle(kind, random);
      row.bend_radius_mm = own_radii ? r * Uniform(random, kind.bend_radius) : common;
      longer.program.rows.push_back({r * Uniform(random, 3, 15), 0, 0, std::nullopt});
      if (!tests::TouchesItself(longer)) tube = std::move(longer);
    }
    if (static_cast<int>(tube.program.bend_count()) < bends) continue;
    tube.X_WT = tests::RandomPose(300, random);
    return tube;
  }
}

// The least of the sines between the spine and the better of the views: 0 where neither sees it.
double WorstSine(const hal::Tube& tube, std::span<const Eigen::Vector3d> views) {
  double worst = 1;
  for (const auto& segment : hal::SpineSegments(tube.program, tube.X_WT)) {
    for (const double part : {0.0, 0.25, 0.5, 0.75, 1.0}) {
      const Eigen::Vector3d t = segment.TangentAt(part * segment.length_mm);
      double best = 0;
      for (const Eigen::Vector3d& view : views) best = std::max(best, t.cross(view).norm());
      worst = std::min(worst, best);
    }
  }
  return worst;
}

// From where the tube is seen well; empty: from all round. One view is not enough for a tube that
// runs in all directions: such tubes get two, or are walked around.
std::vector<Eigen::Vector3d> DrawViews(const hal::Tube& tube, Views views, Random& random) {
  if (views == Views::kAny) {
    const double what = Uniform(random, 0, 1);
    views = what < 0.33 ? Views::kOne : what < 0.66 ? Views::kTwo : Views::kAllRound;
  }
  for (std::size_t count = views == Views::kOne ? 1 : 2; views != Views::kAllRound && count < 3;
       ++count) {
    std::vector<Eigen::Vector3d> best;
    double best_sine = 0.35;
    for (int i = 0; i < 100; ++i) {
      std::vector<Eigen::Vector3d> some = {RandomUnit(random)};
      if (count == 2) {
        const Eigen::Vector3d axis = some[0].unitOrthogonal();
        const double turn = Uniform(random, 60, 150) * kPi / 180.0;
        some.push_back(Eigen::AngleAxisd(turn, axis) * some[0]);
      }
      const double sine = WorstSine(tube, some);
      if (sine <= best_sine) continue;
      best_sine = sine;
      best = some;
    }
    if (!best.empty()) return best;
  }
  return {};
}

// How the points of one tube are taken.
struct Sampling {
  tests::CloudOptions cloud;
  std::vector<Eigen::Vector3d> views;
  double per_area = 30;  // points on r_P^2
};

Points Scan(const hal::Tube& tube, const Sampling& sampling, Random& random) {
  tests::CloudOptions options = sampling.cloud;
  const double turn = 2.0 * kPi * (sampling.views.empty() ? 1.0 : 0.5);
  options.points = static_cast<std::size_t>(
      std::clamp(sampling.per_area * turn * hal::SpineLength(tube.program) / tube.pipe_radius_mm,
                 1500.0, 60000.0));
  if (sampling.views.empty()) return tests::SyntheticCloud(tube, options, random);
  Points points;
  for (const Eigen::Vector3d& view : sampling.views) {
    options.view_W = view;
    const Points more = tests::SyntheticCloud(tube, options, random);
    points.insert(points.end(), more.begin(), more.end());
  }
  return points;
}

// Takes up to 3 r_P of the tube away and puts the faces of a clamp there.
void Clamp(const hal::Tube& tube, Points& points, Random& random) {
  const double r = tube.pipe_radius_mm;
  const auto segments = hal::SpineSegments(tube.program, tube.X_WT);
  const double total = hal::SpineLength(tube.program);
  const double s =
      Uniform(random, std::min(4.5 * r, 0.5 * total), std::max(total - 4.5 * r, 0.5 * total));
  const auto* held = &segments.back();
  for (const auto& segment : segments) {
    if (s < segment.from_start_mm + segment.length_mm) {
      held = &segment;
      break;
    }
  }
  const Eigen::Vector3d center = held->PointAt(s - held->from_start_mm);
  const Eigen::Vector3d t = held->TangentAt(s - held->from_start_mm);
  const Eigen::Vector3d n = held->normal;
  const double half = Uniform(random, 0.5, 1.5);
  std::erase_if(points, [&](const Eigen::Vector3d& p) {
    return (p - center).norm() < 3.5 * r && std::abs((p - center).dot(t)) < half * r;
  });
  const double size = Uniform(random, 1.5, 3.0);
  const auto count = static_cast<int>(20 * 8 * (size * size + 2 * size * half));
  for (int i = 0; i < count; ++i) {
    Eigen::Vector3d b(Uniform(random, -half, half), Uniform(random, -size, size),
                      Uniform(random, -size, size));
    const int face = i % 3;
    b[face] = (i % 2 == 0 ? 1 : -1) * (face == 0 ? 0.95 * half : size);
    if (face == 0 && std::hypot(b.y(), b.z()) < 1) continue;
    points.push_back(center + r * (b.x() * t + b.y() * n + b.z() * n.cross(t)));
  }
}

void Table(const hal::Tube& tube, Points& points, Random& random) {
  const double r = tube.pipe_radius_mm;
  Eigen::Vector3d low = points.front(), high = points.front();
  for (const Eigen::Vector3d& p : points) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  const Eigen::Vector3d center = 0.5 * (low + high);
  const Eigen::Vector3d size = high - low;
  const double half = std::min(0.6 * std::max(size.x(), size.y()) + 3 * r, 40 * r);
  double lowest = 1e30;  // of the spine; fliers lie lower
  for (const auto& segment : hal::SpineSegments(tube.program, tube.X_WT)) {
    for (const double part : {0.0, 0.25, 0.5, 0.75, 1.0}) {
      lowest = std::min(lowest, segment.PointAt(part * segment.length_mm).z());
    }
  }
  const auto count = static_cast<int>(std::min(20000.0, 12 * std::pow(2 * half / r, 2)));
  for (int i = 0; i < count; ++i) {
    points.emplace_back(center.x() + Uniform(random, -half, half),
                        center.y() + Uniform(random, -half, half),
                        lowest - 1.05 * r + Uniform(random, -0.03, 0.03));
  }
}

double NearestOfSpines(const hal::Tube& a, const hal::Tube& b) {
  const auto places = [](const hal::Tube& tube) {
    Points list;
    for (const auto& segment : hal::SpineSegments(tube.program, tube.X_WT)) {
      const int steps = 1 + static_cast<int>(segment.length_mm / tube.pipe_radius_mm);
      for (int i = 0; i <= steps; ++i)
        list.push_back(segment.PointAt(segment.length_mm * i / steps));
    }
    return list;
  };
  double nearest = 1e30;
  for (const Eigen::Vector3d& p : places(a)) {
    for (const Eigen::Vector3d& q : places(b)) nearest = std::min(nearest, (p - q).norm());
  }
  return nearest;
}

// Another tube, of the same thickness or another, not far away and at most half as long.
hal::Tube DrawSecond(const Kind& kind, const hal::Tube& tube, Random& random) {
  const double r = tube.pipe_radius_mm;
  const double own = Chance(random, 0.5) ? r : r * Uniform(random, 0.6, 1.6);
  const auto segments = hal::SpineSegments(tube.program, tube.X_WT);
  for (;;) {
    const auto bends = static_cast<int>(Uniform(random, 0, 3));
    hal::Tube second = DrawTube({.name = kind.name, .angle_deg = {10, 100}}, own, bends, random);
    if (hal::SpineLength(second.program) > 0.5 * hal::SpineLength(tube.program)) {
      second.program.rows = {{0.4 * hal::SpineLength(tube.program), 0, 0, std::nullopt}};
    }
    const auto& beside = segments[static_cast<std::size_t>(Uniform(random, 0, 0.999) *
                                                           static_cast<double>(segments.size()))];
    second.X_WT.position_mm = beside.PointAt(0.5 * beside.length_mm) +
                              (r + own) * Uniform(random, 1.3, 4.0) * RandomUnit(random);
    if (NearestOfSpines(tube, second) > 1.25 * (r + own)) return second;
  }
}

// A drawing of the tube: what springback and stretch leave between it and the part.
hal::BendProgram NominalOf(const hal::BendProgram& truth, Random& random) {
  hal::BendProgram nominal = truth;
  for (std::size_t i = 0; i < nominal.rows.size(); ++i) {
    hal::BendRow& row = nominal.rows[i];
    row.length_mm = std::max(0.0, row.length_mm + Uniform(random, -0.5, 0.5));
    if (i + 1 == nominal.rows.size()) break;
    row.angle_deg += Uniform(random, -0.5, 0.5);
    if (i > 0) row.rotation_deg = hal::WrapRotationDeg(row.rotation_deg + Uniform(random, -1, 1));
  }
  return nominal;
}

// With one bend more in the middle of a straight.
void AddBend(hal::BendProgram& nominal, double r, Random& random) {
  const auto at = static_cast<std::size_t>(Uniform(random, 0, 0.999) *
                                           static_cast<double>(nominal.rows.size()));
  hal::BendRow before = nominal.rows[at];
  before.length_mm *= 0.5;
  before.rotation_deg = at == 0 ? 0 : Uniform(random, -180, 180);
  before.angle_deg = Uniform(random, 2, 20);
  before.bend_radius_mm = nominal.rows.front().bend_radius_mm.value_or(3 * r);
  nominal.rows[at].length_mm *= 0.5;
  if (at + 1 < nominal.rows.size()) nominal.rows[at].rotation_deg = Uniform(random, -180, 180);
  nominal.rows.insert(nominal.rows.begin() + static_cast<std::ptrdiff_t>(at), before);
}

// Without its slightest bend.
void DropBend(hal::BendProgram& nominal) {
  const auto slightest = std::min_element(
      nominal.rows.begin(), nominal.rows.end() - 1,
      [](const hal::BendRow& a, const hal::BendRow& b) { return a.angle_deg < b.angle_deg; });
  (slightest + 1)->length_mm += slightest->length_mm;
  if (slightest == nominal.rows.begin()) (slightest + 1)->rotation_deg = 0;
  nominal.rows.erase(slightest);
}

}  // namespace

const std::vector<std::string>& MonteCarloKinds() {
  static const std::vector<std::string> names = [] {
    std::vector<std::string> list;
    for (const Kind& kind : Kinds()) list.emplace_back(kind.name);
    return list;
  }();
  return names;
}

MonteCarloCase DrawMonteCarloCase(std::uint64_t seed, Drawing drawing) {
  const Kind& kind = Kinds()[seed % Kinds().size()];
  Random random(seed);
  MonteCarloCase result;
  result.name = kind.name;
  result.seed = seed;
  const double r = LogUniform(random, kind.pipe_radius_mm);
  const auto bends = static_cast<int>(Uniform(random, kind.bends[0], kind.bends[1] + 0.999));
  Sampling sampling;
  result.truth = DrawTube(kind, r, bends, random);
  sampling.views = DrawViews(result.truth, kind.views, random);
  sampling.per_area = Uniform(random, 20, 50);
  tests::CloudOptions& cloud = sampling.cloud;
  cloud.noise_mm = result.noise_mm = Uniform(random, kind.noise_mm);
  cloud.fliers = result.fliers = kind.fliers;
  cloud.ovality = result.ovality = kind.ovality;
  cloud.profile_error_mm = Uniform(random, kind.profile_error_mm);
  result.systematic_mm = 0.5 * kind.ovality * r + 3.0 * cloud.profile_error_mm;
  result.spacing_mm = r / std::sqrt(sampling.per_area);
  if (kind.stripes) {
    cloud.stripes_mm = result.spacing_mm = r * Uniform(random, 0.08, 0.3);
    cloud.first_stripe_mm = Uniform(random, 0, cloud.stripes_mm);
    if (Chance(random, 0.5)) cloud.stripe_tilt = Uniform(random, 0, 0.3);
  }
  result.points_W = Scan(result.truth, sampling, random);
  if (kind.scene == Scene::kClamp) Clamp(result.truth, result.points_W, random);
  if (kind.scene == Scene::kTable) Table(result.truth, result.points_W, random);
  if (kind.scene == Scene::kSecondTube || kind.scene == Scene::kSecondTubeAndNominal) {
    const Points more = Scan(DrawSecond(kind, result.truth, random), sampling, random);
    result.points_W.insert(result.points_W.end(), more.begin(), more.end());
    if (kind.scene == Scene::kSecondTubeAndNominal) {
      result.nominal = NominalOf(result.truth.program, random);
    }
  }
  std::shuffle(result.points_W.begin(), result.points_W.end(), random);
  if (drawing != Drawing::kOfKind) result.nominal = NominalOf(result.truth.program, random);
  if (drawing == Drawing::kBendMore) AddBend(*result.nominal, r, random);
  if (drawing == Drawing::kBendFewer) DropBend(*result.nominal);
  return result;
}

}  // namespace bendloop::bench
