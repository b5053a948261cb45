// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/opening_surroundings.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numbers>
#include <numeric>
#include <set>

#include "hal/angles.h"
#include "pipeline/features/beside_border.h"
#include "pipeline/features/local_wall.h"
#include "pipeline/features/opening_lines.h"
#include "pipeline/features/plane_samples.h"
#include "pipeline/features/sampling.h"
#include "pipeline/features/unrolled_wall.h"

namespace bendloop::pipeline {
namespace {

struct LookSettings {
  // [of r_P] Samples further in are not the wall's; further out nothing hides it.
  double inside = 0.3, outside = 1.0;
  // Of how far it is looked around a place: so much of the spine its wall goes on along.
  double along = 1.5;
  // Cameras look at a laser line from so far beside it, along the tube; and how far off parts of
  // the tube are that hide a place. Steps of the search [deg, and of r_P].
  double camera_deg = 45.0, camera_step_deg = 6.0, hides_mm = 400.0, way_step = 0.2;
  // [of the way] What is so near to it hides the place, too: edges of shadows are not sharp.
  double beside = 0.05;
  // So many samples of a pass are asked whether a camera would have seen them; of these so many may
  // be wrong. [of r_P] So deep in the tube a way is certainly hidden.
  std::size_t asked = 60;
  double most_hidden = 0.03, deep = 0.1;
  // Of the samples of the wall: from so many on whose pass is known the passes are.
  double known = 0.5;
  // Of an opening: so much of it a pass of scattered samples looks through, or its density tells
  // nothing; and of the sides of that part so many have its samples. A shadow of what nobody knows
  // of has them on two sides.
  double least_part = 0.4, least_sides = 0.75;
  // And so many of all sides of what is no shadow of the tube: that is as wide as the tube.
  double surrounded = 0.9;
  int places = 9;      // of it that are asked for, each way
  double clear = 0.1;  // [of its width] beside its border samples tell of no side
  // Samples beside an opening that lie below the wall, and of those on it: fewer are fliers.
  double least_of_face = 4.0, part_of_face = 0.01;
  // [sigma] By how much less low samples may lie, for each mm that rays go towards the border while
  // they go down by one; and at least.
  double low_by_slope = 4.0, least_low = -0.5;
  // Of what is roughly its border: with less looked through it is none that is seen.
  double hardly_through = 0.2;
  // Cosine of a ray to the wall's normal: of flatter ones nobody knows where they met it.
  double flattest = 0.15;
};
constexpr LookSettings kLook;
// [sigma] Of samples where no face is seen: certainly of the wall.
constexpr double kNotBelow = -1e300;

// What of a tube stands between its own wall and a scanner: the laser above a place, or its camera,
// which looks at the line from somewhere before or behind.
class Shadows {
 public:
  explicit Shadows(const LookedAtTube& tube)
      : segments_(tube.segments),
        frames_(tube.frames),
        r_mm_(tube.pipe_radius_mm),
        all_(frames_.size()) {
    std::iota(all_.begin(), all_.end(), 0);
    for (const hal::SpineSegment& segment : segments_) {
      const Eigen::Vector3d middle_mm = segment.PointAt(0.5 * segment.length_mm);
      // Of more than half a turn an arc's farthest point is across the circle.
      const double across_mm = 2.0 * segment.bend_radius_mm;
      const bool is_more =
          segment.is_arc() && 2.0 * segment.length_mm > std::numbers::pi * across_mm;
      balls_.push_back({middle_mm, is_more ? across_mm : (segment.start_mm - middle_mm).norm()});
    }
  }

  // The laser, and where the camera of a pass may stand: what it saw is not hidden from there.
  std::vector<double> WaysOf(std::span<const SeenWall* const> seen) const {
    const std::size_t stride = StrideTo(seen.size(), kLook.asked);
    std::vector<double> turns = {0.0};
    for (double turn_deg = -kLook.camera_deg; turn_deg <= kLook.camera_deg;
         turn_deg += kLook.camera_step_deg) {
      const double turn = turn_deg * hal::kRadiansPerDegree;
      double hidden = 0, count = 0;
      for (std::size_t i = 0; i < seen.size(); i += stride) {
        hidden += IsHiddenAbout(*seen[i], turn) ? 1 : 0;
        count += 1;
      }
      if (hidden <= kLook.most_hidden * count) turns.push_back(turn);
    }
    return turns;
  }

