// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <set>
#include <string>
#include <vector>

#include "firmware-host/cad/cad_shape.h"
#include "firmware-host/cad/tube_chain.h"
#include "firmware-host/cad/tube_end.h"
#include "hal/tube_features.h"

namespace bendloop::host {

// A hole or slot through the wall.
struct WallOpening {
  // Where the drill's axis meets the outer surface: on the developed length from the first end, and
  // around it, counted as in hal/tube_features.h, (-180, 180].
  double along_mm = 0;
  double around_deg = 0;
  double width_mm = 0;   // diameter, or the slot's width
  double length_mm = 0;  // of a slot; 0: round
  double axis_deg = 0;   // of a slot's length, as in hal/tube_features.h, (-90, 90]
  // Of the drill's axis, as in hal/tube_features.h, of slots, too. Both 0: radial.
  double lean_along_deg = 0, lean_around_deg = 0;
  std::vector<int> faces;

  double lean_deg() const;  // from the wall's normal
};

// Another tube of the file that begins where one ends.
struct NextTube {
  std::size_t tube = 0;  // of the list, counted from 0
  double apart_mm = 0;   // along both; negative: they reach into each other
};

// A tube of a file.
struct CadTube {
  std::string name;        // of its body
  std::string occurrence;  // what its assembly calls the body, where that is something else
  std::size_t body = 0;    // of the shape, counted from 0
  bool is_wire = false;
  double pipe_radius_mm = 0;  // 0: a centre line alone
  std::optional<double> wall_mm;
  Spine spine;  // between its ends
  TubeEnd first, last;
  std::set<int> faces;  // of its straights and bends, outside and inside
  std::vector<WallOpening> openings;
  std::vector<WallOpening> openings_reversed;  // as they are from the other end
  // What is told by its place, counted from the first end and from the last.
  std::vector<std::string> placed_notes, placed_notes_reversed;
  std::vector<std::string> notes;
  // Why it is no sequence of lines and arcs; empty: it is one.
  std::vector<std::string> problems;

  std::vector<NextTube> next;  // of other bodies, in line with it
  bool goes_on = false;        // with another diameter, as another tube of the file
  bool is_round = true;        // false: no face goes all around it; one of its problems
  bool is_ring = false;        // closed: without ends; one of its problems

  bool is_bent() const { return !spine.arcs.empty(); }
  // No face of its surface goes around any axis.
  bool is_free_form() const { return !is_wire && !is_ring && pipe_radius_mm == 0; }
  // Whether lines and arcs can come near to what is none.
  bool has_nearest() const { return is_round && !is_ring; }
};

// How the ends are cut, as a part file says it; those that are square or no plane are square.
hal::EndCut FirstCut(const CadTube& tube);
hal::EndCut LastCut(const CadTube& tube);

// Where a direction across an end lies around the tube there [deg].
double AroundEndDeg(const CadTube& tube, bool is_first, const Eigen::Vector3d& across);

// All tubes of a file, in its order, or its rings where it holds nothing else; each from the end
// that lies nearer to the file's origin.
std::vector<CadTube> TubesOf(CadShape& shape);

// Describes `tube` from the end that lies nearer to the file's origin.
void BeginNearOrigin(CadTube& tube);

// Steps of TubesOf.
std::vector<CadTube> TubesOfSurfaces(CadBody& body);
std::vector<CadTube> TubesOfCurves(const CadBody& body);
// Holes and slots in the wall of `tube`, whose spine is known, and a sentence for each other thing
// that was cut or drilled into it.
struct Openings {
  std::vector<WallOpening> openings;
  std::vector<std::string> notes;
};
Openings OpeningsOf(const CadBody& body, const CadTube& tube);

}  // namespace bendloop::host
