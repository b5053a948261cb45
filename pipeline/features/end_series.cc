// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/end_series.h"

#include <cmath>

namespace bendloop::pipeline {
namespace {

struct SeriesSettings {
  // [of r_P] 1 sigma of the terms of a turn, of two; of more turns as much less.
  double slope = 0.5, wave = 0.3;
};
constexpr SeriesSettings kSeries;

// `term(k, cos k, sin k)`, turn by turn.
template <class Term>
void EachTurn(double cosine, double sine, int order, Term term) {
  double c = 1.0, s = 0.0;
  for (int k = 1; k <= order; ++k) {
    const double next = c * cosine - s * sine;
    s = s * cosine + c * sine;
    c = next;
    term(k, c, s);
  }
}

}  // namespace

// Of its own: where GCC 12 sees that order 1 has three numbers it warns of Eigen's packets of two.
[[gnu::noinline]] Eigen::VectorXd SeriesAt(double cosine, double sine, int order) {
  Eigen::VectorXd terms(1 + 2 * order);
  terms[0] = 1.0;
  EachTurn(cosine, sine, order, [&](int k, double c, double s) {
    terms[2 * k - 1] = c;
    terms[2 * k] = s;
  });
  return terms;
}

double SeriesOf(const Eigen::VectorXd& series, double cosine, double sine) {
  double at = series[0];
  EachTurn(cosine, sine, OrderOf(series),
           [&](int k, double c, double s) { at += c * series[2 * k - 1] + s * series[2 * k]; });
  return at;
}

Eigen::VectorXd SeriesCertainties(int order, double pipe_radius_mm) {
  Eigen::VectorXd certainties(1 + 2 * order);
  certainties[0] = 0.0;
  for (int k = 1; k <= order; ++k) {
    const double sigma = k == 1 ? kSeries.slope : kSeries.wave * std::pow(2.0 / k, 1.5);
    certainties.segment<2>(2 * k - 1).setConstant(1.0 / (sigma * pipe_radius_mm));
  }
  return certainties;
}

}  // namespace bendloop::pipeline
