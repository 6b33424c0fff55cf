#include "host/evaluation/animation.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <sstream>
#include <stdexcept>

#include "host/evaluation/picture.h"
#include "host/evaluation/recorded_folder.h"
#include "host/file_writing.h"
#include "host/rendering/renderer.h"

namespace arah {
namespace {

namespace fs = std::filesystem;

// What the pictures depend on.
nlohmann::ordered_json description(const Avatar& avatar, const Animation& animation) {
  const Camera& camera = animation.frames.front().camera;
  return {{"avatar", fingerprint_of(avatar)},
          {"frames", animation.frames.size()},
          {"size", fmt::format("{} x {}", camera.width, camera.height)},
          {"poses_and_cameras", fingerprint_of(animation.frames)},
          {"beside", animation.normals_beside ? "normals" : "nothing"},
          {"render", nlohmann::ordered_json::parse(render_settings_json(animation.render))}};
}

// Two pictures with straight alpha, four channels each, side by side.
std::vector<float> side_by_side(const std::vector<float>& left, const std::vector<float>& right, int width, int height) {
  std::vector<float> both;
  both.reserve(left.size() + right.size());
  const auto row = static_cast<std::ptrdiff_t>(4 * width);
  for (std::ptrdiff_t y = 0; y < height; ++y)
    for (const std::vector<float>* half : {&left, &right}) both.insert(both.end(), half->begin() + y * row, half->begin() + (y + 1) * row);
  return both;
}

std::vector<uint8_t> picture_png(const Picture& picture, bool normals_beside) {
  const int w = picture.width, h = picture.height;
  const std::vector<float> color = straight_alpha(picture.color, picture.alpha, w, h);
  if (!normals_beside) return encode_png(color, w, h, 4);
  return encode_png(side_by_side(color, straight_alpha(normals_to_rgb(picture.normal, w, h), picture.alpha, w, h), w, h), 2 * w, h, 4);
}

}  // namespace

std::string fingerprint_of(const std::vector<AnimationFrame>& frames) {
  Fingerprint print;
  for (const AnimationFrame& frame : frames) {
    for (const glm::dvec3& theta : frame.pose.theta)
      for (int k = 0; k < 3; ++k) print.add(theta[k]);
    for (int k = 0; k < 3; ++k) print.add(frame.pose.root_position[k]), print.add(frame.camera.T[k]);
    for (int column = 0; column < 3; ++column)
      for (int row = 0; row < 3; ++row) print.add(frame.camera.K[column][row]), print.add(frame.camera.R[column][row]);
    print.add(uint64_t{frame.latent_row});
  }
  return print.text();
}

fs::path animation_picture(const fs::path& folder, std::size_t frame) { return folder / fmt::format("{:06}.png", frame); }

AnimationFolder::AnimationFolder(fs::path path, const Avatar& avatar, const Animation& animation) : path_(std::move(path)), animation_(animation) {
  if (animation.frames.empty()) throw std::invalid_argument("an animation without frames");
  claim_folder(path_, "animation.json", description(avatar, animation), "pictures", [this] { return done() > 0; });
}

std::size_t AnimationFolder::done() const {
  std::size_t count = 0;
  for (const fs::path& picture : pictures()) count += fs::exists(picture);
  return count;
}

std::vector<fs::path> AnimationFolder::pictures() const {
  std::vector<fs::path> paths;
  for (std::size_t f = 0; f < animation_.frames.size(); ++f) paths.push_back(animation_picture(path_, f));
  return paths;
}

bool AnimationFolder::render(Device& device, const Avatar& avatar, const std::function<bool(double)>& progress, const Ranks& ranks) const {
  // Of several ranks the first one looks, since others may be writing already when the next one would.
  std::string missing;
  for (std::size_t f = 0; ranks.first() && f < animation_.frames.size(); ++f)
    if (!fs::exists(animation_picture(path_, f))) missing += fmt::format("{} ", f);
  ranks.broadcast(missing);
  std::vector<std::size_t> wanted;
  std::istringstream words(missing);
  for (std::size_t f = 0; words >> f;) wanted.push_back(f);
  if (wanted.empty()) return true;
  const std::size_t before = animation_.frames.size() - wanted.size();
  RenderSettings settings = animation_.render;
  settings.normals = animation_.normals_beside;
  Renderer renderer(device, avatar, settings);
  return ranks.share(wanted.size(), [&](uint64_t number) {
    const AnimationFrame& frame = animation_.frames[wanted[number]];
    Picture picture;
    try {
      picture = renderer.render(frame.camera, frame.pose, frame.latent_row, [&](const PictureSoFar& so_far) { return progress(double(before + number) + so_far.part); });
    } catch (const RenderingStopped&) {
      return false;
    }
    const fs::path path = animation_picture(path_, wanted[number]);
    if (const BadPixels bad = bad_pixels(picture); bad.count > 0 && animation_.on_bad_pixels) animation_.on_bad_pixels(path, bad);
    write_file_safely(path, picture_png(picture, animation_.normals_beside));
    return progress(double(before + number + 1)) || number + 1 == wanted.size();
  });
}

void AnimationFolder::remove() const {
  std::error_code ignored;
  for (const fs::path& picture : pictures()) fs::remove(picture, ignored);
  fs::remove(path_ / "animation.json", ignored);
  fs::remove(path_, ignored);  // refuses where something else is in it
}

}  // namespace arah
