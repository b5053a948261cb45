// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cad/tube_layers.h"

#include <algorithm>
#include <cmath>

namespace bendloop::host {
namespace {

// Surfaces about one axis that go along this part of the longest of them may be the tube's outer.
constexpr double kMostOfLongest = 0.6;
// The same for the inner surface, of the outer's length.
constexpr double kMostOfOuter = 0.5;

const TubeChain* LongestOf(const TubeLayer& layer) {
  return *std::max_element(layer.chains.begin(), layer.chains.end(),
                           [](const TubeChain* a, const TubeChain* b) {
                             return a->spine.length_mm() < b->spine.length_mm();
                           });
}

}  // namespace

std::vector<TubeLayer> LayersOf(const std::vector<const TubeChain*>& cluster) {
  std::vector<TubeLayer> layers;
  for (const TubeChain* c : cluster) {
    const auto same = std::find_if(layers.begin(), layers.end(), [&](const TubeLayer& l) {
      return l.concave == c->concave &&
             std::abs(l.radius_mm - c->radius_mm) < MatchToleranceMm(c->radius_mm) / 4;
    });
    TubeLayer& layer = same != layers.end()
                           ? *same
                           : layers.emplace_back(TubeLayer{c->radius_mm, 0, 0, c->concave, {}});
    layer.length_mm += c->spine.length_mm();
    layer.arcs += c->spine.arcs.size();
    layer.chains.push_back(c);
  }
  return layers;
}

const TubeLayer* OuterOf(const std::vector<TubeLayer>& layers) {
  double longest = 0;
  std::size_t most_arcs = 0;
  for (const TubeLayer& l : layers) most_arcs = std::max(most_arcs, l.arcs);
  const auto bends = [&](const TubeLayer& l) { return 2 * l.arcs >= most_arcs; };
  for (const TubeLayer& l : layers) {
    if (bends(l)) longest = std::max(longest, l.length_mm);
  }
  const TubeLayer* outer = nullptr;
  for (const bool concave : {false, true}) {
    if (outer != nullptr) break;
    for (const TubeLayer& l : layers) {
      if (l.concave != concave || !bends(l) || l.length_mm < kMostOfLongest * longest) continue;
      if (outer == nullptr || l.radius_mm > outer->radius_mm) outer = &l;
    }
  }
  return outer;
}

const TubeLayer* InnerOf(const std::vector<TubeLayer>& layers, const TubeLayer& outer, bool solid) {
  const TubeLayer* inner = nullptr;
  for (const TubeLayer& l : layers) {
    if (&l == &outer || l.radius_mm >= outer.radius_mm) continue;
    if (solid && !l.concave) continue;
    if (l.length_mm < kMostOfOuter * outer.length_mm) continue;
    if (inner == nullptr || l.radius_mm > inner->radius_mm) inner = &l;
  }
  return inner;
}

const TubeChain& BasisOf(const TubeLayer& outer, const TubeLayer* inner) {
  const TubeChain* basis = LongestOf(outer);
  if (inner == nullptr) return *basis;
  const TubeChain* other = LongestOf(*inner);
  return other->spine.arcs.size() > basis->spine.arcs.size() ? *other : *basis;
}

double MostAroundDeg(const TubeLayer& layer, const std::vector<TubePiece>& pieces) {
  double around = 0;
  for (const TubeChain* chain : layer.chains) {
    for (const int i : chain->pieces) {
      const TubePiece& piece = pieces[std::size_t(i)];
      if (!piece.inferred) around = std::max(around, piece.around_deg());
    }
  }
  return around;
}

}  // namespace bendloop::host
