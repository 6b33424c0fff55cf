#include "host/rendering/surface_colors.h"

#include <algorithm>
#include <array>
#include <glm/geometric.hpp>
#include <glm/mat3x3.hpp>
#include <stdexcept>

#include "shaders/shared/ray.h"

namespace arah {
namespace {

constexpr uint32_t colors_at_a_time = 16384;

Buffer by_point(Device& device, const char* what, uint64_t bytes) { return Buffer(device, std::string("surface colours: ") + what, colors_at_a_time * bytes, BufferPlace::device); }

}  // namespace

SurfaceColors::SurfaceColors(Device& device, AvatarNetworks& networks)
    : device_(device), networks_(networks), field_(device, networks, point_padding, 1, {colors_at_a_time, false}, false), points_(by_point(device, "points", 16)), rays_(by_point(device, "rays", sizeof(Ray))), transforms_(by_point(device, "transforms", 48)) {}

std::vector<glm::vec3> SurfaceColors::at(Commands& commands, const BufferSlice& frame, std::span<const glm::vec3> points, std::span<const glm::vec3> normals, std::span<const glm::mat4> transforms) {
  if (normals.size() != points.size() || transforms.size() != points.size()) throw std::invalid_argument("surface colours: a normal and a transform for each point");
  std::vector<glm::vec3> colors;
  colors.reserve(points.size());
  for (size_t first = 0; first < points.size(); first += colors_at_a_time) {
    const auto count = static_cast<uint32_t>(std::min<size_t>(colors_at_a_time, points.size() - first));
    const uint32_t padded = padded_points(count);
    std::vector<std::array<float, 4>> places(padded, {0, 0, 0, 0}), rows(3 * size_t{padded}, {0, 0, 0, 0});
    std::vector<Ray> rays(padded, Ray{});
    for (uint32_t i = 0; i < count; ++i) {
      const glm::vec3& p = points[first + i];
      places[i] = {p.x, p.y, p.z, 1};
      const glm::mat4& t = transforms[first + i];
      for (int row = 0; row < 3; ++row) rows[3 * i + static_cast<uint32_t>(row)] = {t[0][row], t[1][row], t[2][row], t[3][row]};
      const glm::vec3 posed = glm::mat3(t) * normals[first + i];
      const float length = glm::length(posed);
      const glm::vec3 towards = length > 0 ? -posed / length : glm::vec3(0, 0, 1);
      rays[i] = {{0, 0, 0}, 0, {towards.x, towards.y, towards.z}, 1};
    }
    device_.upload(points_.slice(), places);
    device_.upload(rays_.slice(), rays);
    device_.upload(transforms_.slice(), rows);
    field_.record_forward(commands, {frame, points_.slice(), rays_.slice(), count, transforms_.slice()});
    commands.submit_and_wait();
    const Matrix rgb = field_.rgb();
    const std::vector<float> values = device_.download<float>(rgb.slice.elements(0, uint64_t(count) * rgb.stride));
    for (uint32_t i = 0; i < count; ++i) {
      const float* color = &values[size_t(i) * rgb.stride + rgb.column];
      colors.emplace_back(color[0], color[1], color[2]);
    }
  }
  return colors;
}

}  // namespace arah
