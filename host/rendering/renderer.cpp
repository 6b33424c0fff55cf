#include "host/rendering/renderer.h"

#include <algorithm>
#include <array>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "kernels/color/posed_normals.h"
#include "kernels/compositing/forward.h"

namespace arah {
namespace {

// Rays whose activations fit the memory: floats a sample of the fields' tapes and of the root search.
uint32_t rays_at_a_time(const AvatarSpec& spec, uint32_t samples, uint64_t memory_bytes) {
  const double sdf = 4.0 * spec.sdf.sine_layers * spec.sdf.width;
  const double color = double(spec.color.hidden_layers + 2) * spec.color.width;
  const double skinning = double(spec.skinning.hidden_layers + 1) * spec.skinning.width;
  const double bytes_a_ray = 4.0 * samples * (sdf + color + skinning + 120);
  // no more than 65,536 rows, so that a matrix of 512 channels still fits the 128 MiB that every device binds at once
  const uint32_t most = 65536 / samples / 64 * 64;
  return std::clamp(static_cast<uint32_t>(double(memory_bytes) / bytes_a_ray) / 64 * 64, 64u, std::max(64u, most));
}

}  // namespace

SamplingSettings picture_sampling(const Avatar& avatar) {
  SamplingSettings sampling;
  sampling.samples = 32;
  const nlohmann::json trained = nlohmann::json::parse(avatar.settings, nullptr, false);
  if (!trained.is_object() || trained.value("sampling_mode", nlohmann::json()) != to_string(SamplingMode::surface)) return sampling;
  sampling.mode = SamplingMode::surface;
  sampling.samples = 64;
  return sampling;
}

Renderer::Renderer(Device& device, const Avatar& avatar, const RenderSettings& settings)
    : device_(device), avatar_(avatar), settings_(settings), sampling_(settings.sampling.value_or(picture_sampling(avatar))), networks_(device, avatar, false), body_(device, avatar.body), commands_(device) {
  const uint32_t rays = rays_at_a_time(avatar.spec, sampling_.samples, settings.memory_bytes), rows = rays * sampling_.samples;
  samples_.emplace(device, networks_, rays, sampling_);
  field_.emplace(device, networks_, rows, sampling_.samples, false);
  auto make = [&](const char* what, uint64_t bytes) { return Buffer(device, std::string("picture: ") + what, bytes, BufferPlace::device); };
  colors_ = make("colours", rays * 16ull);
  ray_depths_ = make("depths", rays * 4ull);
  weights_ = make("weights", rows * 4ull);
  transmittances_ = make("transmittances", rows * 4ull);
  if (!settings.normals) return;
  normals_ = make("normals of samples", rows * 16ull);
  composited_normals_ = make("normals", rays * 16ull);
  unused_depths_ = make("depths, again", rays * 4ull);
}

Picture Renderer::render(const Camera& camera, const Pose& pose, std::size_t latent_row, const std::function<bool(double)>& progress) {
  FrameOnDevice frame(device_, avatar_, body_, pose, sampling_.shell);
  networks_.record_pack(commands_, latent_row);
  commands_.submit_and_wait();

  Picture picture;
  picture.width = camera.width;
  picture.height = camera.height;
  const size_t pixels = static_cast<size_t>(camera.width) * static_cast<size_t>(camera.height);
  picture.color.assign(3 * pixels, 0);
  picture.alpha.assign(pixels, 0);
  picture.depth.assign(pixels, 0);
  if (settings_.normals) picture.normal.assign(3 * pixels, 0);

  // Pixels whose rays enter the shell, then only those in full chunks.
  std::vector<uint32_t> all, seen;
  for (int v = 0; v < camera.height; ++v)
    for (int u = 0; u < camera.width; ++u) all.push_back(static_cast<uint32_t>(u) | static_cast<uint32_t>(v) << 16);
  const uint32_t chunk = samples_->capacity_rays(), look = samples_->capacity_pixels();
  for (size_t first = 0; first < all.size(); first += look) {
    const std::vector<uint32_t> some(all.begin() + static_cast<ptrdiff_t>(first), all.begin() + static_cast<ptrdiff_t>(std::min(all.size(), first + look)));
    samples_->set_pixels(commands_, frame, camera, some);
    const std::vector<uint32_t> kept = samples_->kept_counts(static_cast<uint32_t>(some.size()));
    for (size_t i = 0; i < some.size(); ++i)
      if (kept[i]) seen.push_back(some[i]);
  }
  for (size_t first = 0; first < seen.size(); first += chunk) {
    if (progress && !progress(double(first) / double(seen.size()))) throw std::runtime_error("stopped");
    render_chunk(frame, camera, {seen.begin() + static_cast<ptrdiff_t>(first), seen.begin() + static_cast<ptrdiff_t>(std::min(seen.size(), first + chunk))}, picture);
  }
  return picture;
}

void Renderer::render_chunk(FrameOnDevice& frame, const Camera& camera, const std::vector<uint32_t>& pixels, Picture& picture) {
  const auto rays = static_cast<uint32_t>(pixels.size());
  samples_->set_pixels(commands_, frame, camera, pixels);
  samples_->place(commands_, frame, rays, {});
  const uint32_t rows = samples_->rows(rays);
  const bool turned = settings_.normals || avatar_.spec.color.normal;
  const BufferSlice transforms = turned ? samples_->root_finder().record_transforms(commands_, frame, rows, samples_->canonical()) : BufferSlice{};
  field_->record_forward(commands_, {frame.constants(), samples_->canonical(), samples_->rays(), rows, transforms}, settings_.normals);

  CompositeForwardArgs composite;
  composite.samples.rays = rays;
  composite.samples.samples = samples_->samples();
  composite.samples.sdf = field_->sdf();
  composite.samples.metres_per_unit = static_cast<float>(avatar_.cube.metres_per_unit());
  composite.samples.rgb = field_->rgb();
  composite.samples.points = samples_->canonical();
  composite.samples.deltas = samples_->deltas();
  composite.samples.parameters = networks_.parameters();
  composite.samples.scale_index = networks_.deviation_index();
  composite.delta_mode = samples_->delta_mode();
  composite.depths = samples_->depths();
  composite.colors = colors_.slice();
  composite.ray_depths = ray_depths_.slice();
  composite.weights = weights_.slice();
  composite.transmittances = transmittances_.slice();
  record_composite_forward(commands_, composite);
  if (settings_.normals) {
    record_posed_normals(commands_, {rows, field_->gradient(), transforms, normals_.slice(), true});
    composite.samples.rgb = {normals_.slice(), 4, 0};  // Σ w n: compositing is linear in its colours
    composite.colors = composited_normals_.slice();
    composite.ray_depths = unused_depths_.slice();
    record_composite_forward(commands_, composite);
  }
  commands_.submit_and_wait();

  using Rgba = std::array<float, 4>;
  const auto colors = device_.download<Rgba>(colors_.slice().sub(0, rays * 16ull));
  const auto depths = device_.download<float>(ray_depths_.slice().elements(0, rays));
  const auto normals = settings_.normals ? device_.download<Rgba>(composited_normals_.slice().sub(0, rays * 16ull)) : std::vector<Rgba>{};
  for (size_t i = 0; i < rays; ++i) {
    const size_t at = static_cast<size_t>(pixels[i] >> 16) * static_cast<size_t>(picture.width) + (pixels[i] & 0xffff);
    const float alpha = colors[i][3];
    picture.alpha[at] = alpha;
    for (size_t c = 0; c < 3; ++c) picture.color[3 * at + c] = colors[i][c];
    if (alpha >= 0.5f) picture.depth[at] = depths[i] / alpha;
    if (!normals.empty())
      for (size_t c = 0; c < 3; ++c) picture.normal[3 * at + c] = normals[i][c];
  }
}

}  // namespace arah
