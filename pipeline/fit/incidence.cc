// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/incidence.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "pipeline/fit/nearest_lanes.h"
#include "pipeline/fit/surface_sums.h"
#include "pipeline/math/simd.h"

namespace bendloop::pipeline {
namespace {

constexpr double kOneSigma = 0.6827;  // of normal noise lies within
constexpr std::uint8_t kNotKnown = 0;

struct IncidenceSettings {
  // [mm] The least sigma that is believed: noise-free points are points too.
  double least_sigma_mm = 1e-4;
  // Points of a class; smaller ones go with their neighbours. Of 200 sigma is known to 7 %.
  double least_points = 200;
  // Of the estimates' variance is to be gained, and chi square of the classes be so much less: 4
  // sigma, where one trend is all that is asked for.
  double worthwhile = 0.01, sure = 16.0;
  // Variance of the logarithm of a class's sigma's square, times its points. From the quantile of
  // normal noise: 4 p (1 - p) / (density at 1 sigma, both sides)^2 with p = 0.6827.
  double variance_of_log = 3.7;
  // Logarithm of a variance: a factor of 5 in sigma either way. By trial.
  double most_different = 3.2;
  // The walk over the points: least points of a round, and most rounds. By trial.
  std::size_t points_of_round = 8192, most_rounds = 16;
};
constexpr IncidenceSettings kIncidence;

struct Class {
  double points = 0;
  double cosine = 0;  // mean
  double log_variance = 0;
};

// All of them, from grazing to face on.
struct Classes {
  std::vector<Class> of;
  double points = 0;
  double mean = 0;  // of log_variance, by points
};

// Least squares of values that never fall (`rising`) or never rise from class to class: pools
// neighbours that are the wrong way round.
std::vector<double> Monotone(std::span<const Class> classes, bool rising) {
  struct Pool {
    double weight, mean;
    std::size_t size;
  };
  std::vector<Pool> pools;
  for (const Class& c : classes) {
    pools.push_back({c.points, c.log_variance, 1});
    while (pools.size() > 1) {
      const Pool last = pools.back();
      Pool& before = pools[pools.size() - 2];
      if (rising ? before.mean <= last.mean : before.mean >= last.mean) break;
      before.mean =
          (before.weight * before.mean + last.weight * last.mean) / (before.weight + last.weight);
      before.weight += last.weight;
      before.size += last.size;
      pools.pop_back();
    }
  }
  std::vector<double> values;
  for (const Pool& pool : pools) values.insert(values.end(), pool.size, pool.mean);
  return values;
}

double CosineOf(std::size_t code) { return (static_cast<double>(code) - 0.5) / 254.0; }

// Between the classes' means straight, beyond them level.
double Interpolated(std::span<const Class> classes, std::span<const double> values, double cosine) {
  if (cosine <= classes.front().cosine) return values.front();
  for (std::size_t i = 1; i < classes.size(); ++i) {
    const Class &a = classes[i - 1], &b = classes[i];
    if (cosine > b.cosine) continue;
    return std::lerp(values[i - 1], values[i], (cosine - a.cosine) / (b.cosine - a.cosine));
  }
  return values.back();
}

// `counts`: points by code; `distances`: theirs, by ranges of codes that are equally long. What is
// left over goes with the last class.
Classes ClassesOf(std::span<const std::uint32_t> counts,
                  std::span<const MagnitudeHistogram> distances) {
  const std::size_t codes_of_range = counts.size() / distances.size();
  Classes classes;
  std::vector<MagnitudeHistogram> of_class;
  bool full = true;
  for (std::size_t k = 0; k < distances.size(); ++k) {
    if (full) {
      classes.of.emplace_back();
      of_class.emplace_back();
    }
    Class& c = classes.of.back();
    for (std::size_t code = k * codes_of_range; code < (k + 1) * codes_of_range; ++code) {
      c.points += counts[code];
      c.cosine += counts[code] * CosineOf(code);
    }
    of_class.back().Add(distances[k]);
    full = c.points >= kIncidence.least_points;
  }
  if (!full && classes.of.size() > 1) {
    Class& last_full = classes.of[classes.of.size() - 2];
    last_full.points += classes.of.back().points;
    last_full.cosine += classes.of.back().cosine;
    of_class[of_class.size() - 2].Add(of_class.back());
    classes.of.pop_back();
    of_class.pop_back();
  }
  for (std::size_t i = 0; i < classes.of.size(); ++i) {
    Class& c = classes.of[i];
    c.cosine /= c.points;
    c.log_variance =
        2.0 * std::log(std::max(kIncidence.least_sigma_mm, of_class[i].Quantile(kOneSigma)));
    classes.points += c.points;
    classes.mean += c.points * c.log_variance;
  }
  classes.mean /= classes.points;
  return classes;
}

// Of each class the logarithm of its variance, monotone either way, as the distances have it; both
// keep the mean. None: they are alike, or not known better than that.
std::vector<double> TrendOf(const Classes& classes) {
  std::vector<double> best;
  double best_spread = 0;  // the variance that it explains
  for (const bool rising : {false, true}) {
    std::vector<double> values = Monotone(classes.of, rising);
    double spread = 0;
    for (std::size_t i = 0; i < classes.of.size(); ++i) {
      spread += classes.of[i].points * (values[i] - classes.mean) * (values[i] - classes.mean) /
                classes.points;
    }
    if (spread <= best_spread) continue;
    best_spread = spread;
    best = std::move(values);
  }
  const double least = std::max(kIncidence.worthwhile,
                                kIncidence.sure * kIncidence.variance_of_log / classes.points);
  if (best_spread < least) return {};
  return best;
}

// Towards the sensor, unit vectors.
BENDLOOP_LOOP void UnpackBody(const SensorDirection* from, std::size_t count, PointLanes& to) {
  for (std::size_t i = 0; i < count; ++i) {
    const UnpackedDirection direction = UnpackDirection(from[i]);
    to.x[i] = direction.x;
    to.y[i] = direction.y;
    to.z[i] = direction.z;
  }
}
BENDLOOP_MULTIVERSION(void, Unpack,
                      (const SensorDirection* from, std::size_t count, PointLanes& to),
                      (from, count, to))

// The incidence of the rays from points to the sensor on the segment's pipe, from how far they pass
// by its axis: noise along the ray does not move them, and so a point's certainty does not depend
// on its own error. 0: they miss the pipe.
BENDLOOP_LOOP void CosinesBody(const SegmentFrame& frame, const LocalLanes& local,
                               const PointLanes& to_sensor, double inverse_radius, double least,
                               double* cosines) {
  const double tx = frame.tangent.x(), ty = frame.tangent.y(), tz = frame.tangent.z();
  const double ax = frame.across.x(), ay = frame.across.y(), az = frame.across.z();
  const double nx = frame.normal.x(), ny = frame.normal.y(), nz = frame.normal.z();
  const double bend_radius = frame.bend_radius_mm;
  const double arc = bend_radius > 0 ? 1.0 : 0.0;
  for (std::size_t i = 0; i < kBatch; ++i) {
    const double ux = to_sensor.x[i] * tx + to_sensor.y[i] * ty + to_sensor.z[i] * tz;
    const double uy = to_sensor.x[i] * ax + to_sensor.y[i] * ay + to_sensor.z[i] * az;
    const double uz = to_sensor.x[i] * nx + to_sensor.y[i] * ny + to_sensor.z[i] * nz;
    // Across the axis there: of an arc away from its centre, of a line along y; and along z.
    const double x = arc * local.x[i], y = local.y[i];
    const double rho = std::sqrt(x * x + y * y);
    const double inverse = 1.0 / (rho > 0 ? rho : 1.0);
    const double outward = (x * ux + y * uy) * inverse;
    const double v = rho - bend_radius;
    const double by = (v * uz - local.z[i] * outward) * inverse_radius;
    const double cosine2 = outward * outward + uz * uz - by * by;
    cosines[i] = std::sqrt(cosine2 > least * least ? cosine2 : least * least);
  }
}
BENDLOOP_MULTIVERSION(void, Cosines,
                      (const SegmentFrame& frame, const LocalLanes& local,
                       const PointLanes& to_sensor, double inverse_radius, double least,
                       double* cosines),
                      (frame, local, to_sensor, inverse_radius, least, cosines))

// Codes of the blocks' points, and the noise by them.
class IncidenceWalk {
 public:
  IncidenceWalk(const hal::Tube& tube, std::span<const Flattening> flattening, double sigma_mm,
                double reach_mm)
      : frames_(SegmentFrames(hal::SpineSegments(tube.program, tube.X_WT),
                              kBeyond * tube.pipe_radius_mm, flattening)),
        pipe_radius_mm_(tube.pipe_radius_mm),
        reach_mm_(reach_mm),
        // The outermost 2 sigma of the pipe's width.
        least_cosine_(std::min(1.0, 2.0 * std::sqrt(sigma_mm / tube.pipe_radius_mm))) {}

