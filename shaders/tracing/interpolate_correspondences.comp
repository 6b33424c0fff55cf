// Correspondences between the nodes of a grid that has them (kernels/reference/tracing.h, interpolate_correspondence). One
// invocation serves one point: trilinear between the eight nodes around it, w = 1; zeros where the grid cannot tell (outside,
// a node without a correspondence, neighbours that belong to different parts of the body) and for points that are not wanted.
// Flags the wanted points that the grid cannot tell.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require

#include "shared/tracing.h"

layout(local_size_x = 64) in;
layout(binding = 0, rgba32f) uniform readonly imageBuffer targets;  // w > 0: wanted
layout(binding = 1, scalar) restrict readonly buffer Slots { uint slots[]; };  // by node: the place of its correspondence
layout(binding = 2, rgba32f) uniform readonly imageBuffer canonical;           // by slot; w > 0: found. Slot 0: none
layout(binding = 3, scalar) restrict writeonly buffer Interpolated { vec4 interpolated[]; };
layout(binding = 4, scalar) restrict writeonly buffer Flags { uint flags[]; };
layout(push_constant, scalar) uniform Constants { InterpolateConstants constants; };

void main() {
  const uint point = gl_GlobalInvocationID.x;
  const bool exists = point < constants.points;
  const vec4 target = imageLoad(targets, int(min(point, constants.points - 1u)));
  const bool wanted = exists && target.w > 0.0;
  const vec3 at = (target.xyz - constants.origin) / constants.cell;
  const uvec3 nodes = constants.nodes;
  const vec3 last = vec3(nodes - 1u);
  bool valid = wanted && all(greaterThanEqual(at, vec3(0))) && all(lessThanEqual(at, last));
  const uvec3 corner = min(uvec3(valid ? at : vec3(0)), nodes - 2u);
  const vec3 part = at - vec3(corner);
  const uint first = (corner.z * nodes.y + corner.y) * nodes.x + corner.x;
  vec3 around[8];  // number: x + 2 y + 4 z
  [[unroll]] for (uint i = 0u; i < 8u; ++i) {
    const uint node = first + (i & 1u) + (i >> 1 & 1u) * nodes.x + (i >> 2) * nodes.x * nodes.y;
    const vec4 found = imageLoad(canonical, int(slots[node]));
    valid = valid && found.w > 0.0;
    around[i] = found.xyz;
  }
  const float longest_squared = constants.longest * constants.longest;
  [[unroll]] for (uint axis = 1u; axis < 8u; axis <<= 1) {
    [[unroll]] for (uint i = 0u; i < 8u; ++i) {
      if ((i & axis) == 0u) {
        const vec3 edge = around[i + axis] - around[i];
        valid = valid && dot(edge, edge) <= longest_squared;
      }
    }
  }
  vec3 line[4];
  [[unroll]] for (uint i = 0u; i < 4u; ++i) line[i] = mix(around[2u * i], around[2u * i + 1u], part.x);
  const vec3 result = mix(mix(line[0], line[1], part.y), mix(line[2], line[3], part.y), part.z);
  interpolated[point] = valid ? vec4(result, 1.0) : vec4(0);
  flags[point] = wanted && !valid ? 1u : 0u;
}
