// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "hal/register_map.h"
#include "hal/result.h"

namespace bendloop::config {

// An object of an EDS file (CiA 306), as far as an SDO client needs it.
struct DictionaryObject {
  hal::ObjectAddress address;
  std::uint16_t data_type = 0;  // CiA 301's numbers: 5 is UNSIGNED8, 15 is DOMAIN
  bool readable = false;
  bool writable = false;
  std::uint32_t line = 0;  // of its section
};

struct ObjectDictionary {
  std::string file;                 // for messages
  std::uint32_t vendor_number = 0;  // object 1018sub1; 0: not told
  std::uint32_t product_number = 0;
  std::vector<DictionaryObject> objects;  // by index and sub-index

  const DictionaryObject* Find(hal::ObjectAddress address) const;
};

// Reads an EDS. Errors are as load.h's, `FILE:LINE: [section] key: found ..., expected ...`.
// Sections and keys that are of no use to an SDO client are passed over.
hal::Result<ObjectDictionary> ParseObjectDictionary(std::string_view eds, std::string_view name);
hal::Result<ObjectDictionary> LoadObjectDictionary(const std::filesystem::path& file);

// Gives every field of a map of objects the type that the dictionary says, and a register of its
// own to be kept in. kBadInput for objects that are missing, or have a type or an access that does
// not fit.
hal::Result<void> BindObjects(hal::RegisterMap& map, const ObjectDictionary& dictionary);

}  // namespace bendloop::config
