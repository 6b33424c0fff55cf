// The small part of SPIR-V that a launch needs: descriptor bindings of set 0, size of the push-constant block, local size.
// Numbers are those of the SPIR-V specification, section 3.
#include <algorithm>
#include <cstring>
#include <map>
#include <stdexcept>

#include "kernels/vulkan/pipeline.h"

namespace arah {
namespace {

enum : uint32_t {
  op_name = 5, op_execution_mode = 16, op_type_bool = 20, op_type_int = 21, op_type_float = 22, op_type_vector = 23,
  op_type_matrix = 24, op_type_image = 25, op_type_sampled_image = 27, op_type_array = 28, op_type_struct = 30,
  op_type_pointer = 32, op_constant = 43, op_spec_constant = 50, op_spec_constant_composite = 51, op_constant_composite = 44,
  op_variable = 59, op_decorate = 71, op_member_decorate = 72, op_execution_mode_id = 331
};
enum : uint32_t {
  decoration_spec_id = 1, decoration_array_stride = 6, decoration_builtin = 11, decoration_binding = 33, decoration_set = 34,
  decoration_offset = 35, builtin_workgroup_size = 25, mode_local_size = 17, mode_local_size_id = 38
};
enum : uint32_t { class_uniform_constant = 0, class_uniform = 2, class_push_constant = 9, class_storage_buffer = 12 };

struct Id {
  uint32_t op = 0;
  std::vector<uint32_t> operands;  // without the result id
  std::string name;
  uint32_t binding = ~0u, set = 0, spec_id = ~0u, array_stride = 0;
  bool workgroup_size = false;
  std::map<uint32_t, uint32_t> member_offsets;
};

class Module {
 public:
  Module(const uint32_t* words, size_t count, const std::vector<uint32_t>& specialization) : specialization_(specialization) {
    if (count < 5 || words[0] != 0x07230203) throw std::runtime_error("not a SPIR-V module: bad magic number or too short");
    for (size_t at = 5; at < count;) {
      const uint32_t length = words[at] >> 16, op = words[at] & 0xffff;
      if (length == 0 || at + length > count) throw std::runtime_error("SPIR-V module is cut off inside an instruction");
      read(op, words + at + 1, length - 1);
      at += length;
    }
  }

  ShaderInterface interface() {
    ShaderInterface result;
    for (auto& [key, id] : ids_) {
      if (id.op == op_spec_constant_composite || id.op == op_constant_composite) {
        if (id.workgroup_size)
          for (int i = 0; i < 3; ++i) local_size_[i] = value(id.operands[1 + i]);
      }
      if (id.op != op_variable) continue;
      const Id& pointer = ids_.at(id.operands[0]);
      const uint32_t storage = id.operands[1], pointee = pointer.operands[1];
      if (storage == class_push_constant) result.push_constant_bytes = size_of(pointee);
      if (id.binding == ~0u) continue;
      if (id.set != 0) throw std::runtime_error("a shader uses a descriptor set other than 0");
      result.bindings.push_back({id.binding, binding_type(storage, pointee), id.name.empty() ? ids_.at(pointee).name : id.name, texels_are_words(pointee)});
    }
    std::sort(result.bindings.begin(), result.bindings.end(), [](const auto& a, const auto& b) { return a.binding < b.binding; });
    for (size_t i = 0; i < result.bindings.size(); ++i)
      if (result.bindings[i].binding != i) throw std::runtime_error("a shader's bindings are not 0, 1, 2, … without gaps");
    result.local_size = local_size_;
    return result;
  }

