// Pictures of an exported GLB, by nothing of the program's but its rasteriser: skin, animation and texture are the file's.
#pragma once

#include <glm/common.hpp>
#include <opencv2/imgcodecs.hpp>

#include "host/capture/software_renderer.h"
#include "host/rendering/renderer.h"
#include "tests/host/body/glb_reader.h"

namespace arah {

// World of a capture (z up) from that of the file (y up).
inline glm::dvec3 z_up(const glm::dvec3& p) { return {p.x, -p.z, p.y}; }

struct GlbPicture {
  std::vector<bool> covered;          // by pixel
  std::vector<glm::dvec3> colors;     // of the texture, 0..1; without one black
};

// turn: from the file's world to the camera's.
inline GlbPicture picture_of(const GlbReader& file, const Camera& camera, std::optional<double> seconds, const std::function<glm::dvec3(const glm::dvec3&)>& turn) {
  std::vector<glm::vec3> positions;
  for (const glm::dvec3& p : file.posed(seconds)) positions.emplace_back(turn(p));
  const std::vector<glm::uvec3> triangles = file.triangles();
  cv::Mat texture;
  std::vector<glm::dvec2> uvs;
  if (file.json.contains("images")) {
    const auto& view = file.json["bufferViews"][file.json["images"][0]["bufferView"].get<size_t>()];
    const auto first = file.binary.begin() + view.value("byteOffset", std::ptrdiff_t{0});
    texture = cv::imdecode(std::vector<std::uint8_t>(first, first + view["byteLength"].get<std::ptrdiff_t>()), cv::IMREAD_COLOR);
    uvs = file.uvs();
  }
  const std::vector<VisiblePlace> places = visible_places(camera, positions, triangles);
  GlbPicture picture{std::vector<bool>(places.size()), std::vector<glm::dvec3>(places.size(), glm::dvec3(0.0))};
  for (size_t i = 0; i < places.size(); ++i) {
    if (places[i].triangle == VisiblePlace::no_triangle) continue;
    picture.covered[i] = true;
    if (texture.empty()) continue;
    glm::dvec2 uv(0.0);
    for (int k = 0; k < 3; ++k) uv += double{places[i].barycentric[k]} * uvs[triangles[places[i].triangle][k]];
    // Bilinear between texel centres.
    const glm::dvec2 at = uv * glm::dvec2(texture.cols, texture.rows) - 0.5, low = glm::floor(at), part = at - low;
    for (int j = 0; j < 4; ++j) {
      const int x = std::clamp(static_cast<int>(low.x) + (j & 1), 0, texture.cols - 1), y = std::clamp(static_cast<int>(low.y) + (j >> 1), 0, texture.rows - 1);
      const cv::Vec3b texel = texture.at<cv::Vec3b>(y, x);
      const double weight = (j & 1 ? part.x : 1 - part.x) * (j >> 1 ? part.y : 1 - part.y);
      for (int c = 0; c < 3; ++c) picture.colors[i][c] += weight * texel[2 - c] / 255.0;
    }
  }
  return picture;
}

// Intersection over union with the pixels that the avatar's rendering covers by half and more, and the mean difference of colours
// where both cover fully.
struct Likeness {
  double overlap = 0, color = 0;
};
inline Likeness likeness(const GlbPicture& mesh, const Picture& rendering) {
  double both = 0, either = 0, difference = 0, compared = 0;
  for (size_t i = 0; i < mesh.covered.size(); ++i) {
    const bool seen = rendering.alpha[i] >= 0.5f;
    both += seen && mesh.covered[i], either += seen || mesh.covered[i];
    if (!mesh.covered[i] || rendering.alpha[i] < 0.99f) continue;
    ++compared;
    for (int c = 0; c < 3; ++c) difference += std::abs(mesh.colors[i][c] - double{rendering.color[3 * i + static_cast<size_t>(c)]}) / 3;
  }
  return {both / either, difference / compared};
}

}  // namespace arah
