// SPDX-License-Identifier: Apache-2.0
#include "step_text.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <utility>
#include <vector>

#include "firmware-host/cad/tube_chain.h"

namespace bendloop::test {
namespace {

using Eigen::Vector3d;

// One straight or bend of the tube, with the frames at its two ends.
struct Segment {
  bool is_arc = false;
  Vector3d from, to, tangent_in, tangent_out;
  Vector3d side_in, side_out;  // across the tangent; where faces begin
  Vector3d centre, normal;     // of an arc
  double bend_radius_mm = 0, angle_rad = 0;
};

std::vector<Segment> SegmentsOf(const hal::Tube& tube) {
  const host::Spine spine = host::SpineOf(tube);
  std::vector<Segment> segments;
  Vector3d at = spine.start, along = spine.direction;
  // Not in any bend's plane, so that faces meet at no special place.
  Vector3d side =
      Eigen::AngleAxisd(0.4, along) *
      (spine.arcs.empty() ? Vector3d(along.unitOrthogonal()) : spine.arcs.front().normal);
  const auto straight = [&](const Vector3d& to) {
    if ((to - at).norm() > 1e-6)
      segments.push_back({false, at, to, along, along, side, side, at, along});
    at = to;
  };
  for (const host::SpineArc& arc : spine.arcs) {
    straight(arc.from);
    Segment s{true, arc.from,   arc.to,     arc.tangent_in,     arc.tangent_out, side,
              side, arc.centre, arc.normal, arc.bend_radius_mm, arc.angle_rad};
    s.side_out = side = Eigen::AngleAxisd(arc.angle_rad, arc.normal) * side;
    segments.push_back(s);
    at = arc.to;
    along = arc.tangent_out;
  }
  straight(spine.end);
  return segments;
}

// The last straight moved as `off` says.
void MoveLast(const OffJoint& off, std::vector<Segment>& segments) {
  if (off.beside_mm == 0 && off.askew_deg == 0) return;
  Segment moved = segments.back();
  const double length_mm = (moved.to - moved.from).norm() / (off.within_straight ? 2 : 1);
  moved.from = moved.to - length_mm * moved.tangent_out;
  if (off.within_straight) {
    segments.back().to = moved.from;
  } else {
    segments.pop_back();
  }
  // Beside it one way and askew the other.
  const Eigen::AngleAxisd turn(off.askew_deg * M_PI / 180, moved.side_in);
  moved.from += off.beside_mm * moved.side_in;
  moved.tangent_in = moved.tangent_out = turn * moved.tangent_in;
  moved.to = moved.from + length_mm * moved.tangent_in;
  segments.push_back(moved);
}

// A B-spline curve's knots and poles, as of a circle or a line; poles may have weights.
struct Profile {
  int degree = 1;
  std::vector<double> knots;
  std::vector<int> multiplicities;
  std::vector<Eigen::Vector3d> poles;  // x, y, weight; the circle's radius is 1
};

// The circle of radius 1 from angle 0 to `angle`.
Profile Arc(double angle, bool rational, double span_deg) {
  const double widest = rational ? M_PI / 2 : span_deg * M_PI / 180;
  const int spans = std::max(1, int(std::ceil(angle / widest - 1e-9)));
  const double step = angle / spans;
  Profile profile;
  profile.degree = rational ? 2 : 3;
  const auto pole = [&](double x, double y, double w) { profile.poles.emplace_back(x, y, w); };
  pole(1, 0, 1);
  for (int i = 0; i < spans; ++i) {
    const double a = step * i, b = a + step;
    if (rational) {
      const double w = std::cos(step / 2);
      pole(std::cos(a + step / 2) / w, std::sin(a + step / 2) / w, w);
    } else {
      const double k = 4.0 / 3 * std::tan(step / 4);
      pole(std::cos(a) - k * std::sin(a), std::sin(a) + k * std::cos(a), 1);
      pole(std::cos(b) + k * std::sin(b), std::sin(b) - k * std::cos(b), 1);
    }
    pole(std::cos(b), std::sin(b), 1);
  }
  for (int i = 0; i <= spans; ++i) {
    profile.knots.push_back(i);
    profile.multiplicities.push_back(i == 0 || i == spans ? profile.degree + 1 : profile.degree);
  }
  return profile;
}

// A line from 0 to 1 in the same degree, as where it joins arcs in one surface.
Profile Line(int degree) {
  Profile profile;
  profile.degree = degree;
  profile.knots = {0, 1};
  profile.multiplicities = {degree + 1, degree + 1};
  for (int i = 0; i <= degree; ++i) profile.poles.emplace_back(double(i) / degree, 0, 1);
  return profile;
}

class Writer {
 public:
  Writer(const hal::Tube& tube, const StepStyle& style)
      : style_(style), radius_mm_(tube.pipe_radius_mm), segments_(SegmentsOf(tube)) {
    MoveLast(style.off, segments_);
  }

