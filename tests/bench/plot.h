// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <string>
#include <vector>

namespace bendloop::bench {

// Readable on the picture's white, apart for the colour-blind too.
namespace colour {
inline constexpr const char* kInk = "#222";
inline constexpr const char* kGrid = "#e4e4e4";
inline constexpr const char* kBar = "#c0392b";   // what is required
inline constexpr const char* kGoal = "#2e8b57";  // goals
// For series, in this order.
inline constexpr const char* kSeries[] = {"#1f5fa8", "#d1660f", "#7b4aa3",
                                          "#4a9fc4", "#a08400", "#5f6b75"};
const char* OfSeries(std::size_t index);
}  // namespace colour

struct PlotPoint {
  double x = 0;
  double y = 0;
};

struct Axis {
  std::string label;  // with its unit; empty where the title says it
  double low = 0;
  double high = 1;
  bool log = false;
};
// From 0 to a little more than `most`.
Axis LinearAxis(std::string label, double most);
// From the 1, 2 or 5 times a power of ten below `least` to the one above `most`; both positive.
Axis LogAxis(std::string label, double least, double most);

enum class LineStyle { kFull, kDashed, kDotted };

// An SVG that is legible on light and dark pages: it brings its own white sheet.
class Picture {
 public:
  Picture(double width, double height);
  // x and y from the upper left corner; anchor: "start", "middle" or "end".
  void Text(double x, double y, const std::string& text, const char* anchor = "start",
            const char* colour = colour::kInk, bool bold = false);
  // Along the left side of something: turned to read upwards, middle at (x, y).
  void TurnedText(double x, double y, const std::string& text);
  void Rect(double x, double y, double width, double height, const char* fill,
            const char* stroke = "none");
  void Line(std::span<const PlotPoint> page, const char* colour, LineStyle style, double width);
  void Dot(const PlotPoint& page, const char* colour);
  std::string Svg() const;

 private:
  std::string body_;
  double width_;
  double height_;
};

// One line of a legend.
struct LegendEntry {
  std::string name;
  const char* colour;
  LineStyle style = LineStyle::kFull;
  bool dots = false;
};
// In a row, the first at (x, y). Ends where the next entry would begin.
double DrawLegend(Picture& picture, double x, double y, std::span<const LegendEntry> entries);

// A box with axes in which values are drawn. Title and labels stand outside the box.
class Panel {
 public:
  struct Box {
    double x, y, width, height;  // the frame, without title and labels
  };
  Panel(Picture& picture, const Box& box, const std::string& title, Axis x, Axis y);

  void Line(std::span<const PlotPoint> values, const char* colour,
            LineStyle style = LineStyle::kFull);
  void Dots(std::span<const PlotPoint> values, const char* colour);
  // How many values lie in each of `bins` equal parts of the x axis; what is beyond its end counts
  // as the last part.
  void Histogram(std::span<const double> values, int bins, const char* colour);
  // A line right across: at one x, or at one y.
  void AtX(double x, const char* colour, LineStyle style = LineStyle::kFull);
  void AtY(double y, const char* colour, LineStyle style = LineStyle::kFull);
  // A short stroke across one point: a target that holds there only.
  void Target(const PlotPoint& value, const char* colour);

 private:
  void DrawAxes();
  PlotPoint Page(const PlotPoint& value) const;

  Picture& picture_;
  Box box_;
  Axis x_, y_;
};

}  // namespace bendloop::bench
