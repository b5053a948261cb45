// SPDX-License-Identifier: Apache-2.0
#include "tests/support/real_tube.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "hal/spine.h"
#include "tests/support/uniform.h"

namespace bendloop::tests {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kStep = 0.02;    // of the pipe radius, between the places of a spine
constexpr double kSinks = 0.6;    // of the pipe radius, along a bend until its outer wall is sunk
constexpr double kWrinkle = 0.6;  // of the pipe radius, from crest to crest
// Of a table: how far it reaches beyond the tube, in pipe radii; of the tube's points at most; how
// far aslant it is seen.
constexpr double kTable = 8, kMostOfTable = 4, kAslant = 1.2;
constexpr double kSeamAt = 1.0;  // [rad]

// What sits on the end as a thicker pipe does, in pipe radii.
struct Sitting {
  double length = 0, radius = 0;
  bool is_closed = false;
};
Sitting SittingOf(EndFitting fitting) {
  switch (fitting) {
    case EndFitting::kNut:
      return {2.5, 1.6};
    case EndFitting::kFlange:
      return {0.5, 2.5};
    case EndFitting::kCap:
      return {2.5, 1.12, true};
    default:
      return {};
  }
}

Eigen::Vector3d RandomUnit(std::mt19937_64& random) {
  std::normal_distribution<double> normal;
  return Eigen::Vector3d(normal(random), normal(random), normal(random)).normalized();
}

// A spine as places close together, with a frame that does not twist.
struct Spine {
  double step_mm = 0;
  std::vector<Eigen::Vector3d> place, tangent, across;
  std::vector<Eigen::Vector2d> curvature;  // (across, tangent x across)
  std::vector<Eigen::Vector2d> turn;       // the sum of curvature up to a place
  std::vector<double> bentness;            // 0 on straights, 1 in bends
  std::vector<double> sunk;                // the same of sharp bends, whose ends are ramps
  std::vector<Eigen::Vector2d> section;    // the same towards the bend's inner side, if it rises
  double length_mm() const { return step_mm * static_cast<double>(place.size() - 1); }
  // From the start along the wall on that side: outside bends longer than the spine, inside
  // shorter.
  double AlongWallMm(double s_mm, double phi, double r_mm) const {
    const double at = s_mm / step_mm;
    const auto i = std::min(static_cast<std::size_t>(at), turn.size() - 2);
    const double f = at - static_cast<double>(i);
    const Eigen::Vector2d here = (1 - f) * turn[i] + f * turn[i + 1];
    return s_mm - r_mm * (here.x() * std::cos(phi) + here.y() * std::sin(phi));
  }
};

// How much of the step from place `i` on lies from `from` to `to` [steps], and where its middle
// does.
struct Overlap {
  double part, middle;
};
Overlap OverlapOf(std::size_t i, double from, double to) {
  const double begin = std::max(from, static_cast<double>(i));
  const double end = std::min(to, static_cast<double>(i + 1));
  return {std::max(0.0, end - begin), 0.5 * (begin + end)};
}

// What follows bend after bend in the frame that does not twist: its direction, and curvature; each
// the mean of the step from one place to the next, so that no bend or bow begins too early.
std::vector<Eigen::Vector2d> Curvatures(const hal::Tube& tube, const Form& form, double step_mm,
                                        std::vector<double>& bentness, std::mt19937_64& random) {
  const auto segments = hal::SpineSegments(tube.program, tube.X_WT);
  const double total_mm = hal::SpineLength(tube.program);
  const auto count = static_cast<std::size_t>(total_mm / step_mm) + 1;
  std::vector<Eigen::Vector2d> curvature(count, Eigen::Vector2d::Zero());
  bentness.assign(count, 0.0);
  double plane = 0;
  for (std::size_t k = 0; k < segments.size(); ++k) {
    const auto& segment = segments[k];
    const double from = segment.from_start_mm / step_mm;
    const double to = (segment.from_start_mm + segment.length_mm) / step_mm;
    const auto first = static_cast<std::size_t>(from);
    const auto last = std::min(count, static_cast<std::size_t>(std::ceil(to)));
    if (segment.is_arc()) {
      if (k > 1) plane += tube.program.rows[k / 2].rotation_deg * kPi / 180.0;
      const Eigen::Vector2d turn(std::cos(plane), std::sin(plane));
      for (std::size_t i = first; i < last; ++i) {
        const double part = OverlapOf(i, from, to).part;
        curvature[i] += part * turn / segment.bend_radius_mm;
        bentness[i] += part;
      }
      continue;
    }
    // Bows of height bow * L have the curvature 8 bow / L, or pi^2 bow / L in the middle; that of a
    // cubic is zero there.
    const double sign = Uniform(random, 0, 2 * kPi), other = Uniform(random, 0, 2 * kPi);
    const Eigen::Vector2d bow(std::cos(sign), std::sin(sign)),
        s_bow(std::cos(other), std::sin(other));
    for (std::size_t i = first; i < last; ++i) {
      const Overlap here = OverlapOf(i, from, to);
      const double t = (here.middle - from) / (to - from);
      const double of_bow = form.half_sine ? kPi * kPi * std::sin(kPi * t) : 8.0;
      curvature[i] += here.part *
                      (of_bow * form.bow * bow + 62.0 * form.s_bow * (t - 0.5) * s_bow) /
                      segment.length_mm;
    }
  }
  return curvature;
}

template <class Value>
std::vector<Value> Smoothed(const std::vector<Value>& values, double easing_r, bool ramps,
                            const Value& zero) {
  if (easing_r <= 0) return values;
  const double sigma = easing_r / kStep;  // steps
  const int reach = static_cast<int>(std::ceil((ramps ? 1.0 : 4.0) * sigma));
  std::vector<double> kernel;
  double sum = 0;
  for (int i = -reach; i <= reach; ++i) {
    kernel.push_back(ramps ? 1.0 : std::exp(-0.5 * i * i / (sigma * sigma)));
    sum += kernel.back();
  }
  std::vector<Value> smooth(values.size(), zero);
  const auto last = static_cast<int>(values.size()) - 1;
  for (int i = 0; i <= last; ++i) {
    Value mean = zero;
    for (int k = -reach; k <= reach; ++k) {
      if (i + k < 0 || i + k > last) continue;
      mean += kernel[static_cast<std::size_t>(k + reach)] / sum *
              values[static_cast<std::size_t>(i + k)];
    }
    smooth[static_cast<std::size_t>(i)] = mean;
  }
  return smooth;
}

double Size(double value) { return std::abs(value); }
double Size(const Eigen::Vector2d& value) { return value.norm(); }

// What rises and what falls, each by itself.
template <class Value>
std::vector<Value> Smoothed(const std::vector<Value>& values, const Form& form, const Value& zero) {
  if (!form.falling_r) return Smoothed(values, form.easing_r, form.ramps, zero);
  std::vector<Value> rises(values.size(), zero), falls = rises;
  for (std::size_t i = 1; i < values.size(); ++i) {
    (Size(values[i]) > Size(values[i - 1]) ? rises : falls)[i] = values[i] - values[i - 1];
  }
  rises = Smoothed(rises, form.easing_r, form.ramps, zero);
  falls = Smoothed(falls, *form.falling_r, form.ramps, zero);
  std::vector<Value> smooth(values.size(), zero);
  for (std::size_t i = 1; i < values.size(); ++i) {
    smooth[i] = smooth[i - 1] + rises[i] + falls[i];
  }
  return smooth;
}

// How far the section has risen, towards the inner side of the bend: sharp bends under a raised
// cosine.
std::vector<Eigen::Vector2d> RisingSection(const std::vector<Eigen::Vector2d>& sharp,
                                           const std::vector<double>& bentness, double rise_r) {
  const int reach = static_cast<int>(std::ceil(rise_r / kStep));
  std::vector<double> kernel;
  double sum = 0;
  for (int i = -reach; i <= reach; ++i) {
    kernel.push_back(1.0 + std::cos(kPi * i / reach));
    sum += kernel.back();
  }
  std::vector<Eigen::Vector2d> section(sharp.size(), Eigen::Vector2d::Zero());
  const auto last = static_cast<int>(sharp.size()) - 1;
  for (int i = 0; i <= last; ++i) {
    for (int k = std::max(0, i - reach); k <= std::min(last, i + reach); ++k) {
      const auto at = static_cast<std::size_t>(k);
      if (bentness[at] == 0) continue;
      section[static_cast<std::size_t>(i)] += kernel[static_cast<std::size_t>(k - i + reach)] /
                                              sum * bentness[at] * sharp[at].normalized();
    }
  }
  return section;
}

Spine MakeSpine(const hal::Tube& tube, const Form& form, std::mt19937_64& random) {
  Spine spine;
  spine.step_mm = kStep * tube.pipe_radius_mm;
  std::vector<double> bentness;
  const auto sharp = Curvatures(tube, form, spine.step_mm, bentness, random);
  spine.curvature = Smoothed<Eigen::Vector2d>(sharp, form, Eigen::Vector2d::Zero());
  spine.bentness = Smoothed<double>(bentness, form, 0.0);
  spine.sunk = Smoothed<double>(bentness, {.easing_r = kSinks, .ramps = true}, 0.0);
  for (double& part : spine.sunk) part = std::max(0.0, 2.0 * part - 1.0);
  if (form.section_rise_r) spine.section = RisingSection(sharp, bentness, *form.section_rise_r);
  const Eigen::Matrix3d R = tube.X_WT.orientation.toRotationMatrix();
  Eigen::Vector3d place = tube.X_WT.position_mm, tangent = R.col(0), across = R.col(1);
  Eigen::Vector2d turned = Eigen::Vector2d::Zero();
  for (const Eigen::Vector2d& k : spine.curvature) {
    spine.turn.push_back(turned);
    turned += spine.step_mm * k;
    spine.place.push_back(place);
    spine.tangent.push_back(tangent);
    spine.across.push_back(across);
    const Eigen::Vector3d binormal = tangent.cross(across);
    // Turned by the curvature's integral about (tangent x direction).
    const Eigen::Vector3d axis = k.x() * binormal - k.y() * across;
    const double angle = axis.norm() * spine.step_mm;
    const Eigen::Quaterniond turn(angle > 0 ? Eigen::AngleAxisd(angle, axis.normalized())
                                            : Eigen::AngleAxisd::Identity());
    const Eigen::Vector3d next = turn * tangent;
    // The chord of the arc between them.
    const double chord = angle > 0 ? std::sin(0.5 * angle) / (0.5 * angle) : 1.0;
    place += chord * spine.step_mm * (tangent + next).normalized();
    tangent = next.normalized();
    across = (turn * across - (turn * across).dot(tangent) * tangent).normalized();
  }
  return spine;
}

struct Line {
  Eigen::Vector3d point, direction;
};

// [mm] Standard deviation of what curvature is smoothed over.
double EasingLengthMm(const Form& form, double r_mm) {
  const double easing_r = std::max(form.easing_r, form.falling_r.value_or(0.0));
  return easing_r * r_mm / (form.ramps ? std::sqrt(3.0) : 1.0);
}

// Least squares over the places of a straight without the tangent regions: an eighth at each end,
// or two easing lengths, but for a middle fifth.
Line BestFitLine(const Spine& spine, double from_mm, double to_mm, double easing_mm) {
  const double length_mm = to_mm - from_mm;
  const double off_mm = std::clamp(2.0 * easing_mm, 0.125 * length_mm, 0.4 * length_mm);
  // Each place stands for half a step before and behind it, as far as that is of the straight.
  const double from = std::max(0.0, (from_mm + off_mm) / spine.step_mm + 0.5);
  const double to = std::max((to_mm - off_mm) / spine.step_mm + 0.5, from + 3.0);
  const auto first = static_cast<std::size_t>(from);
  const auto last = std::min(spine.place.size(), static_cast<std::size_t>(std::ceil(to)));
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  double weight = 0;
  for (std::size_t i = first; i < last; ++i) {
    mean += OverlapOf(i, from, to).part * spine.place[i];
    weight += OverlapOf(i, from, to).part;
  }
  mean /= weight;
  Eigen::Matrix3d spread = Eigen::Matrix3d::Zero();
  for (std::size_t i = first; i < last; ++i) {
    const Eigen::Vector3d off = spine.place[i] - mean;
    spread += OverlapOf(i, from, to).part * off * off.transpose();
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen(spread);
  Eigen::Vector3d direction = eigen.eigenvectors().col(2);
  if (direction.dot(spine.tangent[first]) < 0) direction = -direction;
  return {mean, direction};
}

// The tube whose straights are these lines: corners are halfway between neighbours.
hal::Tube TradeTube(const hal::Tube& program, const Form& form, const Spine& spine) {
  const auto segments = hal::SpineSegments(program.program, program.X_WT);
  std::vector<Line> lines;
  for (std::size_t k = 0; k < segments.size(); k += 2) {
    lines.push_back(BestFitLine(spine, segments[k].from_start_mm,
                                segments[k].from_start_mm + segments[k].length_mm,
                                EasingLengthMm(form, program.pipe_radius_mm)));
  }
  const auto onto = [](const Line& line, const Eigen::Vector3d& p) -> Eigen::Vector3d {
    return line.point + (p - line.point).dot(line.direction) * line.direction;
  };
  std::vector<Eigen::Vector3d> corner = {onto(lines.front(), spine.place.front())};
  for (std::size_t i = 0; i + 1 < lines.size(); ++i) {
    const Line &a = lines[i], &b = lines[i + 1];
    const Eigen::Vector3d normal = a.direction.cross(b.direction);
    const Eigen::Vector3d between = b.point - a.point;
    const double s = between.cross(b.direction).dot(normal) / normal.squaredNorm();
    const double t = between.cross(a.direction).dot(normal) / normal.squaredNorm();
    corner.push_back(0.5 * (a.point + s * a.direction + b.point + t * b.direction));
  }
  corner.push_back(onto(lines.back(), spine.place.back()));
  hal::Tube tube = program;
  std::vector<double> tangent_mm(corner.size(), 0.0);
  Eigen::Vector3d last_normal = Eigen::Vector3d::Zero();
  for (std::size_t i = 0; i + 1 < lines.size(); ++i) {
    const Eigen::Vector3d t_in = lines[i].direction, t_out = lines[i + 1].direction;
    const Eigen::Vector3d normal = t_in.cross(t_out).normalized();
    hal::BendRow& row = tube.program.rows[i];
    row.angle_deg = std::atan2(t_in.cross(t_out).norm(), t_in.dot(t_out)) * 180.0 / kPi;
    tangent_mm[i + 1] = *row.bend_radius_mm * std::tan(0.5 * row.angle_deg * kPi / 180.0);
    if (i > 0) {
      row.rotation_deg =
          std::atan2(last_normal.cross(normal).dot(t_in), last_normal.dot(normal)) * 180.0 / kPi;
    }
    last_normal = normal;
  }
  for (std::size_t i = 0; i < tube.program.rows.size(); ++i) {
    tube.program.rows[i].length_mm =
        (corner[i + 1] - corner[i]).norm() - tangent_mm[i] - tangent_mm[i + 1];
  }
  return tube;
}

class Scanner {
 public:
  Scanner(const hal::Tube& tube, const Form& form, const RealScan& scan, const Spine& spine,
          std::mt19937_64& random)
      : r_(tube.pipe_radius_mm), form_(form), scan_(scan), spine_(spine), random_(random) {}

  std::vector<Eigen::Vector3d> Pass(const Eigen::Vector3d& to_sensor, std::size_t points) {
    std::vector<Eigen::Vector3d> cloud;
    std::normal_distribution<double> noise(0.0, scan_.noise_mm);
    std::student_t_distribution<double> heavy(2.0);
    while (cloud.size() < points) {
      const double s_mm = Uniform(random_, 0, spine_.length_mm());
      const double part = s_mm / spine_.length_mm();
      // Gradually over a tenth of the length, from two thirds on.
      const double thinned =
          scan_.thins_all_along ? part : std::clamp((part - 2.0 / 3.0) / 0.1, 0.0, 1.0);
      const double thin = std::pow(scan_.thinning, -thinned);
      if (Uniform(random_, 0, 1) > thin) continue;
      const double phi = Uniform(random_, 0, 2 * kPi);
      Eigen::Vector3d point, normal;
      if (!Place(s_mm, phi, point, normal) || normal.dot(to_sensor) < 0.1) continue;
      double off_mm = noise(random_);
      if (scan_.heavy_tail > 0 && Uniform(random_, 0, 1) < scan_.heavy_tail) {
        off_mm = scan_.noise_mm * heavy(random_);
      }
      cloud.push_back(point + off_mm * normal);
    }
    return cloud;
  }

 private:
  // Of the wall, at a place and on a side.
  double FlattenedRadiusMm(std::size_t i, double phi) const {
    const bool rises = form_.section_rise_r.has_value();
    const Eigen::Vector2d inner = rises ? spine_.section[i] : spine_.curvature[i];
    if (inner.norm() == 0) return r_;
    const double from_plane = phi - std::atan2(inner.y(), inner.x());
    const double oval = rises ? inner.norm() : spine_.bentness[i];
    const double sunk = rises ? inner.norm() : spine_.sunk[i];
    return r_ * (1.0 - 0.5 * form_.ovality * oval * std::cos(2 * from_plane)) -
           form_.sunk * r_ * sunk * std::pow(std::max(0.0, -std::cos(from_plane)), 3);
  }

  // A point of the surface with its normal. False: less area there, drawn again.
  bool Place(double s_mm, double phi, Eigen::Vector3d& point, Eigen::Vector3d& normal) {
    const double at = s_mm / spine_.step_mm;
    const auto i = std::min(static_cast<std::size_t>(at), spine_.place.size() - 2);
    const double f = at - static_cast<double>(i);
    const Eigen::Vector2d k = spine_.curvature[i];
    const Eigen::Vector3d tangent =
        ((1 - f) * spine_.tangent[i] + f * spine_.tangent[i + 1]).normalized();
    const Eigen::Vector3d across = (1 - f) * spine_.across[i] + f * spine_.across[i + 1];
    const Eigen::Vector3d side = (across - across.dot(tangent) * tangent).normalized();
    const Eigen::Vector3d binormal = tangent.cross(side);
    // On the arc over the chord.
    const double over_mm = 0.5 * f * (1 - f) * spine_.step_mm * spine_.step_mm;
    const Eigen::Vector3d center = (1 - f) * spine_.place[i] + f * spine_.place[i + 1] -
                                   over_mm * (k.x() * side + k.y() * binormal);
    normal = std::cos(phi) * side + std::sin(phi) * binormal;
    const double area = 1.0 - r_ * (k.x() * std::cos(phi) + k.y() * std::sin(phi));
    if (Uniform(random_, 0, 1.0 + r_ * k.norm()) > area) return false;
    double radius_mm = FlattenedRadiusMm(i, phi);
    if (form_.wrinkles > 0 && k.norm() > 0) {
      const double inner = std::max(0.0, std::cos(phi - std::atan2(k.y(), k.x())));
      radius_mm += form_.wrinkles * r_ * spine_.bentness[i] * inner * inner *
                   std::cos(2 * kPi * s_mm / (kWrinkle * r_));
    }
    if (form_.seam > 0) {
      const double beside = std::remainder(phi - kSeamAt, 2 * kPi) / form_.seam_rad;
      radius_mm += form_.seam * r_ * std::exp(-0.5 * beside * beside);
    }
    for (const Dent& dent : form_.dents) {
      const double middle_mm = dent.along * spine_.length_mm();
      const double along =
          (spine_.AlongWallMm(s_mm, phi, r_) - spine_.AlongWallMm(middle_mm, phi, r_)) / r_;
      const double around = std::remainder(phi - dent.around_rad, 2 * kPi);
      radius_mm -=
          dent.depth_r * r_ *
          std::exp(-0.5 * (along * along + around * around) / (dent.width_r * dent.width_r));
    }
    const double left = (spine_.length_mm() - s_mm) / r_;
    if (form_.at_end == EndFitting::kFlare && left < 1.5)
      radius_mm += 0.4 * r_ * (1.0 - left / 1.5);
    if (form_.at_end == EndFitting::kBead) {
      // Straight flanks of 0.3, and a top between them.
      radius_mm += r_ * std::clamp((0.4 - std::abs(left - 1.2)) / 0.3 * 0.25, 0.0, 0.25);
    }
    const Sitting sits = SittingOf(form_.at_end);
    if (left < sits.length) radius_mm = sits.radius * r_;
    if (sits.is_closed && left < 0.3 && Uniform(random_, 0, 1) < 0.5) {
      const double from_axis = sits.radius * std::sqrt(Uniform(random_, 0, 1));
      point = center + left * r_ * tangent + from_axis * r_ * normal;
      normal = tangent;
      return true;
    }
    // Its face.
    const double before = left - sits.length;
    if (sits.length > 0 && before > 0 && before < 0.3 && Uniform(random_, 0, 1) < 0.5) {
      point = center + before * r_ * tangent + Uniform(random_, 1.0, sits.radius) * r_ * normal;
      normal = -tangent;
      return true;
    }
    point = center + radius_mm * normal;
    return true;
  }

  double r_;
  const Form& form_;
  const RealScan& scan_;
  const Spine& spine_;
  std::mt19937_64& random_;
};

// Of the plane on which the tube lies flattest.
Eigen::Vector3d Upright(const Spine& spine, const Eigen::Vector3d& middle_mm) {
  Eigen::Matrix3d squares = Eigen::Matrix3d::Zero();
  for (const Eigen::Vector3d& place : spine.place) {
    squares += (place - middle_mm) * (place - middle_mm).transpose();
  }
  return Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(squares).eigenvectors().col(0);
}

// A rectangle that reaches well beyond the tube.
void AddTable(const Spine& spine, double r_mm, const Eigen::Vector3d& up, const RealScan& scan,
              std::mt19937_64& random, std::vector<Eigen::Vector3d>& cloud) {
  const Eigen::Vector3d u = up.unitOrthogonal(), v = up.cross(u);
  Eigen::AlignedBox3d box;
  for (const Eigen::Vector3d& place : spine.place) {
    box.extend(Eigen::Vector3d(place.dot(u), place.dot(v), place.dot(up)));
  }
  const Eigen::Vector3d low = box.min().array() - kTable * r_mm;
  const Eigen::Vector3d high = box.max().array() + kTable * r_mm;
  const double height_mm = box.min().z() - r_mm;
  const double per_mm2 = static_cast<double>(scan.points) / (2 * kPi * r_mm * spine.length_mm());
  const auto points =
      static_cast<std::size_t>(std::min(per_mm2 * (high - low).x() * (high - low).y(),
                                        kMostOfTable * static_cast<double>(scan.points)));
  std::normal_distribution<double> noise(0.0, scan.noise_mm);
  for (std::size_t i = 0; i < points; ++i) {
    const double x_mm = Uniform(random, low.x(), high.x()),
                 y_mm = Uniform(random, low.y(), high.y());
    cloud.push_back(x_mm * u + y_mm * v + (height_mm + noise(random)) * up);
  }
}

}  // namespace

RealCloud ScanRealTube(const hal::Tube& program, const Form& form, const RealScan& scan,
                       std::mt19937_64& random) {
  const Spine spine = MakeSpine(program, form, random);
  RealCloud cloud;
  cloud.truth = TradeTube(program, form, spine);
  Scanner scanner(program, form, scan, spine, random);
  Eigen::Vector3d axis = RandomUnit(random), first = axis.unitOrthogonal();
  Eigen::Vector3d middle = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3d& p : spine.place)
    middle += p / static_cast<double>(spine.place.size());
  if (scan.on_table) {
    axis = Upright(spine, middle);
    first = (axis + kAslant * axis.unitOrthogonal()).normalized();
  }
  std::normal_distribution<double> normal;
  const auto drift = [&] {
    return Eigen::Vector3d(normal(random), normal(random), normal(random));
  };
  for (int view = 0; view < scan.views; ++view) {
    const Eigen::Vector3d to_sensor = Eigen::AngleAxisd(2 * kPi * view / scan.views, axis) * first;
    auto points = scanner.Pass(to_sensor, scan.points / static_cast<std::size_t>(scan.views));
    const Eigen::Vector3d turn = scan.drift_deg * kPi / 180.0 * drift();
    const Eigen::Vector3d move = scan.drift_mm * drift();
    for (const Eigen::Vector3d& p : points) {
      cloud.points_W.push_back(p + move + turn.cross(p - middle));
    }
  }
  if (scan.on_table) AddTable(spine, program.pipe_radius_mm, axis, scan, random, cloud.points_W);
  return cloud;
}

}  // namespace bendloop::tests
