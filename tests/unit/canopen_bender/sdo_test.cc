// SPDX-License-Identifier: Apache-2.0
//
// Client against server, frame by frame, on a bus that loses, repeats, garbles and adds frames.
#include <gmock/gmock.h>

#include <algorithm>
#include <functional>
#include <random>

#include "drivers/canopen_bender/sdo_client.h"
#include "tests/support/sdo_store.h"

namespace bendloop::drivers {
namespace {

using ::testing::HasSubstr;
using Bytes = std::vector<std::uint8_t>;
using Mode = SdoClient::Mode;

constexpr ObjectId kOneObject{0x2001, 3};

Bytes RandomBytes(std::mt19937& random, std::size_t size) {
  Bytes bytes(size);
  for (auto& byte : bytes) byte = static_cast<std::uint8_t>(random());
  return bytes;
}

class Sdo : public ::testing::Test {
 protected:
  // What the bus makes of a frame: as many frames as it likes.
  using Bus = std::function<std::vector<SdoData>(const SdoData&)>;
  static std::vector<SdoData> Clean(const SdoData& frame) { return {frame}; }

  // Until the client is done; every frame that does not come costs it one timeout.
  void Run() {
    for (int step = 0; step < 20000; ++step) {
      SdoData frame{};
      bool moved = false;
      while (client_.NextFrame(frame)) {
        ++sent_;
        moved = true;
        for (const SdoData& request : to_server_(frame)) server_->Receive(request);
        SdoData answer{};
        while (server_->NextFrame(answer)) {
          for (const SdoData& got : to_client_(answer)) client_.Receive(got);
        }
      }
      if (client_.finished()) return;
      if (!moved) client_.Timeout();
    }
    FAIL() << "no end";
  }
  Bytes Upload(std::size_t max_size, Mode mode) {
    client_.Upload(kOneObject, max_size, mode);
    Run();
    return client_.data();
  }
  void Download(const Bytes& bytes, Mode mode) {
    client_.Download(kOneObject, bytes, mode);
    Run();
  }
  void Serve(SdoServer::Options options) { server_.emplace(store_, options); }

