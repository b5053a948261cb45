// SPDX-License-Identifier: Apache-2.0
// The paper's overview (Bauer & Polthier 2009, section 1.3): project, connect, simplify,
// approximate, fit. Samples are projected while they arrive; the rest follows when the scan ends,
// and now and then for the live view.
#include "pipeline/reconstruction.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <optional>
#include <tuple>
#include <utility>

#include "pipeline/feature_points.h"
#include "pipeline/features/around_zero.h"
#include "pipeline/features/cut_faces.h"
#include "pipeline/features/dents.h"
#include "pipeline/features/end_cut.h"
#include "pipeline/features/end_profile.h"
#include "pipeline/features/openings.h"
#include "pipeline/features/surface_cells.h"
#include "pipeline/fit/bends_with_bows.h"
#include "pipeline/fit/correlations.h"
#include "pipeline/fit/coverage.h"
#include "pipeline/fit/die_spread.h"
#include "pipeline/fit/easing_fit.h"
#include "pipeline/fit/end_forms.h"
#include "pipeline/fit/explained_by_bows.h"
#include "pipeline/fit/faint_dents.h"
#include "pipeline/fit/grooves.h"
#include "pipeline/fit/hidden_ends.h"
#include "pipeline/fit/hidden_radii.h"
#include "pipeline/fit/incidence.h"
#include "pipeline/fit/kept_ends.h"
#include "pipeline/fit/last_fit.h"
#include "pipeline/fit/odd_die.h"
#include "pipeline/fit/one_die.h"
#include "pipeline/fit/other_parts.h"
#include "pipeline/fit/registration.h"
#include "pipeline/fit/report_quality.h"
#include "pipeline/fit/seam.h"
#include "pipeline/fit/section_rise.h"
#include "pipeline/fit/self_check.h"
#include "pipeline/fit/silent_bends.h"
#include "pipeline/fit/skewed_easing.h"
#include "pipeline/fit/sunk_ends.h"
#include "pipeline/fit/surface_fit.h"
#include "pipeline/fit/surface_form.h"
#include "pipeline/fit/tube_ends.h"
#include "pipeline/fit/wall_spine.h"
#include "pipeline/fit/without_dents.h"
#include "pipeline/fit/wrinkles.h"
#include "pipeline/points/input_checks.h"
#include "pipeline/spine/closed_tube.h"
#include "pipeline/spine/oriented_samples.h"
#include "pipeline/spine/sample_intake.h"
#include "pipeline/spine/shrinking.h"
#include "pipeline/spine/spine_polygon.h"
#include "pipeline/spine/thin_parts.h"
#include "pipeline/spine/tube_choice.h"
#include "pipeline/structure/end_sleeves.h"
#include "pipeline/structure/neighbour_separation.h"
#include "pipeline/structure/nominal_along.h"
#include "pipeline/structure/nominal_die.h"
#include "pipeline/structure/nominal_radii.h"
#include "pipeline/structure/other_part.h"
#include "pipeline/structure/round_bends.h"
#include "pipeline/structure/structure.h"
#include "pipeline/tube/stage_timer.h"

