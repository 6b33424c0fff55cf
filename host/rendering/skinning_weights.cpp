#include "host/rendering/skinning_weights.h"

#include <algorithm>
#include <array>
#include <glm/geometric.hpp>

#include "host/body/canonical.h"
#include "kernels/skinning/lbs.h"
#include "kernels/tracing/normalise_inputs.h"

namespace arah {

CanonicalTemplate::CanonicalTemplate(const Avatar& avatar) : vertices_(canonical_vertices(avatar.body, avatar.canonical)), triangles_(avatar.body.triangles), surface_(vertices_, triangles_) {}

uint32_t CanonicalTemplate::nearest_vertex(const glm::dvec3& point) const {
  const glm::uvec3& corners = triangles_[surface_.closest(point).triangle];
  uint32_t nearest = corners.x;
  for (int k = 1; k < 3; ++k)
    if (glm::distance(vertices_[corners[k]], point) < glm::distance(vertices_[nearest], point)) nearest = corners[k];
  return nearest;
}

SkinningWeights::SkinningWeights(Device& device, AvatarNetworks& networks, const Avatar& avatar) : device_(device), networks_(networks), avatar_(avatar) {
  if (!avatar.spec.skinning.learned()) return;
  tape_.emplace(device, "skinning weights: network", networks.skinning_shape(), points_at_a_time, false);
  points_ = Buffer(device, "skinning weights: points", points_at_a_time * 16ull, BufferPlace::device);
  posed_ = Buffer(device, "skinning weights: posed points", points_at_a_time * 16ull, BufferPlace::device);
  weights_ = Buffer(device, "skinning weights", uint64_t(points_at_a_time) * padded_channels(networks.tree().joints()) * 4, BufferPlace::device);
}

std::vector<float> SkinningWeights::at(Commands& commands, const BufferSlice& frame, std::span<const glm::vec3> points) {
  const size_t joints = networks_.tree().joints();
  std::vector<float> weights(points.size() * joints, 0.0f);
  switch (avatar_.spec.skinning.kind) {
    case Skinning::none:
      for (size_t i = 0; i < points.size(); ++i) weights[i * joints] = 1;
      break;
    case Skinning::template_weights: ask_template(points, weights.data()); break;
    case Skinning::network:
    case Skinning::backward:
      for (size_t first = 0; first < points.size(); first += points_at_a_time) ask_network(commands, frame, points.subspan(first, std::min<size_t>(points_at_a_time, points.size() - first)), &weights[first * joints]);
      break;
  }
  return weights;
}

void SkinningWeights::ask_network(Commands& commands, const BufferSlice& frame, std::span<const glm::vec3> points, float* weights) {
  const auto count = static_cast<uint32_t>(points.size());
  const uint32_t joints = networks_.tree().joints(), stride = padded_channels(joints);
  std::vector<std::array<float, 4>> some(padded_points(count), {0, 0, 0, 0});
  for (uint32_t i = 0; i < count; ++i) some[i] = {points[i].x, points[i].y, points[i].z, 1};
  device_.upload(points_.slice(), some);
  const Rows rows{{count, {}}, {}};
  record_normalise_inputs(commands, {rows, frame, points_.slice(), tape_->input(), avatar_.spec.skinning.kind == Skinning::backward});
  networks_.skinning().record_forward(commands, *tape_, rows.range);
  LbsArgs lbs;
  lbs.tree = &networks_.tree();
  lbs.rows = rows;
  lbs.logits = tape_->output();
  lbs.frame = frame;
  lbs.canonical = points_.slice();
  lbs.posed = posed_.slice();
  lbs.weights = {weights_.slice(), stride, 0};
  record_lbs(commands, lbs);
  commands.submit_and_wait();
  const std::vector<float> padded = device_.download<float>(weights_.slice().elements(0, uint64_t(count) * stride));
  for (size_t i = 0; i < count; ++i) std::copy_n(&padded[i * stride], joints, weights + i * joints);
}

void SkinningWeights::ask_template(std::span<const glm::vec3> points, float* weights) {
  if (!template_) template_ = std::make_unique<CanonicalTemplate>(avatar_);
  const size_t joints = networks_.tree().joints();
  for (size_t i = 0; i < points.size(); ++i) {
    const uint32_t vertex = template_->nearest_vertex(points[i]);
    const glm::vec4& of_vertex = avatar_.body.weights[vertex];
    const float sum = of_vertex.x + of_vertex.y + of_vertex.z + of_vertex.w;  // nearly 1
    for (int k = 0; k < 4; ++k) weights[i * joints + avatar_.body.joints[vertex][k]] += of_vertex[k] / sum;
  }
}

}  // namespace arah
