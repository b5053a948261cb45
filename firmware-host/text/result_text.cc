// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/text/result_text.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "firmware-host/console/printable.h"
#include "firmware-host/console/wrap.h"
#include "firmware-host/result/words.h"
#include "firmware-host/text/table.h"
#include "hal/spine.h"
#include "pipeline/math/text.h"
#include "pipeline/tube/row_names.h"

namespace bendloop::host {
namespace {

using pipeline::RowValueKind;
using pipeline::ToleranceState;

// Decimals that a person reads: the scanner's bound is some 0.02 mm and 0.005 degree.
constexpr int kDecimals = 3;
// 1 sigma from which on a number does not tell where it is: what no bender could use.
constexpr double kUnknownDeg = 5;
constexpr double kUnknownMm = 0.3;  // a straight of nothing is well known to be short
constexpr std::size_t kMostTogether = 6;
constexpr std::size_t kHanging = 4;  // of the further lines of a sentence

struct Mark {
  const char* text;
  Style style;
};

Mark MarkOf(ToleranceState state) {
  switch (state) {
    case ToleranceState::kIn:
      return {"in", Style::kGood};
    case ToleranceState::kOut:
      return {"OUT", Style::kBad};
    case ToleranceState::kUndecided:
      return {"undecided", Style::kWarning};
    case ToleranceState::kNotJudged:
      return {"-", Style::kFaint};
  }
  return {"-", Style::kFaint};
}

// A sentence in lines that `columns` hold; 0: in one.
std::string Line(const std::string& text, Style style, bool colour, std::size_t columns) {
  if (columns == 0) return "  " + Paint(Printable(text), style, colour) + "\n";
  std::string out, indent = "  ";
  for (const std::string& line :
       WrapWords(Printable(text), columns - std::min(columns, kHanging))) {
    out += indent + Paint(line, style, colour) + "\n";
    indent = std::string(kHanging, ' ');
  }
  return out;
}

std::string Plural(std::size_t count, const char* noun) {
  return std::to_string(count) + " " + noun + (count == 1 ? "" : "s");
}

// Sigma of row i, NaN when there is none.
double SigmaOf(const hal::BendProgram& sigma, std::size_t i, double hal::BendRow::*value) {
  return i < sigma.rows.size() ? sigma.rows[i].*value : std::nan("");
}

bool IsUnknown(RowValueKind kind, double value, double sigma) {
  const bool beyond = sigma > std::abs(value);
  switch (kind) {
    case RowValueKind::kLength:
      return beyond && sigma > kUnknownMm;
    case RowValueKind::kRotation:
      return sigma > kUnknownDeg;
    case RowValueKind::kAngle:
      return beyond || sigma > kUnknownDeg;
    case RowValueKind::kBendRadius:
      return beyond;
  }
  return false;
}

Cell ValueCell(const ShownValue& shown) {
  return {shown.text, shown.is_known ? Style::kPlain : Style::kWarning};
}

// "0.5", as it stands in the part file: digits that say nothing cost a long tube's row its line.
std::string LimitText(double tolerance) {
  std::string text = Fixed(tolerance, kDecimals);
  text.erase(text.find_last_not_of('0') + 1);
  if (text.back() == '.') text.pop_back();
  return text;
}

void AddAxis(Table& table, std::string row, RowValueKind kind, const pipeline::Deviation& d,
             const ShownValue& measured, const pipeline::AxisCorrection* correction) {
  static constexpr const char* kNames[] = {"length", "rotation", "angle", "CLR"};
  static constexpr const char* kUnits[] = {"mm", "deg", "deg", "mm"};
  const auto axis = static_cast<std::size_t>(kind);
  const Mark mark = MarkOf(d.state);
  std::vector<Cell> cells = {std::move(row),
                             kNames[axis],
                             kUnits[axis],
                             Fixed(d.nominal, kDecimals),
                             ValueCell(measured),
                             ShowSigma(d.sigma),
                             {Signed(d.deviation, SigmaDecimals(d.sigma, kDecimals)), mark.style},
                             d.tolerance ? LimitText(*d.tolerance) : "-",
                             {mark.text, mark.style}};
  if (correction) {
    cells.emplace_back(Fixed(correction->corrected, kDecimals));
    cells.emplace_back(Signed(correction->applied, kDecimals));
  }
  table.Add(std::move(cells));
}

// "R3": the rotation of the table's row 3.
std::string ShortName(const pipeline::RowValue& value) {
  static constexpr const char* kLetters[] = {"L", "R", "A", "CLR"};
  return kLetters[static_cast<std::size_t>(value.kind)] + std::to_string(value.row + 1);
}

// Below a table, which has 80 columns in any case.
std::string Below(const std::string& sentence) {
  return Line(sentence, Style::kPlain, false, kPlainColumns);
}

std::string TogetherText(const std::vector<std::string>& lines) {
  std::string out;
  for (const std::string& line : lines) out += Below(line);
  return out;
}

// "deadband: L4, A2": which numbers were not corrected as they asked for, below the table, which
// has no room for words.
class FlagLines {
 public:
  void Add(const pipeline::RowValue& value, const pipeline::AxisCorrection* correction) {
    const std::string words = correction ? FlagText(correction->flags) : "";
    if (words.empty()) return;
    std::string& names = names_[words];
    names += (names.empty() ? "" : ", ") + ShortName(value);
  }
  std::string Text() const {
    std::string text;
    for (const auto& [words, names] : names_) text += Below(words + ": " + names);
    return text;
  }

