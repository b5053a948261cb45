// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/text/result_text.h"

#include <algorithm>
#include <cmath>

#include "firmware-host/result/words.h"
#include "firmware-host/text/table.h"

namespace bendloop::host {
namespace {

using pipeline::ToleranceState;

// Decimals that a person reads: the scanner's bound is some 0.02 mm and 0.005 degree.
constexpr int kDecimals = 3;

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

std::string Line(const std::string& text, Style style, bool colour) {
  return "  " + Paint(Printable(text), style, colour) + "\n";
}

std::string Plural(std::size_t count, const char* noun) {
  return std::to_string(count) + " " + noun + (count == 1 ? "" : "s");
}

// Sigma of row i, NaN when there is none.
double SigmaOf(const hal::BendProgram& sigma, std::size_t i, double hal::BendRow::*value) {
  return i < sigma.rows.size() ? sigma.rows[i].*value : std::nan("");
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

void AddAxis(Table& table, std::string row, const char* name, const char* unit,
             const pipeline::Deviation& d, const pipeline::AxisCorrection* correction) {
  const Mark mark = MarkOf(d.state);
  std::vector<Cell> cells = {std::move(row),
                             name,
                             unit,
                             Fixed(d.nominal, kDecimals),
                             Fixed(d.measured, kDecimals),
                             Fixed(d.sigma, kDecimals),
                             {Signed(d.deviation, kDecimals), mark.style},
                             d.tolerance ? Fixed(*d.tolerance, kDecimals) : "-",
                             {mark.text, mark.style}};
  if (correction) {
    cells.emplace_back(Fixed(correction->corrected, kDecimals));
    cells.emplace_back(Signed(correction->applied, kDecimals));
    cells.emplace_back(FlagText(correction->flags));
  }
  table.Add(std::move(cells));
}

bool Refused(const pipeline::InterlockReport& report) {
  return !std::all_of(report.checks.begin(), report.checks.end(),
                      [](const pipeline::Interlock& check) { return check.passed; });
}

}  // namespace

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
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const bool last = i + 1 == rows.size();
    const auto sigma = [&](double hal::BendRow::*value) {
      return Fixed(SigmaOf(m.sigma, i, value), kDecimals);
    };
    std::vector<Cell> cells = {std::to_string(i + 1), Fixed(rows[i].length_mm, kDecimals),
                               sigma(&hal::BendRow::length_mm)};
    if (!last) {
      const bool first = i == 0;
      cells.emplace_back(first ? "-" : Fixed(rows[i].rotation_deg, kDecimals));
      cells.emplace_back(first ? "-" : sigma(&hal::BendRow::rotation_deg));
      cells.emplace_back(Fixed(rows[i].angle_deg, kDecimals));
      cells.emplace_back(sigma(&hal::BendRow::angle_deg));
      cells.emplace_back(Fixed(rows[i].bend_radius_mm.value_or(std::nan("")), kDecimals));
      const bool known = i < m.sigma.rows.size() && m.sigma.rows[i].bend_radius_mm;
      cells.emplace_back(known ? Fixed(*m.sigma.rows[i].bend_radius_mm, kDecimals) : "-");
    }
    table.Add(std::move(cells));
  }
  std::string out = rows.empty() ? "  no rows: see the spine\n" : table.Render(colour);
  out += "\n  pipe radius " + Fixed(m.tube.pipe_radius_mm, kDecimals) + " +- " +
         Fixed(m.pipe_radius_sigma_mm, kDecimals) + " mm; " +
         Plural(m.tube.program.bend_count(), "bend") + "; +- is 1 sigma\n";
  out += "  fit: " + Plural(m.fit.samples, "sample") + ", " + Plural(m.fit.outliers, "outlier") +
         "; distance median " + Fixed(m.fit.median_abs_distance_mm, kDecimals) + ", rms " +
         Fixed(m.fit.rms_distance_mm, kDecimals) + ", 95 % below " +
         Fixed(m.fit.p95_abs_distance_mm, kDecimals) + " mm\n";
  if (m.coverage > 0) {
    out += "  coverage " + Fixed(100 * m.coverage, 1) + " % of the spine, longest gap " +
           Fixed(m.longest_gap_mm, 1) + " mm\n";
  }
  for (std::size_t i = 0; i < m.bend_shapes.size(); ++i) {
    const pipeline::BendShape& shape = m.bend_shapes[i];
    out += "  bend " + std::to_string(i + 1) + ": ovality " + Fixed(shape.ovality_percent, 2) +
           " +- " + Fixed(shape.ovality_sigma_percent, 2) + " %, outer wall sunk in by " +
           Fixed(shape.outer_wall_mm, kDecimals) + " +- " +
           Fixed(shape.outer_wall_sigma_mm, kDecimals) + " mm\n";
  }
  return out;
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
                                 {"deviation", Align::kDecimal},
                                 {"limit", Align::kDecimal},
                                 {"", Align::kLeft}};
  if (corrected) {
    columns.push_back({"corrected", Align::kDecimal});
    columns.push_back({"change", Align::kDecimal});
    columns.push_back({"", Align::kLeft});
  }
  Table table(std::move(columns));
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const pipeline::RowCorrection* c = corrected ? &result.correction->rows[i] : nullptr;
    if (i > 0) table.AddGap();
    AddAxis(table, std::to_string(i + 1), "length", "mm", rows[i].length_mm,
            c ? &c->length_mm : nullptr);
    if (i + 1 == rows.size()) break;
    if (i > 0) {
      AddAxis(table, "", "rotation", "deg", rows[i].rotation_deg, c ? &c->rotation_deg : nullptr);
    }
    AddAxis(table, "", "angle", "deg", rows[i].angle_deg, c ? &c->angle_deg : nullptr);
    if (rows[i].bend_radius_mm) {
      AddAxis(table, "", "CLR", "mm", *rows[i].bend_radius_mm, nullptr);
    }
  }
  return table.Render(colour);
}

std::string VerdictLine(const RunResult& result, bool colour) {
  std::string out = result.part.empty() ? "measured" : "part " + Printable(result.part);
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

std::string RunText(const RunResult& result, bool colour) {
  std::string out = VerdictLine(result, colour) + "\n" + ComparisonText(result, colour);
  std::string notes;
  if (result.inspection) {
    for (const auto& reason : result.inspection->reasons) {
      notes += Line(reason, Style::kPlain, colour);
    }
    if (!result.inspection->direction.settled()) {
      notes += Line(result.inspection->direction.message, Style::kBad, colour);
    }
  }
  if (result.interlocks) {
    for (const auto& check : result.interlocks->checks) {
      if (!check.passed) notes += Line("refused: " + check.sentence, Style::kBad, colour);
    }
  }
  if (result.correction) {
    for (const auto& notice : result.correction->notices) {
      notes += Line("note: " + notice, Style::kPlain, colour);
    }
  }
  for (const auto& warning : result.measurement.warnings) {
    notes += Line("warning: " + warning, Style::kWarning, colour);
  }
  return notes.empty() ? out : out + "\n" + notes;
}

}  // namespace bendloop::host