  void Add(const PointBlock& block, std::uint8_t* codes) {
    std::fill_n(codes, block.points.size(), kNotKnown);
    if (block.to_sensor.empty()) return;
    CandidateSegments(block, frames_, pipe_radius_mm_ + reach_mm_, candidates_);
    if (candidates_.empty()) return;
    cosines_.resize(std::max(cosines_.size(), candidates_.size()));
    for (std::size_t first = 0; first < block.points.size(); first += kBatch) {
      const std::size_t count = std::min(kBatch, block.points.size() - first);
      const auto directions = block.to_sensor.subspan(first, count);
      nearest_.Find(block.points.subspan(first, count), frames_, pipe_radius_mm_, candidates_);
      Unpack(directions.data(), count, to_sensor_);
      for (std::size_t c = 0; c < candidates_.size(); ++c) {
        Cosines(frames_[static_cast<std::size_t>(candidates_[c])], nearest_.Local(c), to_sensor_,
                1.0 / pipe_radius_mm_, least_cosine_, cosines_[c].data());
      }
      for (std::size_t i = 0; i < count; ++i) {
        if (!directions[i].known()) continue;
        const std::size_t c = nearest_.Candidate(i);
        const double distance_mm = nearest_.Local(c).distance[i] - pipe_radius_mm_;
        codes[first + i] = NoiseByIncidence::CodeOf(cosines_[c][i]);
        if (std::abs(distance_mm) < reach_mm_) noise_.Add(codes[first + i], distance_mm);
      }
    }
  }

