// The signed distances of a posed person on a plane.
#pragma once

#include <cstdint>
#include <functional>
#include <glm/vec3.hpp>
#include <vector>

#include "host/capture/camera.h"
#include "host/rendering/field.h"
#include "host/rendering/ray_samples.h"

namespace arah {

// A rectangle in the world, metres, of width × height pixels: the centre of column i, row j lies at
// origin + (i + ½) / width · across + (j + ½) / height · down.
struct SlicePlane {
  glm::dvec3 origin{0.0}, across{1, 0, 0}, down{0, -1, 0};

  glm::dvec3 at(double column, double row, int width, int height) const { return origin + (column + 0.5) / width * across + (row + 0.5) / height * down; }
};

// Parallel to the camera's picture, through a point in front of it: what lies on the plane is seen at its own pixel.
// Throws std::invalid_argument for a point that is not in front.
SlicePlane plane_facing(const Camera& camera, const glm::dvec3& point);

// Row-major, top left first.
struct DistanceSlice {
  int width = 0, height = 0;
  std::vector<float> distances;  // metres, below 0 inside; 0 where there is no root
  std::vector<uint8_t> found;    // 1 where the point has a canonical one
};

// For the frame and the networks as they are packed now: the canonical point of each pixel's by the search that `search` asks for,
// and f there. As in the field itself that is a distance in canonical space; where skinning stretches or bends, another one in the posed.
// samples: whose room for points and search are used; what was placed there is lost. Submits. progress: the part done, 0..1; return
// false to stop (throws RenderingStopped).
DistanceSlice distance_slice(Device& device, Commands& commands, FrameOnDevice& frame, RaySamples& samples, Field& field, const RootFindingSettings& search, double metres_per_unit, const SlicePlane& plane, int width, int height,
                             const std::function<bool(double)>& progress = {});

}  // namespace arah
