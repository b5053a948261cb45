// SPDX-License-Identifier: Apache-2.0
#include "drivers/scanner_wire/wire_messages.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "drivers/scanner_wire/crc32c.h"
#include "drivers/scanner_wire/wire_bytes.h"
#include "wire_fixture.h"

namespace bendloop::drivers {
namespace {

TEST(Crc32c, MatchesThePublishedVectors) {
  const std::string nine = "123456789";
  const Bytes digits(nine.begin(), nine.end());
  EXPECT_EQ(Crc32c(digits), 0xE3069283U);
  EXPECT_EQ(Crc32cPortable(digits), 0xE3069283U);
  // RFC 3720, B.4.
  EXPECT_EQ(Crc32c(Bytes(32, 0x00)), 0x8A9136AAU);
  EXPECT_EQ(Crc32c(Bytes(32, 0xFF)), 0x62A8AB43U);
  EXPECT_EQ(Crc32c({}), 0U);
  // In pieces as in one.
  const std::span<const std::uint8_t> all(digits);
  for (std::size_t cut = 0; cut <= all.size(); ++cut) {
    EXPECT_EQ(Crc32c(all.subspan(cut), Crc32c(all.first(cut))), 0xE3069283U);
    EXPECT_EQ(Crc32cPortable(all.subspan(cut), Crc32cPortable(all.first(cut))), 0xE3069283U);
  }
  std::mt19937_64 engine(1);
  for (std::size_t size = 0; size < 100; ++size) {
    Bytes bytes(size);
    for (auto& byte : bytes) byte = static_cast<std::uint8_t>(engine());
    EXPECT_EQ(Crc32c(bytes), Crc32cPortable(bytes));
  }
}

TEST(WireMessages, ProfilesComeBackBitForBit) {
  std::mt19937_64 engine(2);
  WireEncoder encoder;
  WireDecoder decoder;
  hal::LaserProfile back(kWireMaxPoints);
  const auto* const storage = back.points.data();
  for (const std::size_t points : {0U, 1U, 7U, 640U, 16384U}) {
    for (std::uint64_t sequence = 0; sequence < 2; ++sequence) {
      const auto profile = WireProfile(engine, sequence, points);
      Bytes bytes;
      ASSERT_TRUE(encoder.Append(profile, bytes));
      EXPECT_EQ(bytes.size(), 20 + 80 + points * (sequence == 0 ? 9 : 8) + 4);
      ASSERT_EQ(decoder.Push(bytes), bytes.size());
      const auto message = decoder.Next();
      ASSERT_TRUE(message && message->type == WireType::kProfile);
      ASSERT_TRUE(DecodeProfile(message->payload, back));
      EXPECT_TRUE(SameBits(back, profile));
    }
  }
  EXPECT_EQ(back.points.data(), storage);  // nothing was allocated
}

TEST(WireMessages, RoundingIsStable) {
  std::mt19937_64 engine(3);
  std::uniform_real_distribution<double> number(-8000, 8000);
  for (int i = 0; i < 10000; ++i) {
    const double exact = number(engine);
    const float once = RoundToWire(exact);
    EXPECT_NEAR(once, exact, 0.0005 + 8000 * 6e-8);
    EXPECT_EQ(RoundToWire(once), once);
  }
}

TEST(WireMessages, ProfileMatchesTheDocumentedBytes) {
  hal::LaserProfile profile(1);
  profile.sequence = 0x0102;
  profile.t_ns = -2;
  profile.X_WS.position_mm = {1, 0, 0};
  profile.points.push_back({-0.001F, 150.25F});
  profile.intensity.push_back(0x7F);
  Bytes bytes;
  WireEncoder encoder;
  encoder.Skip(5);
  ASSERT_TRUE(encoder.Append(profile, bytes));
  const Bytes head = {'B', 'L', 'S', 'W', 1, 0x90, 0, 0, 89, 0, 0, 0, 5, 0, 0, 0};
  EXPECT_TRUE(std::equal(head.begin(), head.end(), bytes.begin()));
  const Bytes numbers = {0x02, 0x01, 0,    0,    0, 0, 0, 0, 0xFE, 0xFF, 0xFF, 0xFF,
                         0xFF, 0xFF, 0xFF, 0xFF, 0, 0, 0, 0, 0,    0,    0xF0, 0x3F};
  EXPECT_TRUE(std::equal(numbers.begin(), numbers.end(), bytes.begin() + 20));
  // One point with intensity: count, flag, -1 um, 150250 um, 0x7F.
  const Bytes tail = {1, 0, 0, 0, 1, 0, 0, 0, 0xFF, 0xFF, 0xFF, 0xFF, 0xEA, 0x4A, 0x02, 0, 0x7F};
  EXPECT_TRUE(std::equal(tail.begin(), tail.end(), bytes.begin() + 20 + 72));
}

TEST(WireMessages, OtherMessagesComeBack) {
  WireEncoder encoder;
  Bytes bytes;
  hal::ScanEvent event;
  event.kind = hal::ScanEventKind::kGap;
  event.t_ns = 12345678901234;
  event.set_detail(std::string(300, 'x'));
  encoder.Append(event, bytes);
  encoder.Append(WireIdentity{"arm", "S1", "1.0", std::string(200, 'c'), 640}, bytes);
  encoder.Append(WireSettings{1500, 20, false}, bytes);
  encoder.Append(WireReply{WireType::kStart, 3, 77, "no"}, bytes);
  encoder.Append(WireType::kStop, {}, bytes);
  WireDecoder decoder;
  decoder.Push(bytes);

  hal::ScanEvent event_back;
  ASSERT_TRUE(DecodeEvent(decoder.Next()->payload, event_back));
  EXPECT_EQ(event_back.kind, event.kind);
  EXPECT_EQ(event_back.t_ns, event.t_ns);
  EXPECT_EQ(event_back.detail(), event.detail());
  WireIdentity identity;
  ASSERT_TRUE(DecodeIdentity(decoder.Next()->payload, identity));
  EXPECT_EQ(identity.model, "arm");
  EXPECT_EQ(identity.calibration, std::string(119, 'c'));
  EXPECT_EQ(identity.max_points, 640u);
  WireSettings settings;
  ASSERT_TRUE(DecodeSettings(decoder.Next()->payload, settings));
  EXPECT_EQ(settings.profiles_per_second_milli, 1500u);
  EXPECT_EQ(settings.exposure_us, 20u);
  EXPECT_FALSE(settings.intensity);
  WireReply reply;
  ASSERT_TRUE(DecodeReply(decoder.Next()->payload, reply));
  EXPECT_EQ(reply.request, WireType::kStart);
  EXPECT_EQ(reply.status, 3);
  EXPECT_EQ(reply.request_sequence, 77u);
  EXPECT_EQ(reply.text, "no");
  EXPECT_EQ(decoder.Next()->type, WireType::kStop);
  EXPECT_FALSE(decoder.Next());
}

TEST(WireMessages, RefuseWhatIsNotAProfile) {
  std::mt19937_64 engine(4);
  WireEncoder encoder;
  Bytes bytes;
  ASSERT_TRUE(encoder.Append(WireProfile(engine, 0, 3), bytes));
  const Bytes good(bytes.begin() + 20, bytes.end() - 4);
  hal::LaserProfile profile(kWireMaxPoints);
  ASSERT_TRUE(DecodeProfile(good, profile));
  for (std::size_t size = 0; size < good.size(); ++size) {
    EXPECT_FALSE(DecodeProfile(std::span(good).first(size), profile));
  }
  Bytes bad = good;
  StoreLittle(std::uint32_t{0xFFFFFFFF}, bad.data() + 72);
  EXPECT_FALSE(DecodeProfile(bad, profile));
  bad = good;
  bad[76] = 2;
  EXPECT_FALSE(DecodeProfile(bad, profile));
  bad = good;
  StoreFloat64Little(std::nan(""), bad.data() + 16);
  EXPECT_FALSE(DecodeProfile(bad, profile));
  bad = good;
  StoreFloat64Little(2.0, bad.data() + 40);
  EXPECT_FALSE(DecodeProfile(bad, profile));

  hal::LaserProfile unfit = WireProfile(engine, 0, 3);
  unfit.points[1].x_mm = 3e6F;
  EXPECT_FALSE(encoder.Append(unfit, bytes));
  unfit.points[1].x_mm = std::numeric_limits<float>::quiet_NaN();
  EXPECT_FALSE(encoder.Append(unfit, bytes));
  EXPECT_FALSE(encoder.Append(WireProfile(engine, 0, kWireMaxPoints + 1), bytes));
}

}  // namespace
}  // namespace bendloop::drivers
