// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <TopoDS_Shape.hxx>
#include <string>
#include <utility>
#include <vector>

#include "hal/tube.h"

// CAD files as other systems write them, made with OpenCASCADE's own modelling and not with ours.
namespace bendloop::test {

struct PipeOptions {
  double wall_mm = 1;  // 0: solid, as bars and models of the outside are
  int cuts = 0;        // planes along the pipe that split its faces: 1 halves, 2 quarters
};

// The centre line of `tube` as a wire of lines and arcs.
TopoDS_Shape CentreLine(const hal::Tube& tube);
// A circle swept along it.
TopoDS_Shape Pipe(const hal::Tube& tube, const PipeOptions& options = {});
// A pipe along a spline, which has no arc anywhere.
TopoDS_Shape SplineHose(double radius_mm);
// The centre line of `tube` with B-splines through so many places of each bend in its arcs' place.
TopoDS_Shape SplineBends(const hal::Tube& tube, int places);
// The faces of a shape, sewn to nothing, without those whose number is listed.
TopoDS_Shape LooseFaces(const TopoDS_Shape& shape, const std::vector<int>& without = {});

// `shape` without a round bar from `from` to `to`.
TopoDS_Shape Drilled(const TopoDS_Shape& shape, const Eigen::Vector3d& from,
                     const Eigen::Vector3d& to, double radius_mm);
// Without what lies on the positive side of the plane.
TopoDS_Shape Cut(const TopoDS_Shape& shape, const Eigen::Vector3d& at,
                 const Eigen::Vector3d& normal);
// A ring about `from` to `to`, joined to `shape`.
TopoDS_Shape WithCollar(const TopoDS_Shape& shape, const Eigen::Vector3d& from,
                        const Eigen::Vector3d& to, double radius_mm, double inner_radius_mm);

TopoDS_Shape Joined(const TopoDS_Shape& a, const TopoDS_Shape& b);
TopoDS_Shape Without(const TopoDS_Shape& a, const TopoDS_Shape& b);

using Named = std::vector<std::pair<std::string, TopoDS_Shape>>;
// `schema` is OpenCASCADE's: AP203, AP214IS, AP242DIS; `unit` MM, INCH, M. The shapes stand in an
// assembly in an assembly when there are several.
std::string WriteStepFile(const Named& shapes, const std::string& schema = "AP214IS",
                          const std::string& unit = "MM");
std::string WriteIgesFile(const TopoDS_Shape& shape, const std::string& unit = "MM");

// A file of the test's own temporary folder.
std::string TemporaryFile(const std::string& name);

}  // namespace bendloop::test
