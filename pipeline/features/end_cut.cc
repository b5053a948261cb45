// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/end_cut.h"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "hal/angles.h"
#include "pipeline/features/end_bevel.h"
#include "pipeline/features/end_burr.h"
#include "pipeline/features/end_plane.h"
#include "pipeline/features/end_plane_fit.h"
#include "pipeline/features/end_samples.h"
#include "pipeline/features/end_sectors.h"
#include "pipeline/fit/end_face.h"

namespace bendloop::pipeline {
namespace {

struct EndCutSettings {
  // [of r_P] The end beside a shadow that lies so much further out is looked for again from there,
  // so often at most.
  double further = 1.0;
  int most_further = 4;
  // [of r_P] Deeper samples are of no dent.
  double deepest_dent = 0.35;
  // Of the wall so far before an end [of r_P] sectors have this part, at least, of the samples that
  // they have on three times as much of it, where it is whole; so many of them are beside a dent.
  double whole_before = 0.15, whole_part = 0.5, least_whole = 0.25;
  // Of how far the face of the cut lies beyond the wall's border, where no bevel is certain between
  // them: the tube ends there to 1 sigma of this part.
  double perhaps_bevelled = 0.3;
  // Columns tell an end better than the outermost point where that is so many times as unsure: what
  // stands out before the end parts the wall into pieces, whose distance is none of its samples.
  double much_surer = 4.0;
  // [sigma] Samples of a cloud that lie so near to its plane below the wall, so many, are of the
  // face; those that noise lifts so far above the wall are asked alone then. A face that lies
  // further beyond the plane that they tell has something between. By trial.
  double near_face = 4.0, above_face = 0.7, face_beyond = 1.0;
  double least_of_face = 12.0;
  // [sigma] Apart from what noise moves of a face, two planes of the same end lie no further apart.
  double apart_by_chance = 4.0;
  // [sigma] By which a bevel's border and its tip's may rise differently by chance; [of that] what
  // both are unsure by at least; [of how far a tip lies off at the rim] and at the axis. By trial.
  double rise_alike = 3.0, unlike = 0.25, misplaced = 0.3;
  double face_ring = 10.0;  // [sigma] All of a face lies within this along the axis.
  // A slope that is known no better may be of any end.
  double unsure_slope = 0.3;
  // [of r_P] From the border into the tube: where the gaps between samples are looked at.
  double window = 3.0;
  // The ball in which all that is looked at is, should the tube go on for longer than it was found.
  double ball = 6.0;
};
constexpr EndCutSettings kCut;

EndCutFound Found(const EndPlane& plane) {
  const double slope = plane.Slope();
  EndCutFound found;
  found.cut.obliquity_deg = std::atan(slope) * hal::kDegreesPerRadian;
  found.cut.around_deg = std::atan2(plane.sine, plane.cosine) * hal::kDegreesPerRadian;
  found.obliquity_sigma_deg = plane.slope_sigma / (1.0 + slope * slope) * hal::kDegreesPerRadian;
  found.around_sigma_deg =
      std::min(180.0, plane.slope_sigma / std::max(slope, 1e-9) * hal::kDegreesPerRadian);
  found.border = plane.border;
  return found;
}

// The face of an end, from a plane.
std::optional<EndFace> FaceFrom(const Eigen::Vector3d& plane_mm, const SamplesNearEnd& near,
                                double r_mm, double sigma_mm) {
  if (near.knows_passes()) return std::nullopt;
  std::vector<double> beyond_mm;
  for (const auto* samples : {&near.wall(), &near.inside(), &near.outside()}) {
    for (const NearEnd& sample : *samples) {
      beyond_mm.push_back(sample.BeyondInsideMm(plane_mm, r_mm));
    }
  }
  return FindEndFace(beyond_mm, 0.0, sigma_mm);
}

// One end: its plane, and what it has beside it.
struct FoundCut {
  EndPlane plane;
  EndCutFound cut;
  bool is_dented = false, may_be_bevelled = false, has_rim = false;
};
class CutSearch {
 public:
  CutSearch(double pipe_radius_mm, double window_mm, double sigma_mm, EndDice& dice)
      : r_mm_(pipe_radius_mm), window_mm_(window_mm), sigma_mm_(sigma_mm), dice_(dice) {}

