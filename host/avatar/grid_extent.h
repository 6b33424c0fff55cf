// Where the colour's feature grid lies in canonical space, and how many nodes it has.
#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
#include <span>
#include <vector>

#include "host/avatar/avatar_spec.h"

namespace arah {

// All levels fill one axis-aligned box, in canonical metres. The first and last node of each axis lie on the box's
// faces; a level of n nodes has cells of (upper − lower) / (n − 1). No levels: the avatar has no grid.
struct GridExtent {
  glm::vec3 lower{0.0f};
  glm::vec3 upper{0.0f};
  std::vector<glm::uvec3> nodes;  // [levels], along x, y, z, at least 2 each

  bool operator==(const GridExtent&) const = default;
};

// Room around the template that clothes and hair may need, metres.
inline constexpr double kGridMargin = 0.12;

// The box of the canonical template vertices grown by kGridMargin and then, about its middle, to whole cells of the
// coarsest level. A finer level takes as many cells as keep them no larger than it asks. Empty where spec.grid_cells is
// empty. Throws InputError when a level would exceed 128 MiB, the least limit on a storage buffer that Vulkan
// guarantees.
GridExtent make_grid_extent(const AvatarSpec& spec, std::span<const glm::dvec3> canonical_vertices);

}  // namespace arah
