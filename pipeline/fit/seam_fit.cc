// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/seam_fit.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <vector>

namespace bendloop::pipeline {
namespace {

struct SeamFitSettings {
  // [of its width] and [rad] To both sides: more of the wall tells hardly more of a ridge, and that
  // it curves evenly is true of a part of the turn only.
  double beside = 8.0, least_beside = 0.3, most_beside = 1.0;
  // [sigma] and [of the height, which a ridge of another form leaves] Samples further off are none
  // of the wall's.
  double flier = 5.0, flier_of_height = 0.2;
  // [rad] Within which a ridge has a width.
  double narrowest = 0.01, widest = 0.3;
  // [of the height] Once less is left it has led away.
  double least_left = 0.5;
  // Samples spread over a ridge tell its place to the root of two times its width, as a part of
  // which they tell its height. Of those at the same few angles, as a sensor's rays have, one
  // stands out by chance: they look surer of the place than of the height.
  double least_spread = 0.4;
  // [noise] 1 sigma of the wall beside it before the scan: pieces without samples leave it open.
  double wall = 1e3;
  int most_steps = 20;
  double rests = 1e-3;  // [sigma] of a step
};
constexpr SeamFitSettings kSeamFit;

// Its numbers: height, place and width; and of the wall of one piece: its offset, slope and curve.
using Of3 = Eigen::Vector3d;
using By3 = Eigen::Matrix3d;

// A piece of the tube, with the wall beside the ridge there.
struct SeamPiece {
  std::vector<const SeamSample*> samples;
  Of3 wall_mm = Of3::Zero();
};

// What a piece says, in variances of a sample.
struct PieceSums {
  By3 ridge = By3::Zero(), wall = By3::Zero(), both = By3::Zero();  // both: wall by ridge
  Of3 ridge_right = Of3::Zero(), wall_right = Of3::Zero();
  double squares_mm2 = 0, samples = 0;

  void Add(const Of3& by_ridge, const Of3& by_wall, double left_mm, double weight) {
    ridge += weight * by_ridge * by_ridge.transpose();
    wall += weight * by_wall * by_wall.transpose();
    both += weight * by_wall * by_ridge.transpose();
    ridge_right += weight * left_mm * by_ridge;
    wall_right += weight * left_mm * by_wall;
    squares_mm2 += weight * left_mm * left_mm;
    samples += 1;
  }
};

class RidgeFit {
 public:
  RidgeFit(std::span<const SeamSample> samples, const Ridge& start, double piece_mm,
           double noise_mm)
      : ridge_(start),
        start_rad_(start.around_rad),
        beside_rad_(LookedAtBeside(start.width_rad)),
        noise_mm_(noise_mm) {
    std::map<int, SeamPiece> pieces;
    for (const SeamSample& sample : samples) {
      if (std::abs(OffRad(sample)) > beside_rad_) continue;
      pieces[static_cast<int>(std::floor(sample.along_mm / piece_mm))].samples.push_back(&sample);
    }
    for (auto& [at, piece] : pieces) pieces_.push_back(std::move(piece));
  }

  std::optional<Ridge> Solve() {
    const double least_mm = kSeamFit.least_left * ridge_.height_mm;
    bool is_at_rest = false;
    for (int i = 0; i < kSeamFit.most_steps && !is_at_rest; ++i) {
      SumAll();
      const Of3 step = inverse_ * right_;
      if (!step.allFinite()) return std::nullopt;
      for (std::size_t k = 0; k < pieces_.size(); ++k) {
        pieces_[k].wall_mm += wall_inverses_[k] * (sums_[k].wall_right - sums_[k].both * step);
      }
      ridge_.height_mm += step[0], ridge_.around_rad += step[1], ridge_.width_rad += step[2];
      const bool is_ridge = ridge_.height_mm > least_mm && ridge_.width_rad > kSeamFit.narrowest &&
                            ridge_.width_rad < kSeamFit.widest &&
                            std::abs(ridge_.around_rad - start_rad_) < ridge_.width_rad;
      if (!is_ridge) return std::nullopt;
      is_at_rest = step.cwiseAbs2().cwiseQuotient(inverse_.diagonal()).maxCoeff() <
                   std::pow(kSeamFit.rests * noise_mm_, 2);
    }
    SumAll();
    const Of3 sigma = Sigmas();
    if (sigma[1] < kSeamFit.least_spread * ridge_.width_rad * sigma[0] / ridge_.height_mm) {
      return std::nullopt;
    }
    ridge_.height_sigma_mm = sigma[0];
    ridge_.around_sigma_rad = sigma[1];
    return ridge_;
  }