  std::optional<FoundCut> Find(const SamplesNearEnd& near) {
    const auto planes = PlanesOfWall(near);
    if (!planes) return std::nullopt;
    const EndPlane* plane = &planes->plane;
    FoundCut found{*plane, Found(*plane)};
    // What is pressed in is on one side: neither a shadow there nor the flank of a bevel.
    if (const auto dented = UnlessDented(near, *plane)) return dented;
    const auto ragged = [&] { return FoundCut{*planes->ragged, Found(*planes->ragged)}; };
    if (plane->in_shadow) return planes->ragged ? ragged() : found;
    const Eigen::Vector3d of_wall_mm = plane->Numbers(r_mm_);
    // Where the wall comes in or stands out, it ends before the tube does.
    const BevelSearch search = FindBevel(near, of_wall_mm, r_mm_, sigma_mm_);
    if (const auto& bevel = search.bevel) {
      if (auto tip = PlaneOfWall(near.With(bevel->samples))) {
        // Its samples become few towards the tip, where those of the face are still seen.
        if (bevel->face_mm) PlaceAtFace(of_wall_mm[0] + *bevel->face_mm, *tip);
        AlignWithBevel(*plane, *tip);
        found = {*tip, Found(*tip)};
        found.cut.bevel = bevel->Found(tip->at_mm - of_wall_mm[0], tip->at_sigma_mm);
      }
      return found;
    }
    if (const auto rimmed = WithRim(near, of_wall_mm)) return rimmed;
    // Beside what stands out, as a flare does, the face is another's.
    const auto out = static_cast<double>(near.outside().size());
    // Behind the crests of a border the bore goes on as they do.
    const bool may_be_face = search.perhaps_mm > 0 && plane->border.empty();
    if (may_be_face && MayBeFliers(out, near.wall().size())) {
      PlaceAtFace(found.plane.at_mm + search.perhaps_mm, found.plane);
      found.may_be_bevelled = true;
    } else if (const auto cut = WithoutFace(near, *plane)) {
      return cut;
    } else if (planes->ragged) {
      return ragged();
    }
    return found;
  }

 private:
  // A tube ends at its face: as unsure as that lies off where samples beside it end.
  static void PlaceAtFace(double face_mm, EndPlane& plane) {
    plane.at_sigma_mm =
        std::hypot(plane.at_sigma_mm, kCut.perhaps_bevelled * (face_mm - plane.at_mm));
    plane.at_mm = face_mm;
  }

  // A tool that bevels follows the edge of the cut: where the bevel begins and where the tube ends
  // are planes that rise alike, and if they do not, one of them is not what it was taken for.
  void AlignWithBevel(const EndPlane& begins, EndPlane& tip) const {
    const Eigen::Vector2d apart(begins.cosine - tip.cosine, begins.sine - tip.sine);
    const double of_begin = std::pow(begins.slope_sigma, 2), of_tip = std::pow(tip.slope_sigma, 2);
    if (!(of_begin + of_tip > 0)) return;
    if (apart.squaredNorm() > 2.0 * std::pow(kCut.rise_alike, 2) * (of_begin + of_tip)) {
      tip.slope_sigma = std::hypot(tip.slope_sigma, apart.norm() / std::sqrt(2.0));
      tip.at_sigma_mm =
          std::hypot(tip.at_sigma_mm, kCut.misplaced * r_mm_ * apart.norm() / std::sqrt(2.0));
    } else {
      const double part = of_tip / (of_begin + of_tip);
      tip.cosine += part * apart.x();
      tip.sine += part * apart.y();
      tip.slope_sigma = std::hypot(std::sqrt(part * of_begin), kCut.unlike * apart.norm());
    }
    tip.slope_sigmas = tip.Slope() / tip.slope_sigma;
  }

