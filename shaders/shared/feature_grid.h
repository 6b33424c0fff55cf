// Levels of a dense feature grid over an axis-aligned box. Valid in C++ and GLSL, scalar layout.
#ifndef ARAH_SHARED_FEATURE_GRID_H
#define ARAH_SHARED_FEATURE_GRID_H
#ifdef __cplusplus
#include <cstdint>
namespace arah {
#define ARAH_UINT uint32_t
#define ARAH_FLOAT3(name) float name[3]
#else
#define ARAH_UINT uint
#define ARAH_FLOAT3(name) vec3 name
#endif

// Nodes along x, y, z, at least one each; a node has four features, one texel. The node (i, j, k) of a level is texel
// first_node + (k nodes_y + j) nodes_x + i.
struct FeatureGridLevel {
  ARAH_UINT nodes_x, nodes_y, nodes_z;
  ARAH_UINT first_node;
};

// The first and last node of each axis lie on the faces of the box.
struct FeatureGridBox {
  ARAH_FLOAT3(lower);
  ARAH_FLOAT3(inverse_size);  // 1 / (upper − lower)
};

#undef ARAH_UINT
#undef ARAH_FLOAT3
#ifdef __cplusplus
static_assert(sizeof(FeatureGridLevel) == 16);
static_assert(sizeof(FeatureGridBox) == 24);
}  // namespace arah
#endif
#endif