namespace bendloop::pipeline {
namespace {

// What the stages are given.
struct StageSettings {
  // [of r_P] How far from the surface the final fit looks: beyond any noise that a tube may have
  // (fit/report_quality.cc) five times over, and nearer than a neighbour that touches.
  double final_reach = 0.2;
  // By trial on passes that drift: about that of seven degrees of freedom.
  double few_causes = 0.4;
  // [of 1/r_P] How far off the pipe's a sample's curvature may be that is shrunk (Lee & Kim 2004).
  double shrink_widest = 1.5;
  // So many samples are shrunk at most: the spine asks for no more, and each costs the same.
  std::size_t shrink_samples = 30'000;
  // Points of lines about all places that may be openings, and about the ends, which every tube
  // has: more cost more time than they make their borders sharper.
  std::size_t about_openings = 300'000, about_ends = 100'000;
  // Times that a neighbour is taken off. Each takes one joint at least; more were never seen.
  int most_parted = 3;
  // [degrees] 1 sigma of an angle from which on the live view shows the bend.
  double settled_deg = 2.0;
};
constexpr StageSettings kStage;

// The tube among what is in view, and its lines and arcs.
struct ApproximatedTube {
  SpinePolygon polygon;
  std::vector<PointBlock> blocks;  // all points near it
  SurfaceFit structure;
  std::vector<PlainEnd> sleeves;    // where its ends are in one: polygon and blocks end there
  std::vector<PartedBlock> parted;  // what some of the blocks look at
  std::vector<double> left_out_mm;  // lengths of the other pieces
  Registration registration;        // of the scan's passes; the blocks look at its points
};

// Least squares on all points.
struct FinalFit {
  SurfaceFitOptions options;
  IncidenceWeights weights;  // the tube's blocks look at them
  SurfaceFit fit;
  BowedTubeState bowed;
  // 1 sigma of the points: beside lines and arcs, where bows and dents count as well; and their
  // own.
  double beside_rows_mm = 0, noise_mm = 0;
  std::optional<SeamFound> seam;
  std::vector<WrinklesFound> wrinkles;
  std::optional<OtherDie> other_die;  // than the nominal's, from which the radii are
  // The points left without these, one after the other, if not all.
  std::optional<OwnedBlocks> beside_seam, beside_wrinkles, beside_sunk;
  std::span<const PointBlock> BesideSeam(std::span<const PointBlock> all) const {
    return beside_seam ? std::span<const PointBlock>(*beside_seam) : all;
  }
  std::span<const PointBlock> BesideWrinkles(std::span<const PointBlock> all) const {
    return beside_wrinkles ? std::span<const PointBlock>(*beside_wrinkles) : BesideSeam(all);
  }
  std::span<const PointBlock> Fitted(std::span<const PointBlock> all) const {
    return beside_sunk ? std::span<const PointBlock>(*beside_sunk) : BesideWrinkles(all);
  }
};

// What is left beside a tube: straights and sides as they are without dents, whose slopes would bow
// the straights that they lie on, and press their sides in.
SurfaceForm FormBeside(const BowedTubeState& state, const FinalFit& final,
                       std::span<const PointBlock> blocks) {
  const double reach_mm = final.options.reach_mm;
  SurfaceForm form = FindForm(state, final.beside_rows_mm, blocks, reach_mm, kPerhapsDents);
  if (form.dents.empty()) return form;
  const auto undented = WithoutDents(state, final.beside_rows_mm, blocks, blocks, reach_mm);
  if (!undented) return form;
  SurfaceForm without = FindForm(state, final.beside_rows_mm, *undented, reach_mm);
  without.dents = std::move(form.dents);
  return without;
}

// Of straights what is left beside their best-fit lines, of all else beside the bows.
SurfaceForm FormOf(const FinalFit& final, const hal::Tube& tube,
                   std::span<const PointBlock> blocks) {
  SurfaceForm form = FormBeside({tube, final.fit.flattening, final.fit.easing, {}}, final, blocks);
  if (!final.bowed.is_bowed()) return form;
  SurfaceForm beside_bows = FormBeside(final.bowed, final, blocks);
  beside_bows.straights = std::move(form.straights);
  return beside_bows;
}

void TellForm(const FinalFit& final, std::span<const PointBlock> blocks, Measurement& measurement) {
  const SurfaceForm form = FormOf(final, measurement.tube, final.BesideSeam(blocks));
  ReportForm(form, final.fit.priors.radii_alike > 0, measurement);
  measurement.bows_explain_mm2 =
      ExplainedByBowsMm2(final.bowed, measurement.tube, blocks, final.options.reach_mm);
  SayUnsureBends(std::sqrt(form.sides_mm2), measurement);
}

EndCuts CutsIn(const FeaturePoints& seen, double noise_mm, TubeEnds& ends) {
  return FindEndCuts(noise_mm, seen.About(BallsAbout(ends), kStage.about_ends).blocks, ends);
}

std::vector<OpeningFound> OpeningsIn(const FeaturePoints& seen, WallCells cells,
                                     const WallSpine& wall, const TubeEnds& ends, double noise_mm,
                                     const hal::Tube& tube) {
  const std::vector<EmptyPlace> places = FindEmptyPlaces(tube, std::move(cells));
  const SeenPoints about = seen.About(BallsAbout(tube, places), kStage.about_openings);
  return FindOpenings(tube, wall, ends, noise_mm, about.blocks, places);
}

// The dents that cells showed, by their points.
void TellDents(std::span<const PointBlock> blocks, const WallSpine& wall, const TubeEnds& ends,
               double noise_mm, Measurement& measurement) {
  const CutFaces faces(measurement.tube, measurement.features);
  MeasureDents(measurement.tube, {wall, measurement.flattening}, ends, faces, noise_mm, blocks,
               measurement.dents);
  KeepPressedIn(measurement.tube, faces, noise_mm, blocks, measurement.dents);
  KeepThoseOf(measurement.tube, measurement.dents, measurement.wrinkles);
}

// The plane of what sits on an end is not the tube's.
void DropPlanesOfFittings(Measurement& measurement) {
  if (measurement.first_end.length_mm > 0) measurement.features.first_end.reset();
  if (measurement.last_end.length_mm > 0) measurement.features.last_end.reset();
}

// The nominal's bends in place of more, where dents explain what those do, or all points speak for
// them: bends may ease so that the search has never been near them. Whether these did: how many
// there are is as sure as they say then, `margin`; else it stays a close call that was one.
bool TryNominal(const hal::BendProgram& nominal, const SpinePolygon& polygon,
                std::span<const PointBlock> blocks, const SurfaceFitOptions& options,
                BowedSolution& solution, double& margin) {
  if (nominal.bend_count() >= solution.fit.tube.program.bend_count()) return false;
  const double r_mm = solution.fit.tube.pipe_radius_mm;
  BowedSolution other = SolveAnew(NominalAlong(nominal, r_mm, polygon), blocks, options);
  if (MayHideBends(other) || !MayBeByCorners(nominal, other.fit.tube, other.fit.sigma))
    return false;
  const auto more = MoreThanDents(solution, other, blocks, options.reach_mm);
  const double evidence = EvidenceFor(other, solution, blocks, options.reach_mm);
  // Of the points but those of the dents, where there are any.
  const double against = more.value_or(-evidence);
  const bool by_all = against < 0 && !more;
  margin = by_all ? -against : std::min(margin, std::abs(against));
  if (against < 0) solution = std::move(other);
  return by_all;
}

// The search knows lines and arcs alone, and finds a bend more nearly as good where there is a
// dent, a bow or an easing: by how much that is worse once they are known.
double MarginOfSearch(const SurfaceFit& structure, const BowedSolution& solution,
                      std::span<const PointBlock> blocks, const SurfaceFitOptions& options) {
  const std::size_t bends = solution.fit.tube.program.bend_count();
  const bool as_searched = IsOfLinesAndArcs(solution) && solution.fit.flattening.empty();
  if (as_searched || !structure.rival || structure.margin > kCloseCall ||
      structure.rival->program.bend_count() <= bends) {
    return structure.margin;
  }
  hal::Tube start = *structure.rival;
  ReachTo(EndsOf(structure.tube), start);
  const BowedSolution rival = SolveAnew(start, blocks, options);
  if (rival.fit.tube.program.bend_count() <= bends) return structure.margin;
  return std::max(structure.margin, EvidenceWithDents(solution, rival, blocks, options.reach_mm));
}

void LeaveOutSeamAndWrinkles(const SurfaceFit& structure, std::span<const PointBlock> blocks,
                             FinalFit& final) {
  final.seam = FindSeam(structure, blocks, final.options.reach_mm);
  if (final.seam) final.beside_seam = WithoutSeam(structure, *final.seam, blocks);
  const std::span<const PointBlock> beside_seam = final.BesideSeam(blocks);
  final.wrinkles = FindWrinkles(structure, beside_seam, final.options.reach_mm);
  if (final.wrinkles.empty()) return;
  final.beside_wrinkles = WithoutWrinkles(structure, final.wrinkles, beside_seam);
}

void TellNoise(const BowedFit& bows, FinalFit& final) {
  final.beside_rows_mm =
      final.weights.certainties.empty() ? final.fit.sigma_mm : final.weights.noise_mm;
  final.noise_mm = final.beside_rows_mm;
  if (final.bowed.is_bowed() && !bows.is_lost) {
    final.noise_mm = std::min(final.noise_mm, bows.noise_mm);
  }
}

// In all points: those of the seam were left out of the fit.
void MeasureSeamOf(FinalFit& final, std::span<const PointBlock> all) {
  if (final.seam) {
    final.seam = MeasureSeam(*final.seam, final.bowed, final.fit.tube, final.beside_rows_mm, all,
                             final.options.reach_mm);
  }
}

// What the bends' sections are, and what of them is left out.
void FitSections(std::span<const PointBlock> blocks, BowedSolution& solution, FinalFit& final) {
  RoundDentedBends(blocks, final.options, solution);
  FlattenRoundBends(blocks, final.options, solution);
  TrySectionRise(blocks, final.options, solution);
  final.options.priors.sunk = LearnSunk(solution.fit);
  final.beside_sunk = LeaveOutSunkEnds(blocks, final.options, solution);
}

FinalFit FitAllPoints(ApproximatedTube& tube, unsigned passes, const ReconstructionOptions& given,
                      const BlocksAbout& about_end, Workers* workers) {
  ReachTo({tube.polygon.front().position_mm, tube.polygon.back().position_mm}, tube.structure.tube);
  const SurfaceFit& structure = tube.structure;
  FinalFit final;
  tube.registration =
      RegisterPasses(structure, passes, given.pass_drift,
                     kStage.final_reach * structure.tube.pipe_radius_mm, tube.blocks);
  final.options = {.reach_mm = kStage.final_reach * structure.tube.pipe_radius_mm,
                   .max_length_mm = 2.0 * LengthOf(tube.polygon),
                   .flattened = !structure.flattening.empty(),
                   .priors = structure.priors,
                   .few_causes = kStage.few_causes,
                   .workers = workers};
  final.weights = WeighByIncidence(structure.tube, structure.flattening, structure.sigma_mm,
                                   final.options.reach_mm, tube.blocks, workers);
  LeaveOutSeamAndWrinkles(structure, tube.blocks, final);
  std::span<const PointBlock> blocks = final.BesideWrinkles(tube.blocks);
  final.options.hidden_mm = HiddenMm(structure, blocks, final.options.reach_mm, about_end);
  FoundEasing found = FindEasing(structure, blocks, final.options);
  RoundBendsThatEase(structure, blocks, final.options, found);
  final.options.easing = std::move(found.easing);
  BowedSolution solution = SolveWithBows(found.eased.value_or(structure.tube), blocks,
                                         final.options, std::move(found.sharp));
  const auto& nominal = given.nominal;
  const auto nominal_bends =
      nominal ? std::optional<std::size_t>(nominal->bend_count()) : std::nullopt;
  double margin = ReviseBends(blocks, final.options, nominal_bends, solution);
  const bool is_sure =
      nominal && TryNominal(*nominal, tube.polygon, blocks, final.options, solution, margin);
  FitSections(blocks, solution, final);
  blocks = final.Fitted(tube.blocks);
  TrySkewedEasing(blocks, final.options, solution);
  TryOneDie(blocks, final.options, solution);
  std::vector<Doubt> doubts;
  TryOddDie(blocks, final.options, doubts, solution);
  if (nominal) final.other_die = TryNominalDie(*nominal, blocks, final.options, doubts, solution);
  FitLast(blocks, final.options, solution);
  TryFaintDents(blocks, final.options, solution);
  TakeUsualWhereHidden(final.options, solution);
  if (!is_sure) {
    margin = std::min(margin, MarginOfSearch(structure, solution, blocks, final.options));
  }
  tube.structure.margin = margin;
  for (const Doubt& doubt : doubts) DoubtBy(doubt, final.options.free_pipe_radius, solution);
  if (nominal) TakeNominalRadii(*nominal, final.options.free_pipe_radius, solution.fit);
  final.fit = std::move(solution.fit);
  final.bowed = std::move(solution.bows.state);
  if (!tube.registration.passes.empty()) {
    Widen(tube.registration.covariance, final.options.free_pipe_radius, final.fit);
  }
  TellNoise(solution.bows, final);
  MeasureSeamOf(final, tube.blocks);
  return final;
}

}  // namespace

class Reconstruction::Impl {
 public:
  Impl(const ReconstructionOptions& options, const hal::Clock& clock)
      : options_(options),
        clock_(clock),
        intake_(options.pipe_radius_mm, options.max_points, options.max_line_points) {}

