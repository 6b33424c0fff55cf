// Adds the fixed-point sums of feature_grid_backward to the parameter gradient and clears them for the next step:
// gradient[node] += sums[node] / scale. One invocation owns one node.
#version 460
#extension GL_EXT_scalar_block_layout : require

layout(local_size_x = 64) in;
layout(binding = 0, scalar) restrict buffer Sums { ivec4 sums[]; };
layout(binding = 1, scalar) restrict buffer Gradient { vec4 gradient[]; };
layout(push_constant, scalar) uniform Constants {
  uint nodes;
  float inverse_scale;
};

void main() {
  const uint group = gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x;
  const uint node = group * gl_WorkGroupSize.x + gl_LocalInvocationID.x;
  if (node < nodes) {
    gradient[node] += vec4(sums[node]) * inverse_scale;
    sums[node] = ivec4(0);
  }
}
