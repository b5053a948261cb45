// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cad/occt/read_shape.h"

#include <BRepAdaptor_Curve.hxx>
#include <BRepAdaptor_Surface.hxx>
#include <BRepBuilderAPI_Transform.hxx>
#include <BRepTools.hxx>
#include <BRepTopAdaptor_FClass2d.hxx>
#include <BRep_Builder.hxx>
#include <BRep_Tool.hxx>
#include <Geom2d_Curve.hxx>
#include <Geom_Surface.hxx>
#include <IGESControl_Reader.hxx>
#include <Interface_InterfaceModel.hxx>
#include <STEPCAFControl_Reader.hxx>
#include <STEPControl_Reader.hxx>
#include <Standard_Failure.hxx>
#include <StepShape_ConnectedFaceSet.hxx>
#include <StepShape_GeometricSet.hxx>
#include <StepShape_OrientedClosedShell.hxx>
#include <StepShape_OrientedOpenShell.hxx>
#include <StepShape_ShellBasedSurfaceModel.hxx>
#include <StepShape_SolidModel.hxx>
#include <TColStd_Array1OfReal.hxx>
#include <TCollection_AsciiString.hxx>
#include <TDF_Label.hxx>
#include <TDF_LabelSequence.hxx>
#include <TDataStd_Name.hxx>
#include <TDocStd_Document.hxx>
#include <TopExp.hxx>
#include <TopExp_Explorer.hxx>
#include <TopTools_IndexedMapOfShape.hxx>
#include <TopTools_MapOfShape.hxx>
#include <TopoDS.hxx>
#include <TopoDS_Compound.hxx>
#include <XCAFDoc_DocumentTool.hxx>
#include <XCAFDoc_ShapeTool.hxx>
#include <algorithm>
#include <cmath>
#include <fstream>
#include <gp_Cylinder.hxx>
#include <gp_Pnt2d.hxx>
#include <gp_Torus.hxx>
#include <iterator>
#include <map>
#include <optional>
#include <set>
#include <sstream>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include "firmware-host/cad/occt/placements.h"

