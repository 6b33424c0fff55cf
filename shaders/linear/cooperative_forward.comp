// Y = epilogue(X W + b) where X and W are halves, on the device's matrix units; sums are float32. A workgroup owns 64 points and
// all outputs; its subgroups, however large, take the columns of 16 outputs in turns: four sums of 16 × 16 share each 16 × 16
// weights that are read. Reads rows of halves and the weights of half_weights (biases as float32, then K rows of halves). The
// sums pass through shared memory to the epilogue, where an invocation owns 8 outputs of a point.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require
#extension GL_EXT_shader_explicit_arithmetic_types_float16 : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_KHR_memory_scope_semantics : require
#extension GL_KHR_shader_subgroup_basic : require
#ifdef ARAH_KHR_COOPERATIVE_MATRIX
#extension GL_KHR_cooperative_matrix : require
#else
#extension GL_NV_cooperative_matrix : require
#endif
#pragma use_vulkan_memory_model

layout(local_size_x = 128) in;
layout(constant_id = 0) const int K = 64;  // multiple of 16, as the outputs are
layout(binding = 0, scalar) restrict readonly buffer Points { uvec4 x_words[]; };        // 8 halves each
layout(binding = 7, scalar) restrict readonly buffer HalfWeights { uvec4 w_words[]; };  // 4 biases each, then 8 halves each
#include "lib/cooperative_matrix.glsl"
#include "lib/epilogue.glsl"

const int SIDE = 16;
const int BLOCKS = 4;                    // of 16 points
const int MOST_SUBGROUPS = 16;           // of at least 8 invocations
shared float sums[MOST_SUBGROUPS * SIDE * SIDE];  // one block a subgroup

void main() {
  const int first_point = int(gl_WorkGroupID.x) * SIDE * BLOCKS;
  const int columns = int(outputs) / SIDE;
  const uint x_base = uint(first_point) * x_stride + x_column;
  const uint bias_words = outputs / 4u, row_words = outputs / 8u;
  const uint own_sums = gl_SubgroupID * uint(SIDE * SIDE);
  for (int column = int(gl_SubgroupID); column < columns; column += int(gl_NumSubgroups)) {
    SumMatrix block[BLOCKS];
    [[unroll]] for (int b = 0; b < BLOCKS; ++b) block[b] = SumMatrix(0.0);
    for (int k = 0; k < K; k += SIDE) {
      RightMatrix w;
      LOAD_MATRIX(w, w_words, bias_words + uint(k) * row_words + uint(column) * 2u, row_words);
      [[unroll]] for (int b = 0; b < BLOCKS; ++b) {
        LeftMatrix x;
        LOAD_MATRIX(x, x_words, x_base + uint(b * SIDE) * x_stride + uint(k / 8), x_stride);
        block[b] = MULTIPLY_ADD(x, w, block[b]);
      }
    }
    [[unroll]] for (int b = 0; b < BLOCKS; ++b) {
      STORE_MATRIX(block[b], sums, own_sums, uint(SIDE));
      subgroupBarrier();
      for (int item = int(gl_SubgroupInvocationID); item < 2 * SIDE; item += int(gl_SubgroupSize)) {
        const int row = item / 2, group = 2 * column + item % 2;  // of 8 outputs
        const int at = int(own_sums) + row * SIDE + item % 2 * 8;
        const vec4 low = vec4(sums[at], sums[at + 1], sums[at + 2], sums[at + 3]), high = vec4(sums[at + 4], sums[at + 5], sums[at + 6], sums[at + 7]);
        const vec4 bias_low = uintBitsToFloat(w_words[2 * group]), bias_high = uintBitsToFloat(w_words[2 * group + 1]);
        store_group(first_point + b * SIDE + row, group, low + bias_low, high + bias_high);
      }
      subgroupBarrier();
    }
  }
}
