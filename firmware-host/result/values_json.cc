// SPDX-License-Identifier: Apache-2.0
#include <cmath>

#include "firmware-host/result/program_json.h"
#include "firmware-host/result/sections.h"

namespace bendloop::host {

Json PointJson(const Eigen::Vector3d& p) { return {Number(p.x()), Number(p.y()), Number(p.z())}; }

Eigen::Vector3d ReadPoint(const JsonReader& json) {
  if (json.Size(3) != 3) json.Wrong("three numbers x, y, z");
  return {json.Item(0).Number(), json.Item(1).Number(), json.Item(2).Number()};
}

Json OrientationJson(const Eigen::Quaterniond& orientation) {
  Eigen::Quaterniond q = orientation;
  if (q.w() < 0) q.coeffs() = -q.coeffs();
  return {Number(q.w(), 9), Number(q.x(), 9), Number(q.y(), 9), Number(q.z(), 9)};
}

Eigen::Quaterniond ReadOrientation(const JsonReader& json) {
  if (json.Size(4) != 4) json.Wrong("four numbers w, x, y, z");
  const Eigen::Quaterniond q(json.Item(0).Number(), json.Item(1).Number(), json.Item(2).Number(),
                             json.Item(3).Number());
  // Rounded to 1e-9 when written, so that it is a unit quaternion to that order.
  if (!(std::abs(q.norm() - 1) < 1e-3)) {
    json.Wrong("a unit quaternion");
    return Eigen::Quaterniond::Identity();
  }
  return q;
}

Json ProgramBlockJson(const hal::ProgramBlock& block) {
  return {{"part_number", block.part_number},
          {"sequence", block.sequence},
          {"crc", block.crc},
          {"rows", RowsJson(block.program)}};
}

hal::ProgramBlock ReadProgramBlock(const JsonReader& json) {
  return {json.At("part_number").Count32(),
          json.At("sequence").Count32(),
          {ReadRows(json.At("rows"))},
          json.At("crc").Count32()};
}

Json BenderJson(const CommitReport& report) {
  Json json = {
      {"outcome", Word(report.outcome)}, {"reason", report.reason}, {"sequence", report.sequence}};
  json["active"] = report.active ? ProgramBlockJson(*report.active) : Json(nullptr);
  if (report.facts) {
    json["answer"] = Word(report.facts->answer);
    json["activated"] = report.facts->activated;
    json["read_back"] = Word(report.facts->read_back);
  }
  if (!report.breach.empty()) json["breach"] = report.breach;
  return json;
}

CommitReport ReadBender(const JsonReader& json) {
  CommitReport report;
  report.outcome = ReadWord<CommitOutcome>(json.At("outcome"));
  report.reason = json.TextOr("reason");
  report.sequence = json.At("sequence").Count32();
  if (json.Has("active")) report.active = ReadProgramBlock(json.At("active"));
  if (json.Has("answer")) {
    report.facts.emplace();
    report.facts->answer = ReadWord<hal::CommitReply>(json.At("answer"));
    report.facts->activated = json.At("activated").Bool();
    report.facts->read_back = ReadWord<ReadBack>(json.At("read_back"));
  }
  report.breach = json.TextOr("breach");
  return report;
}

}  // namespace bendloop::host
