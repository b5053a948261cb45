// SPDX-License-Identifier: Apache-2.0
#include "tests/support/lot_controllers.h"

#include <algorithm>
#include <cmath>

#include "pipeline/correction/tube_values.h"

namespace bendloop::support {
namespace {

using pipeline::PerAxis;
using pipeline::RowValueKind;
using pipeline::TubeValues;

class Filter final : public LotController {
 public:
  Filter(const LotBender& bender, const pipeline::RowTolerances& tolerance) : bender_(bender) {
    options_.material = bender.told();
    options_.tolerance = tolerance;
    options_.total_limit = {20, 20, 20};
  }
  hal::BendProgram Next(const hal::BendProgram& commanded, const LotBender::Scan& scan,
                        const hal::BendProgram& active) override {
    pipeline::CorrectionInput input{bender_.nominal(), commanded, scan.measured, scan.sigma,
                                    active};
    input.correlations = scan.correlations;
    input.ahead = 1 + bender_.overlap();
    const auto correction = pipeline::Correct(input, lot_, options_);
    if (!correction) return active;
    lot_ = correction->next;
    if (correction->refused()) return active;
    forecast_ = correction->forecast.part;
    return correction->corrected;
  }
  std::optional<double> forecast() const override { return forecast_; }

 private:
  const LotBender& bender_;
  pipeline::CorrectionOptions options_;
  pipeline::LotState lot_;
  std::optional<double> forecast_;
};

// Those that know one number of each value: how far it is off the material model.
class Offsets : public LotController {
 public:
  explicit Offsets(const LotBender& bender)
      : bender_(bender), values_(bender.nominal().bend_count()) {}

  hal::BendProgram Next(const hal::BendProgram& commanded, const LotBender::Scan& scan,
                        const hal::BendProgram& active) override {
    const Eigen::VectorXd model =
        pipeline::ModelValues(commanded, pipeline::Angles(scan.measured), bender_.told());
    const bool is_first = off_.size() == 0;
    if (is_first) off_ = Eigen::VectorXd::Zero(model.size());
    ++parts_;
    for (std::size_t j = 0; j < values_.size(); ++j) {
      const auto [row, kind] = values_[j];
      double seen = pipeline::ValueOf(scan.measured.rows[row], kind) - model[Eigen::Index(j)];
      if (kind == RowValueKind::kRotation) seen = hal::WrapRotationDeg(seen);
      const double sigma = pipeline::ValueOf(scan.sigma.rows[row], kind);
      off_[Eigen::Index(j)] += Gain(j, sigma) * (seen - off_[Eigen::Index(j)]);
    }
    return Aimed(active);
  }

 protected:
  virtual double Gain(std::size_t value, double sigma) = 0;
  // True: a change of `wanted` is not made.
  virtual bool IsLeft(std::size_t, double) const { return false; }
  const TubeValues& values() const { return values_; }
  unsigned parts() const { return parts_; }

 private:
  hal::BendProgram Aimed(const hal::BendProgram& active) const {
    hal::BendProgram program = active;
    const hal::BendProgram& nominal = bender_.nominal();
    const auto move = [&](std::size_t j, double& command, double wanted) {
      if (!IsLeft(j, wanted)) command += wanted;
    };
    for (std::size_t i = 0; i < nominal.bend_count(); ++i) {
      const std::size_t j = values_.Angle(i);
      double& command = program.rows[i].angle_deg;
      move(j, command,
           bender_.told().AngleToCommandDeg(nominal.rows[i].angle_deg - off_[Eigen::Index(j)]) -
               command);
      if (i == 0) continue;
      const std::size_t r = values_.Rotation(i);
      double& turn = program.rows[i].rotation_deg;
      move(r, turn,
           hal::WrapRotationDeg(nominal.rows[i].rotation_deg - off_[Eigen::Index(r)] - turn));
    }
    const std::vector<double> angles_deg = pipeline::Angles(nominal);
    for (std::size_t i = 0; i < nominal.rows.size(); ++i) {
      const std::size_t j = values_.Length(i);
      double& command = program.rows[i].length_mm;
      move(j, command,
           nominal.rows[i].length_mm - off_[Eigen::Index(j)] -
               pipeline::StretchMm(nominal, angles_deg, i, bender_.told()) - command);
    }
    return program;
  }

  const LotBender& bender_;
  TubeValues values_;
  Eigen::VectorXd off_;
  unsigned parts_ = 0;
};

class Fixed final : public Offsets {
 public:
  // `first`: of the first part.
  Fixed(const LotBender& bender, double gain, double first)
      : Offsets(bender), gain_(gain), first_(first) {}

