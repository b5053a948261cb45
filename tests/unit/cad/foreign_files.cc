// SPDX-License-Identifier: Apache-2.0
#include "foreign_files.h"

#include <BOPAlgo_MakerVolume.hxx>
#include <BRepAdaptor_Surface.hxx>
#include <BRepAlgoAPI_Cut.hxx>
#include <BRepAlgoAPI_Splitter.hxx>
#include <BRepBuilderAPI_MakeEdge.hxx>
#include <BRepBuilderAPI_MakeFace.hxx>
#include <BRepBuilderAPI_MakeWire.hxx>
#include <BRepBuilderAPI_NurbsConvert.hxx>
#include <BRepBuilderAPI_Transform.hxx>
#include <BRepOffsetAPI_MakePipeShell.hxx>
#include <BRepPrimAPI_MakePrism.hxx>
#include <BRepPrimAPI_MakeRevol.hxx>
#include <BRepPrimAPI_MakeTorus.hxx>
#include <BRep_Builder.hxx>
#include <GeomConvert.hxx>
#include <Geom_BSplineCurve.hxx>
#include <Geom_BSplineSurface.hxx>
#include <Geom_Circle.hxx>
#include <Geom_CylindricalSurface.hxx>
#include <Geom_RectangularTrimmedSurface.hxx>
#include <Geom_ToroidalSurface.hxx>
#include <ShapeUpgrade_ShapeDivideAngle.hxx>
#include <TopExp_Explorer.hxx>
#include <TopoDS.hxx>
#include <TopoDS_CompSolid.hxx>
#include <TopoDS_Compound.hxx>
#include <cmath>
#include <fstream>
#include <gp_Circ.hxx>
#include <gp_Pln.hxx>
#include <iterator>

#include "firmware-host/cad/tube_chain.h"
#include "made_files.h"

