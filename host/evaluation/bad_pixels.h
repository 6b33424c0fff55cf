// Pixels of a rendering that hold a NaN or an infinity: eight_bits() makes them magenta, and a user is told of them.
#pragma once

#include <cstddef>
#include <string>

#include "host/evaluation/image_metrics.h"
#include "host/rendering/renderer.h"

namespace arah {

struct BadPixels {
  std::size_t count = 0;     // with a number that is not finite in colour, alpha, depth or normal
  std::size_t pixels = 0;    // of the picture
  int column = 0, row = 0;   // of the first, row-major; 0 where there is none
};

BadPixels bad_pixels(const Picture& picture);
// Whether all colours of a rectangle of the picture are finite, so that it can be compared with a photograph there.
bool finite_colors(const Picture& picture, const CropRectangle& crop);

// "12 of 4096 pixels are not finite, the first in column 3 of row 5".
std::string counted(const BadPixels& bad);
// One line: "warning: out/color.png: 12 of 4096 pixels are not finite, ...; ..." with what to do.
// avatar: as the user named it.
std::string warning_of(const BadPixels& bad, const std::string& picture, const std::string& avatar);

}  // namespace arah
