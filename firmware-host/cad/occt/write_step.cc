// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cad/occt/write_step.h"

#include <BRepBuilderAPI_MakeEdge.hxx>
#include <BRepBuilderAPI_MakeFace.hxx>
#include <BRepBuilderAPI_MakeSolid.hxx>
#include <BRepBuilderAPI_MakeWire.hxx>
#include <BRepBuilderAPI_Sewing.hxx>
#include <BRepLib.hxx>
#include <Geom_BSplineCurve.hxx>
#include <Geom_CylindricalSurface.hxx>
#include <Geom_ToroidalSurface.hxx>
#include <Interface_Static.hxx>
#include <STEPCAFControl_Writer.hxx>
#include <TColStd_Array1OfInteger.hxx>
#include <TColStd_Array1OfReal.hxx>
#include <TColgp_Array1OfPnt.hxx>
#include <TCollection_ExtendedString.hxx>
#include <TDataStd_Name.hxx>
#include <TDocStd_Document.hxx>
#include <TopExp_Explorer.hxx>
#include <TopoDS.hxx>
#include <TopoDS_Face.hxx>
#include <TopoDS_Shell.hxx>
#include <TopoDS_Solid.hxx>
#include <TopoDS_Wire.hxx>
#include <XCAFDoc_DocumentTool.hxx>
#include <XCAFDoc_ShapeTool.hxx>
#include <cmath>
#include <gp_Circ.hxx>
#include <gp_Pln.hxx>
#include <optional>
#include <stdexcept>
#include <vector>

namespace bendloop::cad {
namespace {

using nlohmann::json;

constexpr double kTurn = 2 * M_PI;
// Neighbouring faces have their edge in common to rounding; wider gaps are a mistake.
constexpr double kSewingMm = 1e-6;

gp_Pnt Point(const json& j) { return {j.at(0), j.at(1), j.at(2)}; }

// One line or arc of the centre line.
struct Segment {
  gp_Pnt from, to;
  gp_Dir tangent;            // at its start
  std::optional<gp_Ax3> at;  // of an arc: centre, axis, x towards `from`
  double size = 0;           // length, or radius
  double angle = 0;          // of an arc