 private:
  std::map<std::string, std::string> names_;
};

bool Refused(const pipeline::InterlockReport& report) {
  return !std::all_of(report.checks.begin(), report.checks.end(),
                      [](const pipeline::Interlock& check) { return check.passed; });
}

std::string FitText(const pipeline::Measurement& m) {
  std::string out = Below(
      "pipe radius " +
      Fixed(m.tube.pipe_radius_mm, SigmaDecimals(m.pipe_radius_sigma_mm, kDecimals)) + " +- " +
      ShowSigma(m.pipe_radius_sigma_mm) + " mm; " +
      (m.tube.program.rows.empty() ? "" : Plural(m.tube.program.bend_count(), "bend") + "; ") +
      "+- is 1 sigma");
  out +=
      Below("fit: " + Plural(m.fit.samples, "sample") + ", " + Plural(m.fit.outliers, "outlier") +
            "; distance median " + Fixed(m.fit.median_abs_distance_mm, kDecimals) + ", rms " +
            Fixed(m.fit.rms_distance_mm, kDecimals) + ", 95 % below " +
            Fixed(m.fit.p95_abs_distance_mm, kDecimals) + " mm");
  if (m.coverage > 0) {
    out += Below("coverage " + Fixed(100 * m.coverage, 1) + " % of the spine, longest gap " +
                 Fixed(m.longest_gap_mm, 1) + " mm");
  }
  return out;
}

std::string BendShapesText(const std::vector<pipeline::BendShape>& shapes) {
  std::string out;
  for (std::size_t i = 0; i < shapes.size(); ++i) {
    const pipeline::BendShape& shape = shapes[i];
    out += Below("bend " + std::to_string(i + 1) + ": ovality " + Fixed(shape.ovality_percent, 2) +
                 " +- " + Fixed(shape.ovality_sigma_percent, 2) + " %, outer wall sunk in by " +
                 Fixed(shape.outer_wall_mm, kDecimals) + " +- " +
                 Fixed(shape.outer_wall_sigma_mm, kDecimals) + " mm");
  }
  return out;
}

// What a person at the machine should know of the tube's form: what is beyond its own sigma.
std::string FormText(const pipeline::Measurement& m) {
  std::string out;
  const pipeline::StraightForm* worst = nullptr;
  for (const pipeline::StraightForm& straight : m.straights) {
    if (straight.length_mm > 0 && (!worst || straight.height_mm > worst->height_mm)) {
      worst = &straight;
    }
  }
  if (worst && worst->height_mm > 3 * worst->sigma_mm) {
    out += Below("straightness: " + Fixed(worst->height_mm, kDecimals) + " +- " +
                 Fixed(worst->sigma_mm, kDecimals) + " mm on " + Fixed(worst->length_mm, 0) +
                 " mm (L/" + Fixed(worst->length_mm / worst->height_mm, 0) + "), the worst, row " +
                 std::to_string(worst - m.straights.data() + 1));
  }
  if (!m.bend_easings.empty()) {
    std::string lengths;
    for (std::size_t i = 0; i < m.bend_easings.size(); ++i) {
      lengths += (i == 0 ? " " : ", ") + Fixed(m.bend_easings[i].length_mm, 1);
    }
    out += Below("bends ease in and out over" + lengths + " mm");
  }
  for (const pipeline::DentFound& dent : m.dents) {
    out +=
        Below("dent: " + Fixed(dent.depth_mm, 2) + " +- " + Fixed(dent.sigma_mm, 2) + " mm deep, " +
              Fixed(dent.area_mm2, 1) + " +- " + Fixed(dent.area_sigma_mm2, 1) +
              " mm2 where half as deep, at " + Fixed(dent.along_mm, 1) + " +- " +
              Fixed(dent.along_sigma_mm, 1) + " mm along the spine, " + Fixed(dent.around_deg, 1) +
              " +- " + Fixed(dent.around_sigma_deg, 1) + " degrees around");
  }
  for (std::size_t i = 0; i < m.passes.size(); ++i) {
    out += Below("pass " + std::to_string(i + 1) + ": moved by " +
                 Fixed(m.passes[i].move_mm.norm(), kDecimals) + " mm and " +
                 Fixed(m.passes[i].turn_deg.norm(), kDecimals) + " degrees to meet the others");
  }
  return out;
}

// Ends that are certainly not square (5 sigma), holes and slots.
std::string FeaturesText(const pipeline::Measurement& m) {
  std::string out;
  const auto degrees = [](double value, double sigma) {
    return Fixed(value, 2) + " +- " + Fixed(sigma, 2) + " degrees";
  };
  const auto mm = [](double value, double sigma) {
    return Fixed(value, kDecimals) + " +- " + Fixed(sigma, kDecimals) + " mm";
  };
  for (const auto* end : {&m.features.first_end, &m.features.last_end}) {
    if (!*end || (*end)->cut.obliquity_deg < 5 * (*end)->obliquity_sigma_deg) continue;
    out += Below(std::string(end == &m.features.first_end ? "first" : "last") + " end: cut " +
                 degrees((*end)->cut.obliquity_deg, (*end)->obliquity_sigma_deg) +
                 " oblique, longest at " +
                 degrees((*end)->cut.around_deg, (*end)->around_sigma_deg) + " around");
  }
  for (const auto* end : {&m.first_end, &m.last_end}) {
    if (end->profile.empty()) continue;
    const pipeline::RadiusAt& widest = end->Widest();
    const bool is_bead = end->is_bead();
    out += Below(std::string(end == &m.first_end ? "first" : "last") +
                 " end: " + (is_bead ? "bead" : "wider") + " from " +
                 mm(end->begins_mm, end->begins_sigma_mm) +
                 (is_bead ? " to " + mm(end->returns_mm, end->returns_sigma_mm) : "") +
                 " before its end, radius up to " + mm(widest.radius_mm, widest.sigma_mm));
  }
  const double length_mm = hal::SpineLength(m.tube.program);
  for (const pipeline::OpeningFound& found : m.features.openings) {
    const hal::WallOpening& opening = found.opening;
    const bool from_end = opening.along_mm > 0.5 * length_mm;
    std::string size = mm(opening.width_mm, found.sigma.width_mm);
    if (!opening.is_hole()) {
      size = mm(opening.length_mm, found.sigma.length_mm) + " long, " + size + " wide, axis at " +
             degrees(opening.axis_deg, found.sigma.axis_deg);
    }
    if (opening.lean_along_deg != 0 || opening.lean_around_deg != 0) {
      size += ", leaning " + degrees(opening.lean_along_deg, found.sigma.lean_along_deg) +
              " along and " + degrees(opening.lean_around_deg, found.sigma.lean_around_deg) +
              " around";
    }
    out +=
        Below((opening.is_hole() ? "hole: " : "slot: ") + size + ", " +
              mm(from_end ? length_mm - opening.along_mm : opening.along_mm, found.sigma.along_mm) +
              (from_end ? " from the last end, " : " from the first end, ") +
              degrees(opening.around_deg, found.sigma.around_deg) + " around");
  }
  return out;
}

}  // namespace

ShownValue ShowValue(RowValueKind kind, double value, double sigma) {
  const bool is_known = !IsUnknown(kind, value, sigma);
  return {(is_known ? "" : "~") + Fixed(value, SigmaDecimals(sigma, kDecimals)), is_known};
}

std::string ShowSigma(double sigma) { return Fixed(sigma, SigmaDecimals(sigma, kDecimals)); }

std::vector<std::string> TogetherLines(const pipeline::JointUncertainty& joint, std::size_t bends) {
  std::vector<std::string> lines;
  for (const pipeline::KnownTogether& run : joint.known_together) {
    const auto bend = [](std::size_t b) { return "bend " + std::to_string(b + 1); };
    const std::string from = run.first_bend > 0 ? bend(run.first_bend - 1) : "start";
    const std::string to = run.last_bend + 1 < bends ? bend(run.last_bend + 1) : "end";
    std::string values, known;
    for (const pipeline::RowValue& value : run.values) {
      values += (values.empty() ? "" : ", ") + ShortName(value);
    }
    const auto add = [&known](const std::string& what, double sigma, const char* unit) {
      if (!std::isfinite(sigma)) return;
      known += (known.empty() ? "; but " : ", ") + what + " +- " + ShowSigma(sigma) + unit;
    };
    add("direction behind " + bend(run.last_bend), run.direction_sigma_deg, " deg");
    add("plane of " + to + " against " + from, run.plane_sigma_deg, " deg");
    add("from " + from + " to " + to + " " +
            Fixed(run.length_mm, SigmaDecimals(run.length_sigma_mm, kDecimals)),
        run.length_sigma_mm, " mm");
    if (known.empty()) continue;
    lines.push_back((run.values.size() == 1 ? "vague: " : "hardly told apart: ") + values + known);
  }
  if (lines.size() > kMostTogether) {
    const std::size_t more = lines.size() - kMostTogether;
    lines.resize(kMostTogether);
    lines.push_back("and " + Plural(more, "more place") +
                    " like these: \"known_together\" in the JSON");
  }
  return lines;
}

std::vector<std::string> TogetherLines(const RunResult& result) {
  const std::size_t bends = result.measurement.tube.program.bend_count();
  const pipeline::JointUncertainty& joint = result.measurement.joint;
  if (!result.inspection || result.inspection->rows.empty()) return TogetherLines(joint, bends);
  if (bends + 1 != result.inspection->rows.size()) return {};
  const bool reverse = result.inspection->direction.state == pipeline::DirectionState::kReverse;
  return TogetherLines(reverse ? Reversed(joint, bends) : joint, bends);
}

std::string ForecastLine(const RunResult& result) {
  if (!result.correction || result.correction->forecast.rows.empty()) return "";
  const pipeline::Forecast& forecast = result.correction->forecast;
  const std::size_t bends = forecast.rows.size() - 1;
  double least = 1;
  std::string name;
  const auto take = [&](double probability, const std::string& of) {
    if (probability >= least) return;
    least = probability;
    name = of;
  };
  for (std::size_t i = 0; i <= bends; ++i) {
    take(forecast.rows[i].length_mm, pipeline::LengthName(i, bends));
    take(forecast.rows[i].rotation_deg, pipeline::RotationName(i));
    take(forecast.rows[i].angle_deg, pipeline::AngleName(i));
  }
  const auto percent = [](double probability) {
    // Nothing that is not bent yet is certain.
    return pipeline::Fixed(std::min(100 * probability, 99.9), 1) + " %";
  };
  std::string line = "the next tube is in tolerance with " + percent(forecast.part);
  if (!name.empty()) line += ", least sure: " + name + ", " + percent(least);
  return line;
}

std::string FlagText(std::uint32_t flags) {
  std::string text;
  for (const auto& [flag, word] : Words<pipeline::CorrectionFlag>::kTable) {
    // The first rotation and the last angle do not exist: nobody needs to be told.
    if (!(flags & flag) || flag == pipeline::kFlagNotCorrected) continue;
    text += (text.empty() ? "" : ", ") + std::string(word);
  }
  for (char& c : text) c = c == '_' ? ' ' : c;
  return text;
}

std::string MeasurementText(const pipeline::Measurement& m, bool colour) {
  Table table({{"row", Align::kRight},
               {"length mm", Align::kDecimal},
               {"+-", Align::kDecimal},
               {"rotation deg", Align::kDecimal},
               {"+-", Align::kDecimal},
               {"angle deg", Align::kDecimal},
               {"+-", Align::kDecimal},
               {"CLR mm", Align::kDecimal},
               {"+-", Align::kDecimal}});
  const auto& rows = m.tube.program.rows;
  bool unknown = false;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const bool last = i + 1 == rows.size();
    std::vector<Cell> cells = {std::to_string(i + 1)};
    const auto add = [&](RowValueKind kind, double value, double sigma) {
      const ShownValue shown = ShowValue(kind, value, sigma);
      unknown = unknown || !shown.is_known;
      cells.push_back(ValueCell(shown));
      cells.emplace_back(ShowSigma(sigma));
    };
    add(RowValueKind::kLength, rows[i].length_mm, SigmaOf(m.sigma, i, &hal::BendRow::length_mm));
    if (!last) {
      if (i == 0) {
        cells.insert(cells.end(), {"-", "-"});
      } else {
        add(RowValueKind::kRotation, rows[i].rotation_deg,
            SigmaOf(m.sigma, i, &hal::BendRow::rotation_deg));
      }
      add(RowValueKind::kAngle, rows[i].angle_deg, SigmaOf(m.sigma, i, &hal::BendRow::angle_deg));
      const bool known = i < m.sigma.rows.size() && m.sigma.rows[i].bend_radius_mm;
      add(RowValueKind::kBendRadius, rows[i].bend_radius_mm.value_or(std::nan("")),
          known ? *m.sigma.rows[i].bend_radius_mm : std::nan(""));
    }
    table.Add(std::move(cells));
  }
  std::string out = rows.empty() ? "  no rows: see the spine\n" : table.Render(colour);
  if (unknown) out += std::string("  ") + kUnknownLegend + "\n";
  return out + TogetherText(TogetherLines(m.joint, m.tube.program.bend_count())) + "\n" +
         FitText(m) + BendShapesText(m.bend_shapes) + FormText(m) + FeaturesText(m);
}

