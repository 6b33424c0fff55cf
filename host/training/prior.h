// A prior: networks that were pre-trained on a family of bodies, for a training to start from. One .safetensors with the
// tensors "sdf.*", "skinning.*" and, where its SDF follows the pose, "pose_code.*", "hyper.*" and "low_rank.*" or "hyper_last.*"
// under an avatar's names and shapes, and in the metadata "arah_prior" (the format's
// number), "version", "spec" (prior_spec), "settings" (pretrain_settings.h), "seed", "family" (BodyFamily::description) and
// "joints" {names, parents, places}. What continuing needs lies beside them (Reptile::save) and is ignored here.
#pragma once

#include <filesystem>
#include <string>

#include "host/avatar/avatar.h"
#include "host/avatar/safetensors.h"
#include "host/training/pretrain_settings.h"

namespace arah {

struct Prior {
  AvatarSpec spec;
  PretrainSettings settings;
  std::string family;                    // JSON
  std::vector<std::string> joint_names;
  std::vector<int> joint_parents;
  std::vector<glm::dvec3> joint_places;  // canonical, in the cube, mean over the family; empty in files from before there were any
  std::string version;                   // of the program that made it
  SafetensorsFile file;
};

// Whether a prior keeps this tensor of an avatar.
bool of_prior(const TensorSlot& slot);

// avatar: of prior_spec and with a body of the family. joint_places: as in Prior.
SafetensorsFile prior_tensors(const Avatar& avatar, const PretrainSettings& settings, const std::string& family, const std::vector<glm::dvec3>& joint_places);

// Where the canonical joints of an avatar's body lie in its cube.
std::vector<glm::dvec3> joint_places(const Avatar& avatar);

// Throws InputError naming file and field: not a prior, a newer format, a field missing or malformed.
Prior read_prior(const std::filesystem::path& path);

// The avatar's cube depends on how the vertices of its template are spread, which differs from mesh to mesh: x ↦ s x + t takes its
// joints to the family's places, in the sense of least squares, and the networks become the prior's of s x + t, distances
// divided by s, by changes of their first layers and the SDF's last one.
// The avatar's SDF and, where it has one, its skinning network become the prior's. Throws InputError naming the file and
// what does not fit: a size of a network (as "sdf.width"), omega, the number of joints or the joint whose name or parent
// differs, a tensor that is missing or not finite.
// The pose networks, too, where both have them in the same sizes; else the avatar's begin at zero, as without a prior. Says
// which, in words; empty where neither SDF follows the pose.
std::string start_from_prior(Avatar& avatar, const Prior& prior);

}  // namespace arah
