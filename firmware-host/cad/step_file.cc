// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cad/step_file.h"

#include <nlohmann/json.hpp>

#include "firmware-host/cad/cad_helper.h"
#include "firmware-host/console/output_file.h"
#include "firmware-host/console/temporary_folder.h"
#include "firmware-host/console/whole_file.h"

namespace bendloop::host {
namespace {

nlohmann::json CurveJson(const pipeline::RationalBezier& curve, const std::string& name) {
  nlohmann::json poles = nlohmann::json::array(), weights = nlohmann::json::array();
  nlohmann::json knots = {0}, multiplicities = {4};
  double scale = 1;  // so that the weight of a joint is that of the piece before
  for (std::size_t p = 0; p < curve.pieces.size(); ++p) {
    const pipeline::RationalCubic& piece = curve.pieces[p];
    if (p > 0) scale *= curve.pieces[p - 1].weight[3] / piece.weight[0];
    for (std::size_t j = p == 0 ? 0 : 1; j < 4; ++j) {
      const Eigen::Vector3d& at = piece.control_mm[j];
      poles.push_back({at.x(), at.y(), at.z()});
      weights.push_back(scale * piece.weight[j]);
    }
    knots.push_back(p + 1);
    multiplicities.push_back(p + 1 < curve.pieces.size() ? 3 : 4);
  }
  return {{"name", name},       {"degree", 3},    {"poles", std::move(poles)},
          {"weights", weights}, {"knots", knots}, {"multiplicities", multiplicities}};
}

}  // namespace

hal::Result<void> WriteStepFile(const std::string& json, const std::string& step) {
  const auto folder = TemporaryFolder::Make();
  if (!folder) return hal::Fail(folder.error());
  const std::string made = folder->path() / "made.step";
  const auto answer = RunCadHelper({"write", made}, json, step);
  if (!answer) return hal::Fail(answer.error());
  const nlohmann::json said = nlohmann::json::parse(*answer, nullptr, false);
  if (!said.is_object() || !said.contains("written")) {
    return hal::Fail(hal::ErrorKind::kBadInput,
                     step + ": OpenCASCADE cannot make it: " +
                         (said.is_object() ? said.value("error", std::string("no reason given"))
                                           : std::string("no answer")));
  }
  const auto text = ReadWholeFile(made);
  if (!text) return hal::Fail(text.error());
  return WriteOutputFile(step, *text);
}

hal::Result<void> WriteCurvesStep(std::span<const pipeline::RationalBezier* const> curves,
                                  const std::string& name, const std::string& step) {
  nlohmann::json list = nlohmann::json::array();
  for (std::size_t i = 0; i < curves.size(); ++i) {
    list.push_back(CurveJson(*curves[i], "border " + std::to_string(i + 1)));
  }
  const nlohmann::json json = {
      {"schema", "bendloop.cad-curves/1"}, {"name", name}, {"curves", std::move(list)}};
  return WriteStepFile(json.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace), step);
}

}  // namespace bendloop::host
