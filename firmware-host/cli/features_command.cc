// SPDX-License-Identifier: Apache-2.0
#include <unistd.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <iostream>
#include <memory>
#include <vector>

#include "firmware-host/cad/step_file.h"
#include "firmware-host/cli/cloud_argument.h"
#include "firmware-host/cli/command.h"
#include "firmware-host/console/command_line.h"
#include "firmware-host/console/message.h"
#include "firmware-host/console/version.h"
#include "firmware-host/result/json.h"
#include "firmware-host/result/sections.h"
#include "firmware-host/text/style.h"
#include "firmware-host/text/table.h"
#include "firmware-host/workers/thread_workers.h"
#include "pipeline/features/feature_borders.h"

namespace bendloop::host {
namespace {

using pipeline::FeatureBorder;
using pipeline::FeatureBorders;
using pipeline::FeatureRegion;

struct FeaturesArguments {
  CloudArgument cloud;
  std::string json;
  std::string borders;
  pipeline::FeatureOptions options;
};

// Places on each piece in the CSV of the borders.
constexpr int kSamplesOfPiece = 16;

constexpr const char* kFeaturesFooter = R"(
Examples:
  bendloop features handle.ply
  bendloop features handle.ply --borders borders.csv --json features.json
  bendloop features handle.ply --borders borders.step
  bendloop features part.xyz --units m --normal-turn 20
  bendloop features casting.pcd --concavity 0.5 --json -

Finds regions on any cloud, tube or not, by how fast the normal turns and how
deep points lie below the convex hull, and writes their borders as piecewise
cubic rational Bezier curves with common tangents in their joints (Stamati &
Fudos 2008). "error/chord2" is their measure: mean squared error over squared
chord of the pieces. "+-" is 1 sigma of the curve across itself.

The CSV has a line for each control point (kind control, with its weight) and 16
sampled points a piece (kind sample). STEP (AP214, mm) has each border as one
rational B-spline and needs OpenCASCADE (bendloop-cad): exit code 4 where it is
not installed.

Reads PLY, PCD and XYZ/CSV text, - from standard input. Output is in mm.)";

std::string Triple(const Eigen::Vector3d& v, int decimals) {
  return Fixed(v.x(), decimals) + " " + Fixed(v.y(), decimals) + " " + Fixed(v.z(), decimals);
}

std::string Scientific(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.1e", value);
  return text;
}

std::string BesideText(const FeatureBorder& border) {
  return std::to_string(border.region + 1) + "|" +
         (border.beside < 0 ? "edge" : std::to_string(border.beside + 1));
}

std::string FeaturesText(const FeatureBorders& found, bool colour) {
  Table regions({{"region", Align::kRight},
                 {"kind"},
                 {"points", Align::kRight},
                 {"center mm", Align::kRight},
                 {"size mm", Align::kRight},
                 {"deep mm", Align::kDecimal}});
  for (std::size_t r = 0; r < found.regions.size(); ++r) {
    const FeatureRegion& region = found.regions[r];
    regions.Add({std::to_string(r + 1), region.concave ? "concave" : "surface",
                 std::to_string(region.points), Triple(region.center_mm, 1),
                 Triple(region.size_mm, 1), Fixed(region.depth_mm, 2)});
  }
  Table borders({{"border", Align::kRight},
                 {"between"},
                 {"line"},
                 {"points", Align::kRight},
                 {"pieces", Align::kRight},
                 {"corners", Align::kRight},
                 {"length mm", Align::kDecimal},
                 {"error/chord2", Align::kRight},
                 {"+- mm", Align::kDecimal},
                 {"gaps", Align::kRight},
                 {"arms", Align::kRight}});
  for (std::size_t b = 0; b < found.borders.size(); ++b) {
    const FeatureBorder& border = found.borders[b];
    const auto& curve = border.fit.curve;
    const auto corners = std::count(curve.corner.begin(), curve.corner.end(), true);
    borders.Add({std::to_string(b + 1), BesideText(border), curve.closed ? "closed" : "open",
                 std::to_string(border.points), std::to_string(curve.pieces.size()),
                 std::to_string(corners - (curve.closed ? 0 : 2)), Fixed(curve.LengthMm(), 2),
                 Scientific(border.fit.Relative()), Fixed(border.fit.curve_sigma_mm, 3),
                 std::to_string(border.gaps), std::to_string(border.branches)});
  }
  return regions.Render(colour) + "\n" + borders.Render(colour);
}

// Far below what Number keeps.
Json Small(double value) { return std::isfinite(value) ? Json(value) : Json(nullptr); }

Json PieceJson(const pipeline::RationalCubic& piece, const pipeline::PieceQuality& quality) {
  Json control = Json::array(), weights = Json::array();
  for (std::size_t j = 0; j < 4; ++j) {
    control.push_back(PointJson(piece.control_mm[j]));
    weights.push_back(Number(piece.weight[j], 9));
  }
  return {{"control_mm", control},
          {"weights", weights},
          {"points", quality.points},
          {"mean_square_error_mm2", Small(quality.mean_square_mm2)},
          {"relative_error", Small(quality.Relative())}};
}

Json BorderJson(const FeatureBorder& border) {
  Json pieces = Json::array(), corners = Json::array();
  for (std::size_t p = 0; p < border.fit.curve.pieces.size(); ++p) {
    pieces.push_back(PieceJson(border.fit.curve.pieces[p], border.fit.quality[p]));
  }
  for (const bool corner : border.fit.curve.corner) corners.push_back(corner);
  return {{"region", border.region + 1},
          {"beside", border.beside < 0 ? Json(nullptr) : Json(border.beside + 1)},
          {"closed", border.fit.curve.closed},
          {"points", border.points},
          {"gaps", border.gaps},
          {"branches", border.branches},
          {"length_mm", Number(border.fit.curve.LengthMm())},
          {"relative_error", Small(border.fit.Relative())},
          {"noise_sigma_mm", Number(border.fit.noise_sigma_mm)},
          {"curve_sigma_mm", Number(border.fit.curve_sigma_mm)},
          {"corner_at_start_of_piece", corners},
          {"pieces", pieces}};
}

std::string FeaturesJson(const FeatureBorders& found, const std::string& name) {
  Json regions = Json::array(), borders = Json::array();
  for (const FeatureRegion& region : found.regions) {
    regions.push_back({{"concave", region.concave},
                       {"points", region.points},
                       {"center_mm", PointJson(region.center_mm)},
                       {"size_mm", PointJson(region.size_mm)},
                       {"depth_mm", Number(region.depth_mm)}});
  }
  for (const FeatureBorder& border : found.borders) borders.push_back(BorderJson(border));
  const Json json = {{"schema", "bendloop.features/1"},
                     {"software", kSoftware},
                     {"cloud", name},
                     {"points_used", found.points_used},
                     {"reach_mm", Number(found.reach_mm)},
                     {"concavity_from_mm", Number(found.concavity_mm)},
                     {"regions", regions},
                     {"borders", borders},
                     {"warnings", found.warnings}};
  return Dump(json, 2) + "\n";
}

std::string BordersCsv(const FeatureBorders& found) {
  std::string csv = "border,piece,kind,number,x_mm,y_mm,z_mm,weight\n";
  const auto add = [&](std::size_t border, std::size_t piece, const char* kind, int number,
                       const Eigen::Vector3d& at, const std::string& weight) {
    csv += std::to_string(border + 1) + "," + std::to_string(piece + 1) + "," + kind + "," +
           std::to_string(number) + "," + Fixed(at.x(), 6) + "," + Fixed(at.y(), 6) + "," +
           Fixed(at.z(), 6) + "," + weight + "\n";
  };
  for (std::size_t b = 0; b < found.borders.size(); ++b) {
    const auto& pieces = found.borders[b].fit.curve.pieces;
    for (std::size_t p = 0; p < pieces.size(); ++p) {
      for (std::size_t j = 0; j < 4; ++j) {
        add(b, p, "control", static_cast<int>(j) + 1, pieces[p].control_mm[j],
            Fixed(pieces[p].weight[j], 9));
      }
      for (int i = 0; i <= kSamplesOfPiece; ++i) {
        add(b, p, "sample", i + 1, pieces[p].At(static_cast<double>(i) / kSamplesOfPiece), "");
      }
    }
  }
  return csv;
}

bool IsStep(const std::string& file) {
  std::string end = std::filesystem::path(file).extension().string();
  for (char& c : end) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return end == ".step" || end == ".stp";
}

int WriteBorders(const FeaturesArguments& arguments, const FeatureBorders& found) {
  if (!IsStep(arguments.borders)) return WriteOutput(arguments.borders, BordersCsv(found));
  std::vector<const pipeline::RationalBezier*> curves;
  for (const FeatureBorder& border : found.borders) curves.push_back(&border.fit.curve);
  if (curves.empty()) {
    return Report(
        {hal::ErrorKind::kBadInput,
         arguments.cloud.file + ": no borders were found to write as " + arguments.borders});
  }
  const auto written = WriteCurvesStep(curves, "borders", arguments.borders);
  return written ? 0 : Report(written.error());
}

int Features(const FeaturesArguments& arguments) {
  if (!arguments.borders.empty() && arguments.borders != "-" &&
      !arguments.borders.ends_with(".csv") && !IsStep(arguments.borders)) {
    return Report({hal::ErrorKind::kUsage, "--borders " + arguments.borders +
                                               ": borders are written as STEP or CSV; give a name "
                                               "that ends in .step or .csv"});
  }
  const auto cloud = arguments.cloud.Read();
  if (!cloud) return Report(cloud.error());
  for (const std::string& note : cloud->warnings) Note(arguments.cloud.file + ": " + note);
  ThreadWorkers workers(ProcessorCount());
  const auto found = pipeline::FindFeatureBorders(cloud->points_mm, arguments.options, &workers);
  if (!found) {
    return Report({found.error().kind, arguments.cloud.file + ": " + found.error().message});
  }
  for (const std::string& warning : found->warnings) {
    TellPerson("bendloop", "warning: " + warning);
  }
  if (arguments.json != "-" && arguments.borders != "-") {
    std::cout << FeaturesText(*found, ColourAllowed(STDOUT_FILENO)) << std::flush;
  }
  if (!arguments.json.empty()) {
    const std::string name =
        arguments.cloud.is_standard_input() ? "standard input" : arguments.cloud.file;
    if (const int code = WriteOutput(arguments.json, FeaturesJson(*found, name))) return code;
  }
  return arguments.borders.empty() ? 0 : WriteBorders(arguments, *found);
}

}  // namespace

CLI::App* AddFeaturesCommand(CLI::App& app, Run& run) {
  auto arguments = std::make_shared<FeaturesArguments>();
  CLI::App* command =
      app.add_subcommand("features", "Regions on any cloud, and their borders as curves");
  command->footer(kFeaturesFooter);
  arguments->cloud.AddTo(*command);
  command
      ->add_option("--normal-turn", arguments->options.normal_turn_deg,
                   "Normals that turn faster among neighbours are a border")
      ->check(NumberWithin(2, 89))
      ->type_name("DEG")
      ->capture_default_str();
  command
      ->add_option("--concavity", arguments->options.concavity_mm,
                   "Deeper below the convex hull is a feature; from the points' noise when not "
                   "given")
      ->check(NumberWithin(1e-6, 1e6))
      ->type_name("MM");
  command->add_option("--json", arguments->json, "Write the result here, - for standard output")
      ->type_name("OUT");
  command
      ->add_option("--borders", arguments->borders,
                   "Write the borders: OUT.step as B-splines, OUT.csv with control points, weights "
                   "and sampled points")
      ->type_name("OUT");
  command->callback([arguments, &run] { run = [arguments] { return Features(*arguments); }; });
  return command;
}

}  // namespace bendloop::host
