// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <set>
#include <string>
#include <vector>

#include "firmware-host/cad/form_face.h"
#include "firmware-host/cad/tube_chain.h"
#include "firmware-host/cad/tube_piece.h"

namespace bendloop::host {

// What lies over the axis where the tube ends; nothing, as of a bore that is open.
enum class EndCover { kNone, kFlat, kPoint, kDome };

// What a tube has beyond an end.
struct EndForm {
  double end_mm = 0;  // it goes on so far
  EndCover cover = EndCover::kNone;
};

// How the tube goes on beyond its straight or bend `piece`, on the axis of `view`: faces that join
// its edge at `at_mm` and theirs in turn, as of a chamfer, a flare, a swage or a cap, while they
// keep near to the axis; `at_mm` where nothing goes on. `tubes`: faces of tubes, which are no form.
EndForm FormBeyond(const CadBody& body, const TubePiece& piece, const EndView& view, double at_mm,
                   const std::set<int>& tubes);

// Whether a surface is neither plane nor cylinder, torus, cone or sphere.
bool IsFreeForm(const SurfacePatch& patch);

// The free surfaces that begin where a chain ends.
struct FreeForm {
  std::string name;       // empty: none does
  double reach_mm = 0;    // from the end's centre
  double along_mm = 0;    // along the line that the end points along
  double across_mm = 0;   // from that line
  bool leads_on = false;  // to another end of the same pipe
  Eigen::Vector3d at;     // the end's centre

  // Whether they are the end's form, and no bend that is no arc.
  bool is_end_form(double pipe_radius_mm) const;
};
FreeForm FreeFormBeyond(const CadBody& body, const std::vector<TubePiece>& pieces,
                        const std::vector<TubeChain>& chains, const TubeChain& chain,
                        const ChainEnd& end);

}  // namespace bendloop::host
