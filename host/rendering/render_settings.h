// What a picture may cost: every knob by name, its exact value and what is given up for speed (docs/decisions/render-presets.md).
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "host/avatar/avatar.h"
#include "host/rendering/ray_samples.h"
#include "kernels/linear/arithmetic.h"

namespace arah {

// The knobs, each with its exact value in brackets:
//   sampling_mode [as the avatar was trained]  shell, surface, surface_only, uniform: where a ray is sampled
//   samples [32 in the shell, 64 around surfaces or in the whole box, 1 on surfaces]  of a ray
//   around_surface, before_surface [17, 16]  of the samples of a ray that hits a surface: within half_width of it, and in front
//   half_width [0.05]  metres; half_width_b [0]: in units of b if above 0, where that is less
//   surface [search]  search, mesh: where the surface comes from that the modes surface and surface_only ask for
//   outline [0]  mesh: drawn this many b farther out
//   distances [network]  network, baked: of samples; baked ones are interpolated in a grid that is made once for each code and, where the SDF follows it, pose
//   sdf_by_pose [frame]  frame, shared: where the SDF follows the pose, that of the frame, or the one that all poses share, of
//     which what is baked stays good for every pose
//   bake_cell [0.006]  metres between the nodes of that grid, which the mesh is made of too
//   shell_bound [true]  surface, uniform: samples farther than 5.5 cm from the template are empty without a look
//   trace_start [box]  box, shell: where sphere tracing begins, the body's box or the template's shell (5.5 cm)
//   trace_tolerance [1e-5]  metres, of the distance at which sphere tracing leaves the rest to the joint search
//   root_tolerance [1e-5]  metres, of a correspondence's residual
//   root_max_iterations [50]  of a correspondence's search
//   root_initialisations [1]  2 to 8: starts of a correspondence's search, the least distance of their roots is kept
//   root_rescue_steps [0]  of damped Newton with the exact Jacobian, for points whose search found no root, from each start
//   root_rescue_bones [2]  of these starts: so many nearest bones, after the best place so far
//   root_correspondence [search]  search_from_grid, grid, grid_alone: what the frame's grid of roots is good for
//   color_groups [0]  0: a colour for each sample; else one for each of so many groups of equal weight of a ray's samples
//   least_weight [0]  samples whose compositing weight is at most this stay black
//   arithmetic [float32]  half_storage, cooperative_matrix: of the networks that give the samples' distances and colours
//   pixel_step [1]  every so-many-th pixel of a row and column is computed, those between are interpolated
struct RenderSettings {
  std::optional<SamplingSettings> sampling;  // none: picture_sampling of the avatar
  bool baked_distances = false;
  bool shared_sdf = false;
  double bake_cell = 0.006;  // metres
  double outline = 0;        // in units of b, the scale of the density
  uint32_t color_groups = 0;
  double half_width_b = 0;   // of SamplingSettings::half_width in units of b; 0: that stands
  double least_weight = 0;
  int pixel_step = 1;  // 1 to 16
  Arithmetic arithmetic = Arithmetic::float32;
  bool normals = false;
  bool inspect = false;  // Picture::inspection too; the picture stays the same
  // Of activations, about: decides how many rays are rendered at a time, fewer where the device's memory ceiling asks for it.
  uint64_t memory_bytes = 300'000'000;
  uint32_t most_rays = 65536;  // at a time, whatever the memory holds: a picture can be stopped between them
};

// How pictures of an avatar are sampled exactly: as it was trained (`sampling_mode` and `rendering` of its settings): 64
// samples in the paper's places or evenly over the box, or one on the surface; else 32 in the template's shell.
SamplingSettings picture_sampling(const Avatar& avatar);

// "paper": exact to 1e-6 of a colour. "balanced": less than can be seen. "fast": a glance. "preview": while the camera moves. A density (FieldKind) is
// asked itself in "balanced" and "fast", and has no "preview": the renderer refuses it. Throws InputError
// naming the presets for another word.
RenderSettings render_preset(const Avatar& avatar, const std::string& name);
const std::vector<std::string>& render_presets();

std::vector<std::string> render_knobs();  // their names
// One knob by name, its value as text. Throws InputError naming the knob: unknown, or a value that it does not take.
void set_render_knob(RenderSettings& settings, const std::string& name, const std::string& value);
// The settings as {"samples": 32, …}: knobs alone.
std::string render_settings_json(const RenderSettings& settings);

}  // namespace arah
