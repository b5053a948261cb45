// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/report/views_svg.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "firmware-host/report/html.h"
#include "firmware-host/text/table.h"

namespace bendloop::host {
namespace {

struct View {
  const char* name;
  int right;  // axis of the picture's x
  int up;     // axis of the picture's y
  int depth;  // axis that points at the reader
  double depth_sign;
};

constexpr View kViews[] = {
    {"front (x, z)", 0, 2, 1, -1}, {"top (x, y)", 0, 1, 2, 1}, {"side (y, z)", 1, 2, 0, 1}};

struct Box {
  double low[2] = {std::numeric_limits<double>::infinity(),
                   std::numeric_limits<double>::infinity()};
  double high[2] = {-std::numeric_limits<double>::infinity(),
                    -std::numeric_limits<double>::infinity()};

  void Add(double x, double y) {
    low[0] = std::min(low[0], x), low[1] = std::min(low[1], y);
    high[0] = std::max(high[0], x), high[1] = std::max(high[1], y);
  }
};

// The extreme deviation, sign kept, of the ring's half that faces the reader.
double RingDeviation(const Scene& scene, std::size_t ring, const View& view) {
  double extreme = 0;
  for (int k = 0; k < TubeMesh::kSides; ++k) {
    const std::size_t v = ring * TubeMesh::kSides + static_cast<std::size_t>(k);
    const double toward = view.depth_sign * (scene.measured.vertices[v][view.depth] -
                                             scene.measured.centers[ring][view.depth]);
    if (toward < 0 || v >= scene.deviation_mm.size()) continue;
    if (std::abs(scene.deviation_mm[v]) > std::abs(extreme)) extreme = scene.deviation_mm[v];
  }
  return extreme;
}

// The pieces between neighbouring centres: what is nearer to the reader is drawn later.
std::vector<std::size_t> FarPiecesFirst(const Scene& scene, const View& view) {
  const auto& centers = scene.measured.centers;
  std::vector<std::size_t> order(centers.empty() ? 0 : centers.size() - 1);
  for (std::size_t i = 0; i < order.size(); ++i) order[i] = i;
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return view.depth_sign * centers[a][view.depth] < view.depth_sign * centers[b][view.depth];
  });
  return order;
}

// What a view is drawn into: lettering and margins have the same size in all of them, whatever the
// tube's extents are. A unit is about a pixel of a desktop's page.
constexpr double kPictureWidth = 400, kPictureHeight = 300;
constexpr double kMargin = 22, kLettering = 14;  // units

std::string OneView(const Scene& scene, double scale_mm, const View& view) {
  Box box;
  for (const auto* mesh : {&scene.measured, &scene.nominal}) {
    for (const auto& v : mesh->vertices) box.Add(v[view.right], v[view.up]);
  }
  const double unit_mm =
      std::max({(box.high[0] - box.low[0]) / (kPictureWidth - 2 * kMargin),
                (box.high[1] - box.low[1]) / (kPictureHeight - 2 * kMargin), 1e-5});
  const double margin = kMargin * unit_mm;
  const double width = box.high[0] - box.low[0] + 2 * margin;
  const double height = box.high[1] - box.low[1] + 2 * margin;
  const auto x = [&](double value) { return Fixed(value - box.low[0] + margin, 2); };
  const auto y = [&](double value) { return Fixed(box.high[1] - value + margin, 2); };

  double pipe_mm = 1;
  if (!scene.measured.centers.empty()) {
    pipe_mm = 2 * (scene.measured.vertices[0] - scene.measured.centers[0]).norm();
  }
  std::string svg = "<figure><svg role=\"img\" aria-label=\"" + std::string(view.name) +
                    "\" viewBox=\"0 0 " + Fixed(width, 2) + " " + Fixed(height, 2) + "\">";
  // The nominal: its outline as a wide faint line under the measured one.
  if (!scene.nominal.centers.empty()) {
    svg += "<polyline class=\"ghost\" stroke-width=\"" + Fixed(pipe_mm + 2 * unit_mm, 2) +
           "\" points=\"";
    for (const auto& c : scene.nominal.centers) svg += x(c[view.right]) + "," + y(c[view.up]) + " ";
    svg += "\"/>";
  }
  svg += "<g class=\"tube\" stroke-width=\"" + Fixed(pipe_mm, 2) + "\">";
  for (const std::size_t i : FarPiecesFirst(scene, view)) {
    const auto &a = scene.measured.centers[i], &b = scene.measured.centers[i + 1];
    const std::string colour =
        scene.compared ? DeviationColour(RingDeviation(scene, i, view), scale_mm) : "#8fa3b3";
    svg += "<line x1=\"" + x(a[view.right]) + "\" y1=\"" + y(a[view.up]) + "\" x2=\"" +
           x(b[view.right]) + "\" y2=\"" + y(b[view.up]) + "\" stroke=\"" + colour + "\"/>";
  }
  svg += "</g>";
  // Numbers of the bends, and where the tube starts.
  const auto label = [&](const Eigen::Vector3d& at, const std::string& text) {
    svg += "<text font-size=\"" + Fixed(kLettering * unit_mm, 2) + "\" stroke-width=\"" +
           Fixed(0.3 * kLettering * unit_mm, 2) + "\" x=\"" + x(at[view.right]) + "\" y=\"" +
           y(at[view.up]) + "\">" + text + "</text>";
  };
  const auto& segments = scene.measured.segments;
  for (std::size_t i = 0; i < segments.size(); ++i) {
    std::size_t end = i;
    while (end + 1 < segments.size() && segments[end + 1] == segments[i]) ++end;
    if (segments[i] % 2) {
      label(scene.measured.centers[(i + end) / 2], std::to_string(segments[i] / 2 + 1));
    }
    i = end;
  }
  if (!scene.measured.centers.empty()) label(scene.measured.centers.front(), "start");
  return svg + "</svg><figcaption>" + view.name + "</figcaption></figure>";
}

}  // namespace

