// Lines over a picture: the skeleton, and the template's mesh.
#pragma once

#include <array>
#include <cstdint>
#include <glm/gtc/type_precision.hpp>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>
#include <optional>
#include <span>
#include <vector>

#include "host/body/body_template.h"
#include "host/capture/camera.h"

namespace arah {

using OverlayColor = glm::u8vec4;  // red, green, blue, straight alpha

// In pixels of the camera's picture, inside of it: from −0.5 to its size − 0.5.
struct OverlayLine {
  glm::dvec2 from{0.0}, to{0.0};
  OverlayColor color{255};
};
struct OverlayJoint {
  int joint = 0;
  glm::dvec2 place{0.0};
  double depth = 0;  // metres
  OverlayColor color{255};
};

// What of a line between two points of the world is in the picture: nothing nearer to the camera than kNearPlane, nothing outside. None where
// nothing is, or where a point is not finite.
std::optional<OverlayLine> line_in_picture(const Camera& camera, const glm::dvec3& from, const glm::dvec3& to, OverlayColor color);

// Bones in blue on the left, red on the right and yellow in the middle, by the joints' names; joints in the same colours.
struct SkeletonOverlay {
  std::vector<OverlayLine> bones;    // those in the picture, from a joint to its parent
  std::vector<OverlayJoint> joints;  // those in the picture, the farthest first
};
// joints: where they are, world, [J]. Throws std::invalid_argument for another number of them.
SkeletonOverlay skeleton_overlay(const Camera& camera, const Skeleton& skeleton, std::span<const glm::dvec3> joints);

// A mesh of thousands of triangles as lines that let one see through it: its outlines, and rings around what was upright at rest.
class TemplateOverlay {
 public:
  // Rings at rest are level and a 48th of the body's largest side apart. Throws std::invalid_argument for triangles of vertices that are not there.
  explicit TemplateOverlay(const BodyTemplate& body);

  // The mesh with its vertices where they are now, world, [V]. Outlines: edges where a triangle that faces the camera meets one that does not, or
  // none. Rings: on triangles that face it. Lines that nearer parts of the body hide are drawn all the same. Throws std::invalid_argument
  // for another number of vertices.
  std::vector<OverlayLine> lines(const Camera& camera, std::span<const glm::vec3> vertices) const;

  struct Edge {
    std::array<std::uint32_t, 2> ends{};
    std::array<std::int64_t, 2> triangles{-1, -1};  // −1: none; of an edge of more than two, the last two
  };
  // Of a triangle's way through a level: on two of its sides, from vertices `from` to `to`, as parts of the way.
  struct Ring {
    std::uint32_t triangle = 0;
    std::array<std::uint32_t, 2> from{}, to{};
    std::array<double, 2> part{};
  };
  const std::vector<Edge>& edges() const { return edges_; }
  const std::vector<Ring>& rings() const { return rings_; }

 private:
  std::size_t vertices_ = 0;
  std::vector<glm::uvec3> triangles_;
  std::vector<Edge> edges_;
  std::vector<Ring> rings_;
};

}  // namespace arah
