// The naked body of the built-in synthetic figure, as joined tapered capsules, one or more a joint.
#pragma once

#include <cstdint>
#include <glm/glm.hpp>
#include <vector>

#include "host/body/body_template.h"
#include "host/body/skeleton.h"
#include "host/capture/figure_variation.h"
#include "host/capture/implicit_surface.h"

namespace arah {

// Where a muscle belongs: the legs blend into the trunk but not into each other.
enum class Limb : std::uint8_t { kTrunk, kLeftLeg, kRightLeg };

struct Muscle {
  TaperedCapsule shape;
  int joint = 0;  // the joint that moves it
  Limb limb = Limb::kTrunk;
  double blend = 0.03;  // m, width of the smooth union with what is there already
  bool shirt = false, shorts = false, shoe = false, hair = false;  // whether the garment wraps it
};

struct Anatomy {
  Skeleton skeleton;  // SMPL's 24 names and tree, T-pose, root 0.93 m above the ground
  std::vector<Muscle> muscles;
};

// The seed varies height (+-3 %) and girth (+-5 %); seed 0 is the average build. `variation` comes on top.
Anatomy make_anatomy(std::uint64_t seed, const FigureVariation& variation = {});

// The smooth union of some of the muscles, swollen by `offset` metres; `blend_factor` scales every muscle's blend.
// At least one must be given.
ImplicitField muscle_union(const std::vector<Muscle>& muscles, double blend_factor);

// The box around some muscles, grown by `margin` metres on all sides.
struct Box {
  glm::dvec3 low, high;
};
Box bounds(const std::vector<Muscle>& muscles, double margin);

// The body's mesh with normals and skinning weights (glb empty): every vertex starts with the joint of its nearest
// muscle, and weights diffuse over the surface, so that joints bend over some 6 cm.
BodyTemplate make_body(const Anatomy& anatomy);

// Averages weights with those of neighbours, `rounds` times, and keeps the four largest of each vertex. weights: [V]
// [J].
void diffuse_weights(std::vector<std::vector<float>>& weights,
                     const std::vector<std::vector<std::uint32_t>>& neighbours, int rounds);

// The four largest weights of each vertex, normalised to sum 1.
void keep_four(const std::vector<std::vector<float>>& weights, std::vector<glm::u8vec4>& joints,
               std::vector<glm::vec4>& kept);

}  // namespace arah