  // Noise along the tube moves samples of the face beyond the border: most lie below the wall.
  // Where they lie further out than the wall goes without them, what is between may be bevelled.
  // None: no face is seen.
  std::optional<FoundCut> WithoutFace(const SamplesNearEnd& near, const EndPlane& with_face) {
    if (near.knows_passes() || !with_face.of_border) return std::nullopt;
    const double noise_mm = near.WallNoiseMm();
    const auto beyond_mm =
        near.FaceBeyondMm(with_face.Numbers(r_mm_), kCut.near_face * noise_mm, kCut.least_of_face);
    if (!beyond_mm) return std::nullopt;
    const double face_mm = with_face.at_mm + *beyond_mm;
    const auto plane = PlaneOfWall(near.Above(r_mm_ + kCut.above_face * noise_mm));
    if (!plane || !MayBeMovedBy(kCut.near_face * noise_mm, with_face, *plane)) return std::nullopt;
    FoundCut found{*plane, Found(*plane)};
    if (face_mm - plane->at_mm > kCut.face_beyond * noise_mm) {
      PlaceAtFace(face_mm, found.plane);
      found.may_be_bevelled = true;
    }
    return found;
  }

  // Whether two planes lie apart, at the rim, by no more than this and chance.
  bool MayBeMovedBy(double most_mm, const EndPlane& a, const EndPlane& b) const {
    const Eigen::Vector3d apart_mm = a.Numbers(r_mm_) - b.Numbers(r_mm_);
    const double by_chance_mm =
        std::hypot(a.at_sigma_mm, b.at_sigma_mm) + r_mm_ * std::hypot(a.slope_sigma, b.slope_sigma);
    return std::abs(apart_mm[0]) + apart_mm.tail<2>().norm() <
           most_mm + kCut.apart_by_chance * by_chance_mm;
  }

  std::optional<FoundCut> WithRim(const SamplesNearEnd& near, const Eigen::Vector3d& of_wall_mm) {
    const std::vector<NearEnd> out = StandingOut(near, of_wall_mm, r_mm_, sigma_mm_);
    if (out.empty()) return std::nullopt;
    const SamplesNearEnd whole = near.With(out);
    auto tip = PlaneOfWall(whole);
    if (!tip) return std::nullopt;
    if (const auto face = FaceFrom(tip->Numbers(r_mm_), near, r_mm_, sigma_mm_)) {
      tip->at_mm += face->at_mm;
      tip->at_sigma_mm = face->sigma_mm;
    }
    const RimTip ends{tip->Numbers(r_mm_), tip->at_sigma_mm, tip->slope_sigma};
    const auto rim = FindRim(whole, ends, r_mm_, sigma_mm_);
    if (!rim) return std::nullopt;
    FoundCut found{*tip, Found(*tip)};
    found.cut.burr = rim->burr;
    found.has_rim = true;
    return found;
  }

  // Where a dent presses the wall in its samples still show that it goes on: an end that is square
  // with them and oblique, or a curve, without is dented.
  std::optional<FoundCut> UnlessDented(const SamplesNearEnd& near, const EndPlane& plane) {
    const auto may_be_square = [](const EndPlane& of) {
      return !of.MayBeOblique() && of.slope_sigma < kCut.unsure_slope && of.border.empty() &&
             !of.in_shadow;
    };
    if (may_be_square(plane)) return std::nullopt;
    std::vector<NearEnd> pressed_in;
    for (const NearEnd& sample : near.inside()) {
      if (sample.RadiusMm() > (1.0 - kCut.deepest_dent) * r_mm_) pressed_in.push_back(sample);
    }
    if (pressed_in.empty()) return std::nullopt;
    const auto square = PlaneOfWall(near.With(pressed_in));
    if (!square || !may_be_square(*square)) return std::nullopt;
    const Eigen::Vector3d square_mm = square->Numbers(r_mm_);
    if (!StandingOut(near, square_mm, r_mm_, sigma_mm_).empty()) return std::nullopt;
    if (!IsWholeElsewhere(near, square_mm)) return std::nullopt;
    return FoundCut{*square, Found(*square), true};
  }

