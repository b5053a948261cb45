// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

#include "firmware-host/result/json.h"
#include "hal/result.h"

// The other end of the status server: what `bendloop status` and the demo ask with. A library of
// its own: the daemon shall not load cpp-httplib, which brings TLS and compression with it.
namespace bendloop::host {

// GET from a server on this machine; kDevice when nobody answers, or says nothing for `timeout_s`.
hal::Result<std::string> FetchLocal(std::uint16_t port, const std::string& path, int timeout_s = 2);

// /status at this port; kDevice when there is no daemon.
hal::Result<Json> FetchStatus(std::uint16_t port);
// /status of the daemon whose address stands in this file of its state directory: by its socket,
// else by its port. kDevice when there is no daemon, or when this user may not know.
hal::Result<Json> FetchStatus(const std::filesystem::path& address_file);

}  // namespace bendloop::host
