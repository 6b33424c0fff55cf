// How strongly each joint moves a point: what skinning blends bone transforms by, for points of the host's choice.
#pragma once

#include <glm/vec3.hpp>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "host/avatar/avatar.h"
#include "host/body/mesh_distance.h"
#include "host/rendering/avatar_networks.h"

namespace arah {

// Skinning::template_weights in canonical space: which vertex of the template decides at a canonical point.
class CanonicalTemplate {
 public:
  explicit CanonicalTemplate(const Avatar& avatar);
  // Of the corners of the triangle that comes nearest to the point, the nearest.
  uint32_t nearest_vertex(const glm::dvec3& point) const;

 private:
  std::vector<glm::dvec3> vertices_;
  const std::vector<glm::uvec3>& triangles_;
  MeshDistance surface_;
};

class SkinningWeights {
 public:
  // For so many points at a time, where there is a network.
  static constexpr uint32_t points_at_a_time = 8192;

  SkinningWeights(Device& device, AvatarNetworks& networks, const Avatar& avatar);

  // [points][joints], at least 0 with sum 1. points: canonical, metres; with Skinning::backward, whose weights are those of posed points,
  // posed ones without the root translation. Networks as they are packed now, for backward with record_pose.
  // frame: FrameConstants, of that pose for backward, else of any.
  // network, backward: what the network says (ARAH.md section 2). template_weights: of CanonicalTemplate::nearest_vertex. none: the
  // root's, which stands where it is. Submits.
  std::vector<float> at(Commands& commands, const BufferSlice& frame, std::span<const glm::vec3> points);

 private:
  void ask_network(Commands& commands, const BufferSlice& frame, std::span<const glm::vec3> points, float* weights);
  void ask_template(std::span<const glm::vec3> points, float* weights);

  Device& device_;
  AvatarNetworks& networks_;
  const Avatar& avatar_;
  std::optional<DenseTape> tape_;
  Buffer points_, posed_, weights_;
  std::unique_ptr<CanonicalTemplate> template_;  // made when it is first asked
};

}  // namespace arah