  // Whether the wall, and not what lies further in, goes on to the plane on some sides.
  bool IsWholeElsewhere(const SamplesNearEnd& near, const Eigen::Vector3d& plane_mm) const {
    std::array<double, kEndSectors> before{}, at_end{};
    const double part_mm = kCut.whole_before * r_mm_;
    for (const NearEnd& sample : near.wall()) {
      const double before_mm = -sample.BeyondMm(plane_mm);
      if (before_mm > 3.0 * part_mm) continue;
      const std::size_t sector = EndSectorOf(sample.AroundRad());
      if (before_mm < part_mm) at_end[sector] += 1;
      before[sector] += 1.0 / 3.0;
    }
    double whole = 0, seen = 0;
    for (std::size_t i = 0; i < kEndSectors; ++i) {
      seen += before[i] > 0 ? 1 : 0;
      whole += at_end[i] > kCut.whole_part * before[i] ? 1 : 0;
    }
    return whole > kCut.least_whole * seen;
  }

  std::optional<EndPlane> PlaneOfWall(const SamplesNearEnd& near) {
    const auto planes = PlanesOfWall(near);
    return planes ? std::optional(planes->plane) : std::nullopt;
  }

  std::optional<EndPlanes> PlanesOfWall(const SamplesNearEnd& near) {
    SamplesAboutEnd all{near.size(), near.knows_passes(),
                        [&](std::size_t stride) { return near.Every(stride); },
                        [&](const Eigen::Vector3d& plane_mm, double below_mm, double above_mm) {
                          return near.Band(plane_mm, below_mm, above_mm);
                        },
                        [&](const Eigen::Vector3d& plane_mm) { return near.Hidden(plane_mm); }};
    return FitEndPlanes(std::move(all), r_mm_, window_mm_, sigma_mm_, dice_);
  }

  double r_mm_, window_mm_, sigma_mm_;
  EndDice& dice_;
};

// An end among the samples about it.
struct SeenEnd {
  FoundCut cut;
  bool knows_passes = false;
  bool is_further = false;  // than was looked at first
  // From where the outermost samples of a cloud are: they are those of the face that noise moved.
  std::optional<EndFace> face;

  // Whether it tells the end's place better than the borders' outermost point does.
  bool IsSurerThan(double sigma_mm) const {
    const EndPlane& plane = cut.plane;
    if (plane.IsOblique() || plane.of_border || is_further) return true;
    // Where the wall comes in, or its border is no plane, its outermost point is not the end.
    if (cut.cut.bevel || cut.has_rim || cut.is_dented || cut.may_be_bevelled) return true;
    if (!plane.border.empty() || plane.in_shadow) return true;
    if (plane.of_columns && kCut.much_surer * plane.at_sigma_mm < sigma_mm) return true;
    // Laser lines tell of an end's place at its axis whether it is square or not, and how surely:
    // samples of lines that a hand tilts lie all along the tube as if they were no lines.
    return plane.of_lines;
  }
  // Of an end that is not square for sure the outermost samples lie beyond where it meets the axis;
  // all samples beside the border have said so already.
  bool MayMeetAxisElsewhere() const {
    const EndPlane& plane = cut.plane;
    return !plane.of_border && (plane.of_columns || plane.MayBeOblique());
  }
};

class EndSearch {
 public:
  EndSearch(const hal::Tube& tube, bool at_start, double sigma_mm,
            std::span<const PointBlock> blocks, EndDice& dice)
      : tube_(tube), at_start_(at_start), sigma_mm_(sigma_mm), blocks_(blocks), dice_(dice) {}

  std::optional<SeenEnd> Find(EndAxis axis) {
    auto end = FindAt(axis);
    // Beside a shadow the tube may go on for longer than is looked at.
    double further_mm = 0;
    for (int i = 0; i < kCut.most_further && end; ++i) {
      const double at_mm = end->cut.plane.at_mm;
      if (!end->cut.plane.in_shadow || at_mm < kCut.further * tube_.pipe_radius_mm) break;
      axis.end_mm += at_mm * axis.outward;
      const auto next = FindAt(axis);
      if (!next) break;
      further_mm += at_mm;
      end = next;
    }
    if (!end) return std::nullopt;
    end->cut.plane.at_mm += further_mm;
    end->is_further = further_mm > 0;
    return end;
  }

