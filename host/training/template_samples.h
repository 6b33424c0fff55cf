// Points around the canonical template that training compares its fields with: distances, insides, outsides, weights.
// Drawn once; every batch picks from these pools (ARAH.md §7, "Sampling of regulariser points").
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include <glm/vec3.hpp>
#include <glm/vec4.hpp>

#include "host/avatar/avatar.h"

namespace arah {

struct DistanceSample {
  glm::vec3 position{0.0f};    // canonical metres
  float signed_distance = 0;   // to the template, metres, negative inside
};

// A point whose skinning weights the template gives: at most four joints, the weights of the closest surface point.
struct WeightSample {
  glm::vec3 position{0.0f};  // canonical metres
  std::array<uint8_t, 4> joints{};
  glm::vec4 weights{0.0f};  // ≥ 0, sum 1
};

struct TemplateSamples {
  std::vector<DistanceSample> near;     // within some centimetres of the surface
  std::vector<DistanceSample> volume;   // uniform in the template's bounds ± 15 cm
  std::vector<glm::vec3> off_surface;   // uniform in the cube, farther than 20 cm outside
  std::vector<glm::vec3> inside;        // deeper than 1 cm inside, not in a hand
  std::vector<WeightSample> surface;    // on the surface, uniform by area
  std::vector<WeightSample> around;     // off the surface by N(0, 3 cm)
};

// The points of TemplateSamples::surface alone, from another stream of the seed.
std::vector<WeightSample> draw_weight_samples(const Avatar& avatar, uint64_t seed);

// Throws InputError where the template has no inside (an open or inside-out mesh).
TemplateSamples draw_template_samples(const Avatar& avatar, uint64_t seed);

}  // namespace arah
