// Of the roots that searches from several starts found for a point, the one where the signed distance is least: parts of the
// body that meet in posed space are a union there, as in SNARF. One invocation serves one row, a root that was found: FIRST, it
// is the point's first and its distance is noted; else it replaces the point's root where that has none or lies farther out.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require

#define ROWS_CONSTANT 0
#include "lib/rows.glsl"
#include "shared/tracing.h"

layout(local_size_x = 64) in;
layout(constant_id = 2) const uint FIRST = 0u;
layout(binding = 2, rgba32f) uniform readonly imageBuffer sdf;    // by row, in channel 0
layout(binding = 3, rgba32f) uniform readonly imageBuffer found;  // by point
layout(binding = 4, scalar) restrict buffer Kept { vec4 kept[]; };            // by point; w > 0: has a root
layout(binding = 5, scalar) restrict buffer KeptSdf { float kept_sdf[]; };  // by point with a root
layout(push_constant, scalar) uniform Constants { KeepRootConstants constants; };

void main() {
  const uint row = gl_GlobalInvocationID.x;
  const bool exists = row < row_count(constants.row_limit);
  const int point = point_of_row(row);
  const float distance = imageLoad(sdf, int(row * constants.sdf_stride + constants.sdf_column)).x;
  const vec4 root = imageLoad(found, point);
  if (!exists) return;
  if (FIRST != 0u || kept[point].w <= 0.0 || distance < kept_sdf[point]) {
    if (FIRST == 0u) kept[point] = root;
    kept_sdf[point] = distance;
  }
}
