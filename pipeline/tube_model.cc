// SPDX-License-Identifier: Apache-2.0
#include "pipeline/tube_model.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numeric>
#include <optional>
#include <vector>

#include "hal/spine.h"
#include "pipeline/canal/canal.h"
#include "pipeline/fit/nearest_lanes.h"
#include "pipeline/fit/surface_points.h"
#include "pipeline/math/quantiles.h"
#include "pipeline/points/input_checks.h"
#include "pipeline/points/point_index.h"
#include "pipeline/structure/nominal_along.h"
#include "pipeline/tube/stage_timer.h"

namespace bendloop::pipeline {
namespace {

// When a look at the other models is worth its time. By trial.
struct LookSettings {
  double radius_range = 0.05;  // [of r_P] of the local radius, between its 5 % and 95 %
  double outliers = 0.15;      // [of the points]
  double systematic = 0.02;    // [of r_P] distances that neighbours share
  // Tubes for benders are straight for most of their length; where arc follows upon arc they may
  // stand in for something else: so many bends or more, and straights of at most this part of the
  // arcs' length.
  std::size_t many_bends = 3;
  double few_straights = 0.5;
  double no_straights = 0.1;
};
constexpr LookSettings kLook;

// When the tube is left for another model, or there is none. By trial where nothing else is said;
// tests/unit/canal holds what must stay a tube and what must not.
struct LeaveSettings {
  // [of the mean radius] Range of the local radius on the straights of a canal.
  double on_straights = 0.10;
  // The same anywhere. An oval bend seen from one side looks like one of another radius: an ovality
  // of 10 % is the bender's limit and makes up to 16 %, thicker or thinner.
  double in_bends = 0.35;
  // [times its 1 sigma] A range of radii of less may be noise.
  double range_sigmas = 6.0;
  // Times that the tube's squared distances must be the other model's.
  double better = 3.0;
  // [of r_P] Lines and arcs miss the samples by so much, beyond the noise.
  double spine_off = 0.05;
  // Twice the logarithm of the likelihood's ratio, numbers paid for: odds of 20 000 to 1.
  double evidence = 20.0;
  // [of r_P] Points further off are just as bad.
  double reach = 0.3;
  // [sigma] Points nearer than this to a surface are explained by it.
  double explained_sigmas = 5.0;
  // [of the points] Explained by a canal when there is no tube to compare with.
  double explained = 0.6;
  // [of the points] Explained by one pipe, to doubt that there is no tube.
  double nearly_all = 0.9;
  // [pipe radii] A canal without a tube is as long as this.
  double least_length = 6.0;
  // [of r_P] So much of the tube beside what sits on its end a canal follows that with.
  double beside_fitting = 1.0;
  // [of the tube's samples] The other model must hold so many.
  double least_share = 0.8;
  // So many points are compared: far more than the models have numbers.
  std::size_t compared_points = 20'000;
};
constexpr LeaveSettings kLeave;

// Of the squared distances from the wall: what bows of the straights explain, which are no reason
// to leave lines and arcs. A parabola is off its best-fit line by 0.3 of its height, root mean
// square; seen from all sides by less.
double OfBowsMm2(const Measurement& tube) {
  constexpr double kOfHeight = 0.3;
  double sum_mm3 = 0, length_mm = 0;
  for (const StraightForm& straight : tube.straights) {
    sum_mm3 += std::pow(kOfHeight * straight.height_mm, 2) * straight.length_mm;
  }
  for (const auto& segment : hal::SpineSegments(tube.tube.program, tube.tube.X_WT)) {
    length_mm += segment.length_mm;
  }
  return length_mm > 0 ? sum_mm3 / length_mm : 0.0;
}

// The part of the squared distances that neighbouring samples have in common and that no bow
// explains, as a length.
double SystematicMm(const Measurement& tube) {
  struct Patch {
    double sum = 0, sum2 = 0, count = 0;
  };
  std::map<std::uint64_t, Patch> patches;
  for (const SurfaceSample& sample : tube.surface) {
    Patch& patch = patches[CellKey(CellOf(sample.position_mm, tube.tube.pipe_radius_mm))];
    patch.sum += sample.distance_mm;
    patch.sum2 += sample.distance_mm * sample.distance_mm;
    patch.count += 1;
  }
  double between = 0, count = 0;
  for (const auto& [key, p] : patches) {
    if (p.count < 4) continue;
    const double mean = p.sum / p.count;
    const double variance = (p.sum2 / p.count - mean * mean) / (p.count - 1);
    between += p.count * (mean * mean - variance);
    count += p.count;
  }
  return count > 0 ? std::sqrt(std::max(0.0, between / count - OfBowsMm2(tube))) : 0.0;
}

double Range(std::vector<double> values) { return Quantile(values, 0.95) - Quantile(values, 0.05); }

// Local radii without what one bin's noise does.
std::vector<double> SmoothRadii(const std::vector<SpineSample>& spine) {
  std::vector<double> smooth;
  for (std::size_t i = 0; i < spine.size(); ++i) {
    std::vector<double> window;
    for (std::size_t k = i < 3 ? 0 : i - 3; k < std::min(i + 4, spine.size()); ++k) {
      window.push_back(spine[k].pipe_radius_mm);
    }
    smooth.push_back(Median(std::move(window)));
  }
  return smooth;
}

bool IsArcUponArc(const hal::Tube& tube) {
  double arcs_mm = 0, straights_mm = 0;
  for (const hal::SpineSegment& segment : hal::SpineSegments(tube.program, tube.X_WT)) {
    (segment.is_arc() ? arcs_mm : straights_mm) += segment.length_mm;
  }
  return tube.program.bend_count() >= kLook.many_bends &&
         straights_mm < kLook.few_straights * arcs_mm;
}

// A coil, a helix and a ring's part, as lines and arcs: hardly a straight between the ends.
bool IsArcsAlone(const hal::Tube& tube) {
  double arcs_mm = 0, straights_mm = 0;
  const auto segments = hal::SpineSegments(tube.program, tube.X_WT);
  for (std::size_t i = 1; i + 1 < segments.size(); ++i) {
    (segments[i].is_arc() ? arcs_mm : straights_mm) += segments[i].length_mm;
  }
  return tube.program.bend_count() >= kLook.many_bends &&
         straights_mm < kLook.no_straights * arcs_mm;
}

bool WorthALook(const Measurement& m) {
  const double r = m.tube.pipe_radius_mm;
  const auto all = static_cast<double>(m.fit.samples + m.fit.outliers);
  return Range(SmoothRadii(m.spine)) > kLook.radius_range * r ||
         static_cast<double>(m.fit.outliers) > kLook.outliers * all ||
         SystematicMm(m) > kLook.systematic * r || IsArcUponArc(m.tube);
}

// A place of a canal's spine beside the tube.
struct CanalPlace {
  bool is_plain = false;  // the pipe's, and not of what sits on its ends
  bool is_straight = false;
};

std::vector<CanalPlace> PlacesOf(const Measurement& tube, const CanalScan& scan) {
  const auto segments = hal::SpineSegments(tube.tube.program, tube.tube.X_WT);
  const std::vector<SegmentFrame> frames = SegmentFrames(segments);
  std::vector<std::int32_t> all(frames.size());
  std::iota(all.begin(), all.end(), 0);
  const auto last = static_cast<std::int32_t>(segments.size()) - 1;
  const auto of_form_mm = [&tube](const EndForm& form) {
    const double long_mm = std::max(form.length_mm, form.begins_mm);
    return long_mm > 0 ? long_mm + kLeave.beside_fitting * tube.tube.pipe_radius_mm : 0.0;
  };
  const double first_mm = of_form_mm(tube.first_end), last_mm = of_form_mm(tube.last_end);
  std::vector<CanalPlace> places;
  for (const SpineSample& sample : scan.spine) {
    const std::int32_t near = NearestSegment(sample.position_mm, frames, all).segment;
    const hal::SpineSegment& segment = segments[static_cast<std::size_t>(near)];
    const double along_mm = (sample.position_mm - segment.start_mm).dot(segment.tangent);
    const bool is_on_form = (near == 0 && first_mm > 0 && along_mm < first_mm) ||
                            (near == last && last_mm > 0 && along_mm > segment.length_mm - last_mm);
    places.push_back({!is_on_form, !segment.is_arc()});
  }
  return places;
}

struct Comparison {
  double tube_mm2 = 0;
  double other_mm2 = 0;
  double samples = 0;
};

// Squared distances of the other model's samples from both; from bends as they were fitted, oval
// ones too.
Comparison Compare(const Measurement& measured, const CanalScan& scan,
                   const std::vector<CanalPlace>& places) {
  const hal::Tube& tube = measured.tube;
  const std::vector<SegmentFrame> frames =
      SegmentFrames(SpineOf(tube.program, tube.X_WT, measured.easing),
                    std::numeric_limits<double>::infinity(), measured.flattening);
  std::vector<std::int32_t> all(frames.size());
  std::iota(all.begin(), all.end(), 0);
  const double reach_mm = kLeave.reach * tube.pipe_radius_mm;
  Comparison result;
  const std::size_t stride = scan.points.size() / kLeave.compared_points + 1;
  NearestLanes nearest;
  const double per_mm =
      static_cast<double>(places.size() - 1) / std::max(1e-9, scan.to_mm - scan.from_mm);
  const auto is_plain = [&](std::size_t i) {
    const double at = std::clamp(per_mm * (scan.along_mm[i] - scan.from_mm), 0.0,
                                 static_cast<double>(places.size() - 1));
    return places[static_cast<std::size_t>(std::lround(at))].is_plain;
  };
  std::vector<Eigen::Vector3d> batch;
  const auto add_batch = [&] {
    if (batch.empty()) return;
    nearest.Find(batch, frames, tube.pipe_radius_mm, all);
    for (std::size_t i = 0; i < batch.size(); ++i) {
      const double d = nearest.Local(nearest.Candidate(i)).distance[i] - tube.pipe_radius_mm;
      result.tube_mm2 += std::pow(std::min(std::abs(d), reach_mm), 2);
    }
    batch.clear();
  };
  for (std::size_t i = 0; i < scan.points.size(); i += stride) {
    const CanalFoot& foot = scan.feet[i];
    if (foot.beyond || std::abs(foot.distance_mm) > reach_mm || !is_plain(i)) continue;
    batch.push_back(scan.points[i]);
    if (batch.size() == kBatch) add_batch();
    result.other_mm2 += foot.distance_mm * foot.distance_mm;
    result.samples += 1;
  }
  add_batch();
  // Bows of straights are no reason to leave lines and arcs.
  result.tube_mm2 = std::max(0.0, result.tube_mm2 - result.samples * measured.bows_explain_mm2);
  return result;
}

std::size_t Explained(const CanalScan& scan) {
  const double near_mm = kLeave.explained_sigmas * scan.fit.sigma_mm;
  std::size_t count = 0;
  for (const CanalFoot& foot : scan.feet) {
    count += !foot.beyond && std::abs(foot.distance_mm) < near_mm ? 1 : 0;
  }
  return count;
}

std::vector<double> Radii(const CanalScan& scan) {
  std::vector<double> radii;
  for (const SpineSample& sample : scan.spine) radii.push_back(sample.pipe_radius_mm);
  return radii;
}

// Why the points are a canal surface and not this tube; empty: they are not.
std::string WhyCanal(const Measurement& tube, const CanalScan& scan) {
  const std::vector<CanalPlace> places = PlacesOf(tube, scan);
  std::vector<double> radii, straight;
  for (std::size_t i = 0; i < places.size(); ++i) {
    if (!places[i].is_plain) continue;
    radii.push_back(scan.spine[i].pipe_radius_mm);
    if (places[i].is_straight) straight.push_back(radii.back());
  }
  const double mean_mm = Median(radii);
  const double noise_mm = kLeave.range_sigmas * scan.fit.pipe_radius_sigma_mm;
  const double range_mm = Range(radii);
  const bool varies = Range(straight) > std::max(kLeave.on_straights * mean_mm, noise_mm) ||
                      range_mm > std::max(kLeave.in_bends * mean_mm, noise_mm);
  const Comparison compared = Compare(tube, scan, places);
  if (!varies || !(compared.tube_mm2 > kLeave.better * compared.other_mm2) ||
      static_cast<double>(Explained(scan)) <
          kLeave.least_share * static_cast<double>(tube.fit.samples)) {
    return {};
  }
  return "no tube of one radius: the pipe radius varies by " + Mm(range_mm) +
         " along the spine, more than noise and oval bends explain (samples lie " +
         Mm(std::sqrt(compared.tube_mm2 / compared.samples)) + " rms from the best tube and " +
         Mm(std::sqrt(compared.other_mm2 / compared.samples)) +
         " from the canal surface); measured as a canal, see --model.";
}

std::string WhyFreeform(const Measurement& tube, const CanalScan& scan) {
  const Comparison compared = Compare(tube, scan, PlacesOf(tube, scan));
  if (compared.samples < 1 || !(compared.other_mm2 > 0)) return {};
  const auto bends = static_cast<int>(tube.tube.program.bend_count());
  const int parameters = 5 + 4 * bends;
  const double off_mm =
      std::sqrt(std::max(0.0, compared.tube_mm2 - compared.other_mm2) / compared.samples);
  const double evidence =
      compared.samples * std::log(compared.tube_mm2 / compared.other_mm2) -
      std::max(0, scan.fit.parameters - parameters) * std::log(compared.samples);
  const bool simpler = scan.fit.parameters <= parameters && evidence > kLeave.evidence;
  const bool curved = IsArcUponArc(tube.tube) && evidence > kLeave.evidence;
  const bool much_better = compared.tube_mm2 > kLeave.better * compared.other_mm2 &&
                           off_mm > kLeave.spine_off * tube.tube.pipe_radius_mm;
  if ((!simpler && !curved && !much_better) ||
      static_cast<double>(Explained(scan)) <
          kLeave.least_share * static_cast<double>(tube.fit.samples)) {
    return {};
  }
  return "no lines and arcs: " + std::to_string(bends) + " bends leave the samples " +
         Mm(std::sqrt(compared.tube_mm2 / compared.samples)) +
         " rms from the tube, a free-form "
         "spine " +
         Mm(std::sqrt(compared.other_mm2 / compared.samples)) +
         (simpler ? " with fewer numbers" : "") + "; measured as a free form, see --model.";
}

// A drawing says lines and arcs. With its corners nothing contradicts it but a radius that varies;
// with as many bends as it has, and nearly all of the points on them, not even that does.
bool IsNominal(const Measurement& tube, const ReconstructionOptions& options) {
  return options.nominal && MayBeByCorners(*options.nominal, tube.tube, tube.sigma);
}
bool IsAsDrawn(const Measurement& tube, const ReconstructionOptions& options) {
  const auto all = static_cast<double>(tube.fit.samples + tube.fit.outliers);
  return options.nominal && options.nominal->bend_count() == tube.tube.program.bend_count() &&
         static_cast<double>(tube.fit.samples) > (1.0 - kLook.outliers) * all &&
         SystematicMm(tube) < kLeave.spine_off * tube.tube.pipe_radius_mm;
}

void SayWhy(const std::string& why, Measurement& measurement) {
  measurement.warnings.insert(measurement.warnings.begin(), why);
}

// All points may lie on one pipe that the projection lost: noise of a tenth of the radius lays
// cylinders on from outside. Empty: that is not so, or shrinking does not find it either.
std::optional<Measurement> TubeByShrinking(std::span<const Eigen::Vector3d> points,
                                           const CanalScan& pipe, const std::string& without,
                                           ReconstructionOptions options, const hal::Clock& clock,
                                           Workers* workers) {
  const double nearly_all = kLeave.nearly_all * static_cast<double>(points.size());
  if (!(static_cast<double>(Explained(pipe)) > nearly_all)) return std::nullopt;
  options.spine_method = SpineMethod::kShrinking;
  auto tube = Reconstruct(points, options, clock, workers);
  if (!tube || !(static_cast<double>(tube->fit.samples) > nearly_all)) return std::nullopt;
  SayWhy("moving least squares did not find one spine (" + without + "), shrinking did.", *tube);
  return std::move(*tube);
}

// Where there is no tube: a canal, if it is long, holds most points and its radius certainly
// varies.
std::optional<Measurement> CanalWithoutTube(std::size_t points, const CanalScan& scan,
                                            const std::string& without, const hal::Clock& clock) {
  const std::vector<double> radii = Radii(scan);
  const double length_mm = scan.to_mm - scan.from_mm;
  const double range_mm = Range(radii);
  if (static_cast<double>(Explained(scan)) < kLeave.explained * static_cast<double>(points) ||
      length_mm < kLeave.least_length * Median(radii) ||
      range_mm < std::max(kLeave.on_straights * Median(radii),
                          kLeave.range_sigmas * scan.fit.pipe_radius_sigma_mm)) {
    return std::nullopt;
  }
  Measurement measurement = DescribeCanal(scan, false, clock);
  SayWhy("no tube of one radius (" + without + "), but one whose pipe radius varies by " +
             Mm(range_mm) + "; measured as a canal, see --model.",
         measurement);
  return measurement;
}

// A canal or a free form, where it explains the points of this tube clearly better.
std::optional<Measurement> BetterThanTube(std::span<const Eigen::Vector3d> points,
                                          const Measurement& tube, bool is_nominal,
                                          const CanalScan& varying, CanalOptions options,
                                          const hal::Clock& clock) {
  if (const std::string why = WhyCanal(tube, varying); !why.empty()) {
    Measurement measurement = DescribeCanal(varying, false, clock);
    SayWhy(why, measurement);
    return measurement;
  }
  if (is_nominal) return std::nullopt;
  options.freeform = true;
  const auto freeform = FitCanalScan(points, options, clock);
  const std::string why = freeform ? WhyFreeform(tube, *freeform) : std::string();
  if (why.empty()) return std::nullopt;
  Measurement measurement = DescribeCanal(*freeform, true, clock);
  SayWhy(why, measurement);
  return measurement;
}

// A ring, a frame: all of it is one pipe, which has no ends.
std::optional<Measurement> ClosedForm(std::span<const Eigen::Vector3d> points, CanalOptions options,
                                      const std::string& without, const hal::Clock& clock) {
  options.freeform = true;
  const auto scan = FitCanalScan(points, options, clock);
  if (!scan || !scan->is_closed ||
      static_cast<double>(Explained(*scan)) <
          kLeave.explained * static_cast<double>(points.size())) {
    return std::nullopt;
  }
  Measurement measurement = DescribeCanal(*scan, true, clock);
  SayWhy("no tube from end to end (" + without + "); measured as a free form, see --model.",
         measurement);
  return measurement;
}

hal::Result<Measurement> Choose(std::span<const Eigen::Vector3d> points,
                                const ReconstructionOptions& options, const hal::Clock& clock,
                                Workers* workers) {
  auto tube = Reconstruct(points, options, clock, workers);
  if (tube && (!WorthALook(*tube) || IsAsDrawn(*tube, options))) return tube;
  if (!tube && tube.error().kind != hal::ErrorKind::kBadInput) return tube;

  StageTimer timer(clock);
  const CanalOptions canal{options.pipe_radius_mm, options.spine_method, false};
  const auto varying = FitCanalScan(points, canal, clock);
  if (!tube && varying && options.spine_method == SpineMethod::kMls) {
    auto shrunk = TubeByShrinking(points, *varying, tube.error().message, options, clock, workers);
    if (shrunk) tube = std::move(*shrunk);
    if (tube && !WorthALook(*tube)) return tube;
  }
  if (varying) {
    auto other =
        tube ? BetterThanTube(points, *tube, IsNominal(*tube, options), *varying, canal, clock)
             : CanalWithoutTube(points.size(), *varying, tube.error().message, clock);
    if (!tube && !other && varying->is_closed) {
      other = ClosedForm(points, canal, tube.error().message, clock);
    }
    if (other) return std::move(*other);
  }
  if (!tube) return tube;
  timer.Done("other_models");
  tube->timing.insert(tube->timing.end(), timer.times.begin(), timer.times.end());
  return tube;
}

// Rows of arcs alone are told, but where the nominal has as many. Cuts and holes of a spine that
// may be another are places on a wall that is not there: none are.
hal::Result<Measurement> TellArcs(hal::Result<Measurement> found,
                                  const ReconstructionOptions& options) {
  if (!found || !IsArcsAlone(found->tube)) return found;
  if (options.nominal && options.nominal->bend_count() == found->tube.program.bend_count()) {
    return found;
  }
  SayWhy(
      "arc follows upon arc: a coil or another spine without lines and arcs may be shown by "
      "them, compare --model freeform. Nothing is told of cuts and holes.",
      *found);
  found->features = {};
  return found;
}

}  // namespace

hal::Result<Measurement> ReconstructModel(std::span<const Eigen::Vector3d> points, TubeModel model,
                                          const ReconstructionOptions& options,
                                          const hal::Clock& clock, Workers* workers) {
  switch (model) {
    case TubeModel::kAuto:
      return TellArcs(Choose(points, options, clock, workers), options);
    case TubeModel::kTube:
      return TellArcs(Reconstruct(points, options, clock, workers), options);
    case TubeModel::kCanal:
    case TubeModel::kFreeform:
      break;
  }
  const bool freeform = model == TubeModel::kFreeform;
  const auto scan =
      FitCanalScan(points, {options.pipe_radius_mm, options.spine_method, freeform}, clock);
  if (!scan) return hal::Fail(scan.error());
  return DescribeCanal(*scan, freeform, clock);
}

}  // namespace bendloop::pipeline