std::string ComparisonText(const RunResult& result, bool colour) {
  if (!result.inspection || result.inspection->rows.empty()) {
    return MeasurementText(result.measurement, colour);
  }
  const auto& rows = result.inspection->rows;
  const bool corrected = result.correction && result.correction->rows.size() == rows.size();
  std::vector<Column> columns = {{"row", Align::kRight},
                                 {"", Align::kLeft},
                                 {"", Align::kLeft},
                                 {"nominal", Align::kDecimal},
                                 {"measured", Align::kDecimal},
                                 {"+-", Align::kDecimal},
                                 {"off by", Align::kDecimal},
                                 {"limit", Align::kDecimal},
                                 {"", Align::kLeft}};
  if (corrected) {
    columns.push_back({"command", Align::kDecimal});
    columns.push_back({"change", Align::kDecimal});
  }
  Table table(std::move(columns));
  FlagLines flags;
  bool unknown = false;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const pipeline::RowCorrection* c = corrected ? &result.correction->rows[i] : nullptr;
    if (i > 0) table.AddGap();
    const auto add = [&](RowValueKind kind, const pipeline::Deviation& d,
                         const pipeline::AxisCorrection* correction) {
      const ShownValue measured = ShowValue(kind, d.measured, d.sigma);
      unknown = unknown || !measured.is_known;
      const bool first = kind == RowValueKind::kLength;
      AddAxis(table, first ? std::to_string(i + 1) : "", kind, d, measured, correction);
      flags.Add({i, kind}, correction);
    };
    add(RowValueKind::kLength, rows[i].length_mm, c ? &c->length_mm : nullptr);
    if (i + 1 == rows.size()) break;
    if (i > 0) {
      add(RowValueKind::kRotation, rows[i].rotation_deg, c ? &c->rotation_deg : nullptr);
    }
    add(RowValueKind::kAngle, rows[i].angle_deg, c ? &c->angle_deg : nullptr);
    if (rows[i].bend_radius_mm) {
      add(RowValueKind::kBendRadius, *rows[i].bend_radius_mm, nullptr);
    }
  }
  std::string out = table.Render(colour, 1, 1) + flags.Text();  // 80 columns
  if (unknown) out += std::string("  ") + kUnknownLegend + "\n";
  return out + TogetherText(TogetherLines(result));
}

