#include "kernels/reference/tracing.h"

#include <limits>

namespace arah::reference {

RayInterval intersect_box(const Vector<3>& origin, const Vector<3>& direction, const Vector<3>& minimum,
                          const Vector<3>& maximum) {
  RayInterval interval{0, std::numeric_limits<double>::infinity(), false};
  for (int i = 0; i < 3; ++i) {
    double component = direction[i];
    if (std::abs(component) < 1e-12) component = component < 0 ? -1e-12 : 1e-12;
    const double to_minimum = (minimum[i] - origin[i]) / component;
    const double to_maximum = (maximum[i] - origin[i]) / component;
    if (!std::isfinite(to_minimum) || !std::isfinite(to_maximum)) return interval;
    interval.near = std::max(interval.near, std::min(to_minimum, to_maximum));
    interval.far = std::min(interval.far, std::max(to_minimum, to_maximum));
  }
  interval.hit = interval.near < interval.far;
  return interval;
}

std::size_t nearest_vertex(const Vector<3>& point, std::span<const Vector<3>> vertices) {
  std::size_t best = 0;
  double best_squared = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < vertices.size(); ++i) {
    const Vector<3> difference{vertices[i][0] - point[0], vertices[i][1] - point[1], vertices[i][2] - point[2]};
    const double squared = dot<3>(difference, difference);
    if (squared < best_squared) {
      best_squared = squared;
      best = i;
    }
  }
  return best;
}

Correspondence template_correspondence(const Vector<3>& posed, const PosedTemplate& posed_template) {
  Correspondence found;
  found.vertex = nearest_vertex(posed, posed_template.vertices);
  const std::size_t bones = posed_template.bone_transforms.size();
  const auto weights = posed_template.skinning_weights.subspan(found.vertex * bones, bones);
  found.transform = {};
  for (std::size_t b = 0; b < bones; ++b)
    for (int i = 0; i < 4; ++i)
      for (int j = 0; j < 4; ++j) found.transform[i][j] += weights[b] * posed_template.bone_transforms[b][i][j];
  // The full 4x4 is inverted: with weights that sum to 1 only nearly, its last row is not exactly (0, 0, 0, 1).
  const Matrix<4> inverted = inverse<4>(found.transform).value_or(not_a_matrix<4>());
  found.canonical = transform_point(inverted, posed);
  return found;
}

Vector<3> bone_start(const Vector<3>& posed, std::span<const Matrix<4>> bone_transforms, std::span<const BoneSegment> segments, std::size_t rank) {
  std::vector<std::pair<double, std::size_t>> order;  // by distance, then index
  std::vector<Vector<3>> starts;
  for (std::size_t b = 0; b < bone_transforms.size(); ++b) {
    const Vector<3> x = transform_point(inverse<4>(bone_transforms[b]).value_or(not_a_matrix<4>()), posed);
    Vector<3> along, from, apart;
    for (int i = 0; i < 3; ++i) along[i] = segments[b].to[i] - segments[b].from[i], from[i] = x[i] - segments[b].from[i];
    const double size = dot<3>(along, along), t = size > 0 ? std::clamp(dot<3>(from, along) / size, 0.0, 1.0) : 0;
    for (int i = 0; i < 3; ++i) apart[i] = from[i] - t * along[i];
    order.emplace_back(dot<3>(apart, apart), b);
    starts.push_back(x);
  }
  if (rank >= order.size()) return {NAN, NAN, NAN};
  std::sort(order.begin(), order.end());
  return starts[order[rank].second];
}

std::optional<Vector<3>> interpolate_correspondence(const Vector<3>& posed, const CorrespondenceNodes& nodes) {
  std::array<std::size_t, 3> corner{};
  Vector<3> part{};
  for (int axis = 0; axis < 3; ++axis) {
    const double at = (posed[axis] - nodes.origin[axis]) / nodes.cell;
    const std::size_t last = nodes.nodes[static_cast<std::size_t>(axis)] - 1;
    if (!(at >= 0 && at <= static_cast<double>(last))) return std::nullopt;
    const auto whole = std::min(static_cast<std::size_t>(at), last - 1);
    corner[static_cast<std::size_t>(axis)] = whole;
    part[axis] = at - static_cast<double>(whole);
  }
  std::array<Vector<3>, 8> around;  // number: x + 2 y + 4 z
  Vector<3> result{};
  for (std::size_t i = 0; i < 8; ++i) {
    const std::size_t x = corner[0] + (i & 1), y = corner[1] + (i >> 1 & 1), z = corner[2] + (i >> 2);
    const std::size_t node = (z * nodes.nodes[1] + y) * nodes.nodes[0] + x;
    if (!nodes.found[node]) return std::nullopt;
    around[i] = nodes.canonical[node];
    const double weight = (i & 1 ? part[0] : 1 - part[0]) * (i & 2 ? part[1] : 1 - part[1]) * (i & 4 ? part[2] : 1 - part[2]);
    for (int c = 0; c < 3; ++c) result[c] += weight * around[i][c];
  }
  for (std::size_t i = 0; i < 8; ++i)
    for (const std::size_t step : {1u, 2u, 4u}) {
      if (i & step) continue;
      Vector<3> edge{};
      for (int c = 0; c < 3; ++c) edge[c] = around[i + step][c] - around[i][c];
      if (!(norm<3>(edge) <= nodes.longest)) return std::nullopt;
    }
  return result;
}

double interpolate_value(const Vector<3>& at, const ValueNodes& nodes) {
  std::array<std::size_t, 3> corner{};
  Vector<3> part{};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const std::size_t last = nodes.nodes[axis] - 1;
    const double place = std::clamp((at[static_cast<int>(axis)] - nodes.origin[static_cast<int>(axis)]) / nodes.cell, 0.0, static_cast<double>(last));
    corner[axis] = std::min(static_cast<std::size_t>(place), last - 1);
    part[static_cast<int>(axis)] = place - static_cast<double>(corner[axis]);
  }
  double result = 0;
  for (std::size_t i = 0; i < 8; ++i) {
    const std::size_t x = corner[0] + (i & 1), y = corner[1] + (i >> 1 & 1), z = corner[2] + (i >> 2);
    const double weight = (i & 1 ? part[0] : 1 - part[0]) * (i & 2 ? part[1] : 1 - part[1]) * (i & 4 ? part[2] : 1 - part[2]);
    result += weight * nodes.values[(z * nodes.nodes[1] + y) * nodes.nodes[0] + x];
  }
  return result;
}

}  // namespace arah::reference
