// J = dx_bar/dx of one row, metres per metre: row i = (sum_b w_b R_b)_i + cube_scale · dx_bar_i/dn through the network.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require

#include "shared/frame.h"
#include "shared/skinning.h"

layout(local_size_x = 64) in;
layout(binding = 0, scalar) restrict readonly buffer Frame { FrameConstants frame; };
layout(binding = 1, rgba32f) uniform readonly imageBuffer transforms;  // three texels a row
layout(binding = 2, rgba32f) uniform readonly imageBuffer gradient_x;
layout(binding = 3, rgba32f) uniform readonly imageBuffer gradient_y;
layout(binding = 4, rgba32f) uniform readonly imageBuffer gradient_z;
layout(binding = 5, scalar) restrict writeonly buffer Jacobians { vec4 jacobians[]; };
layout(push_constant, scalar) uniform Constants { JacobianConstants constants; };

void main() {
  const int row = int(gl_GlobalInvocationID.x);
  const ivec3 at = row * ivec3(constants.stride) + ivec3(constants.column);
  const float scale = frame.cube_scale;
  const vec3 x = imageLoad(transforms, 3 * row).xyz + scale * imageLoad(gradient_x, at.x).xyz;
  const vec3 y = imageLoad(transforms, 3 * row + 1).xyz + scale * imageLoad(gradient_y, at.y).xyz;
  const vec3 z = imageLoad(transforms, 3 * row + 2).xyz + scale * imageLoad(gradient_z, at.z).xyz;
  jacobians[3 * row] = vec4(x, 0.0);
  jacobians[3 * row + 1] = vec4(y, 0.0);
  jacobians[3 * row + 2] = vec4(z, 0.0);
}
