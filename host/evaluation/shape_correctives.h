// What the shape of an avatar does beyond skinning, as few morph targets: for files whose mesh is the same in all frames.
#pragma once

#include <functional>
#include <vector>

#include "host/evaluation/mesh_extraction.h"

namespace arah {

struct ShapeCorrectives {
  std::vector<std::vector<double>> displacements;  // [targets][vertices] along the canonical normals, metres
  std::vector<std::vector<float>> weights;         // [frames][targets] −1..1
  double mean_left = 0, most_left = 0;             // metres that frames' surfaces are off the sum, over vertices and frames
};

// The mesh of the first frame follows the surface of each: along its vertices' normals to the frame's zero set. The displacements'
// greatest principal components are the targets, `most` at most, fewer where the rest is below 0.1 mm; no frame differing, none.
// poses, rows: equally many, at least one; those of the extraction's last mesh() first.
ShapeCorrectives shape_correctives(MeshExtraction& extraction, const SurfaceMesh& mesh, const std::vector<Pose>& poses, const std::vector<std::size_t>& rows, std::size_t most, const std::function<void(double)>& progress = {});

}  // namespace arah
