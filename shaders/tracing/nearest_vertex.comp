// The nearest posed template vertex of each point, exactly, and the start of the correspondence search that it gives:
// x = T^-1 q with T = sum_k w_k B_k over the vertex's four influences (ARAH.md section 4). One invocation serves one row.
// The vertices lie sorted by the cells of a uniform grid. The cell of the point (the closest one for a point outside) names
// a vertex nearby; only cells that the sphere through it touches can hold a nearer one, and these are read in runs along x,
// in which the vertices are neighbours. The sphere shrinks as nearer vertices are found. Of equally near vertices the one
// with the lowest index is taken, and index 0 for a point that is not finite.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require

#define ROWS_CONSTANT 0
#include "lib/finite.glsl"
#include "lib/rows.glsl"
#include "shared/frame.h"
#include "shared/tracing.h"

layout(local_size_x = 64) in;
layout(binding = 2, rgba32f) uniform readonly imageBuffer posed;
layout(binding = 3, scalar) restrict readonly buffer Frame { FrameConstants frame; };
layout(binding = 4, scalar) restrict readonly buffer CellStart { uint cell_start[]; };  // cells + 1
layout(binding = 5, scalar) restrict readonly buffer CellSeed { uint cell_seed[]; };    // a sorted vertex near each cell
layout(binding = 6, rgba32f) uniform readonly imageBuffer vertices;           // sorted by cell; w: the vertex's index
layout(binding = 7, scalar) restrict readonly buffer Joints { uint joints[]; };  // by vertex index, four of 8 bits
layout(binding = 8, rgba32f) uniform readonly imageBuffer weights;
layout(binding = 9, scalar) restrict writeonly buffer Canonical { vec4 canonical[]; };
layout(binding = 10, scalar) restrict writeonly buffer Nearest { uint nearest[]; };
layout(push_constant, scalar) uniform Constants { NearestVertexConstants constants; };

vec3 q;
float best_squared;
vec4 best;  // w: its index

void consider(int slot) {
  const vec4 vertex = imageLoad(vertices, slot);
  const vec3 difference = vertex.xyz - q;
  const float squared = dot(difference, difference);
  if (squared < best_squared || (squared == best_squared && vertex.w < best.w)) {
    best_squared = squared;
    best = vertex;
  }
}

// The cell that holds p, or the closest one. Clamped before the conversion, which is undefined for large values.
ivec3 cell_of(vec3 p, vec3 origin, float per_cell, ivec3 last) {
  return clamp(ivec3(clamp((p - origin) * per_cell, vec3(0), vec3(last))), ivec3(0), last);
}

void main() {
  const uint row = gl_GlobalInvocationID.x;
  const bool exists = row < row_count(constants.row_limit);
  const int point = point_of_row(row);
  const vec3 origin = constants.origin;
  const float size = constants.cell_size, per_cell = 1.0 / size;
  const ivec3 cells = ivec3(constants.cells), last = cells - 1;

  q = imageLoad(posed, point).xyz;
  const ivec3 home = cell_of(q, origin, per_cell, last);
  best = imageLoad(vertices, int(cell_seed[(home.z * cells.y + home.y) * cells.x + home.x]));
  const vec3 to_seed = best.xyz - q;
  best_squared = dot(to_seed, to_seed);

  // For the rounding of places in the grid and of the distances of far-away points.
  const float margin = 1e-4 * size + 1e-6 * sqrt(best_squared);
  const float reach = sqrt(best_squared) + margin;
  const ivec3 low = cell_of(q - reach, origin, per_cell, last), high = cell_of(q + reach, origin, per_cell, last);
  const int width = high.y - low.y + 1;
  const int runs = exists ? width * (high.z - low.z + 1) : 0;
  for (int run = 0; run < runs; ++run) {
    const int z = low.z + run / width, y = low.y + run % width;
    const vec2 floor_yz = origin.yz + size * vec2(y, z);
    const vec2 apart = max(max(floor_yz - q.yz, q.yz - (floor_yz + size)) - margin, vec2(0));
    const float rest = best_squared * (1.0 + 2e-6) - dot(apart, apart);
    if (rest >= 0.0) {
      const float half_width = sqrt(rest) + margin;
      const int base = (z * cells.y + y) * cells.x;
      const int x0 = cell_of(q - half_width, origin, per_cell, last).x, x1 = cell_of(q + half_width, origin, per_cell, last).x;
      const int end = int(cell_start[base + x1 + 1]);
      for (int slot = int(cell_start[base + x0]); slot < end; ++slot) consider(slot);
    }
  }

  const int vertex = is_finite(q) ? int(best.w) : 0;
  const uint vertex_joints = joints[vertex];
  const vec4 vertex_weights = imageLoad(weights, vertex);
  vec4 x = vec4(0), y = vec4(0), z = vec4(0);  // the rows of T
  float w = 0.0;                               // and its corner: weights may sum to 1 only nearly
  [[unroll]] for (int k = 0; k < 4; ++k) {
    const int joint = int(vertex_joints >> (8 * k) & 255u);
    x += vertex_weights[k] * frame.bones[3 * joint];
    y += vertex_weights[k] * frame.bones[3 * joint + 1];
    z += vertex_weights[k] * frame.bones[3 * joint + 2];
    w += vertex_weights[k];
  }
  const vec3 offset = q - vec3(x.w, y.w, z.w) / w;
  const vec3 yz = cross(y.xyz, z.xyz), zx = cross(z.xyz, x.xyz), xy = cross(x.xyz, y.xyz);
  const vec3 start = (yz * offset.x + zx * offset.y + xy * offset.z) / dot(x.xyz, yz);
  if (exists) {
    canonical[point] = vec4(start, sqrt(best_squared));
    nearest[point] = uint(vertex);
  }
}
