#include "viewer/saving.h"

#include <fmt/format.h>

#include "host/evaluation/avatar_export.h"
#include "host/evaluation/layers.h"
#include "host/evaluation/mesh_files.h"
#include "host/evaluation/picture.h"
#include "host/evaluation/video.h"
#include "host/file_writing.h"
#include "host/version.h"

namespace arah {

namespace fs = std::filesystem;

fs::path free_name(const fs::path& folder, const std::string& stem, const std::string& end) {
  for (int number = 1;; ++number) {
    const fs::path path = folder / fmt::format("{}_{:04}{}", stem, number, end);
    if (!fs::exists(path)) return path;
  }
}

std::vector<uint8_t> screenshot(const DrawnPicture& drawn, PictureLayer layer) {
  const Picture& picture = *drawn.picture;
  if (layer == PictureLayer::color) return encode_png(straight_alpha(picture.color, picture.alpha, picture.width, picture.height), picture.width, picture.height, 4);
  return encode_png(drawn.layer ? *drawn.layer : layer_image(layer, picture, *drawn.avatar));
}

Job video_job(const fs::path& path, std::vector<AnimationFrame> frames, const RenderSettings& settings, double frames_per_second) {
  return {"video", [=](Device& device, const Avatar& avatar, const std::function<bool(double)>& progress) {
            const Animation animation{frames, settings, false};
            fs::path working = path;
            working += ".frames";
            const AnimationFolder folder(working, avatar, animation);
            const auto all = static_cast<double>(frames.size());
            if (!folder.render(device, avatar, [&](double done) { return progress(done / all); })) return fmt::format("stopped: {} of {} pictures are in {}", folder.done(), frames.size(), working.string());
            const std::string codec = write_video(path, folder.pictures(), frames_per_second, {1, 1, 1});
            folder.remove();
            return fmt::format("{} ({}, {} pictures)", path.string(), codec, frames.size());
          }};
}

Job mesh_job(const fs::path& path, const Pose& pose, std::size_t latent_row) {
  return {"mesh", [=](Device& device, const Avatar& avatar, const std::function<bool(double)>& progress) {
            progress(0);
            MeshExtraction extraction(device, avatar, {});
            const ColoredMesh mesh = posed_mesh(extraction, {pose, latent_row}, true);
            write_file_safely(path, ply_file(mesh, fmt::format("arah {}, metres", kVersion)));
            return fmt::format("{} ({} triangles)", path.string(), mesh.triangles.size());
          }};
}

}  // namespace arah
