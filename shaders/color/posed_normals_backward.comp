// From the gradient at a sample's posed normal T₃ₓ₃ ∇f to the cotangent T₃ₓ₃ᵀ dL/dnormal of the field's gradient; the
// blended transform T is a constant (ARAH.md §1, "Normal"). One invocation owns one sample and writes the whole row of
// eight floats, zeros in channels 3 to 7. A sample that the loss does not depend on gets zeros, whatever its transform.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require

#include "lib/row_access.glsl"

layout(local_size_x = 64) in;
layout(constant_id = 0) const bool POSED = true;  // else T is the identity
layout(binding = 0, rgba32f) uniform readonly imageBuffer d_normals;
layout(binding = 1, rgba32f) uniform readonly imageBuffer transforms;  // three texels by row
layout(binding = 2, scalar) restrict writeonly buffer DGradients { u64vec4 d_gradients[]; };
layout(push_constant) uniform Constants { uint stride, column; };  // groups of 8 floats

void main() {
  const int row = int(gl_GlobalInvocationID.x);
  const vec3 d = imageLoad(d_normals, row).xyz;
  vec3 turned = d;
  if (POSED)
    turned = d.x * imageLoad(transforms, 3 * row).xyz + d.y * imageLoad(transforms, 3 * row + 1).xyz +
             d.z * imageLoad(transforms, 3 * row + 2).xyz;
  const vec3 result = d == vec3(0) ? vec3(0) : turned;
  d_gradients[row * int(stride) + int(column)] = pack_floats(vec4(result, 0), vec4(0));
}
