// A rendered picture as bytes for the screen.
#pragma once

#include "host/rendering/renderer.h"
#include "viewer/presentation.h"

namespace arah {

// The colour over the window's background.
ScreenPicture color_on_screen(const Picture& picture);

}  // namespace arah
