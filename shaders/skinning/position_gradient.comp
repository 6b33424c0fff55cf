// dL/dx = cube_scale (dL/dn through the sdf + dL/dn of the other paths): the upstream gradient of a canonical point, per metre.
// One invocation owns one point.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#include "shared/frame.h"

layout(local_size_x = 64) in;
layout(binding = 0, rgba32f) uniform readonly imageBuffer through_sdf;  // channels 0..2 of a matrix
layout(binding = 1, rgba32f) uniform readonly imageBuffer direct;       // vec4 by point
layout(binding = 2, scalar) restrict readonly buffer Frame { FrameConstants frame; };
layout(binding = 3, scalar) restrict writeonly buffer Upstream { vec4 upstream[]; };
layout(push_constant) uniform Constants { uint stride, column; };  // texels

void main() {
  const int point = int(gl_GlobalInvocationID.x);
  const vec3 sum = imageLoad(through_sdf, point * int(stride) + int(column)).xyz + imageLoad(direct, point).xyz;
  upstream[point] = vec4(frame.cube_scale * sum, 0);
}