  SampleIntake& intake() { return intake_; }
  LiveView View() const;
  hal::Result<Measurement> Finish(Workers* workers);

 private:
  hal::Result<void> TakeSamples(Workers* workers, StageTimer& timer);
  std::vector<SpineNode> Project(Workers* workers);
  hal::Result<ApproximatedTube> Connect(std::span<const SpineNode> nodes) const;
  hal::Result<void> Approximate(ApproximatedTube& tube) const;
  void LookAround(ApproximatedTube& tube) const;
  void TakeOffSleeves(ApproximatedTube& tube) const;
  BlocksAbout AboutEnds() const {
    return [this](const PlainEnd& end, const EasedSpine& spine, std::size_t row) {
      return AboutEnd(end, spine, row);
    };
  }
  // Points about an end, but those on other parts of the tube than the straight of that row.
  std::vector<PointBlock> AboutEnd(const PlainEnd& end, const EasedSpine& spine,
                                   std::size_t row) const;
  // What sits on the ends, and what goes on beyond them.
  void LookBeyondEnds(const TubeEnds& ends, const FinalFit& final, Measurement& measurement) const;
  bool IsNominal(const SurfaceFit& structure) const {
    return options_.nominal && MayBeByCorners(*options_.nominal, structure.tube, structure.sigma);
  }
  // Blocks whose points may lie on the tube along the polygon.
  std::vector<std::int32_t> IndicesNear(const SpinePolygon& polygon) const;
  // Samples only, or all points.
  std::vector<PointBlock> BlocksAt(std::span<const std::int32_t> indices, bool all_points) const;
  PointBlock BlockAt(std::int32_t index, bool all_points) const;
  std::optional<std::size_t> NominalBends() const {
    if (!options_.nominal) return std::nullopt;
    return options_.nominal->bend_count();
  }

