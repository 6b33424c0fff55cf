// Pictures of a motion, one after the other, in a folder that remembers how they were made: what was interrupted goes on.
#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "host/avatar/avatar.h"
#include "host/capture/camera.h"
#include "host/evaluation/bad_pixels.h"
#include "host/rendering/render_settings.h"
#include "host/training/ranks.h"
#include "kernels/vulkan/device.h"

namespace arah {

struct AnimationFrame {
  Pose pose;
  Camera camera;
  std::size_t latent_row = 0;
};

// Of poses, cameras and codes.
std::string fingerprint_of(const std::vector<AnimationFrame>& frames);

struct Animation {
  std::vector<AnimationFrame> frames;
  RenderSettings render;
  bool normals_beside = false;  // colour left, normals right (n/2 + 1/2, world axes)
  std::function<void(const std::filesystem::path&, const BadPixels&)> on_bad_pixels = {};  // of a picture that has some, before it is written; may be empty
};

// Where picture number `frame` lies: 000000.png and so on.
std::filesystem::path animation_picture(const std::filesystem::path& folder, std::size_t frame);

// Renders what is missing: RGBA PNGs with straight alpha. animation.json beside them says what they depend on.
class AnimationFolder {
 public:
  // Makes the folder where there is none. Throws InputError where it holds pictures of another animation, naming what differs.
  AnimationFolder(std::filesystem::path path, const Avatar& avatar, const Animation& animation);

  std::size_t done() const;  // pictures that are there
  std::vector<std::filesystem::path> pictures() const;  // all of them, in order
  // progress: pictures done, with the part of the one in work; false stops. Returns whether all are there. ranks: that share the
  // pictures out among them, each to the one that is free; collective, and for the same folder on all.
  bool render(Device& device, const Avatar& avatar, const std::function<bool(double)>& progress, const Ranks& ranks = {}) const;
  // The pictures and what says how they were made; the folder too where nothing else is in it.
  void remove() const;

 private:
  std::filesystem::path path_;
  const Animation& animation_;
};

}  // namespace arah
