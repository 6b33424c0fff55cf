// Meshes of fewer triangles for other programs.
#pragma once

#include <cstddef>

#include "host/capture/implicit_surface.h"

namespace arah {

struct SimplifiedMesh {
  TriangleMesh mesh;
  double error = 0;  // metres that the surface moved by, as the quadrics of the edges that were taken away estimate it
};

// Edges collapse, those first that move the surface least (meshoptimizer), until at most so many triangles are left: more only where every
// further collapse would change how the surface hangs together. Vertices stay where they were; those that no triangle uses go.
SimplifiedMesh simplified(const TriangleMesh& mesh, std::size_t most_triangles);

}  // namespace arah
