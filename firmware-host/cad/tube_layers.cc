// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cad/tube_layers.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

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

// Elbows differ from the straights between them by no more than this part of the pipe radius; what
// is wider is a sleeve.
constexpr double kMostElbowStep = 0.3;
// A surface of which faces show this part of the straights has straights.
constexpr double kStraightsShown = 0.5;

bool ShowsStraights(const TubeLayer& layer) {
  return layer.shown_straight_mm >= kStraightsShown * layer.straight_mm;
}

void AddShown(const TubeChain& chain, const std::vector<TubePiece>& pieces, TubeLayer& layer) {
  for (const int i : chain.pieces) {
    const TubePiece& piece = pieces[std::size_t(i)];
    if (!piece.is_arc) layer.straight_mm += piece.length_mm();
    if (piece.inferred) continue;
    if (piece.is_arc) {
      ++layer.shown_arcs;
    } else {
      layer.shown_straight_mm += piece.length_mm();
    }
  }
}

// The widest of those that show their straights, and where none does, of all.
const TubeLayer* WidestOf(const std::vector<const TubeLayer*>& layers) {
  const TubeLayer* widest = nullptr;
  for (const TubeLayer* l : layers) {
    const bool is_better = widest == nullptr || (ShowsStraights(*l) == ShowsStraights(*widest)
                                                     ? l->radius_mm > widest->radius_mm
                                                     : ShowsStraights(*l));
    if (is_better) widest = l;
  }
  return widest;
}

}  // namespace

std::vector<TubeLayer> LayersOf(const std::vector<const TubeChain*>& cluster,
                                const std::vector<TubePiece>& pieces) {
  std::vector<TubeLayer> layers;
  for (const TubeChain* c : cluster) {
    const auto same = std::find_if(layers.begin(), layers.end(), [&](const TubeLayer& l) {
      return l.concave == c->concave &&
             std::abs(l.radius_mm - c->radius_mm) < MatchToleranceMm(c->radius_mm) / 4;
    });
    TubeLayer& layer = same != layers.end() ? *same : layers.emplace_back();
    layer.radius_mm = layer.chains.empty() ? c->radius_mm : layer.radius_mm;
    layer.concave = c->concave;
    layer.length_mm += c->spine.length_mm();
    layer.arcs += c->spine.arcs.size();
    AddShown(*c, pieces, layer);
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
  for (const bool concave : {false, true}) {
    std::vector<const TubeLayer*> candidates;
    for (const TubeLayer& l : layers) {
      if (l.concave == concave && bends(l) && l.length_mm >= kMostOfLongest * longest) {
        candidates.push_back(&l);
      }
    }
    if (const TubeLayer* outer = WidestOf(candidates)) return outer;
  }
  return nullptr;
}

const TubeLayer* InnerOf(const std::vector<TubeLayer>& layers, const TubeLayer& outer, bool solid) {
  std::vector<const TubeLayer*> candidates;
  for (const TubeLayer& l : layers) {
    if (&l == &outer || l.radius_mm >= outer.radius_mm) continue;
    if (solid && !l.concave) continue;
    if (l.length_mm < kMostOfOuter * outer.length_mm) continue;
    candidates.push_back(&l);
  }
  return WidestOf(candidates);
}

const TubeChain& BasisOf(const TubeLayer& outer, const TubeLayer* inner) {
  const TubeChain* basis = LongestOf(outer);
  if (inner == nullptr) return *basis;
  const TubeChain* other = LongestOf(*inner);
  return other->spine.arcs.size() > basis->spine.arcs.size() ? *other : *basis;
}

std::vector<const TubeLayer*> ElbowsOf(const std::vector<TubeLayer>& layers, const TubeLayer& outer,
                                       const TubeLayer* inner) {
  std::vector<const TubeLayer*> elbows;
  for (const TubeLayer& l : layers) {
    if (&l == &outer || &l == inner || l.shown_arcs == 0 || ShowsStraights(l)) continue;
    if (std::abs(l.radius_mm - outer.radius_mm) > kMostElbowStep * outer.radius_mm) continue;
    elbows.push_back(&l);
  }
  return elbows;
}

std::vector<std::string> ElbowNotes(const std::vector<const TubeLayer*>& elbows,
                                    const TubeLayer& outer, const TubeLayer* inner) {
  std::vector<std::string> notes;
  for (const TubeLayer* l : elbows) {
    const bool is_bore = inner != nullptr && std::abs(l->radius_mm - inner->radius_mm) <
                                                 std::abs(l->radius_mm - outer.radius_mm);
    char text[160];
    std::snprintf(text, sizeof text,
                  "%zu of its bends have %s of %.3f mm, its straights one of %.3f: the part file "
                  "has that of the straights",
                  l->shown_arcs, is_bore ? "a bore" : "a diameter", 2 * l->radius_mm,
                  2 * (is_bore ? inner->radius_mm : outer.radius_mm));
    notes.emplace_back(text);
  }
  return notes;
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
