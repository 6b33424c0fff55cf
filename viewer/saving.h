// What a user takes home from the viewer: pictures, videos of what was played, meshes.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "host/evaluation/animation.h"
#include "viewer/picture_worker.h"
#include "viewer/view_state.h"

namespace arah {

// The first of <folder>/<stem>_0001<end>, _0002 and so on that is not there.
std::filesystem::path free_name(const std::filesystem::path& folder, const std::string& stem, const std::string& end);

// The picture's layer as arah render writes it, without what lies above it in the window.
// Throws std::invalid_argument where it was drawn for another layer.
std::vector<uint8_t> screenshot(const DrawnPicture& drawn, PictureLayer layer);

// Renders the frames at their quality and makes a video of them. What was drawn stays beside it in <path>.frames when it is stopped; nothing
// else does.
Job video_job(const std::filesystem::path& path, std::vector<AnimationFrame> frames, const RenderSettings& settings, double frames_per_second);

// The surface in one pose as .ply, with colours, as arah export makes it.
Job mesh_job(const std::filesystem::path& path, const Pose& pose, std::size_t latent_row);

}  // namespace arah
