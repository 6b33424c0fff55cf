#include "host/capture/camera.h"

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <glm/matrix.hpp>
#include <set>
#include <stdexcept>

#include "host/body/json_fields.h"
#include "host/file_writing.h"

namespace arah {
namespace {

constexpr int kLargestSize = 8192;  // pixels

glm::dmat3 read_matrix(const nlohmann::json& value, const std::string& where, const std::string& field) {
  json_list(value, 3, where, field);
  glm::dmat3 matrix;
  for (int r = 0; r < 3; ++r) {
    const glm::dvec3 row = json_vector(value[static_cast<std::size_t>(r)], where, field);
    for (int c = 0; c < 3; ++c) matrix[c][r] = row[c];
  }
  return matrix;
}

nlohmann::json as_json(const glm::dmat3& matrix) {
  nlohmann::json rows = nlohmann::json::array();
  for (int r = 0; r < 3; ++r) rows.push_back({matrix[0][r], matrix[1][r], matrix[2][r]});
  return rows;
}

// The name is a folder's name too.
void check_name(const std::string& name, const std::string& where, const std::string& field) {
  if (name.empty() || name.find('/') != std::string::npos || name[0] == '.') {
    throw InputError(where, field, "a name that can name a folder", "'" + name + "'");
  }
}

void check_rotation(const glm::dmat3& rotation, const std::string& where, const std::string& field) {
  const glm::dmat3 gram = glm::transpose(rotation) * rotation;
  double error = 0.0;
  for (int c = 0; c < 3; ++c) {
    for (int r = 0; r < 3; ++r) error = std::max(error, std::abs(gram[c][r] - (c == r ? 1.0 : 0.0)));
  }
  if (error > 1e-3) {
    throw InputError(where, field, "a rotation (RᵀR = 1)", fmt::format("a matrix that is off by {:.3g}", error));
  }
  const double determinant = glm::determinant(rotation);
  if (!(determinant > 0.0)) {
    throw InputError(where, field, "a rotation (determinant +1)",
                     fmt::format("a mirror (determinant {:.3g})", determinant),
                     "Camera axes are x right, y down, z forward.");
  }
}

// OpenCV's axes (x right, y down, z forward) at the camera; K may have a skew.
void check_intrinsics(const glm::dmat3& K, const std::string& where, const std::string& field) {
  if (!(K[0][0] > 0.0) || !(K[1][1] > 0.0)) {
    throw InputError(where, field, "positive focal lengths", fmt::format("{} and {}", K[0][0], K[1][1]));
  }
  if (K[0][2] != 0.0 || K[1][2] != 0.0 || K[2][2] != 1.0 || K[0][1] != 0.0) {
    throw InputError(where, field, "[[fx, s, cx], [0, fy, cy], [0, 0, 1]]", json_excerpt(as_json(K)));
  }
}

Camera read_camera(const nlohmann::json& entry, const std::string& where, std::size_t index) {
  const std::string position = fmt::format("cameras[{}]", index);
  Camera camera;
  camera.name = json_text(json_member(entry, "name", where, position), where, position + " name");
  check_name(camera.name, where, position + " name");
  const std::string field = fmt::format("camera '{}'", camera.name);
  if (entry.contains("role")) camera.role = json_text(entry["role"], where, field + " role");
  if (camera.role == "heldout") camera.role = "test";
  if (camera.role != "train" && camera.role != "test") {
    throw InputError(where, field + " role", "'train', 'test' or 'heldout'", "'" + camera.role + "'");
  }
  camera.width = json_integer(json_member(entry, "width", where, field), 1, kLargestSize, where, field + " width");
  camera.height = json_integer(json_member(entry, "height", where, field), 1, kLargestSize, where, field + " height");
  camera.K = read_matrix(json_member(entry, "K", where, field), where, field + " K");
  camera.R = read_matrix(json_member(entry, "R", where, field), where, field + " R");
  camera.T = json_vector(json_member(entry, "T", where, field), where, field + " T");
  if (entry.contains("D")) {
    const nlohmann::json& list = json_list(entry["D"], 5, where, field + " D");
    for (std::size_t i = 0; i < 5; ++i) camera.distortion[i] = json_number(list[i], where, field + " D");
  }
  check_camera(camera, where);
  return camera;
}

}  // namespace

bool Camera::distorted() const {
  return std::any_of(distortion.begin(), distortion.end(), [](double k) { return k != 0.0; });
}

glm::dvec3 Camera::center() const {
  return -(glm::transpose(R) * T);
}

glm::dvec2 Camera::project(const glm::dvec3& world) const {
  const glm::dvec3 pixel = K * to_camera(world);
  return {pixel.x / pixel.z, pixel.y / pixel.z};
}

PixelRay Camera::ray(double u, double v) const {
  const double y = (v - K[2][1]) / K[1][1];
  const double x = (u - K[2][0] - K[1][0] * y) / K[0][0];
  return {center(), glm::normalize(glm::transpose(R) * glm::dvec3(x, y, 1.0))};
}

// OpenCV's model: radial k1 k2 k3, tangential p1 p2, on normalised coordinates.
glm::dvec2 Camera::distort(const glm::dvec2& pixel) const {
  const auto [k1, k2, p1, p2, k3] = distortion;
  const double y = (pixel.y - K[2][1]) / K[1][1];
  const double x = (pixel.x - K[2][0] - K[1][0] * y) / K[0][0];
  const double r2 = x * x + y * y;
  const double radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
  const double xd = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x);
  const double yd = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y;
  return {K[0][0] * xd + K[1][0] * yd + K[2][0], K[1][1] * yd + K[2][1]};
}