  bool MayHide(const Eigen::Vector3d& place, SensorDirection to_sensor,
               std::span<const double> turns) const {
    const Eigen::Vector3d tangent = TangentAt(place, NearestSegment(place, frames_, all_).segment);
    return std::any_of(turns.begin(), turns.end(), [&](double turn) {
      return IsHidden(place, Way(to_sensor, tangent, turn), 0.0, kLook.beside);
    });
  }

 private:
  // Whether what was seen would not have been from any turn near this one.
  bool IsHiddenAbout(const SeenWall& seen, double turn) const {
    constexpr double kStep = kLook.camera_step_deg / 2.0 * hal::kRadiansPerDegree;
    const Eigen::Vector3d tangent = TangentAt(seen.point_mm, seen.segment);
    for (const double at : {turn, turn - kStep, turn + kStep}) {
      const Eigen::Vector3d way = Way(seen.to_sensor, tangent, at);
      if (!IsHidden(seen.point_mm, way, -kLook.deep * r_mm_, 0.0)) return false;
    }
    return true;
  }
  // Along the tube, as the sensor went there.
  Eigen::Vector3d TangentAt(const Eigen::Vector3d& point, std::int32_t segment) const {
    const std::array<std::int32_t, 1> own = {segment};
    const SpineFoot foot = NearestFoot(point, segments_, frames_, own);
    return segments_[static_cast<std::size_t>(segment)].TangentAt(foot.along_mm);
  }
  static Eigen::Vector3d Way(SensorDirection to_sensor, const Eigen::Vector3d& tangent,
                             double turn) {
    return (std::cos(turn) * TowardsSensor(to_sensor) + std::sin(turn) * tangent).normalized();
  }
  // Whether the tube comes nearer to the way than this, and than this part of how far it is.
  bool IsHidden(const Eigen::Vector3d& place, const Eigen::Vector3d& way, double least_mm,
                double least_part) const {
    const std::vector<std::int32_t> near = SegmentsBeside(place, way, least_part);
    if (near.empty()) return false;
    for (double at_mm = 0.5 * r_mm_; at_mm < kLook.hides_mm;) {
      const double free_mm = NearestSegment(place + at_mm * way, frames_, near).distance_mm - r_mm_;
      if (free_mm < least_mm + least_part * at_mm) return true;
      at_mm += std::max(free_mm, kLook.way_step * r_mm_);
    }
    return false;
  }
  // Those that come so near to the way anywhere: most of a tube is nowhere near it.
  std::vector<std::int32_t> SegmentsBeside(const Eigen::Vector3d& place, const Eigen::Vector3d& way,
                                           double part) const {
    std::vector<std::int32_t> near;
    for (std::size_t i = 0; i < balls_.size(); ++i) {
      const Eigen::Vector3d from = balls_[i].middle_mm - place;
      const double along_mm = from.dot(way), wide_mm = balls_[i].radius_mm + r_mm_;
      // Farther along the way than this it is farther from all of it than that part.
      const double last_mm = std::clamp((along_mm + wide_mm) / (1.0 - part), 0.0, kLook.hides_mm);
      const double off_mm = (from - std::clamp(along_mm, 0.0, last_mm) * way).norm();
      if (off_mm < wide_mm + part * last_mm) near.push_back(static_cast<std::int32_t>(i));
    }
    return near;
  }

  struct Ball {
    Eigen::Vector3d middle_mm;
    double radius_mm;
  };

