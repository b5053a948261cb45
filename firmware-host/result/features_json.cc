// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/result/program_json.h"
#include "firmware-host/result/sections.h"

namespace bendloop::host {
namespace {

constexpr std::size_t kMostOpenings = 1000;
constexpr std::size_t kMostBorderPlaces = 1000;

Json CutJson(const pipeline::EndCutFound& end) {
  Json json = {{"obliquity_deg", Number(end.cut.obliquity_deg)},
               {"obliquity_sigma_deg", Number(end.obliquity_sigma_deg)},
               {"around_deg", Number(end.cut.around_deg)},
               {"around_sigma_deg", Number(end.around_sigma_deg)}};
  if (end.bevel) {
    json["bevel"] = {{"length_mm", Number(end.bevel->length_mm)},
                     {"length_sigma_mm", Number(end.bevel->length_sigma_mm)},
                     {"depth_mm", Number(end.bevel->depth_mm)},
                     {"depth_sigma_mm", Number(end.bevel->depth_sigma_mm)},
                     {"angle_deg", Number(end.bevel->angle_deg)},
                     {"angle_sigma_deg", Number(end.bevel->angle_sigma_deg)}};
  }
  if (end.burr) {
    json["burr"] = {{"height_mm", Number(end.burr->height_mm)},
                    {"height_sigma_mm", Number(end.burr->sigma_mm)},
                    {"around_deg", Number(end.burr->around_deg)},
                    {"part_of_turn", Number(end.burr->part)}};
  }
  if (!end.border.empty()) {
    Json border = Json::array();
    for (const pipeline::BorderPlace& place : end.border) {
      border.push_back({{"around_deg", Number(place.around_deg)},
                        {"beyond_plane_mm", Number(place.beyond_mm)},
                        {"sigma_mm", Number(place.sigma_mm)}});
    }
    json["border"] = std::move(border);
  }
  return json;
}

pipeline::EndCutFound ReadCut(const JsonReader& json) {
  pipeline::EndCutFound end;
  end.cut = {json.NumberOr("obliquity_deg", 0), json.NumberOr("around_deg", 0)};
  end.obliquity_sigma_deg = json.NumberOr("obliquity_sigma_deg", 0);
  end.around_sigma_deg = json.NumberOr("around_sigma_deg", 0);
  if (json.Has("bevel")) {
    const JsonReader bevel = json.At("bevel");
    end.bevel = {bevel.NumberOr("length_mm", 0), bevel.NumberOr("length_sigma_mm", 0),
                 bevel.NumberOr("depth_mm", 0),  bevel.NumberOr("depth_sigma_mm", 0),
                 bevel.NumberOr("angle_deg", 0), bevel.NumberOr("angle_sigma_deg", 0)};
  }
  if (json.Has("burr")) {
    const JsonReader burr = json.At("burr");
    end.burr = {burr.NumberOr("height_mm", 0), burr.NumberOr("height_sigma_mm", 0),
                burr.NumberOr("around_deg", 0), burr.NumberOr("part_of_turn", 0)};
  }
  if (!json.Has("border")) return end;
  const JsonReader border = json.At("border");
  for (std::size_t i = 0, n = border.Size(kMostBorderPlaces); i < n; ++i) {
    const JsonReader place = border.Item(i);
    end.border.push_back({place.NumberOr("around_deg", 0), place.NumberOr("beyond_plane_mm", 0),
                          place.NumberOr("sigma_mm", 0)});
  }
  return end;
}

// `length_mm`: of the spine.
Json OpeningJson(const pipeline::OpeningFound& found, double length_mm) {
  const hal::WallOpening& opening = found.opening;
  const bool from_end = opening.along_mm > 0.5 * length_mm;
  Json json = {
      {"kind", opening.is_hole() ? "hole" : "slot"},
      {"along_mm", Number(opening.along_mm)},
      {"along_sigma_mm", Number(found.sigma.along_mm)},
      {"nearer_end", from_end ? "last" : "first"},
      {"from_nearer_end_mm", Number(from_end ? length_mm - opening.along_mm : opening.along_mm)},
      {"around_deg", Number(opening.around_deg)},
      {"around_sigma_deg", Number(found.sigma.around_deg)}};
  if (opening.is_hole()) {
    json["diameter_mm"] = Number(opening.length_mm);
    json["diameter_sigma_mm"] = Number(found.sigma.length_mm);
  } else {
    json["length_mm"] = Number(opening.length_mm);
    json["length_sigma_mm"] = Number(found.sigma.length_mm);
    json["width_mm"] = Number(opening.width_mm);
    json["width_sigma_mm"] = Number(found.sigma.width_mm);
    json["axis_deg"] = Number(opening.axis_deg);
    json["axis_sigma_deg"] = Number(found.sigma.axis_deg);
  }
  if (opening.lean_along_deg != 0 || opening.lean_around_deg != 0) {
    json["lean_along_deg"] = Number(opening.lean_along_deg);
    json["lean_along_sigma_deg"] = Number(found.sigma.lean_along_deg);
    json["lean_around_deg"] = Number(opening.lean_around_deg);
    json["lean_around_sigma_deg"] = Number(found.sigma.lean_around_deg);
  }
  json["position_mm"] = PointJson(found.position_mm);
  json["direction"] = PointJson(found.direction);
  return json;
}

pipeline::OpeningFound ReadOpening(const JsonReader& json) {
  pipeline::OpeningFound found;
  found.opening.along_mm = json.NumberOr("along_mm", 0);
  found.sigma.along_mm = json.NumberOr("along_sigma_mm", 0);
  found.opening.around_deg = json.NumberOr("around_deg", 0);
  found.sigma.around_deg = json.NumberOr("around_sigma_deg", 0);
  if (json.Has("diameter_mm")) {
    found.opening.length_mm = found.opening.width_mm = json.NumberOr("diameter_mm", 0);
    found.sigma.length_mm = found.sigma.width_mm = json.NumberOr("diameter_sigma_mm", 0);
  } else {
    found.opening.length_mm = json.NumberOr("length_mm", 0);
    found.sigma.length_mm = json.NumberOr("length_sigma_mm", 0);
    found.opening.width_mm = json.NumberOr("width_mm", 0);
    found.sigma.width_mm = json.NumberOr("width_sigma_mm", 0);
    found.opening.axis_deg = json.NumberOr("axis_deg", 0);
    found.sigma.axis_deg = json.NumberOr("axis_sigma_deg", 0);
  }
  found.opening.lean_along_deg = json.NumberOr("lean_along_deg", 0);
  found.sigma.lean_along_deg = json.NumberOr("lean_along_sigma_deg", 0);
  found.opening.lean_around_deg = json.NumberOr("lean_around_deg", 0);
  found.sigma.lean_around_deg = json.NumberOr("lean_around_sigma_deg", 0);
  found.position_mm = ReadPoint(json.At("position_mm"));
  found.direction = ReadPoint(json.At("direction"));
  return found;
}

Json OpeningInspectionJson(const pipeline::OpeningInspection& opening) {
  Json json = {
      {"name", opening.name}, {"kind", Word(opening.named)}, {"state", Word(opening.state)}};
  json["found"] = opening.found;
  if (opening.state == pipeline::OpeningState::kFound) {
    json["found_kind"] = Word(opening.found_as);
  }
  json["along_mm"] = DeviationJson(opening.along_mm);
  json["around_deg"] = DeviationJson(opening.around_deg);
  json["length_mm"] = DeviationJson(opening.length_mm);
  json["width_mm"] = DeviationJson(opening.width_mm);
  json["axis_deg"] = DeviationJson(opening.axis_deg);
  json["out_of_round_mm"] = DeviationJson(opening.out_of_round_mm);
  json["lean_deg"] = DeviationJson(opening.lean_deg);
  return json;
}

// Earlier results have neither kinds nor what goes with them.
pipeline::OpeningInspection ReadOpeningInspection(const JsonReader& json) {
  pipeline::OpeningInspection opening;
  opening.name = json.At("name").Text();
  opening.state = ReadWord<pipeline::OpeningState>(json.At("state"));
  opening.found = json.At("found").Count();
  if (json.Has("kind")) {
    opening.named = opening.found_as = ReadWord<pipeline::OpeningKind>(json.At("kind"));
  }
  if (json.Has("found_kind")) {
    opening.found_as = ReadWord<pipeline::OpeningKind>(json.At("found_kind"));
  }
  opening.along_mm = ReadDeviation(json.At("along_mm"));
  opening.around_deg = ReadDeviation(json.At("around_deg"));
  opening.length_mm = ReadDeviation(json.At("length_mm"));
  opening.width_mm = ReadDeviation(json.At("width_mm"));
  opening.axis_deg = ReadDeviation(json.At("axis_deg"));
  if (json.Has("out_of_round_mm")) {
    opening.out_of_round_mm = ReadDeviation(json.At("out_of_round_mm"));
  }
  if (json.Has("lean_deg")) opening.lean_deg = ReadDeviation(json.At("lean_deg"));
  return opening;
}

Json EndInspectionJson(const pipeline::EndInspection& end) {
  return end.is_known ? Json({{"obliquity_deg", DeviationJson(end.obliquity_deg)}}) : Json();
}

pipeline::EndInspection ReadEndInspection(const JsonReader& json, const char* key) {
  if (!json.Has(key)) return {};
  return {true, ReadDeviation(json.At(key).At("obliquity_deg"))};
}

}  // namespace

Json FeaturesJson(const pipeline::Measurement& m) {
  Json json = Json::object();
  const pipeline::TubeFeaturesFound& features = m.features;
  if (!features.is_known) return json;
  if (features.first_end) json["first_end"] = CutJson(*features.first_end);
  if (features.last_end) json["last_end"] = CutJson(*features.last_end);
  const double length_mm = hal::SpineLength(m.tube.program);
  Json openings = Json::array();
  for (const pipeline::OpeningFound& opening : features.openings) {
    openings.push_back(OpeningJson(opening, length_mm));
  }
  json["openings"] = std::move(openings);
  return json;
}

void ReadFeatures(const JsonReader& json, pipeline::Measurement& m) {
  m.features.is_known = true;
  if (json.Has("first_end")) m.features.first_end = ReadCut(json.At("first_end"));
  if (json.Has("last_end")) m.features.last_end = ReadCut(json.At("last_end"));
  const JsonReader openings = json.At("openings");
  for (std::size_t i = 0, n = openings.Size(kMostOpenings); i < n; ++i) {
    m.features.openings.push_back(ReadOpening(openings.Item(i)));
  }
}

Json FeatureInspectionJson(const pipeline::FeatureInspection& features) {
  Json json = Json::object();
  Json openings = Json::array();
  for (const pipeline::OpeningInspection& opening : features.openings) {
    openings.push_back(OpeningInspectionJson(opening));
  }
  if (!openings.empty()) json["openings"] = std::move(openings);
  // Ends that nobody judges stand among the features measured.
  if (features.first_end.obliquity_deg.tolerance || features.last_end.obliquity_deg.tolerance) {
    json["first_end"] = EndInspectionJson(features.first_end);
    json["last_end"] = EndInspectionJson(features.last_end);
  }
  return json;
}

void ReadFeatureInspection(const JsonReader& json, pipeline::FeatureInspection& features) {
  if (json.Has("openings")) {
    const JsonReader openings = json.At("openings");
    for (std::size_t i = 0, n = openings.Size(kMostOpenings); i < n; ++i) {
      features.openings.push_back(ReadOpeningInspection(openings.Item(i)));
    }
  }
  features.first_end = ReadEndInspection(json, "first_end");
  features.last_end = ReadEndInspection(json, "last_end");
}

}  // namespace bendloop::host
