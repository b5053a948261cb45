// SPDX-License-Identifier: Apache-2.0
#include <unistd.h>

#include <cmath>
#include <iostream>
#include <memory>
#include <optional>

#include "config/load.h"
#include "firmware-host/cell/part_plan.h"
#include "firmware-host/cli/cloud_argument.h"
#include "firmware-host/cli/command.h"
#include "firmware-host/cli/outlier_place.h"
#include "firmware-host/console/command_line.h"
#include "firmware-host/console/message.h"
#include "firmware-host/console/version.h"
#include "firmware-host/result/result_json.h"
#include "firmware-host/text/result_text.h"
#include "firmware-host/text/style.h"
#include "firmware-host/text/table.h"
#include "firmware-host/workers/thread_workers.h"
#include "hal/clock.h"
#include "pipeline/tube_model.h"

namespace bendloop::host {
namespace {

struct ReconstructArguments {
  CloudArgument cloud;
  std::optional<double> pipe_radius_mm;
  std::string part;
  std::string model = "auto";
  std::string spine_method = "mls";
  std::string json;
  std::string spine_out;
};

// A known radius is measured to a few percent even through paint and noise.
constexpr double kRadiusDoubt = 0.05;

constexpr const char* kReconstructFooter = R"(
Examples:
  bendloop reconstruct tube.ply
  bendloop reconstruct coil.ply --units m
  bendloop reconstruct tube.xyz --pipe-radius 4 --json tube.json
  zcat tube.ply.gz | bendloop reconstruct - --units m
  bendloop reconstruct tube.pcd --json - | bendloop convert --to lra --format csv
  bendloop reconstruct noisy.ply --part part.toml
  bendloop reconstruct tapered.ply --model canal --spine-out spine.csv

Models:
  tube      lines and arcs, one pipe radius: rows of lengths, rotations, angles
  canal     the pipe radius varies along the spine (tapered, end-formed): spine
            with local radius; the rows are the lines and arcs nearest to it,
            the pipe radius is the mean
  freeform  a spine without lines and arcs: spine with local radius, no rows
  auto      tube, unless the points contradict it clearly; a warning says why
Spine methods:
  mls       moving least squares: cylinders fitted around each place
  shrinking points move along their normals until they meet; needs more than a
            third of the circumference

Reads PLY, PCD and XYZ/CSV text, - from standard input; the content decides, not
the name. Output is in mm and degrees. The rotation is right-handed about the
feed direction, from one bend plane to the next. The rows go along the tube from
the end at which the scan began: the nominal's order is in a cell's results.)";

// The one place where a model and a spine method become a measurement.
hal::Result<pipeline::Measurement> Measure(const ReconstructArguments& arguments,
                                           const std::optional<hal::BendProgram>& nominal,
                                           std::optional<double> pipe_radius_mm,
                                           const PointCloud& cloud) {
  using pipeline::TubeModel;
  pipeline::ReconstructionOptions options;
  options.pipe_radius_mm = pipe_radius_mm;
  options.nominal = nominal;
  options.spine_method = arguments.spine_method == "shrinking" ? pipeline::SpineMethod::kShrinking
                                                               : pipeline::SpineMethod::kMls;
  const TubeModel model = arguments.model == "tube"       ? TubeModel::kTube
                          : arguments.model == "canal"    ? TubeModel::kCanal
                          : arguments.model == "freeform" ? TubeModel::kFreeform
                                                          : TubeModel::kAuto;
  const hal::SteadyClock clock;
  ThreadWorkers workers(ProcessorCount());
  return pipeline::ReconstructModel(cloud.points_mm, model, options, clock, &workers);
}

std::string SpineCsv(const pipeline::Measurement& measurement) {
  std::string csv = "x_mm,y_mm,z_mm,pipe_radius_mm,arc_length_mm\n";
  double along_mm = 0;
  const Eigen::Vector3d* before = nullptr;
  for (const pipeline::SpineSample& sample : measurement.spine) {
    if (before) along_mm += (sample.position_mm - *before).norm();
    before = &sample.position_mm;
    csv += Fixed(sample.position_mm.x(), 6) + "," + Fixed(sample.position_mm.y(), 6) + "," +
           Fixed(sample.position_mm.z(), 6) + "," + Fixed(sample.pipe_radius_mm, 6) + "," +
           Fixed(along_mm, 6) + "\n";
  }
  return csv;
}

// What the numbers alone do not show: points that are not of this tube, a radius that is not its.
std::vector<std::string> Doubts(const pipeline::Measurement& measurement, const PointCloud& cloud,
                                std::optional<double> given_radius_mm, bool is_option) {
  std::vector<std::string> doubts;
  const pipeline::FitQuality& fit = measurement.fit;
  const double radius_mm = measurement.tube.pipe_radius_mm;
  if (std::string place = OutlierPlace(cloud.points_mm, measurement); !place.empty()) {
    doubts.push_back(std::move(place));
  }
  if (fit.outliers > fit.samples) {
    doubts.push_back("only " + std::to_string(fit.samples) + " of " +
                     std::to_string(fit.samples + fit.outliers) +
                     " points lie on the measured tube: unless the rest is a table or a fixture, "
                     "this is a scrap of the tube and not to be trusted; scan with laser lines "
                     "closer than " +
                     Fixed(0.5 * radius_mm, 1) + " mm (half the pipe radius)");
  }
  if (given_radius_mm && std::abs(radius_mm - *given_radius_mm) > kRadiusDoubt * *given_radius_mm) {
    doubts.push_back(
        (is_option ? "--pipe-radius says " : "another part: the nominal's pipe radius is ") +
        Fixed(*given_radius_mm, 3) + " mm, the points show " + Fixed(radius_mm, 3) + " mm");
  }
  return doubts;
}

std::string BaseName(const std::string& path) {
  const std::size_t slash = path.rfind('/');
  return slash == std::string::npos ? path : path.substr(slash + 1);
}

void TellNotes(const std::string& name, const PointCloud& cloud) {
  std::vector<std::string> notes = cloud.warnings;
  const std::size_t most = pipeline::ReconstructionOptions().max_points;
  if (cloud.points_mm.size() > most) {
    notes.push_back("the final fit takes " + std::to_string(most) + " of the " +
                    std::to_string(cloud.points_mm.size()) +
                    " points at most, evenly spread; all of them find the spine");
  }
  for (const std::string& note : notes) {
    Note(name + ": " + note);
  }
}

int Reconstruct(const ReconstructArguments& arguments) {
  std::optional<hal::BendProgram> nominal;
  std::optional<double> nominal_radius_mm;
  if (!arguments.part.empty()) {
    const auto part = config::LoadPart(arguments.part);
    if (!part) return Report(part.error());
    auto program = NominalProgram(*part);
    if (!program) return Report(program.error());
    nominal = std::move(*program);
    nominal_radius_mm = part->pipe_radius_mm;
  }
  const auto cloud = arguments.cloud.Read();
  if (!cloud) return Report(cloud.error());
  TellNotes(arguments.cloud.file, *cloud);
  const std::optional<double> radius_mm =
      arguments.pipe_radius_mm ? arguments.pipe_radius_mm : nominal_radius_mm;
  auto measurement = Measure(arguments, nominal, radius_mm, *cloud);
  // Another part may have another radius, and is to be measured all the same.
  const auto is_bad = [&] {
    return !measurement && measurement.error().kind == hal::ErrorKind::kBadInput;
  };
  if (is_bad() && nominal_radius_mm && !arguments.pipe_radius_mm) {
    measurement = Measure(arguments, nominal, std::nullopt, *cloud);
  }
  if (!measurement) {
    hal::Error error = measurement.error();
    if (error.kind == hal::ErrorKind::kBadInput) {
      error.message = arguments.cloud.file + ": " + error.message;
    }
    return Report(error);
  }
  for (std::string& doubt :
       Doubts(*measurement, *cloud, radius_mm, arguments.pipe_radius_mm.has_value())) {
    measurement->warnings.push_back(std::move(doubt));
  }
  for (const std::string& warning : measurement->warnings) {
    TellPerson("bendloop", "warning: " + warning);
  }
  RunResult result;
  result.session =
      arguments.cloud.is_standard_input() ? "standard input" : BaseName(arguments.cloud.file);
  result.software = kSoftware;
  result.measurement = std::move(*measurement);
  // With the JSON on standard output the table would be in its way.
  if (arguments.json != "-" && arguments.spine_out != "-") {
    std::cout << MeasurementText(result.measurement, ColourAllowed(STDOUT_FILENO)) << std::flush;
  }
  if (!arguments.json.empty()) {
    ResultJsonOptions options;
    options.spine = true;
    if (const int code = WriteOutput(arguments.json, WriteResultJson(result, options))) return code;
  }
  if (!arguments.spine_out.empty()) {
    if (const int code = WriteOutput(arguments.spine_out, SpineCsv(result.measurement))) {
      return code;
    }
  }
  return 0;
}

}  // namespace

