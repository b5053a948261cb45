// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "drivers/register_bender/register_image.h"
#include "hal/register_map.h"
#include "hal/result.h"

namespace bendloop::drivers {

// One value to and from registers: value = raw * scale + offset, in the map's word and byte order.
// `what` names the value in messages.

// kBadInput if the value is not finite or does not fit the field's type; never wraps or clips.
hal::Result<void> PutField(const hal::RegisterMap& map, const hal::RegisterField& field,
                           double value, std::string_view what, RegisterImage& image);

// kDevice if the registers hold a float that is not finite.
hal::Result<double> GetField(const hal::RegisterMap& map, const hal::RegisterField& field,
                             std::string_view what, const RegisterImage& image);

// kDevice if the registers do not hold a whole number from 0 to 2^32 - 1.
hal::Result<std::uint32_t> GetInteger(const hal::RegisterMap& map, const hal::RegisterField& field,
                                      std::string_view what, const RegisterImage& image);

// The text without blanks and zeros at its end; empty where it is not all printable ASCII.
std::optional<std::string> GetText(const hal::RegisterMap& map, const hal::TextField& field,
                                   const RegisterImage& image);
// What does not fit is left out.
void PutText(const hal::RegisterMap& map, const hal::TextField& field, std::string_view text,
             RegisterImage& image);

// The largest whole number such that it and every one below it down to 1 keep their value.
std::uint32_t MaxInteger(const hal::RegisterField& field);

RegisterRange RangeOf(const hal::RegisterField& field);
RegisterRange RangeOf(const hal::TextField& field);

// "register 12", "object 2001sub3": where the controller has the value.
std::string PlaceOf(const hal::RegisterField& field);

}  // namespace bendloop::drivers