std::string VerdictLine(const RunResult& result, bool colour) {
  std::string out = result.part.empty() ? "measured" : "part " + Printable(result.part);
  if (!result.repeat_of.empty()) out += ", the tube of " + Printable(result.repeat_of) + " again";
  if (result.inspection) {
    switch (result.inspection->verdict) {
      case pipeline::Verdict::kPass:
        out += ": " + Paint("PASS", Style::kGood, colour);
        break;
      case pipeline::Verdict::kFail:
        out += ": " + Paint("FAIL", Style::kBad, colour);
        break;
      case pipeline::Verdict::kUndecided:
        out += ": " + Paint("UNDECIDED", Style::kWarning, colour);
        break;
    }
  }
  if (result.bender) {
    if (result.bender->outcome == CommitOutcome::kCommitted) {
      out += "; corrected program committed as sequence " + std::to_string(result.bender->sequence);
    } else {
      out += "; " +
             Paint("correction " + std::string(Word(result.bender->outcome)), Style::kBad, colour) +
             ": " + Printable(result.bender->reason);
    }
  } else if (result.interlocks && Refused(*result.interlocks)) {
    out += "; " + Paint("correction refused", Style::kBad, colour) + ", nothing was sent";
  } else if (result.correction && !result.correction->changes_anything) {
    out += "; no correction needed";
  }
  return out + "\n";
}

std::string RunText(const RunResult& result, bool colour, std::size_t columns) {
  std::string out = VerdictLine(result, colour) + "\n" + ComparisonText(result, colour);
  std::string notes;
  if (result.inspection) {
    for (const auto& reason : result.inspection->reasons) {
      notes += Line(reason, Style::kPlain, colour, columns);
    }
    if (!result.inspection->direction.settled()) {
      notes += Line(result.inspection->direction.message, Style::kBad, colour, columns);
    }
  }
  if (result.interlocks) {
    for (const auto& check : result.interlocks->checks) {
      if (!check.passed) notes += Line("refused: " + check.sentence, Style::kBad, colour, columns);
    }
  }
  if (result.correction) {
    if (const std::string forecast = ForecastLine(result); !forecast.empty()) {
      notes += Line(forecast, Style::kPlain, colour, columns);
    }
    for (const auto& notice : result.correction->notices) {
      notes += Line("note: " + notice, Style::kPlain, colour, columns);
    }
  }
  for (const auto& warning : result.measurement.warnings) {
    notes += Line("warning: " + warning, Style::kWarning, colour, columns);
  }
  return notes.empty() ? out : out + "\n" + notes;
}

}  // namespace bendloop::host
