// Bodies alike in their joints and different in shape: what a prior is learned from (ARAH.md section 10).
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "host/body/canonical.h"
#include "host/capture/resting_arms.h"
#include "host/capture/synthetic_figure.h"

namespace arah {

struct FamilyMember {
  std::string name;  // its file, or "body 3"
  ClothedFigure figure;
};

struct BodyFamily {
  std::vector<FamilyMember> members;  // at least one; all with the joint names and parents of the first
  std::string description;            // JSON: {"kind": "generated", "bodies", "first_seed", "arms" where they are not the T-pose's} or {"kind": "folder", "files"}

  const Skeleton& skeleton() const { return members.front().figure.body.skeleton; }
};

// The built-in figure in `bodies` builds and wardrobes: varied_figure(first_seed), … Takes about a second a body and
// processor; progress: how many are made; return false to stop (throws std::runtime_error "stopped"). arms: how they rest;
// the built-in figure's T-pose without.
BodyFamily generated_family(std::size_t bodies, std::uint64_t first_seed, const std::function<bool(std::size_t)>& progress = {}, const std::optional<RestingArms>& arms = {});

// The arms that a generated family's description states; none for the T-pose and other families.
std::optional<RestingArms> described_arms(const std::string& description);

// The .glb and .gltf files of a folder, in the order of their names, as they are. Throws InputError: no such folder, no
// such file in it, a file that cannot be read, or one whose joints are not those of the first (named with the joint).
BodyFamily family_from_folder(const std::filesystem::path& folder);

// A surface in the canonical pose. Normals are of unit length, outward.
struct CanonicalSurface {
  std::vector<glm::dvec3> vertices, normals;
  std::vector<glm::uvec3> triangles;
};

// The figure's visible surface at rest, taken to the canonical pose: Σ_b w_b V_b x.
CanonicalSurface canonical_surface(const ClothedFigure& figure, const CanonicalPose& canonical);

// The figure's visible surface in `pose` (with folds, gravity, and lag behind `previous_pose`, `seconds` before), brought
// back by the weights that the template gives it: x̂ = (Σ_b w_b B_b)⁻¹ (x̄ − t). What is left of the pose is what a
// pose-conditioned SDF has to learn. Triangles at vertices whose blended transform is flattened to a tenth are left out.
CanonicalSurface canonical_surface(const ClothedFigure& figure, const CanonicalPose& canonical, const Pose& pose,
                                   const Pose& previous_pose, double seconds);

// A member in a pose: the unit that a pose-dependent SDF learns from.
struct FamilyScan {
  std::size_t member = 0;
  Pose pose;
  CanonicalSurface surface;
};

// `poses` poses of a member, spread evenly over the training motion, another part of it for each member. shift: of all of them,
// as a part of their spacing: with 0.5 those halfway between.
std::vector<Pose> member_poses(const BodyFamily& family, std::size_t member, std::size_t poses, std::uint64_t seed, double shift = 0);

// Scans of each member in its member_poses; one at rest of a member whose surface moves by skinning alone. By member, then by
// pose.
std::vector<FamilyScan> family_scans(const BodyFamily& family, std::size_t poses, std::uint64_t seed, double shift = 0);

}  // namespace arah
