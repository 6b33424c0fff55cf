#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>

#include "host/cli/command.h"
#include "kernels/vulkan/device.h"

namespace arah {
namespace {

constexpr double kMebibyte = 1 << 20;

struct Survey {
  std::vector<DeviceReport> devices;
  std::optional<uint32_t> chosen;  // index of the device that the program would run on
  std::string reason;              // why none can be chosen
};

// Opens the device that any other subcommand would take, so that "chosen" is what really happens.
Survey survey() {
  Survey result;
  result.devices = survey_devices();
  try {
    result.chosen = Device().report().index;
  } catch (const std::exception& error) {
    result.reason = error.what();
  }
  return result;
}

std::string as_json(const Survey& survey) {
  nlohmann::ordered_json devices = nlohmann::json::array();
  for (const DeviceReport& device : survey.devices) {
    devices.push_back({{"index", device.index},
                       {"name", device.name},
                       {"driver", device.driver},
                       {"api_version", device.api_version},
                       {"type", to_string(device.type)},
                       {"chosen", survey.chosen == device.index},
                       {"refusals", device.refusals},
                       {"heap_bytes", device.heap_bytes},
                       {"max_storage_buffer_bytes", device.max_storage_buffer_bytes},
                       {"max_allocation_bytes", device.max_allocation_bytes},
                       {"max_texel_elements", device.max_texel_elements},
                       {"max_workgroup_invocations", device.max_workgroup_invocations},
                       {"max_workgroups_x", device.max_workgroups_x},
                       {"max_shared_bytes", device.max_shared_bytes},
                       {"max_push_constant_bytes", device.max_push_constant_bytes},
                       {"subgroup_size", device.subgroup_size},
                       {"timestamp_period_ns", device.timestamp_period_ns},
                       {"cooperative_matrix_missing", device.cooperative_matrix_missing}});
  }
  return nlohmann::ordered_json{{"devices", devices}}.dump(1) + "\n";
}

std::string as_text(const Survey& survey) {
  std::string text;
  for (const DeviceReport& device : survey.devices) {
    const bool chosen = survey.chosen == device.index;
    text += fmt::format("{} {} {}: {}, Vulkan {}, {}\n", chosen ? "*" : " ", device.index, device.name,
                        to_string(device.type), device.api_version, device.driver);
    text += fmt::format(
        "      memory {:.0f} MiB, buffers up to {:.0f} MiB, subgroups of {}, {} KiB shared by a workgroup\n",
        static_cast<double>(device.heap_bytes) / kMebibyte,
        static_cast<double>(device.max_storage_buffer_bytes) / kMebibyte, device.subgroup_size,
        device.max_shared_bytes / 1024);
    text += device.cooperative_matrix_missing.empty() ? "      arithmetic=cooperative_matrix: 16 x 16 x 16 halves, float32 sums\n"
                                                      : fmt::format("      no arithmetic=cooperative_matrix: {}\n", device.cooperative_matrix_missing);
    for (const std::string& refusal : device.refusals) text += fmt::format("      refused: {}\n", refusal);
  }
  if (survey.devices.empty()) text += "the Vulkan loader lists no device\n";
  if (survey.chosen) text += "* the device that would be used; ARAH_DEVICE=<number or part of a name> takes another\n";
  return text;
}

}  // namespace

void add_devices_command(CLI::App& program, Run& run) {
  const auto json = std::make_shared<bool>(false);
  CLI::App* command =
      program.add_subcommand("devices", "List the Vulkan devices, which one would be used, and why not others");
  command->add_flag("--json", *json, "machine-readable output");
  command->footer("Example: arah devices --json");
  command->callback([json, &run] {
    run = [json] {
      const Survey found = survey();
      fmt::print("{}", *json ? as_json(found) : as_text(found));
      if (!found.chosen) throw std::runtime_error(found.reason);
      return 0;
    };
  });
}

}  // namespace arah
