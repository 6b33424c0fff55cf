// Signed distance to the posed template at the nodes of a grid around it.
#pragma once

#include "kernels/rays/shell_nodes.h"

namespace arah {

struct ShellDistanceArgs {
  ShellGrid grid;         // posed space, metres
  uint32_t vertices = 0;  // of the template
  BufferSlice nearest;    // [nodes] uint32: index of the vertex nearest to each node
  BufferSlice positions;  // [vertices] vec4: posed vertices without the root translation, metres; w is not read
  BufferSlice normals;    // [vertices] vec4: outward normals, of any positive length; w is not read
  // out: [padded_points(nodes)] float, metres: |p − v| of the nearest vertex v, negative where (p − v)·n_v < 0
  BufferSlice distances;
};

void record_shell_distance(Commands& commands, const ShellDistanceArgs& args);

}  // namespace arah