 private:
  std::optional<SeenEnd> FindAt(const EndAxis& axis) {
    const auto& rows = tube_.program.rows;
    const double straight_mm = at_start_ ? rows.front().length_mm : rows.back().length_mm;
    const double r_mm = tube_.pipe_radius_mm;
    double window_mm = std::min(kCut.window * r_mm, straight_mm);
    const SamplesNearEnd near(tube_, at_start_, axis, sigma_mm_, window_mm, blocks_);
    // A bead parts the wall: samples before it tell nothing of how those of the end lie.
    std::optional<SamplesNearEnd> parted;
    if (const auto begins_mm = near.WallBeginsMm()) {
      // What is as wide as the pipe beyond a flare is a ring of the face.
      if (!near.knows_passes() && near.WallReachesMm(*begins_mm) < kCut.face_ring * sigma_mm_) {
        parted = near;
        parted->LeaveOutWallFrom(*begins_mm);
      } else if (*begins_mm < 0) {
        parted = near;
        parted->LeaveOutWallBefore(*begins_mm);
        window_mm = std::min(window_mm, -*begins_mm);
      }
    }
    const auto cut = CutSearch(r_mm, window_mm, sigma_mm_, dice_).Find(parted ? *parted : near);
    if (!cut) return std::nullopt;
    SeenEnd end{*cut, near.knows_passes(), false, std::nullopt};
    // The face is asked by all samples, and only where the border tells less.
    if (!end.IsSurerThan(0.0)) {
      end.face = FaceFrom(Eigen::Vector3d::Zero(), near, r_mm, sigma_mm_);
    }
    return end;
  }

  const hal::Tube& tube_;
  bool at_start_;
  double sigma_mm_;
  std::span<const PointBlock> blocks_;
  EndDice& dice_;
};

}  // namespace

std::vector<Ball> BallsAbout(const TubeEnds& ends) {
  const double ball_mm = kCut.ball * ends.tube.pipe_radius_mm;
  return {{ends.first.end_mm, ball_mm}, {ends.last.end_mm, ball_mm}};
}

EndCuts FindEndCuts(double sigma_mm, std::span<const PointBlock> blocks, TubeEnds& ends) {
  EndCuts cuts;
  const hal::Tube found = ends.tube;
  EndDice dice;
  for (const bool at_start : {true, false}) {
    if (!(at_start ? ends.first_seen : ends.last_seen)) continue;
    const auto end =
        EndSearch(found, at_start, sigma_mm, blocks, dice).Find(at_start ? ends.first : ends.last);
    if (!end) continue;
    const EndPlane& plane = end->cut.plane;
    (at_start ? cuts.first : cuts.last) = end->cut.cut;
    double& sigma_of_end_mm = at_start ? ends.first_sigma_mm : ends.last_sigma_mm;
    const EndPlace of_plane{plane.at_mm, plane.at_sigma_mm * plane.at_sigma_mm};
    EndPlace place = of_plane;
    if (!end->IsSurerThan(sigma_of_end_mm)) {
      // Where noise has moved them are the outermost samples of a cloud, by which it was found.
      const double moved_mm = end->knows_passes ? 0.0 : sigma_mm;
      place = {0.0, sigma_of_end_mm * sigma_of_end_mm + moved_mm * moved_mm};
      if (end->face) place = {end->face->at_mm, std::pow(end->face->sigma_mm, 2)};
      if (end->MayMeetAxisElsewhere()) place = OfEither(place, of_plane, LogOddsOfOblique(plane));
    }
    sigma_of_end_mm = std::sqrt(place.variance_mm2);
    auto& rows = ends.tube.program.rows;
    double& length_mm = at_start ? rows.front().length_mm : rows.back().length_mm;
    length_mm = std::max(0.0, length_mm + place.at_mm);
    if (at_start) {
      ends.tube.X_WT.position_mm -=
          place.at_mm * (ends.tube.X_WT.orientation * Eigen::Vector3d::UnitX());
    }
  }
  return cuts;
}

}  // namespace bendloop::pipeline
