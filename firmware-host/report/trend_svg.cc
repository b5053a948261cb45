// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/report/trend_svg.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "firmware-host/report/html.h"
#include "firmware-host/report/part_html.h"
#include "firmware-host/text/table.h"

namespace bendloop::host {
namespace {

using pipeline::Deviation;

struct Axis {
  const char* title;
  const char* unit;
  const char* series;  // "bend" or "row"
  Deviation pipeline::RowInspection::*value;
  std::size_t first;  // row
  bool last;          // whether the last row has this number
};

constexpr Axis kAxes[] = {
    {"Bend angle", "deg", "bend", &pipeline::RowInspection::angle_deg, 0, false},
    {"Length", "mm", "row", &pipeline::RowInspection::length_mm, 0, true},
    {"Rotation", "deg", "bend", &pipeline::RowInspection::rotation_deg, 1, false}};

// Okabe and Ito's colours, which differ for every colour vision; the markers differ as well.
constexpr std::array<const char*, 6> kColours = {"#0072b2", "#d55e00", "#009e73",
                                                 "#cc79a7", "#e69f00", "#56b4e9"};

std::string Marker(std::size_t series, double x, double y, const std::string& title) {
  const std::string tip = title.empty() ? "" : "<title>" + Escape(title) + "</title>";
  const std::string paint =
      " fill=\"" + std::string(kColours[series % kColours.size()]) + "\">" + tip;
  const auto path = [&](const char* d) {
    return "<path transform=\"translate(" + Fixed(x, 1) + " " + Fixed(y, 1) + ")\" d=\"" + d +
           "\"" + paint + "</path>";
  };
  switch (series % 5) {
    case 0:
      return path("M-4 0a4 4 0 1 0 8 0a4 4 0 1 0 -8 0z");
    case 1:
      return path("M-3.6-3.6h7.2v7.2h-7.2z");
    case 2:
      return path("M0-4.8l4.6 8.2h-9.2z");
    case 3:
      return path("M0-5l5 5l-5 5l-5-5z");
    default:
      return path("M0 4.8l4.6-8.2h-9.2z");
  }
}

double NiceCeil(double value) {
  for (double decade = 1e-3; decade < 1e9; decade *= 10) {
    for (const double step : {1.0, 2.0, 4.0, 6.0, 8.0}) {
      if (value <= step * decade) return step * decade;
    }
  }
  return value;
}

class Chart {
 public:
  Chart(const Axis& axis, const std::vector<const RunResult*>& runs, std::size_t rows)
      : axis_(axis), runs_(runs), last_row_(axis.last ? rows : rows - 1) {
    double most = 0;
    for (const RunResult* run : runs) {
      for (std::size_t r = axis.first; r < last_row_; ++r) {
        const Deviation& d = run->inspection->rows[r].*axis.value;
        if (std::isfinite(d.deviation)) most = std::max(most, std::abs(d.deviation) + Sigma(d));
        if (d.tolerance) tolerance_ = std::max(tolerance_, *d.tolerance);
      }
    }
    range_ = NiceCeil(std::max({most * 1.05, tolerance_ * 1.25, 0.01}));
  }

  bool empty() const { return last_row_ <= axis_.first; }

  std::string Svg() const {
    std::string svg = "<figure class=\"trend\"><h3>" + std::string(axis_.title) +
                      "</h3><svg role=\"img\" aria-label=\"" + axis_.title +
                      " deviation by part\" viewBox=\"0 0 440 236\">" + Frame();
    for (std::size_t r = axis_.first; r < last_row_; ++r) svg += Series(r);
    return svg + "</svg><figcaption>" + Legend() + "</figcaption></figure>";
  }

 private:
  static constexpr double kLeft = 58, kRight = 428, kTop = 10, kBottom = 196;

  static double Sigma(const Deviation& d) { return std::isfinite(d.sigma) ? d.sigma : 0; }
  double Y(double value) const {
    return (kTop + kBottom) / 2 - value / range_ * (kBottom - kTop) / 2;
  }
  double Slot() const { return (kRight - kLeft) / static_cast<double>(runs_.size()); }
  // Series stand side by side within a part's slot, so that their bars do not cover each other.
  double X(std::size_t part, std::size_t row) const {
    const double count = static_cast<double>(last_row_ - axis_.first);
    const double offset = (static_cast<double>(row - axis_.first) - (count - 1) / 2) / count;
    return kLeft + Slot() * (static_cast<double>(part) + 0.5 + 0.5 * offset);
  }

