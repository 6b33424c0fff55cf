// Of each ray's samples that have a canonical point, the one with the least distance, the first of several. One invocation
// walks one ray and writes that point with w = 1, or zeros where no sample has a point and in the padding. A distance that is
// no number is taken, so that it is seen further on.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#include "shared/sampling.h"

layout(local_size_x = 64) in;

layout(push_constant, scalar) uniform Constants { LeastDistanceConstants c; };
layout(binding = 0, rgba32f) uniform readonly imageBuffer sdf;     // by row = ray · samples + sample
layout(binding = 1, rgba32f) uniform readonly imageBuffer points;  // by row; w > 0: has a canonical point
layout(binding = 2, scalar) writeonly buffer Least { vec4 least[]; };

void main() {
  uint ray = gl_GlobalInvocationID.x;
  uint samples = c.samples, stride = c.stride, column = c.column;
  uint first = min(ray, c.rays - 1u) * samples;
  vec4 found = vec4(0.0);
  float nearest = 0.0;
  for (uint sample_ = 0u; sample_ < samples; ++sample_) {
    vec4 point = imageLoad(points, int(first + sample_));
    float f = imageLoad(sdf, int((first + sample_) * stride + column)).x;
    bool nearer = point.w > 0.0 && (found.w == 0.0 || f < nearest || isnan(f)) && !(found.w > 0.0 && isnan(nearest));
    found = nearer ? vec4(point.xyz, 1.0) : found;
    nearest = nearer ? f : nearest;
  }
  least[ray] = ray < c.rays ? found : vec4(0.0);
}
