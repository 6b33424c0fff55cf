// The cubes that a zero set crosses, at any resolution: asked for from coarse to fine around it, never over the whole box.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <glm/vec3.hpp>
#include <span>
#include <vector>

#include "host/capture/implicit_surface.h"

namespace arah {

// What the kernels march over (kernels/meshing/marching_cubes.h).
struct SurfaceCells {
  std::vector<std::array<float, 4>> nodes;       // position, metres, and signed distance to the level, metres
  std::vector<std::array<uint32_t, 8>> corners;  // of each cube its nodes (cube_cases.h)
  double cell = 0;                               // metres, the cubes' edge
  uint64_t evaluated = 0;                        // points that `distances` was asked for

  std::vector<uint32_t> cell_of_node() const;  // by node the cube whose corner 0 it is, or no_cell
};

// Signed distances of points, metres.
using DistancesAt = std::function<std::vector<double>(std::span<const glm::dvec3>)>;

// rough: the field at nodes that are good where it is near the level. Its cubes are halved so many times wherever they may reach the
// level; nodes in between are asked for. Cubes beside a face that the surface crosses are added until there are none: the set is
// closed, whatever the first guess missed, and so is the mesh. The box's own faces count as outside, and where the rough field says
// that the level is more than two of its cells away its values stand. Throws std::runtime_error for a distance that is not finite.
SurfaceCells surface_cells(const FieldSamples<float>& rough, int halvings, double level, const DistancesAt& distances);

}  // namespace arah
