// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace bendloop::pipeline {

// Where along the spine a bend's section becomes what it is in the bend: about a place so far
// before the tangent point, from so far before that to so far behind it. Behind the bend likewise.
// None: with the curvature.
struct SectionRise {
  double half_mm = 0, before_mm = 0;

  bool is_none() const { return half_mm <= 0; }
};

// How far a bend's cross-section is from round. In the direction of angle psi from the outer side
// (the far side from the centre of the bend) the surface is at
//   r_P (1 - (constant S + bump B) / 2 cos 2 psi - collapse B C^2 - plateau P C^2 N)
// from the spine, C = max(0, cos psi), where S rises with the curvature to 1, B is 1 in the middle
// of the bend and falls to 0 at its ends like a parabola, P = 1 - (1 - B)^4 rises soon and stays,
// and N is C^2 where the sunk wall is narrow, 1 where it is wide. The first term is the oval, the
// others the outer wall that sinks in. All are parts of the pipe radius; an oval of 0.05 has
// diameters that differ by 5 %. An outer wall that sinks in all along, taken for one that does in
// the middle, moves the spine at the bend's ends inwards as easing does.
//
// A mandrel's section is not round before the bend begins. With a rise of its own the surface is at
//   r_P (1 - (constant S + bump B) / 2 cos 2 psi - collapse S C^2 - plateau S C^4),
// and S rises along that, and falls likewise.
struct Flattening {
  double constant = 0;
  double bump = 0;
  double collapse = 0;
  double plateau = 0;
  bool is_wide = false;   // the plateau; not fitted
  SectionRise rise = {};  // not fitted with these (section_rise.h)

  // (greatest - least diameter) / nominal, in the middle of the bend.
  double OvalityPart() const { return constant + bump + 0.5 * (collapse + plateau); }
  // How far the outer wall lies inside the round one, in pipe radii, in the middle of the bend.
  double OuterWallPart() const { return 0.5 * (constant + bump) + collapse + plateau; }
};
constexpr int kFlatteningParameters = 4;

// 1 sigma of the two parts.
struct FlatteningSigma {
  double ovality_part = 0;
  double outer_wall_part = 0;
};

// What machines do to tubes (1 sigma), which determines what the points leave open.
constexpr double kUsualFlattening = 0.05;

}  // namespace bendloop::pipeline
