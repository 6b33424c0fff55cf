// The colour network's input rows from their parts, and the way back (ARAH.md section 3; kernels/reference/color.h).
#pragma once

#include <array>
#include <cstdint>
#include <optional>

#include "kernels/linear/matrix.h"
#include "kernels/vulkan/commands.h"

namespace arah {

// What a row holds, in this order: n(x) 3, view encoding 27, normal 3, SDF feature. Columns of a feature grid follow
// and are written by record_feature_grid_forward. A frame's latent code is no part of the rows: it is constant over a
// batch, and packing the weights folds it into the bias.
struct ColorRow {
  bool view = false;
  bool normal = false;
  uint32_t feature_channels = 0;
  bool canonical = false;  // the view direction is turned into the canonical pose's axes

  static constexpr uint32_t view_channels = 27;  // v and sines and cosines of 1, 2, 4, 8 times v
  uint32_t feature_column() const { return 3 + (view ? view_channels : 0) + (normal ? 3 : 0); }
  uint32_t grid_column() const { return feature_column() + feature_channels; }  // the first column after these parts
};

// n(x) = x · cube_scale + cube_offset; v = −direction of the sample's ray, world axes; with row.canonical T₃ₓ₃⁻¹ v, where
// |det T₃ₓ₃| > 1e-3 (of rotations blended until they all but cancel, T tells no direction, and v stays); the normal as it is.
// With view_rotation R the row gets the direction of R v where that lies less than 90° from the normal, so that the surface
// could be seen so, and of v elsewhere (ARAH.md section 7, augmentation).
struct AssembleInputsArgs {
  ColorRow row;
  uint32_t points = 0;           // rows; all of padded_points(points) are written
  uint32_t samples_per_ray = 1;  // sample s belongs to ray s / samples_per_ray
  BufferSlice frame;             // FrameConstants
  BufferSlice canonical;         // vec4 [padded points]: x in metres; w unused
  BufferSlice rays;              // Ray [padded rays]; read with row.view, else may be empty
  BufferSlice normals;           // vec4 [padded points]; read with row.normal or a view_rotation, else may be empty
  Matrix feature;                // [points][feature_channels]; empty where feature_channels is 0
  Matrix rows;                   // [points][channels]
  uint32_t channels = 0;  // of a row with its grid columns; columns from grid_column() to the padded width become 0
  BufferSlice samples = {};   // uint32 [padded points]: the sample that row p is of; empty: p
  uint32_t sample_count = 0;  // with `samples`: how many samples these are of
  BufferSlice transforms = {};  // three vec4 by row: of record_lbs; read with row.canonical and row.view, else may be empty
  std::optional<std::array<float, 9>> view_rotation = {};  // rows of a rotation; without row.view ignored
};
// Throws std::invalid_argument where `channels` is less than the parts need or a matrix is too narrow.
void record_assemble_inputs(Commands& commands, const AssembleInputsArgs& args);

// The gradients at the parts from those at the rows. All are assigned, none is added to.
struct AssembleInputsBackwardArgs {
  ColorRow row;
  uint32_t points = 0;
  Matrix d_rows;           // [points][channels]
  BufferSlice d_position;  // vec4 [padded points]: at n(x), per cube unit: the part that does not pass through the
                           // other inputs; w = 0
  BufferSlice d_normal;    // vec4 [padded points], w = 0; may be empty without row.normal
  Matrix d_feature;        // [points][feature_channels], padding columns 0; empty where feature_channels is 0
};
void record_assemble_inputs_backward(Commands& commands, const AssembleInputsBackwardArgs& args);

}  // namespace arah