namespace bendloop::cad {
namespace {

using nlohmann::json;

// A face that is not given as cylinder, torus or plane is sampled by so many points each way,
// between two places where its curvature may jump. A whole turn in 15 degrees.
constexpr int kGridSteps = 24;
// And by at most so many, where a step in mm is asked for.
constexpr int kMostGridSteps = 1000;
// More of such pieces in one direction, or in all, are no tube but a scanned skin.
constexpr int kMostPieces = 200, kMostCells = 4000;
// Of a face in more pieces than this, each is sampled by fewer points.
constexpr int kManyCells = 64, kFewGridSteps = 8;
// More bodies are a plant, or a file that multiplies itself by assemblies of assemblies.
constexpr std::size_t kMostBodies = 20000;
// An edge that is no straight line, in so many chords.
constexpr int kEdgeSteps = 16;

json Numbers(const gp_Pnt& p) { return {p.X(), p.Y(), p.Z()}; }
json Numbers(const gp_Dir& d) { return {d.X(), d.Y(), d.Z()}; }

// Whether a file has bytes that are neither ASCII, as its escapes are, nor UTF-8.
bool HasOtherBytes(const std::string& file) {
  std::ifstream in(file, std::ios::binary);
  int expected = 0;  // bytes that go on with a letter
  for (std::istreambuf_iterator<char> at(in), end; at != end; ++at) {
    const auto byte = static_cast<unsigned char>(*at);
    const bool goes_on = (byte & 0xC0) == 0x80;
    if (goes_on != (expected > 0)) return true;
    if (goes_on) {
      --expected;
    } else if (byte >= 0x80) {
      expected = byte >= 0xF0 ? 3 : byte >= 0xE0 ? 2 : 1;
    }
  }
  return expected > 0;
}

// OpenCASCADE takes other bytes than UTF-8 as Latin-1. So many accented letters in a row are no
// word of a western language but one in Windows-1251, as systems write it that are set to Russian.
TCollection_ExtendedString InCyrillic(const TCollection_ExtendedString& name) {
  constexpr int kInARow = 3, kFirstLetter = 0xC0, kLastByte = 0xFF;
  static const std::map<int, int> kOthers{{0xA8, 0x401}, {0xB8, 0x451}, {0xB9, 0x2116}};
  int row = 0, longest = 0;
  for (int i = 1; i <= name.Length(); ++i) {
    const int c = name.Value(i);
    if (c > kLastByte) return name;
    row = c >= kFirstLetter ? row + 1 : 0;
    longest = std::max(longest, row);
  }
  if (longest < kInARow) return name;
  TCollection_ExtendedString cyrillic = name;
  for (int i = 1; i <= name.Length(); ++i) {
    const int c = name.Value(i);
    const auto other = kOthers.find(c);
    if (c >= kFirstLetter) cyrillic.SetValue(i, Standard_ExtCharacter(c - kFirstLetter + 0x410));
    if (other != kOthers.end()) cyrillic.SetValue(i, Standard_ExtCharacter(other->second));
  }
  return cyrillic;
}

std::string NameOf(const TDF_Label& label, bool has_other_bytes) {
  Handle(TDataStd_Name) name;
  if (!label.FindAttribute(TDataStd_Name::GetID(), name)) return "";
  const TCollection_ExtendedString text = has_other_bytes ? InCyrillic(name->Get()) : name->Get();
  return TCollection_AsciiString(text).ToCString();  // UTF-8
}

const char* KindOf(GeomAbs_SurfaceType type) {
  switch (type) {
    case GeomAbs_Plane:
      return "plane";
    case GeomAbs_Cylinder:
      return "cylinder";
    case GeomAbs_Torus:
      return "torus";
    case GeomAbs_Cone:
      return "cone";
    case GeomAbs_Sphere:
      return "sphere";
    case GeomAbs_BezierSurface:
      return "Bezier surface";
    case GeomAbs_BSplineSurface:
      return "B-spline surface";
    case GeomAbs_SurfaceOfRevolution:
      return "surface of revolution";
    case GeomAbs_SurfaceOfExtrusion:
      return "surface of extrusion";
    case GeomAbs_OffsetSurface:
      return "offset surface";
    default:
      return "other surface";
  }
}

struct Domain {
  double u0 = 0, u1 = 0, v0 = 0, v1 = 0;
};

// The face's normal (out of the material) at (u, v); zero where it has none.
template <class Surface>
gp_Vec NormalAt(const Surface& surface, bool reversed, double u, double v, gp_Pnt& p) {
  gp_Vec du, dv;
  surface.D1(u, v, p, du, dv);
  gp_Vec n = du.Crossed(dv);
  if (n.Magnitude() < 1e-12) return {0, 0, 0};
  n.Normalize();
  if (reversed) n.Reverse();
  return n;
}

// Steps from `from` to `to` along a curve at(parameter), each at most `step_mm`; 0: as they come.
template <class At>
int StepsAlong(double step_mm, int fewest, double from, double to, const At& at) {
  if (!(step_mm > 0)) return fewest;
  double length = 0;
  gp_Pnt before = at(from);
  for (int i = 1; i <= kGridSteps; ++i) {
    const gp_Pnt p = at(from + (to - from) * i / kGridSteps);
    length += p.Distance(before);
    before = p;
  }
  return std::clamp(int(std::min(length / step_mm, 1e6)) + 1, fewest, kMostGridSteps);
}

double Inside(int step, int steps) {
  constexpr double kInside = 1e-9;
  return std::clamp(double(step) / steps, kInside, 1 - kInside);
}

// Which points of its surface belong to a face.
class FaceArea {
 public:
  // `asks`: else it has them all.
  FaceArea(const TopoDS_Face& face, const Domain& d, bool asks) {
    try {
      if (asks && !IsAll(face, d)) in_.emplace(face, kToleranceUv);
    } catch (const Standard_Failure&) {
      // Of a damaged border nothing is known.
    }
  }

  bool Has(double u, double v) { return !in_ || in_->Perform(gp_Pnt2d(u, v)) != TopAbs_OUT; }

 private:
  static constexpr double kToleranceUv = 1e-6;