CLI::App* AddReconstructCommand(CLI::App& app, Run& run) {
  auto arguments = std::make_shared<ReconstructArguments>();
  CLI::App* command =
      app.add_subcommand("reconstruct", "Point cloud to lengths, rotations and angles (LRA)");
  command->footer(kReconstructFooter);
  arguments->cloud.AddTo(*command);
  command->add_option("--pipe-radius", arguments->pipe_radius_mm, "Known; estimated when not given")
      ->check(NumberWithin(0.2, 300.0))
      ->type_name("MM");
  command
      ->add_option("--part", arguments->part,
                   "The part's file: says which of several tubes it is, and how many bends where "
                   "the points leave that open")
      ->type_name("PART.toml");
  command->add_option("--model", arguments->model, "What the points show")
      ->check(CLI::IsMember({"auto", "tube", "canal", "freeform"}))
      ->capture_default_str();
  command->add_option("--spine-method", arguments->spine_method, "How samples reach the spine")
      ->check(CLI::IsMember({"mls", "shrinking"}))
      ->capture_default_str();
  command->add_option("--json", arguments->json, "Write the result here, - for standard output")
      ->type_name("OUT");
  command->add_option("--spine-out", arguments->spine_out, "Write the spine's points as CSV")
      ->type_name("OUT.csv");
  command->callback([arguments, &run] { run = [arguments] { return Reconstruct(*arguments); }; });
  return command;
}

}  // namespace bendloop::host
