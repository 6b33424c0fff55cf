// The subject of a synthetic capture: a procedurally built person in clothes, or any skinned rig dressed by offsetting
// its surface.
#pragma once

#include <array>
#include <cstdint>
#include <glm/glm.hpp>
#include <vector>

#include "host/body/body_template.h"
#include "host/body/pose.h"
#include "host/capture/figure_variation.h"

namespace arah {

// What a piece of the rendered surface is made of.
enum class FigureLayer : std::uint8_t { kSkin, kShirt, kShorts, kShoes, kHair, kRigBody, kRigGarment };

// The `part` number of a layer in a ground-truth mesh: 0 skin, 1 garment, 2 shoes, 3 hair.
int ground_truth_part(FigureLayer layer);

// One way that a vertex of a garment folds: rings about a bone, driven by how far a joint is bent.
struct Fold {
  int joint = 0;       // whose rotation drives it
  float strength = 0;  // 0..1, falls off with the distance from the joint
  float phase = 0;     // radians, the place along the bone
};

// A clothed figure at rest. `body` is the naked template; the surface is what a camera sees: uncovered skin and the
// garment sheets, several open sheets in one list of triangles. All arrays of the surface have one entry a vertex [V];
// metres, +Y up, +Z forward.
struct ClothedFigure {
  BodyTemplate body;
  double scale = 1;             // size relative to a person of 1.74 m: lengths of folds, offsets and patterns follow it
  double middle_height = 0.93;  // m above the ground, where cameras look
  double camera_distance = 3;   // m, from which the whole figure is in view, arms overhead
  Stretch stretch;              // of the average build's places to this one's

  std::vector<glm::vec3> rest;
  std::vector<glm::vec3> normals;
  std::vector<FigureLayer> layers;
  std::vector<glm::vec3> tint;  // colour of the rig's part, white for the built-in figure
  std::vector<glm::u8vec4> joints;
  std::vector<glm::vec4> weights;
  std::vector<float> looseness;  // 0: moves by skinning alone; 1: hangs free (a hem)
  std::vector<std::array<Fold, 3>> folds;
  std::vector<std::uint8_t> under_cloth;  // 1: another sheet lies over it at rest
  std::vector<glm::uvec3> triangles;

  // Where a place of the surface at rest is on a figure of average build and 1.74 m.
  glm::vec3 average_place(const glm::vec3& place) const {
    const glm::vec3 p = place / static_cast<float>(scale);
    return stretch.none() ? p : glm::vec3(stretch.to_average(glm::dvec3(p)));
  }
};

// The built-in person: 24 joints with SMPL's names and tree in a T-pose, about 1.74 m tall; t-shirt, shorts, shoes,
// hair. The seed varies the build by a few per cent, `variation` build and clothes by more. Takes about a second.
ClothedFigure make_clothed_figure(std::uint64_t seed, const FigureVariation& variation = {});

// The built-in person's body with its shape: morph targets height, arm_length, leg_length and trunk_length, of each of which
// a unit is 10 % of what `build` (the one that the figure was made with) has. They move the body's own vertices, and the
// joints, as a body of that build would have them.
BodyTemplate body_with_shape(const ClothedFigure& figure, const Build& build);

// Dresses a rig: its own surface plus a garment sheet 12 mm (times scale) above it around torso and limbs' roots (rigs
// with SMPL's names) or the upper 55 % of its height (other rigs).
ClothedFigure dress_rig(BodyTemplate rig);

// A rig as it is: its own surface, which moves by skinning alone.
ClothedFigure undressed_rig(BodyTemplate rig);

struct PosedSurface {
  std::vector<glm::vec3> positions;  // [V] world, metres
  std::vector<glm::vec3> normals;    // [V] unit length
};

// The surface in `pose`, in the world (+Z up). Skin follows linear blend skinning; garments add, by looseness:
//   folds     along the normal, up to 14 mm for each driving joint, growing with its bend;
//   gravity   up to 45 mm (for a right angle) from where the garment hangs at rest towards where it hangs now;
//   lag       against the velocity between `previous_pose` and `pose` (`seconds` apart, > 0), saturating at 30 mm;
// none of which moves a garment further into the body than a fraction of the gap between them.
PosedSurface pose_surface(const ClothedFigure& figure, const Pose& pose, const Pose& previous_pose, double seconds);

// The vertices of the surface by skinning alone, in the world.
std::vector<glm::vec3> skinned_surface(const ClothedFigure& figure, const Pose& pose);

}  // namespace arah
