// Signed distances of a queue back to the rows of their samples: one invocation serves one slot.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require

layout(local_size_x = 64) in;
layout(binding = 0, scalar) restrict readonly buffer Samples { uint samples[]; };
layout(binding = 1, rgba32f) uniform readonly imageBuffer sdf;  // by slot, in x
layout(binding = 2, scalar) restrict writeonly buffer Distances { vec4 distances[]; };  // by row, in x
layout(push_constant, scalar) uniform Constants {
  uint count;
  uint sdf_stride, sdf_column;  // texels
};

void main() {
  const uint slot = gl_GlobalInvocationID.x;
  const float value = imageLoad(sdf, int(slot * sdf_stride + sdf_column)).x;
  if (slot < count) distances[samples[slot]] = vec4(value, 0.0, 0.0, 0.0);
}
