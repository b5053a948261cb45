// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>

#include "config/part_config.h"
#include "hal/register_map.h"

namespace bendloop::config {

enum class ScannerKind : std::uint8_t { kSimulated, kStream, kUsb, kSession };

// A USB device's numbers.
struct UsbId {
  std::uint16_t vendor = 0;
  std::uint16_t product = 0;
};
// "1209:0001", in hexadecimal.
std::optional<UsbId> ParseUsbId(const std::string& text);

// Where profiles come from.
struct ScannerConfig {
  ScannerKind kind = ScannerKind::kStream;
  std::string host = "127.0.0.1";    // kSimulated, kStream
  std::uint16_t port = 7420;         // kSimulated, kStream
  std::string usb_id = "1209:0001";  // kUsb: the maker's numbers
  std::string serial;                // kUsb: of the device; "": the only one
  std::filesystem::path session;     // kSession: the recording to play
  // What a live scanner is set to; 0: as it is.
  double profiles_per_second = 0;
  std::uint32_t exposure_us = 0;
  // Between acquisition and pipeline; all memory is taken at the start.
  std::size_t queue_profiles = 1024;
};

// Which end of the nominal the scan begins with.
enum class ScanDirection : std::uint8_t { kAuto, kForward, kReverse };
// What ends a scan: the scanner's word, or the nominal being covered.
enum class ScanEnd : std::uint8_t { kEvent, kCoverage };

// How the cell knows that a scan shows another tube than the scan before. kAuto: by the bender's
// count where its register map has parts_bent; where it has not, nothing is corrected.
enum class TubeSource : std::uint8_t { kAuto, kCounted, kEachScan };

struct ScanConfig {
  ScanDirection direction = ScanDirection::kAuto;
  ScanEnd end = ScanEnd::kEvent;
  double max_seconds = 120;         // a longer scan is ended and held
  double silence_seconds = 5;       // with kCoverage: so long without points, and the part is over
  std::uint32_t min_profiles = 20;  // a shorter one is not a scan
  TubeSource tubes = TubeSource::kAuto;
  // Tubes that were bent after the one that is scanned; empty: as many as at the first scan.
  std::optional<std::int64_t> parts_between = 0;
  // 1 sigma of how far a pass of the scan may lie beside the others, by an arm that drifts.
  double pass_drift_mm = 0.05;
  double pass_drift_deg = 0.02;
};

enum class BenderKind : std::uint8_t {
  kNone,
  kModbusTcp,
  kModbusRtu,
  kCanIsotp,
  kCanopen,
  kSimulated,
};
// A machine behind it that really bends.
constexpr bool IsReal(BenderKind kind) {
  return kind == BenderKind::kModbusTcp || kind == BenderKind::kModbusRtu ||
         kind == BenderKind::kCanIsotp || kind == BenderKind::kCanopen;
}
enum class SerialParity : std::uint8_t { kNone, kEven, kOdd };

// How the bender is reached.
struct BenderConfig {
  BenderKind link = BenderKind::kNone;
  std::string host = "127.0.0.1";  // numeric: a name's look-up has no bounded time
  std::uint16_t port = 502;
  std::string device;  // kModbusRtu, as the four below: the serial port
  int baud = 19200;
  SerialParity parity = SerialParity::kEven;
  int stop_bits = 1;
  bool rs485 = false;  // the port switches the line's direction, with pauses around each request
  std::chrono::milliseconds rs485_delay_before_send{0};
  std::chrono::milliseconds rs485_delay_after_send{0};
  std::string can_interface;             // kCanIsotp, kCanopen
  std::uint32_t can_request_id = 0x7e0;  // kCanIsotp
  std::uint32_t can_reply_id = 0x7e8;    // kCanIsotp
  std::uint8_t can_node_id = 1;          // kCanopen, as the four below
  std::filesystem::path object_dictionary_file;
  std::uint32_t can_vendor_id = 0;  // as the object dictionary says; 0: not told
  std::uint32_t can_product_code = 0;
  std::chrono::milliseconds heartbeat_timeout{2000};  // 0: the node sends no heartbeat
  std::uint8_t unit_id = 1;
  std::filesystem::path register_map_file;
  hal::RegisterMap register_map;  // loaded from register_map_file; unused when link is kNone
  std::chrono::milliseconds connect_timeout{1000};
  std::chrono::milliseconds response_timeout{500};
  std::chrono::milliseconds byte_timeout{0};       // between two bytes; 0: response_timeout alone
  std::chrono::milliseconds commit_timeout{5000};  // until the bender acknowledges
  bool allow_non_atomic = false;  // send to a controller without a commit register, too
};

struct CorrectionLimits {
  double length_mm = 0;
  double rotation_deg = 0;
  double angle_deg = 0;
};

// What a correction may do; what it goes by the lot teaches (pipeline/correction/README.md).
struct CorrectionConfig {
  bool enabled = true;
  bool correct_lengths = true;
  bool correct_rotations = true;
  bool correct_angles = true;
  // Part of each change that is wanted and made, 0..1. The filter damps by itself.
  double gain_length = 1.0;
  double gain_rotation = 1.0;
  double gain_angle = 1.0;
  CorrectionLimits max_step{2.0, 3.0, 5.0};    // from one part to the next
  CorrectionLimits max_total{5.0, 8.0, 12.0};  // from the nominal
  double deadband_sigmas = 1;  // changes below so many 1-sigma of what is known are not made
};

// A part that misses one of these is not measured well enough to be acted on: the run is refused.
struct InterlockConfig {
  double min_coverage = 0.8;                  // fraction of the spine with samples
  double max_gap_mm = 60;                     // longest piece of the spine without samples
  double max_fit_rms_mm = 0.3;                // of the samples from the fitted surface
  CorrectionLimits max_sigma{0.3, 0.3, 0.2};  // 1 sigma of any corrected row
  double max_session_age_s = 600;             // from the end of the scan to the commit
};

// How a measured value is judged against its tolerance (ISO 14253-1). kSimple: in or out as it was
// measured. kGuarded: in, or out, when it is by `guard_factor` times its standard uncertainty, and
// undecided between.
enum class VerdictRule : std::uint8_t { kSimple, kGuarded };
struct VerdictConfig {
  VerdictRule rule = VerdictRule::kGuarded;
  double guard_factor = 2;  // 1.65: at most 5 % of the tubes that pass are out; 2: 2.3 %
};

struct RecordConfig {
  std::filesystem::path directory = "sessions";  // below state_dir unless absolute
  std::uint64_t disk_budget_mb = 4096;           // the oldest sessions go first
};

// What may stay on the disk, and for how long (firmware-host/retention).
struct StorageConfig {
  double max_age_days = 365;         // 0: no limit
  std::uint64_t min_free_mb = 1024;  // of the file system; 0: whatever is free
  // The report of the latest parts is written at each so many; 0: only when somebody asks.
  std::uint32_t report_every_parts = 20;
  double shift_hours = 8;  // the log says so often what was done; 0: never
};

enum class LogLevel : std::uint8_t { kDebug, kInfo, kWarning, kError };

enum class RealtimeMode : std::uint8_t { kRequired, kBestEffort };

struct RealtimeConfig {
  RealtimeMode mode = RealtimeMode::kBestEffort;
  std::optional<int> cpu;  // the acquisition thread is bound to it; empty: any
  int priority = 50;       // SCHED_FIFO
};

// Everything the daemon knows about its cell. The defaults here are the defaults of the cell file,
// schema "bendloop.cell/1" (README.md). Paths are absolute after loading.
struct CellConfig {
  std::string name;
  std::filesystem::path part_file;
  PartConfig part;  // loaded from part_file
  // Of the parts that the PLC may set by their numbers; empty: none but `part`.
  std::filesystem::path parts_dir;
  std::filesystem::path state_dir = "/var/lib/bendloop";
  ScannerConfig scanner;
  ScanConfig scan;
  BenderConfig bender;
  CorrectionConfig correction;
  InterlockConfig interlocks;
  VerdictConfig verdict;
  RecordConfig record;
  StorageConfig storage;
  LogLevel log_level = LogLevel::kInfo;
  RealtimeConfig realtime;

  std::filesystem::path file;  // where it came from; empty: from text
};

// How tubes are told apart in this cell; kAuto: not at all, so that nothing may be corrected.
TubeSource TubesOf(const CellConfig& cell);

}  // namespace bendloop::config
