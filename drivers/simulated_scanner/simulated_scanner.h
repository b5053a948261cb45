// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "drivers/scanner_wire/wire_decoder.h"
#include "drivers/scanner_wire/wire_encoder.h"
#include "drivers/simulated_scanner/random.h"
#include "drivers/simulated_scanner/virtual_scan.h"
#include "hal/clock.h"
#include "hal/result.h"

namespace bendloop::drivers {

enum class ScanPace {
  kRealTime,  // at the profiles' times
  kMax,       // as fast as the host takes them
};

// What a scanner should not do, done once before the next profile.
struct Misbehaviour {
  enum class Kind {
    kGap,      // leaves out `amount` profiles
    kRepeat,   // sends the next profile twice
    kGarbage,  // `amount` random bytes between messages
    kCorrupt,  // one wrong byte in the next profile's message
    kBadPose,  // a whole message with a pose that is none
    kStall,    // silent for `amount` milliseconds
    kCut,      // half a message, then the connection is closed
    kFault,    // a fault event
  };
  Kind kind = Kind::kGap;
  std::uint32_t amount = 1;
};

// "gap", "repeat", "garbage", "corrupt", "bad-pose", "stall", "cut", "fault".
std::optional<Misbehaviour::Kind> MisbehaviourFromName(const std::string& name);

// A scanner on a loopback TCP port that speaks the wire protocol (../scanner_wire) and streams
// virtual scans. One host at a time; a further one is turned away. No threads: whoever owns it
// calls Poll() again and again.
class SimulatedScanner {
 public:
  // Port 0 takes any free one. `clock` must outlive the scanner.
  static hal::Result<std::unique_ptr<SimulatedScanner>> Listen(std::uint16_t port,
                                                               WireIdentity identity,
                                                               hal::Clock& clock);
  ~SimulatedScanner();
  SimulatedScanner(const SimulatedScanner&) = delete;
  SimulatedScanner& operator=(const SimulatedScanner&) = delete;

  std::uint16_t port() const { return port_; }
  bool has_host() const { return host_ >= 0; }
  // Scans that are not over yet, the running one included.
  std::size_t scans_waiting() const { return scans_.size(); }
  std::size_t scans_finished() const { return scans_finished_; }
  // Lost because the host went away in the middle.
  std::size_t scans_abandoned() const { return scans_abandoned_; }

  // Somebody pulls the trigger: the scan runs as soon as a host has started the scanner and the
  // scans before are over. Profiles with more points than the identity says are not sent.
  void Trigger(std::shared_ptr<const VirtualScan> scan, ScanPace pace);
  void Misbehave(Misbehaviour misbehaviour) { misbehaviours_.push_back(misbehaviour); }

  // Serves the network and sends what is due. Waits at most `timeout` if there is nothing to do.
  hal::Result<void> Poll(std::chrono::nanoseconds timeout);
  // A descriptor that makes a waiting Poll() return when it becomes readable, e.g. 0; -1 for none.
  void WakeOn(int descriptor) { wake_ = descriptor; }

 private:
  struct ActiveScan {
    std::shared_ptr<const VirtualScan> scan;
    ScanPace pace = ScanPace::kRealTime;
    bool begun = false;
    std::chrono::nanoseconds begun_at{0};
    std::size_t next = 0;
  };

  SimulatedScanner(WireIdentity identity, hal::Clock& clock)
      : identity_(std::move(identity)), clock_(clock), profile_(identity_.max_points) {}
  void Accept();
  void DropHost();
  void ReceiveRequests();
  void Answer(const WireMessage& request);
  void Flush();
  // Makes messages while some are due and the host takes them.
  void SendDue();
  void SendNext(ActiveScan& active);
  // Applies what waits; true if the next profile is not to be sent now.
  bool DoMisbehave(ActiveScan& active);
  // How long nothing is due.
  std::chrono::nanoseconds UntilDue() const;

  WireIdentity identity_;
  hal::Clock& clock_;
  int listener_ = -1;
  int host_ = -1;
  int wake_ = -1;
  std::uint16_t port_ = 0;
  bool started_ = false;
  WireDecoder decoder_;
  WireEncoder encoder_;
  std::vector<std::uint8_t> out_;
  std::size_t sent_ = 0;
  bool close_after_flush_ = false;
  std::deque<ActiveScan> scans_;
  std::size_t scans_finished_ = 0;
  std::size_t scans_abandoned_ = 0;
  std::deque<Misbehaviour> misbehaviours_;
  std::optional<std::chrono::nanoseconds> stalled_until_;
  hal::LaserProfile profile_;
  Random random_{1};
};

}  // namespace bendloop::drivers