  gp_Dir EndTangent() const {
    return at ? tangent.Rotated(gp_Ax1(at->Location(), at->Direction()), angle) : tangent;
  }
};

std::vector<Segment> SegmentsOf(const json& tube) {
  std::vector<Segment> segments;
  for (const json& j : tube.at("segments")) {
    Segment s;
    s.from = Point(j.at("from"));
    s.to = Point(j.at("to"));
    if (j.contains("centre")) {
      const gp_Pnt centre = Point(j.at("centre")), axis = Point(j.at("axis"));
      s.at = gp_Ax3(centre, gp_Dir(axis.XYZ()), gp_Dir(gp_Vec(centre, s.from)));
      s.size = centre.Distance(s.from);
      s.angle = j.at("angle_deg").get<double>() * M_PI / 180;
      s.tangent = s.at->YDirection();
    } else {
      s.size = s.from.Distance(s.to);
      s.tangent = gp_Dir(gp_Vec(s.from, s.to));
    }
    segments.push_back(s);
  }
  if (segments.empty()) throw std::runtime_error("a tube without segments");
  return segments;
}

TopoDS_Wire CentreLine(const std::vector<Segment>& segments) {
  BRepBuilderAPI_MakeWire wire;
  for (const Segment& s : segments) {
    if (s.at) {
      wire.Add(BRepBuilderAPI_MakeEdge(gp_Circ(s.at->Ax2(), s.size), 0, s.angle));
    } else {
      wire.Add(BRepBuilderAPI_MakeEdge(s.from, s.to));
    }
  }
  return wire.Wire();
}

// The faces of a pipe of `radius` about the centre line. `seam`, across the first tangent, is where
// they close; it is carried along without turning, so that neighbours have whole edges in common.
void AddPipe(const std::vector<Segment>& segments, double radius, gp_Dir seam,
             BRepBuilderAPI_Sewing& sewing) {
  for (const Segment& s : segments) {
    if (s.at) {
      const double v = std::atan2(seam.Dot(s.at->Direction()), seam.Dot(s.at->XDirection()));
      const Handle(Geom_Surface) torus = new Geom_ToroidalSurface(*s.at, s.size, radius);
      sewing.Add(BRepBuilderAPI_MakeFace(torus, 0, s.angle, v, v + kTurn, kSewingMm).Face());
      seam.Rotate(gp_Ax1(s.at->Location(), s.at->Direction()), s.angle);
    } else {
      const gp_Ax3 axes(s.from, s.tangent, seam);
      const Handle(Geom_Surface) cylinder = new Geom_CylindricalSurface(axes, radius);
      sewing.Add(BRepBuilderAPI_MakeFace(cylinder, 0, kTurn, 0, s.size, kSewingMm).Face());
    }
  }
}

void AddCap(const gp_Pnt& at, const gp_Dir& normal, double radius, double inner_radius,
            BRepBuilderAPI_Sewing& sewing) {
  const gp_Ax2 axes(at, normal);
  const auto ring = [&](double r) {
    return BRepBuilderAPI_MakeWire(BRepBuilderAPI_MakeEdge(gp_Circ(axes, r))).Wire();
  };
  BRepBuilderAPI_MakeFace face(gp_Pln(at, normal), ring(radius));
  if (inner_radius > 0) face.Add(TopoDS::Wire(ring(inner_radius).Reversed()));
  sewing.Add(face.Face());
}

TopoDS_Shape Surface(const std::vector<Segment>& segments, double radius, double wall) {
  BRepBuilderAPI_Sewing sewing(kSewingMm);
  const gp_Dir seam = gp_Ax2(segments.front().from, segments.front().tangent).XDirection();
  AddPipe(segments, radius, seam, sewing);
  const bool hollow = wall > 0 && wall < radius;
  if (hollow) {
    AddPipe(segments, radius - wall, seam, sewing);
    const Segment& first = segments.front();
    const Segment& last = segments.back();
    AddCap(first.from, first.tangent.Reversed(), radius, radius - wall, sewing);
    AddCap(last.to, last.EndTangent(), radius, radius - wall, sewing);
  }
  sewing.Perform();
  const TopoDS_Shape sewed = sewing.SewedShape();
  if (!hollow) return sewed;
  TopExp_Explorer shell(sewed, TopAbs_SHELL);
  if (!shell.More() || sewing.NbFreeEdges() > 0) {
    throw std::runtime_error("the tube's surface does not close: its segments do not meet");
  }
  TopoDS_Solid solid = BRepBuilderAPI_MakeSolid(TopoDS::Shell(shell.Current()));
  BRepLib::OrientClosedSolid(solid);
  return solid;
}

template <class Array>
Array Values(const json& j) {
  Array values(1, static_cast<int>(j.size()));
  for (int i = 1; i <= values.Upper(); ++i)
    values.SetValue(i, j.at(static_cast<std::size_t>(i - 1)));
  return values;
}

// A rational B-spline as it stands in the file.
TopoDS_Shape Curve(const json& j) {
  const json& places = j.at("poles");
  TColgp_Array1OfPnt poles(1, static_cast<int>(places.size()));
  for (int i = 1; i <= poles.Upper(); ++i) {
    poles.SetValue(i, Point(places.at(static_cast<std::size_t>(i - 1))));
  }
  const Handle(Geom_BSplineCurve) curve = new Geom_BSplineCurve(
      poles, Values<TColStd_Array1OfReal>(j.at("weights")),
      Values<TColStd_Array1OfReal>(j.at("knots")),
      Values<TColStd_Array1OfInteger>(j.at("multiplicities")), j.at("degree").get<int>());
  return BRepBuilderAPI_MakeEdge(curve).Edge();
}

// What goes into one file, by name.
class StepFile {
 public:
  void Add(const TopoDS_Shape& shape, const std::string& called) {
    const TDF_Label label = shapes_->AddShape(shape, false);
    TDataStd_Name::Set(label, TCollection_ExtendedString(called.c_str(), true));
  }
  void Write(const std::string& name, const std::string& file) {
    STEPCAFControl_Writer writer;
    Interface_Static::SetCVal("write.step.schema", "AP214IS");
    Interface_Static::SetCVal("write.step.unit", "MM");
    Interface_Static::SetCVal("write.step.product.name", name.c_str());
    if (!writer.Transfer(document_) || writer.Write(file.c_str()) != IFSelect_RetDone) {
      throw std::runtime_error("cannot be written");
    }
  }

 private:
  Handle(TDocStd_Document) document_ = new TDocStd_Document("BinXCAF");
  Handle(XCAFDoc_ShapeTool) shapes_ = XCAFDoc_DocumentTool::ShapeTool(document_->Main());
};

}  // namespace

void WriteStep(const json& tube, const std::string& file) {
  const std::string name = tube.value("name", std::string("tube"));
  StepFile step;
  if (tube.contains("curves")) {
    for (const json& curve : tube.at("curves")) {
      step.Add(Curve(curve), curve.value("name", std::string("border")));
    }
    return step.Write(name, file);
  }
  const std::vector<Segment> segments = SegmentsOf(tube);
  const double radius = tube.value("pipe_radius_mm", 0.0), wall = tube.value("wall_mm", 0.0);
  if (radius > 0) step.Add(Surface(segments, radius, wall), name);
  step.Add(CentreLine(segments), name + ", centre line");
  step.Write(name, file);
}

}  // namespace bendloop::cad
