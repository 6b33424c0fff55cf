#include "viewer/overlay.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <map>
#include <stdexcept>
#include <utility>

#include "host/body/retarget.h"
#include "viewer/pose_editor.h"

namespace arah {
namespace {

constexpr OverlayColor kLeft{90, 170, 255, 255}, kRight{255, 110, 90, 255}, kMiddle{255, 215, 90, 255};
constexpr OverlayColor kOutline{255, 255, 255, 220}, kRing{255, 255, 255, 90};
constexpr double kRings = 48;

// Liang and Barsky 1984: what of from + t (to − from), t in [0, 1], is on the inner side of all four borders.
bool clip_to_picture(const Camera& camera, glm::dvec2& from, glm::dvec2& to) {
  const glm::dvec2 low(-0.5), high(camera.width - 0.5, camera.height - 0.5), way = to - from;
  double first = 0, last = 1;
  for (int axis = 0; axis < 2; ++axis) {
    for (const auto& [slope, room] : {std::pair(-way[axis], from[axis] - low[axis]), std::pair(way[axis], high[axis] - from[axis])}) {
      if (slope == 0.0 && room < 0.0) return false;
      if (slope < 0.0) first = std::max(first, room / slope);
      if (slope > 0.0) last = std::min(last, room / slope);
    }
  }
  if (!(first <= last)) return false;
  to = from + last * way;
  from += first * way;
  return true;
}

OverlayColor side_color(const std::vector<int>& other, const Skeleton& skeleton, const glm::dvec3& left, std::size_t joint) {
  const int across = other[joint];
  if (across == static_cast<int>(joint)) return kMiddle;
  return glm::dot(left, skeleton.rest_joints[joint] - skeleton.rest_joints[static_cast<std::size_t>(across)]) > 0 ? kLeft : kRight;
}

}  // namespace

std::optional<OverlayLine> line_in_picture(const Camera& camera, const glm::dvec3& from, const glm::dvec3& to, OverlayColor color) {
  glm::dvec3 a = camera.to_camera(from), b = camera.to_camera(to);
  if (!(a.z >= kNearPlane) && !(b.z >= kNearPlane)) return std::nullopt;
  if (a.z < kNearPlane) a = glm::mix(a, b, (kNearPlane - a.z) / (b.z - a.z));
  if (b.z < kNearPlane) b = glm::mix(b, a, (kNearPlane - b.z) / (a.z - b.z));
  const glm::dvec3 start = camera.K * a, end = camera.K * b;
  OverlayLine line{glm::dvec2(start) / start.z, glm::dvec2(end) / end.z, color};
  if (!std::isfinite(line.from.x + line.from.y + line.to.x + line.to.y) || !clip_to_picture(camera, line.from, line.to)) return std::nullopt;
  return line;
}

SkeletonOverlay skeleton_overlay(const Camera& camera, const Skeleton& skeleton, std::span<const glm::dvec3> joints) {
  if (joints.size() != skeleton.size()) throw std::invalid_argument(fmt::format("{} places for a skeleton of {} joints", joints.size(), skeleton.size()));
  const std::vector<int> other = other_side(skeleton);
  const glm::dvec3 left = rest_axes(skeleton)[0];
  SkeletonOverlay overlay;
  for (std::size_t j = 0; j < joints.size(); ++j) {
    const OverlayColor color = side_color(other, skeleton, left, j);
    if (skeleton.parents[j] >= 0)
      if (const auto bone = line_in_picture(camera, joints[j], joints[static_cast<std::size_t>(skeleton.parents[j])], color)) overlay.bones.push_back(*bone);
    if (const auto point = line_in_picture(camera, joints[j], joints[j], color)) overlay.joints.push_back({static_cast<int>(j), point->from, camera.to_camera(joints[j]).z, color});
  }
  std::stable_sort(overlay.joints.begin(), overlay.joints.end(), [](const OverlayJoint& a, const OverlayJoint& b) { return a.depth > b.depth; });
  return overlay;
}

TemplateOverlay::TemplateOverlay(const BodyTemplate& body) : vertices_(body.vertices.size()), triangles_(body.triangles) {
  // Where a texture has a seam, a mesh has a vertex twice, and no outline.
  std::map<std::array<float, 3>, std::uint32_t> places;
  std::vector<std::uint32_t> first(vertices_);
  for (std::size_t v = 0; v < vertices_; ++v) {
    const glm::vec3& place = body.vertices[v];
    first[v] = places.try_emplace({place.x, place.y, place.z}, static_cast<std::uint32_t>(v)).first->second;
  }
  std::map<std::pair<std::uint32_t, std::uint32_t>, std::size_t> known;
  for (std::size_t t = 0; t < triangles_.size(); ++t) {
    for (int side = 0; side < 3; ++side) {
      std::uint32_t a = triangles_[t][side], b = triangles_[t][(side + 1) % 3];
      if (a >= vertices_ || b >= vertices_) throw std::invalid_argument(fmt::format("triangle {} of vertex {} of {}", t, std::max(a, b), vertices_));
      a = first[a], b = first[b];
      const auto [entry, added] = known.try_emplace(std::minmax(a, b), edges_.size());
      if (added) edges_.push_back({{a, b}, {-1, -1}});
      std::array<std::int64_t, 2>& beside = edges_[entry->second].triangles;
      beside = {static_cast<std::int64_t>(t), beside[0]};
    }
  }
  if (vertices_ == 0) return;
  glm::vec3 low = body.vertices[0], high = low;
  for (const glm::vec3& vertex : body.vertices) low = glm::min(low, vertex), high = glm::max(high, vertex);
  const glm::vec3 sides = high - low;
  const double apart = static_cast<double>(std::max({sides.x, sides.y, sides.z})) / kRings;
  if (!(apart > 0)) return;
  // Levels between the bottom and the first ring half as far: none passes through the extreme vertices themselves.
  const auto level = [&](std::uint32_t vertex) { return (static_cast<double>(body.vertices[vertex].y) - static_cast<double>(low.y)) / apart - 0.5; };
  for (std::size_t t = 0; t < triangles_.size(); ++t) {
    const glm::uvec3& triangle = triangles_[t];
    const auto [least, greatest] = std::minmax({level(triangle.x), level(triangle.y), level(triangle.z)});
    for (double ring = std::ceil(least); ring <= greatest; ++ring) {
      Ring found{static_cast<std::uint32_t>(t), {}, {}, {}};
      int crossed = 0;
      for (int side = 0; side < 3; ++side) {
        const std::uint32_t a = triangle[side], b = triangle[(side + 1) % 3];
        const double from = level(a), to = level(b);
        if ((from < ring) == (to < ring)) continue;  // a vertex on the level counts as above it: two sides are crossed or none
        const auto slot = static_cast<std::size_t>(crossed++);
        found.from[slot] = a;
        found.to[slot] = b;
        found.part[slot] = (ring - from) / (to - from);
      }
      if (crossed == 2) rings_.push_back(found);
    }
  }
}

std::vector<OverlayLine> TemplateOverlay::lines(const Camera& camera, std::span<const glm::vec3> vertices) const {
  if (vertices.size() != vertices_) throw std::invalid_argument(fmt::format("{} vertices of a body of {}", vertices.size(), vertices_));
  const glm::dvec3 eye = camera.center();
  std::vector<bool> faces(triangles_.size());
  for (std::size_t t = 0; t < triangles_.size(); ++t) {
    const glm::dvec3 a(vertices[triangles_[t].x]), b(vertices[triangles_[t].y]), c(vertices[triangles_[t].z]);
    faces[t] = glm::dot(glm::cross(b - a, c - a), eye - a) > 0;
  }
  const auto seen = [&](std::int64_t triangle) { return triangle >= 0 && faces[static_cast<std::size_t>(triangle)]; };
  std::vector<OverlayLine> lines;
  const auto add = [&](const glm::dvec3& from, const glm::dvec3& to, OverlayColor color) {
    if (const auto line = line_in_picture(camera, from, to, color)) lines.push_back(*line);
  };
  for (const Ring& ring : rings_) {
    if (!faces[ring.triangle]) continue;
    const auto place = [&](std::size_t end) { return glm::mix(glm::dvec3(vertices[ring.from[end]]), glm::dvec3(vertices[ring.to[end]]), ring.part[end]); };
    add(place(0), place(1), kRing);
  }
  for (const Edge& edge : edges_)
    if (seen(edge.triangles[0]) != seen(edge.triangles[1])) add(glm::dvec3(vertices[edge.ends[0]]), glm::dvec3(vertices[edge.ends[1]]), kOutline);
  return lines;
}

}  // namespace arah