  std::span<const hal::SpineSegment> segments_;
  std::span<const SegmentFrame> frames_;
  double r_mm_;
  std::vector<std::int32_t> all_;
  std::vector<Ball> balls_;  // about the segments' spine
};

// Of what lies about a place, in the plane across the outward direction there.
Eigen::Vector2d InPlane(const Eigen::Vector3d& point, const hal::SurfaceFrame& frame) {
  const Eigen::Vector3d from = point - frame.spine_mm;
  return {from.dot(frame.tangent), from.dot(frame.sideways())};
}

}  // namespace

std::vector<std::int32_t> LookedAtTube::SegmentsAbout(const hal::SurfaceFrame& frame,
                                                      double reach_mm) const {
  std::vector<std::int32_t> about(frames.size());
  std::iota(about.begin(), about.end(), 0);
  const SpineFoot foot = NearestFoot(frame.spine_mm, segments, frames, about);
  if (foot.segment < 0) return about;
  const double along_mm =
      segments[static_cast<std::size_t>(foot.segment)].from_start_mm + foot.along_mm;
  const double far_mm = kLook.along * reach_mm + pipe_radius_mm;
  std::erase_if(about, [&](std::int32_t i) {
    const hal::SpineSegment& segment = segments[static_cast<std::size_t>(i)];
    return segment.from_start_mm > along_mm + far_mm ||
           segment.from_start_mm + segment.length_mm < along_mm - far_mm;
  });
  return about;
}

Eigen::Vector3d LookedAtTube::OnItsRay(const Eigen::Vector3d& point, SensorDirection to_sensor,
                                       std::int32_t segment) const {
  const std::array<std::int32_t, 1> own = {segment};
  const SpineFoot foot = NearestFoot(point, segments, frames, own);
  const Eigen::Vector3d from =
      point - segments[static_cast<std::size_t>(segment)].PointAt(foot.along_mm);
  const Eigen::Vector3d way = TowardsSensor(to_sensor);
  const double cosine = way.dot(from) / foot.distance_mm;
  if (!(cosine > kLook.flattest)) return point;
  return point - (foot.distance_mm - pipe_radius_mm) / cosine * way;
}

bool Surroundings::ShowsFace(const OpeningBorder& about, double beside_mm) const {
  const auto is_near = [&](const Eigen::Vector2d& place_mm) {
    return std::abs(about.DistanceMm(place_mm)) < beside_mm;
  };
  double of_face = 0, of_wall = 0;
  for (std::size_t i = 0; i < wall.size(); ++i) {
    if (!is_near(wall[i])) continue;
    (sigmas_below[i] > kSampling.on_surface ? of_face : of_wall) += 1;
  }
  of_face += static_cast<double>(std::count_if(below.begin(), below.end(), is_near));
  return of_face > std::max(kLook.least_of_face, kLook.part_of_face * of_wall);
}

Surroundings Surroundings::WithoutFace(const OpeningBorder& about, double beside_mm) const {
  // Further off what is as low is a dent.
  const auto is_face = [&](const Eigen::Vector2d& place_mm, double sigmas) {
    return sigmas > kSampling.on_surface && about.DistanceMm(place_mm) < beside_mm;
  };
  Surroundings without;
  if (!ShowsFace(about, beside_mm)) {
    without = *this;
    without.all = wall;
    for (SeenWall& sample : without.seen) sample.sigmas_below = kNotBelow;
    return without;
  }
  without.below = below;
  for (std::size_t i = 0; i < present.size(); ++i) {
    (is_face(present[i], present_below[i]) ? without.below : without.present).push_back(present[i]);
  }
  for (std::size_t i = 0; i < wall.size(); ++i) {
    const double sigmas = sigmas_below[i];
    const bool may_be_face = sigmas > kSampling.low && sigmas <= kSampling.on_surface;
    if (is_face(wall[i], sigmas)) continue;
    without.all.push_back(wall[i]);
    if (may_be_face) continue;
    without.wall.push_back(wall[i]);
    without.sigmas_below.push_back(sigmas);
  }
  for (const SeenWall& sample : seen) {
    if (!is_face(sample.place_mm, sample.sigmas_below)) without.seen.push_back(sample);
  }
  return without;
}

Surroundings LookedAtTube::LookAt(const hal::SurfaceFrame& frame, double reach_mm,
                                  double wall_mm) const {
  const double r_mm = pipe_radius_mm;
  Surroundings around;
  const Eigen::Vector3d middle = frame.spine_mm + r_mm * frame.outward;
  const double ball_mm = std::hypot(reach_mm, (1.0 + kLook.outside) * r_mm);
  const std::vector<std::int32_t> about = SegmentsAbout(frame, reach_mm);
  std::vector<std::int32_t> candidates;
  std::vector<OffWall> off_present, off_wall;  // of `around.present` and `around.wall`
  std::vector<std::size_t> seen_at;            // of `around.seen`, in `around.wall`
  for (const PointBlock& block : blocks) {
    const double near_mm = ball_mm + block.half_diagonal_mm;
    if ((block.center_mm - middle).squaredNorm() > near_mm * near_mm) continue;
    CandidateSegments(block, frames, 2.5 * r_mm, candidates);
    if (candidates.empty()) continue;
    for (std::size_t i = 0; i < block.points.size(); ++i) {
      const Eigen::Vector3d& point = block.points[i];
      const Eigen::Vector3d from = point - frame.spine_mm;
      const Eigen::Vector2d place = InPlane(point, frame);
      if (place.norm() > reach_mm || from.dot(frame.outward) < 0) continue;
      const NearSegment near = NearestSegment(point, frames, candidates);
      const double off_mm = near.distance_mm - r_mm;
      if (off_mm < -kLook.inside * r_mm || off_mm > kLook.outside * r_mm) continue;
      // Another part of the tube, which lies before the wall or beside it, is not its wall.
      if (!std::binary_search(about.begin(), about.end(), near.segment)) {
        around.present.push_back(place);
        off_present.push_back({place, std::max(0.0, off_mm)});
        continue;
      }
      if (off_mm < -wall_mm) {
        around.below.push_back(place);
        continue;
      }
      around.present.push_back(place);
      off_present.push_back({place, off_mm});
      if (off_mm >= wall_mm) continue;
      off_wall.push_back({place, off_mm});
      if (i >= block.to_sensor.size() || !block.to_sensor[i].known()) {
        around.wall.push_back(place);
        continue;
      }
      const Eigen::Vector3d met = OnItsRay(point, block.to_sensor[i], near.segment);
      around.wall.push_back(InPlane(met, frame));
      around.seen.push_back({met, around.wall.back(), block.to_sensor[i], near.segment});
      seen_at.push_back(around.wall.size() - 1);
    }
  }
  const LocalWall local(off_wall, reach_mm, noise_mm);
  for (const OffWall& sample : off_present) {
    around.present_below.push_back(local.SigmasBelow(sample));
  }
  for (const OffWall& sample : off_wall) around.sigmas_below.push_back(local.SigmasBelow(sample));
  for (std::size_t i = 0; i < seen_at.size(); ++i) {
    around.seen[i].sigmas_below = around.sigmas_below[seen_at[i]];
  }
  return around;
}

namespace {

// Passes about a place, and what hides it from them.
class PassViews {
 public:
  PassViews(const LookedAtTube& tube, const hal::SurfaceFrame& frame,
            std::span<const SeenWall> seen)
      : frame_(frame),
        unrolled_(tube.segments, frame, tube.pipe_radius_mm),
        r_mm_(tube.pipe_radius_mm),
        shadows_(tube) {
    for (const SeenWall& sample : seen) {
      passes_[PassOf(sample.to_sensor)].push_back(&sample);
      reach_mm_ = std::max(reach_mm_, sample.place_mm.norm());
    }
  }

