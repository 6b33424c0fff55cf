// The avatar's file: one .safetensors with every learned tensor under its own name and shape (ParameterLayout), the
// template as the byte tensor "template.glb", the canonical pose as "canonical.rest_to_canonical" (F64 [J, 4, 4],
// row-major), where the template has morph targets the body's shape β as "template.shape" (F64 [B], whatever the weights in
// template.glb), where poses were refined "refined.*" (refined_poses.h), and in the metadata "arah_avatar" (the format's
// number), "version", "spec", "settings", "seed", "steps", "latent_frames", "cube" {center, cmin, cmax}, "grid" {lower,
// upper, nodes} and "shape_names" (of β), each text or JSON.
#pragma once

#include <filesystem>

#include "host/avatar/avatar.h"
#include "host/avatar/safetensors.h"

namespace arah {

// The tensors and metadata of the file, to which a checkpoint may add others. Throws std::runtime_error as
// check_finite() does: an avatar that is not finite is not written.
SafetensorsFile avatar_tensors(const Avatar& avatar);

// The avatar in the file; tensors and metadata beside its own are ignored. Reading gives what was written, bit for bit.
// Throws InputError naming file and field: not an avatar, a format that is newer, a field missing, malformed or unknown
// to the spec, a tensor missing, of another shape or type or not finite (with its first such element), b not above 0, a
// template that cannot be read, a canonical pose that is not rigid.
Avatar avatar_from_tensors(const SafetensorsFile& file);

// The whole file or nothing, see write_safetensors().
void save_avatar(const std::filesystem::path& path, const Avatar& avatar);
Avatar load_avatar(const std::filesystem::path& path);

}  // namespace arah
