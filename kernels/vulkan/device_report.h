// What a Vulkan device offers, and why this program takes or refuses it.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace arah {

enum class DeviceType { cpu, integrated_gpu, discrete_gpu, virtual_gpu, other };

const char* to_string(DeviceType type);

struct DeviceReport {
  uint32_t index = 0;  // position in the loader's list; `--device 1` asks for it
  std::string name;
  std::string driver;  // name and version as the driver states them
  std::string api_version;
  DeviceType type = DeviceType::other;

  std::vector<std::string> refusals;  // empty: usable; otherwise what was asked for and what the device offers
  bool usable() const { return refusals.empty(); }

  // Limits that the memory plan and the kernels ask for (bytes or elements, as Vulkan states them).
  uint64_t max_storage_buffer_bytes = 0;
  uint64_t max_allocation_bytes = 0;
  uint64_t heap_bytes = 0;  // largest device-local heap
  uint64_t max_texel_elements = 0;
  uint64_t buffer_offset_alignment = 1;  // satisfies storage, uniform and texel bindings alike
  uint32_t max_workgroup_invocations = 0;
  uint32_t max_workgroups_x = 0;
  uint32_t max_shared_bytes = 0;
  uint32_t max_push_constant_bytes = 0;
  uint32_t subgroup_size = 0;
  double timestamp_period_ns = 0;  // 0: no timestamps

  // What the device lacks of the cooperative matrices that linear/cooperative_forward needs; "": nothing.
  std::string cooperative_matrix_missing = "Vulkan 1.2";
};

// Every device that the Vulkan loader lists, in its order; empty where there is none.
// Throws std::runtime_error where the loader itself cannot start.
std::vector<DeviceReport> survey_devices();

}  // namespace arah