 private:
  // From where the ridge was looked for.
  double OffRad(const SeamSample& sample) const {
    return std::remainder(sample.around_rad - start_rad_, 2.0 * std::numbers::pi);
  }

  PieceSums SumOf(const SeamPiece& piece) const {
    PieceSums sums;
    sums.wall.diagonal().setConstant(std::pow(kSeamFit.wall, -2));
    const double limit_mm =
        kSeamFit.flier * noise_mm_ + kSeamFit.flier_of_height * ridge_.height_mm;
    for (const SeamSample* sample : piece.samples) {
      const double off_rad = OffRad(*sample), x = off_rad / beside_rad_;
      const double beside = (off_rad - (ridge_.around_rad - start_rad_)) / ridge_.width_rad;
      const double high = std::exp(-0.5 * beside * beside);
      const double steep = ridge_.height_mm * high * beside / ridge_.width_rad;
      const Of3 by_wall(1.0, x, x * x);
      const double left_mm = sample->off_mm - ridge_.height_mm * high - by_wall.dot(piece.wall_mm);
      if (left_mm * left_mm * sample->weight > limit_mm * limit_mm) continue;
      sums.Add({high, steep, steep * beside}, by_wall, left_mm, sample->weight);
    }
    return sums;
  }

  void SumAll() {
    sums_.clear(), wall_inverses_.clear();
    By3 matrix = By3::Zero();
    right_.setZero();
    for (const SeamPiece& piece : pieces_) {
      const PieceSums& of = sums_.emplace_back(SumOf(piece));
      const By3& inverse = wall_inverses_.emplace_back(of.wall.inverse());
      matrix += of.ridge - of.both.transpose() * inverse * of.both;
      right_ += RightOf(of, inverse);
    }
    inverse_ = matrix.inverse();
  }
  static Of3 RightOf(const PieceSums& of, const By3& wall_inverse) {
    return of.ridge_right - of.both.transpose() * (wall_inverse * of.wall_right);
  }

  // By what the samples leave, and where pieces pull against each other by that.
  Of3 Sigmas() const {
    double squares_mm2 = 0, free = -3;
    By3 scatter = By3::Zero();
    for (std::size_t k = 0; k < sums_.size(); ++k) {
      squares_mm2 += sums_[k].squares_mm2;
      free += std::max(0.0, sums_[k].samples - 3.0);
      const Of3 pull = RightOf(sums_[k], wall_inverses_[k]);
      scatter += pull * pull.transpose();
    }
    const double left_mm2 = std::max(noise_mm_ * noise_mm_, squares_mm2 / std::max(1.0, free));
    const Of3 by_samples = left_mm2 * inverse_.diagonal();
    const auto pieces = static_cast<double>(sums_.size());
    if (pieces < 4) return by_samples.cwiseSqrt();
    const Of3 by_pieces = pieces / (pieces - 3.0) * (inverse_ * scatter * inverse_).diagonal();
    return by_samples.cwiseMax(by_pieces).cwiseSqrt();
  }

  Ridge ridge_;
  double start_rad_, beside_rad_, noise_mm_;
  std::vector<SeamPiece> pieces_;
  std::vector<PieceSums> sums_;
  std::vector<By3> wall_inverses_;
  By3 inverse_;
  Of3 right_;
};

}  // namespace

double LookedAtBeside(double width_rad) {
  return std::clamp(kSeamFit.beside * width_rad, kSeamFit.least_beside, kSeamFit.most_beside);
}

std::optional<Ridge> FitRidge(std::span<const SeamSample> samples, const Ridge& start,
                              double piece_mm, double noise_mm) {
  return RidgeFit(samples, start, piece_mm, noise_mm).Solve();
}

}  // namespace bendloop::pipeline
