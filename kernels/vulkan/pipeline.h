// A compute pipeline whose interface (bindings, push constants, workgroup size) was read from its SPIR-V.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

struct VkPipeline_T;
struct VkPipelineLayout_T;
struct VkDescriptorSetLayout_T;

namespace arah {

enum class BindingType { storage_buffer, uniform_buffer, storage_texel_buffer, uniform_texel_buffer };

struct ShaderBinding {
  uint32_t binding = 0;
  BindingType type = BindingType::storage_buffer;
  std::string name;
  bool words = false;  // of a texel buffer: its texels are four uint32 instead of four floats
};

struct ShaderInterface {
  std::vector<ShaderBinding> bindings;  // set 0, by binding number, dense from 0
  uint32_t push_constant_bytes = 0;
  std::array<uint32_t, 3> local_size{1, 1, 1};
};

// Reads the interface of a compute shader; `specialization` replaces constants that size the workgroup.
// Throws std::runtime_error where the words are not a SPIR-V module of the supported form.
ShaderInterface reflect_spirv(const uint32_t* words, size_t count, const std::vector<uint32_t>& specialization = {});

struct Pipeline {
  std::string name;  // "<area>/<stem>"
  ShaderInterface interface;
  VkPipeline_T* handle = nullptr;
  VkPipelineLayout_T* layout = nullptr;
  VkDescriptorSetLayout_T* set_layout = nullptr;
  mutable bool launched = false;  // nothing is left to compile
};

}  // namespace arah