  const UnrolledWall& unrolled() const { return unrolled_; }

  // Of a pass that saw the wall on all sides of the opening no part of the tube hides it: what that
  // hides is as wide as the tube itself.
  void TakeSurrounded(const OpeningBorder& about) {
    const double clear_mm = kLook.clear * about.width_mm;
    for (const auto& [pass, samples] : passes_) {
      const std::vector<Eigen::Vector2d> places = PlacesOf(pass);
      const double within_mm = 2.0 * GapBeside(about, PlaneSamples(places), r_mm_) + clear_mm;
      if (about.width_mm + 2.0 * within_mm > 2.0 * r_mm_) continue;
      const BorderSides sides = SidesOf(about, places, clear_mm, within_mm, 0.0);
      const bool has_sides = sides.all > 0;
      if (has_sides && sides.with_samples >= kLook.surrounded * sides.all) surrounded_.insert(pass);
    }
  }

  bool MayBeHidden(const Eigen::Vector3d& place, SensorDirection to_sensor) {
    const unsigned pass = PassOf(to_sensor);
    if (surrounded_.contains(pass)) return false;
    const auto [at, is_new] = ways_.try_emplace(pass);
    if (is_new) at->second = shadows_.WaysOf(passes_[pass]);
    return shadows_.MayHide(place, to_sensor, at->second);
  }

