// Rays against the body's box, the nearest template vertex, and sphere tracing through it (ARAH.md section 4).
// Metres throughout; directions are unit vectors; depths are along the direction from the camera centre.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "kernels/reference/small_matrix.h"

namespace arah::reference {

struct RayInterval {
  double near = 0, far = 0;  // metres, 0 <= near < far where hit
  bool hit = false;
};

// Slab test of the ray origin + d·direction, d >= 0, with the box [minimum, maximum]. Direction components below 1e-12
// in size count as ±1e-12 (a zero counts as +1e-12; the paper's code has 1e-5, see shaders/rays/generate.comp), so that a ray
// parallel to a face has finite depths. An origin inside
// the box has near = 0. No hit: the box is behind, missed, touched in a point, flat along the ray, or an input is not
// finite.
RayInterval intersect_box(const Vector<3>& origin, const Vector<3>& direction, const Vector<3>& minimum,
                          const Vector<3>& maximum);

// Index of the vertex nearest to the point (Euclidean); of several equally near ones the lowest index. Every vertex is
// compared: the truth for any accelerated search. `vertices` must not be empty; a point that is not finite gets index
// 0.
std::size_t nearest_vertex(const Vector<3>& point, std::span<const Vector<3>> vertices);

// A posed template: the data of the approximate backward mapping.
struct PosedTemplate {
  std::span<const Vector<3>> vertices;         // posed, without the global translation
  std::span<const double> skinning_weights;    // [vertices][bones]
  std::span<const Matrix<4>> bone_transforms;  // canonical to posed, without the global translation
};

struct Correspondence {
  Vector<3> canonical;     // NaN where the blended transform has no inverse
  Matrix<4> transform;     // T = Σ_b w_b B_b
  std::size_t vertex = 0;  // the nearest one
};

// x̂ = T⁻¹ x̄ with the skinning weights of the nearest posed vertex. `posed` is without the global translation.
Correspondence template_correspondence(const Vector<3>& posed, const PosedTemplate& posed_template);

// x̂ = B_j⁻¹ x̄ of the bone j that is the rank-th nearest (from 0) to the posed point, where B_j⁻¹ x̄ lies nearest to the bone's
// segment in canonical space; of equally near ones the lower index comes first. NaN where no bone has that rank.
struct BoneSegment {
  Vector<3> from{}, to{};  // canonical, metres
};
Vector<3> bone_start(const Vector<3>& posed, std::span<const Matrix<4>> bone_transforms, std::span<const BoneSegment> segments, std::size_t rank);

// Canonical correspondences of a box of posed nodes: node (x, y, z) lies at origin + cell (x, y, z) and is number
// (z nodes[1] + y) nodes[0] + x.
struct CorrespondenceNodes {
  Vector<3> origin{};
  double cell = 0;  // metres
  std::array<std::size_t, 3> nodes{};
  std::span<const Vector<3>> canonical;
  std::span<const std::uint8_t> found;  // 0: the node has none
  double longest = 0;  // metres between the canonical points of neighbouring nodes, at most
};

// Trilinear between the eight nodes around the point; nothing outside the box, where a node has no correspondence, or where
// the canonical points of two neighbouring ones of the eight are farther apart than `longest`: there the nodes belong to
// different parts of the body, and nothing lies between them.
std::optional<Vector<3>> interpolate_correspondence(const Vector<3>& posed, const CorrespondenceNodes& nodes);

// A box of nodes with a number each: node (x, y, z) lies at origin + cell · (x, y, z) and is number
// (z · nodes[1] + y) · nodes[0] + x.
struct ValueNodes {
  Vector<3> origin{};
  double cell = 1;
  std::array<std::size_t, 3> nodes{};  // at least 2 each
  std::vector<double> values;
};

// Trilinear between the nodes; outside the box the nearest place of it answers.
double interpolate_value(const Vector<3>& at, const ValueNodes& nodes);

struct TracingSettings {
  int max_iterations = 50;
  double max_step = 0.1;    // metres, in both directions
  double tolerance = 1e-5;  // metres
};

struct TracedRay {
  double depth = 0;         // after the last step
  double sdf = 0;           // metres, at `canonical`
  Vector<3> canonical{};    // of the last evaluated point: the start of the joint search
  Matrix<4> transform{};    // likewise
  int evaluations = 0;      // of the sdf
  bool on_surface = false;  // |sdf| <= tolerance
  bool diverged = false;    // depth >= far, or a value that is not finite
};

// Sphere tracing from the near side. Each of at most max_iterations steps maps origin + depth·direction to canonical
// space with `correspondence` (Vector<3> posed -> Correspondence), evaluates `sdf` (Vector<3> canonical -> metres)
// and, where |sdf| > tolerance, advances by the sdf clamped to ±max_step; steps back are allowed. A ray that neither
// reached the surface nor diverged ran out of iterations and is still a start for the joint search.
// `origin` is the camera centre minus the global translation.
template <class CorrespondenceOf, class Sdf>
TracedRay trace_sphere(const Vector<3>& origin, const Vector<3>& direction, double near, double far,
                       CorrespondenceOf&& correspondence, Sdf&& sdf, const TracingSettings& settings = {}) {
  TracedRay ray;
  ray.depth = near;
  while (ray.evaluations < settings.max_iterations && !ray.on_surface && !ray.diverged) {
    Vector<3> posed;
    for (int i = 0; i < 3; ++i) posed[i] = origin[i] + ray.depth * direction[i];
    const Correspondence found = correspondence(posed);
    ray.canonical = found.canonical;
    ray.transform = found.transform;
    ray.sdf = sdf(found.canonical);
    ++ray.evaluations;
    ray.on_surface = std::abs(ray.sdf) <= settings.tolerance;
    if (!ray.on_surface) ray.depth += std::clamp(ray.sdf, -settings.max_step, settings.max_step);
    ray.diverged = !(ray.depth < far);  // also where the depth is NaN
  }
  return ray;
}

}  // namespace arah::reference
