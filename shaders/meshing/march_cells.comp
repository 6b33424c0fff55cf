// Third pass of marching cubes: one invocation writes the vertices on its cube's own edges and its triangles
// (reference::marching_cubes). An edge's vertex is that of the cube whose corner 0 it begins at.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require

#include "lib/marked_cells.glsl"

layout(constant_id = 0) const float LEAST_EDGE_PART = 0.0;

layout(local_size_x = 64) in;
layout(binding = 1, rgba32f) uniform readonly imageBuffer nodes;
layout(binding = 2, scalar) restrict readonly buffer Corners { uint corners[]; };
layout(binding = 3, scalar) restrict readonly buffer CellOfNode { uint cell_of_node[]; };
layout(binding = 4, scalar) restrict readonly buffer Marks { uint marks[]; };
layout(binding = 5, scalar) restrict readonly buffer Places { MeshCount places[]; };
layout(binding = 6, scalar) restrict writeonly buffer Vertices { vec4 vertices[]; };
layout(binding = 7, scalar) restrict writeonly buffer Triangles { uint triangle_corners[]; };
layout(push_constant, scalar) uniform Constants { MeshingConstants constants; };

const uint NONE = 0xffffffffu;

// The corner where an edge of a cube begins (cube_cases.h).
uint edge_corner(uint edge) {
  const uint k = edge % 4u;
  return edge < 4u ? 2u * k : edge < 8u ? k & 1u | (k & 2u) << 1u : k;
}

uint vertex_on(uint cell, uint edge) {
  const uint owner = cell_of_node[corners[8u * cell + edge_corner(edge)]];
  if (owner >= constants.cells) return NONE;
  const uint mark = marks[owner] >> 8u, axis = edge / 4u;
  return (mark >> axis & 1u) == 0u ? NONE : places[owner].vertices + uint(bitCount(mark & (1u << axis) - 1u));
}

void main() {
  const uint cell = gl_GlobalInvocationID.x;
  if (cell >= constants.cells) return;
  const uint mark = marks[cell];
  const MeshCount place = places[cell];
  const vec4 low = imageLoad(nodes, int(corners[8u * cell]));
  uint vertex = place.vertices;
  for (uint axis = 0u; axis < 3u; ++axis) {
    if ((mark >> 8u + axis & 1u) == 0u) continue;
    const vec4 high = imageLoad(nodes, int(corners[8u * cell + (1u << axis)]));
    const float t = clamp(low.w / (low.w - high.w), LEAST_EDGE_PART, 1.0 - LEAST_EDGE_PART);
    vertices[vertex++] = vec4(low.xyz + t * (high.xyz - low.xyz), 1.0);
  }
  const uint inside = mark & 255u, count = case_byte(inside, 0u);
  for (uint i = 0u; i < 3u * count; ++i) triangle_corners[3u * place.triangles + i] = vertex_on(cell, case_byte(inside, 1u + i));
}
