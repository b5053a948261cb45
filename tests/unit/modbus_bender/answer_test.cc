// SPDX-License-Identifier: Apache-2.0
//
// Bad answers, one at a time: each is refused in words, nothing is asked twice, and the next
// exchange is a good one.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <modbus/modbus.h>

#include <memory>
#include <string>

#include "drivers/modbus_bender/rtu_carrier.h"
#include "drivers/modbus_bender/tcp_carrier.h"
#include "tests/support/bender_maps.h"
#include "tests/unit/modbus_bender/scripted_peer.h"

namespace bendloop::test {
namespace {

using drivers::RegisterImage;
using drivers::RegisterRange;
using testing::HasSubstr;

constexpr std::uint8_t kUnit = 1;
const RegisterRange kSome{hal::RegisterSpace::kHolding, 0x123, 3};
const RegisterRange kOne{hal::RegisterSpace::kHolding, 0x145, 1};

// Makes an answer of a good one.
using Spoil = std::function<ScriptedAnswer(Bytes good)>;

struct BadAnswer {
  const char* name;
  Spoil spoil;
  const char* words;  // in the error; "": it is a good answer
  friend void PrintTo(const BadAnswer& bad, std::ostream* out) { *out << bad.name; }
};

ScriptedAnswer Patched(Bytes good, std::size_t at, std::uint8_t value) {
  good[at] = value;
  return {std::move(good)};
}

// A carrier to a peer that spoils the first answer of each `Exchange`.
class Exchanges {
 public:
  Exchanges(ScriptedPeer::Carrier carrier, const Spoil& spoil,
            std::chrono::milliseconds response_timeout = std::chrono::milliseconds(300),
            std::chrono::milliseconds byte_timeout = {})
      : header_(carrier == ScriptedPeer::Carrier::kTcp ? 7 : 1),
        peer_(carrier, [this, spoil](const Bytes& request) {
          Bytes good = GoodAnswer(request, header_);
          if (header_ == 1) good = WithCrc(std::move(good));
          return spoil_next_.exchange(false) ? spoil(std::move(good)) : ScriptedAnswer{good};
        }) {
    drivers::ModbusBenderOptions options;
    options.port = peer_.port();
    options.unit_id = kUnit;
    options.connect_timeout = std::chrono::seconds(20);
    options.response_timeout = response_timeout;
    options.byte_timeout = byte_timeout;
    options.max_backoff = std::chrono::milliseconds(1);
    if (header_ == 1) options.serial = drivers::SerialLine{.device = peer_.device()};
    carrier_ = header_ == 7 ? drivers::MakeTcpCarrier(PlainMap(), options, clock_)
                            : drivers::MakeRtuCarrier(PlainMap(), options, clock_);
  }

  std::string Read(const RegisterRange& range) {
    const auto done = carrier_->Read({range}, image_);
    return done ? "" : done.error().message;
  }
  std::string Write(const RegisterRange& range) {
    const auto done = carrier_->Write({range}, image_);
    return done ? "" : done.error().message;
  }

  // A good exchange, the spoilt one, and a good one again.
  void Check(const char* words, const std::function<std::string()>& exchange) {
    ASSERT_EQ(exchange(), "");
    const int before = peer_.requests();
    spoil_next_ = true;
    const std::string error = exchange();
    EXPECT_EQ(peer_.requests(), before + 1) << "asked again";
    if (*words == '\0') {
      EXPECT_EQ(error, "");
    } else {
      EXPECT_THAT(error, HasSubstr(words));
      EXPECT_THAT(error, HasSubstr(header_ == 7 ? " unit 1: " : "/dev/pts/"));
    }
    EXPECT_EQ(exchange(), "");
    EXPECT_EQ(peer_.requests(), before + 2);
  }

  void CheckRead(const char* words) {
    Check(words, [this] {
      std::uint16_t* const to = image_.At(kSome.space, 0x123);
      std::fill_n(to, 3, std::uint16_t{0xbad});
      const std::string error = Read(kSome);
      if (error.empty()) {
        EXPECT_THAT(std::vector<int>(to, to + 3), testing::ElementsAre(0x123, 0x124, 0x125));
      }
      return error;
    });
  }

  const ScriptedPeer& peer() const { return peer_; }

