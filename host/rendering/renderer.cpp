#include "host/rendering/renderer.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

#include "host/body/pose.h"
#include "host/input_error.h"
#include "host/rendering/memory_plan.h"

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

// A smaller picture between whose pixels the others are interpolated; depths and what is behind an edge come from the nearest.
Picture enlarged(const Picture& small, int width, int height) {
  Picture picture;
  picture.width = width;
  picture.height = height;
  const auto resized = [&](const std::vector<float>& from, int channels, int interpolation) {
    if (from.empty()) return std::vector<float>{};
    const cv::Mat source(small.height, small.width, CV_32FC(channels), const_cast<float*>(from.data()));
    std::vector<float> to(static_cast<size_t>(width) * static_cast<size_t>(height) * static_cast<size_t>(channels));
    cv::Mat target(height, width, CV_32FC(channels), to.data());
    cv::resize(source, target, target.size(), 0, 0, interpolation);
    return to;
  };
  picture.color = resized(small.color, 3, cv::INTER_LINEAR);
  picture.alpha = resized(small.alpha, 1, cv::INTER_LINEAR);
  picture.depth = resized(small.depth, 1, cv::INTER_NEAREST);
  picture.normal = resized(small.normal, 3, cv::INTER_LINEAR);
  return picture;
}

}  // namespace

Renderer::Renderer(Device& device, const Avatar& avatar, const RenderSettings& settings)
    : device_(device), avatar_(avatar), settings_(settings), sampling_(settings.sampling.value_or(picture_sampling(avatar))), rays_(planned_rays()), networks_(device, avatar, false), body_(device, avatar.body), commands_(device) {
  if (sampling_.mode == SamplingMode::surface && sampling_.samples < samples_around_surface + samples_before_surface)
    throw InputError("samples", "", fmt::format("at least {} with sampling_mode surface", samples_around_surface + samples_before_surface), fmt::format("{}", sampling_.samples));
  samples_.emplace(device, networks_, rays_, sampling_);
  shaded_.emplace(device, networks_, rays_, sampling_.samples, false, settings.normals);
}

uint32_t Renderer::planned_rays() {
  const uint32_t most = rays_at_a_time(avatar_.spec, sampling_.samples, settings_.memory_bytes);
  if (!device_.memory_ceiling()) return most;
  // Of the frames to come, one at a time, with a grid whose nodes all have a root: more than any pose needs.
  const uint64_t frame_bytes = device_.bytes_of([&] {
    TemplateOnDevice body(device_, avatar_.body);
    FrameOnDevice(device_, avatar_, body, rest_pose(avatar_.body.skeleton), sampling_.shell).make_correspondences(device_, sampling_.shell);
  });
  return rays_that_fit(device_, "a picture", most, frame_bytes, [&](uint32_t rays) {
    AvatarNetworks networks(device_, avatar_, false);
    RaySamples samples(device_, networks, rays, sampling_);
    ShadedRays shaded(device_, networks, rays, sampling_.samples, false, settings_.normals);
    if (samples.has_gaps()) shaded.field().make_room_for_gaps();
  });
}

Picture Renderer::render(const Camera& camera, const Pose& pose, std::size_t latent_row, const std::function<bool(double)>& progress) {
  if (settings_.pixel_step <= 1) return render_every_pixel(camera, pose, latent_row, progress);
  const int columns = std::max(1, (camera.width + settings_.pixel_step - 1) / settings_.pixel_step);
  return enlarged(render_every_pixel(camera.scaled(columns), pose, latent_row, progress), camera.width, camera.height);
}

Picture Renderer::render_every_pixel(const Camera& camera, const Pose& pose, std::size_t latent_row, const std::function<bool(double)>& progress) {
  FrameOnDevice frame(device_, avatar_, body_, pose, sampling_.shell);
  networks_.record_pack(commands_, latent_row);
  commands_.submit_and_wait();
  if (avatar_.spec.skinning.kind == Skinning::network && sampling_.root.correspondence != Correspondence::search) {
    frame.make_correspondences(device_, sampling_.shell);
    frame.correspondences()->solve(commands_, samples_->root_finder(), frame, sampling_.root);
  }

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
  shaded_->record_forward(commands_, frame, *samples_, rays, settings_.least_weight, settings_.normals);
  work_.rays += rays;
  work_.samples += samples_->rows(rays);
  work_.shaded += shaded_->queue().shaded();
  commands_.submit_and_wait();

  using Rgba = std::array<float, 4>;
  const auto colors = device_.download<Rgba>(shaded_->colors().sub(0, rays * 16ull));
  const auto depths = device_.download<float>(shaded_->ray_depths().elements(0, rays));
  const auto normals = settings_.normals ? device_.download<Rgba>(shaded_->normals().sub(0, rays * 16ull)) : std::vector<Rgba>{};
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
