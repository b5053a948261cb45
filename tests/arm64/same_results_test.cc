// SPDX-License-Identifier: Apache-2.0
// What both builds write of one scan: the same but for the last digit of numbers
// (pipeline/math/README.md says what was measured).
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <nlohmann/json.hpp>
#include <numbers>
#include <string>

#include "tests/replay/program.h"

namespace bendloop::testing {
namespace {

using nlohmann::json;

// [in the unit of the number] Results have six digits behind the point; one may be rounded the
// other way.
constexpr double kLastDigit = 1.01e-6;
// [mm, degrees] Ceres' free spine of a canal ends where a step gains little: rounding shows there.
constexpr double kFreeSpine = 1e-4;

// Paths and values that differ, and by how much numbers do.
struct Difference {
  double greatest = 0;
  int numbers = 0;
  std::string others;

  void Between(const json& a, const json& b, const std::string& path) {
    if (a == b) return;
    if (a.is_number() && b.is_number()) {
      greatest = std::max(greatest, std::abs(a.get<double>() - b.get<double>()));
      ++numbers;
    } else if (a.is_object() && b.is_object() && a.size() == b.size()) {
      for (const auto& [key, value] : a.items()) {
        if (b.contains(key)) Between(value, b[key], path + "/" + key);
        if (!b.contains(key)) others += path + "/" + key + " is missing\n";
      }
    } else if (a.is_array() && b.is_array() && a.size() == b.size()) {
      for (std::size_t i = 0; i < a.size(); ++i)
        Between(a[i], b[i], path + "/" + std::to_string(i));
    } else {
      others += path + ": " + a.dump() + " and " + b.dump() + "\n";
    }
  }
};

class SameResults : public ::testing::Test {
 protected:
  void SetUp() override {
    ASSERT_TRUE(std::filesystem::exists(BENDLOOP_AMD64_PROGRAM))
        << "build it first: cmake --preset release && cmake --build --preset release -t bendloop";
  }

  void Run(const std::string& program, const std::string& arguments) const {
    const std::string log = (scratch_ / "log").string();
    const int status =
        std::system((program + " " + arguments + " </dev/null >" + log + " 2>&1").c_str());
    // 1: measured, but refused or out of tolerance.
    ASSERT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) <= 1)
        << program << " " << arguments << "\n"
        << Slurp(log);
  }

  json Result(const std::string& program, const std::string& arguments) const {
    std::filesystem::remove_all(scratch_ / "state");
    const auto file = scratch_ / "result.json";
    Run(program, arguments + " --json " + file.string());
    json result = json::parse(Slurp(file), nullptr, false);
    result.erase("timing_ms");
    result.erase("software");  // the commits may differ while somebody works
    return result;
  }

  void ExpectTheSame(const std::string& arguments, double at_most = kLastDigit) const {
    const json amd64 = Result(BENDLOOP_AMD64_PROGRAM, arguments);
    const json arm64 = Result(BENDLOOP_EMULATOR " " BENDLOOP_BIN_DIR "/bendloop", arguments);
    ASSERT_TRUE(amd64.is_object()) << arguments;
    Difference difference;
    difference.Between(amd64, arm64, "");
    EXPECT_EQ(difference.others, "") << arguments;
    EXPECT_LE(difference.greatest, at_most) << arguments;
    std::cout << difference.numbers << " numbers differ, by at most " << difference.greatest
              << "\n";
  }

  // A virtual scan of a shipped part, replayed as the daemon would see it.
  void ExpectTheSameReplay(const std::string& part, const std::string& options) const {
    const std::string shipped = BENDLOOP_SOURCE_DIR "/config/";
    const std::string session = (scratch_ / "scan.session").string();
    Run(BENDLOOP_AMD64_PROGRAM, "simulate --part " + shipped + "parts/" + part + ".toml --out " +
                                    session + " --spacing 0.5 --rays 320 --views 2 " + options);
    const std::string cell = (scratch_ / "cell.toml").string();
    std::ofstream(cell) << "schema = \"bendloop.cell/1\"\nname = \"test\"\npart = \"" << shipped
                        << "parts/" << part << ".toml\"\nstate_dir = \"state\"\n"
                        << "[scanner]\nkind = \"simulated\"\n[bender]\nlink = \"simulated\"\n"
                        << "register_map = \"" << shipped << "register-maps/default.toml\"\n";
    ExpectTheSame("replay " + session + " --config " + cell);
  }

