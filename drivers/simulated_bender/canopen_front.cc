// SPDX-License-Identifier: Apache-2.0
#include "drivers/simulated_bender/canopen_front.h"

#include <algorithm>
#include <thread>
#include <utility>

namespace bendloop::drivers {
namespace {

using Answer = Misbehaviour::Answer;

constexpr std::chrono::milliseconds kSlice{10};
constexpr std::uint8_t kOperational = 0x05;
constexpr std::uint8_t kStopped = 0x04;
constexpr std::uint8_t kPreOperational = 0x7f;

std::vector<std::uint8_t> Bytes32(std::uint32_t value) {
  const SdoData frame = SdoFrame(0, {}, value);
  return {frame.begin() + 4, frame.end()};
}

}  // namespace

CanopenFront::CanopenFront(const SimulatedNode& node, const hal::RegisterMap& map,
                           std::unique_ptr<CanPort> port)
    : node_(node), objects_(ObjectsOf(map)), port_(std::move(port)), server_(*this, node.sdo) {}

hal::Result<std::unique_ptr<CanopenFront>> CanopenFront::Open(const SimulatedNode& node,
                                                              const hal::RegisterMap& map) {
  std::unique_ptr<CanPort> port;
  if (node.socket >= 0) {
    port = AdoptCanSocket(node.socket);
  } else {
    auto opened = OpenCanPort(node.interface, {kCobNmt, kCobSdoRequest + node.node_id});
    if (!opened) return hal::Fail(opened.error());
    port = std::move(*opened);
  }
  if (!map.of_objects()) {
    return hal::Fail(hal::ErrorKind::kBadInput,
                     "register map \"" + map.name + "\" has registers, expected CANopen objects");
  }
  std::unique_ptr<CanopenFront> front(new CanopenFront(node, map, std::move(port)));
  front->Reboot();
  return front;
}

void CanopenFront::Send(std::uint32_t id, std::uint8_t size, const SdoData& data) {
  constexpr int kTries = 200;  // a full queue empties, or nobody listens
  for (int i = 0; i < kTries; ++i) {
    const auto sent = port_->Send({CanFrame::Kind::kData, id, size, data});
    if (!sent || *sent) return;
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
}

void CanopenFront::Reboot() {
  server_.Reset();
  nmt_state_ = kOperational;
  fault_ = 0;
  Send(kCobHeartbeat + node_.node_id, 1, {0});
}

void CanopenFront::ObeyNmt(const CanFrame& frame) {
  if (frame.size != 2 || (frame.data[1] != 0 && frame.data[1] != node_.node_id)) return;
  if (frame.data[0] == 0x01) nmt_state_ = kOperational;
  if (frame.data[0] == 0x02) nmt_state_ = kStopped;
  if (frame.data[0] == 0x80) nmt_state_ = kPreOperational;
  if (frame.data[0] == 0x81 || frame.data[0] == 0x82) Reboot();
}

void CanopenFront::Poll(std::chrono::milliseconds timeout, std::uint32_t fault, bool silent,
                        const std::function<void(const SdoData&)>& handle) {
  const auto now = std::chrono::steady_clock::now();
  if (!silent && node_.heartbeat.count() > 0 && now >= next_heartbeat_) {
    next_heartbeat_ = now + node_.heartbeat;
    Send(kCobHeartbeat + node_.node_id, 1, {nmt_state_});
  }
  if (fault != fault_) {
    fault_ = fault;
    // Device specific codes; 0 takes the emergency back.
    const auto code = static_cast<std::uint16_t>(fault == 0 ? 0 : 0xff00 | (fault & 0xff));
    Send(kCobEmcy + node_.node_id, 8,
         {static_cast<std::uint8_t>(code), static_cast<std::uint8_t>(code >> 8),
          static_cast<std::uint8_t>(fault == 0 ? 0x00 : 0x81)});
  }
  const auto frame = port_->Receive(std::min(timeout, kSlice));
  if (!frame) std::this_thread::sleep_for(kSlice);  // the interface is down
  if (!frame || !*frame || (*frame)->kind != CanFrame::Kind::kData) return;
  if ((*frame)->id == kCobNmt) return ObeyNmt(**frame);
  if ((*frame)->id != kCobSdoRequest + node_.node_id || (*frame)->size != 8) return;
  if (nmt_state_ != kStopped) handle((*frame)->data);
}

void CanopenFront::Handle(const SdoData& request, const Misbehaviour& wrong, const Bender& bender) {
  if (wrong.answer == Answer::kSilent) return;
  std::uint32_t id = kCobSdoReply + node_.node_id;
  if (wrong.answer == Answer::kException) {
    server_.Reset();
    return Send(id, 8, SdoFrame(0x80, SdoObject(request), 0x08000020u + wrong.exception));
  }
  if (wrong.answer == Answer::kGarbage) {
    return Send(id, 8, {0xde, 0xad, 0xbe, 0xef, 0x00, 0xff, 0x55, 0xaa});
  }
  if (wrong.answer == Answer::kWrongUnit) ++id;
  bender_ = &bender;
  server_.Receive(request);
  bender_ = nullptr;
  for (SdoData answer{}; server_.NextFrame(answer);) {
    if (wrong.answer == Answer::kMute) continue;
    if (wrong.answer == Answer::kWrongTransaction) ++answer[3];
    Send(id, wrong.answer == Answer::kShort ? 4 : 8, answer);
  }
}

const MappedObject* CanopenFront::Find(ObjectId object) const {
  const auto found = std::find_if(objects_.begin(), objects_.end(),
                                  [&](const MappedObject& o) { return o.object == object; });
  return found == objects_.end() ? nullptr : &*found;
}

std::uint32_t CanopenFront::NoSuch(ObjectId object) const {
  const bool has_index = std::any_of(objects_.begin(), objects_.end(),
                                     [&](const auto& o) { return o.object.index == object.index; });
  return has_index ? kAbortNoSub : kAbortNoObject;
}

bool CanopenFront::ReadStandard(ObjectId object, std::vector<std::uint8_t>& bytes) const {
  const std::uint32_t key = static_cast<std::uint32_t>(object.index) << 8 | object.sub;
  switch (key) {
    case 0x100000:  // device type: no profile
      bytes = Bytes32(0);
      return true;
    case 0x100100:  // error register
      bytes = {static_cast<std::uint8_t>(fault_ == 0 ? 0x00 : 0x81)};
      return true;
    case 0x101700: {  // producer heartbeat time
      bytes = Bytes32(static_cast<std::uint32_t>(node_.heartbeat.count()));
      bytes.resize(2);
      return true;
    }
    case 0x101800:
      bytes = {4};
      return true;
    case 0x101801:
      bytes = Bytes32(node_.vendor_id);
      return true;
    case 0x101802:
      bytes = Bytes32(node_.product_code);
      return true;
    case 0x101803:
    case 0x101804:
      bytes = Bytes32(1);
      return true;
    default:
      return false;
  }
}

std::uint32_t CanopenFront::Read(ObjectId object, std::vector<std::uint8_t>& bytes) {
  if (ReadStandard(object, bytes)) return 0;
  const MappedObject* found = Find(object);
  if (found == nullptr) return NoSuch(object);
  const RegisterImage& image = bender_->image();
  bytes = ToBytes(image.At(found->range.space, static_cast<std::uint16_t>(found->range.address)),
                  found->bytes);
  return 0;
}

std::uint32_t CanopenFront::Write(ObjectId object, std::span<const std::uint8_t> bytes) {
  const MappedObject* found = Find(object);
  std::vector<std::uint8_t> standard;
  if (found == nullptr) return ReadStandard(object, standard) ? kAbortReadOnly : NoSuch(object);
  if (!found->is_written) return kAbortReadOnly;
  if (bytes.size() > found->bytes) return kAbortTooLong;
  if (found->is_rows ? bytes.size() % 2 != 0 : bytes.size() != found->bytes) return kAbortLength;
  RegisterRange range = found->range;
  if (found->is_rows) range.count = static_cast<std::uint32_t>(bytes.size() / 2);
  std::uint16_t* to = bender_->image().At(range.space, static_cast<std::uint16_t>(range.address));
  return bender_->write(range, [&] { FromBytes(bytes, to); }) ? 0 : kNoAnswer;
}

}  // namespace bendloop::drivers
