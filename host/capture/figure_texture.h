// Colours of a synthetic figure as functions of the place on the figure at rest: sharp at any resolution, no image
// needed.
#pragma once

#include <cstdint>
#include <glm/glm.hpp>

#include "host/capture/synthetic_figure.h"

namespace arah {

struct Palette {
  glm::vec3 skin, lips, hair, iris;
  glm::vec3 shirt, stripe, trim;  // shirt ground, its stripes, collar and hems
  glm::vec3 shorts, shorts_line;  // ground and the check's lines
  glm::vec3 shoes, sole;
};

// Seed 0 gives the standard outfit; others draw hues, skin and hair.
Palette make_palette(std::uint64_t seed);

// sRGB colour (0..1) without light of a layer at `rest`: metres divided by the figure's scale, +Y up, +Z forward.
// `tint` is the figure's colour there and matters for rigs only.
glm::vec3 surface_color(const Palette& palette, FigureLayer layer, const glm::vec3& rest, const glm::vec3& tint);

// The colour under the capture's light: a soft key light from above, the sky from above and the floor from below.
// `normal` faces the camera, unit length, world.
glm::vec3 lit(const glm::vec3& color, const glm::vec3& normal);

}  // namespace arah