  std::string Text() {
    const int context = Context();
    std::vector<int> faces;
    AddPipe(radius_mm_, false, faces);
    if (style_.wall_mm > 0 && style_.body != BodyStyle::kOpenShell) {
      AddPipe(radius_mm_ - style_.wall_mm, true, faces);
    }
    if (style_.body == BodyStyle::kSolid) {
      AddCap(0, faces);
      AddCap(segments_.size(), faces);
    }
    const bool solid = style_.body == BodyStyle::kSolid;
    const int shell = Add((solid ? "CLOSED_SHELL('',(" : "OPEN_SHELL('',(") + List(faces) + "))");
    const int body =
        solid ? Add("MANIFOLD_SOLID_BREP('" + style_.name + "'," + Ref(shell) + ")")
              : Add("SHELL_BASED_SURFACE_MODEL('" + style_.name + "',(" + Ref(shell) + "))");
    AddProduct(body, context, solid);
    return Header() + data_ + "ENDSEC;\nEND-ISO-10303-21;\n";
  }

 private:
  static std::string Ref(int id) { return "#" + std::to_string(id); }
  static std::string List(const std::vector<int>& ids) {
    std::string text;
    for (const int id : ids) text += (text.empty() ? "" : ",") + Ref(id);
    return text;
  }

  int Add(const std::string& entity) {
    data_ += Ref(++last_) + "=" + entity + ";\n";
    return last_;
  }

  std::string Real(double value) const {
    char text[40];
    std::snprintf(text, sizeof text, "%.*G", style_.digits, value);
    std::string real = text;
    const std::size_t e = real.find('E');
    if (real.find('.') == std::string::npos)
      real.insert(e == std::string::npos ? real.size() : e, ".");
    return real;
  }
  std::string Length(double mm) const { return Real(mm / style_.unit_mm); }

  int Point(const Vector3d& p) {
    return Add("CARTESIAN_POINT('',(" + Length(p.x()) + "," + Length(p.y()) + "," + Length(p.z()) +
               "))");
  }
  int Direction(const Vector3d& d) {
    return Add("DIRECTION('',(" + Real(d.x()) + "," + Real(d.y()) + "," + Real(d.z()) + "))");
  }
  int Axes(const Vector3d& at, const Vector3d& z, const Vector3d& x) {
    const int p = Point(at), a = Direction(z), b = Direction(x);
    return Add("AXIS2_PLACEMENT_3D(''," + Ref(p) + "," + Ref(a) + "," + Ref(b) + ")");
  }
  int Vertex(const Vector3d& p) {
    const int point = Point(p);
    return Add("VERTEX_POINT(''," + Ref(point) + ")");
  }
  int Edge(int from, int to, int curve) {
    return Add("EDGE_CURVE(''," + Ref(from) + "," + Ref(to) + "," + Ref(curve) + ",.T.)");
  }
  int Oriented(int edge, bool forward) {
    return Add("ORIENTED_EDGE('',*,*," + Ref(edge) + (forward ? ",.T.)" : ",.F.)"));
  }
  int Circle(const Vector3d& at, const Vector3d& axis, const Vector3d& x, double radius) {
    const int axes = Axes(at, axis, x);
    return Add("CIRCLE(''," + Ref(axes) + "," + Length(radius) + ")");
  }

  int Parts() const {
    return style_.faces == FaceStyle::kHalves ? 2 : style_.faces == FaceStyle::kQuarters ? 4 : 1;
  }

  // Where the faces of joint `k` (before segment k) meet, and the arcs between these places.
  struct Ring {
    Vector3d at, tangent, side;
    std::vector<int> vertices, edges;
  };

  Ring RingAt(std::size_t k, double radius) {
    const bool last = k == segments_.size();
    const Segment& s = segments_[last ? k - 1 : k];
    Ring ring{last ? s.to : s.from,
              last ? s.tangent_out : s.tangent_in,
              last ? s.side_out : s.side_in,
              {},
              {}};
    if (k > 0 && !last && style_.lean_deg != 0) {
      const Vector3d about = s.is_arc ? s.normal : ring.side;
      const Eigen::AngleAxisd lean(style_.lean_deg * M_PI / 180, about);
      ring.tangent = lean * ring.tangent;
      ring.side = lean * ring.side;
    }
    const int parts = Parts();
    for (int i = 0; i < parts; ++i)
      ring.vertices.push_back(Vertex(ring.at + radius * SideOf(ring, i)));
    for (int i = 0; i < parts; ++i) {
      const int circle = Circle(ring.at, ring.tangent, ring.side, radius);
      ring.edges.push_back(
          Edge(ring.vertices[std::size_t(i)], ring.vertices[std::size_t((i + 1) % parts)], circle));
    }
    return ring;
  }

