#include "host/evaluation/mesh_extraction.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/geometric.hpp>
#include <limits>
#include <numbers>

#include "host/evaluation/marched_mesh.h"
#include "host/evaluation/mesh_simplification.h"

namespace arah {
namespace {

constexpr uint32_t distances_at_a_time = 16384;
constexpr double least_rough_cell = 0.006;   // metres: finer cubes are halves of these and more
constexpr double greatest_radius = 0.15;  // metres
constexpr int tangents = 8, along_tangent = 40;  // over half a circle; places of each
constexpr int outline_rounds = 5, smoothing_rounds_of_outlines = 3;
constexpr double outline_step = 0.7;

// Times that a cell of so many metres is halved until it is no longer than `cell`, but for what a float loses.
int halvings_from(double rough, double cell) { return std::max(0, static_cast<int>(std::ceil(std::log2(rough / cell) - 1e-3))); }

// Of a signed distance, by metre (ARAH.md §6).
double laplace_density(double f, double b) { return f > 0 ? 0.5 / b * std::exp(-f / b) : (1 - 0.5 * std::exp(f / b)) / b; }

}  // namespace

MeshExtraction::MeshExtraction(Device& device, const Avatar& avatar, const MeshSettings& settings)
    : device_(device), avatar_(avatar), commands_(device), networks_(device, avatar, false), body_(device, avatar.body), field_(device, networks_, distances_at_a_time, 1, {.capacity = point_padding}, false), settings_(settings), baked_(device, avatar, std::ldexp(settings.cell, halvings_from(least_rough_cell, settings.cell))) {
  require_surface(avatar.spec, "meshes of the surface");
  commands_.stage("meshing");
}

const SurfaceMesh& MeshExtraction::mesh(const Pose& pose, std::size_t latent_row) {
  const bool new_pose = !frame_ || !(pose_ == pose), new_row = !mesh_ || row_ != latent_row;
  if (packed_ && !new_pose && !new_row) return *mesh_;
  packed_ = true;
  shapes_frame_.reset();
  networks_.record_pack(commands_, latent_row, pose_input(avatar_, pose));
  commands_.submit_and_wait();
  if (new_pose) frame_.emplace(device_, avatar_, body_, pose, ShellSettings{});
  pose_ = pose;
  row_ = latent_row;
  const bool same = mesh_ && (!new_row || avatar_.spec.sdf.conditioning == SdfConditioning::none) && (!new_pose || avatar_.spec.sdf.pose == PoseConditioning::none);
  if (same) return *mesh_;
  baked_.bake(commands_, field_, frame_->constants());
  const SurfaceCells cells = surface_cells(baked_.samples(), halvings_from(baked_.samples().cell, settings_.cell), settings_.outline, [&](std::span<const glm::dvec3> points) { return distances_as_packed(points); });
  evaluated_ = baked_.evaluated() + cells.evaluated;
  SimplifiedMesh meshed{without_small_parts(marched_mesh(device_, commands_, cells), settings_.least_part), 0};
  if (settings_.most_triangles) meshed = simplified(meshed.mesh, settings_.most_triangles);
  simplification_error_ = meshed.error;
  mesh_.emplace(device_, commands_, networks_, avatar_, std::move(meshed.mesh), frame_->constants());
  return *mesh_;
}

std::vector<glm::vec3> MeshExtraction::colors(std::span<const glm::vec3> points, std::span<const glm::vec3> normals, std::span<const glm::mat4> transforms) {
  if (!colors_) colors_.emplace(device_, networks_);
  return colors_->at(commands_, frame_->constants(), points, normals, transforms);
}

bool MeshExtraction::shape_follows_frames() const { return avatar_.spec.sdf.conditioning != SdfConditioning::none || avatar_.spec.sdf.pose != PoseConditioning::none; }

std::vector<double> MeshExtraction::distances(const Pose& pose, std::size_t latent_row, std::span<const glm::dvec3> points) {
  if (!(shapes_frame_ == std::pair(latent_row, pose.theta))) {
    networks_.record_pack(commands_, latent_row, pose_input(avatar_, pose));
    commands_.submit_and_wait();
    if (!frame_) frame_.emplace(device_, avatar_, body_, pose, ShellSettings{});  // any pose's constants: the cube's are read
    shapes_frame_ = {latent_row, pose.theta};
    packed_ = false;
  }
  return distances_as_packed(points);
}

std::vector<double> MeshExtraction::distances_as_packed(std::span<const glm::dvec3> points) {
  if (!points_.bytes()) points_ = Buffer(device_, "mesh extraction: points", distances_at_a_time * 16ull, BufferPlace::device);
  const double metres = avatar_.cube.metres_per_unit();
  std::vector<double> result;
  for (size_t first = 0; first < points.size(); first += distances_at_a_time) {
    const auto count = static_cast<uint32_t>(std::min<size_t>(distances_at_a_time, points.size() - first));
    std::vector<std::array<float, 4>> some(padded_points(count), {0, 0, 0, 0});
    for (uint32_t i = 0; i < count; ++i) {
      const glm::vec3 p(points[first + i]);
      some[i] = {p.x, p.y, p.z, 1};
    }
    device_.upload(points_.slice(), some);
    const Matrix answer = field_.record_distances(commands_, frame_->constants(), points_.slice(), count, false);
    commands_.submit_and_wait();
    const std::vector<float> values = device_.download<float>(answer.slice.elements(0, uint64_t(count) * answer.stride));
    for (uint32_t i = 0; i < count; ++i) result.push_back(metres * double{values[size_t(i) * answer.stride + answer.column]});
  }
  return result;
}

std::vector<double> MeshExtraction::outlines() const {
  const double b = density_scale(avatar_);
  const TriangleMesh& mesh = mesh_->canonical();
  const double half = std::min(0.08, 4 * std::sqrt(2 * 0.1 * b)), step = 2 * half / along_tangent;  // beyond, a trunk of 10 cm radius is 16 b away
  const double most = std::max(0.0, b * std::log(std::sqrt(2 * std::numbers::pi * greatest_radius * b) / (2 * b * std::numbers::ln2)));
  std::vector<double> farther;
  for (size_t v = 0; v < mesh.vertices.size(); ++v) {
    const glm::dvec3& n = mesh_->normals()[v];
    const glm::dvec3 u = glm::normalize(glm::cross(n, std::abs(n.x) < 0.7 ? glm::dvec3(1, 0, 0) : glm::dvec3(0, 1, 0))), w = glm::cross(n, u);
    // Moved out by d every distance along the tangent would grow by d and the depth shrink by e^(−d/b), were the field a distance
    // everywhere: nearly, so a few times over.
    double moved = 0;
    for (int round = 0; round < outline_rounds; ++round) {
      double least = std::numeric_limits<double>::infinity();
      for (int k = 0; k < tangents; ++k) {
        const double angle = std::numbers::pi * k / tangents;
        const glm::dvec3 tangent = std::cos(angle) * u + std::sin(angle) * w;
        double depth = 0;
        for (int i = 0; i < along_tangent; ++i) depth += step * laplace_density(baked_.samples().between(mesh.vertices[v] + moved * n + ((i + 0.5) * step - half) * tangent), b);
        least = std::min(least, depth);
      }
      moved = std::clamp(moved + outline_step * b * std::log(std::max(least, 1e-30) / std::numbers::ln2), 0.0, most);
    }
    farther.push_back(moved);
  }
  const std::vector<std::vector<uint32_t>> neighbours = vertex_neighbours(mesh.vertices.size(), mesh.triangles);
  for (int round = 0; round < smoothing_rounds_of_outlines; ++round) {
    const std::vector<double> before = farther;
    for (size_t v = 0; v < farther.size(); ++v)
      for (const uint32_t other : neighbours[v]) farther[v] += (before[other] - before[v]) / double(neighbours[v].size() + 1);
  }
  return farther;
}

}  // namespace arah