namespace bendloop::test {
namespace {

gp_Pnt Point(const Eigen::Vector3d& p) { return {p.x(), p.y(), p.z()}; }
gp_Vec Way(const Eigen::Vector3d& d) { return {d.x(), d.y(), d.z()}; }

TopoDS_Wire CircleAbout(const Eigen::Vector3d& at, const Eigen::Vector3d& along, double radius_mm) {
  const gp_Circ circle(gp_Ax2(Point(at), gp_Dir(Way(along))), radius_mm);
  return BRepBuilderAPI_MakeWire(BRepBuilderAPI_MakeEdge(circle));
}

// The profile of a sweep, as a B-spline.
TopoDS_Wire SplineCircle(const Eigen::Vector3d& at, const Eigen::Vector3d& along,
                         double radius_mm) {
  const Handle(Geom_Circle) circle =
      new Geom_Circle(gp_Ax2(Point(at), gp_Dir(Way(along))), radius_mm);
  return BRepBuilderAPI_MakeWire(BRepBuilderAPI_MakeEdge(GeomConvert::CurveToBSplineCurve(circle)));
}

// Calls straight(from, to) and bend(arc) of the centre line, in order.
void EachPiece(const hal::Tube& tube, const auto& straight, const auto& bend) {
  const host::Spine spine = host::SpineOf(tube);
  Eigen::Vector3d at = spine.start;
  for (const host::SpineArc& arc : spine.arcs) {
    if ((arc.from - at).norm() > 1e-6) straight(at, arc.from);
    bend(arc);
    at = arc.to;
  }
  if ((spine.end - at).norm() > 1e-6) straight(at, spine.end);
}

gp_Ax1 AxisOf(const host::SpineArc& arc) { return {Point(arc.centre), gp_Dir(Way(arc.normal))}; }

}  // namespace

TopoDS_Shape AsNurbs(const TopoDS_Shape& wire) { return BRepBuilderAPI_NurbsConvert(wire); }

TopoDS_Shape AsExtrusions(const hal::Tube& tube) {
  TopoDS_Compound all;
  BRep_Builder builder;
  builder.MakeCompound(all);
  EachPiece(
      tube,
      [&](const Eigen::Vector3d& from, const Eigen::Vector3d& to) {
        const TopoDS_Wire ring = SplineCircle(from, to - from, tube.pipe_radius_mm);
        builder.Add(all, BRepPrimAPI_MakePrism(ring, Way(to - from)).Shape());
      },
      [&](const host::SpineArc& arc) {
        const TopoDS_Wire ring = SplineCircle(arc.from, arc.tangent_in, tube.pipe_radius_mm);
        builder.Add(all, BRepPrimAPI_MakeRevol(ring, AxisOf(arc), arc.angle_rad).Shape());
      });
  return all;
}

TopoDS_Shape AsCutSplines(const hal::Tube& tube, double short_piece_deg) {
  TopoDS_Compound all;
  BRep_Builder builder;
  builder.MakeCompound(all);
  const double whole = 2 * M_PI;
  const auto add = [&](const Handle(Geom_Surface) & surface, double short_piece) {
    const Handle(Geom_BSplineSurface) spline = GeomConvert::SurfaceToBSplineSurface(surface);
    spline->IncreaseDegree(3, 3);
    if (short_piece > 0) spline->InsertUKnot(short_piece, 3, 1e-9);
    builder.Add(all, BRepBuilderAPI_MakeFace(spline, 1e-6).Face());
  };
  EachPiece(
      tube,
      [&](const Eigen::Vector3d& from, const Eigen::Vector3d& to) {
        const gp_Ax3 axes(Point(from), gp_Dir(Way(to - from)));
        add(new Geom_RectangularTrimmedSurface(
                new Geom_CylindricalSurface(axes, tube.pipe_radius_mm), 0, whole, 0,
                (to - from).norm()),
            0);
      },
      [&](const host::SpineArc& arc) {
        const gp_Ax3 axes(Point(arc.centre), gp_Dir(Way(arc.normal)),
                          gp_Dir(Way(arc.from - arc.centre)));
        add(new Geom_RectangularTrimmedSurface(
                new Geom_ToroidalSurface(axes, arc.bend_radius_mm, tube.pipe_radius_mm), 0,
                arc.angle_rad, 0, whole),
            short_piece_deg * M_PI / 180);
      });
  return all;
}

TopoDS_Shape WithoutSeams(const TopoDS_Shape& shape, double angle_deg) {
  ShapeUpgrade_ShapeDivideAngle divide(angle_deg * M_PI / 180, shape);
  divide.Perform();
  return divide.Result();
}

TopoDS_Shape AsShell(const hal::Tube& tube) {
  BRepOffsetAPI_MakePipeShell sweep(TopoDS::Wire(CentreLine(tube)));
  const host::Spine spine = host::SpineOf(tube);
  sweep.Add(CircleAbout(spine.start, spine.direction, tube.pipe_radius_mm));
  sweep.Build();
  sweep.MakeSolid();
  return sweep.Shape();
}

TopoDS_Shape InSolids(const hal::Tube& tube, double wall_mm, bool as_compound_solid) {
  TopoDS_Compound all;
  BRep_Builder builder;
  builder.MakeCompound(all);
  const auto swept = [&](const Eigen::Vector3d& at, const Eigen::Vector3d& along,
                         const auto& sweep) {
    TopoDS_Shape solid =
        sweep(BRepBuilderAPI_MakeFace(CircleAbout(at, along, tube.pipe_radius_mm)).Face());
    if (wall_mm > 0) {
      const TopoDS_Face bore =
          BRepBuilderAPI_MakeFace(CircleAbout(at, along, tube.pipe_radius_mm - wall_mm));
      solid = BRepAlgoAPI_Cut(solid, sweep(bore)).Shape();
    }
    builder.Add(all, solid);
  };
  EachPiece(
      tube,
      [&](const Eigen::Vector3d& from, const Eigen::Vector3d& to) {
        swept(from, to - from, [&](const TopoDS_Face& face) -> TopoDS_Shape {
          return BRepPrimAPI_MakePrism(face, Way(to - from)).Shape();
        });
      },
      [&](const host::SpineArc& arc) {
        swept(arc.from, arc.tangent_in, [&](const TopoDS_Face& face) -> TopoDS_Shape {
          return BRepPrimAPI_MakeRevol(face, AxisOf(arc), arc.angle_rad).Shape();
        });
      });
  if (!as_compound_solid) return all;
  BOPAlgo_MakerVolume volume;
  TopTools_ListOfShape faces;
  for (TopExp_Explorer at(all, TopAbs_FACE); at.More(); at.Next()) faces.Append(at.Current());
  volume.SetArguments(faces);
  volume.SetIntersect(true);
  volume.Perform();
  TopoDS_CompSolid shared;
  builder.MakeCompSolid(shared);
  for (TopExp_Explorer at(volume.Shape(), TopAbs_SOLID); at.More(); at.Next()) {
    builder.Add(shared, at.Current());
  }
  return shared;
}

TopoDS_Shape InShells(const TopoDS_Shape& shape) {
  TopTools_ListOfShape what, by;
  what.Append(shape);
  by.Append(BRepBuilderAPI_MakeFace(gp_Pln({}, {0, 0, 1}), -5000, 5000, -5000, 5000).Shape());
  BRepAlgoAPI_Splitter splitter;
  splitter.SetArguments(what);
  splitter.SetTools(by);
  splitter.Build();
  return splitter.Shape();
}

TopoDS_Shape WithoutEnds(const TopoDS_Shape& shape) {
  TopoDS_Compound faces;
  BRep_Builder builder;
  builder.MakeCompound(faces);
  bool turn = false;
  for (TopExp_Explorer at(shape, TopAbs_FACE); at.More(); at.Next()) {
    if (BRepAdaptor_Surface(TopoDS::Face(at.Current())).GetType() == GeomAbs_Plane) continue;
    builder.Add(faces, turn ? at.Current().Reversed() : at.Current());
    turn = !turn;
  }
  return faces;
}

TopoDS_Shape Mirrored(const TopoDS_Shape& shape) {
  gp_Trsf mirror;
  mirror.SetMirror(gp_Ax2({}, {0, 0, 1}));
  return BRepBuilderAPI_Transform(shape, mirror, true).Shape();
}

TopoDS_Shape Ring(double bend_radius_mm, double radius_mm) {
  return BRepPrimAPI_MakeTorus(bend_radius_mm, radius_mm).Shape();
}

std::string Edited(const std::string& file, const std::string& what, const std::string& by) {
  std::ifstream in(file, std::ios::binary);
  std::string text{std::istreambuf_iterator<char>(in), {}};
  for (std::size_t at = 0; (at = text.find(what, at)) != std::string::npos; at += by.size()) {
    text.replace(at, what.size(), by);
  }
  const std::string edited = TemporaryFile("edited.step");
  std::ofstream(edited, std::ios::binary) << text;
  return edited;
}

}  // namespace bendloop::test