  const NoiseByIncidence& noise() const { return noise_; }

 private:
  std::vector<SegmentFrame> frames_;
  double pipe_radius_mm_, reach_mm_, least_cosine_;
  NoiseByIncidence noise_;
  std::vector<std::int32_t> candidates_;
  NearestLanes nearest_;
  PointLanes to_sensor_;
  std::vector<std::array<double, kBatch>> cosines_;
};

}  // namespace

void NoiseByIncidence::Add(const NoiseByIncidence& other) {
  for (std::size_t i = 0; i < kClasses; ++i) classes_[i].Add(other.classes_[i]);
  for (std::size_t code = 0; code < kCodes; ++code) counts_[code] += other.counts_[code];
}

double NoiseByIncidence::SigmaMm() const {
  MagnitudeHistogram all;
  for (const MagnitudeHistogram& of_class : classes_) all.Add(of_class);
  return all.Quantile(kOneSigma);
}

std::optional<std::array<float, NoiseByIncidence::kCodes>> NoiseByIncidence::Certainties() const {
  const Classes classes = ClassesOf(counts_, classes_);
  if (classes.of.size() < 2) return std::nullopt;
  const std::vector<double> trend = TrendOf(classes);
  if (trend.empty()) return std::nullopt;

  std::array<double, kCodes> relative{};
  double squares = 0;
  for (std::size_t code = 1; code < kCodes; ++code) {
    const double log_variance = std::clamp(Interpolated(classes.of, trend, CosineOf(code)),
                                           classes.mean - kIncidence.most_different,
                                           classes.mean + kIncidence.most_different);
    relative[code] = std::exp(0.5 * (classes.mean - log_variance));
    squares += counts_[code] * relative[code] * relative[code];
  }
  const double scale = std::sqrt(classes.points / squares);
  std::array<float, kCodes> certainties{};
  for (std::size_t code = 1; code < kCodes; ++code) {
    certainties[code] = static_cast<float>(scale * relative[code]);
  }
  certainties[kNotKnown] = 1.0F;
  return certainties;
}

IncidenceWeights WeighByIncidence(const hal::Tube& tube, std::span<const Flattening> flattening,
                                  double sigma_mm, double reach_mm, std::span<PointBlock> blocks,
                                  Workers* workers) {
  IncidenceWeights weights;
  const auto sees_sensor = [](const PointBlock& block) { return !block.to_sensor.empty(); };
  if (std::none_of(blocks.begin(), blocks.end(), sees_sensor)) return weights;
  std::vector<std::size_t> first;  // of a block's points among all
  std::size_t points = 0;
  for (const PointBlock& block : blocks) {
    first.push_back(points);
    points += block.points.size();
  }
  std::vector<std::uint8_t> codes(points);
  const std::vector<BlockRange> rounds =
      EvenRounds(blocks, kIncidence.points_of_round, kIncidence.most_rounds);
  std::vector<IncidenceWalk> walks(rounds.size(),
                                   IncidenceWalk(tube, flattening, sigma_mm, reach_mm));
  ParallelFor(workers, rounds.size(), [&](std::size_t round) {
    for (std::size_t b = rounds[round].begin; b < rounds[round].end; ++b) {
      walks[round].Add(blocks[b], codes.data() + first[b]);
    }
  });
  NoiseByIncidence noise = walks.front().noise();
  for (std::size_t round = 1; round < walks.size(); ++round) noise.Add(walks[round].noise());
  const auto certainties = noise.Certainties();
  if (!certainties) return weights;
  weights.noise_mm = noise.SigmaMm();
  weights.certainties.reserve(points);
  for (const std::uint8_t code : codes) weights.certainties.push_back((*certainties)[code]);
  for (std::size_t b = 0; b < blocks.size(); ++b) {
    blocks[b].certainties = {weights.certainties.data() + first[b], blocks[b].points.size()};
  }
  return weights;
}

}  // namespace bendloop::pipeline