  test::SdoStore store_;
  std::optional<SdoServer> server_{std::in_place, store_};
  SdoClient client_;
  Bus to_server_ = Clean;
  Bus to_client_ = Clean;
  int sent_ = 0;
};

TEST_F(Sdo, KnownFramesOfTheStandard) {
  SdoData frame{};
  client_.Upload({0x1018, 2}, 4, Mode::kPlain);
  ASSERT_TRUE(client_.NextFrame(frame));
  EXPECT_EQ(frame, (SdoData{0x40, 0x18, 0x10, 2}));
  EXPECT_TRUE(client_.Receive(SdoData{0x4b, 0x18, 0x10, 2, 0x34, 0x12}));
  EXPECT_EQ(client_.data(), (Bytes{0x34, 0x12}));

  client_.Download({0x2000, 1}, {0x78, 0x56, 0x34}, Mode::kBlock);  // small: expedited all the same
  ASSERT_TRUE(client_.NextFrame(frame));
  EXPECT_EQ(frame, (SdoData{0x27, 0x00, 0x20, 1, 0x78, 0x56, 0x34}));

  client_.Download({0x2000, 1}, Bytes(8, 0xee), Mode::kPlain);
  ASSERT_TRUE(client_.NextFrame(frame));
  EXPECT_EQ(frame, (SdoData{0x21, 0x00, 0x20, 1, 8}));
  EXPECT_TRUE(client_.Receive(SdoData{0x60, 0x00, 0x20, 1}));
  ASSERT_TRUE(client_.NextFrame(frame));
  EXPECT_EQ(frame, (SdoData{0x00, 0xee, 0xee, 0xee, 0xee, 0xee, 0xee, 0xee}));
  EXPECT_TRUE(client_.Receive(SdoData{0x20}));
  ASSERT_TRUE(client_.NextFrame(frame));
  EXPECT_EQ(frame, (SdoData{0x1d, 0xee}));
  const std::string digits = "123456789";
  EXPECT_EQ(SdoCrc(Bytes(digits.begin(), digits.end())), 0x31c3);  // CRC-16/XMODEM
}

TEST_F(Sdo, EverySizeArrivesInEveryWay) {
  std::mt19937 random(1);
  for (const Mode mode : {Mode::kPlain, Mode::kBlock}) {
    for (const std::uint8_t block_size : {1, 2, 7, 127}) {
      Serve({.block = true, .block_size = block_size});
      for (std::size_t size = 1; size < 2000; size += size < 40 ? 1 : 61) {
        const Bytes bytes = RandomBytes(random, size);
        Download(bytes, mode);
        ASSERT_FALSE(client_.failed()) << size << ": " << client_.error();
        ASSERT_EQ(store_.objects[kOneObject], bytes) << size;
        ASSERT_EQ(Upload(size, mode), bytes) << size << client_.error();
        ASSERT_FALSE(client_.failed()) << size << ": " << client_.error();
        if (size == 1) continue;
        Upload(size - 1, mode);
        EXPECT_TRUE(client_.failed());
        EXPECT_LE(client_.data().size(), size + 6);
      }
    }
  }
}

TEST_F(Sdo, BlockTransferSpendsFewFramesAndFallsBack) {
  const Bytes bytes(640, 7);
  Download(bytes, Mode::kBlock);
  EXPECT_EQ(sent_, 1 + 92 + 1);
  sent_ = 0;
  EXPECT_EQ(Upload(640, Mode::kBlock), bytes);
  EXPECT_EQ(sent_, 1 + 1 + 1 + 1);  // ask, start, one acknowledgement, end
  EXPECT_FALSE(client_.block_declined());

  Serve({.block = false});
  EXPECT_EQ(Upload(640, Mode::kBlock), bytes);
  EXPECT_TRUE(client_.block_declined());
  Download(bytes, Mode::kBlock);
  EXPECT_FALSE(client_.failed());
  EXPECT_TRUE(client_.block_declined());
}

TEST_F(Sdo, LostSegmentsOfABlockAreSentAgain) {
  std::mt19937 random(2);
  for (int lost = 0; lost < 30; ++lost) {
    for (const bool of_client : {true, false}) {
      const Bytes bytes = RandomBytes(random, 180);
      int segment = -2;  // not the first answer
      const auto drop = [&, lost](const SdoData& frame) {
        return ++segment == lost ? std::vector<SdoData>{} : std::vector<SdoData>{frame};
      };
      if (of_client) {
        store_.objects[kOneObject] = bytes;
        to_client_ = drop;
        const Bytes got = Upload(180, Mode::kBlock);
        if (!client_.failed()) {
          EXPECT_EQ(got, bytes);
        }
        if (lost < 26) {
          EXPECT_FALSE(client_.failed()) << lost << ": " << client_.error();
        }
      } else {
        to_server_ = drop;
        Download(bytes, Mode::kBlock);
        if (!client_.failed()) {
          EXPECT_EQ(store_.objects[kOneObject], bytes);
        }
        if (lost < 24) {
          EXPECT_FALSE(client_.failed()) << lost << ": " << client_.error();
        }
      }
      to_client_ = to_server_ = Clean;
      server_->Reset();
    }
  }
}

// Whatever the bus does: the transfer ends, and "done" means that the bytes are right.
TEST_F(Sdo, DoneIsRightOnAHostileBus) {
  std::mt19937 random(3);
  int done = 0;
  int failed = 0;
  const auto hostile = [&](const SdoData& frame) {
    std::vector<SdoData> frames{frame};
    switch (random() % 120) {
      case 0:
        frames.clear();
        break;
      case 1:
      case 2:
        frames.push_back(frame);
        break;
      case 3:
        frames[0][0] ^= 0x10;  // toggle
        break;
      case 4:
        for (auto& byte : frames[0]) byte = static_cast<std::uint8_t>(random());
        break;
      case 5:
        frames.insert(frames.begin(), SdoData{0x43, 0x00, 0x10, 0, 1, 2, 3, 4});  // about another
        break;
      default:
        break;
    }
    return frames;
  };
  for (int i = 0; i < 4000; ++i) {
    const Mode mode = i % 2 ? Mode::kBlock : Mode::kPlain;
    const Bytes bytes = RandomBytes(random, 1 + random() % 200);
    Serve({.block = true, .block_size = static_cast<std::uint8_t>(1 + random() % 127)});
    store_.objects[kOneObject] = i % 4 < 2 ? bytes : Bytes{};
    to_client_ = to_server_ = hostile;
    if (i % 4 < 2) {
      const Bytes got = Upload(200, mode);
      // A segment whose bytes were changed shows in a block's crc only.
      if (!client_.failed() && mode == Mode::kBlock && bytes.size() > 14) {
        EXPECT_EQ(got, bytes);
      }
    } else {
      Download(bytes, mode);
      if (!client_.failed() && mode == Mode::kBlock && bytes.size() > 4) {
        EXPECT_EQ(store_.objects[kOneObject], bytes);
      }
    }
    client_.failed() ? ++failed : ++done;
    to_client_ = to_server_ = Clean;
    server_->Reset();
  }
  EXPECT_GT(done, 1000);
  EXPECT_GT(failed, 500);
}

TEST_F(Sdo, SaysWhatWentWrong) {
  const auto error = [&](const Bytes& answer, std::size_t size = 100, Mode mode = Mode::kPlain) {
    client_.Upload(kOneObject, size, mode);
    SdoData frame{};
    while (client_.NextFrame(frame)) {
    }
    client_.Receive(answer);
    while (client_.NextFrame(frame)) {  // the abort
    }
    return client_.error();
  };
  EXPECT_EQ(error({0x80, 0x01, 0x20, 3, 0x11, 0, 0x09, 0x06}),
            "the bender aborts: 0x06090011, the sub-index does not exist");
  EXPECT_THAT(error({0x80, 0x01, 0x20, 3, 1, 2, 3, 4}), HasSubstr("CiA 301 does not name"));
  EXPECT_EQ(error({0x41, 0x01, 0x20, 3, 0xff, 0xff, 0xff, 0xff}),
            "the bender announces 4294967295 bytes, at most 100 were expected");
  EXPECT_EQ(error({0x43, 0x01, 0x20, 3, 1, 2, 3, 4}, 2),
            "the bender sends 4 bytes, at most 2 were expected");
  EXPECT_EQ(error({0x43, 0x01}), "an answer of 2 bytes, where SDO frames have 8");
  EXPECT_EQ(error({0xe0, 1, 2, 3, 4, 5, 6, 7}),
            "the answer e0 01 02 03 04 05 06 07 does not fit the question");
  EXPECT_EQ(error({0xc6, 0x01, 0x20, 3, 0, 0, 1, 0}, 100, Mode::kBlock),
            "the bender announces 65536 bytes, at most 100 were expected");
  error({0x43, 0x02, 0x20, 3, 1, 2, 3, 4});
  client_.Timeout();
  EXPECT_EQ(client_.error(), "no answer; one about 2002sub3 came instead");

  std::mt19937 random(4);
  store_.objects[kOneObject] = RandomBytes(random, 30);
  int segment = 0;
  to_client_ = [&](SdoData frame) {
    if (++segment == 3) frame[0] ^= 0x10;
    return std::vector<SdoData>{frame};
  };
  Upload(30, Mode::kPlain);
  EXPECT_EQ(client_.error(), "toggle bit not alternated");
  to_client_ = [&](SdoData frame) {
    if ((frame[0] & 0xe3) == 0xc1) frame[1] ^= 1;
    return std::vector<SdoData>{frame};
  };
  Upload(30, Mode::kBlock);
  EXPECT_EQ(client_.error(), "the crc of the block transfer is wrong");
  client_.Download({0x3000, 0}, Bytes(30, 1), Mode::kBlock);
  to_client_ = Clean;
  Run();
  EXPECT_THAT(client_.error(), HasSubstr("the object does not exist"));
  EXPECT_EQ(store_.writes, 0);
}

}  // namespace
}  // namespace bendloop::drivers
