// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace bendloop::host {

// Name, version, commit and build type, "bendloop 0.1.0 (4071980d1f2e, Release)": in results,
// sessions, status and logs. A "+" after the commit: the sources had changes of their own.
extern const char* const kSoftware;

// The same with compiler and libraries: what --version prints.
std::string BuildText();

}  // namespace bendloop::host
