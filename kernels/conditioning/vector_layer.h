// A linear layer for one vector, y = b + W x, and its transposes: what a network that sees one pose at a time consists of
// (reference::dense_change, hyper_trunk_forward). linear/ would pad the one vector to 64.
#pragma once

#include "kernels/vulkan/commands.h"
#include "shaders/shared/conditioning.h"

namespace arah {

// Matrices of the same size one below the other. Vectors are read as texels of four: their slices hold a multiple of four floats.
struct VectorLayer {
  uint32_t rows = 0, columns = 0;  // of one matrix
  uint32_t blocks = 1;             // matrices
  bool own_inputs = false;         // each matrix reads its own `columns` (a multiple of 4) of x; else all read the same
  const char* name = "vector layer";

  uint64_t numbers() const { return uint64_t(rows) * blocks * columns; }
  uint32_t input_floats() const { return own_inputs ? blocks * columns : columns; }
};

struct VectorLayerArgs {
  VectorLayer layer;
  BufferSlice weights;  // float [blocks][rows][columns]; may exceed what a device binds at once, with one block
  BufferSlice x;        // float [input_floats()] from first_x on
  BufferSlice bias;     // float [blocks][rows]
  BufferSlice y;        // out (=): float [blocks][rows]
  uint32_t first_x = 0; // a multiple of 4
};
// Throws std::invalid_argument where columns are no multiple of 4 and the inputs are the blocks' own.
void record_vector_layer(Commands& commands, const VectorLayerArgs& args);

// Floats of `partials` below.
uint64_t vector_layer_partials(const VectorLayer& layer);

struct VectorLayerInputGradientArgs {
  VectorLayer layer;
  BufferSlice weights;   // as above
  BufferSlice d_y;       // float [blocks][rows]
  BufferSlice partials;  // scratch: vector_layer_partials floats
  BufferSlice d_x;       // +=: float [input_floats()] from first_x on; of inputs that all blocks read, there is one block
                         // (std::invalid_argument)
  uint32_t first_x = 0;
};
void record_vector_layer_input_gradient(Commands& commands, const VectorLayerInputGradientArgs& args);

struct VectorLayerWeightGradientArgs {
  VectorLayer layer;
  BufferSlice d_y, x;    // as above
  BufferSlice d_weights; // +=: as `weights`, at most what a device binds at once
  BufferSlice d_bias;    // +=: as `bias`
};
void record_vector_layer_weight_gradient(Commands& commands, const VectorLayerWeightGradientArgs& args);

}  // namespace arah