  std::string Frame() const {
    std::string svg;
    if (tolerance_ > 0) {
      svg += "<rect class=\"band\" x=\"58\" width=\"370\" y=\"" + Fixed(Y(tolerance_), 1) +
             "\" height=\"" + Fixed(Y(-tolerance_) - Y(tolerance_), 1) + "\"/>";
      for (const double sign : {1.0, -1.0}) {
        const std::string y = Fixed(Y(sign * tolerance_), 1);
        svg += "<line class=\"limit\" x1=\"58\" x2=\"428\" y1=\"" + y + "\" y2=\"" + y + "\"/>";
      }
    }
    const int decimals = TickDecimals(range_);
    for (const double part : {1.0, 0.5, 0.0, -0.5, -1.0}) {
      const std::string y = Fixed(Y(part * range_), 1);
      svg += "<line class=\"" + std::string(part == 0 ? "zero" : "grid") +
             "\" x1=\"58\" x2=\"428\" y1=\"" + y + "\" y2=\"" + y + "\"/><text x=\"52\" y=\"" +
             Fixed(Y(part * range_) + 4, 1) + "\" text-anchor=\"end\">" +
             (part == 0 ? "0" : Signed(part * range_, decimals)) + "</text>";
    }
    svg +=
        "<text class=\"unit\" transform=\"translate(12 103) rotate(-90)\" "
        "text-anchor=\"middle\">deviation, " +
        std::string(axis_.unit) + "</text>";
    // Not more part numbers than there is room for.
    const std::size_t every = 1 + (runs_.size() - 1) / 15;
    for (std::size_t i = 0; i < runs_.size(); i += every) {
      svg += "<text x=\"" + Fixed(kLeft + Slot() * (static_cast<double>(i) + 0.5), 1) +
             "\" y=\"214\" text-anchor=\"middle\">" + PartNumber(*runs_[i], i) + "</text>";
    }
    return svg + "<text x=\"243\" y=\"232\" text-anchor=\"middle\">part</text>";
  }

  std::string Series(std::size_t row) const {
    const std::size_t series = row - axis_.first;
    const std::string colour = kColours[series % kColours.size()];
    std::string line, marks;
    for (std::size_t i = 0; i < runs_.size(); ++i) {
      const Deviation& d = runs_[i]->inspection->rows[row].*axis_.value;
      if (!std::isfinite(d.deviation)) continue;
      const double x = X(i, row), y = Y(d.deviation);
      line += Fixed(x, 1) + "," + Fixed(y, 1) + " ";
      if (Sigma(d) > 0) {
        marks += "<path class=\"sigma\" stroke=\"" + colour + "\" d=\"M" + Fixed(x, 1) + " " +
                 Fixed(Y(d.deviation - d.sigma), 1) + "V" + Fixed(Y(d.deviation + d.sigma), 1) +
                 "\"/>";
      }
      marks += Marker(series, x, y,
                      "part " + PartNumber(*runs_[i], i) + ", " + axis_.series + " " +
                          std::to_string(row + 1) + ": " + Signed(d.deviation, 3) + " +- " +
                          Fixed(d.sigma, 3) + " " + axis_.unit);
    }
    return "<polyline class=\"series\" stroke=\"" + colour + "\" points=\"" + line + "\"/>" + marks;
  }

  std::string Legend() const {
    std::string html;
    for (std::size_t r = axis_.first; r < last_row_; ++r) {
      html +=
          "<span><svg viewBox=\"-6 -6 12 12\" width=\"12\" height=\"12\" aria-hidden=\"true\">" +
          Marker(r - axis_.first, 0, 0, "") + "</svg>" + axis_.series + " " +
          std::to_string(r + 1) + "</span>";
    }
    if (tolerance_ > 0) {
      html +=
          "<span><svg viewBox=\"0 0 16 12\" width=\"16\" height=\"12\" aria-hidden=\"true\">"
          "<rect class=\"band\" width=\"16\" height=\"12\"/></svg>tolerance &#177;" +
          Fixed(tolerance_, 2) + " " + axis_.unit + "</span>";
    }
    return html;
  }

  const Axis& axis_;
  const std::vector<const RunResult*>& runs_;
  std::size_t last_row_;
  double tolerance_ = 0;
  double range_ = 1;
};

}  // namespace

std::string TrendSvg(std::span<const RunResult> runs) {
  // Only parts of the same shape can stand in one chart: that of the newest.
  std::vector<const RunResult*> compared;
  for (const RunResult& run : runs) {
    if (run.inspection && !run.inspection->rows.empty()) compared.push_back(&run);
  }
  if (compared.empty()) return "";
  const std::size_t rows = compared.back()->inspection->rows.size();
  std::erase_if(compared, [&](const RunResult* r) { return r->inspection->rows.size() != rows; });
  std::string html;
  for (const Axis& axis : kAxes) {
    const Chart chart(axis, compared, rows);
    if (!chart.empty()) html += chart.Svg();
  }
  return html;
}

}  // namespace bendloop::host
