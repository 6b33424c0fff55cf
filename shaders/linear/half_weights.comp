// The forward packing of pack_weights → what cooperative_forward reads: the biases as float32, then K rows of all outputs as
// halves. One invocation owns 8 neighbouring outputs of a row of the packing (row 0: the biases).
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require

layout(local_size_x = 64) in;
layout(constant_id = 0) const uint TILE = 16;  // width of the packing's tiles
#include "lib/half.glsl"
layout(binding = 0, rgba32f) uniform readonly imageBuffer forward_pack;
layout(binding = 1, scalar) restrict writeonly buffer HalfWeights { uvec4 words[]; };
layout(push_constant, scalar) uniform Constants { uint inputs, outputs; };

void main() {
  const uint groups = outputs / 8u;
  const uint row = gl_GlobalInvocationID.x / groups, group = gl_GlobalInvocationID.x % groups;
  if (row > inputs) return;
  const uint first = 8u * group;
  const int texel = int((first / TILE * (inputs + 1u) * TILE + row * TILE + first % TILE) / 4u);
  const vec4 low = imageLoad(forward_pack, texel), high = imageLoad(forward_pack, texel + 1);
  if (row == 0u) {
    words[2u * group] = floatBitsToUint(low);
    words[2u * group + 1u] = floatBitsToUint(high);
  } else {
    words[(row + 1u) * groups + group] = pack_halves(low, high);
  }
}
