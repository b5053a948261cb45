// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/report/part_html.h"

#include <algorithm>
#include <cmath>
#include <initializer_list>
#include <span>

#include "firmware-host/report/html.h"
#include "firmware-host/report/unrolled_svg.h"
#include "firmware-host/result/words.h"
#include "firmware-host/text/result_text.h"
#include "firmware-host/text/shown_value.h"
#include "firmware-host/text/table.h"
#include "hal/spine.h"

namespace bendloop::host {
namespace {

using pipeline::AxisCorrection;
using pipeline::Deviation;
using pipeline::RowValueKind;

std::string Number(double value, int decimals = 3) {
  return "<td class=\"n\">" + Fixed(value, decimals) + "</td>";
}
std::string Change(double value, int decimals = 3) {
  return "<td class=\"n\">" + Signed(value, decimals) + "</td>";
}

std::string StateCell(pipeline::ToleranceState state) {
  const StateMark mark = MarkOf(state);
  return "<td class=\"state " + std::string(mark.css) + "\"><span aria-hidden=\"true\">" +
         mark.mark + "</span> " + mark.word + "</td>";
}

// Value and sigma as on the terminal; `unknown` grows true at the first that is not known.
std::string WithSigma(RowValueKind kind, double value, double sigma, bool& unknown) {
  const ShownValue shown = ShowValue(kind, value, sigma);
  unknown = unknown || !shown.is_known;
  return "<td class=\"n\">" + shown.text + "</td><td class=\"n\">" + ShowSigma(sigma) + "</td>";
}

std::string Legend(bool unknown) {
  return unknown ? "<p><small>" + Escape(kUnknownLegend) + "</small></p>" : "";
}

// The deviation within its limits, as a setter's dial: the band is the tolerance, the line is 1
// sigma to both sides. What lies beyond twice the limit stands at the end.
std::string ToleranceBar(const Deviation& d) {
  if (!d.tolerance || !(*d.tolerance > 0) || !std::isfinite(d.deviation)) return "<td></td>";
  constexpr double kWidth = 80,
                   kLimit = 20;  // of the drawing; the limit's distance from the middle
  const auto x = [&](double value) {
    return Fixed(std::clamp(kWidth / 2 + value / *d.tolerance * kLimit, 2.0, kWidth - 2), 1);
  };
  const double sigma = std::isfinite(d.sigma) ? d.sigma : 0;
  return "<td class=\"dial\"><svg viewBox=\"0 0 80 14\" aria-hidden=\"true\">"
         "<path class=\"axis\" d=\"M0 7h80\"/><rect class=\"band\" x=\"20\" y=\"1\" "
         "width=\"40\" height=\"12\"/><path class=\"axis\" d=\"M40 1v12\"/><path "
         "class=\"sigma\" d=\"M" +
         x(d.deviation - sigma) + " 7H" + x(d.deviation + sigma) + "\"/><circle cx=\"" +
         x(d.deviation) + "\" cy=\"7\" r=\"3.5\"/></svg></td>";
}

std::string AxisRow(const std::string& head, RowValueKind kind, const Deviation& d, bool corrected,
                    const AxisCorrection* correction, bool& unknown) {
  static constexpr const char* kNames[] = {"length", "rotation", "angle", "CLR"};
  static constexpr const char* kUnits[] = {"mm", "deg", "deg", "mm"};
  const auto axis = static_cast<std::size_t>(kind);
  std::string html = "<tr class=\"" + std::string(MarkOf(d.state).css) + "\" data-unit=\"" +
                     kUnits[axis] + "\">" + head + "<th scope=\"row\">" + kNames[axis] +
                     " <small>" + kUnits[axis] + "</small></th>" + Number(d.nominal) +
                     WithSigma(kind, d.measured, d.sigma, unknown) +
                     Change(d.deviation, SigmaDecimals(d.sigma, 3)) + "<td class=\"n\">" +
                     (d.tolerance ? "&#177;" + Fixed(*d.tolerance, 2) : "") + "</td>" +
                     ToleranceBar(d) + StateCell(d.state);
  if (corrected && correction) {
    html += Number(correction->commanded) + Number(correction->corrected) +
            Change(correction->applied) + "<td class=\"flag\">" + FlagText(correction->flags) +
            "</td>";
  } else if (corrected) {
    html += "<td></td><td></td><td></td><td></td>";
  }
  return html + "</tr>\n";
}

std::string MeasuredOnly(const pipeline::Measurement& m) {
  std::string html =
      "<table><thead><tr><th>row</th><th class=\"n\">length <small>mm</small></th>"
      "<th class=\"n\">&#177;</th><th class=\"n\">rotation <small>deg</small></th>"
      "<th class=\"n\">&#177;</th><th class=\"n\">angle <small>deg</small></th>"
      "<th class=\"n\">&#177;</th><th class=\"n\">CLR <small>mm</small></th>"
      "<th class=\"n\">&#177;</th></tr></thead><tbody>\n";
  bool unknown = false;
  const auto& rows = m.tube.program.rows;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const bool last = i + 1 == rows.size(), known = i < m.sigma.rows.size();
    const hal::BendRow sigma =
        known ? m.sigma.rows[i] : hal::BendRow{std::nan(""), std::nan(""), std::nan(""), {}};
    const auto with_sigma = [&unknown](RowValueKind kind, double value, double one_sigma) {
      return WithSigma(kind, value, one_sigma, unknown);
    };
    html += "<tr><th scope=\"row\">" + std::to_string(i + 1) + "</th>" +
            with_sigma(RowValueKind::kLength, rows[i].length_mm, sigma.length_mm);
    if (!last) {
      // The first rotation is 0 by convention and not measured.
      html += i == 0
                  ? "<td></td><td></td>"
                  : with_sigma(RowValueKind::kRotation, rows[i].rotation_deg, sigma.rotation_deg);
      html += with_sigma(RowValueKind::kAngle, rows[i].angle_deg, sigma.angle_deg) +
              with_sigma(RowValueKind::kBendRadius, rows[i].bend_radius_mm.value_or(std::nan("")),
                         sigma.bend_radius_mm.value_or(std::nan("")));
    }
    html += "</tr>\n";
  }
  return html + "</tbody></table>" + Legend(unknown);
}

std::string List(const std::vector<std::string>& sentences, const char* css) {
  if (sentences.empty()) return "";
  std::string html = "<ul class=\"" + std::string(css) + "\">";
  for (const auto& sentence : sentences) html += "<li>" + Escape(sentence) + "</li>";
  return html + "</ul>";
}

std::string Card(const char* title, const std::string& body) {
  if (body.empty()) return "";
  return "<section class=\"card\"><h3>" + std::string(title) + "</h3>" + body + "</section>\n";
}

std::string Fact(const char* name, const std::string& value) {
  return "<div><dt>" + std::string(name) + "</dt><dd>" + value + "</dd></div>";
}

std::string InspectionBody(const RunResult& run) {
  if (!run.inspection) return "";
  const auto& in = *run.inspection;
  std::string html = List(in.reasons, "reasons");
  if (in.reasons.empty()) html = "<p>Every judged number is inside its limit.</p>";
  html += "<p>" + Escape(in.direction.message) + "</p>";
  if (in.rows.empty()) return html;
  const StateMark surface = MarkOf(in.surface.state);
  html += "<dl>" +
          Fact("Surface, 99 % below",
               Fixed(in.surface.p99_abs_mm, 3) +
                   (in.surface.tolerance_mm ? " of " + Fixed(*in.surface.tolerance_mm, 2) : "") +
                   " mm <span class=\"state " + surface.css + "\">" + surface.mark + " " +
                   surface.word + "</span>") +
          Fact("Surface, largest", Fixed(in.surface.max_abs_mm, 3) + " mm") +
          Fact("Tangent points, largest", Fixed(in.envelope_max_mm, 3) + " mm") +
          Fact("Pipe radius", Fixed(in.pipe_radius_mm.measured, 3) + " mm (nominal " +
                                  Fixed(in.pipe_radius_mm.nominal, 3) + " mm)") +
          "</dl>";
  html +=
      "<details><summary>Tangent points and ends</summary><table><thead><tr><th>point</th>"
      "<th class=\"n\">distance <small>mm</small></th><th class=\"n\">&#177;</th><th></th></tr>"
      "</thead><tbody>";
  for (const auto& point : in.envelope) {
    html += "<tr class=\"" + std::string(MarkOf(point.state).css) + "\"><th scope=\"row\">" +
            Escape(point.name) + "</th>" + Number(point.distance_mm) + Number(point.sigma_mm) +
            StateCell(point.state) + "</tr>";
  }
  return html + "</tbody></table></details>";
}

std::string CorrectionBody(const RunResult& run) {
  if (!run.correction) return "";
  const auto& c = *run.correction;
  std::string html = "<p>" + Escape(OutcomeText(run)) + "</p>";
  // The largest change of angle, in words: what a setter asks first.
  const pipeline::RowCorrection* most = nullptr;
  std::size_t row = 0;
  for (std::size_t i = 0; i < c.rows.size(); ++i) {
    const double size = std::abs(c.rows[i].angle_deg.applied);
    if (size > (most ? std::abs(most->angle_deg.applied) : 0.0)) most = &c.rows[i], row = i + 1;
  }
  if (most) {
    const AxisCorrection& a = most->angle_deg;
    html += "<p>Largest change of angle: bend " + std::to_string(row) + " was " +
            Fixed(std::abs(a.deviation), 3) + "&#176; " + (a.deviation < 0 ? "over" : "under") +
            " its nominal. Believed to be the lot's and not this part's alone: " +
            Fixed(100 * a.gain, 0) + " %. So the command changes by " + Signed(a.applied, 3) +
            "&#176;, from " + Fixed(a.commanded, 3) + "&#176; to " + Fixed(a.corrected, 3) +
            "&#176;.</p>";
  }
  if (const std::string forecast = ForecastLine(run); !forecast.empty()) {
    html += "<p>" + Escape(forecast) + ".</p>";
  }
  return html + List(c.refusals, "bad") + List(c.notices, "notes");
}

std::string InterlocksBody(const RunResult& run) {
  if (!run.interlocks || run.interlocks->checks.empty()) return "";
  std::string html = "<ul class=\"checks\">";
  for (const auto& check : run.interlocks->checks) {
    html += "<li class=\"" + std::string(check.passed ? "in" : "out") +
            "\"><span class=\"mark\" aria-hidden=\"true\">" + (check.passed ? "\u2713" : "\u2717") +
            "</span><span class=\"sr\">" + (check.passed ? "passed" : "refused") + ": </span>" +
            Escape(check.sentence) + "</li>";
  }
  return html + "</ul>";
}

std::string FitBody(const RunResult& run) {
  const auto& m = run.measurement;
  std::string html = "<dl>" + Fact("Samples used", std::to_string(m.fit.samples)) +
                     Fact("Left out", std::to_string(m.fit.outliers)) +
                     Fact("Distance, median", Fixed(m.fit.median_abs_distance_mm, 3) + " mm") +
                     Fact("Distance, rms", Fixed(m.fit.rms_distance_mm, 3) + " mm") +
                     Fact("Distance, 95 % below", Fixed(m.fit.p95_abs_distance_mm, 3) + " mm") +
                     Fact("Noise of a sample", Fixed(m.noise_mm, 3) + " mm") +
                     Fact("Pipe radius", Fixed(m.tube.pipe_radius_mm, 3) + " +- " +
                                             Fixed(m.pipe_radius_sigma_mm, 3) + " mm") +
                     Fact("Longest gap", Fixed(m.longest_gap_mm, 1) + " mm") + "</dl>";
  const double coverage = std::clamp(std::isfinite(m.coverage) ? m.coverage : 0.0, 0.0, 1.0);
  html += "<p class=\"meter\">Coverage of the spine " + Fixed(100 * m.coverage, 1) +
          " %<span><i style=\"width:" + Fixed(100 * coverage, 1) + "%\"></i></span></p>";
  return html + List(TogetherLines(run), "notes") + List(m.warnings, "notes");
}

// Columns of one of the tables below.
std::string HeadOf(std::initializer_list<const char*> columns) {
  std::string html = "<table><thead><tr>";
  for (const char* column : columns) html += "<th class=\"n\">" + std::string(column) + "</th>";
  return html + "</tr></thead><tbody>";
}

std::string StraightnessTable(std::span<const pipeline::StraightForm> straights) {
  std::string rows;
  for (std::size_t i = 0; i < straights.size(); ++i) {
    const pipeline::StraightForm& straight = straights[i];
    if (!(straight.length_mm > 0)) continue;
    // As the trade says it; of what may be noise nothing is said.
    const bool is_seen = straight.height_mm > 2.0 * straight.sigma_mm;
    rows += "<tr>" + Number(static_cast<double>(i + 1), 0) + Number(straight.height_mm) +
            Number(straight.sigma_mm) + "<td class=\"n\">" +
            (is_seen ? "L/" + Fixed(straight.length_mm / straight.height_mm, 0) : "") +
            "</td></tr>";
  }
  if (rows.empty()) return "";
  return "<p>Straightness, against the best-fit line</p>" +
         HeadOf({"straight", "height <small>mm</small>", "&#177;", "of its length"}) + rows +
         "</tbody></table>";
}

std::string EasingTable(std::span<const pipeline::BendEasing> easings) {
  if (easings.empty()) return "";
  std::string html = "<p>Length over which a bend's curvature rises, and falls again</p>" +
                     HeadOf({"bend", "easing <small>mm</small>", "&#177;"});
  for (std::size_t i = 0; i < easings.size(); ++i) {
    html += "<tr>" + Number(static_cast<double>(i + 1), 0) + Number(easings[i].length_mm, 2) +
            Number(easings[i].length_sigma_mm, 2) + "</tr>";
  }
  return html + "</tbody></table>";
}

std::string DentTable(std::span<const pipeline::DentFound> dents) {
  if (dents.empty()) return "";
  std::string html =
      "<p>Dents; the area is that where they are at least half as deep</p>" +
      HeadOf({"along <small>mm</small>", "&#177;", "around <small>deg</small>", "&#177;",
              "depth <small>mm</small>", "&#177;", "area <small>mm&#178;</small>", "&#177;"});
  for (const pipeline::DentFound& dent : dents) {
    html += "<tr>" + Number(dent.along_mm, 1) + Number(dent.along_sigma_mm, 1) +
            Number(dent.around_deg, 1) + Number(dent.around_sigma_deg, 1) +
            Number(dent.depth_mm, 2) + Number(dent.sigma_mm, 2) + Number(dent.area_mm2, 1) +
            Number(dent.area_sigma_mm2, 1) + "</tr>";
  }
  return html + "</tbody></table>";
}

std::string SeamTable(const std::optional<pipeline::SeamFound>& seam) {
  if (!seam) return "";
  return "<p>Weld seam; where it lies around is counted on the first straight</p>" +
         HeadOf({"around <small>deg</small>", "&#177;", "height <small>mm</small>", "&#177;",
                 "width <small>mm</small>"}) +
         "<tr>" + Number(seam->around_deg, 1) + Number(seam->around_sigma_deg, 1) +
         Number(seam->height_mm, 3) + Number(seam->sigma_mm, 3) + Number(seam->width_mm, 1) +
         "</tr></tbody></table>";
}

std::string WrinkleTable(const std::vector<pipeline::WrinklesFound>& wrinkles) {
  if (wrinkles.empty()) return "";
  std::string html = "<p>Wrinkles on the inner sides of bends, from crest to trough</p>" +
                     HeadOf({"bend", "height <small>mm</small>", "&#177;"});
  for (const pipeline::WrinklesFound& of : wrinkles) {
    html += "<tr>" + Number(static_cast<double>(of.bend + 1), 0) + Number(of.height_mm, 3) +
            Number(of.sigma_mm, 3) + "</tr>";
  }
  return html + "</tbody></table>";
}

// Bevels, burrs and borders that no plane is.
std::string EdgeTable(const pipeline::TubeFeaturesFound& features) {
  std::string rows;
  const auto row = [&](const std::string& what, double value, double sigma, double around_deg) {
    rows += "<tr><td>" + what + "</td>" + Number(value, 2) + Number(sigma, 2) +
            (std::isnan(around_deg) ? "<td></td>" : Number(around_deg, 0)) + "</tr>";
  };
  for (const auto* end : {&features.first_end, &features.last_end}) {
    if (!*end) continue;
    const std::string which = end == &features.first_end ? "first, " : "last, ";
    if ((*end)->bevel) {
      const pipeline::BevelFound& bevel = *(*end)->bevel;
      row(which + "bevel, along the tube", bevel.length_mm, bevel.length_sigma_mm, NAN);
      row(which + "bevel, depth", bevel.depth_mm, bevel.depth_sigma_mm, NAN);
    }
    if ((*end)->burr) {
      row(which + "burr, where highest", (*end)->burr->height_mm, (*end)->burr->sigma_mm,
          (*end)->burr->around_deg);
    }
    if ((*end)->border.empty()) continue;
    const auto [least, most] =
        std::minmax_element((*end)->border.begin(), (*end)->border.end(),
                            [](const pipeline::BorderPlace& a, const pipeline::BorderPlace& b) {
                              return a.beyond_mm < b.beyond_mm;
                            });
    row(which + "border, farthest beyond its plane", most->beyond_mm, most->sigma_mm,
        most->around_deg);
    row(which + "border, farthest before it", least->beyond_mm, least->sigma_mm, least->around_deg);
  }
  if (rows.empty()) return "";
  return "<p>Edges of the ends</p>" +
         HeadOf({"end", "<small>mm</small>", "&#177;", "at <small>deg</small>"}) + rows +
         "</tbody></table>";
}

std::string EndTable(const pipeline::TubeFeaturesFound& features) {
  std::string rows;
  for (const auto* end : {&features.first_end, &features.last_end}) {
    if (!*end) continue;
    rows += std::string("<tr><td>") + (end == &features.first_end ? "first" : "last") + "</td>" +
            Number((*end)->cut.obliquity_deg, 2) + Number((*end)->obliquity_sigma_deg, 2) +
            Number((*end)->cut.around_deg, 0) + "</tr>";
  }
  if (rows.empty()) return "";
  return "<p>How the ends are cut</p>" +
         HeadOf({"end", "oblique <small>deg</small>", "&#177;", "longest at <small>deg</small>"}) +
         rows + "</tbody></table>" + EdgeTable(features);
}

// Beads, flares and what else is wider than the pipe.
std::string EndFormTable(const pipeline::Measurement& m) {
  std::string rows;
  for (const auto* end : {&m.first_end, &m.last_end}) {
    if (end->profile.empty()) continue;
    const pipeline::RadiusAt& widest = end->Widest();
    const bool is_bead = end->is_bead();
    rows += std::string("<tr><td>") + (end == &m.first_end ? "first" : "last") +
            (is_bead ? ", bead" : "") + "</td>" + Number(end->begins_mm, 2) +
            Number(end->begins_sigma_mm, 2) +
            (is_bead ? Number(end->returns_mm, 2) + Number(end->returns_sigma_mm, 2)
                     : "<td></td><td></td>") +
            Number(widest.radius_mm, 2) + Number(widest.sigma_mm, 2) + "<td>" +
            EndProfileSvg(*end, m.tube.pipe_radius_mm) + "</td></tr>";
  }
  if (rows.empty()) return "";
  return "<p>Ends that are wider than the pipe, counted from the end</p>" +
         HeadOf({"end", "begins <small>mm</small>", "&#177;",
                 "back at the pipe's <small>mm</small>", "&#177;", "radius <small>mm</small>",
                 "&#177;", "radius by place"}) +
         rows + "</tbody></table>";
}

std::string OpeningTable(const pipeline::Measurement& m) {
  if (m.features.openings.empty()) return "";
  const double length_mm = hal::SpineLength(m.tube.program);
  std::string html = "<p>Holes and slots</p>" +
                     HeadOf({"", "from the end <small>mm</small>", "&#177;",
                             "around <small>deg</small>", "&#177;", "size <small>mm</small>",
                             "&#177;", "width <small>mm</small>", "axis <small>deg</small>"});
  for (const pipeline::OpeningFound& found : m.features.openings) {
    const hal::WallOpening& opening = found.opening;
    const bool from_end = opening.along_mm > 0.5 * length_mm;
    html += std::string("<tr><td>") + (opening.is_hole() ? "hole" : "slot") +
            (from_end ? ", last end" : ", first end") + "</td>" +
            Number(from_end ? length_mm - opening.along_mm : opening.along_mm, 2) +
            Number(found.sigma.along_mm, 2) + Number(opening.around_deg, 1) +
            Number(found.sigma.around_deg, 1) + Number(opening.length_mm, 2) +
            Number(found.sigma.length_mm, 2);
    html += opening.is_hole() ? "<td></td><td></td>"
                              : Number(opening.width_mm, 2) + Number(opening.axis_deg, 1);
    html += "</tr>";
  }
  return html + "</tbody></table>";
}

// What the tube is beside lines, arcs and one section.
std::string FormBody(const RunResult& run) {
  const auto& m = run.measurement;
  return StraightnessTable(m.straights) + EasingTable(m.bend_easings) + EndTable(m.features) +
         EndFormTable(m) + OpeningTable(m) + DentTable(m.dents) + SeamTable(m.seam) +
         WrinkleTable(m.wrinkles) + UnrolledSvg(m);
}

std::string TimingBody(const RunResult& run) {
  double most = 0;
  for (const auto& stage : run.measurement.timing) most = std::max(most, stage.ms);
  if (!(most > 0)) return "";
  std::string html = "<table class=\"timing\"><tbody>";
  for (const auto& stage : run.measurement.timing) {
    html += "<tr><th scope=\"row\">" + Escape(stage.stage) + "</th><td class=\"n\">" +
            Fixed(stage.ms, 1) +
            " <small>ms</small></td><td class=\"meter\"><span><i "
            "style=\"width:" +
            Fixed(100 * std::clamp(stage.ms / most, 0.0, 1.0), 1) + "%\"></i></span></td></tr>";
  }
  return html + "</tbody></table>";
}

std::string Developers(const RunResult& run) {
  const std::string timing = TimingBody(run);
  if (timing.empty()) return "";
  return "<details class=\"developers\"><summary>For developers: how long each step "
         "took</summary>" +
         timing + "</details>\n";
}

}  // namespace

