// Signed distances to the posed template between the nodes of a shell grid (shared/shell_grid.h), trilinear.
// Includers bind `distances`, a readonly imageBuffer of four nodes a texel, before this file.
#ifndef ARAH_LIB_SHELL_DISTANCE_GLSL
#define ARAH_LIB_SHELL_DISTANCE_GLSL

// Distances of a node and of the next one along x. The latter lies in the next texel only where the former is the last of its own.
vec2 node_pair(uint node, int last_texel) {
  int texel = int(node >> 2u);
  vec4 here = imageLoad(distances, texel);
  float after = imageLoad(distances, min(texel + 1, last_texel)).x;
  uint place = node & 3u;
  vec2 low = place == 0u ? here.xy : here.yz;
  vec2 high = place == 2u ? here.zw : vec2(here.w, after);
  return place < 2u ? low : high;
}

// At a place in cells from the first node; metres. inside: whether it lies in the grid; else the nearest place of the grid
// answers.
float shell_distance(vec3 at, uvec3 nodes, out bool inside) {
  vec3 last = vec3(nodes - 1u);
  inside = all(greaterThanEqual(at, vec3(0.0))) && all(lessThanEqual(at, last));
  vec3 within = clamp(at, vec3(0.0), last);
  uvec3 corner = min(uvec3(within), nodes - 2u);
  vec3 part = within - vec3(corner);
  int last_texel = int((nodes.x * nodes.y * nodes.z - 1u) >> 2u);
  uint node = (corner.z * nodes.y + corner.y) * nodes.x + corner.x;
  uint above = node + nodes.x * nodes.y;
  vec4 low = vec4(node_pair(node, last_texel), node_pair(node + nodes.x, last_texel));
  vec4 high = vec4(node_pair(above, last_texel), node_pair(above + nodes.x, last_texel));
  vec4 level = mix(low, high, part.z);
  vec2 line = mix(level.xy, level.zw, part.y);
  return mix(line.x, line.y, part.x);
}

#endif
