// First pass of marching cubes: marks which corners of each cube lie inside, and counts the vertices and triangles of each block
// of cubes.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require

#include "lib/marked_cells.glsl"
#include "lib/scan.glsl"

layout(local_size_x = 64) in;
layout(binding = 1, rgba32f) uniform readonly imageBuffer nodes;  // w: the value
layout(binding = 2, scalar) restrict readonly buffer Corners { uint corners[]; };
layout(binding = 3, scalar) restrict writeonly buffer Marks { uint marks[]; };
layout(binding = 4, scalar) restrict writeonly buffer BlockCounts { MeshCount block_counts[]; };
layout(push_constant, scalar) uniform Constants { MeshingConstants constants; };

void main() {
  const uint first = gl_WorkGroupID.x * CELLS_A_BLOCK + gl_LocalInvocationIndex * CELLS_AN_INVOCATION;
  MeshCount sum = MeshCount(0u, 0u);
  for (uint i = 0u; i < CELLS_AN_INVOCATION; ++i) {
    const uint cell = first + i;
    if (cell >= constants.cells) break;
    uint mark = 0u;
    [[unroll]] for (uint corner = 0u; corner < 8u; ++corner) mark |= imageLoad(nodes, int(corners[8u * cell + corner])).w < 0.0 ? 1u << corner : 0u;
    const uint low = mark & 1u;
    mark |= (mark >> 1u & 1u) != low ? 1u << 8u : 0u;
    mark |= (mark >> 2u & 1u) != low ? 1u << 9u : 0u;
    mark |= (mark >> 4u & 1u) != low ? 1u << 10u : 0u;
    marks[cell] = mark;
    const MeshCount own = count_of(mark);
    sum.vertices += own.vertices;
    sum.triangles += own.triangles;
  }
  MeshCount total;
  exclusive_scan(sum.vertices, total.vertices);
  exclusive_scan(sum.triangles, total.triangles);
  if (gl_LocalInvocationIndex == 0u) block_counts[gl_WorkGroupID.x] = total;
}
