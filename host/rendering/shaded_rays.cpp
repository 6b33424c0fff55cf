#include "host/rendering/shaded_rays.h"

#include "kernels/color/posed_normals.h"
#include "kernels/compositing/forward.h"
#include "kernels/compositing/group_samples.h"

namespace arah {

ShadedRays::ShadedRays(Device& device, AvatarNetworks& networks, uint32_t rays, uint32_t samples, bool with_gradients, bool normals)
    : networks_(networks), field_(device, networks, rays * samples, samples, with_gradients), queue_(device, rays * samples) {
  const uint64_t ray_room = padded_points(rays), rows = padded_points(rays * samples);
  auto make = [&](const char* what, uint64_t bytes) { return Buffer(device, std::string("rays: ") + what, bytes, BufferPlace::device); };
  colors_ = make("colours", ray_room * 16);
  ray_depths_ = make("depths", ray_room * 4);
  weights_ = make("weights", rows * 4);
  transmittances_ = make("transmittances", rows * 4);
  if (!normals) return;
  normals_ = make("normals of samples", rows * 16);
  composited_normals_ = make("normals", ray_room * 16);
  unused_depths_ = make("depths, again", ray_room * 4);
}

void ShadedRays::record_forward(Commands& commands, FrameOnDevice& frame, RaySamples& placed, uint32_t rays, const Options& options) {
  const uint32_t rows = placed.rows(rays);
  commands.stage("distances");
  CompositeForwardArgs composite;
  composite.samples.rays = rays;
  composite.samples.samples = placed.samples();
  if (placed.opaque()) composite.samples.sdf = field_.opaque_distances();
  else if (options.baked) composite.samples.sdf = field_.record_distances(commands, placed.canonical(), rows, *options.baked);
  else composite.samples.sdf = field_.record_distances(commands, frame.constants(), placed.canonical(), rows, placed.has_gaps());
  composite.samples.metres_per_unit = static_cast<float>(networks_.cube().metres_per_unit());
  composite.samples.points = placed.canonical();
  composite.samples.deltas = placed.deltas();
  composite.samples.parameters = networks_.parameters();
  composite.samples.scale_index = networks_.deviation_index();
  composite.delta_mode = placed.delta_mode();
  composite.depths = placed.depths();
  composite.colors = colors();
  composite.ray_depths = ray_depths();
  composite.weights = weights_.slice();
  composite.transmittances = transmittances();
  composite.flags = queue_.flags();
  composite.least_weight = static_cast<float>(options.least_weight);
  commands.stage("compositing");
  record_composite_forward(commands, composite);
  if (options.groups) {
    GroupSamplesArgs group;
    group.rays = rays;
    group.samples = placed.samples();
    group.groups = options.groups;
    group.least_weight = composite.least_weight;
    group.weights = composite.weights;
    group.points = placed.canonical();
    group.flags = composite.flags;
    record_group_samples(commands, group);
  }
  queue_.select(commands, rows, placed.canonical());

  commands.stage("shading");
  inputs_ = {frame.constants(), queue_.canonical(), placed.rays(), queue_.size(), {}, queue_.samples(), rows};
  if (options.normals || networks_.spec().color.normal)
    inputs_.transforms = placed.root_finder().record_transforms(commands, frame, {{inputs_.rows, {}}, queue_.samples()}, queue_.canonical());
  field_.record_forward(commands, inputs_, options.normals);
  composite.delta_mode = DeltaMode::given;  // written by now
  composite.samples.rgb = field_.rgb();
  composite.samples.slots = queue_.slots();
  composite.samples.slot_count = queue_.size();
  composite.samples.groups = options.groups > 0;
  composite.flags = {};
  commands.stage("compositing");
  record_composite_forward(commands, composite);
  composited_ = composite.samples;
  if (!options.normals) return;
  record_posed_normals(commands, {inputs_.rows, field_.gradient(), inputs_.transforms, normals_.slice(), true});
  composite.samples.rgb = {normals_.slice(), 4, 0};  // Σ w n: compositing is linear in its colours
  composite.colors = composited_normals_.slice();
  composite.ray_depths = unused_depths_.slice();
  record_composite_forward(commands, composite);
}

}  // namespace arah