 private:
  const std::size_t header_;
  hal::SteadyClock clock_;
  std::atomic<bool> spoil_next_{false};
  RegisterImage image_;
  ScriptedPeer peer_;
  std::unique_ptr<drivers::RegisterCarrier> carrier_;
};

std::string NameOf(const testing::TestParamInfo<BadAnswer>& info) { return info.param.name; }

class TcpAnswer : public testing::TestWithParam<BadAnswer> {};

TEST_P(TcpAnswer, OfAReadIsChecked) {
  Exchanges exchanges(ScriptedPeer::Carrier::kTcp, GetParam().spoil);
  exchanges.CheckRead(GetParam().words);
}

class RtuAnswer : public testing::TestWithParam<BadAnswer> {};

TEST_P(RtuAnswer, OfAReadIsChecked) {
  Exchanges exchanges(ScriptedPeer::Carrier::kRtu, GetParam().spoil);
  exchanges.CheckRead(GetParam().words);
}

// What may happen on any carrier.
std::vector<BadAnswer> AnyAnswers() {
  return {{"Good", [](Bytes good) { return ScriptedAnswer{good}; }, ""},
          {"ByteByByte",
           [](Bytes good) {
             return ScriptedAnswer{good, true};
           },
           ""},
          // Found before the next request goes out.
          {"ExtraBytes",
           [](Bytes good) {
             good.insert(good.end(), {0, 0, 0});
             return ScriptedAnswer{good};
           },
           ""},
          {"Twice",
           [](Bytes good) {
             const Bytes again = good;
             good.insert(good.end(), again.begin(), again.end());
             return ScriptedAnswer{good};
           },
           ""},
          {"Silence", [](Bytes) { return ScriptedAnswer{}; }, "no complete answer within 300 ms"},
          // However the bytes come, the whole answer must be there in time.
          {"CutOff",
           [](Bytes good) {
             good.pop_back();
             return ScriptedAnswer{good, true};
           },
           "no complete answer within 300 ms"}};
}

INSTANTIATE_TEST_SUITE_P(Any, TcpAnswer, testing::ValuesIn(AnyAnswers()), NameOf);
INSTANTIATE_TEST_SUITE_P(Any, RtuAnswer, testing::ValuesIn(AnyAnswers()), NameOf);

INSTANTIATE_TEST_SUITE_P(
    Tcp, TcpAnswer,
    testing::Values(BadAnswer{"WrongUnit", [](Bytes good) { return Patched(good, 6, 2); },
                              "answer from unit 2, expected unit 1"},
                    BadAnswer{"WrongTransaction", [](Bytes good) { return Patched(good, 0, 0x7f); },
                              "answer to transaction 32514, expected 2"},
                    BadAnswer{"ThePreviousTransaction",
                              [](Bytes good) { return Patched(good, 1, 1); },
                              "answer to transaction 1, expected 2"},
                    BadAnswer{"WrongProtocol", [](Bytes good) { return Patched(good, 3, 1); },
                              "garbled Modbus header"},
                    BadAnswer{"WrongLength", [](Bytes good) { return Patched(good, 5, 5); },
                              "garbled Modbus header"},
                    BadAnswer{"WrongFunction", [](Bytes good) { return Patched(good, 7, 4); },
                              "answer to function 4, expected 3"},
                    BadAnswer{"Exception",
                              [](Bytes good) {
                                good.resize(9);
                                good[5] = 3;
                                good[7] = 0x83;
                                good[8] = 6;
                                return ScriptedAnswer{good};
                              },
                              "(function 3): the bender answers exception 6, device busy"},
                    BadAnswer{"FewerRegisters",
                              [](Bytes good) {
                                good.resize(13);
                                good[5] = 7;
                                good[8] = 4;
                                return ScriptedAnswer{good};
                              },
                              "answer of 4 data bytes, expected 6"},
                    BadAnswer{"CutOffAndHungUp",
                              [](Bytes good) {
                                good.pop_back();
                                return ScriptedAnswer{good, false, true};
                              },
                              "the bender closed the connection"}),
    NameOf);

// A pause in the middle of an answer ends it long before the response timeout does.
TEST(ByteTimeout, EndsAnAnswerThatStops) {
  for (const auto carrier : {ScriptedPeer::Carrier::kTcp, ScriptedPeer::Carrier::kRtu}) {
    Exchanges exchanges(
        carrier,
        [](Bytes good) {
          good.pop_back();
          return ScriptedAnswer{good};
        },
        std::chrono::seconds(2), std::chrono::milliseconds(50));
    exchanges.CheckRead("no complete answer within 2000 ms, or none of its bytes for 50 ms");
  }
}

TEST(TcpEcho, IsTheRequests) {
  const auto check = [](const RegisterRange& range, std::size_t at, const char* words) {
    Exchanges exchanges(ScriptedPeer::Carrier::kTcp,
                        [at](Bytes good) { return Patched(good, at, good[at] ^ 1); });
    exchanges.Check(words, [&] { return exchanges.Write(range); });
  };
  check(kOne, 9, "(function 6): the echo is 06 01 44");   // address
  check(kOne, 11, "(function 6): the echo is 06 01 45");  // value
  check(kSome, 9, "(function 16): the echo is 10 01 22");
  check(kSome, 11, "(function 16): the echo is 10 01 23");  // number of registers
  check(kSome, 6, "answer from unit 0, expected unit 1");
}

// What is checked by hand, and why: libmodbus's own calls take all of these for good. When this
// fails, a newer libmodbus may make ModbusQuery unnecessary for TCP.
TEST(LibmodbusOverTcp, TakesAnAnswerOfAnotherUnitForGood) {
  const auto accepts = [](std::size_t at, bool write) {
    const ScriptedPeer peer(ScriptedPeer::Carrier::kTcp, [at](const Bytes& request) {
      return Patched(GoodAnswer(request, 7), at, static_cast<std::uint8_t>(request[at] ^ 1));
    });
    const std::unique_ptr<modbus_t, void (*)(modbus_t*)> context(
        modbus_new_tcp_pi("127.0.0.1", std::to_string(peer.port()).c_str()), [](modbus_t* made) {
          modbus_close(made);
          modbus_free(made);
        });
    EXPECT_EQ(modbus_set_slave(context.get(), kUnit), 0);
    EXPECT_EQ(modbus_connect(context.get()), 0);
    std::uint16_t values[3] = {};
    return write ? modbus_write_register(context.get(), 0x145, 7) == 1
                 : modbus_read_registers(context.get(), 0x123, 3, values) == 3;
  };
  EXPECT_TRUE(accepts(6, false)) << "unit";
  EXPECT_TRUE(accepts(3, false)) << "protocol";
  EXPECT_TRUE(accepts(9, true)) << "address of the echo";
  EXPECT_TRUE(accepts(11, true)) << "value of the echo";
  EXPECT_FALSE(accepts(1, false)) << "transaction";
  EXPECT_FALSE(accepts(7, false)) << "function";
}

// A good answer without its crc.
Bytes Bare(Bytes good) {
  good.resize(good.size() - 2);
  return good;
}

INSTANTIATE_TEST_SUITE_P(
    Rtu, RtuAnswer,
    testing::Values(  // Another master's question to our bender, and its answer: as long as ours.
        BadAnswer{"AnotherMastersExchange",
                  [](Bytes good) {
                    for (const Bytes& heard : {WithCrc({kUnit, 3, 0, 9, 0, 3}),
                                               WithCrc({kUnit, 3, 6, 9, 9, 9, 9, 9, 9})}) {
                      good.insert(good.end(), heard.begin(), heard.end());
                    }
                    return ScriptedAnswer{good};
                  },
                  ""},
        // The other way round: heard first, it is not ours, and ours is not the next one's.
        BadAnswer{"AnotherUnitsExchangeFirst",
                  [](Bytes good) {
                    Bytes heard = WithCrc({2, 3, 0, 9, 0, 3});
                    const Bytes answer = WithCrc({2, 3, 6, 9, 9, 9, 9, 9, 9});
                    heard.insert(heard.end(), answer.begin(), answer.end());
                    heard.insert(heard.end(), good.begin(), good.end());
                    return ScriptedAnswer{heard};
                  },
                  "bender /dev/pts/"},
        BadAnswer{"WrongUnit",
                  [](Bytes good) {
                    good[0] = 2;
                    return ScriptedAnswer{WithCrc(Bare(good))};
                  },
                  "answer from another unit"},
        BadAnswer{"WrongCrc", [](Bytes good) { return Patched(good, 4, 0x55); },
                  "no valid answer: Invalid CRC"},
        BadAnswer{"WrongFunction",
                  [](Bytes good) {
                    good[1] = 4;
                    return ScriptedAnswer{WithCrc(Bare(good))};
                  },
                  "no valid answer: Invalid data"},
        BadAnswer{"Exception",
                  [](Bytes) {
                    return ScriptedAnswer{WithCrc({kUnit, 0x83, 2})};
                  },
                  "(function 3): the bender answers exception 2, illegal data address"},
        BadAnswer{"FewerRegisters",
                  [](Bytes) {
                    return ScriptedAnswer{WithCrc({kUnit, 3, 4, 1, 2, 3, 4})};
                  },
                  "no valid answer: Invalid data"}),
    NameOf);

}  // namespace
}  // namespace bendloop::test
