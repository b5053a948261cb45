// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "hal/tube.h"

// STEP files of a tube as kernels other than OpenCASCADE write them, made as text: OpenCASCADE's
// own writer would put seams, edges and units as it likes them.
namespace bendloop::test {

enum class FaceStyle {
  kNoSeam,    // Parasolid and ACIS: a face all around has two closed edges and nothing between them
  kSeam,      // an edge along it, used twice
  kHalves,    // two faces each piece
  kQuarters,  // four
};

enum class SurfaceStyle {
  kAnalytic,    // CYLINDRICAL_SURFACE, TOROIDAL_SURFACE
  kRational,    // the same as rational B-splines
  kPolynomial,  // near it: cubic B-splines without weights
};

enum class BodyStyle {
  kSolid,      // MANIFOLD_SOLID_BREP
  kOpenShell,  // the outer skin alone, SHELL_BASED_SURFACE_MODEL
  kLoose,      // each face with edges of its own
};

// The last straight lies beside what it joins, and askew, though the two share their border; or the
// second half of it does.
struct OffJoint {
  double beside_mm = 0, askew_deg = 0;
  bool within_straight = false;
};

struct StepStyle {
  FaceStyle faces = FaceStyle::kNoSeam;
  SurfaceStyle surfaces = SurfaceStyle::kAnalytic;
  BodyStyle body = BodyStyle::kSolid;
  double wall_mm = 1;     // 0: a bar
  double span_deg = 45;   // of one cubic: 90 is 3e-4 of the radius off, 45 is 4e-6
  int digits = 15;        // of each number
  bool one_face = false;  // B-splines: one surface along the whole tube
  double unit_mm = 1;     // what a length of 1 is in the file
  std::string unit;       // entities of the length unit; empty: SI millimetre
  std::string name = "tube";
  double lean_deg = 0;  // of the borders between pieces from square to the centre line
  OffJoint off;
};

// The text of a file. `tube` has a bend radius at each bend.
std::string StepText(const hal::Tube& tube, const StepStyle& style = {});

}  // namespace bendloop::test
