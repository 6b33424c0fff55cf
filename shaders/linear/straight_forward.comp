// Y = epilogue(X W + b) for CPU devices: straight-line code, one invocation a point, one workgroup 64 points, one launch a
// tile of TILE outputs. Reads K channels of X (texels), the packed weights of the tile (row 0 bias, then K rows of TILE
// floats, by address: uniform and outside control flow, so each weight is one broadcast operand). Writes TILE channels.
// Eight accumulators at a time fit the 16 vector registers of AVX2; the barriers cut the code into pieces of 512 products
// (9 KB), each of which runs for all points of the workgroup from the instruction cache (docs/decisions/linear-on-cpu.md).
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_buffer_reference : require
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require
#extension GL_EXT_control_flow_attributes : require

layout(local_size_x = 64) in;
layout(constant_id = 0) const int K = 64;     // multiple of 8
layout(constant_id = 1) const int TILE = 16;  // multiple of 8
// volatile: no weight is read twice, and looking for one that is takes the driver time with the square of their number.
layout(buffer_reference, std430, buffer_reference_align = 16) volatile readonly buffer Weights { vec4 w[]; };
#include "lib/epilogue.glsl"
#include "lib/linear_input.glsl"

const int CHUNK = K < 64 ? K : 64;  // channels of X held at a time
const int QUADS = TILE / 4;

void main() {
  Weights packed_weights = Weights(weights);
  const int point = int(gl_GlobalInvocationID.x);
  const int x_base = point * int(x_stride) + int(x_column);
  vec4 a[QUADS];
  [[unroll]] for (int q = 0; q < QUADS; ++q) a[q] = MODE == MODE_TANGENT ? vec4(0) : packed_weights.w[q];  // a tangent has no bias
  [[unroll]] for (int first = 0; first < K; first += CHUNK) {
    // all trip counts are constants, or the driver unrolls none of these loops; what lies beyond K folds away
    vec4 x[CHUNK / 4];
    [[unroll]] for (int k = 0; k < CHUNK / 4; k += 2)
      if (first + 4 * k < K) read_eight(x_base, first / 8 + k / 2, x[k], x[k + 1]);
    barrier();
    [[unroll]] for (int pair = 0; pair < QUADS; pair += 2) {
      vec4 low = a[pair], high = a[pair + 1];
      [[unroll]] for (int k = 0; k < CHUNK / 4; ++k) {
        if (first + 4 * k < K) {
          // A reference of its own for each four rows, and the four in a line: half the driver's time for a loop over one.
          Weights rows = Weights(weights + 16 * (QUADS + (first + 4 * k) * QUADS + pair));
          low += x[k].x * rows.w[0];
          high += x[k].x * rows.w[1];
          low += x[k].y * rows.w[QUADS];
          high += x[k].y * rows.w[QUADS + 1];
          low += x[k].z * rows.w[2 * QUADS];
          high += x[k].z * rows.w[2 * QUADS + 1];
          low += x[k].w * rows.w[3 * QUADS];
          high += x[k].w * rows.w[3 * QUADS + 1];
        }
      }
      a[pair] = low;
      a[pair + 1] = high;
      barrier();
    }
  }
  [[unroll]] for (int pair = 0; pair < QUADS; pair += 2) store_group(point, pair / 2, a[pair], a[pair + 1]);
}
