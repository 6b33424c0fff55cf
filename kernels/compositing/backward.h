// The way back through alpha compositing (reference::composite_backward). Depths and δ are constants.
#pragma once

#include "kernels/compositing/samples.h"
#include "kernels/vulkan/commands.h"

namespace arah {

struct CompositeBackwardArgs {
  CompositeSamples samples;    // as in the forward run, after it
  BufferSlice transmittances;  // [rows] float of the forward run
  BufferSlice colors;          // [rays] vec4 of the forward run
  BufferSlice d_colors;        // [rays] vec4: dL/d(rgb, Σ w)
  // out (=): dL/d(sdf network's value) in the first column, 0 in the other written columns and in padding rows; 0 for
  // skipped samples. Stride, column and d_sdf_columns are multiples of 4. By row, or by slot where samples.slots is given:
  // then padding rows stay as they are, and so does, by no_slot, what the samples that are not shaded would have got.
  Matrix d_sdf;
  uint32_t d_sdf_columns = channel_padding;  // written, from d_sdf.column on
  Matrix d_rgb;                              // out (=): dL/drgb in 3 columns; otherwise as d_sdf
  uint32_t d_rgb_columns = channel_padding;
  BufferSlice gradients;  // float, parallel to samples.parameters: dL/dparameter of b is added (+=) at scale_index
  BufferSlice partials;   // scratch: partial_bytes(rays) (kernels/reduction/sum.h)
};

// Two launches: the walk and the sum over rays, in a fixed order.
void record_composite_backward(Commands& commands, const CompositeBackwardArgs& args);

}  // namespace arah
