// total[i] = (ACCUMULATE ? total[i] : 0) + Σ_split partial[split][i], in order of splits. One invocation adds one vec4.
#version 460
#extension GL_EXT_scalar_block_layout : require

layout(local_size_x = 64) in;
layout(constant_id = 0) const int ACCUMULATE = 0;
layout(binding = 0, rgba32f) uniform readonly imageBuffer partial_sums;
layout(binding = 1, scalar) restrict buffer Total { vec4 total[]; };
layout(push_constant) uniform Constants {
  uint texels;          // to add up
  uint splits;
  uint split_stride;    // texels from one split to the next
};

void main() {
  const uint i = gl_GlobalInvocationID.x;
  const uint own = min(i, texels - 1);  // the last workgroup reads no further than the buffer
  vec4 sum = vec4(0);
  for (uint split = 0; split < splits; ++split) sum += imageLoad(partial_sums, int(split * split_stride + own));
  if (i < texels) total[i] = ACCUMULATE != 0 ? total[i] + sum : sum;
}
