// A mesh laid out flat in a square picture: charts that look one way, turned and packed with a margin around each.
#pragma once

#include <cstdint>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>
#include <span>
#include <vector>

#include "host/capture/implicit_surface.h"

namespace arah {

struct TextureAtlas {
  struct Texel {
    std::uint32_t pixel = 0;  // row-major, top left first
    std::uint32_t triangle = 0;
    glm::vec3 barycentric{0.0f};  // of the triangle's vertices, ≥ 0, sum 1: the place of it nearest to the texel's centre
  };

  int size = 0;  // columns and rows
  std::vector<std::uint32_t> vertices;  // of the cut mesh: the mesh's vertex that each is a copy of
  std::vector<glm::vec2> uvs;           // [cut vertices] 0..1, u right, v down
  std::vector<glm::uvec3> triangles;    // of the cut mesh, in the mesh's order
  std::vector<Texel> texels;            // those of charts and what bilinear filters read around them; each pixel once
  std::size_t charts = 0;
  double texels_per_metre = 0;
};

// Charts are connected parts whose triangles face one of six ways, each projected along that way so that none lies over another,
// cut in halves while they fill little of their box. Areas shrink by a factor of 2 at most where the surface is smooth.
// size: 16 to 16384. Throws std::invalid_argument for a mesh without triangles, InputError where so many charts do not fit.
TextureAtlas make_texture_atlas(const TriangleMesh& mesh, int size);

// A picture [size][size][3] of the texels' colours; the rest takes those of the nearest, for smaller versions of the texture.
std::vector<float> atlas_picture(const TextureAtlas& atlas, std::span<const glm::vec3> colors);

}  // namespace arah