std::string PartNumber(const RunResult& run, std::size_t index) {
  const std::string& name = run.session;
  const std::size_t last = name.find_last_not_of("0123456789");
  const std::size_t from = name.find_first_not_of('0', last == std::string::npos ? 0 : last + 1);
  const bool numbered = last != std::string::npos && last > 0 && name[last] == '-';
  constexpr std::size_t kLongest = 9;  // a date and time is no number of a part
  if (!numbered || from == std::string::npos || name.size() - from > kLongest) {
    return std::to_string(index + 1);
  }
  return name.substr(from);
}

std::string OutcomeText(const RunResult& run) {
  if (run.bender && run.bender->outcome == CommitOutcome::kCommitted) {
    return "Corrected program committed as sequence " + std::to_string(run.bender->sequence) + ".";
  }
  if (run.bender) {
    return "The correction was not committed (" + std::string(Word(run.bender->outcome)) +
           "): " + run.bender->reason;
  }
  if (run.correction && run.correction->refused()) return "Correction refused; nothing was sent.";
  if (run.interlocks) {
    const auto& checks = run.interlocks->checks;
    const auto failed =
        std::find_if(checks.begin(), checks.end(), [](const auto& check) { return !check.passed; });
    if (failed != checks.end()) return "Refused, nothing was sent: " + failed->sentence;
  }
  if (run.correction && !run.correction->changes_anything) return "No correction needed.";
  return run.correction ? "The correction was not sent." : "";
}

