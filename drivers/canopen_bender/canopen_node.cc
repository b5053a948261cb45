// SPDX-License-Identifier: Apache-2.0
#include "drivers/canopen_bender/canopen_node.h"

#include <algorithm>
#include <iterator>
#include <optional>
#include <utility>

namespace bendloop::drivers {
namespace {

using hal::ErrorKind;

constexpr std::chrono::milliseconds kQueueRetry{1};
constexpr int kMaxStale = 4096;  // frames that may wait in a socket
// Objects that every node has; taken in turn, so that one that comes late is not taken for another.
constexpr ObjectId kProbes[] = {{0x1000, 0}, {0x1018, 0}, {0x1001, 0}, {0x1018, 1}};

}  // namespace

CanopenNode::CanopenNode(std::string name, std::uint8_t node_id, CanPortOpener open,
                         std::chrono::milliseconds response_timeout,
                         std::chrono::milliseconds heartbeat_timeout, hal::Clock& clock)
    : name_(std::move(name)),
      node_id_(node_id),
      open_(std::move(open)),
      response_timeout_(response_timeout),
      clock_(clock),
      watch_(node_id, heartbeat_timeout) {}

std::vector<std::uint32_t> CanopenNode::Identifiers(std::uint8_t node_id) {
  return {kCobEmcy + node_id, kCobSdoReply + node_id, kCobHeartbeat + node_id};
}

hal::Error CanopenNode::Fault(const std::string& what, const std::string& why) const {
  return {ErrorKind::kDevice,
          "bender " + name_ + ": " + what + ": " + why + watch_.Remarks(clock_.Now())};
}

hal::Result<void> CanopenNode::Open() {
  if (port_) return {};
  auto opened = open_();
  if (!opened) {
    return hal::Fail(ErrorKind::kDevice, "bender " + name_ + ": " + opened.error().message);
  }
  port_ = std::move(*opened);
  return {};
}

SdoClient::Mode CanopenNode::ModeOf(bool block) const {
  return block && !no_blocks_ ? SdoClient::Mode::kBlock : SdoClient::Mode::kPlain;
}

hal::Result<std::vector<std::uint8_t>> CanopenNode::Upload(ObjectId object, std::size_t max_size,
                                                           bool block) {
  const std::string what = "read " + hal::Name(object);
  if (auto ready = Prepare(what); !ready) return hal::Fail(ready.error());
  client_.Upload(object, max_size, ModeOf(block));
  if (auto done = Transfer(what); !done) return hal::Fail(done.error());
  return client_.data();
}

hal::Result<void> CanopenNode::Download(ObjectId object, std::vector<std::uint8_t> data,
                                        bool block) {
  const std::string what = "write " + hal::Name(object);
  if (auto ready = Prepare(what); !ready) return ready;
  client_.Download(object, std::move(data), ModeOf(block));
  return Transfer(what);
}

hal::Result<void> CanopenNode::Prepare(const std::string& what) {
  if (auto open = Open(); !open) return open;
  if (auto drained = Drain(what); !drained) return drained;
  if (watch_.lost(clock_.Now())) {
    unsure_ = true;
    return hal::Fail(Fault(what, "not asked"));
  }
  static_cast<void>(watch_.TakeRestart());
  return unsure_ ? Resynchronise() : hal::Result<void>{};
}

// Nobody has been listening for a while: answers that nobody waits for, and signs of life.
hal::Result<void> CanopenNode::Drain(const std::string& what) {
  const auto now = clock_.Now();
  for (int i = 0; i < kMaxStale; ++i) {
    auto frame = port_->Receive(std::chrono::milliseconds(0));
    if (!frame) {
      port_.reset();
      unsure_ = true;
      return hal::Fail(Fault(what, frame.error().message));
    }
    if (!*frame) break;
    watch_.Receive(**frame, now);
  }
  watch_.Listened(now, false);
  // The bus may have come back meanwhile; if not, sending will show it.
  static_cast<void>(watch_.TakeBusFailure());
  return {};
}

hal::Result<void> CanopenNode::Resynchronise() {
  const ObjectId probe = kProbes[probe_++ % std::size(kProbes)];
  client_.Upload(probe, 4, SdoClient::Mode::kTolerant);
  auto done =
      Run("ask for " + hal::Name(probe) + ", to find the node again", 2 * response_timeout_);
  // That it does not have the object is its own answer, too.
  if (!done && !client_.refused()) return done;
  unsure_ = false;
  return {};
}

hal::Result<void> CanopenNode::Transfer(const std::string& what) {
  auto done = Run(what, response_timeout_);
  if (!done) unsure_ = true;
  if (done && client_.block_declined()) no_blocks_ = true;
  return done;
}

hal::Result<bool> CanopenNode::Take(std::chrono::nanoseconds wait) {
  auto received = port_->Receive(std::chrono::ceil<std::chrono::milliseconds>(wait));
  if (!received) return hal::Fail(received.error());
  watch_.Listened(clock_.Now(), true);
  if (!*received) return false;
  const CanFrame& frame = **received;
  watch_.Receive(frame, clock_.Now());
  if (watch_.TakeRestart()) client_.GiveUp("the node restarted (boot-up message)");
  if (const auto failure = watch_.TakeBusFailure()) client_.GiveUp(*failure);
  if (frame.kind != CanFrame::Kind::kData || frame.id != kCobSdoReply + node_id_) return false;
  return client_.Receive({frame.data.data(), std::min<std::size_t>(frame.size, 8)});
}

hal::Result<void> CanopenNode::Run(const std::string& what, std::chrono::milliseconds timeout) {
  auto deadline = clock_.Now() + timeout;
  std::optional<SdoData> waiting;  // to be sent
  const auto broken = [&](const hal::Error& error) {
    port_.reset();
    return hal::Fail(Fault(what, error.message));
  };
  for (;;) {
    if (SdoData frame; !waiting && client_.NextFrame(frame)) waiting = frame;
    if (!waiting && client_.finished()) break;
    const auto now = clock_.Now();
    const bool was_finished = client_.finished();
    if (!was_finished) {
      const auto left = std::max(deadline - now, std::chrono::nanoseconds(0));
      const auto further = Take(waiting ? std::chrono::nanoseconds(0) : left);
      if (!further) return broken(further.error());
      if (*further) deadline = clock_.Now() + timeout;
      if (client_.failed()) {
        waiting.reset();  // instead of it comes the abort
        continue;
      }
    }
    if (waiting) {
      const auto sent =
          port_->Send({CanFrame::Kind::kData, kCobSdoRequest + node_id_, 8, *waiting});
      if (!sent) return broken(sent.error());
      if (*sent) {
        waiting.reset();
        deadline = clock_.Now() + timeout;
      } else if (clock_.Now() >= deadline) {
        client_.GiveUp(
            "the CAN interface's transmit queue stays full: nobody acknowledges on the "
            "bus (bit rate, wiring, the other node's power)");
        break;  // the abort could not be sent either
      } else {
        clock_.SleepFor(kQueueRetry);
      }
    } else if (clock_.Now() >= deadline) {
      client_.Timeout();
      deadline = clock_.Now() + timeout;
    }
  }
  if (!client_.failed()) return {};
  std::string why = client_.error();
  if (why.rfind("no answer", 0) == 0) {
    why = "no answer within " + std::to_string(timeout.count()) + " ms" + why.substr(9);
  }
  return hal::Fail(Fault(what, why));
}

}  // namespace bendloop::drivers
