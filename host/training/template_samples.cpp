#include "host/training/template_samples.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <random>

#include <glm/common.hpp>
#include <glm/geometric.hpp>

#include "host/body/canonical.h"
#include "host/body/mesh_distance.h"
#include "host/input_error.h"

namespace arah {
namespace {

constexpr size_t pool_size = 1 << 15;
constexpr double near_deviation = 0.04;      // metres: nine in ten points within 7 cm
constexpr double around_deviation = 0.03;    // metres
constexpr double volume_margin = 0.15;       // metres
constexpr double off_surface_distance = 0.20;  // metres (the paper's 20 cm)
constexpr double inside_depth = 0.01;          // metres (the paper's 1 cm)

class Sampler {
 public:
  Sampler(const Avatar& avatar, uint64_t seed)
      : avatar_(avatar), vertices_(canonical_vertices(avatar.body, avatar.canonical)), distance_(vertices_, avatar.body.triangles), generator_(seed) {
    std::vector<double> areas;
    for (const glm::uvec3& t : avatar.body.triangles)
      areas.push_back(glm::length(glm::cross(vertices_[t.y] - vertices_[t.x], vertices_[t.z] - vertices_[t.x])));
    triangle_ = std::discrete_distribution<uint32_t>(areas.begin(), areas.end());
    lower_ = upper_ = vertices_.front();
    for (const glm::dvec3& v : vertices_) lower_ = glm::min(lower_, v), upper_ = glm::max(upper_, v);
  }

  std::vector<WeightSample> draw_surface() {
    std::vector<WeightSample> samples;
    for (size_t i = 0; i < pool_size; ++i) samples.push_back(surface_point());
    return samples;
  }

  TemplateSamples draw() {
    TemplateSamples samples;
    for (size_t i = 0; i < pool_size; ++i) {
      const WeightSample on = surface_point();
      samples.surface.push_back(on);
      const glm::dvec3 off = glm::dvec3(on.position) + normal_vector(around_deviation);
      samples.around.push_back(weights_at(distance_.closest(off), off));
      const glm::dvec3 p = glm::dvec3(surface_point().position) + normal_vector(near_deviation);
      samples.near.push_back({p, static_cast<float>(distance_.closest(p).signed_distance)});
      const glm::dvec3 q = uniform_between(lower_ - volume_margin, upper_ + volume_margin);
      samples.volume.push_back({q, static_cast<float>(distance_.closest(q).signed_distance)});
    }
    fill(samples.off_surface, [&] {
      const glm::dvec3 p = avatar_.cube.from_cube(uniform_between(glm::dvec3(-1), glm::dvec3(1)));
      return std::pair(p, distance_.closest(p).signed_distance > off_surface_distance);
    });
    fill(samples.inside, [&] {
      const glm::dvec3 p = glm::dvec3(surface_point().position) + normal_vector(0.08);
      const ClosestPoint closest = distance_.closest(p);
      return std::pair(p, closest.signed_distance < -inside_depth && !in_hand(closest));
    });
    return samples;
  }

 private:
  glm::dvec3 normal_vector(double deviation) {
    std::normal_distribution<double> normal(0, deviation);
    const double x = normal(generator_), y = normal(generator_), z = normal(generator_);
    return {x, y, z};
  }
  glm::dvec3 uniform_between(const glm::dvec3& low, const glm::dvec3& high) {
    std::uniform_real_distribution<double> unit(0, 1);
    const double x = unit(generator_), y = unit(generator_), z = unit(generator_);
    return low + (high - low) * glm::dvec3(x, y, z);
  }

  WeightSample surface_point() {
    const uint32_t t = triangle_(generator_);
    std::uniform_real_distribution<double> unit(0, 1);
    const double root = std::sqrt(unit(generator_)), v = unit(generator_);
    const glm::dvec3 barycentric(1 - root, root * (1 - v), root * v);  // uniform by area
    const glm::uvec3 corners = avatar_.body.triangles[t];
    const glm::dvec3 position = barycentric.x * vertices_[corners.x] + barycentric.y * vertices_[corners.y] + barycentric.z * vertices_[corners.z];
    return weights_at({0, position, t, barycentric}, position);
  }

  // The four largest of the interpolated weights, made to sum to 1.
  WeightSample weights_at(const ClosestPoint& closest, const glm::dvec3& position) const {
    std::array<double, 256> sum{};
    const glm::uvec3 corners = avatar_.body.triangles[closest.triangle];
    for (int corner = 0; corner < 3; ++corner)
      for (int k = 0; k < 4; ++k) sum[avatar_.body.joints[corners[corner]][k]] += closest.barycentric[corner] * avatar_.body.weights[corners[corner]][k];
    std::array<uint8_t, 256> order;
    std::iota(order.begin(), order.end(), uint8_t(0));
    std::partial_sort(order.begin(), order.begin() + 4, order.end(), [&](uint8_t a, uint8_t b) { return sum[a] != sum[b] ? sum[a] > sum[b] : a < b; });
    WeightSample sample;
    sample.position = position;
    double total = 0;
    for (size_t k = 0; k < 4; ++k) total += sum[order[k]];
    for (size_t k = 0; k < 4; ++k) {
      sample.joints[k] = sum[order[k]] > 0 ? order[k] : uint8_t(0);
      sample.weights[static_cast<int>(k)] = static_cast<float>(sum[order[k]] / total);
    }
    return sample;
  }

  bool in_hand(const ClosestPoint& closest) const {
    const WeightSample at = weights_at(closest, closest.position);
    return avatar_.body.skeleton.names[at.joints[0]].find("hand") != std::string::npos;
  }

  // Draws until the pool is full; gives up where hardly any point is accepted.
  template <typename Draw>
  void fill(std::vector<glm::vec3>& pool, const Draw& draw) {
    const size_t most = 40 * pool_size;
    for (size_t tries = 0; tries < most && pool.size() < pool_size / 2; ++tries) {
      const auto [position, accepted] = draw();
      if (accepted) pool.emplace_back(position);
    }
    if (pool.size() < 256)
      throw InputError("template", "triangles", "a closed surface with an inside of some centimetres", "hardly any point that is clearly inside or outside",
                       "Check that the mesh is closed, faces outward and is in metres.");
  }

  const Avatar& avatar_;
  std::vector<glm::dvec3> vertices_;
  MeshDistance distance_;
  std::mt19937_64 generator_;
  std::discrete_distribution<uint32_t> triangle_;
  glm::dvec3 lower_, upper_;
};

}  // namespace

std::vector<WeightSample> draw_weight_samples(const Avatar& avatar, uint64_t seed) { return Sampler(avatar, seed ^ 0x3b97f1e4ull).draw_surface(); }

TemplateSamples draw_template_samples(const Avatar& avatar, uint64_t seed) { return Sampler(avatar, seed ^ 0x7e3a91c5ull).draw(); }

}  // namespace arah
