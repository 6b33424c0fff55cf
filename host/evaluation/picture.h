// Pictures of what was rendered, as PNG bytes for files and for the report.
//
// Input is row-major and interleaved, `width * height * channels` floats. Every function throws std::invalid_argument
// where the number of values does not fit the size, and leaves its input alone.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace arah {

// Values in [0, 1] clamped and rounded to 255 steps, as they are: no gamma is applied. Of 1 (grey), 3 (RGB) or 4 (RGBA) channels. A pixel with a NaN or an
// infinity becomes opaque magenta (white where grey), so that it is seen.
std::vector<std::uint8_t> eight_bits(std::span<const float> values, int width, int height, int channels);

// eight_bits() as PNG; alpha is not premultiplied.
std::vector<std::uint8_t> encode_png(std::span<const float> values, int width, int height, int channels);

// RGBA with straight alpha from a colour that is multiplied by it, as compositing over black leaves it; 0 where alpha is 0, but not finite where the colour is not.
std::vector<float> straight_alpha(std::span<const float> color, std::span<const float> alpha, int width, int height);

// RGB in [0, 1]: the mean over channels of |rendering - truth|, times `gain`, in the Inferno colours: black = equal,
// pale yellow = a difference of 1 / gain and above. Non-finite pixels stay non-finite, so that encode_png shows them.
std::vector<float> error_map(std::span<const float> rendering, std::span<const float> truth, int width, int height,
                             float gain = 4.0f);

// RGB = normal * 0.5 + 0.5 of `[height][width][3]` unit normals. Shorter ones, composited over a background of zeros, fade to
// black: 0.5 (normal + its length).
std::vector<float> normals_to_rgb(std::span<const float> normals, int width, int height);

// Grey in [0, 1] of `[height][width]` depths in metres: the nearest pixel is 1, the farthest 0.2 (1 where all are
// equal), linear between. Depths that are not finite or not above 0 mean background and become 0.
std::vector<float> depth_to_grey(std::span<const float> depth, int width, int height);

// 16-bit grey PNG of depths in millimetres, rounded. 0 is background (not finite, not above 0); a surface nearer than
// half a millimetre is stored as 1, one beyond 65.535 m as 65535.
std::vector<std::uint8_t> encode_depth_png(std::span<const float> depth, int width, int height);

}  // namespace arah