  Vector3d SideOf(const Ring& ring, int part) const {
    return Eigen::AngleAxisd(2 * M_PI * part / Parts(), ring.tangent) * ring.side;
  }

  // Rings that faces and caps have in common; loose faces have each their own.
  const Ring& SharedRing(std::size_t k, double radius) {
    const auto key = std::make_pair(k, radius);
    const auto found = rings_.find(key);
    return found != rings_.end() ? found->second
                                 : rings_.emplace(key, RingAt(k, radius)).first->second;
  }

  int Along(const Segment& s, const Ring& a, const Ring& b, int part, double radius) {
    const Vector3d from = a.at + radius * SideOf(a, part);
    int curve = 0;
    if (s.is_arc) {
      const Vector3d centre = s.centre + (from - s.centre).dot(s.normal) * s.normal;
      curve = Circle(centre, s.normal, (from - centre).normalized(), (from - centre).norm());
    } else {
      const int p = Point(from), d = Direction(s.tangent_in);
      const int v = Add("VECTOR(''," + Ref(d) + "," + Length(1) + ")");
      curve = Add("LINE(''," + Ref(p) + "," + Ref(v) + ")");
    }
    return Edge(a.vertices[std::size_t(part)], b.vertices[std::size_t(part)], curve);
  }

  int Surface(const Segment& s, double radius) {
    if (style_.surfaces != SurfaceStyle::kAnalytic) return Spline({s}, radius);
    if (s.is_arc) {
      const int axes = Axes(s.centre, s.normal, (s.from - s.centre).normalized());
      return Add("TOROIDAL_SURFACE(''," + Ref(axes) + "," + Length(s.bend_radius_mm) + "," +
                 Length(radius) + ")");
    }
    const int axes = Axes(s.from, s.tangent_in, s.side_in);
    return Add("CYLINDRICAL_SURFACE(''," + Ref(axes) + "," + Length(radius) + ")");
  }

  // A B-spline around and along one or more pieces.
  int Spline(const std::vector<Segment>& pieces, double radius) {
    const bool rational = style_.surfaces == SurfaceStyle::kRational;
    const Profile around = Arc(2 * M_PI, rational, style_.span_deg);
    std::vector<std::vector<Vector3d>> rows;  // by pole along
    std::vector<double> knots;
    std::vector<int> multiplicities;
    std::vector<std::vector<double>> weights;
    int degree = 1;
    const bool mixed = pieces.size() > 1;
    for (const Segment& s : pieces) {
      const Profile along = s.is_arc ? Arc(s.angle_rad, rational, style_.span_deg)
                                     : Line(mixed ? (rational ? 2 : 3) : 1);
      degree = along.degree;
      const double before = knots.empty() ? 0 : knots.back();
      for (std::size_t i = 0; i < along.knots.size(); ++i) {
        if (i == 0 && !knots.empty()) {
          multiplicities.back() = degree;
          continue;
        }
        knots.push_back(before + along.knots[i]);
        multiplicities.push_back(along.multiplicities[i]);
      }
      for (std::size_t i = 0; i < along.poles.size(); ++i) {
        if (i == 0 && !rows.empty()) continue;
        std::vector<Vector3d> row;
        std::vector<double> row_weights;
        for (const Vector3d& c : around.poles) {
          row.push_back(PoleOf(s, along.poles[i], c, radius));
          row_weights.push_back(c.z() * along.poles[i].z());
        }
        rows.push_back(std::move(row));
        weights.push_back(std::move(row_weights));
      }
    }
    return AddSpline(around, degree, knots, multiplicities, rows, weights);
  }

  // The product of a pole around and one along.
  static Vector3d PoleOf(const Segment& s, const Vector3d& along, const Vector3d& around,
                         double radius) {
    const Vector3d up = s.tangent_in.cross(s.side_in);
    const Vector3d offset = radius * (around.x() * s.side_in + around.y() * up);
    if (!s.is_arc) return s.from + along.x() * (s.to - s.from) + offset;
    // Of a torus: the pole around, at the pole along of its own circle about the axis.
    const Vector3d p = s.from + offset;
    const Vector3d centre = s.centre + (p - s.centre).dot(s.normal) * s.normal;
    const Vector3d x = p - centre, y = s.normal.cross(x);
    return centre + along.x() * x + along.y() * y;
  }