 private:
  double Gain(std::size_t, double) override { return parts() == 1 ? first_ : gain_; }
  double gain_, first_;
};

// As the shipped cell files had it: at most 0.8, falling as 1/n to 0.05; a change below two sigma
// of what is known is not made; a part with a value that is hardly known is left out altogether.
class Decaying final : public Offsets {
 public:
  explicit Decaying(const LotBender& bender) : Offsets(bender) {
    for (std::size_t j = 0; j < values().size(); ++j) {
      variance_.push_back(std::pow(pipeline::OfKind(PerAxis{2, 2, 3}, values()[j].kind), 2));
      noise_variance_.push_back(0);
    }
  }
  hal::BendProgram Next(const hal::BendProgram& commanded, const LotBender::Scan& scan,
                        const hal::BendProgram& active) override {
    for (std::size_t j = 0; j < values().size(); ++j) {
      const auto [row, kind] = values()[j];
      if (pipeline::ValueOf(scan.sigma.rows[row], kind) >
          pipeline::OfKind(PerAxis{0.3, 0.3, 0.2}, kind)) {
        return active;
      }
    }
    return Offsets::Next(commanded, scan, active);
  }

 private:
  double Gain(std::size_t j, double sigma) override {
    const double scatter = pipeline::OfKind(PerAxis{0.05, 0.1, 0.1}, values()[j].kind);
    const double noise = scatter * scatter + sigma * sigma;
    const double gain = std::clamp(variance_[j] / (variance_[j] + noise), 0.05, 0.8);
    const double kept = (1 - gain) * (1 - gain);
    variance_[j] = kept * variance_[j] + gain * gain * noise;
    noise_variance_[j] = kept * noise_variance_[j] + gain * gain * noise;
    return gain;
  }
  bool IsLeft(std::size_t j, double wanted) const override {
    return std::abs(wanted) <= 2 * std::sqrt(noise_variance_[j]);
  }
  std::vector<double> variance_, noise_variance_;
};

class Oracle final : public LotController {
 public:
  explicit Oracle(const LotBender& bender) : bender_(bender) {}
  hal::BendProgram Next(const hal::BendProgram&, const LotBender::Scan&,
                        const hal::BendProgram& active) override {
    hal::BendProgram program = active;
    for (int step = 0; step < 4; ++step) {  // springback's slope and backlash: in a few steps
      const hal::BendProgram off =
          bender_.Expected(program, bender_.bent() + 1, bender_.bent() - bender_.overlap());
      for (std::size_t i = 0; i < program.rows.size(); ++i) {
        const hal::BendRow& n = bender_.nominal().rows[i];
        hal::BendRow& row = program.rows[i];
        row.length_mm += n.length_mm - off.rows[i].length_mm;
        row.angle_deg += i < program.bend_count() ? n.angle_deg - off.rows[i].angle_deg : 0;
        if (i > 0 && i < program.bend_count()) {
          row.rotation_deg = hal::WrapRotationDeg(
              row.rotation_deg + hal::WrapRotationDeg(n.rotation_deg - off.rows[i].rotation_deg));
        }
      }
    }
    return program;
  }

 private:
  const LotBender& bender_;
};

}  // namespace

const std::vector<LotControllerKind>& LotControllers() {
  using Tolerance = pipeline::RowTolerances;
  using Made = std::unique_ptr<LotController>;
  static const std::vector<LotControllerKind> kinds = {
      {"bendloop",
       [](const LotBender& b, const Tolerance& t) -> Made {
         return std::make_unique<Filter>(b, t);
       }},
      {"gain 1",
       [](const LotBender& b, const Tolerance&) -> Made {
         return std::make_unique<Fixed>(b, 1.0, 1.0);
       }},
      {"damping 50 %",
       [](const LotBender& b, const Tolerance&) -> Made {
         return std::make_unique<Fixed>(b, 0.5, 0.5);
       }},
      {"EWMA 0.3",
       [](const LotBender& b, const Tolerance&) -> Made {
         return std::make_unique<Fixed>(b, 0.3, 1.0);
       }},
      {"until 2026-11",
       [](const LotBender& b, const Tolerance&) -> Made { return std::make_unique<Decaying>(b); }},
      {"oracle",
       [](const LotBender& b, const Tolerance&) -> Made { return std::make_unique<Oracle>(b); }},
  };
  return kinds;
}

}  // namespace bendloop::support
