// SPDX-License-Identifier: Apache-2.0
#include "drivers/simulated_scanner/simulated_scanner.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <ctime>
#include <system_error>
#include <utility>

#include "drivers/scanner_wire/crc32c.h"
#include "drivers/scanner_wire/wire_bytes.h"

namespace bendloop::drivers {
namespace {

using hal::ErrorKind;
using hal::Fail;
using hal::Result;
using std::chrono::nanoseconds;

// Messages are made while fewer bytes than this wait for the host: back-pressure.
constexpr std::size_t kMostWaitingBytes = 256 * 1024;
constexpr int kMostProfilesAPoll = 256;

hal::Error SocketError(const std::string& what) {
  return {ErrorKind::kDevice,
          "simulated scanner: " + what + ": " + std::generic_category().message(errno)};
}

}  // namespace

std::optional<Misbehaviour::Kind> MisbehaviourFromName(const std::string& name) {
  using Kind = Misbehaviour::Kind;
  constexpr std::array<std::pair<const char*, Kind>, 8> kNames = {{{"gap", Kind::kGap},
                                                                   {"repeat", Kind::kRepeat},
                                                                   {"garbage", Kind::kGarbage},
                                                                   {"corrupt", Kind::kCorrupt},
                                                                   {"bad-pose", Kind::kBadPose},
                                                                   {"stall", Kind::kStall},
                                                                   {"cut", Kind::kCut},
                                                                   {"fault", Kind::kFault}}};
  for (const auto& [known, kind] : kNames) {
    if (name == known) return kind;
  }
  return std::nullopt;
}

Result<std::unique_ptr<SimulatedScanner>> SimulatedScanner::Listen(std::uint16_t port,
                                                                   WireIdentity identity,
                                                                   hal::Clock& clock) {
  identity.max_points =
      std::clamp(identity.max_points, std::uint32_t{1}, std::uint32_t{kWireMaxPoints});
  std::unique_ptr<SimulatedScanner> scanner(new SimulatedScanner(std::move(identity), clock));
  scanner->listener_ = socket(AF_INET, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
  if (scanner->listener_ < 0) return Fail(SocketError("cannot make a socket"));
  const int on = 1;
  setsockopt(scanner->listener_, SOL_SOCKET, SO_REUSEADDR, &on, sizeof(on));
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(port);
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  socklen_t size = sizeof(address);
  auto* const generic = reinterpret_cast<sockaddr*>(&address);
  if (bind(scanner->listener_, generic, size) != 0 || listen(scanner->listener_, 4) != 0 ||
      getsockname(scanner->listener_, generic, &size) != 0) {
    return Fail(SocketError("cannot listen on 127.0.0.1:" + std::to_string(port)));
  }
  scanner->port_ = ntohs(address.sin_port);
  return scanner;
}

SimulatedScanner::~SimulatedScanner() {
  if (host_ >= 0) close(host_);
  if (listener_ >= 0) close(listener_);
}

void SimulatedScanner::Trigger(std::shared_ptr<const VirtualScan> scan, ScanPace pace) {
  ActiveScan active;
  active.scan = std::move(scan);
  active.pace = pace;
  scans_.push_back(std::move(active));
}

void SimulatedScanner::Accept() {
  while (true) {
    const int taken = accept4(listener_, nullptr, nullptr, SOCK_NONBLOCK | SOCK_CLOEXEC);
    if (taken < 0) return;
    if (host_ >= 0) {
      close(taken);  // one host at a time
      continue;
    }
    const int on = 1;
    setsockopt(taken, IPPROTO_TCP, TCP_NODELAY, &on, sizeof(on));
    host_ = taken;
    started_ = false;
    decoder_.Reset();
    encoder_ = {};
    out_.clear();
    sent_ = 0;
    close_after_flush_ = false;
  }
}

void SimulatedScanner::DropHost() {
  if (host_ >= 0) close(host_);
  host_ = -1;
  started_ = false;
  if (!scans_.empty() && scans_.front().begun) {
    scans_.pop_front();
    ++scans_abandoned_;
  }
}

void SimulatedScanner::ReceiveRequests() {
  while (host_ >= 0) {
    const auto room = decoder_.Writable();
    const ssize_t got = recv(host_, room.data(), room.size(), 0);
    if (got == 0 || (got < 0 && errno != EAGAIN && errno != EINTR)) return DropHost();
    if (got < 0) return;
    decoder_.Commit(static_cast<std::size_t>(got));
    while (const auto message = decoder_.Next()) Answer(*message);
  }
}

void SimulatedScanner::Answer(const WireMessage& request) {
  WireReply reply{request.type, 0, request.sequence, ""};
  switch (request.type) {
    case WireType::kIdentify:
      encoder_.Append(identity_, out_);
      return;
    case WireType::kSettings: {
      WireSettings settings;
      if (!DecodeSettings(request.payload, settings)) {
        reply.status = 1;
        reply.text = "malformed settings";
      }
      break;
    }
    case WireType::kStart:
      started_ = true;
      break;
    case WireType::kStop:
      started_ = false;
      break;
    default:
      return;  // not a host's to say
  }
  encoder_.Append(reply, out_);
}

void SimulatedScanner::Flush() {
  while (host_ >= 0 && sent_ < out_.size()) {
    const ssize_t sent = send(host_, out_.data() + sent_, out_.size() - sent_, MSG_NOSIGNAL);
    if (sent > 0) {
      sent_ += static_cast<std::size_t>(sent);
    } else if (errno == EAGAIN) {
      return;
    } else if (errno != EINTR) {
      return DropHost();
    }
  }
  out_.clear();
  sent_ = 0;
  if (close_after_flush_ && host_ >= 0) DropHost();
}

nanoseconds SimulatedScanner::UntilDue() const {
  if (!started_ || close_after_flush_ || scans_.empty()) return nanoseconds::max();
  const nanoseconds now = clock_.Now();
  if (stalled_until_ && *stalled_until_ > now) return *stalled_until_ - now;
  const ActiveScan& active = scans_.front();
  if (!active.begun || active.pace == ScanPace::kMax) return nanoseconds(0);
  const double seconds =
      static_cast<double>(active.next) / std::max(active.scan->options().profiles_per_second, 1e-3);
  const auto due = active.begun_at +
                   std::chrono::duration_cast<nanoseconds>(std::chrono::duration<double>(seconds));
  return std::max(due - now, nanoseconds(0));
}

bool SimulatedScanner::DoMisbehave(ActiveScan& active) {
  using Kind = Misbehaviour::Kind;
  const Misbehaviour now = misbehaviours_.front();
  misbehaviours_.pop_front();
  if (now.kind == Kind::kGap) {
    active.next += now.amount;
    return true;
  }
  if (now.kind == Kind::kStall) {
    stalled_until_ = clock_.Now() + std::chrono::milliseconds(now.amount);
    return true;
  }
  if (now.kind == Kind::kGarbage) {
    const std::uint32_t most = 1 << 20;
    for (std::uint32_t i = 0; i < std::min(now.amount, most); ++i) {
      out_.push_back(static_cast<std::uint8_t>(random_.Uniform(0, 256)));
    }
    return true;
  }
  if (now.kind == Kind::kFault) {
    hal::ScanEvent event;
    event.kind = hal::ScanEventKind::kFault;
    event.t_ns = active.scan->TimeOf(active.next);
    event.set_detail("laser too hot");
    encoder_.Append(event, out_);
    return true;
  }
  // The others spoil the next profile's message.
  active.scan->Make(active.next, profile_);
  const std::size_t begin = out_.size();
  if (!encoder_.Append(profile_, out_)) return true;
  if (now.kind == Kind::kRepeat) return true;  // it is sent once more
  ++active.next;
  if (now.kind == Kind::kCorrupt) {
    out_[begin + kWireHeaderBytes + 20] ^= 0x5A;
  } else if (now.kind == Kind::kBadPose) {
    std::uint8_t* const payload = out_.data() + begin + kWireHeaderBytes;
    const std::size_t size = out_.size() - begin - kWireHeaderBytes - kWireTrailerBytes;
    StoreFloat64Little(7.0, payload + 40);
    StoreLittle(Crc32c({payload, size}), payload + size);
  } else {  // kCut
    out_.resize(begin + (out_.size() - begin) / 2);
    close_after_flush_ = true;
  }
  return true;
}

void SimulatedScanner::SendNext(ActiveScan& active) {
  const VirtualScan& scan = *active.scan;
  if (!active.begun) {
    active.begun = true;
    active.begun_at = clock_.Now();
    encoder_.Append(scan.StartEvent(), out_);
    return;
  }
  if (active.next < scan.profile_count()) {
    if (!misbehaviours_.empty() && DoMisbehave(active)) return;
    scan.Make(active.next++, profile_);
    if (profile_.points.size() <= identity_.max_points) (void)encoder_.Append(profile_, out_);
    return;
  }
  encoder_.Append(scan.EndEvent(), out_);
  scans_.pop_front();
  ++scans_finished_;
}

void SimulatedScanner::SendDue() {
  Flush();
  for (int i = 0; i < kMostProfilesAPoll && host_ >= 0 && UntilDue() == nanoseconds(0) &&
                  out_.size() - sent_ < kMostWaitingBytes;
       ++i) {
    SendNext(scans_.front());
    Flush();
  }
}

Result<void> SimulatedScanner::Poll(nanoseconds timeout) {
  ReceiveRequests();  // first, to see that a host has left before the next one knocks
  Accept();
  SendDue();
  const bool is_blocked = sent_ < out_.size();
  nanoseconds wait = timeout;
  if (host_ >= 0 && !is_blocked) wait = std::min(wait, UntilDue());
  if (wait <= nanoseconds(0)) return {};
  std::array<pollfd, 3> waiting = {
      pollfd{listener_, POLLIN, 0},
      pollfd{host_, static_cast<short>(is_blocked ? POLLIN | POLLOUT : POLLIN), 0},
      pollfd{wake_, POLLIN, 0}};
  const timespec limit{wait.count() / 1'000'000'000, wait.count() % 1'000'000'000};
  if (ppoll(waiting.data(), waiting.size(), &limit, nullptr) < 0 && errno != EINTR) {
    return Fail(SocketError("cannot wait"));
  }
  return {};
}

}  // namespace bendloop::drivers
