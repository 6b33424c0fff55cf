// The eight nodes around a point and their trilinear weights (kernels/reference/feature_grid.h is the truth).
#ifndef ARAH_LIB_FEATURE_GRID_GLSL
#define ARAH_LIB_FEATURE_GRID_GLSL

#include "shared/feature_grid.h"

struct GridCell {
  ivec3 low;   // node below the point; the one above is low + step
  ivec3 step;  // 0 along an axis with a single node
  vec3 t;      // weight of the node above; NaN where the point is NaN
  vec3 slope;  // dt/dx; 0 along an axis on which the point lies outside the box
};

GridCell grid_cell(FeatureGridBox box, FeatureGridLevel level, vec3 x) {
  const ivec3 nodes = ivec3(level.nodes_x, level.nodes_y, level.nodes_z);
  const vec3 cells = vec3(nodes - 1);
  const vec3 share = (x - box.lower) * box.inverse_size;
  // min and max may hide a NaN; it is put back below, so that it cannot pass for a value
  const vec3 position = min(max(share, vec3(0)), vec3(1)) * cells;
  GridCell cell;
  cell.step = min(nodes - 1, ivec3(1));
  cell.low = clamp(ivec3(position), ivec3(0), max(nodes - 2, ivec3(0)));
  cell.t = mix(position - vec3(cell.low), x, isnan(x));
  const bvec3 inside = bvec3(uvec3(greaterThanEqual(share, vec3(0))) * uvec3(lessThanEqual(share, vec3(1))));
  cell.slope = mix(vec3(0), cells * box.inverse_size, inside);
  return cell;
}

// Corner 0 to 7: bit 0 is x, bit 1 y, bit 2 z; a set bit takes the node above.
ivec3 corner_bits(int corner) { return ivec3(corner & 1, corner >> 1 & 1, corner >> 2 & 1); }

int corner_node(FeatureGridLevel level, GridCell cell, int corner) {
  const ivec3 node = cell.low + cell.step * corner_bits(corner);
  return int(level.first_node) + (node.z * int(level.nodes_y) + node.y) * int(level.nodes_x) + node.x;
}

vec3 corner_weights(GridCell cell, int corner) { return mix(1.0 - cell.t, cell.t, bvec3(corner_bits(corner))); }

#endif