  // Adds a pass that comes scattered, if it looked through the opening.
  void AddScattered(unsigned pass, const OpeningBorder& about, PassSurroundings& found) {
    const std::vector<Eigen::Vector2d> places = PlacesOf(pass);
    const double gap_mm = GapBeside(about, PlaneSamples(places), r_mm_);
    const double clear_mm = kLook.clear * about.width_mm;
    const BorderSides sides = SidesOf(about, places, clear_mm, 2.0 * gap_mm + clear_mm, 0.0);
    const double part = PartSeen(pass, about);
    if (part < kLook.least_part || sides.with_samples < kLook.least_sides * part * sides.all) {
      return;
    }
    // An unsteady hand's lines look scattered, and leave places empty as other samples do not.
    if (IsNarrow(about, gap_mm) &&
        IsLikeItsSurroundings(about, places, reach_mm_, r_mm_, kLook.least_sides)) {
      return;
    }
    found.scattered.insert(found.scattered.end(), places.begin(), places.end());
    found.scattered_part += part;
  }

 private:
  std::vector<Eigen::Vector2d> PlacesOf(unsigned pass) {
    std::vector<Eigen::Vector2d> places;
    for (const SeenWall* sample : passes_[pass]) places.push_back(sample->place_mm);
    return places;
  }
  // Of the area of an opening, what this pass would have seen were it wall.
  double PartSeen(unsigned pass, const OpeningBorder& about) {
    const Eigen::Vector2d axis = about.Axis(), across = about.Across();
    double inside = 0, seen = 0;
    for (int i = 0; i < kLook.places; ++i) {
      for (int k = 0; k < kLook.places; ++k) {
        const Eigen::Vector2d place = about.middle_mm +
                                      about.length_mm * ((i + 0.5) / kLook.places - 0.5) * axis +
                                      about.width_mm * ((k + 0.5) / kLook.places - 0.5) * across;
        if (std::abs(place.y()) > kLimb * r_mm_ || about.DistanceMm(place) > 0) continue;
        inside += 1;
        seen += IsSeen(pass, place) ? 1 : 0;
      }
    }
    return inside > 0 ? seen / inside : 0.0;
  }
  bool IsSeen(unsigned pass, const Eigen::Vector2d& place) {
    // In a straight; a bend's wall is there but for what it turns over an opening.
    const Eigen::Vector3d outward =
        (place.y() * frame_.sideways() +
         std::sqrt(r_mm_ * r_mm_ - place.y() * place.y()) * frame_.outward) /
        r_mm_;
    const Eigen::Vector3d point = frame_.spine_mm + place.x() * frame_.tangent + r_mm_ * outward;
    const auto& samples = passes_[pass];
    const SeenWall* nearest = *std::min_element(
        samples.begin(), samples.end(), [&](const SeenWall* a, const SeenWall* b) {
          return (a->place_mm - place).squaredNorm() < (b->place_mm - place).squaredNorm();
        });
    return TowardsSensor(nearest->to_sensor).dot(outward) > kLeastRayCosine &&
           !MayBeHidden(point, nearest->to_sensor);
  }

