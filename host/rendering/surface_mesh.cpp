#include "host/rendering/surface_mesh.h"

#include <algorithm>
#include <glm/geometric.hpp>
#include <glm/gtc/matrix_transform.hpp>

#include "host/body/canonical.h"
#include "host/capture/software_renderer.h"
#include "host/rendering/skinning_weights.h"

namespace arah {
namespace {

constexpr int smoothing_rounds = 1;  // against the steps that surface nets leave
constexpr float least_influence = 1e-4f;    // of a joint on a vertex: what is left out moves it by less than 0.1 mm for each metre

}  // namespace

TriangleMesh smooth_net(const FieldSamples<float>& distances) {
  TriangleMesh mesh = without_small_parts(surface_nets(distances), least_part);
  even_out(mesh, [&](const glm::dvec3& p) { return distances.between(p); }, distances.cell, smoothing_rounds);
  return mesh;
}

SurfaceMesh::SurfaceMesh(Device& device, Commands& commands, AvatarNetworks& networks, const Avatar& avatar, TriangleMesh mesh, const BufferSlice& frame) : avatar_(avatar), mesh_(std::move(mesh)) {
  require_surface(avatar.spec, "meshes of the surface");
  normals_ = vertex_normals(mesh_.vertices, mesh_.triangles);
  first_.push_back(0);
  if (avatar.spec.skinning.kind == Skinning::network) take_network_weights(device, commands, networks, frame);
  if (avatar.spec.skinning.kind == Skinning::template_weights) take_template_weights();
}

void SurfaceMesh::take_network_weights(Device& device, Commands& commands, AvatarNetworks& networks, const BufferSlice& frame) {
  SkinningWeights weights(device, networks, avatar_);
  const uint32_t joints = networks.tree().joints();
  for (size_t first = 0; first < mesh_.vertices.size(); first += SkinningWeights::points_at_a_time) {
    const size_t count = std::min<size_t>(SkinningWeights::points_at_a_time, mesh_.vertices.size() - first);
    const std::vector<glm::vec3> some(mesh_.vertices.begin() + static_cast<ptrdiff_t>(first), mesh_.vertices.begin() + static_cast<ptrdiff_t>(first + count));
    const std::vector<float> of_vertices = weights.at(commands, frame, some);
    for (size_t i = 0; i < count; ++i) {
      float kept = 0;
      const size_t begin = influences_.size();
      for (uint32_t j = 0; j < joints; ++j) {
        const float weight = of_vertices[i * joints + j];
        if (weight < least_influence) continue;
        influences_.push_back({j, weight});
        kept += weight;
      }
      for (size_t k = begin; k < influences_.size(); ++k) influences_[k].weight /= kept;
      first_.push_back(static_cast<uint32_t>(influences_.size()));
    }
  }
}

void SurfaceMesh::take_template_weights() {
  const CanonicalTemplate body(avatar_);
  for (const glm::dvec3& p : mesh_.vertices) {
    const uint32_t nearest = body.nearest_vertex(p);
    for (int k = 0; k < 4; ++k)
      if (avatar_.body.weights[nearest][k] > 0) influences_.push_back({avatar_.body.joints[nearest][k], avatar_.body.weights[nearest][k]});
    first_.push_back(static_cast<uint32_t>(influences_.size()));
  }
}

std::vector<std::pair<uint32_t, float>> SurfaceMesh::influences(size_t vertex) const {
  std::vector<std::pair<uint32_t, float>> found;
  if (influences_.empty()) return found;
  for (uint32_t i = first_[vertex]; i < first_[vertex + 1]; ++i) found.emplace_back(influences_[i].joint, influences_[i].weight);
  return found;
}

std::vector<glm::mat4> SurfaceMesh::vertex_transforms(const Pose& pose) const {
  const glm::dvec3 t = root_translation(avatar_.body.skeleton, pose);
  std::vector<glm::mat4> world;
  for (glm::dmat4 bone : bone_transforms(avatar_.body.skeleton, avatar_.canonical, pose)) {
    bone[3] += glm::dvec4(t, 0);
    world.emplace_back(bone);
  }
  std::vector<glm::mat4> transforms(mesh_.vertices.size(), glm::mat4(0.0f));
  for (size_t v = 0; v < transforms.size(); ++v) {
    if (influences_.empty()) transforms[v] = glm::translate(glm::mat4(1.0f), glm::vec3(t));
    else
      for (uint32_t i = first_[v]; i < first_[v + 1]; ++i) transforms[v] += influences_[i].weight * world[influences_[i].joint];
  }
  return transforms;
}

std::vector<glm::vec3> SurfaceMesh::posed(const Pose& pose) const {
  const std::vector<glm::mat4> transforms = vertex_transforms(pose);
  std::vector<glm::vec3> vertices;
  for (size_t v = 0; v < transforms.size(); ++v) vertices.emplace_back(transforms[v] * glm::vec4(glm::vec3(mesh_.vertices[v]), 1.0f));
  return vertices;
}

SurfaceHits SurfaceMesh::seen(const Pose& pose, const Camera& camera, double outline) const {
  const std::vector<glm::mat4> transforms = vertex_transforms(pose);
  std::vector<glm::vec3> vertices, drawn;
  for (size_t v = 0; v < transforms.size(); ++v) {
    vertices.emplace_back(transforms[v] * glm::vec4(glm::vec3(mesh_.vertices[v]), 1.0f));
    drawn.emplace_back(transforms[v] * glm::vec4(glm::vec3(mesh_.vertices[v] + outline * normals_[v]), 1.0f));
  }
  const std::vector<VisiblePlace> places = visible_places(camera, drawn, mesh_.triangles);
  const glm::vec3 eye(camera.center());
  SurfaceHits seen;
  seen.points.assign(places.size(), {0, 0, 0, 0});
  seen.depths.assign(places.size(), 0);
  for (size_t i = 0; i < places.size(); ++i) {
    if (places[i].triangle == VisiblePlace::no_triangle) continue;
    const glm::uvec3& corners = mesh_.triangles[places[i].triangle];
    glm::vec3 world(0), canonical(0);
    for (int k = 0; k < 3; ++k) {
      world += places[i].barycentric[k] * vertices[corners[k]];
      canonical += places[i].barycentric[k] * glm::vec3(mesh_.vertices[corners[k]]);
    }
    seen.points[i] = {canonical.x, canonical.y, canonical.z, 1};
    seen.depths[i] = glm::distance(world, eye);
  }
  return seen;
}

}  // namespace arah
