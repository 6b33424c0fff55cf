#include "kernels/reference/tracing.h"

#include <limits>

namespace arah::reference {

RayInterval intersect_box(const Vector<3>& origin, const Vector<3>& direction, const Vector<3>& minimum,
                          const Vector<3>& maximum) {
  RayInterval interval{0, std::numeric_limits<double>::infinity(), false};
  for (int i = 0; i < 3; ++i) {
    double component = direction[i];
    if (std::abs(component) < 1e-5) component = component < 0 ? -1e-5 : 1e-5;
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

}  // namespace arah::reference