std::string RowsHtml(const RunResult& run) {
  if (!run.inspection || run.inspection->rows.empty()) return MeasuredOnly(run.measurement);
  const auto& rows = run.inspection->rows;
  const bool corrected = run.correction && run.correction->rows.size() == rows.size();
  std::string html =
      "<table class=\"rows\"><thead><tr><th>row</th><th></th><th class=\"n spare\">nominal</th>"
      "<th class=\"n\">measured</th><th class=\"n spare\">&#177;1&#963;</th>"
      "<th class=\"n\">deviation</th><th class=\"n spare\">limit</th><th class=\"dial\"></th>"
      "<th></th>";
  if (corrected) {
    html +=
        "<th class=\"n spare\">commanded</th><th class=\"n spare\">corrected</th>"
        "<th class=\"n spare\">change</th><th class=\"spare\"></th>";
  }
  html += "</tr></thead>\n";
  bool unknown = false;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const pipeline::RowCorrection* c = corrected ? &run.correction->rows[i] : nullptr;
    const bool last = i + 1 == rows.size();
    std::size_t lines = 1;
    if (!last) lines = (i > 0 ? 3 : 2) + (rows[i].bend_radius_mm ? 1 : 0);
    std::string head = "<th scope=\"rowgroup\" class=\"row\" rowspan=\"" + std::to_string(lines) +
                       "\">" + std::to_string(i + 1) + "</th>";
    html += "<tbody>";
    const auto add = [&](RowValueKind kind, const Deviation& d, const AxisCorrection* correction) {
      html += AxisRow(kind == RowValueKind::kLength ? head : "", kind, d, corrected, correction,
                      unknown);
    };
    add(RowValueKind::kLength, rows[i].length_mm, c ? &c->length_mm : nullptr);
    if (!last && i > 0) {
      add(RowValueKind::kRotation, rows[i].rotation_deg, c ? &c->rotation_deg : nullptr);
    }
    if (!last) {
      add(RowValueKind::kAngle, rows[i].angle_deg, c ? &c->angle_deg : nullptr);
      if (rows[i].bend_radius_mm) add(RowValueKind::kBendRadius, *rows[i].bend_radius_mm, nullptr);
    }
    html += "</tbody>\n";
  }
  return html + "</table>" + Legend(unknown);
}

std::string CardsHtml(const RunResult& run) {
  return Card("Inspection", InspectionBody(run)) + Card("Correction", CorrectionBody(run)) +
         Card("Interlocks", InterlocksBody(run)) + Card("Form", FormBody(run)) +
         Card("Fit", FitBody(run)) + Developers(run);
}

}  // namespace bendloop::host
