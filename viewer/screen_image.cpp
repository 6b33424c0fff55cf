#include "viewer/screen_image.h"

#include <algorithm>
#include <cmath>

namespace arah {
namespace {

constexpr float kBackground[] = {0.11f, 0.11f, 0.12f};

}  // namespace

ScreenPicture color_on_screen(const Picture& picture) {
  ScreenPicture screen{picture.width, picture.height, std::vector<uint8_t>(4 * picture.alpha.size())};
  for (size_t i = 0; i < picture.alpha.size(); ++i) {
    for (size_t c = 0; c < 3; ++c) screen.rgba[4 * i + c] = static_cast<uint8_t>(std::lround(255 * std::clamp(picture.color[3 * i + c] + (1 - picture.alpha[i]) * kBackground[c], 0.0f, 1.0f)));
    screen.rgba[4 * i + 3] = 255;
  }
  return screen;
}

}  // namespace arah