  // Whether the face's border is that of the domain, as most are: asking for each point is slow.
  static bool IsAll(const TopoDS_Face& face, const Domain& d) {
    const double off_u = kToleranceUv * (d.u1 - d.u0), off_v = kToleranceUv * (d.v1 - d.v0);
    const auto all_at = [](const gp_Pnt2d* points, bool of_u, double at, double off) {
      return std::all_of(points, points + 3, [&](const gp_Pnt2d& p) {
        return std::abs((of_u ? p.X() : p.Y()) - at) < off;
      });
    };
    for (TopExp_Explorer at(face, TopAbs_EDGE); at.More(); at.Next()) {
      double from = 0, to = 0;
      const Handle(Geom2d_Curve) curve =
          BRep_Tool::CurveOnSurface(TopoDS::Edge(at.Current()), face, from, to);
      if (curve.IsNull()) return false;
      const gp_Pnt2d points[] = {curve->Value(from), curve->Value((from + to) / 2),
                                 curve->Value(to)};
      if (!all_at(points, true, d.u0, off_u) && !all_at(points, true, d.u1, off_u) &&
          !all_at(points, false, d.v0, off_v) && !all_at(points, false, d.v1, off_v)) {
        return false;
      }
    }
    return true;
  }

  std::optional<BRepTopAdaptor_FClass2d> in_;
};

// Of the surface itself: at corners of its pieces an adaptor takes another piece's polynomials. A
// little inside of the piece, whose neighbour may go on at an angle. What lies beyond the face's
// edges has a seventh number.
json Samples(const Geom_Surface& surface, FaceArea& area, bool reversed, const Domain& d,
             double step_mm, int fewest) {
  const double u = (d.u0 + d.u1) / 2, v = (d.v0 + d.v1) / 2;
  const auto along_u = [&](double at) { return surface.Value(at, v); };
  const auto along_v = [&](double at) { return surface.Value(u, at); };
  const int nu = StepsAlong(step_mm, fewest, d.u0, d.u1, along_u);
  const int nv = StepsAlong(step_mm, fewest, d.v0, d.v1, along_v);
  json points = json::array();
  for (int i = 0; i <= nu; ++i) {
    for (int j = 0; j <= nv; ++j) {
      gp_Pnt p;
      const double at_u = d.u0 + (d.u1 - d.u0) * Inside(i, nu);
      const double at_v = d.v0 + (d.v1 - d.v0) * Inside(j, nv);
      const gp_Vec n = NormalAt(surface, reversed, at_u, at_v, p);
      if (n.Magnitude() < 0.5) continue;
      points.push_back({p.X(), p.Y(), p.Z(), n.X(), n.Y(), n.Z()});
      if (!area.Has(at_u, at_v)) points.back().push_back(0);
    }
  }
  return points;
}

// The parameters within [from, to] at which the surface's curvature may jump, both ends included.
std::vector<double> Within(const TColStd_Array1OfReal& all, double from, double to) {
  std::vector<double> cuts{from};
  for (int i = all.Lower(); i <= all.Upper(); ++i) {
    if (all(i) > from + 1e-9 && all(i) < to - 1e-9) cuts.push_back(all(i));
  }
  cuts.push_back(to);
  return cuts;
}

void AddFreePatches(const TopoDS_Face& face, const BRepAdaptor_Surface& surface, const Domain& d,
                    const json& head, double step_mm, json& patches) {
  const Handle(Geom_Surface) whole = BRep_Tool::Surface(face);
  const bool reversed = face.Orientation() == TopAbs_REVERSED;
  const int nu = surface.NbUIntervals(GeomAbs_C2), nv = surface.NbVIntervals(GeomAbs_C2);
  std::vector<double> us{d.u0, d.u1}, vs{d.v0, d.v1};
  if (nu <= kMostPieces && nv <= kMostPieces && nu * nv <= kMostCells) {
    TColStd_Array1OfReal all_u(1, nu + 1), all_v(1, nv + 1);
    surface.UIntervals(all_u, GeomAbs_C2);
    surface.VIntervals(all_v, GeomAbs_C2);
    us = Within(all_u, d.u0, d.u1);
    vs = Within(all_v, d.v0, d.v1);
  }
  FaceArea area(face, d, step_mm == 0);  // the nearest tube is of too many samples to ask
  const bool many = (us.size() - 1) * (vs.size() - 1) > kManyCells;
  for (std::size_t i = 0; i + 1 < us.size(); ++i) {
    for (std::size_t j = 0; j + 1 < vs.size(); ++j) {
      json patch = head;
      patch["cell"] = {i, j};
      patch["samples"] = Samples(*whole, area, reversed, {us[i], us[i + 1], vs[j], vs[j + 1]},
                                 step_mm, many ? kFewGridSteps : kGridSteps);
      patches.push_back(std::move(patch));
    }
  }
}

// Bounds of a face are those of boxes about its edges, which may reach beyond a surface's end,
// where a B-spline is anything.
void ClampToSurface(const BRepAdaptor_Surface& surface, Domain& d) {
  if (!surface.IsUPeriodic()) {
    d.u0 = std::max(d.u0, surface.FirstUParameter());
    d.u1 = std::min(d.u1, surface.LastUParameter());
  }
  if (!surface.IsVPeriodic()) {
    d.v0 = std::max(d.v0, surface.FirstVParameter());
    d.v1 = std::min(d.v1, surface.LastVParameter());
  }
}

template <class Axes>
void PutAxes(const Axes& axes, json& patch) {
  patch["origin"] = Numbers(axes.Location());
  patch["axis"] = Numbers(axes.Direction());
  patch["x"] = Numbers(axes.XDirection());
  patch["y"] = Numbers(axes.YDirection());
}

void AddPatches(const TopoDS_Face& face, int number, double step_mm, json& patches) {
  const BRepAdaptor_Surface surface(face, false);  // the whole one
  const bool reversed = face.Orientation() == TopAbs_REVERSED;
  Domain d;
  BRepTools::UVBounds(face, d.u0, d.u1, d.v0, d.v1);
  ClampToSurface(surface, d);
  constexpr double kFar = 1e6;  // mm, and turns: a surface without bounds
  if (!(d.u1 > d.u0 && d.v1 > d.v0) || std::abs(d.u0) > kFar || std::abs(d.u1) > kFar ||
      std::abs(d.v0) > kFar || std::abs(d.v1) > kFar) {
    return;
  }
  json patch = {{"face", number}, {"kind", KindOf(surface.GetType())}};
  gp_Pnt p;
  const gp_Vec n = NormalAt(surface, reversed, (d.u0 + d.u1) / 2, (d.v0 + d.v1) / 2, p);
  gp_Pnt inside;  // the point of the axis, or of the spine, that (u, v) lies about
  switch (surface.GetType()) {
    case GeomAbs_Plane:
      return;
    case GeomAbs_Cylinder: {
      const gp_Cylinder c = surface.Cylinder();
      PutAxes(c.Position(), patch);
      patch["radius_mm"] = c.Radius();
      inside = c.Location().Translated(gp_Vec(c.Axis().Direction()) * ((d.v0 + d.v1) / 2));
      break;
    }
    case GeomAbs_Torus: {
      const gp_Torus t = surface.Torus();
      PutAxes(t.Position(), patch);
      patch["radius_mm"] = t.MinorRadius();
      patch["bend_radius_mm"] = t.MajorRadius();
      const double u = (d.u0 + d.u1) / 2;
      inside = t.Location().Translated(gp_Vec(t.XAxis().Direction()) * t.MajorRadius() * cos(u) +
                                       gp_Vec(t.YAxis().Direction()) * t.MajorRadius() * sin(u));
      break;
    }
    default:
      AddFreePatches(face, surface, d, patch, step_mm, patches);
      return;
  }
  patch["u"] = {d.u0, d.u1};
  patch["v"] = {d.v0, d.v1};
  patch["concave"] = n.Dot(gp_Vec(inside, p)) < 0;
  patches.push_back(std::move(patch));
}

json Polyline(const BRepAdaptor_Curve& curve, double from, double to, double step_mm = 0) {
  const auto at = [&](double parameter) { return curve.Value(parameter); };
  const int steps =
      StepsAlong(step_mm, curve.GetType() == GeomAbs_Line ? 1 : kEdgeSteps, from, to, at);
  json points = json::array();
  for (int i = 0; i <= steps; ++i) {
    points.push_back(Numbers(at(from + (to - from) * i / steps)));
  }
  return points;
}

bool IsUsable(const BRepAdaptor_Curve& curve) {
  return std::abs(curve.FirstParameter()) < 1e6 && std::abs(curve.LastParameter()) < 1e6;
}

void AddEdges(const TopoDS_Face& face, int number, TopTools_IndexedMapOfShape& known, json& edges) {
  for (TopExp_Explorer at(face, TopAbs_EDGE); at.More(); at.Next()) {
    const TopoDS_Edge edge = TopoDS::Edge(at.Current());
    if (BRep_Tool::Degenerated(edge)) {  // a pole, an apex
      const TopoDS_Vertex vertex = TopExp::FirstVertex(edge);
      if (vertex.IsNull()) continue;
      edges.push_back({{"face", number},
                       {"edge", known.Add(edge)},
                       {"points", json::array({Numbers(BRep_Tool::Pnt(vertex))})}});
      continue;
    }
    if (BRep_Tool::IsClosed(edge, face)) continue;  // seams
    const BRepAdaptor_Curve curve(edge);
    if (!IsUsable(curve)) continue;
    edges.push_back({{"face", number},
                     {"edge", known.Add(edge)},
                     {"points", Polyline(curve, curve.FirstParameter(), curve.LastParameter())}});
  }
}

// A free edge, in pieces between places where its curvature may jump.
void AddCurves(const TopoDS_Edge& edge, double step_mm, json& curves) {
  if (BRep_Tool::Degenerated(edge)) return;
  const BRepAdaptor_Curve curve(edge);
  if (!IsUsable(curve)) return;
  const int n = curve.NbIntervals(GeomAbs_C2);
  std::vector<double> cuts{curve.FirstParameter(), curve.LastParameter()};
  if (n <= kMostPieces) {
    TColStd_Array1OfReal all(1, n + 1);
    curve.Intervals(all, GeomAbs_C2);
    cuts = Within(all, cuts.front(), cuts.back());
  }
  for (std::size_t i = 0; i + 1 < cuts.size(); ++i) {
    curves.push_back({{"points", Polyline(curve, cuts[i], cuts[i + 1], step_mm)}});
  }
}

// What a shape is called, and where it is in its assembly.
struct Names {
  std::string own, occurrence, assembly;
};

class Collector {
 public:
  Collector(double step_mm, bool has_other_bytes)
      : step_mm_(step_mm), has_other_bytes_(has_other_bytes) {}

