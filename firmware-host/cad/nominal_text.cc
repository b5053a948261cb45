// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cad/nominal_text.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <filesystem>
#include <string_view>
#include <utility>

#include "firmware-host/cad/bend_notes.h"
#include "firmware-host/cad/developed.h"
#include "firmware-host/console/printable.h"
#include "firmware-host/result/program_json.h"
#include "firmware-host/text/table.h"

namespace bendloop::host {
namespace {

// Half a turn is 180 to the decimals that are shown.
std::string Turn(double deg, int decimals) {
  return Fixed(RoundedTurnDeg(deg, decimals), decimals);
}

// Whether the length counts up to a point, and not to an edge.
bool IsTip(EndCover cover) { return cover == EndCover::kDome || cover == EndCover::kPoint; }

// What an end is that is not cut obliquely or to a shape.
const char* Covered(EndCover cover) {
  switch (cover) {
    case EndCover::kDome:
      return "domed (closed); the length is up to its tip";
    case EndCover::kPoint:
      return "pointed (closed); the length is up to its tip";
    case EndCover::kFlat:
      return "closed: the bore ends before it";
    default:
      return "square";
  }
}

Json CoverJson(EndCover cover) {
  switch (cover) {
    case EndCover::kDome:
      return "dome";
    case EndCover::kPoint:
      return "point";
    case EndCover::kFlat:
      return "flat";
    default:
      return nullptr;
  }
}

// Where a shape is longest, as far as it is so on one side or two.
std::string FarthestAround(const CadTube& tube, bool is_first) {
  const TubeEnd& end = is_first ? tube.first : tube.last;
  if (end.longest.isZero()) return "";
  const double around_deg = AroundEndDeg(tube, is_first, end.longest);
  const std::string other =
      end.longest_twice ? " and " + Turn(hal::WrapRotationDeg(around_deg + 180), 0) : "";
  return " about " + Turn(around_deg, 0) + other + " degrees around";
}

// Of a line across the tube: (-90, 90].
double FlatAroundDeg(const CadTube& tube, bool is_first, const FlatEnd& flat) {
  const double deg = AroundEndDeg(tube, is_first, flat.way);
  const double half = std::remainder(deg, 180.0);
  return half <= -90 + 1e-9 ? half + 180 : half;
}

// What `end` is that is neither cut obliquely nor to a shape.
std::string FormText(const CadTube& tube, bool is_first) {
  const TubeEnd& end = is_first ? tube.first : tube.last;
  if (!end.flat) return Covered(end.cover);
  return "pressed flat to " + Fixed(end.flat->wide_mm, 3) + " by " + Fixed(end.flat->thick_mm, 3) +
         " mm, its wide way at " + Turn(FlatAroundDeg(tube, is_first, *end.flat), 2) +
         " degrees around";
}

std::string EndRemark(const CadTube& tube, bool is_first) {
  const TubeEnd& end = is_first ? tube.first : tube.last;
  std::string text = is_first ? "first end: " : "last end: ";
  if (end.in_bend) {
    text +=
        "cut askew through the bend beside it: the rows have no straight there, and the bend up to "
        "the farthest point of the cut";
  } else if (!end.is_plane) {
    text += "cut to a shape that is no plane; the length is up to its farthest point" +
            FarthestAround(tube, is_first) + ", the tube is whole all around up to " +
            Fixed(end.whole_before_mm, 3) + " mm before it";
  } else if (end.oblique_deg > 0) {
    const hal::EndCut cut = is_first ? FirstCut(tube) : LastCut(tube);
    text += "cut " + Fixed(end.oblique_deg, 3) + " degrees oblique, longest at " +
            Turn(cut.around_deg, 2) + " degrees around; the length is along the axis" +
            (end.reaches_bend ? "; the cut reaches into the bend beside it" : "");
  } else {
    text += FormText(tube, is_first);
  }
  if (end.is_plane && end.fitting_mm > 0) {
    text += "; the plain tube ends " + Fixed(end.fitting_mm, 3) + " mm before it";
    if (!IsTip(end.cover) && !end.flat) text += " (a fitting, flange, chamfer or end form)";
  }
  return text;
}

// A part file has no lean of a slot.
std::string LeanRemark(const WallOpening& opening) {
  if (opening.lean_deg() == 0) return "";
  return ", its drill leaning " + Fixed(opening.lean_deg(), 2) +
         " degrees from the wall's normal (" + Fixed(opening.lean_along_deg, 2) + " along, " +
         Fixed(opening.lean_around_deg, 2) + " around)" +
         (opening.length_mm > 0 ? ", which the part file does not say" : "");
}

std::string OpeningRemark(const WallOpening& opening, const Spine& spine) {
  const int bend = BendAt(spine, opening.along_mm);
  const std::string where = " at " + Fixed(opening.along_mm, 3) + " mm of the developed length" +
                            (bend > 0 ? " (in bend " + std::to_string(bend) + ")" : "") + ", " +
                            Turn(opening.around_deg, 2) + " degrees around";
  if (opening.length_mm == 0) {
    return "hole of " + Fixed(opening.width_mm, 3) + " mm" + where + LeanRemark(opening);
  }
  return "slot of " + Fixed(opening.length_mm, 3) + " by " + Fixed(opening.width_mm, 3) + " mm" +
         where + ", its long axis " + Fixed(opening.axis_deg, 2) + " degrees from the tube's" +
         LeanRemark(opening);
}

Json AroundJson(double deg) { return Number(RoundedTurnDeg(deg, 6)); }

Json FlatJson(const CadTube& tube, bool is_first) {
  const TubeEnd& end = is_first ? tube.first : tube.last;
  if (!end.flat) return nullptr;
  return {{"wide_mm", Number(end.flat->wide_mm)},
          {"thick_mm", Number(end.flat->thick_mm)},
          {"around_deg", AroundJson(FlatAroundDeg(tube, is_first, *end.flat))}};
}

Json EndJson(const CadTube& tube, bool is_first) {
  const TubeEnd& end = is_first ? tube.first : tube.last;
  const hal::EndCut cut = is_first ? FirstCut(tube) : LastCut(tube);
  return {
      {"oblique_deg", end.is_plane ? Number(end.oblique_deg) : Json(nullptr)},
      {"around_deg", cut.obliquity_deg > 0 ? AroundJson(cut.around_deg) : Json(nullptr)},
      {"plane", end.is_plane},
      {"cuts_bend", end.reaches_bend || end.in_bend},
      {"closed_by", CoverJson(end.cover)},
      {"pressed_flat", FlatJson(tube, is_first)},
      {"plain_tube_ends_before_mm", Number(end.is_plane ? end.fitting_mm : end.whole_before_mm)}};
}

std::vector<std::string> NotesOf(const CadTube& tube) {
  std::vector<std::string> notes = tube.placed_notes;
  notes.insert(notes.end(), tube.notes.begin(), tube.notes.end());
  const std::vector<std::string> bends = BendNotes(tube);
  notes.insert(notes.end(), bends.begin(), bends.end());
  return notes;
}

// Which others of the list go on where the tube ends.
std::string NextText(const CadTube& tube) {
  std::string text;
  for (const NextTube& next : tube.next) {
    text += (text.empty() ? "end to end with " : " and ") + std::to_string(next.tube + 1);
    const double apart_mm = std::abs(next.apart_mm);
    if (apart_mm >= 5e-4) {
      text += ", " + Fixed(apart_mm, 3) + " mm " + (next.apart_mm < 0 ? "in each other" : "apart");
    }
  }
  return text;
}

// Some systems write a name where a part has none.
bool IsName(const std::string& name) {
  std::string plain;
  for (const char c : name) {
    if (c != ' ' && c != '\t') plain += char(std::tolower(static_cast<unsigned char>(c)));
  }
  return !plain.empty() && plain != "none";
}

// To what a part file holds, between two letters of UTF-8.
std::string Shortened(std::string name) {
  constexpr std::size_t kMostBytes = 255;
  constexpr std::string_view kMore = "...";
  if (name.size() <= kMostBytes) return name;
  std::size_t end = kMostBytes - kMore.size();
  while (end > 0 && (static_cast<unsigned char>(name[end]) & 0xC0) == 0x80) --end;
  name.resize(end);
  return name += kMore;
}

}  // namespace

std::string BodyName(const CadTube& tube) { return IsName(tube.name) ? Printable(tube.name) : ""; }

std::string PartName(const CadTube& tube, const std::string& file) {
  const std::string name = BodyName(tube);
  if (!name.empty()) return Shortened(name);
  const std::string stem = Printable(std::filesystem::path(file).stem().string());
  return stem.empty() ? "Tube" : Shortened(stem);
}

std::vector<std::string> Remarks(const CadTube& tube) {
  std::vector<std::string> remarks;
  if (!tube.is_wire) {
    remarks.push_back(EndRemark(tube, true));
    remarks.push_back(EndRemark(tube, false));
  }
  for (const WallOpening& opening : tube.openings) {
    remarks.push_back(OpeningRemark(opening, tube.spine));
  }
  for (std::string& note : NotesOf(tube)) remarks.push_back(std::move(note));
  const bool tells_around = std::any_of(
      remarks.begin(), remarks.end(),
      [](const std::string& remark) { return remark.find("degrees around") != std::string::npos; });
  if (tells_around) {
    remarks.emplace_back(
        "degrees around are right-handed about the feed, from the normal of the bend there or last "
        "before (before the first bend: of the first); 90 is that bend's outside");
  }
  return remarks;
}

std::string NominalText(const Nominal& nominal) {
  const CadTube& tube = nominal.tube;
  std::string text =
      PartName(tube, nominal.file) + ": " + Fixed(2 * tube.pipe_radius_mm, 3) + " mm in diameter, ";
  text += tube.wall_mm ? "wall " + Fixed(*tube.wall_mm, 3) + " mm"
                       : "no inner surface (a bar, or the file leaves the bore out)";
  const std::size_t bends = tube.spine.arcs.size();
  text += ", " + std::to_string(bends) + (bends == 1 ? " bend" : " bends") + ", developed length " +
          Fixed(tube.spine.length_mm(), 3) + " mm\n\n";
  Table table({{"row", Align::kRight},
               {"length mm", Align::kDecimal},
               {"rotation deg", Align::kDecimal},
               {"angle deg", Align::kDecimal},
               {"CLR mm", Align::kDecimal}});
  const auto& rows = nominal.program.program.rows;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    table.Add({std::to_string(i + 1), Fixed(rows[i].length_mm, 4), Turn(rows[i].rotation_deg, 4),
               Fixed(rows[i].angle_deg, 4),
               rows[i].bend_radius_mm ? Fixed(*rows[i].bend_radius_mm, 4) : ""});
  }
  text += table.Render(false) + "\n";
  text +=
      "the first end lies at " + FilePlace(nominal.program.X_WT.position_mm, 3) + " of the file\n";
  for (const std::string& remark : Remarks(tube)) text += remark + "\n";
  return text;
}

