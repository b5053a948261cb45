// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/plot.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <iterator>
#include <utility>

namespace bendloop::bench {
namespace {

constexpr double kLetter = 6.3;    // mean width of a letter
constexpr double kBaseline = 4;    // from a text's middle to its baseline
constexpr double kTickLabel = 15;  // baseline below the box
constexpr double kAxisLabel = 30;

template <class... Values>
std::string Format(const char* format, Values... values) {
  std::array<char, 256> text{};
  std::snprintf(text.data(), text.size(), format, values...);
  return text.data();
}

std::string Escaped(const std::string& text) {
  std::string xml;
  for (const char c : text) {
    if (c == '&') {
      xml += "&amp;";
    } else if (c == '<') {
      xml += "&lt;";
    } else {
      xml += c;
    }
  }
  return xml;
}

// 1, 2 or 5 times a power of ten, not above `value`.
double RoundDown(double value) {
  const double decade = std::pow(10, std::floor(std::log10(value) + 1e-9));
  for (const double factor : {5.0, 2.0}) {
    if (factor * decade <= value * (1 + 1e-9)) return factor * decade;
  }
  return decade;
}

double RoundUp(double value) {
  const double down = RoundDown(value);
  if (down >= value * (1 - 1e-9)) return down;
  const double next = RoundDown(2.01 * down);
  return next > down * 1.5 ? next : RoundDown(2.6 * down);
}

std::string TickText(double value) {
  const double size = std::abs(value);
  if (size >= 1e6) return Format("%g M", value / 1e6);
  if (size >= 1e4) return Format("%g k", value / 1e3);
  return Format("%g", value);
}

// Places of ticks; on a long log axis only the decades, on a short one 2 and 5 as well.
std::vector<double> Ticks(const Axis& axis, int most) {
  std::vector<double> ticks;
  if (!axis.log) {
    const double step = RoundUp((axis.high - axis.low) / most);
    for (double k = std::ceil(axis.low / step - 1e-9); k * step <= axis.high * (1 + 1e-9) + 1e-12;
         ++k) {
      ticks.push_back(k == 0 ? 0.0 : k * step);  // never -0
    }
    return ticks;
  }
  const bool decades_only = axis.high / axis.low > 200;
  for (double tick = RoundUp(axis.low); tick <= axis.high * (1 + 1e-9);
       tick = RoundUp(tick * 1.01)) {
    const double decade = std::log10(tick);
    if (!decades_only || std::abs(decade - std::round(decade)) < 1e-6) ticks.push_back(tick);
  }
  return ticks;
}

double Place(const Axis& axis, double value) {  // 0 to 1
  if (!axis.log) return (value - axis.low) / (axis.high - axis.low);
  return std::log(std::max(value, 1e-300) / axis.low) / std::log(axis.high / axis.low);
}

}  // namespace

const char* colour::OfSeries(std::size_t index) { return kSeries[index % std::size(kSeries)]; }

Axis LinearAxis(std::string label, double most) {
  return {std::move(label), 0, most > 0 ? 1.08 * most : 1.0, false};
}

Axis LogAxis(std::string label, double least, double most) {
  return {std::move(label), RoundDown(least), RoundUp(most), true};
}

Picture::Picture(double width, double height) : width_(width), height_(height) {
  Rect(0, 0, width, height, "white");
}

void Picture::Text(double x, double y, const std::string& text, const char* anchor,
                   const char* colour, bool bold) {
  body_ += Format("<text x='%.1f' y='%.1f' text-anchor='%s' fill='%s'%s>", x, y, anchor, colour,
                  bold ? " font-weight='bold'" : "") +
           Escaped(text) + "</text>\n";
}

void Picture::TurnedText(double x, double y, const std::string& text) {
  body_ += Format(
               "<text transform='translate(%.1f %.1f) rotate(-90)' text-anchor='middle' "
               "fill='%s'>",
               x, y, colour::kInk) +
           Escaped(text) + "</text>\n";
}

void Picture::Rect(double x, double y, double width, double height, const char* fill,
                   const char* stroke) {
  body_ += Format("<rect x='%.1f' y='%.1f' width='%.1f' height='%.1f' fill='%s' stroke='%s'/>\n", x,
                  y, width, height, fill, stroke);
}

void Picture::Line(std::span<const PlotPoint> page, const char* colour, LineStyle style,
                   double width) {
  const char* dashes = style == LineStyle::kFull     ? ""
                       : style == LineStyle::kDashed ? " stroke-dasharray='7 4'"
                                                     : " stroke-dasharray='2 3'";
  body_ += Format("<polyline fill='none' stroke='%s' stroke-width='%.1f'%s points='", colour, width,
                  dashes);
  for (const PlotPoint& p : page) body_ += Format("%.1f,%.1f ", p.x, p.y);
  body_ += "'/>\n";
}

void Picture::Dot(const PlotPoint& page, const char* colour) {
  body_ += Format("<circle cx='%.1f' cy='%.1f' r='3' fill='%s'/>\n", page.x, page.y, colour);
}

std::string Picture::Svg() const {
  return Format(
             "<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 %.0f %.0f' width='%.0f' "
             "height='%.0f' font-family='Helvetica, Arial, sans-serif' font-size='12'>\n",
             width_, height_, width_, height_) +
         body_ + "</svg>\n";
}

double DrawLegend(Picture& picture, double x, double y, std::span<const LegendEntry> entries) {
  for (const LegendEntry& entry : entries) {
    const std::array<PlotPoint, 2> stroke = {PlotPoint{x, y - kBaseline},
                                             PlotPoint{x + 22, y - kBaseline}};
    if (!entry.dots) picture.Line(stroke, entry.colour, entry.style, 2);
    if (entry.dots) picture.Dot({x + 11, y - kBaseline}, entry.colour);
    picture.Text(x + 27, y, entry.name);
    x += 27 + kLetter * static_cast<double>(entry.name.size()) + 18;
  }
  return x;
}

Panel::Panel(Picture& picture, const Box& box, const std::string& title, Axis x, Axis y)
    : picture_(picture), box_(box), x_(std::move(x)), y_(std::move(y)) {
  DrawAxes();
  picture_.Text(box_.x, box_.y - 8, title);
}

PlotPoint Panel::Page(const PlotPoint& value) const {
  return {box_.x + box_.width * std::clamp(Place(x_, value.x), 0.0, 1.0),
          box_.y + box_.height * (1 - std::clamp(Place(y_, value.y), 0.0, 1.0))};
}

void Panel::DrawAxes() {
  const double bottom = box_.y + box_.height;
  double widest = 0;
  for (const double tick : Ticks(x_, static_cast<int>(box_.width / 42))) {
    AtX(tick, colour::kGrid);
    picture_.Text(Page({tick, y_.low}).x, bottom + kTickLabel, TickText(tick), "middle");
  }
  for (const double tick : Ticks(y_, static_cast<int>(box_.height / 24))) {
    AtY(tick, colour::kGrid);
    const std::string text = TickText(tick);
    widest = std::max(widest, kLetter * static_cast<double>(text.size()));
    picture_.Text(box_.x - 5, Page({x_.low, tick}).y + kBaseline, text, "end");
  }
  picture_.Rect(box_.x, box_.y, box_.width, box_.height, "none", "#999");
  picture_.Text(box_.x + box_.width / 2, bottom + kAxisLabel, x_.label, "middle");
  if (!y_.label.empty())
    picture_.TurnedText(box_.x - widest - 14, box_.y + box_.height / 2, y_.label);
}

void Panel::Line(std::span<const PlotPoint> values, const char* colour, LineStyle style) {
  std::vector<PlotPoint> page;
  page.reserve(values.size());
  for (const PlotPoint& value : values) page.push_back(Page(value));
  picture_.Line(page, colour, style, 1.8);
}

void Panel::Dots(std::span<const PlotPoint> values, const char* colour) {
  for (const PlotPoint& value : values) picture_.Dot(Page(value), colour);
}

void Panel::Histogram(std::span<const double> values, int bins, const char* colour) {
  std::vector<int> counts(static_cast<std::size_t>(bins), 0);
  for (const double value : values) {
    const double place = std::clamp(Place(x_, value), 0.0, 1.0) * bins;
    ++counts[std::min(counts.size() - 1, static_cast<std::size_t>(place))];
  }
  const double width = box_.width / bins;
  const double bottom = box_.y + box_.height;
  for (std::size_t i = 0; i < counts.size(); ++i) {
    if (counts[i] == 0) continue;
    const double top = Page({x_.low, static_cast<double>(counts[i])}).y;
    picture_.Rect(box_.x + width * static_cast<double>(i), top, width, bottom - top, colour);
  }
}

void Panel::AtX(double x, const char* colour, LineStyle style) {
  const double at = Page({x, y_.low}).x;
  const std::array<PlotPoint, 2> line = {PlotPoint{at, box_.y},
                                         PlotPoint{at, box_.y + box_.height}};
  picture_.Line(line, colour, style, 1);
}

void Panel::AtY(double y, const char* colour, LineStyle style) {
  const double at = Page({x_.low, y}).y;
  const std::array<PlotPoint, 2> line = {PlotPoint{box_.x, at}, PlotPoint{box_.x + box_.width, at}};
  picture_.Line(line, colour, style, 1);
}

void Panel::Target(const PlotPoint& value, const char* colour) {
  const PlotPoint at = Page(value);
  const std::array<PlotPoint, 2> line = {PlotPoint{at.x - 13, at.y}, PlotPoint{at.x + 13, at.y}};
  picture_.Line(line, colour, LineStyle::kFull, 3);
}

}  // namespace bendloop::bench
