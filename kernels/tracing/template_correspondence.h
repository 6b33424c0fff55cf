// Correspondences where no skinning network is: a point follows its nearest posed vertex (Skinning::template_weights of
// the avatar), so that what starts a search elsewhere is the result here.
#pragma once

#include "kernels/tracing/nearest_vertex.h"

namespace arah {

struct AcceptStartsArgs {
  uint32_t points = 0;
  BufferSlice targets;    // vec4 by point: w > 0 where wanted
  BufferSlice starts;     // vec4 by point: of record_nearest_vertex; anything finite or not where not wanted
  BufferSlice canonical;  // out, vec4 by point: the start with w = 1; zeros where not wanted or not finite
};
void record_accept_starts(Commands& commands, const AcceptStartsArgs& args);

// The end of sphere tracing as the surface point of a ray, instead of a joint search.
struct AcceptTracedArgs {
  uint32_t rays = 0;
  float tolerance = 1e-3F;  // metres: |sdf| at the last evaluated point that still counts as on the surface
  BufferSlice trace;        // vec4 by ray: SphereTracing::trace
  BufferSlice ends;         // vec4 by ray: canonical point of the last evaluation
  BufferSlice canonical;    // out, vec4 by ray: the end with w = 1, or zeros
  BufferSlice depths;       // out, float by ray: metres; 0 without a hit
};
void record_accept_traced(Commands& commands, const AcceptTracedArgs& args);

struct VertexTransformsArgs {
  Rows rows;
  BufferSlice frame;       // FrameConstants
  BufferSlice nearest;     // uint32 by point: a vertex, also in the padding
  PosedVertices target;    // its joints and weights are read
  BufferSlice transforms;  // out, three vec4 by row: the rows of Σ_k w_k B_k / Σ_k w_k
};
void record_vertex_transforms(Commands& commands, const VertexTransformsArgs& args);

}  // namespace arah