Camera Camera::scaled(int new_width) const {
  if (new_width < 1) throw std::invalid_argument(fmt::format("a picture {} pixels wide", new_width));
  Camera result = *this;
  result.width = new_width;
  result.height = std::max(1, static_cast<int>(std::lround(static_cast<double>(height) * new_width / width)));
  const double sx = static_cast<double>(result.width) / width;
  const double sy = static_cast<double>(result.height) / height;
  result.K[0][0] *= sx;
  result.K[1][0] *= sx;
  result.K[2][0] = (K[2][0] + 0.5) * sx - 0.5;
  result.K[1][1] *= sy;
  result.K[2][1] = (K[2][1] + 0.5) * sy - 0.5;
  return result;
}

void check_camera(const Camera& camera, const std::string& where) {
  check_name(camera.name, where, "camera");
  const std::string field = fmt::format("camera '{}'", camera.name);
  for (const int length : {camera.width, camera.height}) {
    if (length < 1 || length > kLargestSize) {
      throw InputError(where, field, fmt::format("pictures of 1 to {} pixels", kLargestSize), fmt::format("{}", length));
    }
  }
  check_intrinsics(camera.K, where, field + " K");
  check_rotation(camera.R, where, field + " R");
}

std::vector<Camera> read_cameras(const std::filesystem::path& path) {
  const std::string where = path.string();
  const nlohmann::json file = read_json(path);
  std::vector<Camera> cameras;
  std::set<std::string> names;
  for (const nlohmann::json& entry : json_list(json_member(file, "cameras", where, ""), -1, where, "cameras")) {
    cameras.push_back(read_camera(entry, where, cameras.size()));
    if (!names.insert(cameras.back().name).second) {
      throw InputError(where, fmt::format("camera '{}'", cameras.back().name), "each name once", "this one twice");
    }
  }
  if (cameras.empty()) throw InputError(where, "cameras", "at least one camera", "none");
  return cameras;
}

void write_cameras(const std::filesystem::path& path, const std::vector<Camera>& cameras) {
  nlohmann::ordered_json file;
  file["convention"] = "x_cam = R x_world + T, metres; x right, y down, z forward; integer (u, v) is a pixel's centre";
  file["cameras"] = nlohmann::json::array();
  for (const Camera& camera : cameras) {
    nlohmann::ordered_json entry;
    entry["name"] = camera.name;
    entry["role"] = camera.role;
    entry["width"] = camera.width;
    entry["height"] = camera.height;
    entry["K"] = as_json(camera.K);
    entry["R"] = as_json(camera.R);
    entry["T"] = {camera.T.x, camera.T.y, camera.T.z};
    if (camera.distorted()) entry["D"] = camera.distortion;
    file["cameras"].push_back(std::move(entry));
  }
  write_file_safely(path, file.dump(1) + "\n");
}

}  // namespace arah
