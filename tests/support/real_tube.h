// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <random>
#include <vector>

#include "hal/tube.h"

// Tubes as a bender leaves them and scans as an arm takes them: what the model of lines, arcs and
// one section does not have.
namespace bendloop::tests {

struct Dent {
  double along = 0.5;  // part of the spine's length
  double around_rad = 0;
  double depth_r = 0.05;  // of the pipe radius, in its middle
  double width_r = 0.8;   // 1 sigma of its gaussian, along the wall and around it
};

// kBead: a ridge all round, 0.25 high, whose flanks' lines meet the plain tube 0.8 and 1.6 from the
// end. kFlare: a cone from 1.5 before the end on, 0.4 high. kCap: closed, 2.5 long and 0.12 thick.
// In pipe radii.
enum class EndFitting { kNone, kNut, kFlange, kFlare, kBead, kCap };

// How a real tube differs from its program. Lengths in pipe radii.
struct Form {
  double bow = 0;          // height of each straight's bow over its length: 1 / 1000
  double s_bow = 0;        // the same of a second mode, that changes sides in the middle
  bool half_sine = false;  // bows are no parabolas: less is curved towards the straight's ends
  double easing_r = 0;     // curvature is smoothed over a gaussian of this sigma
  // The same where bends end; none: they fall as they rise. Of straights that do not bow.
  std::optional<double> falling_r = {};
  bool ramps = false;  // instead over a box as wide as twice this: curvature rises linearly
  double ovality = 0;  // (greatest - least diameter) / nominal in the middle of bends
  double sunk = 0;     // depth of the outer wall of bends, all along them
  // Both rise from so far before a bend to so far behind its tangent point, and fall likewise, as a
  // mandrel leaves them. None: the one follows the curvature, the other begins with the arc.
  std::optional<double> section_rise_r = {};
  double wrinkles = 0;  // on the inner side of bends, half of them wave crest to trough
  double seam = 0;  // height of a weld seam along the tube, one radian from the first bend's plane
  double seam_rad = 0.12;        // 1 sigma of its gaussian
  std::vector<Dent> dents = {};  // pressed in
  EndFitting at_end = EndFitting::kNone;
};

// How it is scanned.
struct RealScan {
  std::size_t points = 24'000;
  double noise_mm = 0.05;  // 1 sigma along the normal
  double heavy_tail = 0;   // part of the points with noise from Student's t, 2 degrees of freedom
  int views = 4;           // passes, from directions around the tube
  double drift_mm = 0;     // 1 sigma an axis, by which a pass is displaced
  double drift_deg = 0;    // and turned
  double thinning = 1;     // the last third is so many times thinner, gradually
  bool thins_all_along = false;  // instead from the start to the end of the tube
  // It lies on a table, of which as many points a square millimetre are seen as of the tube, and is
  // seen from above only.
  bool on_table = false;
};

struct RealCloud {
  std::vector<Eigen::Vector3d> points_W;
  // The tube as the trade defines it: straights are best-fit lines, their corners and planes are L,
  // R and A with the bend radii of the program.
  hal::Tube truth;
};

// `program`: bends of less than a half turn. In its pose X_WT.
RealCloud ScanRealTube(const hal::Tube& program, const Form& form, const RealScan& scan,
                       std::mt19937_64& random);

}  // namespace bendloop::tests
