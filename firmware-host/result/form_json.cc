// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cstddef>

#include "firmware-host/result/program_json.h"
#include "firmware-host/result/sections.h"

namespace bendloop::host {
namespace {

constexpr std::size_t kMostDents = 1000;
constexpr std::size_t kMostPasses = 1000;

constexpr std::size_t kMostRadii = 1000;

Json EndJson(const pipeline::EndForm& end) {
  Json json = {{"fitting_mm", Number(end.length_mm)},
               {"proud_mm", Number(end.outside_mm)},
               {"samples_go_on_mm", Number(end.continues_mm)}};
  if (end.profile.empty()) return json;
  json["begins_mm"] = Number(end.begins_mm);
  json["begins_sigma_mm"] = Number(end.begins_sigma_mm);
  if (end.is_bead()) {
    json["returns_mm"] = Number(end.returns_mm);
    json["returns_sigma_mm"] = Number(end.returns_sigma_mm);
  }
  Json profile = Json::array();
  for (const pipeline::RadiusAt& at : end.profile) {
    profile.push_back({{"from_end_mm", Number(at.from_end_mm)},
                       {"radius_mm", Number(at.radius_mm)},
                       {"sigma_mm", Number(at.sigma_mm)}});
  }
  json["profile"] = std::move(profile);
  return json;
}

Json SeamJson(const pipeline::SeamFound& seam) {
  return {{"around_deg", Number(seam.around_deg)},
          {"around_sigma_deg", Number(seam.around_sigma_deg)},
          {"height_mm", Number(seam.height_mm)},
          {"height_sigma_mm", Number(seam.sigma_mm)},
          {"width_mm", Number(seam.width_mm)}};
}

Json WrinklesJson(const std::vector<pipeline::WrinklesFound>& wrinkles) {
  Json list = Json::array();
  for (const pipeline::WrinklesFound& of : wrinkles) {
    list.push_back({{"bend", of.bend + 1},
                    {"height_mm", Number(of.height_mm)},
                    {"height_sigma_mm", Number(of.sigma_mm)}});
  }
  return list;
}

pipeline::EndForm ReadEnd(const JsonReader& json) {
  pipeline::EndForm end{json.NumberOr("fitting_mm", 0),       json.NumberOr("proud_mm", 0),
                        json.NumberOr("samples_go_on_mm", 0), json.NumberOr("begins_mm", 0),
                        json.NumberOr("begins_sigma_mm", 0),  json.NumberOr("returns_mm", 0),
                        json.NumberOr("returns_sigma_mm", 0), {}};
  if (!json.Has("profile")) return end;
  const JsonReader profile = json.At("profile");
  for (std::size_t i = 0, n = profile.Size(kMostRadii); i < n; ++i) {
    const JsonReader at = profile.Item(i);
    end.profile.push_back(
        {at.NumberOr("from_end_mm", 0), at.NumberOr("radius_mm", 0), at.NumberOr("sigma_mm", 0)});
  }
  return end;
}

}  // namespace

Json FormJson(const pipeline::Measurement& m) {
  Json json = Json::object();
  if (!m.straights.empty()) {
    Json list = Json::array();
    for (const pipeline::StraightForm& straight : m.straights) {
      const bool is_known = straight.length_mm > 0;
      list.push_back({{"height_mm", is_known ? Number(straight.height_mm) : Json()},
                      {"sigma_mm", is_known ? Number(straight.sigma_mm) : Json()},
                      {"length_mm", Number(straight.length_mm)}});
    }
    json["straights"] = std::move(list);
  }
  if (!m.bend_easings.empty()) {
    Json list = Json::array();
    for (std::size_t i = 0; i < m.bend_easings.size(); ++i) {
      list.push_back({{"length_mm", Number(m.bend_easings[i].length_mm)},
                      {"length_sigma_mm", Number(m.bend_easings[i].length_sigma_mm)}});
      if (i < m.easing.variance_mm2.size()) {
        list.back()["variance_mm2"] = Number(m.easing.variance_mm2[i]);
      }
      if (i < m.easing.skew.size()) list.back()["skew"] = Number(m.easing.skew[i]);
    }
    json["easings"] = std::move(list);
    if (!m.easing.empty()) json["easing_reach"] = Number(m.easing.reach);
  }
  if (!m.dents.empty()) {
    Json list = Json::array();
    for (const pipeline::DentFound& dent : m.dents) {
      list.push_back({{"along_mm", Number(dent.along_mm)},
                      {"along_sigma_mm", Number(dent.along_sigma_mm)},
                      {"around_deg", Number(dent.around_deg)},
                      {"around_sigma_deg", Number(dent.around_sigma_deg)},
                      {"depth_mm", Number(dent.depth_mm)},
                      {"depth_sigma_mm", Number(dent.sigma_mm)},
                      {"area_mm2", Number(dent.area_mm2)},
                      {"area_sigma_mm2", Number(dent.area_sigma_mm2)},
                      {"size_mm", Number(dent.size_mm)},
                      {"position_mm", PointJson(dent.position_mm)}});
    }
    json["dents"] = std::move(list);
  }
  if (m.seam) json["seam"] = SeamJson(*m.seam);
  if (!m.wrinkles.empty()) json["wrinkles"] = WrinklesJson(m.wrinkles);
  const auto is_plain = [](const pipeline::EndForm& end) {
    return end.length_mm == 0 && end.continues_mm == 0 && end.profile.empty();
  };
  if (!is_plain(m.first_end)) json["first_end"] = EndJson(m.first_end);
  if (!is_plain(m.last_end)) json["last_end"] = EndJson(m.last_end);
  return json;
}

void ReadForm(const JsonReader& json, pipeline::Measurement& m) {
  if (json.Has("straights")) {
    const JsonReader list = json.At("straights");
    for (std::size_t i = 0, n = list.Size(kMaxRows); i < n; ++i) {
      const JsonReader item = list.Item(i);
      m.straights.push_back({item.NumberOr("height_mm", 0), item.NumberOr("sigma_mm", 0),
                             item.NumberOr("length_mm", 0)});
    }
  }
  if (json.Has("easings")) {
    const JsonReader list = json.At("easings");
    for (std::size_t i = 0, n = list.Size(kMaxRows); i < n; ++i) {
      const JsonReader item = list.Item(i);
      m.bend_easings.push_back(
          {item.NumberOr("length_mm", 0), item.NumberOr("length_sigma_mm", 0)});
      // Older results have the length alone: the variance is its square over 12.
      const double length_mm = m.bend_easings.back().length_mm;
      m.easing.variance_mm2.push_back(item.NumberOr("variance_mm2", length_mm * length_mm / 12.0));
      if (!item.Has("skew")) continue;
      m.easing.skew.resize(i);  // those before it, if they rise as they fall
      m.easing.skew.push_back(
          std::clamp(item.NumberOr("skew", 0.0), -pipeline::kMostSkew, pipeline::kMostSkew));
    }
    m.easing.reach = json.NumberOr("easing_reach", pipeline::kUsualReach);
  }
  if (json.Has("dents")) {
    const JsonReader list = json.At("dents");
    for (std::size_t i = 0, n = list.Size(kMostDents); i < n; ++i) {
      const JsonReader item = list.Item(i);
      m.dents.push_back({item.NumberOr("along_mm", 0), item.NumberOr("around_deg", 0),
                         item.NumberOr("depth_mm", 0), item.NumberOr("depth_sigma_mm", 0),
                         item.NumberOr("size_mm", 0), ReadPoint(item.At("position_mm")),
                         item.NumberOr("along_sigma_mm", 0), item.NumberOr("around_sigma_deg", 0),
                         item.NumberOr("area_mm2", 0), item.NumberOr("area_sigma_mm2", 0)});
    }
  }
  if (json.Has("seam")) {
    const JsonReader seam = json.At("seam");
    m.seam = {seam.NumberOr("around_deg", 0), seam.NumberOr("around_sigma_deg", 0),
              seam.NumberOr("height_mm", 0), seam.NumberOr("height_sigma_mm", 0),
              seam.NumberOr("width_mm", 0)};
  }
  if (json.Has("wrinkles")) {
    const JsonReader list = json.At("wrinkles");
    for (std::size_t i = 0, n = list.Size(kMaxRows); i < n; ++i) {
      const JsonReader item = list.Item(i);
      const std::size_t bend = std::max<std::size_t>(1, item.At("bend").Count());
      pipeline::WrinklesFound& of = m.wrinkles.emplace_back();
      of.bend = bend - 1;
      of.height_mm = item.NumberOr("height_mm", 0);
      of.sigma_mm = item.NumberOr("height_sigma_mm", 0);
    }
  }
  if (json.Has("first_end")) m.first_end = ReadEnd(json.At("first_end"));
  if (json.Has("last_end")) m.last_end = ReadEnd(json.At("last_end"));
}

Json PassesJson(const std::vector<pipeline::PassOffset>& passes) {
  Json list = Json::array();
  for (const pipeline::PassOffset& pass : passes) {
    list.push_back({{"points", pass.points},
                    {"move_mm", PointJson(pass.move_mm)},
                    {"turn_deg", PointJson(pass.turn_deg)}});
  }
  return list;
}

std::vector<pipeline::PassOffset> ReadPasses(const JsonReader& json) {
  std::vector<pipeline::PassOffset> passes;
  for (std::size_t i = 0, n = json.Size(kMostPasses); i < n; ++i) {
    const JsonReader item = json.Item(i);
    passes.push_back(
        {item.At("points").Count(), ReadPoint(item.At("move_mm")), ReadPoint(item.At("turn_deg"))});
  }
  return passes;
}

}  // namespace bendloop::host
