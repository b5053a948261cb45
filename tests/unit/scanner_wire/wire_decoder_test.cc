// SPDX-License-Identifier: Apache-2.0
#include "drivers/scanner_wire/wire_decoder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>

#include "drivers/scanner_wire/crc32c.h"
#include "drivers/scanner_wire/wire_bytes.h"
#include "wire_fixture.h"

namespace bendloop::drivers {
namespace {

// A conversation with every kind of message; `ends` are where each message ends.
Bytes Stream(std::uint64_t seed, std::vector<std::size_t>* ends = nullptr) {
  std::mt19937_64 engine(seed);
  WireEncoder encoder;
  Bytes bytes;
  for (std::uint64_t i = 0; i < 30; ++i) {
    if (i % 10 == 3) {
      hal::ScanEvent event;
      event.set_detail("BLSW in a text");
      encoder.Append(event, bytes);
    } else if (i % 10 == 5) {
      encoder.Append(WireType::kIdentify, {}, bytes);
    } else {
      EXPECT_TRUE(encoder.Append(WireProfile(engine, i, engine() % 20), bytes));
    }
    if (ends != nullptr) ends->push_back(bytes.size());
  }
  return bytes;
}

TEST(WireDecoder, AnyChunkingGivesTheSameMessages) {
  const Bytes bytes = Stream(1);
  WireDecoder whole;
  const auto expected = Decode(bytes, whole);
  ASSERT_EQ(expected.size(), 30u);
  EXPECT_EQ(whole.counters().resyncs, 0u);
  std::mt19937_64 engine(2);
  for (int round = 0; round < 50; ++round) {
    WireDecoder decoder;
    std::vector<std::string> messages;
    for (std::size_t at = 0; at < bytes.size();) {
      const std::size_t most = round == 0 ? 1 : 1 + engine() % 300;
      const std::size_t chunk = std::min(most, bytes.size() - at);
      at += decoder.Push(std::span(bytes).subspan(at, chunk));
      for (auto& message : Drain(decoder)) messages.push_back(std::move(message));
    }
    EXPECT_EQ(messages, expected);
    EXPECT_EQ(decoder.counters(), whole.counters());
  }
}

// As from USB transfers: what lies within one is not copied.
TEST(WireDecoder, ReadsInPlace) {
  Bytes bytes = Stream(1);
  for (std::size_t i = 0; i < 40; ++i) bytes[bytes.size() / 2 + i] = 0x42;  // some damage as well
  WireDecoder whole;
  const auto expected = Decode(bytes, whole);
  ASSERT_GT(whole.counters().resyncs, 0u);
  std::mt19937_64 engine(2);
  std::size_t in_place = 0;
  for (int round = 0; round < 50; ++round) {
    WireDecoder decoder;
    std::vector<std::string> messages;
    for (std::size_t at = 0; at < bytes.size();) {
      const std::size_t most = round == 0 ? 1 : 1 + engine() % 600;
      // A transfer's own memory, gone when it is used up.
      const Bytes transfer(bytes.begin() + static_cast<long>(at),
                           bytes.begin() + static_cast<long>(std::min(at + most, bytes.size())));
      at += transfer.size();
      decoder.Feed(transfer);
      while (const auto message = decoder.Next()) {
        messages.push_back(Describe(*message));
        const std::uint8_t* const begin = message->payload.data();
        if (begin >= transfer.data() && begin < transfer.data() + transfer.size()) ++in_place;
      }
    }
    EXPECT_EQ(messages, expected);
    EXPECT_EQ(decoder.counters(), whole.counters());
  }
  EXPECT_GT(in_place, 100u);
}

TEST(WireDecoder, OneDamagedByteCostsOneMessage) {
  std::vector<std::size_t> ends;
  const Bytes bytes = Stream(3, &ends);
  WireDecoder whole;
  const auto expected = Decode(bytes, whole);
  std::mt19937_64 engine(4);
  WireDecoder decoder;
  for (std::size_t at = 0; at < bytes.size(); ++at) {
    Bytes damaged = bytes;
    damaged[at] ^= static_cast<std::uint8_t>(1 + engine() % 255);
    const auto hit =
        static_cast<std::size_t>(std::upper_bound(ends.begin(), ends.end(), at) - ends.begin());
    decoder.Reset();
    const auto messages = Decode(damaged, decoder);
    auto without = expected;
    without.erase(without.begin() + static_cast<long>(hit));
    ASSERT_EQ(messages, without) << "byte " << at;
    const WireCounters& counters = decoder.counters();
    EXPECT_EQ(counters.resyncs, 1u);
    EXPECT_EQ(counters.skipped_bytes, ends[hit] - (hit == 0 ? 0 : ends[hit - 1]));
    // The first message's loss shows only as skipped bytes, the last's nowhere else.
    EXPECT_EQ(counters.lost_messages, hit == 0 || hit == 29 ? 0u : 1u);
    // The magic inside a text may be tried as well.
    EXPECT_LE(counters.header_errors + counters.payload_errors, 2u);
  }
}

TEST(WireDecoder, LostBytesCostAtMostTwoMessages) {
  std::vector<std::size_t> ends;
  const Bytes bytes = Stream(5, &ends);
  std::mt19937_64 engine(6);
  for (int round = 0; round < 500; ++round) {
    Bytes damaged = bytes;
    const std::size_t at = engine() % (bytes.size() - 40);
    damaged.erase(damaged.begin() + static_cast<long>(at),
                  damaged.begin() + static_cast<long>(at + 1 + engine() % 10));
    WireDecoder decoder;
    // The end of the stream may be awaited as part of a message cut short.
    EXPECT_GE(Decode(damaged, decoder).size(), 28u);
  }
}

TEST(WireDecoder, SkipsGarbageBetweenMessages) {
  std::mt19937_64 engine(7);
  const Bytes bytes = Stream(8);
  WireDecoder whole;
  const auto expected = Decode(bytes, whole);
  Bytes garbage;
  for (int i = 0; i < 400'000; ++i) {
    garbage.push_back(i % 5 == 0 ? static_cast<std::uint8_t>(engine()) : "BLSW"[engine() % 4]);
  }
  Bytes both = garbage;
  both.insert(both.end(), bytes.begin(), bytes.end());
  WireDecoder decoder;
  EXPECT_EQ(Decode(both, decoder), expected);
  EXPECT_EQ(decoder.counters().skipped_bytes, garbage.size());
  EXPECT_EQ(decoder.counters().resyncs, 1u);
}

TEST(WireDecoder, SkipsWhatItDoesNotKnow) {
  WireEncoder encoder;
  Bytes bytes;
  encoder.Append(static_cast<WireType>(0x7E), Bytes(1000, 1), bytes);
  const std::size_t second = bytes.size();
  encoder.Append(WireType::kStart, {}, bytes);
  bytes[second + 4] = 2;  // another version
  StoreLittle(Crc32c({bytes.data() + second, 16}), bytes.data() + second + 16);
  encoder.Append(WireType::kStop, {}, bytes);
  WireDecoder decoder;
  decoder.Push(bytes);
  EXPECT_EQ(decoder.Next()->type, WireType::kStop);
  EXPECT_EQ(decoder.counters().unknown_types, 1u);
  EXPECT_EQ(decoder.counters().unknown_versions, 1u);
  EXPECT_EQ(decoder.counters().resyncs, 0u);
  EXPECT_EQ(decoder.counters().lost_messages, 0u);
}

TEST(WireDecoder, DoesNotWaitForALyingLength) {
  WireEncoder encoder;
  Bytes bytes;
  encoder.Append(WireType::kStart, {}, bytes);
  StoreLittle(std::uint32_t{0xFFFFFFF0}, bytes.data() + 8);
  StoreLittle(Crc32c({bytes.data(), 16}), bytes.data() + 16);
  encoder.Append(WireType::kStop, {}, bytes);
  WireDecoder decoder;
  decoder.Push(bytes);
  EXPECT_EQ(decoder.Next()->type, WireType::kStop);
  EXPECT_EQ(decoder.counters().header_errors, 1u);
}

TEST(WireDecoder, CountsLostAndRepeatedSequences) {
  Bytes bytes;
  WireEncoder encoder;
  encoder.Skip(0xFFFFFFFE);
  encoder.Append(WireType::kStart, {}, bytes);
  encoder.Append(WireType::kStart, {}, bytes);
  encoder.Append(WireType::kStart, {}, bytes);  // wraps to 0
  encoder.Skip(7);
  encoder.Append(WireType::kStart, {}, bytes);
  encoder.Skip(static_cast<std::uint32_t>(-3));
  encoder.Append(WireType::kStart, {}, bytes);
  WireDecoder decoder;
  EXPECT_EQ(Decode(bytes, decoder).size(), 5u);
  EXPECT_EQ(decoder.counters().lost_messages, 7u);
  EXPECT_EQ(decoder.counters().repeated_sequences, 1u);
}

TEST(WireDecoder, BuffersAFullMessageWhateverCameBefore) {
  std::mt19937_64 engine(9);
  WireEncoder encoder;
  WireDecoder decoder;
  Bytes bytes;
  for (std::uint64_t i = 0; i < 20; ++i) {
    ASSERT_TRUE(encoder.Append(WireProfile(engine, 2 * i, kWireMaxPoints), bytes));
  }
  ASSERT_EQ(bytes.size(), 20 * kWireMaxMessage);
  EXPECT_EQ(Decode(bytes, decoder).size(), 20u);
  EXPECT_GE(decoder.Writable().size(), kWireMaxMessage);
}

}  // namespace
}  // namespace bendloop::drivers
