// Normals of samples in posed space: normal = T₃ₓ₃ ∇f / |T₃ₓ₃ ∇f|, with T the blended transform (ARAH.md §1, "Normal").
// One invocation owns one sample. A zero gradient gives a zero normal.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#include "lib/stable.glsl"

layout(local_size_x = 64) in;
layout(constant_id = 0) const int UNIT_LENGTH = 1;
layout(constant_id = 1) const bool POSED = true;  // else T is the identity: normals of the canonical pose
layout(binding = 0, rgba32f) uniform readonly imageBuffer gradients;   // channels 0..2 of a matrix: ∂f/∂n
layout(binding = 1, rgba32f) uniform readonly imageBuffer transforms;  // three vec4 by row
layout(binding = 2, scalar) restrict writeonly buffer Normals { vec4 normals[]; };
layout(push_constant) uniform Constants { uint stride, column; };  // texels

void main() {
  const int row = int(gl_GlobalInvocationID.x);
  const vec3 gradient = imageLoad(gradients, row * int(stride) + int(column)).xyz;
  vec3 normal = gradient;
  if (POSED)
    normal = vec3(dot(imageLoad(transforms, 3 * row).xyz, gradient), dot(imageLoad(transforms, 3 * row + 1).xyz, gradient),
                  dot(imageLoad(transforms, 3 * row + 2).xyz, gradient));
  if (UNIT_LENGTH != 0) {
    normal *= factor_for_squares(normal);
    const float squared = dot(normal, normal);
    normal *= squared == 0.0 ? 0.0 : inversesqrt(squared);  // not `squared > 0.0`: a NaN is to be seen
  }
  normals[row] = vec4(normal, 0);
}