 private:
  void read(uint32_t op, const uint32_t* w, uint32_t n) {
    switch (op) {
      case op_name:
        if (n >= 2) ids_[w[0]].name.assign(reinterpret_cast<const char*>(w + 1), strnlen(reinterpret_cast<const char*>(w + 1), (n - 1) * 4));
        break;
      case op_execution_mode:
        if (n >= 5 && w[1] == mode_local_size) local_size_ = {w[2], w[3], w[4]};
        break;
      case op_execution_mode_id:
        throw std::runtime_error("LocalSizeId is not supported: use local_size_x_id, which glslang turns into WorkgroupSize");
      case op_type_bool: case op_type_int: case op_type_float: case op_type_vector: case op_type_matrix: case op_type_image:
      case op_type_sampled_image: case op_type_array: case op_type_struct: case op_type_pointer:
        define(w[0], op, w + 1, n - 1);
        break;
      case op_constant: case op_spec_constant: case op_spec_constant_composite: case op_constant_composite: case op_variable:
        // result type, result id, operands: the type is kept as the first operand
        if (n >= 2) {
          std::vector<uint32_t> operands{w[0]};
          operands.insert(operands.end(), w + 2, w + n);
          define(w[1], op, operands.data(), static_cast<uint32_t>(operands.size()));
        }
        break;
      case op_decorate:
        if (n >= 2) decorate(ids_[w[0]], w[1], n > 2 ? w[2] : 0);
        break;
      case op_member_decorate:
        if (n >= 4 && w[2] == decoration_offset) ids_[w[0]].member_offsets[w[1]] = w[3];
        break;
      default:
        break;
    }
  }
  void define(uint32_t result, uint32_t op, const uint32_t* operands, uint32_t n) {
    ids_[result].op = op;
    ids_[result].operands.assign(operands, operands + n);
  }
  static void decorate(Id& id, uint32_t decoration, uint32_t operand) {
    if (decoration == decoration_binding) id.binding = operand;
    if (decoration == decoration_set) id.set = operand;
    if (decoration == decoration_spec_id) id.spec_id = operand;
    if (decoration == decoration_array_stride) id.array_stride = operand;
    if (decoration == decoration_builtin && operand == builtin_workgroup_size) id.workgroup_size = true;
  }
  uint32_t value(uint32_t constant) const {
    const Id& id = ids_.at(constant);
    if (id.op == op_spec_constant && id.spec_id < specialization_.size()) return specialization_[id.spec_id];
    return id.operands.at(1);
  }
  BindingType binding_type(uint32_t storage, uint32_t type) const {
    const Id& id = ids_.at(type);
    if (storage == class_storage_buffer) return BindingType::storage_buffer;
    if (storage == class_uniform) return BindingType::uniform_buffer;
    // OpTypeImage: sampled type, dim, depth, arrayed, multisampled, sampled (1 sampled, 2 storage); dim 5 is Buffer
    const Id& image = id.op == op_type_sampled_image ? ids_.at(id.operands[0]) : id;
    if (storage == class_uniform_constant && image.op == op_type_image && image.operands[1] == 5)
      return image.operands[5] == 2 ? BindingType::storage_texel_buffer : BindingType::uniform_texel_buffer;
    throw std::runtime_error("a shader binds '" + id.name + "', which is neither a buffer nor a texel buffer");
  }
  bool texels_are_words(uint32_t type) const {
    const Id& id = ids_.at(type);
    const Id& image = id.op == op_type_sampled_image ? ids_.at(id.operands[0]) : id;
    return image.op == op_type_image && ids_.at(image.operands[0]).op == op_type_int;
  }
  // Bytes to the end of a type in explicit layout.
  uint32_t size_of(uint32_t type) const {
    const Id& id = ids_.at(type);
    switch (id.op) {
      case op_type_int: case op_type_float: return id.operands[0] / 8;
      case op_type_vector: return size_of(id.operands[0]) * id.operands[1];
      case op_type_matrix: return size_of(id.operands[0]) * id.operands[1];
      case op_type_array: return id.array_stride * value(id.operands[1]);
      case op_type_pointer: return 8;  // buffer reference
      case op_type_struct: {
        uint32_t end = 0;
        for (uint32_t i = 0; i < id.operands.size(); ++i) {
          const auto offset = id.member_offsets.find(i);
          end = std::max(end, (offset == id.member_offsets.end() ? 0 : offset->second) + size_of(id.operands[i]));
        }
        return end;
      }
      default: throw std::runtime_error("a push constant has a type of unknown size");
    }
  }

  const std::vector<uint32_t>& specialization_;
  std::map<uint32_t, Id> ids_;
  std::array<uint32_t, 3> local_size_{1, 1, 1};
};

}  // namespace

ShaderInterface reflect_spirv(const uint32_t* words, size_t count, const std::vector<uint32_t>& specialization) {
  return Module(words, count, specialization).interface();
}

}  // namespace arah
