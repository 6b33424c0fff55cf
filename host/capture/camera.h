// Calibrated cameras: x_cam = R x_world + T with OpenCV axes (x right, y down, z forward); integer (u, v) is the centre
// of pixel column u, row v.
#pragma once

#include <array>
#include <filesystem>
#include <glm/mat3x3.hpp>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>
#include <string>
#include <vector>

namespace arah {

struct PixelRay {
  glm::dvec3 origin{0.0};
  glm::dvec3 direction{0.0};  // unit length
};

struct Camera {
  std::string name;
  std::string role = "train";  // "train", or "test" for a camera that is held out
  int width = 0;               // pixels
  int height = 0;
  glm::dmat3 K{1.0};  // intrinsics, pixels: u = K[0][0] x/z + K[1][0] y/z + K[2][0] (glm: column first)
  glm::dmat3 R{1.0};  // world → camera rotation
  glm::dvec3 T{0.0};  // world → camera translation, metres
  // OpenCV's k1 k2 p1 p2 k3 of the pictures on disk; load_image() takes it out, so rays and project() know nothing of
  // it.
  std::array<double, 5> distortion{};

  bool operator==(const Camera&) const = default;

  bool distorted() const;
  // The camera's centre in the world, −Rᵀ T.
  glm::dvec3 center() const;
  // World → camera coordinates; z is the depth, positive in front.
  glm::dvec3 to_camera(const glm::dvec3& world) const { return R * world + T; }
  // World → pixel of the undistorted picture. The point must be in front of the camera (depth > 0).
  glm::dvec2 project(const glm::dvec3& world) const;
  // The ray through the centre of pixel (u, v) of the undistorted picture, in the world.
  PixelRay ray(double u, double v) const;
  // Where an undistorted pixel lies in the distorted picture on disk.
  glm::dvec2 distort(const glm::dvec2& pixel) const;
  // The camera of the same picture resized to `new_width` columns, its height in proportion (rounded, at least 1).
  // Pixel centres map as u' = (u + 0.5) new_width / width − 0.5. Throws std::invalid_argument if new_width < 1.
  Camera scaled(int new_width) const;
};

// Reads cameras.json: {"cameras": [{name, role, width, height, K 3×3, R 3×3, T 3, D 5 (optional)}]}, matrices row by
// row. The role "heldout" is read as "test", an absent one as "train". Throws InputError naming file and camera:
// numbers that are not finite, sizes not in 1..8192, focal lengths not positive, K's last row not 0 0 1, R not a
// rotation to 1e-3 (mirrored ones included), names empty or given twice, unknown roles, no camera at all.
std::vector<Camera> read_cameras(const std::filesystem::path& path);

// What read_cameras() demands of one camera, for cameras from elsewhere. Throws InputError naming `where`.
void check_camera(const Camera& camera, const std::string& where);

// Writes the same format. Throws std::runtime_error when the disk refuses.
void write_cameras(const std::filesystem::path& path, const std::vector<Camera>& cameras);

}  // namespace arah
