// How far an avatar's surface is from a capture's true one, where the capture has it: a field that scores well in pictures and
// is rough is no gain.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "host/avatar/avatar.h"
#include "host/capture/capture.h"
#include "kernels/vulkan/device.h"

namespace arah {

// From the true surface to the avatar's: the distances of its vertices, hair left out, to the nearest place of the posed mesh.
struct SurfaceError {
  int frame = 0;
  double mean = 0, percentile_95 = 0;  // metres
};

// Of every frame of the split that has a mesh (meshes/<split>_<frame>.ply in the capture). Throws InputError where there is
// none, or one that is not what captures hold: binary little-endian, float x y z a vertex, and faces of a list of int and one
// uchar `part` (3: hair).
std::vector<SurfaceError> surface_errors(Device& device, const Avatar& avatar, const Capture& capture, const std::string& split,
                                         const std::function<void(double)>& progress = {});

// Whether a frame of that split has such a mesh.
bool has_surface(const Capture& capture, const std::string& split);

// "surface: 4.1 mm in the mean, 95 % within 11.0 mm (6 meshes)".
std::string describe(const std::vector<SurfaceError>& errors);

}  // namespace arah
