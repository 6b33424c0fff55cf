// Second pass of marching cubes: each cube's first vertex and triangle, in the order of the cubes; the last block writes how many there
// are in all.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require

#include "lib/marked_cells.glsl"
#include "lib/scan.glsl"

layout(local_size_x = 64) in;
layout(binding = 1, scalar) restrict readonly buffer Marks { uint marks[]; };
layout(binding = 2, scalar) restrict readonly buffer BlockCounts { MeshCount block_counts[]; };
layout(binding = 3, scalar) restrict writeonly buffer Places { MeshCount places[]; };
layout(binding = 4, scalar) restrict writeonly buffer Total { MeshCount total; };
layout(push_constant, scalar) uniform Constants { MeshingConstants constants; };

void main() {
  const uint block = gl_WorkGroupID.x, lane = gl_LocalInvocationIndex;
  const uint first = block * CELLS_A_BLOCK + lane * CELLS_AN_INVOCATION, end = min(first + CELLS_AN_INVOCATION, constants.cells);
  MeshCount counted = MeshCount(0u, 0u), own = MeshCount(0u, 0u), before, sum;
  for (uint i = lane; i < block; i += 64u) {
    counted.vertices += block_counts[i].vertices;
    counted.triangles += block_counts[i].triangles;
  }
  for (uint cell = first; cell < end; ++cell) {
    const MeshCount count = count_of(marks[cell]);
    own.vertices += count.vertices;
    own.triangles += count.triangles;
  }
  exclusive_scan(counted.vertices, before.vertices);
  exclusive_scan(counted.triangles, before.triangles);
  MeshCount at = MeshCount(before.vertices + exclusive_scan(own.vertices, sum.vertices), before.triangles + exclusive_scan(own.triangles, sum.triangles));
  for (uint cell = first; cell < end; ++cell) {
    places[cell] = at;
    const MeshCount count = count_of(marks[cell]);
    at.vertices += count.vertices;
    at.triangles += count.triangles;
  }
  if (block == gl_NumWorkGroups.x - 1u && lane == 0u) total = MeshCount(before.vertices + sum.vertices, before.triangles + sum.triangles);
}