  int AddSpline(const Profile& around, int degree, const std::vector<double>& knots,
                const std::vector<int>& multiplicities,
                const std::vector<std::vector<Vector3d>>& rows,
                const std::vector<std::vector<double>>& weights) {
    std::string poles, all_weights;
    for (std::size_t j = 0; j < around.poles.size(); ++j) {
      std::vector<int> ids;
      std::string row;
      for (std::size_t i = 0; i < rows.size(); ++i) {
        ids.push_back(Point(rows[i][j]));
        row += (row.empty() ? "" : ",") + Real(weights[i][j]);
      }
      poles += (poles.empty() ? "(" : ",(") + List(ids) + ")";
      all_weights += (all_weights.empty() ? "(" : ",(") + row + ")";
    }
    const auto numbers = [&](const auto& values, const auto& text) {
      std::string all;
      for (const auto& v : values) all += (all.empty() ? "" : ",") + text(v);
      return "(" + all + ")";
    };
    const auto real = [&](double v) { return Real(v); };
    const auto whole = [](int v) { return std::to_string(v); };
    const std::string net = std::to_string(around.degree) + "," + std::to_string(degree) + ",(" +
                            poles + "),.UNSPECIFIED.,.T.,.F.,.U.";
    const std::string marks = numbers(around.multiplicities, whole) + "," +
                              numbers(multiplicities, whole) + "," + numbers(around.knots, real) +
                              "," + numbers(knots, real) + ",.UNSPECIFIED.";
    if (style_.surfaces == SurfaceStyle::kPolynomial) {
      return Add("B_SPLINE_SURFACE_WITH_KNOTS(''," + net + "," + marks + ")");
    }
    return Add("(BOUNDED_SURFACE()B_SPLINE_SURFACE(" + net + ")B_SPLINE_SURFACE_WITH_KNOTS(" +
               marks + ")GEOMETRIC_REPRESENTATION_ITEM()RATIONAL_B_SPLINE_SURFACE((" + all_weights +
               "))REPRESENTATION_ITEM('')SURFACE())");
  }

  int Face(const std::vector<std::vector<int>>& loops, int surface, bool same_sense) {
    std::vector<int> bounds;
    for (const auto& loop : loops) {
      const int id = Add("EDGE_LOOP('',(" + List(loop) + "))");
      const bool outer = bounds.empty() && loops.size() == 1;
      bounds.push_back(
          Add((outer ? "FACE_OUTER_BOUND(''," : "FACE_BOUND('',") + Ref(id) + ",.T.)"));
    }
    return Add("ADVANCED_FACE('',(" + List(bounds) + ")," + Ref(surface) +
               (same_sense ? ",.T.)" : ",.F.)"));
  }

  void AddPipe(double radius, bool inner, std::vector<int>& faces) {
    if (style_.one_face) {
      AddFaces(segments_, 0, segments_.size(), radius, inner, faces);
      return;
    }
    for (std::size_t i = 0; i < segments_.size(); ++i) {
      AddFaces({segments_[i]}, i, i + 1, radius, inner, faces);
    }
  }

  void AddFaces(const std::vector<Segment>& pieces, std::size_t from, std::size_t to, double radius,
                bool inner, std::vector<int>& faces) {
    const bool loose = style_.body == BodyStyle::kLoose;
    const Segment& s = pieces.front();
    const Ring a = loose ? RingAt(from, radius) : SharedRing(from, radius);
    const Ring b = loose ? RingAt(to, radius) : SharedRing(to, radius);
    const int surface = pieces.size() > 1 ? Spline(pieces, radius) : Surface(s, radius);
    const bool outward = !inner;
    if (style_.faces == FaceStyle::kNoSeam) {
      const int lower = Oriented(a.edges[0], outward), upper = Oriented(b.edges[0], !outward);
      faces.push_back(Face({{lower}, {upper}}, surface, outward));
      return;
    }
    const int parts = Parts();
    std::vector<int> sides;
    for (int i = 0; i < parts; ++i) sides.push_back(Along(s, a, b, i, radius));
    for (int i = 0; i < parts; ++i) {
      const int next = (i + 1) % parts;
      std::vector<int> loop{
          Oriented(a.edges[std::size_t(i)], true), Oriented(sides[std::size_t(next)], true),
          Oriented(b.edges[std::size_t(i)], false), Oriented(sides[std::size_t(i)], false)};
      if (inner) loop = Turned(a, b, sides, i, next);
      faces.push_back(Face({loop}, surface, outward));
    }
  }

