#include "host/rendering/shaded_rays.h"

#include <algorithm>

#include "kernels/color/posed_normals.h"
#include "kernels/compositing/forward.h"
#include "kernels/compositing/group_samples.h"

namespace arah {

ShadedRays::ShadedRays(Device& device, AvatarNetworks& networks, uint32_t rays, uint32_t samples, uint32_t shaded)
    : ShadedRays(device, networks, rays, samples, {shaded, false}, true, Arithmetic::float32) {}

ShadedRays::ShadedRays(Device& device, AvatarNetworks& networks, uint32_t rays, uint32_t samples, uint32_t shaded_at_a_time, bool normals, Arithmetic arithmetic)
    : ShadedRays(device, networks, rays, samples, {std::min(shaded_at_a_time, padded_points(rays * samples)), normals}, false, arithmetic) {}

ShadedRays::ShadedRays(Device& device, AvatarNetworks& networks, uint32_t rays, uint32_t samples, const Field::Shaded& shaded, bool with_gradients, Arithmetic arithmetic)
    : networks_(networks), field_(device, networks, rays * samples, samples, shaded, with_gradients, arithmetic), queue_(device, rays * samples) {
  const uint64_t ray_room = padded_points(rays), rows = padded_points(rays * samples);
  auto make = [&](const char* what, uint64_t bytes) { return Buffer(device, std::string("rays: ") + what, bytes, BufferPlace::device); };
  colors_ = make("colours", ray_room * 16);
  ray_depths_ = make("depths", ray_room * 4);
  weights_ = make("weights", rows * 4);
  transmittances_ = make("transmittances", rows * 4);
  if (!with_gradients && field_.shaded_capacity() < rows) rgb_ = make("colours of samples", rows * channel_padding * 4);
  if (!shaded.gradient) return;
  normals_ = make("normals of samples", rows * 16);
  composited_normals_ = make("normals", ray_room * 16);
  unused_depths_ = make("depths, again", ray_room * 4);
}

bool ShadedRays::record_forward(Commands& commands, FrameOnDevice& frame, RaySamples& placed, uint32_t rays, const Options& options) {
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
  composite.samples.parameters = networks_.parameter("b");
  composite.samples.density = networks_.spec().sdf.kind == FieldKind::density ? DensityKind::softplus : DensityKind::laplace;
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
  if (networks_.has_gradients() && queue_.size() > field_.shaded_capacity()) return false;

  commands.stage("shading");
  shade(commands, frame, placed, rows, options);
  composite.delta_mode = DeltaMode::given;  // written by now
  composite.samples.rgb = rgb();
  composite.samples.slots = queue_.slots();
  composite.samples.slot_count = queue_.size();
  composite.samples.groups = options.groups > 0;
  composite.flags = {};
  commands.stage("compositing");
  record_composite_forward(commands, composite);
  composited_ = composite.samples;
  if (!options.normals) return true;
  composite.samples.rgb = {normals_.slice(), 4, 0};  // Σ w n: compositing is linear in its colours
  composite.colors = composited_normals_.slice();
  composite.ray_depths = unused_depths_.slice();
  record_composite_forward(commands, composite);
  return true;
}

void ShadedRays::shade(Commands& commands, FrameOnDevice& frame, RaySamples& placed, uint32_t rows, const Options& options) {
  const uint32_t at_a_time = field_.shaded_capacity();
  for (uint32_t first = 0; first < queue_.size(); first += at_a_time) {
    const uint32_t count = std::min(at_a_time, queue_.size() - first);
    const uint64_t padded = padded_points(count);
    inputs_ = {frame.constants(), queue_.canonical().sub(first * 16ull, padded * 16), placed.rays(), count, {}, queue_.samples().elements(first, padded), rows};
    inputs_.view_rotation = options.view_rotation;
    if (options.normals || field_.takes_transforms(options.view_rotation.has_value()))
      inputs_.transforms = placed.root_finder().record_transforms(commands, frame, {{count, {}}, inputs_.samples}, inputs_.canonical);
    field_.record_forward(commands, inputs_, options.normals);
    if (rgb_.bytes()) commands.copy(field_.rgb().slice.elements(0, padded * channel_padding), rgb_.slice().elements(uint64_t(first) * channel_padding, padded * channel_padding));
    if (options.normals) record_posed_normals(commands, {count, field_.gradient(), inputs_.transforms, normals_.slice().sub(first * 16ull, padded * 16), true});
  }
}

}  // namespace arah
