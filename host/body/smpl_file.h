// Bodies of the SMPL family from the files that their users hold: SMPL, SMPL-H and SMPL-X as .npz, or as .pkl through the
// restricted reader. None is shipped with the program.
#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "host/body/body_template.h"

namespace arah {

struct SmplBody {
  BodyTemplate body;               // with SMPL's joint names; `glb` holds the file to write
  std::vector<std::string> notes;  // what the rig cannot hold of the model, in sentences
};

// Whether the file's name says that it is such a file (.npz, .pkl).
bool is_smpl_file(const std::filesystem::path& path);

// How many directions of the shape are kept: those that fits of the family state.
inline constexpr std::size_t kSmplShapes = 10;

// The model in the shape `betas` (the first coefficients; all others are 0): vertices v_template + shapedirs betas, joints
// J_regressor times these, each vertex's four largest weights, made to sum to 1. The first kSmplShapes directions, or as many
// as the file has, are body.shape ("beta_0", …) with the joints' through J_regressor, at β = betas; what `betas` says of others
// is in the base. Normals are of the mesh in that shape.
//
// Pose blend shapes (posedirs) displace SMPL's mesh by a linear function of each pose's R_1 − I, R_2 − I, …; a rig here moves by
// linear skinning alone. Of them the mesh at rest gets the mean over `poses` (axis-angles of all joints, the root's first, of
// the frames that the body is for): of all meshes that do not change with the pose it is the nearest to theirs, in the sense of
// least squares at rest. The canonical mesh then has them too, as ARAH's has those of each frame. Joints stay. A note
// says in millimetres what is left out. Without poses, or where they have other joints than the model, all is left out.
//
// Throws InputError naming file and field: missing or of other shapes than the family's, numbers that are not finite, more betas
// than the file has, faces or weights that make no rig.
SmplBody read_smpl_body(const std::filesystem::path& path, std::span<const double> betas = {},
                        std::span<const std::vector<glm::dvec3>> poses = {});

}  // namespace arah
