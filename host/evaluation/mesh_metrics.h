// How near two meshes are: the figures that papers state of reconstructed surfaces.
#pragma once

#include <glm/vec3.hpp>
#include <span>
#include <vector>

namespace arah {

struct MeshView {
  std::span<const glm::dvec3> vertices;  // metres
  std::span<const glm::uvec3> triangles;
};

// From the vertices of one mesh to the other.
struct DirectedMeshMetrics {
  std::vector<double> to_surface;  // [V] distance of each vertex to the nearest place on the other's triangles, metres
  double vertex_squared = 0;       // mean squared distance to the nearest vertex, m²
  double vertex_mean = 0;          // mean distance to the nearest vertex, m
  double surface_mean = 0, surface_squared = 0, surface_max = 0;  // of to_surface: m, m², m
  double normals = 0;              // mean n · n' with the nearest vertex's normal, -1..1
  double normals_unsigned = 0;     // mean |n · n'|: for meshes whose faces are not all turned outward
  double normals_apart = 0;        // mean |n - n'|, 0..2

  double share_within(double metres) const;  // of to_surface, 0..1
};

struct MeshMetrics {
  DirectedMeshMetrics to_truth, to_prediction;  // from the prediction's vertices, from the truth's

  // Chamfer distance: mean squared distances between nearest vertices, the mean of both directions (others state the sum), m².
  double chamfer() const { return (to_truth.vertex_squared + to_prediction.vertex_squared) / 2; }
  double normal_consistency() const { return (to_truth.normals + to_prediction.normals) / 2; }
  double normal_consistency_unsigned() const { return (to_truth.normals_unsigned + to_prediction.normals_unsigned) / 2; }
  // As ARAH's authors compute it: 1 - mean over the truth's vertices of |n - n'|, n' of the nearest predicted vertex; below 0 for
  // normals that are more than 60 degrees apart (ARAH.md section 8).
  double normal_consistency_of_the_paper() const { return 1 - to_prediction.normals_apart; }
  // Harmonic mean of the shares of both meshes' vertices that lie within `metres` of the other's surface, 0..1.
  double f_score(double metres) const;
};

// Normals of vertices are the normalised sums of their triangles' v01 x v02, longer for larger triangles. Of vertices at equal distances
// any may count as the nearest. The meshes may be open, and vertices without triangles count. Throws std::invalid_argument for a mesh without vertices or triangles, or indices
// out of range.
MeshMetrics mesh_metrics(const MeshView& prediction, const MeshView& truth);

}  // namespace arah
