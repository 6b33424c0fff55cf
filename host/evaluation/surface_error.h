// How far an avatar's surface is from a capture's true one, where the capture has it: a field that scores well in pictures and
// is rough is no gain.
#pragma once

#include <functional>
#include <glm/vec4.hpp>
#include <optional>
#include <string>
#include <vector>

#include "host/avatar/avatar.h"
#include "host/capture/capture.h"
#include "kernels/vulkan/device.h"

namespace arah {

// What is compared.
struct SurfaceSettings {
  double cell = 0.003;        // metres, of the avatar's mesh (MeshExtraction)
  bool largest_part = false;  // of the avatar's mesh the largest connected part alone, as ARAH's authors do; else without parts of less than 1 % of it
  // Both surfaces end at the plane a x + b y + c z + d = 0 of the world: what lies where the sum is negative is cut off. The authors
  // take away so the floor that true surfaces of theirs stand on.
  std::optional<glm::dvec4> ground;
};

// Mean and percentile: from the true surface to the avatar's: the distances of its vertices, hair left out, to the nearest place of the
// posed mesh. The others are those of mesh_metrics.h between the avatar's posed mesh and the whole true one, hair (open sheets in
// captures that have any) and all.
struct SurfaceError {
  int frame = 0;
  double mean = 0, percentile_95 = 0;  // metres
  double chamfer = 0;                  // mean of both directions, m²
  double normal_consistency = 0;       // mean of both directions, -1..1
  double normal_consistency_of_the_paper = 0;  // as ARAH's authors compute it, 1 at most (mesh_metrics.h)
  double f_score = 0;                  // within 5 mm, 0..1
};

// Of every frame of the split that has a mesh (meshes/<split>_<frame>.ply in the capture). Throws InputError where there is
// none, or one that is not what captures hold, or nothing above the ground: binary little-endian, float x y z a vertex, and faces of a list of int and one
// uchar `part` (3: hair).
std::vector<SurfaceError> surface_errors(Device& device, const Avatar& avatar, const Capture& capture, const std::string& split, const SurfaceSettings& settings = {},
                                         const std::function<void(double)>& progress = {});

// Whether a frame of that split has such a mesh.
bool has_surface(const Capture& capture, const std::string& split);

// "surface: 4.10 mm in the mean, 95 % within 11.00 mm, Chamfer 0.42 cm², normals 0.931, F-score 0.812 at 5 mm (6 meshes)".
std::string describe(const std::vector<SurfaceError>& errors);

// The mean over the frames of one of the figures above.
double mean_of(const std::vector<SurfaceError>& errors, double SurfaceError::*figure);

}  // namespace arah
