// SPDX-License-Identifier: Apache-2.0
// Links: bendloop_drivers_canopen_bender bendloop_drivers_simulated_bender
//
// Whatever frames a node or a stranger sends: to the SDO client, to the node's watch and to the
// simulated server. First byte: what is transferred; then frames of a kind, a size and 8 bytes.
#include <cstdint>
#include <cstdlib>
#include <span>

#include "drivers/canopen_bender/node_watch.h"
#include "drivers/canopen_bender/sdo_client.h"
#include "tests/fuzz/reached.h"
#include "tests/support/sdo_store.h"

namespace {

using namespace bendloop::drivers;

constexpr std::size_t kMaxSize = 300;
constexpr ObjectId kObject{0x2001, 3};

bendloop::Reached uploaded("an upload to its end");
bendloop::Reached downloaded("a download to its end");
bendloop::Reached answered("an answer of the server");
bendloop::Reached watched("a remark of the watch");

void Check(bool holds) {
  if (!holds) std::abort();
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size < 1) return 0;
  const std::uint8_t choice = *data++;
  --size;
  bendloop::test::SdoStore store;
  SdoServer server(store, {(choice & 4) != 0, static_cast<std::uint8_t>(1 + (choice >> 3))});
  SdoClient client;
  NodeWatch watch(5, std::chrono::milliseconds(100));
  const auto mode = choice & 2 ? SdoClient::Mode::kBlock : SdoClient::Mode::kPlain;
  if (choice & 1) {
    client.Upload(kObject, kMaxSize, mode);
  } else {
    client.Download(kObject, std::vector<std::uint8_t>(kMaxSize, choice), mode);
  }
  std::chrono::nanoseconds now{0};
  SdoData frame{};
  for (; size >= 10; data += 10, size -= 10) {
    int sent = 0;
    while (client.NextFrame(frame)) Check(++sent <= 128);
    now += std::chrono::milliseconds(data[1]);
    CanFrame seen{CanFrame::Kind::kData, 0, static_cast<std::uint8_t>(data[1] & 0x0f), {}};
    for (int i = 0; i < 8; ++i) seen.data[i] = frame[i] = data[2 + i];
    switch (data[0] & 7) {
      case 0:
        client.Timeout();
        break;
      case 1:
        seen.kind = CanFrame::Kind::kError;
        seen.id = static_cast<std::uint32_t>(data[2] | data[3] << 8);
        watch.Receive(seen, now);
        break;
      case 2:
      case 3:
        seen.id = (data[0] & 1 ? kCobHeartbeat : kCobEmcy) + 5;
        watch.Receive(seen, now);
        break;
      case 4:
      case 5: {
        server.Receive(frame);
        int answers = 0;
        while (server.NextFrame(frame)) Check(++answers <= 128);
        if (answers > 0) answered.Mark();
        break;
      }
      default:
        client.Receive(std::span(data + 2, std::size_t{data[0] & 0x80u ? data[1] & 7u : 8u}));
        break;
    }
    Check(client.data().size() <= kMaxSize + 7);
    const std::string remarks = watch.Remarks(now);
    if (!remarks.empty()) watched.Mark();
    Check(remarks.find('\n') == std::string::npos);
  }
  if (client.finished() && !client.failed()) (choice & 1 ? uploaded : downloaded).Mark();
  Check(!client.failed() || !client.error().empty());
  return 0;
}
