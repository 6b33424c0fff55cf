// The mesh of a zero set by marching cubes on the device.
#pragma once

#include "host/evaluation/surface_cells.h"
#include "kernels/vulkan/commands.h"

namespace arah {

// Closed where the set of cubes is (surface_cells). Throws InputError for more cubes than one launch takes. Submits.
TriangleMesh marched_mesh(Device& device, Commands& commands, const SurfaceCells& cells);

}  // namespace arah
