// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/text/result_text.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "firmware-host/console/printable.h"
#include "firmware-host/result/words.h"
#include "firmware-host/text/findings_text.h"
#include "firmware-host/text/sentence.h"
#include "firmware-host/text/shown_value.h"
#include "firmware-host/text/table.h"
#include "pipeline/math/text.h"
#include "pipeline/tube/row_names.h"

namespace bendloop::host {
namespace {

using pipeline::RowValueKind;
using pipeline::ToleranceState;

constexpr std::size_t kMostTogether = 6;
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

// Sigma of row i, NaN when there is none.
double SigmaOf(const hal::BendProgram& sigma, std::size_t i, double hal::BendRow::*value) {
  return i < sigma.rows.size() ? sigma.rows[i].*value : std::nan("");
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

}  // namespace

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
         FindingsText(m);
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
      notes += Sentence(reason, Style::kPlain, colour, columns);
    }
    if (!result.inspection->direction.settled()) {
      notes += Sentence(result.inspection->direction.message, Style::kBad, colour, columns);
    }
  }
  if (result.interlocks) {
    for (const auto& check : result.interlocks->checks) {
      if (!check.passed)
        notes += Sentence("refused: " + check.sentence, Style::kBad, colour, columns);
    }
  }
  if (result.correction) {
    if (const std::string forecast = ForecastLine(result); !forecast.empty()) {
      notes += Sentence(forecast, Style::kPlain, colour, columns);
    }
    for (const auto& notice : result.correction->notices) {
      notes += Sentence("note: " + notice, Style::kPlain, colour, columns);
    }
  }
  for (const auto& warning : result.measurement.warnings) {
    notes += Sentence("warning: " + warning, Style::kWarning, colour, columns);
  }
  return notes.empty() ? out : out + "\n" + notes;
}

}  // namespace bendloop::host
