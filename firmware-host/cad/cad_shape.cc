// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cad/cad_shape.h"

#include <nlohmann/json.hpp>
#include <utility>

namespace bendloop::host {
namespace {

using AnswerJson = nlohmann::json;  // keys in any order

Eigen::Vector3d Vector(const AnswerJson& j, std::size_t first = 0) {
  return {j.at(first).get<double>(), j.at(first + 1).get<double>(), j.at(first + 2).get<double>()};
}

std::vector<Eigen::Vector3d> Vectors(const AnswerJson& j) {
  std::vector<Eigen::Vector3d> points;
  points.reserve(j.size());
  for (const AnswerJson& p : j) points.push_back(Vector(p));
  return points;
}

SurfacePatch PatchOf(const AnswerJson& j) {
  SurfacePatch patch;
  patch.face = j.at("face").get<int>();
  patch.name = j.at("kind").get<std::string>();
  if (j.contains("samples")) {
    for (const AnswerJson& s : j.at("samples")) {
      patch.samples.push_back({Vector(s), Vector(s, 3), s.size() < 7});
    }
    patch.cell_u = j.at("cell").at(0).get<int>();
    patch.cell_v = j.at("cell").at(1).get<int>();
    return patch;
  }
  patch.kind = patch.name == "torus" ? PatchKind::kTorus : PatchKind::kCylinder;
  patch.origin = Vector(j.at("origin"));
  patch.axis = Vector(j.at("axis"));
  patch.x = Vector(j.at("x"));
  patch.y = Vector(j.at("y"));
  patch.radius_mm = j.at("radius_mm").get<double>();
  if (patch.kind == PatchKind::kTorus) patch.bend_radius_mm = j.at("bend_radius_mm").get<double>();
  patch.u0 = j.at("u").at(0).get<double>();
  patch.u1 = j.at("u").at(1).get<double>();
  patch.v0 = j.at("v").at(0).get<double>();
  patch.v1 = j.at("v").at(1).get<double>();
  patch.concave = j.at("concave").get<bool>();
  return patch;
}

CadBody BodyOf(const AnswerJson& j) {
  CadBody body;
  body.name = j.at("name").get<std::string>();
  body.occurrence = j.value("occurrence", std::string());
  body.assembly = j.value("assembly", std::string());
  const std::string kind = j.at("kind").get<std::string>();
  body.kind = kind == "solid"     ? BodyKind::kSolid
              : kind == "surface" ? BodyKind::kSurface
                                  : BodyKind::kWire;
  if (body.kind == BodyKind::kWire) {
    for (const AnswerJson& c : j.at("curves")) body.curves.push_back(Vectors(c.at("points")));
    return body;
  }
  body.faces = j.at("faces").get<int>();
  for (const AnswerJson& p : j.at("patches")) body.patches.push_back(PatchOf(p));
  for (const AnswerJson& e : j.at("edges")) {
    body.edges.push_back(
        {e.at("face").get<int>(), e.at("edge").get<int>(), Vectors(e.at("points"))});
  }
  return body;
}

}  // namespace

hal::Result<CadShape> ReadCadShape(std::string_view text, std::string_view file) {
  try {
    const AnswerJson root = AnswerJson::parse(text);
    if (root.contains("error")) {
      std::string message = std::string(file) + ": " + root.at("error").get<std::string>();
      if (root.contains("said")) message += " (" + root.at("said").get<std::string>() + ")";
      return hal::Fail(hal::ErrorKind::kBadInput,
                       message + "; expected STEP (AP203, AP214, AP242) or IGES");
    }
    CadShape shape;
    shape.format = root.at("format").get<std::string>();
    shape.lost_faces = root.value("lost_faces", 0);
    for (const AnswerJson& body : root.at("bodies")) shape.bodies.push_back(BodyOf(body));
    return shape;
  } catch (const AnswerJson::exception& error) {
    return hal::Fail(hal::ErrorKind::kInternal,
                     std::string(file) + ": bendloop-cad's answer is none: " + error.what());
  }
}

}  // namespace bendloop::host
