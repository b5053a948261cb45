// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace bendloop::host {

// Name, version and commit, "bendloop 0.1.0 (4071980d1f2e)": in results, sessions, status and logs.
// A "+" after the commit: the sources had changes of their own.
extern const char* const kSoftware;

// The same with what else decides about behaviour: build type, compiler, libraries. What --version
// prints.
std::string BuildText();

}  // namespace bendloop::host
