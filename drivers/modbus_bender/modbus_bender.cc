// SPDX-License-Identifier: Apache-2.0
#include "drivers/modbus_bender/modbus_bender.h"

#include <utility>

#include "drivers/modbus_bender/modbus_connection.h"
#include "drivers/register_bender/program_codec.h"
#include "drivers/register_bender/register_bender.h"

namespace bendloop::drivers {
namespace {

class ModbusCarrier final : public RegisterCarrier {
 public:
  ModbusCarrier(const hal::RegisterMap& map, ModbusBenderOptions options, hal::Clock& clock)
      : max_read_(map.max_read_registers),
        max_write_(map.max_write_registers),
        connection_(std::move(options), clock) {}

  std::string carrier() const override { return connection_.carrier(); }
  std::string peer() const override { return connection_.peer(); }
  hal::Result<void> Connect() override { return connection_.Connect(); }

  hal::Result<void> Read(const std::vector<RegisterRange>& ranges, RegisterImage& image) override {
    for (const RegisterRange& range : PlanRequests(ranges, max_read_)) {
      std::uint16_t* to = image.At(range.space, static_cast<std::uint16_t>(range.address));
      if (auto ok = connection_.Read(range, to); !ok) return ok;
    }
    return {};
  }

  hal::Result<void> Write(const std::vector<RegisterRange>& ranges,
                          const RegisterImage& image) override {
    for (const RegisterRange& range : PlanRequests(ranges, max_write_)) {
      const auto* from = image.At(range.space, static_cast<std::uint16_t>(range.address));
      if (auto ok = connection_.Write(range, from); !ok) return ok;
    }
    return {};
  }

 private:
  const std::uint16_t max_read_;
  const std::uint16_t max_write_;
  ModbusConnection connection_;
};

}  // namespace

std::unique_ptr<hal::BenderLink> MakeModbusBender(hal::RegisterMap map, ModbusBenderOptions options,
                                                  hal::Clock& clock) {
  auto carrier = std::make_unique<ModbusCarrier>(map, std::move(options), clock);
  return MakeRegisterBender(std::move(map), std::move(carrier));
}

}  // namespace bendloop::drivers
