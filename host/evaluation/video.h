// A video file from pictures on disk.
#pragma once

#include <array>
#include <filesystem>
#include <span>
#include <string>

namespace arah {

// MP4 of PNGs (8 bit, RGB or RGBA with straight alpha) that are all of one size, each shown 1 / fps seconds, over a background
// of one colour (0..1). An odd size grows by one row or column of background: the codecs want even ones. H.264 where the
// FFmpeg that OpenCV was built with has an encoder for it (Debian's has: libx264), else MPEG-4 part 2. Returns the codec's name.
// The file is whole or absent. Throws InputError where a picture is missing or of another size, std::runtime_error where
// there is no encoder or the disk refuses.
std::string write_video(const std::filesystem::path& path, std::span<const std::filesystem::path> pictures, double fps, const std::array<float, 3>& background);

}  // namespace arah