Json NominalJson(const Nominal& nominal) {
  const CadTube& tube = nominal.tube;
  const Eigen::Vector3d& p = nominal.program.X_WT.position_mm;
  const Eigen::Quaterniond& q = nominal.program.X_WT.orientation;
  Json openings = Json::array();
  for (const WallOpening& o : tube.openings) {
    Json json = {{"kind", o.length_mm > 0 ? "slot" : "hole"},
                 {"along_mm", Number(o.along_mm)},
                 {"around_deg", AroundJson(o.around_deg)},
                 {"width_mm", Number(o.width_mm)}};
    if (const int bend = BendAt(tube.spine, o.along_mm); bend > 0) json["in_bend"] = bend;
    if (o.length_mm > 0) {
      json["length_mm"] = Number(o.length_mm);
      json["axis_deg"] = Number(o.axis_deg);
    }
    if (o.lean_deg() != 0) {
      json["lean_along_deg"] = Number(o.lean_along_deg);
      json["lean_around_deg"] = Number(o.lean_around_deg);
    }
    openings.push_back(std::move(json));
  }
  return {{"schema", "bendloop.nominal/1"},
          {"file", nominal.file},
          {"body", tube.name},
          {"pipe_radius_mm", Number(tube.pipe_radius_mm)},
          {"wall_mm", tube.wall_mm ? Number(*tube.wall_mm) : Json(nullptr)},
          {"developed_length_mm", Number(tube.spine.length_mm())},
          {"position_mm", {Number(p.x()), Number(p.y()), Number(p.z())}},
          {"orientation_wxyz",
           {Number(q.w(), 9), Number(q.x(), 9), Number(q.y(), 9), Number(q.z(), 9)}},
          {"rows", RowsJson(nominal.program.program)},
          {"ends", {EndJson(tube, true), EndJson(tube, false)}},
          {"openings", std::move(openings)},
          {"notes", NotesOf(tube)}};
}