  void Add(const TopoDS_Shape& shape, const Names& names) {
    if (bodies_.size() > kMostBodies) {
      throw std::runtime_error("holds more than " + std::to_string(kMostBodies) +
                               " bodies; export the tube alone");
    }
    for (TopExp_Explorer at(shape, TopAbs_SOLID); at.More(); at.Next()) {
      AddBody(at.Current(), names, "solid");
    }
    TopoDS_Compound rest;
    BRep_Builder builder;
    builder.MakeCompound(rest);
    bool any = false;
    for (TopExp_Explorer at(shape, TopAbs_FACE, TopAbs_SOLID); at.More(); at.Next()) {
      builder.Add(rest, at.Current());
      any = true;
    }
    if (any) AddBody(rest, names, "surface");
    json curves = json::array();
    TopTools_MapOfShape seen;
    for (TopExp_Explorer at(shape, TopAbs_EDGE, TopAbs_FACE); at.More(); at.Next()) {
      if (seen.Add(at.Current())) AddCurves(TopoDS::Edge(at.Current()), step_mm_, curves);
    }
    if (!curves.empty()) {
      bodies_.push_back({{"kind", "wire"}, {"curves", std::move(curves)}});
      PutNames(names);
    }
  }

  // In which names may be written that OpenCASCADE does not know.
  bool has_other_bytes() const { return has_other_bytes_; }
  bool is_empty() const { return bodies_.empty(); }
  int faces() const { return faces_; }
  json Take() { return std::move(bodies_); }

