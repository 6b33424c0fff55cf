// Arithmetic alone: one invocation runs twelve independent chains a ← a · factor + term, eight links a round, in registers,
// and writes the sum of their ends. Twelve chains hide the latency of a multiply-add and still fit the 16 registers of a
// CPU's vector unit; eight links a round hide the loop (docs/decisions/device-peak.md). Chain k of an invocation begins at
// k + its place in the workgroup.
#version 450
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require

layout(local_size_x = 64) in;
layout(binding = 0, scalar) restrict writeonly buffer Sums { float sums[]; };  // by invocation
layout(push_constant, scalar) uniform Constants {
  float factor, term;
  uint rounds;
};

void main() {
  vec4 a = vec4(0, 1, 2, 3) + float(gl_LocalInvocationIndex), b = a + 4.0, c = a + 8.0;
  const vec4 f = vec4(factor), t = vec4(term);
#define LINK a = fma(a, f, t), b = fma(b, f, t), c = fma(c, f, t)
  for (uint i = 0u; i < rounds; ++i) {
    LINK; LINK; LINK; LINK; LINK; LINK; LINK; LINK;
  }
  sums[gl_GlobalInvocationID.x] = dot(a + b + c, vec4(1));
}
