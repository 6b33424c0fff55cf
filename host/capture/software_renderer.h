// A small rasteriser on the CPU: triangles to straight-alpha pictures, with supersampled edges.
#pragma once

#include <cstdint>
#include <functional>
#include <glm/glm.hpp>
#include <span>
#include <vector>

#include "host/capture/camera.h"

namespace arah {

// The nearest surface at one place of a picture.
struct SurfaceSample {
  std::uint32_t triangle = 0;
  glm::vec3 barycentric;     // of the triangle's three vertices, in space (perspective-correct), sum 1
  glm::vec3 view_direction;  // unit length, world, from the camera to the surface
};

// Row-major pixels, top left first, RGBA 8 bit. RGB is the mean colour of the covered part (straight, 0 where alpha is
// 0), alpha the covered part of the pixel.
struct RgbaPicture {
  int width = 0;
  int height = 0;
  std::vector<std::uint8_t> rgba;  // [height][width][4]
};

// Colour of a sample, each channel 0..1 (clamped).
using Shader = std::function<glm::vec3(const SurfaceSample&)>;

// Draws triangles (world positions, metres; both sides are visible) through `camera` (its distortion is not applied)
// with 3x3 samples a pixel and a depth buffer. Triangles that reach within 1 % of the camera's distance to the furthest
// vertex, or behind it, are left out.
RgbaPicture rasterise(const Camera& camera, std::span<const glm::vec3> positions, std::span<const glm::uvec3> triangles,
                      const Shader& shade);

// What the centre of a pixel sees.
struct VisiblePlace {
  std::uint32_t triangle = no_triangle;
  glm::vec3 barycentric{0.0f};  // as SurfaceSample's

  static constexpr std::uint32_t no_triangle = 0xffffffff;
};

// The nearest triangle at each pixel's centre, row-major, top left first; triangles too near are left out as by rasterise.
std::vector<VisiblePlace> visible_places(const Camera& camera, std::span<const glm::vec3> positions, std::span<const glm::uvec3> triangles);

}  // namespace arah