 private:
  void PutNames(const Names& names) {
    json& body = bodies_.back();
    body["name"] = names.own;
    body["occurrence"] = names.occurrence;
    body["assembly"] = names.assembly;
  }

  void AddBody(const TopoDS_Shape& shape, const Names& names, const char* kind) {
    json patches = json::array(), edges = json::array();
    TopTools_IndexedMapOfShape known;
    int number = 0;
    for (TopExp_Explorer at(shape, TopAbs_FACE); at.More(); at.Next()) {
      const TopoDS_Face face = TopoDS::Face(at.Current());
      AddPatches(face, ++number, step_mm_, patches);
      AddEdges(face, number, known, edges);
    }
    faces_ += number;
    bodies_.push_back({{"kind", kind},
                       {"faces", number},
                       {"patches", std::move(patches)},
                       {"edges", std::move(edges)}});
    PutNames(names);
  }

  double step_mm_;
  bool has_other_bytes_;
  int faces_ = 0;
  json bodies_ = json::array();
};

// A placement may mirror or scale, which OpenCASCADE takes in the geometry only.
TopoDS_Shape Placed(const TopoDS_Shape& shape, const gp_Trsf& placement) {
  if (std::abs(placement.ScaleFactor() - 1) > 1e-9 || placement.IsNegative()) {
    return BRepBuilderAPI_Transform(shape, placement, true).Shape();
  }
  return shape.Moved(TopLoc_Location(placement));
}

// What OpenCASCADE calls the shapes of a product that has several, as a solid and a quilt.
bool IsKindOfShape(const std::string& name) {
  static const std::set<std::string> kKinds{"COMPOUND", "COMPSOLID", "SOLID", "SHELL",
                                            "FACE",     "WIRE",      "EDGE",  "VERTEX"};
  return kKinds.contains(name);
}

void Walk(const TDF_Label& label, const gp_Trsf& outer, const std::string& given, int depth,
          Collector& collector) {
  if (depth > 64) throw std::runtime_error("an assembly that holds itself");
  TDF_Label what = label;
  gp_Trsf here = outer;
  if (XCAFDoc_ShapeTool::IsReference(label)) {
    XCAFDoc_ShapeTool::GetReferredShape(label, what);
    here = outer * XCAFDoc_ShapeTool::GetLocation(label).Transformation();
  }
  std::string name = NameOf(what, collector.has_other_bytes());
  if (name.empty()) name = NameOf(label, collector.has_other_bytes());
  if (IsKindOfShape(name)) name = given.empty() ? name : given;
  if (name.empty()) name = given;
  if (XCAFDoc_ShapeTool::IsAssembly(what)) {
    TDF_LabelSequence parts;
    XCAFDoc_ShapeTool::GetComponents(what, parts);
    for (int i = 1; i <= parts.Length(); ++i) Walk(parts(i), here, name, depth + 1, collector);
    return;
  }
  const TopoDS_Shape shape = XCAFDoc_ShapeTool::GetShape(what);
  std::string occurrence = NameOf(label, collector.has_other_bytes());
  // What has no name is called by a number of the file, or by OpenCASCADE's own label.
  if (occurrence == name || IsKindOfShape(occurrence) || occurrence.starts_with("=>") ||
      occurrence.find_first_not_of("0123456789") == std::string::npos) {
    occurrence.clear();
  }
  if (!shape.IsNull()) collector.Add(Placed(shape, here), {name, occurrence, given});
}

void CheckStatus(IFSelect_ReturnStatus status) {
  if (status == IFSelect_RetDone) return;
  throw std::runtime_error(status == IFSelect_RetVoid
                               ? "holds no entities"
                               : "is damaged, or no such file: its entities cannot be read");
}

// The solids, surfaces and curves of a file that leads to them by no product, as small programs
// write it.
void AddWithoutProducts(STEPControl_Reader& reader, Collector& collector) {
  const Handle(Interface_InterfaceModel) model = reader.Model();
  reader.ClearShapes();
  for (int i = 1; i <= model->NbEntities(); ++i) {
    const Handle(Standard_Transient) entity = model->Value(i);
    if (entity->IsKind(STANDARD_TYPE(StepShape_SolidModel)) ||
        entity->IsKind(STANDARD_TYPE(StepShape_ShellBasedSurfaceModel)) ||
        entity->IsKind(STANDARD_TYPE(StepShape_GeometricSet))) {
      reader.TransferEntity(entity);
    }
  }
  for (int i = 1; i <= reader.NbShapes(); ++i) collector.Add(reader.Shape(i), {});
}

// Part 21's last line, which some programs leave out, and others write into a broken file.
constexpr std::string_view kLastLine = "END-ISO-10303-21";

// Whether the file ends with its data, and only the last line is missing.
bool LacksLastLine(std::istream& in) {
  constexpr std::streamoff kTail = 4096;
  in.seekg(0, std::ios::end);
  const std::streamoff size = in.tellg(), from = std::max(std::streamoff{0}, size - kTail);
  std::string tail(std::size_t(size - from), ' ');
  in.seekg(from);
  in.read(tail.data(), std::streamsize(tail.size()));
  in.clear();
  in.seekg(0);
  const std::size_t end = tail.rfind("ENDSEC");
  return end != std::string::npos && tail.find(kLastLine, end) == std::string::npos &&
         tail.find('=', end) == std::string::npos;
}

// Editors put UTF-8's mark before a text, which part 21 does not know.
void SkipMark(std::istream& in) {
  char mark[3] = {};
  in.read(mark, sizeof mark);
  if (in.gcount() == 3 && std::string(mark, 3) == "\xef\xbb\xbf") return;
  in.clear();
  in.seekg(0);
}

IFSelect_ReturnStatus ReadText(const std::string& file, STEPControl_Reader& reader) {
  std::ifstream in(file, std::ios::binary);
  const bool lacks_end = LacksLastLine(in);
  SkipMark(in);
  if (!lacks_end) return reader.ReadStream(file.c_str(), in);
  std::stringstream whole;
  whole << in.rdbuf() << "\n" << kLastLine << ";\n";
  return reader.ReadStream(file.c_str(), whole);
}

// Of all shells, those that a shell names and the file lacks, too.
int FacesIn(const Interface_InterfaceModel& model) {
  int faces = 0;
  for (int i = 1; i <= model.NbEntities(); ++i) {
    const Handle(Standard_Transient) entity = model.Value(i);
    // These name another shell, which is counted itself.
    if (entity->IsKind(STANDARD_TYPE(StepShape_OrientedClosedShell)) ||
        entity->IsKind(STANDARD_TYPE(StepShape_OrientedOpenShell))) {
      continue;
    }
    const auto shell = Handle(StepShape_ConnectedFaceSet)::DownCast(entity);
    if (!shell.IsNull()) faces += shell->NbCfsFaces();
  }
  return faces;
}

// How many faces the file has.
int ReadStep(const std::string& file, Collector& collector) {
  Handle(TDocStd_Document) document = new TDocStd_Document("BinXCAF");
  STEPCAFControl_Reader reader;
  reader.SetNameMode(true);
  reader.SetColorMode(false);
  reader.SetLayerMode(false);
  CheckStatus(ReadText(file, reader.ChangeReader()));
  const std::string placement = PlacementNotTaken(reader.ChangeReader().StepModel());
  if (!placement.empty()) {
    throw std::runtime_error("places a part by an operator (" + placement +
                             " it) that OpenCASCADE leaves out: mirror or scale the part itself in "
                             "CAD, or export it alone");
  }
  const bool has_products = reader.NbRootsForTransfer() > 0 && reader.Transfer(document);
  const Handle(XCAFDoc_ShapeTool) shapes = XCAFDoc_DocumentTool::ShapeTool(document->Main());
  TDF_LabelSequence roots;
  shapes->GetFreeShapes(roots);
  if (has_products && !roots.IsEmpty()) {
    for (int i = 1; i <= roots.Length(); ++i) Walk(roots(i), gp_Trsf(), "", 0, collector);
  }
  const int faces = FacesIn(*reader.ChangeReader().Model());
  try {
    if (collector.is_empty()) AddWithoutProducts(reader.ChangeReader(), collector);
  } catch (const Standard_Failure&) {
    // Of a damaged product, which it has tried before, it says so.
  }
  if (collector.is_empty()) {
    throw std::runtime_error(faces == 0
                                 ? std::string("holds no shape that can be built")
                                 : "is damaged: none of its " + std::to_string(faces) +
                                       " faces can be built, since entities are missing or wrong");
  }
  return faces;
}

void ReadIges(const std::string& file, Collector& collector) {
  IGESControl_Reader reader;
  CheckStatus(reader.ReadFile(file.c_str()));
  reader.TransferRoots();
  if (reader.NbShapes() == 0) throw std::runtime_error("none of its shapes can be built");
  collector.Add(reader.OneShape(), {});
}

bool IsIges(const std::string& file) {
  // Column 73 of an IGES line names its section: S, the start, comes first.
  std::ifstream in(file, std::ios::binary);
  std::string line;
  std::getline(in, line);
  return line.size() >= 73 && (line[72] == 'S' || line[72] == 'C');
}

}  // namespace

json ReadShape(const std::string& file, double step_mm) {
  const bool iges = IsIges(file);
  Collector collector(step_mm, !iges && HasOtherBytes(file));
  int faces = 0;
  if (iges) {
    ReadIges(file, collector);
  } else {
    faces = ReadStep(file, collector);
  }
  // A part that is placed several times is built as often, which may hide what is lost.
  const int lost = std::max(0, faces - collector.faces());
  return {{"schema", "bendloop.cad-shape/1"},
          {"format", iges ? "IGES" : "STEP"},
          {"lost_faces", lost},
          {"bodies", collector.Take()}};
}

}  // namespace bendloop::cad
