// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/console/version.h"

#include <algorithm>

#include "firmware-host/console/build_commit.h"
#include "firmware-host/console/wrap.h"

namespace bendloop::host {

const char* const kSoftware =
    "bendloop " BENDLOOP_VERSION " (" BENDLOOP_COMMIT ", " BENDLOOP_BUILD_TYPE ")";

std::string BuildText() {
  std::string text =
      std::string(kSoftware) + "\nbuild: " BENDLOOP_BUILD_TYPE ", " BENDLOOP_COMPILER;
  const std::string begin = "libraries: ";
  std::string indent = begin;
  for (const std::string& line : WrapWords(BENDLOOP_LIBRARIES, kPlainColumns - begin.size())) {
    text += "\n" + indent + line;
    std::replace(text.begin(), text.end(), '~', ' ');
    indent = std::string(begin.size(), ' ');
  }
  return text;
}

}  // namespace bendloop::host
