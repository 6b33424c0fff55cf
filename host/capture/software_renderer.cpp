#include "host/capture/software_renderer.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace arah {

namespace {

constexpr int kSamples = 3;                // a pixel and axis
constexpr int kBandSamples = 1024 * 1024;  // depth samples held at a time: rows are drawn in bands of this size

struct Corner {
  double x, y;           // samples; sample s lies at its integer coordinate
  double inverse_depth;  // 1 / m
};

struct Sample {
  float inverse_depth = 0;  // 0: nothing
  std::uint32_t triangle = 0;
  float second = 0, third = 0;  // barycentric coordinates of the last two corners
};

// Twice the signed area of (a, b, p).
double edge(const Corner& a, const Corner& b, double x, double y) {
  return (b.x - a.x) * (y - a.y) - (b.y - a.y) * (x - a.x);
}

// Draws one triangle into the sample rows [first_row, first_row + rows).
void draw(const Corner (&corner)[3], std::uint32_t triangle, int columns, int first_row, int rows,
          std::vector<Sample>& samples) {
  const double area = edge(corner[0], corner[1], corner[2].x, corner[2].y);
  if (area == 0) return;
  const auto [x_low, x_high] = std::minmax({corner[0].x, corner[1].x, corner[2].x});
  const auto [y_low, y_high] = std::minmax({corner[0].y, corner[1].y, corner[2].y});
  if (!(x_high >= 0 && x_low <= columns - 1 && y_high >= first_row && y_low <= first_row + rows - 1)) return;
  const int x0 = static_cast<int>(std::ceil(std::max(x_low, 0.0))),
            x1 = static_cast<int>(std::floor(std::min(x_high, columns - 1.0)));
  const int y0 = static_cast<int>(std::ceil(std::max(y_low, static_cast<double>(first_row))));
  const int y1 = static_cast<int>(std::floor(std::min(y_high, first_row + rows - 1.0)));
  for (int y = y0; y <= y1; ++y)
    for (int x = x0; x <= x1; ++x) {
      const double a = edge(corner[1], corner[2], x, y) / area, b = edge(corner[2], corner[0], x, y) / area;
      const double c = 1.0 - a - b;
      if (a < 0 || b < 0 || c < 0) continue;
      // 1/depth is linear in the picture, and so is (barycentric coordinate)/depth.
      const double inverse_depth =
          a * corner[0].inverse_depth + b * corner[1].inverse_depth + c * corner[2].inverse_depth;
      Sample& sample = samples[static_cast<std::size_t>(y - first_row) * static_cast<std::size_t>(columns) +
                               static_cast<std::size_t>(x)];
      if (inverse_depth <= static_cast<double>(sample.inverse_depth)) continue;
      sample = {static_cast<float>(inverse_depth), triangle,
                static_cast<float>(b * corner[1].inverse_depth / inverse_depth),
                static_cast<float>(c * corner[2].inverse_depth / inverse_depth)};
    }
}

// Vertices in a picture of `samples` a pixel and axis, and which of them are far enough from the camera to be drawn.
struct Projected {
  std::vector<Corner> corners;
  std::vector<bool> drawn;

  bool draws(const glm::uvec3& triangle) const { return drawn[triangle.x] && drawn[triangle.y] && drawn[triangle.z]; }
};

Projected project(const Camera& camera, std::span<const glm::vec3> positions, int samples) {
  Projected result{std::vector<Corner>(positions.size()), std::vector<bool>(positions.size(), false)};
  std::vector<double> depths(positions.size());
  double furthest = 0;
  for (std::size_t i = 0; i < positions.size(); ++i) furthest = std::max(furthest, depths[i] = camera.to_camera(glm::dvec3(positions[i])).z);
  for (std::size_t i = 0; i < positions.size(); ++i) {
    if (depths[i] <= 0.01 * furthest) continue;
    const glm::dvec2 pixel = camera.project(glm::dvec3(positions[i]));
    // Sample s of a pixel's lies (s - (samples - 1) / 2) / samples beside the pixel's centre.
    result.corners[i] = {pixel.x * samples + 0.5 * (samples - 1), pixel.y * samples + 0.5 * (samples - 1), 1.0 / depths[i]};
    result.drawn[i] = true;
  }
  return result;
}

std::uint8_t byte(float value) {
  return static_cast<std::uint8_t>(std::lround(255.0f * std::clamp(value, 0.0f, 1.0f)));
}

}  // namespace