  hal::SurfaceFrame frame_;
  UnrolledWall unrolled_;
  double r_mm_;
  double reach_mm_ = 0;  // from the middle of the plane
  Shadows shadows_;
  std::map<unsigned, std::vector<const SeenWall*>> passes_;
  std::map<unsigned, std::vector<double>> ways_;
  std::set<unsigned> surrounded_;  // passes that see all sides of the opening
};

// How low a sample beside an opening may lie that is certainly of the wall. A ray that crosses the
// opening towards the border there may have passed the border below it, and met the face: the
// flatter it came, the further inside does it look like a sample of the wall.
double MostSigmasBelow(const SeenWall& sample, const Eigen::Vector3d& normal,
                       const hal::SurfaceFrame& frame, const OpeningBorder& about) {
  const Eigen::Vector3d way = -TowardsSensor(sample.to_sensor);
  constexpr double kStepMm = 1e-3;
  const double cosine = std::max(kLeastRayCosine, -way.dot(normal));
  const Eigen::Vector3d over = way - way.dot(normal) * normal;
  const Eigen::Vector2d aside(over.dot(frame.tangent), over.dot(frame.sideways()));
  const double outward = (about.DistanceMm(sample.place_mm + kStepMm * aside) -
                          about.DistanceMm(sample.place_mm - kStepMm * aside)) /
                         (2.0 * kStepMm * cosine);
  return std::clamp(kSampling.low - kLook.low_by_slope * outward, kLook.least_low, kSampling.low);
}

}  // namespace

double PassSurroundings::PartThrough(const OpeningBorder& border) const {
  double through_mm2 = scattered_part * border.AreaMm2();
  for (std::size_t i = 0; i < missed.size(); ++i) {
    through_mm2 += border.DistanceMm(missed[i].place_mm) < 0 ? cell_mm2[i] : 0;
  }
  return through_mm2 / border.AreaMm2();
}

PassSurroundings LookedAtTube::FindPasses(const hal::SurfaceFrame& frame,
                                          const Surroundings& around,
                                          const OpeningBorder& about) const {
  PassSurroundings found;
  found.are_known = static_cast<double>(around.seen.size()) >=
                    kLook.known * static_cast<double>(around.wall.size());
  if (!found.are_known) {
    found.scattered = around.wall;
    return found;
  }
  PassViews views(*this, frame, around.seen);
  views.TakeSurrounded(about);
  std::vector<WallSample> wall;
  wall.reserve(around.seen.size());
  for (const SeenWall& sample : around.seen) {
    const std::array<std::int32_t, 1> own = {sample.segment};
    const SpineFoot foot = NearestFoot(sample.point_mm, segments, frames, own);
    wall.push_back({views.unrolled().PlaceOf(sample.point_mm, foot), sample.to_sensor});
  }
  const MissedRays missed =
      FindMissed(wall, pipe_radius_mm, noise_mm, frame.outward, frame.sideways());
  found.has_lines = missed.has_lines;
  for (const MissedRay& ray : missed.rays) {
    const Eigen::Vector3d place = views.unrolled().PointAt(ray.place_mm);
    if (views.MayBeHidden(place, ray.to_sensor)) continue;
    found.missed.push_back({InPlane(place, frame), ray.sideways_sigma_mm});
    found.cell_mm2.push_back(ray.cell_mm2);
  }
  for (const unsigned pass : missed.scattered) views.AddScattered(pass, about, found);
  if (found.PartThrough(about) < kLook.hardly_through) return found;  // the rest takes long
  for (std::size_t i = 0; i < wall.size(); ++i) {
    const SeenWall& sample = around.seen[i];
    const double turn = wall[i].place_mm.y() / pipe_radius_mm;
    const Eigen::Vector3d normal =
        std::cos(turn) * frame.outward + std::sin(turn) * frame.sideways();
    const bool is_flat = TowardsSensor(sample.to_sensor).dot(normal) < kLeastRayCosine;
    const bool may_be_face = sample.sigmas_below > MostSigmasBelow(sample, normal, frame, about);
    if (!is_flat && !may_be_face && !views.MayBeHidden(sample.point_mm, sample.to_sensor)) {
      found.fair.push_back(sample.place_mm);
    }
  }
  return found;
}

}  // namespace bendloop::pipeline
