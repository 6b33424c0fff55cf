// The start that a bone gives to the search of a posed point: x = B_j^-1 q, as if the bone alone moved it (SNARF's
// initialisation), j the bone that is the rank-th nearest to q. How near a bone is shows in canonical space, where it stands
// still: the distance of B_j^-1 q to the segment from its joint to the middle of its children's. One invocation serves one
// row; it passes over the bones once for each rank up to its own. Of equally near bones the lower index comes first.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require

#define ROWS_CONSTANT 0
#include "lib/rows.glsl"
#include "shared/frame.h"
#include "shared/tracing.h"

layout(local_size_x = 64) in;
layout(binding = 2, rgba32f) uniform readonly imageBuffer posed;     // by point
layout(binding = 3, scalar) restrict readonly buffer Frame { FrameConstants frame; };
layout(binding = 4, rgba32f) uniform readonly imageBuffer segments;  // two texels a bone: its canonical ends
layout(binding = 5, scalar) restrict writeonly buffer Starts { vec4 starts[]; };  // by point
layout(push_constant, scalar) uniform Constants { BoneStartConstants constants; };

vec3 moved_back(vec3 q, int bone) {
  const vec4 x = frame.bones[3 * bone], y = frame.bones[3 * bone + 1], z = frame.bones[3 * bone + 2];
  const vec3 offset = q - vec3(x.w, y.w, z.w);
  const vec3 yz = cross(y.xyz, z.xyz), zx = cross(z.xyz, x.xyz), xy = cross(x.xyz, y.xyz);
  return (yz * offset.x + zx * offset.y + xy * offset.z) / dot(x.xyz, yz);
}

void main() {
  const uint row = gl_GlobalInvocationID.x;
  const bool exists = row < row_count(constants.row_limit);
  const int point = point_of_row(row);
  const vec3 q = imageLoad(posed, point).xyz;
  const int bones = int(frame.joint_count), rank = int(constants.rank);

  vec3 start = q;
  float last = -1.0;  // squared distance of the bone of the rank before …
  int last_bone = -1;  // … and its index
  for (int pass = 0; pass <= rank; ++pass) {
    float best = 1e38;
    int best_bone = -1;
    vec3 best_start = start;
    for (int bone = 0; bone < bones; ++bone) {
      const vec3 x = moved_back(q, bone);
      const vec3 from = imageLoad(segments, 2 * bone).xyz, along = imageLoad(segments, 2 * bone + 1).xyz - from;
      const float size = dot(along, along);
      const vec3 apart = x - from - (size > 0.0 ? clamp(dot(x - from, along) / size, 0.0, 1.0) : 0.0) * along;
      const float squared = dot(apart, apart);
      const bool after = squared > last || (squared == last && bone > last_bone);
      if (after && squared < best) {
        best = squared;
        best_bone = bone;
        best_start = x;
      }
    }
    // With fewer bones than ranks the last one's start stands.
    start = best_start;
    last = best_bone < 0 ? last : best;
    last_bone = best_bone < 0 ? last_bone : best_bone;
  }
  if (exists) starts[point] = vec4(start, 0.0);
}
