// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/report/report.h"

#include <algorithm>
#include <cmath>

#include "firmware-host/report/assets.h"
#include "firmware-host/report/html.h"
#include "firmware-host/report/part_html.h"
#include "firmware-host/report/scene.h"
#include "firmware-host/report/trend_svg.h"
#include "firmware-host/report/views_svg.h"
#include "firmware-host/text/table.h"

namespace bendloop::host {
namespace {

// Nothing may be loaded from anywhere, whatever a name in the data says.
constexpr const char* kPolicy =
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data:";

constexpr const char* kThreeLicence =
    "<!-- This page contains three.js r111 and its OrbitControls.\n"
    "Copyright (c) 2010-2019 three.js authors. MIT License.\n"
    "Permission is hereby granted, free of charge, to any person obtaining a copy of this "
    "software\n"
    "and associated documentation files (the \"Software\"), to deal in the Software without\n"
    "restriction, including without limitation the rights to use, copy, modify, merge, publish,\n"
    "distribute, sublicense, and/or sell copies of the Software, and to permit persons to whom "
    "the\n"
    "Software is furnished to do so, subject to the following conditions:\n"
    "The above copyright notice and this permission notice shall be included in all copies or\n"
    "substantial portions of the Software.\n"
    "THE SOFTWARE IS PROVIDED \"AS IS\", WITHOUT WARRANTY OF ANY KIND, EXPRESS OR IMPLIED,\n"
    "INCLUDING BUT NOT LIMITED TO THE WARRANTIES OF MERCHANTABILITY, FITNESS FOR A PARTICULAR\n"
    "PURPOSE AND NONINFRINGEMENT. IN NO EVENT SHALL THE AUTHORS OR COPYRIGHT HOLDERS BE LIABLE "
    "FOR\n"
    "ANY CLAIM, DAMAGES OR OTHER LIABILITY, WHETHER IN AN ACTION OF CONTRACT, TORT OR OTHERWISE,\n"
    "ARISING FROM, OUT OF OR IN CONNECTION WITH THE SOFTWARE OR THE USE OR OTHER DEALINGS IN THE\n"
    "SOFTWARE. -->\n";

std::string Badge(const RunResult& run) {
  if (!run.inspection) return "<span class=\"badge none\">Measured</span>";
  const StateMark mark = MarkOf(run.inspection->verdict);
  return "<span class=\"badge " + std::string(mark.css) + "\"><span aria-hidden=\"true\">" +
         mark.mark + "</span> " + mark.word + "</span>";
}

// "2026-11-21 07:32:27 UTC" for ISO 8601 as recordings write it; anything else as it stands.
std::string ReadableTime(const std::string& time) {
  if (time.size() < 20 || time[10] != 'T' || time.back() != 'Z') return time;
  return time.substr(0, 10) + " " + time.substr(11, 8) + " UTC";
}

// The row's number that is furthest from its nominal, in words.
std::string Worst(const RunResult& run, pipeline::Deviation pipeline::RowInspection::*value,
                  const char* unit) {
  if (!run.inspection || run.inspection->rows.empty()) return "-";
  double most = 0;
  for (const auto& row : run.inspection->rows) {
    const double deviation = (row.*value).deviation;
    if (std::abs(deviation) > std::abs(most)) most = deviation;
  }
  return Signed(most, 3) + " " + unit;
}

std::string SelectorHtml(std::span<const RunResult> runs) {
  std::string html =
      "<section class=\"parts\"><h2>Parts</h2><div class=\"scroll\"><table><thead><tr>"
      "<th>part</th><th>verdict</th><th class=\"n\">worst angle</th>"
      "<th class=\"n wide\">worst length</th><th class=\"n wide\">worst rotation</th>"
      "<th class=\"n wide\">surface, 99 %</th><th class=\"wide\">scan</th>"
      "<th class=\"wide\">correction</th></tr></thead><tbody>\n";
  for (std::size_t i = 0; i < runs.size(); ++i) {
    const RunResult& run = runs[i];
    const std::string number = PartNumber(run, i);
    const bool compared = run.inspection && !run.inspection->rows.empty();
    html += "<tr data-part=\"" + std::to_string(i) + "\" data-number=\"" + number +
            "\"><th scope=\"row\"><button type=\"button\">" + number + "</button></th><td>" +
            Badge(run) + "</td><td class=\"n\">" +
            Worst(run, &pipeline::RowInspection::angle_deg, "&#176;") +
            "</td><td class=\"n wide\">" + Worst(run, &pipeline::RowInspection::length_mm, "mm") +
            "</td><td class=\"n wide\">" +
            Worst(run, &pipeline::RowInspection::rotation_deg, "&#176;") +
            "</td><td class=\"n wide\">" +
            (compared ? Fixed(run.inspection->surface.p99_abs_mm, 3) + " mm" : "-") +
            "</td><td class=\"wide\">" +
            Escape(run.time.empty() ? run.session : ReadableTime(run.time)) +
            "</td><td class=\"wide\">" + Escape(OutcomeText(run)) + "</td></tr>\n";
  }
  return html + "</tbody></table></div></section>\n";
}

std::string PartHtml(const RunResult& run, const Scene& scene, std::size_t index, bool shown,
                     double scale_mm) {
  const std::string number = PartNumber(run, index);
  return "<article class=\"part\" data-part=\"" + std::to_string(index) + "\"" +
         (shown ? "" : " hidden") + "><h2>Part " + number + " <small>" + Escape(run.session) +
         "</small></h2>\n<div class=\"views\">" + ViewsSvg(scene, scale_mm) +
         "</div>\n<div class=\"scroll\">" + RowsHtml(run) + "</div>\n<div class=\"cards\">" +
         CardsHtml(run) + "</div></article>\n";
}

std::string ViewerHtml(const std::string& bars, bool compared) {
  return "<section class=\"viewer\"><div class=\"tools\" role=\"toolbar\" aria-label=\"picture\">"
         "<label>Show <select id=\"mode\"><option value=\"tube\">fitted tube</option>"
         "<option value=\"points\">scanned points</option>"
         "<option value=\"both\">both</option></select></label>"
         "<label>Deviation drawn <select id=\"factor\"><option value=\"1\">as it is</option>"
         "<option value=\"5\">5 times</option><option value=\"20\">20 times</option></select>"
         "</label><label>Lengths <select id=\"unit\"><option value=\"mm\">mm</option>"
         "<option value=\"in\">inch</option></select></label>"
         "<label>Colours <select id=\"scale\"><option value=\"shared\">for all "
         "parts</option>"
         "<option value=\"own\">for this part</option></select></label>"
         "<label><input type=\"checkbox\" id=\"ghost\" checked> nominal</label>"
         "<span class=\"push\"></span><button type=\"button\" data-view=\"x\">side</button>"
         "<button type=\"button\" data-view=\"y\">front</button>"
         "<button type=\"button\" data-view=\"z\">top</button>"
         "<button type=\"button\" id=\"reset\">Reset view</button></div>"
         "<p class=\"fallback\">This browser shows no three-dimensional picture here (it has no "
         "WebGL, "
         "or runs no scripts). The three views below show the same tube in the same colours.</p>"
         "<div class=\"picture\"><div class=\"stage\"><div id=\"canvas\"></div><div id=\"labels\" "
         "aria-hidden=\"true\"></div><div id=\"readout\" role=\"status\"></div></div>"
         "<div class=\"legend\"><div><b>" +
         std::string(compared ? "Deviation from nominal" : "Distance from the fit") +
         "</b><small>+ outside, - inside the surface</small></div>" + bars +
         "</div></div>"
         "<p class=\"hint\">Drag to turn, wheel or pinch to zoom, right button or two fingers to "
         "move. Point at the tube to read a deviation.</p></section>\n";
}

std::string HeadHtml(const std::string& title) {
  std::string html =
      "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n"
      "<meta http-equiv=\"Content-Security-Policy\" content=\"";
  html += kPolicy;
  html += "\">\n<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<title>" +
          title + " - tube report</title>\n<style>\n";
  html += ReportCss();
  // Without a picture until the script has made one.
  html += "</style>\n</head>\n<body class=\"no-webgl\">\n";
  html += kThreeLicence;
  return html;
}

// What the head says of one part; only the chosen one's is shown.
std::string PartHead(const RunResult& run, std::size_t index, bool shown, std::size_t parts) {
  std::string html = "<div class=\"head\" data-part=\"" + std::to_string(index) + "\"" +
                     (shown ? "" : " hidden") + "><p>" + Escape(OutcomeText(run)) + "</p>" +
                     Badge(run) + "<dl>";
  const auto fact = [&](const char* name, const std::string& value) {
    if (!value.empty()) {
      html += "<div><dt>" + std::string(name) + "</dt><dd>" + Escape(value) + "</dd></div>";
    }
  };
  fact("Part", PartNumber(run, index) +
                   (parts > 1 ? ", one of " + std::to_string(parts) + " in this report" : ""));
  fact("Scan", ReadableTime(run.time));
  fact("Session", run.session);
  if (run.commanded) {
    fact("Bent with", "program " + std::to_string(run.commanded->part_number) + ", sequence " +
                          std::to_string(run.commanded->sequence));
  }
  fact("Software", run.software);
  return html + "</dl></div>";
}

// Nobody tells the daemon these: they are written into the page, or by hand on the paper.
std::string ByHandHtml() {
  std::string html = "<div class=\"by-hand\">";
  for (const char* name : {"Operator", "Lot", "Identity of the tube"}) {
    html += std::string("<label>") + name +
            " <input type=\"text\" autocomplete=\"off\" maxlength=\"60\"></label>";
  }
  return html + "</div>";
}

std::string HeaderHtml(const std::string& title, std::span<const RunResult> runs) {
  std::string html = "<header><h1>" + title + "</h1>";
  for (std::size_t i = 0; i < runs.size(); ++i) {
    html += PartHead(runs[i], i, i + 1 == runs.size(), runs.size());
  }
  return html + ByHandHtml() + "</header>\n";
}

// The colour bar that all parts share, and each part's own.
std::string BarsHtml(const std::vector<Scene>& scenes, double scale_mm, double tolerance_mm) {
  std::string bars = "<div data-bar=\"shared\">" + ColourBarSvg(scale_mm, tolerance_mm) + "</div>";
  for (std::size_t i = 0; i < scenes.size(); ++i) {
    bars += "<div data-bar=\"" + std::to_string(i) + "\" hidden>" +
            ColourBarSvg(ScaleMm(scenes[i]), tolerance_mm) + "</div>";
  }
  return bars;
}

std::string ScriptsHtml(const std::vector<Scene>& scenes, double scale_mm) {
  Json data = {{"scale_mm", scale_mm}, {"parts", Json::array()}};
  for (const Scene& scene : scenes) data["parts"].push_back(SceneJson(scene));
  std::string html = "<script type=\"application/json\" id=\"data\">" + ScriptSafe(Dump(data)) +
                     "</script>\n<script>";
  html += ThreeJs();
  html += "</script>\n<script>";
  html += OrbitJs();
  html += "</script>\n<script>";
  html += ReportJs();
  html += "</script>\n";
  return html;
}

}  // namespace

std::string ReportHtml(std::span<const RunResult> runs, const ReportOptions& options) {
  std::vector<Scene> scenes;
  const std::size_t most = std::min(options.most_samples_a_part,
                                    options.most_samples / std::max<std::size_t>(runs.size(), 1));
  for (const RunResult& run : runs) scenes.push_back(MakeScene(run, most));
  const RunResult empty;
  const RunResult& last = runs.empty() ? empty : runs.back();
  const double tolerance_mm =
      last.inspection ? last.inspection->surface.tolerance_mm.value_or(0) : 0;
  const double scale_mm = SharedScaleMm(scenes, tolerance_mm);
  const bool compared = !scenes.empty() && scenes.back().compared;
  const std::string title = Escape(!options.title.empty() ? options.title
                                   : last.part.empty()    ? "Tube"
                                                          : last.part);

  std::string html = HeadHtml(title) + HeaderHtml(title, runs) + "<main>\n";
  if (runs.size() > 1) html += SelectorHtml(runs);
  html += ViewerHtml(BarsHtml(scenes, scale_mm, tolerance_mm), compared);
  for (std::size_t i = 0; i < runs.size(); ++i) {
    html += PartHtml(runs[i], scenes[i], i, i + 1 == runs.size(), scale_mm);
  }
  if (const std::string trend = TrendSvg(runs); !trend.empty()) {
    html +=
        "<section class=\"trends\"><h2>From part to part</h2><p>Deviation from the nominal; "
        "bars are 1 sigma of the measurement.</p><div class=\"charts\">" +
        trend + "</div></section>\n";
  }
  html +=
      "</main>\n<footer>Lengths in mm, angles in degrees; &#177; is 1 sigma. Rotation is "
      "right-handed about the feed direction. Frame: the first straight along x, the first "
      "bend in the xy plane.</footer>\n";
  return html + ScriptsHtml(scenes, scale_mm) + "</body>\n</html>\n";
}

}  // namespace bendloop::host