  ReconstructionOptions options_;
  const hal::Clock& clock_;
  SampleIntake intake_;
};

hal::Result<void> Reconstruction::Impl::TakeSamples(Workers* workers, StageTimer& timer) {
  if (!intake_.knows_pipe_radius()) {
    if (auto found = intake_.FindPipeRadius(workers); !found) return hal::Fail(found.error());
    timer.Done("pipe_radius");
  }
  auto taken = intake_.TakeAll(workers);
  timer.Done("samples");
  if (!taken) return hal::Fail(taken.error());
  return {};
}

hal::Result<Measurement> Reconstruction::Impl::Finish(Workers* workers) {
  StageTimer timer(clock_);
  Measurement measurement;
  if (const auto taken = TakeSamples(workers, timer); !taken) return hal::Fail(taken.error());
  const std::vector<SpineNode> nodes = Project(workers);
  timer.Done("projection");
  auto tube = Connect(nodes);
  if (!tube) return hal::Fail(tube.error());
  timer.Done("curve");
  if (const auto done = Approximate(*tube); !done) return hal::Fail(done.error());
  SayLeftOut(tube->left_out_mm, measurement.warnings);
  timer.Done("structure");
  const FinalFit final = FitAllPoints(*tube, intake_.passes(), options_, AboutEnds(), workers);
  ReportPasses(tube->registration, options_.pass_drift, measurement);
  measurement.noise_mm = final.noise_mm;
  std::tie(measurement.seam, measurement.wrinkles) = std::tie(final.seam, final.wrinkles);
  const SurfaceFit& fit = final.fit;
  timer.Done("fit");
  if (const auto shown = CheckShowsTube(fit); !shown) return hal::Fail(shown.error());
  const std::span<const PointBlock> fitted = final.Fitted(tube->blocks);
  ReportQuality(tube->structure, fit, CompareHalves(fit, fitted, final.options), NominalBends(),
                measurement);
  timer.Done("self_check");
  TubeEnds ends = FindTubeEnds(fit.tube, final.noise_mm, fitted, workers, &final.bowed);
  const bool knows_wall = !LiesOffTogether(fit);
  const FeaturePoints seen(intake_, tube->blocks, IndicesNear(tube->polygon), tube->sleeves,
                           tube->registration);
  const EndCuts cuts = knows_wall ? CutsIn(seen, final.noise_mm, ends) : EndCuts{};
  ReportEnds(fit, ends, tube->polygon.front().position_mm, tube->polygon.back().position_mm,
             measurement);
  measurement.pipe_radius_sigma_mm = fit.pipe_radius_sigma_mm;
  TellForm(final, tube->blocks, measurement);
  LookBeyondEnds(ends, final, measurement);
  if (options_.nominal) SayOtherPart(*options_.nominal, final.other_die, measurement);
  timer.Done("ends");
  const WallSpine wall = WallSpineOf(final.bowed, measurement.tube, measurement.easing);
  WallCells cells =
      DescribeSamples(seen.all(), seen.in_view(), wall, final.beside_rows_mm, measurement, workers);
  timer.Done("description");
  if (knows_wall) {
    measurement.features = {
        true, cuts.first, cuts.last,
        OpeningsIn(seen, std::move(cells), wall, ends, final.noise_mm, measurement.tube)};
  }
  TellDents(seen.all(), wall, ends, final.beside_rows_mm, measurement);
  SayDoubtfulEndBends(fit, NominalBends(), measurement);
  SayDeepDents(measurement);
  SayWhatIsAroundBends(fit, final.bowed, fitted, final.options.reach_mm, measurement);
  SayGrooves(FindGrooves(fit, fitted, final.options.reach_mm), measurement);
  DropPlanesOfFittings(measurement);
  AddAroundZero(AroundZeroSigma(fit, measurement.tube), measurement);
  measurement.joint = FindCorrelations(fit, measurement.tube.program, measurement.sigma);
  timer.Done("features");
  const auto units = CheckUnits(measurement.tube.pipe_radius_mm);
  if (!units) return hal::Fail(units.error());
  measurement.timing = std::move(timer.times);
  return measurement;
}

// Samples to nodes of the spine (sections 2 and 3).
std::vector<SpineNode> Reconstruction::Impl::Project(Workers* workers) {
  if (options_.spine_method == SpineMethod::kMls) return intake_.ProjectAll(workers);
  const double r_mm = intake_.pipe_radius_mm();
  return ShrinkPipe(
             OrientSamples(intake_.grid(), r_mm, kStage.shrink_widest, kStage.shrink_samples),
             {.radius_mm = r_mm})
      .nodes;
}

// Nodes to the polygon of the tube's spine (section 1.3).
hal::Result<ApproximatedTube> Reconstruction::Impl::Connect(
    std::span<const SpineNode> nodes) const {
  ApproximatedTube tube;
  const double r_mm = intake_.pipe_radius_mm();
  std::vector<SpinePolygon> polygons = SpinePolygons(nodes, r_mm);
  FollowThinParts(intake_.grid(), r_mm, polygons);
  auto polygon = ChooseTube(std::move(polygons), r_mm, options_.nominal, tube.left_out_mm);
  if (!polygon) return hal::Fail(polygon.error());
  tube.polygon = std::move(*polygon);
  if (IsLoop(tube.polygon, r_mm)) {
    std::vector<Eigen::Vector3d> samples;
    for (const PointBlock& block : BlocksAt(IndicesNear(tube.polygon), false)) {
      samples.insert(samples.end(), block.points.begin(), block.points.end());
    }
    if (!OpenAtGap(samples, r_mm, tube.polygon)) {
      return hal::Fail(hal::ErrorKind::kBadInput,
                       std::string(kClosedTube) +
                           ", and rows of lengths, rotations and angles go from one end to the "
                           "other (--model freeform measures its spine)");
    }
  }
  return tube;
}

// The polygon to lines and arcs (section 4), and off with a neighbour that is joined to the tube by
// a bend that no machine makes.
hal::Result<void> Reconstruction::Impl::Approximate(ApproximatedTube& tube) const {
  LookAround(tube);
  for (int i = 0; i < kStage.most_parted && !IsNominal(tube.structure); ++i) {
    auto pieces = PiecesBetweenJoints(tube.structure, tube.polygon, i == 0);
    if (pieces.size() == 1 && pieces.front().size() == tube.polygon.size()) break;
    auto polygon =
        ChooseTube(std::move(pieces), intake_.pipe_radius_mm(), options_.nominal, tube.left_out_mm);
    if (!polygon) return hal::Fail(polygon.error());
    tube.polygon = std::move(*polygon);
    LookAround(tube);
  }
  TakeOffSleeves(tube);
  return {};
}

// Bends that lead into what sits on an end are none.
void Reconstruction::Impl::TakeOffSleeves(ApproximatedTube& tube) const {
  for (const bool at_start : {true, false}) {
    const auto sleeve = FindEndSleeve(tube.structure, at_start, tube.blocks);
    if (sleeve && CutAt(*sleeve, at_start, tube.polygon)) tube.sleeves.push_back(*sleeve);
  }
  if (!tube.sleeves.empty()) LookAround(tube);
}

// Points near the polygon, and which bends they show.
void Reconstruction::Impl::LookAround(ApproximatedTube& tube) const {
  const double r_mm = intake_.pipe_radius_mm();
  const std::vector<std::int32_t> near = IndicesNear(tube.polygon);
  tube.blocks = BlocksAt(near, true);
  std::vector<PointBlock> samples = BlocksAt(near, false);
  for (const PlainEnd& sleeve : tube.sleeves) {
    LeaveOut(sleeve, r_mm, tube.blocks, tube.parted);
    LeaveOut(sleeve, r_mm, samples, tube.parted);
  }
  tube.structure =
      FindStructure(tube.polygon, r_mm, samples, tube.blocks, {.nominal = options_.nominal});
}

std::vector<std::int32_t> Reconstruction::Impl::IndicesNear(const SpinePolygon& polygon) const {
  std::vector<Eigen::Vector3d> places;
  const double r_mm = intake_.pipe_radius_mm();
  const double step_mm = 0.5 * r_mm;
  const auto along = [&](const Eigen::Vector3d& from, const Eigen::Vector3d& to) {
    const int steps = std::max(1, static_cast<int>(std::ceil((to - from).norm() / step_mm)));
    for (int i = 0; i <= steps; ++i) places.push_back(from + (to - from) * i / steps);
  };
  // Over gaps, and a little beyond the ends, where the projection has too few samples.
  const double beyond_mm = 2.0 * r_mm;
  along(polygon.front().position_mm,
        polygon.front().position_mm - beyond_mm * polygon.front().tangent);
  for (std::size_t i = 1; i < polygon.size(); ++i) {
    along(polygon[i - 1].position_mm, polygon[i].position_mm);
  }
  along(polygon.back().position_mm,
        polygon.back().position_mm + beyond_mm * polygon.back().tangent);

  return intake_.grid().BlocksNear(places, 1.5 * r_mm);
}

std::vector<PointBlock> Reconstruction::Impl::BlocksAt(std::span<const std::int32_t> indices,
                                                       bool all_points) const {
  std::vector<PointBlock> blocks;
  blocks.reserve(indices.size());
  for (const std::int32_t index : indices) {
    if (!intake_.IsPlanar(index)) blocks.push_back(BlockAt(index, all_points));
  }
  return blocks;
}

PointBlock Reconstruction::Impl::BlockAt(std::int32_t index, bool all_points) const {
  const SampleGrid::Block& block = intake_.grid().blocks()[static_cast<std::size_t>(index)];
  PointBlock out;
  out.center_mm = intake_.grid().CenterOf(block);
  out.half_diagonal_mm = 0.5 * std::sqrt(3.0) * intake_.grid().block_mm();
  out.points = all_points ? std::span(block.points) : block.samples();
  if (all_points) out.to_sensor = block.to_sensor;
  return out;
}

std::vector<PointBlock> Reconstruction::Impl::AboutEnd(const PlainEnd& end, const EasedSpine& spine,
                                                       std::size_t row) const {
  const double r_mm = intake_.pipe_radius_mm();
  std::vector<Eigen::Vector3d> places;
  for (double at = -3.0; at <= kEndFormReach; at += 0.5) {
    places.push_back(end.position_mm + at * r_mm * end.outward);
  }
  // What nearly meets this end is no fitting but another part of the tube.
  std::vector<PointBlock> near;
  for (const std::int32_t index : intake_.grid().BlocksNear(places, 3.0 * r_mm)) {
    const PointBlock block = BlockAt(index, true);
    if (!intake_.IsPlanar(index) && !IsOfAnotherPart(block, spine, row, r_mm))
      near.push_back(block);
  }
  return near;
}

void Reconstruction::Impl::LookBeyondEnds(const TubeEnds& ends, const FinalFit& final,
                                          Measurement& measurement) const {
  const double noise_mm = final.beside_rows_mm;
  const hal::Tube plain = measurement.tube;
  const double r_mm = plain.pipe_radius_mm;
  const EasedSpine spine = SpineOf(plain.program, plain.X_WT, measurement.easing);
  // Where no part of the tube is near; what lies beyond its ends is not.
  const std::vector<SegmentFrame> frames = SegmentFrames(spine, 0.0, {});
  std::vector<PointBlock> others;
  std::vector<std::int32_t> candidates;
  for (std::size_t i = 0; i < intake_.grid().blocks().size(); ++i) {
    const auto index = static_cast<std::int32_t>(i);
    const PointBlock block = BlockAt(index, true);
    CandidateSegments(block, frames, kBesideTube * r_mm, candidates);
    if (candidates.empty() && !intake_.IsPlanar(index)) others.push_back(block);
  }
  const double usual_per_mm = static_cast<double>(final.fit.used) / hal::SpineLength(plain.program);
  for (const bool at_start : {true, false}) {
    if (!(at_start ? ends.first_seen : ends.last_seen)) continue;
    const hal::SpineSegment& straight = at_start ? spine.segments.front() : spine.segments.back();
    const PlainEnd end{at_start ? straight.start_mm : straight.PointAt(straight.length_mm),
                       at_start ? Eigen::Vector3d(-straight.tangent) : straight.tangent,
                       straight.length_mm};
    const auto near = AboutEnd(end, spine, at_start ? 0 : plain.program.bend_count());
    const FoundEnd found = FindEndForm(end, r_mm, noise_mm, near, others, usual_per_mm);
    ReportEndForm(at_start, found, measurement);
    EndForm& form = at_start ? measurement.first_end : measurement.last_end;
    const double plain_mm = at_start ? ends.first_sigma_mm : ends.last_sigma_mm;
    MeasureEndProfile(end, r_mm, noise_mm, form.length_mm > 0 ? found.sigma_mm : plain_mm, near,
                      form);
  }
}

LiveView Reconstruction::Impl::View() const {
  LiveView view;
  view.profiles = intake_.profiles();
  view.points = intake_.points();
  if (!intake_.knows_pipe_radius()) return view;
  view.pipe_radius_mm = intake_.pipe_radius_mm();
  const std::vector<SpineNode> nodes = intake_.Nodes();
  view.spine_samples = nodes.size();
  const std::vector<SpinePolygon> polygons = SpinePolygons(nodes, view.pipe_radius_mm);
  if (polygons.empty()) return view;
  view.covered_mm = LengthOf(polygons.front());
  const SurfaceFit fit = GlanceAtStructure(polygons.front(), view.pipe_radius_mm,
                                           BlocksAt(IndicesNear(polygons.front()), false));
  view.program = fit.tube.program;
  view.sigma = fit.sigma;
  // Of a tube still half seen only what is already settled is worth showing.
  for (std::size_t i = 0; i < view.program.bend_count(); ++i) {
    if (view.sigma.rows[i].angle_deg < kStage.settled_deg) continue;
    view.program.rows.resize(i + 1);
    view.program.rows.back() = {view.program.rows.back().length_mm, 0.0, 0.0, std::nullopt};
    view.sigma.rows.resize(i + 1);
    view.sigma.rows.back() = {view.sigma.rows.back().length_mm, 0.0, 0.0, std::nullopt};
    break;
  }
  return view;
}

Reconstruction::Reconstruction(const ReconstructionOptions& options, const hal::Clock& clock)
    : impl_(std::make_unique<Impl>(options, clock)) {}
Reconstruction::~Reconstruction() = default;
Reconstruction::Reconstruction(Reconstruction&&) noexcept = default;
Reconstruction& Reconstruction::operator=(Reconstruction&&) noexcept = default;

void Reconstruction::Add(const hal::LaserProfile& profile) { impl_->intake().Add(profile); }
void Reconstruction::Add(std::span<const Eigen::Vector3d> points_W) {
  impl_->intake().Add(points_W);
}
LiveView Reconstruction::View() const { return impl_->View(); }
hal::Result<Measurement> Reconstruction::Finish(Workers* workers) { return impl_->Finish(workers); }

hal::Result<Measurement> Reconstruct(std::span<const Eigen::Vector3d> points_W,
                                     const ReconstructionOptions& options, const hal::Clock& clock,
                                     Workers* workers) {
  Reconstruction batch(options, clock);
  batch.impl_->intake().Lend(points_W);
  return batch.Finish(workers);
}

}  // namespace bendloop::pipeline