RgbaPicture rasterise(const Camera& camera, std::span<const glm::vec3> positions, std::span<const glm::uvec3> triangles,
                      const Shader& shade) {
  RgbaPicture picture{camera.width, camera.height, {}};
  picture.rgba.resize(static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height) * 4);
  const Projected projected = project(camera, positions, kSamples);
  const std::vector<Corner>& corners = projected.corners;
  const glm::vec3 eye(camera.center());

  // The rows of pixels that anything may touch.
  int top = camera.height, bottom = 0;
  for (std::size_t i = 0; i < positions.size(); ++i) {
    if (!projected.drawn[i]) continue;
    const double row = std::clamp(corners[i].y / kSamples, 0.0, static_cast<double>(camera.height));
    top = std::min(top, static_cast<int>(row));
    bottom = std::max(bottom, std::min(static_cast<int>(row) + 1, camera.height));
  }
  const int columns = camera.width * kSamples;
  const int band = std::clamp(kBandSamples / (columns * kSamples), 1, camera.height);  // rows of pixels
  std::vector<Sample> samples;
  for (int first = top; first < bottom; first += band) {
    const int rows = std::min(band, bottom - first);
    samples.assign(static_cast<std::size_t>(rows * kSamples) * static_cast<std::size_t>(columns), Sample{});
    for (std::uint32_t t = 0; t < triangles.size(); ++t) {
      const glm::uvec3& v = triangles[t];
      if (!projected.draws(v)) continue;
      draw({corners[v.x], corners[v.y], corners[v.z]}, t, columns, first * kSamples, rows * kSamples, samples);
    }
    for (int y = 0; y < rows; ++y)
      for (int x = 0; x < camera.width; ++x) {
        glm::vec3 sum(0);
        int covered = 0;
        for (int s = 0; s < kSamples * kSamples; ++s) {
          const int row = y * kSamples + s / kSamples, column = x * kSamples + s % kSamples;
          const Sample& sample = samples[static_cast<std::size_t>(row) * static_cast<std::size_t>(columns) +
                                         static_cast<std::size_t>(column)];
          if (sample.inverse_depth <= 0) continue;
          const glm::vec3 weight(1.0f - sample.second - sample.third, sample.second, sample.third);
          const glm::uvec3& v = triangles[sample.triangle];
          const glm::vec3 point = weight.x * positions[v.x] + weight.y * positions[v.y] + weight.z * positions[v.z];
          sum += glm::clamp(shade({sample.triangle, weight, glm::normalize(point - eye)}), 0.0f, 1.0f);
          ++covered;
        }
        if (covered == 0) continue;
        const glm::vec3 mean = sum / static_cast<float>(covered);
        std::uint8_t* pixel =
            &picture.rgba[4 * (static_cast<std::size_t>(first + y) * static_cast<std::size_t>(camera.width) +
                               static_cast<std::size_t>(x))];
        for (int k = 0; k < 3; ++k) pixel[k] = byte(mean[k]);
        pixel[3] = byte(static_cast<float>(covered) / (kSamples * kSamples));
      }
  }
  return picture;
}

std::vector<VisiblePlace> visible_places(const Camera& camera, std::span<const glm::vec3> positions, std::span<const glm::uvec3> triangles) {
  const Projected projected = project(camera, positions, 1);
  std::vector<Sample> samples(static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height));
  for (std::uint32_t t = 0; t < triangles.size(); ++t) {
    const glm::uvec3& v = triangles[t];
    if (projected.draws(v)) draw({projected.corners[v.x], projected.corners[v.y], projected.corners[v.z]}, t, camera.width, 0, camera.height, samples);
  }
  std::vector<VisiblePlace> places(samples.size());
  for (std::size_t i = 0; i < samples.size(); ++i) {
    const Sample& sample = samples[i];
    if (sample.inverse_depth > 0) places[i] = {sample.triangle, {1.0f - sample.second - sample.third, sample.second, sample.third}};
  }
  return places;
}

}  // namespace arah
