// A made-up body in a pose: surface, skinning network and rays at it, in double precision, for tests of searches.
#pragma once

#include <algorithm>
#include <cmath>
#include <functional>
#include <random>
#include <vector>

#include "kernels/reference/broyden.h"
#include "kernels/reference/skinning.h"
#include "kernels/skinning/joint_tree.h"
#include "shaders/shared/ray.h"
#include "tests/kernels/skinning_scene.h"

namespace arah {

using Vector3 = reference::Vector<3>;

// A smooth body: an ellipsoid in the cube's coordinates, f = c (|n / a| − 1), not a true distance.
struct Ellipsoid {
  Vector3 axes{0.7, 0.5, 0.6};
  double steepness = 0.45;
  double value(const Vector3& n) const {
    return steepness * (std::hypot(n[0] / axes[0], n[1] / axes[1], n[2] / axes[2]) - 1);
  }
  Vector3 gradient(const Vector3& n) const {
    const double length = std::hypot(n[0] / axes[0], n[1] / axes[1], n[2] / axes[2]);
    Vector3 g;
    for (size_t i = 0; i < 3; ++i) g[i] = steepness * n[i] / (axes[i] * axes[i] * length);
    return g;
  }
};

// f and ∂f/∂n in the cube.
struct Surface {
  std::function<double(const Vector3&)> value;
  std::function<Vector3(const Vector3&)> gradient;
};
inline Surface surface_of(const Ellipsoid& ellipsoid) {
  return {[=](const Vector3& n) { return ellipsoid.value(n); }, [=](const Vector3& n) { return ellipsoid.gradient(n); }};
}

// A skinning network in a pose. Weights change slowly over space, as a body's do.
struct Body {
  reference::SkinningNetwork network;
  std::vector<double> bones;
  Surface surface = surface_of(Ellipsoid{});
  JointTree tree{smpl_tree()};

  std::vector<double> logits(const std::vector<double>& x) const {
    std::vector<double> n;
    for (size_t p = 0; p < x.size() / 3; ++p) {
      const reference::Vec3 at = network.cube.to_cube({x[3 * p], x[3 * p + 1], x[3 * p + 2]});
      n.insert(n.end(), at.begin(), at.end());
    }
    return reference::dense_forward(network.layers, x.size() / 3, n).output;
  }
  reference::Matrix<4> transform(const Vector3& x) const {
    const auto out = reference::skinning_forward(network, bones, 1, x);
    reference::Matrix<4> t;
    for (size_t i = 0; i < 16; ++i) t[i / 4][i % 4] = out.blended[i];
    return t;
  }
  Vector3 skinned(const Vector3& x) const { return reference::transform_point(transform(x), x); }
  double sdf_metric(const Vector3& x) const { return surface.value(network.cube.to_cube(x)) / network.cube.scale(); }
};

inline Body small_body(std::mt19937_64& generator, double turn) {
  Body body{{reference::JointTree(smpl_tree()), {{0.05, -0.1, 0.02}, -0.95, 1.05}, {}, 20},
            random_bones(generator, 24, turn)};
  const size_t logits = body.network.tree.logits();
  const auto doubles = [&](size_t count, double scale) {
    std::uniform_real_distribution<double> distribution(-scale, scale);
    std::vector<double> values(count);
    for (double& value : values) value = distribution(generator);
    return values;
  };
  body.network.layers.layers = {
      {3, 16, reference::Activation::softplus, false, doubles(48, 0.5), {}, doubles(16, 0.3)},
      {16, logits, reference::Activation::none, false, doubles(16 * logits, 0.03), {}, doubles(logits, 0.05)}};
  return body;
}

// Rays from 3 m away at the ellipsoid in its pose.
struct RayScene {
  std::vector<Ray> rays;
  std::vector<double> root_translation{0.25, -0.5, 0.125};
};

inline RayScene rays_at(const Body& body, std::mt19937_64& generator, uint32_t count) {
  RayScene scene;
  std::uniform_real_distribution<double> unit(-1, 1);
  const Vector3 middle = body.skinned(body.network.cube.from_cube({0, 0, 0}));
  for (uint32_t r = 0; r < count; ++r) {
    Vector3 origin, direction;
    for (size_t i = 0; i < 3; ++i)
      origin[i] = middle[i] + scene.root_translation[i] + (i == 2 ? -3 : 0.2 * unit(generator));
    for (size_t i = 0; i < 3; ++i)
      direction[i] = middle[i] + scene.root_translation[i] + 0.9 * unit(generator) - origin[i];
    const double length = reference::norm<3>(direction);
    Ray ray{};
    for (size_t i = 0; i < 3; ++i)
      ray.origin[i] = static_cast<float>(origin[i]), ray.direction[i] = static_cast<float>(direction[i] / length);
    ray.near = 1.5f;
    ray.far = 4.47f;  // not a multiple of the longest step away: rounding must not decide who is past it
    scene.rays.push_back(ray);
  }
  return scene;
}

}  // namespace arah
