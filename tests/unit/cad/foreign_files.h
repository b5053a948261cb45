// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <TopoDS_Shape.hxx>
#include <string>

#include "hal/tube.h"

// Tubes as foreign CAD systems put them into their files: other surfaces, other bodies.
namespace bendloop::test {

// The lines and arcs of a wire as rational B-splines, which are exact.
TopoDS_Shape AsNurbs(const TopoDS_Shape& wire);
// A bar swept piece by piece: straights as extrusions of a B-spline circle, bends as its
// revolutions, each side in a face of its own.
TopoDS_Shape AsExtrusions(const hal::Tube& tube);
// A bar of rational cubic B-splines that are closed around it; each bend's has a short piece of so
// many degrees where it begins, as systems leave it that cut them off a larger one.
TopoDS_Shape AsCutSplines(const hal::Tube& tube, double short_piece_deg);
// No face goes more than `angle_deg` around, as systems have it that know no seams.
TopoDS_Shape WithoutSeams(const TopoDS_Shape& shape, double angle_deg);
// A pipe along the whole centre line at once.
TopoDS_Shape AsShell(const hal::Tube& tube);
// A solid for each straight and each bend, in a compound; `as_compound_solid`: with shared faces.
TopoDS_Shape InSolids(const hal::Tube& tube, double wall_mm, bool as_compound_solid);
// Cut along the plane z = 0 into solids that lie beside each other.
TopoDS_Shape InShells(const TopoDS_Shape& shape);
// Outer and inner surface alone, every other face reversed.
TopoDS_Shape WithoutEnds(const TopoDS_Shape& shape);
// `shape` in the mirror.
TopoDS_Shape Mirrored(const TopoDS_Shape& shape);
TopoDS_Shape Ring(double bend_radius_mm, double radius_mm);

// The file's text with `what` replaced by `by`, wherever it stands; written beside it.
std::string Edited(const std::string& file, const std::string& what, const std::string& by);

}  // namespace bendloop::test