  std::vector<int> Turned(const Ring& a, const Ring& b, const std::vector<int>& sides, int i,
                          int next) {
    return {Oriented(sides[std::size_t(i)], true), Oriented(b.edges[std::size_t(i)], true),
            Oriented(sides[std::size_t(next)], false), Oriented(a.edges[std::size_t(i)], false)};
  }

  void AddCap(std::size_t k, std::vector<int>& faces) {
    const Ring outer = SharedRing(k, radius_mm_);
    const bool last = k > 0;
    const int axes = Axes(outer.at, last ? outer.tangent : Vector3d(-outer.tangent), outer.side);
    const int plane = Add("PLANE(''," + Ref(axes) + ")");
    const auto loop = [&](const Ring& ring, bool forward) {
      std::vector<int> ids;
      for (const int edge : ring.edges) ids.push_back(Oriented(edge, forward));
      if (!forward) std::reverse(ids.begin(), ids.end());
      return ids;
    };
    std::vector<std::vector<int>> loops{loop(outer, last)};
    if (style_.wall_mm > 0)
      loops.push_back(loop(SharedRing(k, radius_mm_ - style_.wall_mm), !last));
    faces.push_back(Face(loops, plane, true));
  }

  int Context() {
    const int length = Add(
        style_.unit.empty() ? "(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT(.MILLI.,.METRE.))" : style_.unit);
    const int angle = Add("(NAMED_UNIT(*)PLANE_ANGLE_UNIT()SI_UNIT($,.RADIAN.))");
    const int solid = Add("(NAMED_UNIT(*)SI_UNIT($,.STERADIAN.)SOLID_ANGLE_UNIT())");
    const int off = Add("UNCERTAINTY_MEASURE_WITH_UNIT(LENGTH_MEASURE(1.E-3)," + Ref(length) +
                        ",'distance_accuracy_value','')");
    return Add("(GEOMETRIC_REPRESENTATION_CONTEXT(3)GLOBAL_UNCERTAINTY_ASSIGNED_CONTEXT((" +
               Ref(off) + "))GLOBAL_UNIT_ASSIGNED_CONTEXT((" + List({length, angle, solid}) +
               "))REPRESENTATION_CONTEXT('',''))");
  }

  void AddProduct(int body, int context, bool solid) {
    const int world = Axes({0, 0, 0}, {0, 0, 1}, {1, 0, 0});
    const int application = Add("APPLICATION_CONTEXT('automotive design')");
    const int product_context = Add("PRODUCT_CONTEXT(''," + Ref(application) + ",'mechanical')");
    const int product = Add("PRODUCT('" + style_.name + "','" + style_.name + "','',(" +
                            Ref(product_context) + "))");
    const int formation = Add("PRODUCT_DEFINITION_FORMATION('',''," + Ref(product) + ")");
    const int definition_context =
        Add("PRODUCT_DEFINITION_CONTEXT('part definition'," + Ref(application) + ",'design')");
    const int definition =
        Add("PRODUCT_DEFINITION('',''," + Ref(formation) + "," + Ref(definition_context) + ")");
    const int shape = Add("PRODUCT_DEFINITION_SHAPE('',''," + Ref(definition) + ")");
    const int representation =
        Add((solid ? "ADVANCED_BREP_SHAPE_REPRESENTATION('"
                   : "MANIFOLD_SURFACE_SHAPE_REPRESENTATION('") +
            style_.name + "',(" + List({body, world}) + ")," + Ref(context) + ")");
    Add("SHAPE_DEFINITION_REPRESENTATION(" + Ref(shape) + "," + Ref(representation) + ")");
  }

  static std::string Header() {
    return "ISO-10303-21;\nHEADER;\nFILE_DESCRIPTION((''),'2;1');\n"
           "FILE_NAME('','2024-01-01T00:00:00',(''),(''),'','','');\n"
           "FILE_SCHEMA(('AUTOMOTIVE_DESIGN { 1 0 10303 214 1 1 1 1 }'));\nENDSEC;\nDATA;\n";
  }

  StepStyle style_;
  double radius_mm_;
  std::vector<Segment> segments_;
  std::map<std::pair<std::size_t, double>, Ring> rings_;
  std::string data_;
  int last_ = 0;
};

}  // namespace

std::string StepText(const hal::Tube& tube, const StepStyle& style) {
  return Writer(tube, style).Text();
}

}  // namespace bendloop::test
