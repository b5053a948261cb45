// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <string>

#include "config/toml_document.h"
#include "hal/register_map.h"

namespace bendloop::config {

// A field of a register map outside its rows, a text, or the rows of a program.
struct MapPlace {
  std::string path;                     // "active.crc", "staging.rows"
  hal::RegisterField* field = nullptr;  // nullptr: rows of `area`, or `text`
  hal::ProgramArea* area = nullptr;
  bool is_written = false;    // by us
  bool is_read_back = false;  // as well
  hal::TextField* text = nullptr;

  hal::ObjectAddress object() const {
    if (text) return text->object;
    return field ? field->object : area->rows_object;
  }
};

// Calls `visit` for every place that the map uses.
void VisitPlaces(hal::RegisterMap& map, const std::function<void(const MapPlace&)>& visit);

// Reports objects among registers, and registers among objects.
void CheckOneKind(TomlDocument& document, hal::RegisterMap& map);

// What a file of objects must keep besides.
void CheckObjects(TomlDocument& document, hal::RegisterMap& map);

}  // namespace bendloop::config
