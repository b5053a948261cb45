// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <string>

#include "firmware-host/acceptance/acceptance.h"
#include "firmware-host/result/json.h"

namespace bendloop::host {

// What a certificate says beside what was found.
struct CertificateHead {
  std::string date;  // UTC
  std::string software;
  std::string cell;        // name of the cell
  std::string link;        // "modbus-tcp"
  std::string map_file;    // without its folder
  std::string map_digest;  // config::Digest of the map
};

// "PASSED, 4 rules not tried", "FAILED: R9, R14", "NOT FINISHED".
std::string VerdictText(const Acceptance& result);

// Schema bendloop.acceptance/1.
Json CertificateJson(const CertificateHead& head, const Acceptance& result);

// One page without scripts, to keep and to print.
std::string CertificateHtml(const CertificateHead& head, const Acceptance& result);

// A table for a terminal of so many columns.
std::string CertificateText(const CertificateHead& head, const Acceptance& result, bool colour,
                            std::size_t columns);

}  // namespace bendloop::host