std::string TubeList(const std::vector<CadTube>& tubes) {
  const bool has_occurrences = std::any_of(
      tubes.begin(), tubes.end(), [](const CadTube& tube) { return !tube.occurrence.empty(); });
  std::vector<Column> columns{{"body", Align::kRight},
                              {"name"},
                              {"placed as"},
                              {"diameter mm", Align::kDecimal},
                              {"wall mm", Align::kDecimal},
                              {"bends", Align::kRight},
                              {"length mm", Align::kDecimal},
                              {""}};
  constexpr std::ptrdiff_t kPlacedAs = 2;
  if (!has_occurrences) columns.erase(columns.begin() + kPlacedAs);
  Table table(columns);
  for (std::size_t i = 0; i < tubes.size(); ++i) {
    const CadTube& tube = tubes[i];
    const bool known = tube.pipe_radius_mm > 0;
    std::vector<Cell> cells{std::to_string(i + 1),
                            Printable(tube.name),
                            Printable(tube.occurrence),
                            known ? Fixed(2 * tube.pipe_radius_mm, 3) : "",
                            tube.wall_mm ? Fixed(*tube.wall_mm, 3) : "",
                            std::to_string(tube.spine.arcs.size()),
                            Fixed(tube.spine.length_mm(), 3),
                            !tube.is_round           ? "not round"
                            : !tube.problems.empty() ? "no lines and arcs"
                            : tube.is_wire           ? "centre line"
                                                     : NextText(tube)};
    if (!has_occurrences) cells.erase(cells.begin() + kPlacedAs);
    table.Add(std::move(cells));
  }
  return table.Render(false);
}

}  // namespace bendloop::host
