// SPDX-License-Identifier: Apache-2.0
#include "config/fields.h"

namespace bendloop::config {
namespace {

// A belt between bender and scanner holds a few tubes; a ledger of many more would tell nothing.
constexpr std::int64_t kMostPartsBetween = 20;

constexpr Choice<ScannerKind> kScannerKinds[] = {{"simulated", ScannerKind::kSimulated},
                                                 {"stream", ScannerKind::kStream},
                                                 {"usb", ScannerKind::kUsb},
                                                 {"session", ScannerKind::kSession}};
constexpr Choice<ScanDirection> kDirections[] = {{"auto", ScanDirection::kAuto},
                                                 {"forward", ScanDirection::kForward},
                                                 {"reverse", ScanDirection::kReverse}};
constexpr Choice<ScanEnd> kEnds[] = {{"event", ScanEnd::kEvent}, {"coverage", ScanEnd::kCoverage}};
constexpr Choice<TubeSource> kTubeSources[] = {{"auto", TubeSource::kAuto},
                                               {"counted", TubeSource::kCounted},
                                               {"each-scan", TubeSource::kEachScan}};
constexpr Choice<BenderKind> kBenderKinds[] = {{"none", BenderKind::kNone},
                                               {"modbus-tcp", BenderKind::kModbusTcp},
                                               {"modbus-rtu", BenderKind::kModbusRtu},
                                               {"can-isotp", BenderKind::kCanIsotp},
                                               {"canopen", BenderKind::kCanopen},
                                               {"simulated", BenderKind::kSimulated}};
constexpr Choice<SerialParity> kParities[] = {
    {"none", SerialParity::kNone}, {"even", SerialParity::kEven}, {"odd", SerialParity::kOdd}};
constexpr Choice<VerdictRule> kVerdictRules[] = {{"simple", VerdictRule::kSimple},
                                                 {"guarded", VerdictRule::kGuarded}};
constexpr Choice<LogLevel> kLogLevels[] = {{"debug", LogLevel::kDebug},
                                           {"info", LogLevel::kInfo},
                                           {"warning", LogLevel::kWarning},
                                           {"error", LogLevel::kError}};
constexpr Choice<RealtimeMode> kRealtimeModes[] = {{"required", RealtimeMode::kRequired},
                                                   {"best-effort", RealtimeMode::kBestEffort}};

void Milliseconds(FieldVisitor& v, std::string_view key, std::chrono::milliseconds& value,
                  std::int64_t min, std::int64_t max) {
  std::int64_t count = value.count();
  v.Integer(key, count, min, max);
  value = std::chrono::milliseconds(count);
}

void VisitScanner(FieldVisitor& v, ScannerConfig& scanner) {
  v.Enum("kind", scanner.kind, kScannerKinds, Need::kRequired);
  v.Text("host", scanner.host);
  v.Integer("port", scanner.port, 1, 65535);
  v.Text("usb_id", scanner.usb_id);
  v.Text("serial", scanner.serial);
  v.Path("session", scanner.session);
  v.Number("profiles_per_second", scanner.profiles_per_second, {0, 100000});
  v.Integer("exposure_us", scanner.exposure_us, 0, 1000000);
  v.Integer("queue_profiles", scanner.queue_profiles, 16, 65536);
}

void VisitScan(FieldVisitor& v, ScanConfig& scan) {
  v.Enum("direction", scan.direction, kDirections);
  v.Enum("end", scan.end, kEnds);
  v.Number("max_seconds", scan.max_seconds, {1, 3600});
  v.Number("silence_seconds", scan.silence_seconds, {0.5, 3600});
  v.Integer("min_profiles", scan.min_profiles, 1, 1000000);
  v.Enum("tubes", scan.tubes, kTubeSources);
  v.IntegerOrWord("parts_between", scan.parts_between, 0, kMostPartsBetween, "auto");
  v.Number("pass_drift_mm", scan.pass_drift_mm, {0.0001, 10});
  v.Number("pass_drift_deg", scan.pass_drift_deg, {0.0001, 10});
}

void VisitBender(FieldVisitor& v, BenderConfig& bender) {
  v.Enum("link", bender.link, kBenderKinds, Need::kRequired);
  v.Text("host", bender.host);
  v.Integer("port", bender.port, 1, 65535);
  v.Text("device", bender.device);
  v.Integer("baud", bender.baud, 1200, 921600);
  v.Enum("parity", bender.parity, kParities);
  v.Integer("stop_bits", bender.stop_bits, 1, 2);
  v.Bool("rs485", bender.rs485);
  Milliseconds(v, "rs485_delay_before_send_ms", bender.rs485_delay_before_send, 0, 100);
  Milliseconds(v, "rs485_delay_after_send_ms", bender.rs485_delay_after_send, 0, 100);
  v.Text("can_interface", bender.can_interface);
  v.Integer("can_request_id", bender.can_request_id, 0, 0x1fffffff);
  v.Integer("can_reply_id", bender.can_reply_id, 0, 0x1fffffff);
  v.Integer("can_node_id", bender.can_node_id, 1, 127);
  v.Path("object_dictionary", bender.object_dictionary_file);
  v.Integer("unit_id", bender.unit_id, 0, 255);
  v.Path("register_map", bender.register_map_file);
  Milliseconds(v, "connect_timeout_ms", bender.connect_timeout, 10, 60000);
  Milliseconds(v, "response_timeout_ms", bender.response_timeout, 10, 60000);
  Milliseconds(v, "byte_timeout_ms", bender.byte_timeout, 0, 60000);
  Milliseconds(v, "heartbeat_timeout_ms", bender.heartbeat_timeout, 0, 60000);
  Milliseconds(v, "commit_timeout_ms", bender.commit_timeout, 10, 600000);
  v.Bool("allow_non_atomic", bender.allow_non_atomic);
}

void VisitCorrection(FieldVisitor& v, CorrectionConfig& correction) {
  v.Bool("enabled", correction.enabled);
  v.Bool("correct_lengths", correction.correct_lengths);
  v.Bool("correct_rotations", correction.correct_rotations);
  v.Bool("correct_angles", correction.correct_angles);
  v.Number("gain_length", correction.gain_length, {0, 1});
  v.Number("gain_rotation", correction.gain_rotation, {0, 1});
  v.Number("gain_angle", correction.gain_angle, {0, 1});
  v.Number("max_step_length_mm", correction.max_step.length_mm, {0, 100});
  v.Number("max_step_rotation_deg", correction.max_step.rotation_deg, {0, 90});
  v.Number("max_step_angle_deg", correction.max_step.angle_deg, {0, 90});
  v.Number("max_total_length_mm", correction.max_total.length_mm, {0, 200});
  v.Number("max_total_rotation_deg", correction.max_total.rotation_deg, {0, 90});
  v.Number("max_total_angle_deg", correction.max_total.angle_deg, {0, 90});
  v.Number("deadband_sigmas", correction.deadband_sigmas, {0, 10});
}

void VisitInterlocks(FieldVisitor& v, InterlockConfig& interlocks) {
  v.Number("min_coverage", interlocks.min_coverage, {0, 1});
  v.Number("max_gap_mm", interlocks.max_gap_mm, {0.1, 10000});
  v.Number("max_fit_rms_mm", interlocks.max_fit_rms_mm, {0.001, 100});
  v.Number("max_sigma_length_mm", interlocks.max_sigma.length_mm, {0.001, 100});
  v.Number("max_sigma_rotation_deg", interlocks.max_sigma.rotation_deg, {0.001, 90});
  v.Number("max_sigma_angle_deg", interlocks.max_sigma.angle_deg, {0.001, 90});
  v.Number("max_session_age_s", interlocks.max_session_age_s, {1, 86400});
}

}  // namespace

void VisitCell(FieldVisitor& v, CellConfig& cell) {
  v.Text("name", cell.name, Need::kRequired);
  v.Path("part", cell.part_file, Need::kRequired);
  v.Path("parts_dir", cell.parts_dir);
  v.Path("state_dir", cell.state_dir);
  v.Table("scanner", Need::kRequired, [&](FieldVisitor& t) { VisitScanner(t, cell.scanner); });
  v.Table("scan", Need::kOptional, [&](FieldVisitor& t) { VisitScan(t, cell.scan); });
  v.Table("bender", Need::kRequired, [&](FieldVisitor& t) { VisitBender(t, cell.bender); });
  v.Table("correction", Need::kOptional,
          [&](FieldVisitor& t) { VisitCorrection(t, cell.correction); });
  v.Table("interlocks", Need::kOptional,
          [&](FieldVisitor& t) { VisitInterlocks(t, cell.interlocks); });
  v.Table("verdict", Need::kOptional, [&](FieldVisitor& t) {
    t.Enum("rule", cell.verdict.rule, kVerdictRules);
    t.Number("guard_factor", cell.verdict.guard_factor, {0, 10});
  });
  v.Table("record", Need::kOptional, [&](FieldVisitor& t) {
    std::string directory = cell.record.directory.string();
    t.Text("directory", directory);  // below state_dir, which the loader sees to
    cell.record.directory = directory;
    t.Integer("disk_budget_mb", cell.record.disk_budget_mb, 1, 100000000);
  });
  v.Table("storage", Need::kOptional, [&](FieldVisitor& t) {
    t.Number("max_age_days", cell.storage.max_age_days, {0, 36500});
    t.Integer("min_free_mb", cell.storage.min_free_mb, 0, 100000000);
    t.Integer("report_every_parts", cell.storage.report_every_parts, 0, 1000000);
    t.Number("shift_hours", cell.storage.shift_hours, {0, 744});
  });
  v.Table("log", Need::kOptional,
          [&](FieldVisitor& t) { t.Enum("level", cell.log_level, kLogLevels); });
  v.Table("realtime", Need::kOptional, [&](FieldVisitor& t) {
    t.Enum("mode", cell.realtime.mode, kRealtimeModes);
    if (t.Present("cpu", cell.realtime.cpu.has_value())) {
      int cpu = cell.realtime.cpu.value_or(0);
      t.Integer("cpu", cpu, 0, 1023);
      cell.realtime.cpu = cpu;
    }
    t.Integer("priority", cell.realtime.priority, 1, 99);
  });
}

}  // namespace bendloop::config
