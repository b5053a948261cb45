// SPDX-License-Identifier: Apache-2.0
#include "made_files.h"

#include <BRepAlgoAPI_Common.hxx>
#include <BRepAlgoAPI_Cut.hxx>
#include <BRepAlgoAPI_Fuse.hxx>
#include <BRepAlgoAPI_Splitter.hxx>
#include <BRepBuilderAPI_MakeEdge.hxx>
#include <BRepBuilderAPI_MakeFace.hxx>
#include <BRepBuilderAPI_MakeWire.hxx>
#include <BRepOffsetAPI_MakePipe.hxx>
#include <BRepPrimAPI_MakeBox.hxx>
#include <BRepPrimAPI_MakeCylinder.hxx>
#include <BRepPrimAPI_MakeHalfSpace.hxx>
#include <BRep_Builder.hxx>
#include <GeomAPI_PointsToBSpline.hxx>
#include <Geom_BSplineCurve.hxx>
#include <IGESControl_Controller.hxx>
#include <IGESControl_Writer.hxx>
#include <Interface_Static.hxx>
#include <STEPCAFControl_Writer.hxx>
#include <STEPControl_Controller.hxx>
#include <TColgp_Array1OfPnt.hxx>
#include <TDataStd_Name.hxx>
#include <TDocStd_Document.hxx>
#include <TopExp_Explorer.hxx>
#include <TopoDS.hxx>
#include <TopoDS_Compound.hxx>
#include <TopoDS_Face.hxx>
#include <TopoDS_Wire.hxx>
#include <XCAFDoc_DocumentTool.hxx>
#include <XCAFDoc_ShapeTool.hxx>
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <gp_Circ.hxx>
#include <gp_Pln.hxx>
#include <string>

#include "firmware-host/console/temporary_folder.h"
#include "hal/spine.h"

