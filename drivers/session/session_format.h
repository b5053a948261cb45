// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>

// The session file in numbers; README.md beside this file is the reference.
namespace bendloop::drivers {

constexpr std::int32_t kSessionApplicationId = 0x424C5345;  // "BLSE"
constexpr std::int32_t kSessionVersion = 2;
constexpr std::int32_t kSessionVersionWithoutSums = 1;  // still read

constexpr std::size_t kSessionPoseBytes = 7 * sizeof(double);
constexpr std::size_t kSessionPointBytes = 2 * sizeof(float);
// Points of one profile that are believed; a longer blob is damage, not data.
constexpr std::size_t kSessionMaxPoints = 1'000'000;
// A pose whose quaternion is further than this from unit length is refused.
constexpr double kSessionUnitTolerance = 1e-6;

constexpr const char* kSessionTables =
    "CREATE TABLE meta(key TEXT PRIMARY KEY, value TEXT NOT NULL);"
    "CREATE TABLE profile(seq INTEGER PRIMARY KEY, t_ns INTEGER NOT NULL, pose BLOB NOT NULL,"
    " points BLOB NOT NULL, intensity BLOB, crc INTEGER NOT NULL);"
    "CREATE TABLE event(t_ns INTEGER NOT NULL, kind TEXT NOT NULL, detail TEXT);";

// Key of meta under which the closed file's digest stands.
constexpr const char* kSessionDigestKey = "digest";

}  // namespace bendloop::drivers