  Scratch scratch_;
};

TEST_F(SameResults, ReplayOfTheDemosPart) {
  ExpectTheSameReplay("demo", "--seed 21 --springback-120 4.6");
}
TEST_F(SameResults, ReplayOfAPartFromPoints) { ExpectTheSameReplay("from-xyz", "--seed 22"); }
TEST_F(SameResults, ReplayOfANearlySymmetricPart) {
  ExpectTheSameReplay("near-symmetric", "--seed 23 --springback-120 3");
}

// A pipe of radius 8 to 6 mm: straight, 60 degrees at a radius of 40 mm, straight. Golden angles
// around it.
void WriteTaperedPipe(const std::filesystem::path& path) {
  constexpr double kPi = std::numbers::pi, kBend = kPi / 3.0, kRadius = 40.0, kStraight = 70.0;
  constexpr int kPoints = 6000;
  const double whole = 2.0 * kStraight + kRadius * kBend;
  std::ofstream out(path);
  for (int i = 0; i < kPoints; ++i) {
    const double along = whole * i / kPoints;
    const double turn = std::clamp((along - kStraight) / kRadius, 0.0, kBend);
    const double first = std::min(along, kStraight);
    const double last = std::max(0.0, along - kStraight - kRadius * kBend);
    const double x = first + kRadius * std::sin(turn) + last * std::cos(turn);
    const double y = kRadius * (1.0 - std::cos(turn)) + last * std::sin(turn);
    const double around = kPi * (3.0 - std::sqrt(5.0)) * i;
    // Ripples stand for noise.
    const double r = 8.0 - 2.0 * along / whole + 0.03 * std::sin(7.3 * i);
    out << x - r * std::cos(around) * std::sin(turn) << " "
        << y + r * std::cos(around) * std::cos(turn) << " " << r * std::sin(around) << "\n";
  }
}

// A straight has no roll that its points would tell: its frame, and what is looked at in that
// frame, must not be what rounding made of it while a part with a bend was tried.
TEST_F(SameResults, StraightWhereThePartHasABend) {
  const auto cloud = scratch_ / "straight.xyz";
  std::ofstream points(cloud);
  for (int i = 0; i < 3000; ++i) {
    const double around = 0.7 * i, r = 5.0 + 0.01 * std::sin(7.3 * i);
    points << 0.036 * i << " " << r * std::cos(around) << " " << r * std::sin(around) << "\n";
  }
  points.close();
  const auto part = scratch_ / "part.toml";
  std::ofstream(part) << "schema = \"bendloop.part/1\"\nname = \"short\"\npart_number = 1\n"
                         "pipe_radius_mm = 5.0\nbend_radius_mm = 15.0\n"
                         "[[row]]\nlength_mm = 50\nangle_deg = 20\n[[row]]\nlength_mm = 53\n";
  ExpectTheSame("reconstruct " + cloud.string() + " --part " + part.string());
}

// Ceres' free spine.
TEST_F(SameResults, TaperedPipe) {
  const auto cloud = scratch_ / "tapered.xyz";
  WriteTaperedPipe(cloud);
  ExpectTheSame("reconstruct " + cloud.string() + " --model canal", kFreeSpine);
}

// Scanned by others.
TEST_F(SameResults, RealCoil) {
  ExpectTheSame("reconstruct " BENDLOOP_SOURCE_DIR
                "/tests/data/clouds/real-coil/coil.ply --units m");
}

}  // namespace
}  // namespace bendloop::testing