std::string ViewsSvg(const Scene& scene, double scale_mm) {
  Eigen::Vector3d low = Eigen::Vector3d::Constant(1e300), high = -low;
  for (const auto& v : scene.measured.vertices) low = low.cwiseMin(v), high = high.cwiseMax(v);
  if (scene.measured.vertices.empty() || !low.allFinite() || !high.allFinite()) return "";
  std::string out;
  for (const View& view : kViews) out += OneView(scene, scale_mm, view);
  return out;
}

std::string ColourBarSvg(double scale_mm, double tolerance_mm) {
  constexpr int kTop = 16, kHeight = 240;
  const int decimals = TickDecimals(scale_mm);
  // Every bar of a page defines the same gradient under the same name.
  std::string svg =
      "<svg class=\"bar\" role=\"img\" aria-label=\"colour bar, mm\" viewBox=\"0 0 106 272\"><defs>"
      "<linearGradient id=\"rdbu\" x1=\"0\" x2=\"0\" y1=\"0\" y2=\"1\">";
  for (int i = 0; i <= 6; ++i) {
    svg += "<stop offset=\"" + Fixed(i / 6.0, 4) + "\" stop-color=\"" +
           DeviationColour(1 - i / 3.0, 1) + "\"/>";
  }
  svg +=
      "</linearGradient></defs><rect x=\"8\" width=\"16\" y=\"16\" height=\"240\" "
      "fill=\"url(#rdbu)\"/>";
  const auto y = [&](double value) { return kTop + kHeight * (0.5 - value / (2 * scale_mm)); };
  for (const double part : {1.0, 0.5, 0.0, -0.5, -1.0}) {
    const std::string at = Fixed(y(part * scale_mm), 1);
    svg += "<line x1=\"24\" x2=\"29\" y1=\"" + at + "\" y2=\"" + at + "\"/><text x=\"33\" y=\"" +
           Fixed(y(part * scale_mm) + 4, 1) + "\">" +
           (part == 0 ? "0" : Signed(part * scale_mm, decimals)) +
           (part == 1 || part == -1 ? " mm" : "") + "</text>";
  }
  if (tolerance_mm > 0 && tolerance_mm < scale_mm) {
    for (const double sign : {1.0, -1.0}) {
      const std::string at = Fixed(y(sign * tolerance_mm), 1);
      svg += "<line class=\"tolerance\" x1=\"2\" x2=\"30\" y1=\"" + at + "\" y2=\"" + at +
             "\"/><path class=\"tolerance\" d=\"M2 " + Fixed(y(sign * tolerance_mm) - 4, 1) +
             "v8l6-4z\"/>";
    }
  }
  return svg + "</svg>";
}

}  // namespace bendloop::host
