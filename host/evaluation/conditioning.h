// How well conditioned an avatar's skinning is in a pose: what the Jacobian J = ∂LBS/∂x does to the surface, and how the search for
// canonical correspondences fares around it. Skinning folds where det J < 0; where J is nearly singular a posed point says little about its
// canonical one, and the gradients through the search, g = −J⁻ᵀ dL/dx, are as much larger, up to 100 times (docs/decisions/singular-jacobians.md).
#pragma once

#include <array>
#include <glm/mat3x3.hpp>
#include <glm/vec3.hpp>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "host/evaluation/mesh_extraction.h"
#include "host/rendering/forward_skinning.h"
#include "host/rendering/root_finder.h"

namespace arah {

struct ConditioningSettings {
  double cell = 0.008;         // metres: MeshSettings::cell
  std::size_t samples = 8000;  // points of the shell, about
  double reach = 0.02;         // metres: they lie at the posed surface and so far and half so far in front of it and behind
  uint32_t bone_starts = 4;    // of the search for several roots: the nearest so many bones' beside the nearest vertex'
  uint32_t max_iterations = 50;  // of Broyden's method (ARAH.md section 5)
  float tolerance = 1e-5f;       // metres
  uint32_t rescue_steps = 30;    // of damped Newton, where Broyden's method finds no root (root_rescue.h)
};

// Below this σ_min a Jacobian counts as nearly singular: gradients through the search grow tenfold.
inline constexpr double nearly_singular = 0.1;
// Roots of one point that are farther apart than this are two, metres: a hundred tolerances.
inline constexpr double roots_apart = 1e-3;

// Singular values, greatest first; not finite where the matrix is not.
std::array<double, 3> singular_values(const glm::dmat3& matrix);

// Of one pose. Shares are of 1; a mean or share of nothing is 0.
struct ConditioningFigures {
  int frame = 0;

  // Over the mesh's vertices.
  std::size_t vertices = 0;
  double least_singular = 0, median_singular = 0;  // of σ_min
  double greatest_singular = 0;                    // of σ_max: the stretch
  double nearly_singular_share = 0, folded_share = 0, bad_share = 0;  // σ_min < nearly_singular; det J < 0; either
  double eikonal = 0;  // mean of ||∇f| − 1|

  // Over the shell's points, what Broyden's method did from the nearest vertex.
  std::size_t samples = 0, found = 0;
  std::size_t refused = 0, diverged = 0, exhausted = 0;  // no start (singular or not finite); a residual out of bounds; out of steps
  std::size_t rescued = 0;  // of these, found by damped Newton
  std::vector<std::size_t> steps;  // [max_iterations + 1]: found after so many

  // Of all starts together.
  double several_share = 0;       // points with roots farther apart than roots_apart
  double several_near_share = 0;  // points with several of them within 2 · reach of the surface: parts that meet, or a fold

  // At the roots of the shell.
  double shell_eikonal = 0;
  double amplified_share = 0, greatest_amplification = 0;  // of 1 / σ_min, the most that g may be larger than dL/dx: above 10; the greatest
  std::size_t untaught = 0;  // |det J| below what float32 tells from 0: g is 0 (kernels/skinning/implicit_cotangent.h)

  std::size_t unfound() const { return samples - found; }  // by Broyden's method
  std::size_t unsolved() const { return samples - found - rescued; }
};

struct ExaminedPose {
  ConditioningFigures figures;
  std::vector<glm::vec3> vertices;  // world, metres
  std::vector<glm::uvec3> triangles;
  std::vector<float> singular, determinants;  // by vertex: σ_min, det J
  std::vector<glm::vec3> unsolved;  // world, metres: points of the shell without a root, by Broyden's method and the rescue
};

class Conditioning {
 public:
  // Throws InputError for an avatar without a surface, or whose skinning is not a network: no other has a Jacobian to look at or
  // a correspondence to search.
  Conditioning(Device& device, const Avatar& avatar, const ConditioningSettings& settings);

  // The same pose gives the same points and figures. frame is noted.
  ExaminedPose examine(const Pose& pose, std::size_t latent_row, int frame);

 private:
  struct Skinned {
    std::vector<glm::dvec3> posed;  // without the root translation
    std::vector<glm::dmat3> jacobians;
  };
  Skinned skinned(const std::vector<glm::vec3>& canonical);
  // f in metres and |∇f|.
  struct Distance {
    double f, slope;
  };
  std::vector<Distance> distances(const std::vector<glm::vec3>& canonical);
  std::vector<glm::vec3> search(const std::vector<glm::vec3>& targets, ConditioningFigures& figures, std::vector<char>& found);

  Device& device_;
  const Avatar& avatar_;
  ConditioningSettings settings_;
  RootFindingSettings search_;
  Commands commands_;
  MeshExtraction extraction_;
  ForwardSkinning skinning_;
  SirenTape sdf_tape_;
  PointRootFinder finder_;
  Buffer points_, roots_;
};

// The figures of all poses, with the avatar's b: conditioning.json.
nlohmann::ordered_json conditioning_json(const Avatar& avatar, const ConditioningSettings& settings, const std::vector<ConditioningFigures>& poses);

// One line on a pose.
std::string describe(const ConditioningFigures& figures);

}  // namespace arah