namespace bendloop::test {
namespace {

gp_Pnt P(const Eigen::Vector3d& p) { return {p.x(), p.y(), p.z()}; }
gp_Dir D(const Eigen::Vector3d& d) { return {d.x(), d.y(), d.z()}; }
constexpr double kFar = 5000;  // mm: beyond every tube here

TopoDS_Shape Swept(const hal::Tube& tube, double radius_mm) {
  const Eigen::Vector3d start = tube.X_WT.position_mm;
  const Eigen::Vector3d along = tube.X_WT.orientation * Eigen::Vector3d::UnitX();
  const TopoDS_Wire ring = BRepBuilderAPI_MakeWire(
      BRepBuilderAPI_MakeEdge(gp_Circ(gp_Ax2(P(start), D(along)), radius_mm)));
  const TopoDS_Face disc = BRepBuilderAPI_MakeFace(ring);
  return BRepOffsetAPI_MakePipe(TopoDS::Wire(CentreLine(tube)), disc).Shape();
}

// Faces split where they cross planes through the first straight.
TopoDS_Shape Split(const TopoDS_Shape& shape, const hal::Tube& tube, int cuts) {
  TopTools_ListOfShape what, by;
  what.Append(shape);
  for (int i = 0; i < cuts; ++i) {
    const Eigen::Vector3d normal =
        tube.X_WT.orientation * Eigen::Vector3d(0, i == 0 ? 0 : 1, i == 0 ? 1 : 0);
    by.Append(BRepBuilderAPI_MakeFace(gp_Pln(P(tube.X_WT.position_mm), D(normal)), -kFar, kFar,
                                      -kFar, kFar)
                  .Shape());
  }
  BRepAlgoAPI_Splitter splitter;
  splitter.SetArguments(what);
  splitter.SetTools(by);
  splitter.Build();
  // The solids fall apart: their faces together are the tube with split faces.
  return splitter.Shape();
}

TopoDS_Shape Bar(const Eigen::Vector3d& from, const Eigen::Vector3d& to, double radius_mm) {
  return BRepPrimAPI_MakeCylinder(gp_Ax2(P(from), D(to - from)), radius_mm, (to - from).norm())
      .Shape();
}

}  // namespace

TopoDS_Shape CentreLine(const hal::Tube& tube) {
  BRepBuilderAPI_MakeWire wire;
  Eigen::Vector3d at = tube.X_WT.position_mm;
  Eigen::Matrix3d frame = tube.X_WT.orientation.toRotationMatrix();
  for (const hal::BendRow& row : tube.program.rows) {
    const Eigen::Vector3d to = at + row.length_mm * frame.col(0);
    if (row.length_mm > 0) wire.Add(BRepBuilderAPI_MakeEdge(P(at), P(to)));
    at = to;
    if (!row.bend_radius_mm || row.angle_deg == 0) continue;
    frame = frame * Eigen::AngleAxisd(row.rotation_deg * M_PI / 180, Eigen::Vector3d::UnitX());
    const Eigen::Vector3d centre = at + *row.bend_radius_mm * frame.col(1);
    const double angle = row.angle_deg * M_PI / 180;
    const gp_Circ circle(gp_Ax2(P(centre), D(frame.col(2)), D(-frame.col(1))), *row.bend_radius_mm);
    wire.Add(BRepBuilderAPI_MakeEdge(circle, 0, angle));
    at = centre + Eigen::AngleAxisd(angle, frame.col(2)) * (at - centre);
    frame = Eigen::AngleAxisd(angle, frame.col(2)) * frame;
  }
  return wire.Wire();
}

TopoDS_Shape Pipe(const hal::Tube& tube, const PipeOptions& options) {
  TopoDS_Shape shape = Swept(tube, tube.pipe_radius_mm);
  if (options.wall_mm > 0) {
    shape = BRepAlgoAPI_Cut(shape, Swept(tube, tube.pipe_radius_mm - options.wall_mm)).Shape();
  }
  if (options.cuts > 0) shape = LooseFaces(Split(shape, tube, options.cuts));
  return shape;
}

TopoDS_Shape SplineHose(double radius_mm) {
  TColgp_Array1OfPnt points(1, 5);
  points(1) = {0, 0, 0};
  points(2) = {60, 0, 0};
  points(3) = {110, 30, 10};
  points(4) = {120, 90, 40};
  points(5) = {180, 140, 40};
  const Handle(Geom_BSplineCurve) curve = GeomAPI_PointsToBSpline(points).Curve();
  gp_Pnt start;
  gp_Vec along;
  curve->D1(curve->FirstParameter(), start, along);
  const TopoDS_Wire ring =
      BRepBuilderAPI_MakeWire(BRepBuilderAPI_MakeEdge(gp_Circ(gp_Ax2(start, along), radius_mm)));
  const TopoDS_Wire spine = BRepBuilderAPI_MakeWire(BRepBuilderAPI_MakeEdge(curve));
  return BRepOffsetAPI_MakePipe(spine, BRepBuilderAPI_MakeFace(ring).Face()).Shape();
}

TopoDS_Shape SplineBends(const hal::Tube& tube, int places) {
  BRepBuilderAPI_MakeWire spine;
  for (const hal::SpineSegment& segment : hal::SpineSegments(tube.program, tube.X_WT)) {
    const bool is_line = (segment.TangentAt(0) - segment.TangentAt(segment.length_mm)).norm() == 0;
    TColgp_Array1OfPnt points(1, is_line ? 2 : places);
    for (int i = 1; i <= points.Length(); ++i) {
      const double part = double(i - 1) / (points.Length() - 1);
      const Eigen::Vector3d p = segment.PointAt(part * segment.length_mm);
      points(i) = {p.x(), p.y(), p.z()};
    }
    spine.Add(is_line ? BRepBuilderAPI_MakeEdge(points(1), points(2)).Edge()
                      : BRepBuilderAPI_MakeEdge(
                            GeomAPI_PointsToBSpline(points, 3, 8, GeomAbs_C2, 1e-4).Curve())
                            .Edge());
  }
  const Eigen::Vector3d start = tube.X_WT.position_mm;
  const Eigen::Vector3d along = tube.X_WT.orientation * Eigen::Vector3d::UnitX();
  const gp_Ax2 axes(gp_Pnt(start.x(), start.y(), start.z()),
                    gp_Dir(along.x(), along.y(), along.z()));
  const TopoDS_Wire ring =
      BRepBuilderAPI_MakeWire(BRepBuilderAPI_MakeEdge(gp_Circ(axes, tube.pipe_radius_mm)));
  return BRepOffsetAPI_MakePipe(spine, BRepBuilderAPI_MakeFace(ring).Face()).Shape();
}

TopoDS_Shape LooseFaces(const TopoDS_Shape& shape, const std::vector<int>& without) {
  TopoDS_Compound faces;
  BRep_Builder builder;
  builder.MakeCompound(faces);
  int number = 0;
  for (TopExp_Explorer at(shape, TopAbs_FACE); at.More(); at.Next()) {
    if (std::find(without.begin(), without.end(), ++number) == without.end()) {
      builder.Add(faces, at.Current());
    }
  }
  return faces;
}

TopoDS_Shape Drilled(const TopoDS_Shape& shape, const Eigen::Vector3d& from,
                     const Eigen::Vector3d& to, double radius_mm) {
  return BRepAlgoAPI_Cut(shape, Bar(from, to, radius_mm)).Shape();
}

TopoDS_Shape Cut(const TopoDS_Shape& shape, const Eigen::Vector3d& at,
                 const Eigen::Vector3d& normal) {
  const TopoDS_Face plane =
      BRepBuilderAPI_MakeFace(gp_Pln(P(at), D(normal)), -kFar, kFar, -kFar, kFar);
  return BRepAlgoAPI_Cut(shape, BRepPrimAPI_MakeHalfSpace(plane, P(at + normal)).Solid()).Shape();
}

TopoDS_Shape WithCollar(const TopoDS_Shape& shape, const Eigen::Vector3d& from,
                        const Eigen::Vector3d& to, double radius_mm, double inner_radius_mm) {
  const TopoDS_Shape ring =
      BRepAlgoAPI_Cut(Bar(from, to, radius_mm), Bar(from, to, inner_radius_mm)).Shape();
  return BRepAlgoAPI_Fuse(shape, ring).Shape();
}

TopoDS_Shape Joined(const TopoDS_Shape& a, const TopoDS_Shape& b) {
  return BRepAlgoAPI_Fuse(a, b).Shape();
}

TopoDS_Shape Without(const TopoDS_Shape& a, const TopoDS_Shape& b) {
  return BRepAlgoAPI_Cut(a, b).Shape();
}

std::string WriteStepFile(const Named& shapes, const std::string& schema, const std::string& unit) {
  Handle(TDocStd_Document) document = new TDocStd_Document("BinXCAF");
  const Handle(XCAFDoc_ShapeTool) tool = XCAFDoc_DocumentTool::ShapeTool(document->Main());
  const auto name = [](const TDF_Label& label, const std::string& text) {
    TDataStd_Name::Set(label, TCollection_ExtendedString(text.c_str(), true));
  };
  const bool several = shapes.size() > 1;
  TDF_Label outer, inner;
  if (several) {
    outer = tool->NewShape();
    inner = tool->NewShape();
    name(outer, "rack");
    name(inner, "lines");
  }
  double moved = 0;
  for (const auto& [text, shape] : shapes) {
    const TDF_Label label = tool->AddShape(shape, false);
    name(label, text);
    if (!several) continue;
    gp_Trsf place;
    place.SetRotation(gp_Ax1({}, {0, 1, 0}), 0.3);
    place.SetTranslationPart({0, moved += 300, 10});
    tool->AddComponent(inner, label, TopLoc_Location(place));
  }
  if (several) {
    gp_Trsf place;
    place.SetRotation(gp_Ax1({}, {1, 1, 0}), 1);
    tool->AddComponent(outer, inner, TopLoc_Location(place));
    tool->UpdateAssemblies();
  }
  STEPControl_Controller::Init();
  Interface_Static::SetCVal("write.step.schema", schema.c_str());
  Interface_Static::SetCVal("write.step.unit", unit.c_str());
  STEPCAFControl_Writer writer;  // takes the unit as it stands now
  const std::string file = TemporaryFile("made.step");
  if (!writer.Transfer(document) || writer.Write(file.c_str()) != IFSelect_RetDone) return "";
  return file;
}

std::string WriteIgesFile(const TopoDS_Shape& shape, const std::string& unit) {
  IGESControl_Controller::Init();
  IGESControl_Writer writer(unit.c_str(), 1);
  const std::string file = TemporaryFile("made.igs");
  if (!writer.AddShape(shape) || !writer.Write(file.c_str())) return "";
  return file;
}

std::string TemporaryFile(const std::string& name) {
  static const auto folder = host::TemporaryFolder::Make();  // goes when the program ends
  return folder ? (folder->path() / name).string() : "";
}

}  // namespace bendloop::test
