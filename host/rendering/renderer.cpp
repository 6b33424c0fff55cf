#include "host/rendering/renderer.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

#include "host/body/pose.h"
#include "host/input_error.h"
#include "host/rendering/memory_plan.h"
#include "kernels/linear/cooperative.h"

namespace arah {
namespace {

// Rays whose activations fit the memory: floats a sample of the distances' and the root search's tapes.
uint32_t rays_at_a_time(const AvatarSpec& spec, uint32_t samples, uint64_t memory_bytes, uint32_t most_rays) {
  const double bytes_a_ray = 4.0 * samples * (2.0 * spec.sdf.width + 2.0 * spec.skinning.width + 120);
  // no more than 65,536 rows, so that a matrix of 512 channels still fits the 128 MiB that every device binds at once
  const uint32_t most = std::min(65536 / samples, most_rays) / 64 * 64;
  return std::clamp(static_cast<uint32_t>(double(memory_bytes) / bytes_a_ray) / 64 * 64, 64u, std::max(64u, most));
}

// What goes together beside so many rays with their samples. Few samples are shaded, and what is kept of each is much; a search
// keeps much of a ray, but many rays share its launches, of which there are some thousand.
constexpr uint32_t most_shaded_at_a_time = 8192;
constexpr uint32_t searched_at_a_time(uint32_t rays) { return std::min(4 * rays, 4096u); }

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
  if (small.inspection) picture.inspection = small.inspection->enlarged(small.width, small.height, width, height);
  return picture;
}

// The settings, where the device can follow them.
const RenderSettings& possible(Device& device, const RenderSettings& settings) {
  if (settings.arithmetic == Arithmetic::cooperative_matrix && !cooperative_refusal(device).empty())
    throw InputError("arithmetic cooperative_matrix", "", "a device with cooperative matrices", fmt::format("{}: {}", device.report().name, cooperative_refusal(device)), "half_storage stores the same numbers and needs nothing of the device.");
  return settings;
}

}  // namespace

Renderer::Renderer(Device& device, const Avatar& avatar, const RenderSettings& settings)
    : device_(device), avatar_(avatar), settings_(possible(device, settings)), sampling_(settings.sampling.value_or(picture_sampling(avatar))), rays_(planned_rays()), networks_(device, avatar, false), body_(device, avatar.body), commands_(device) {
  if (sampling_.mode == SamplingMode::surface && sampling_.samples < sampling_.around_surface + sampling_.before_surface)
    throw InputError("samples", "", fmt::format("at least {} with sampling_mode surface: around_surface and before_surface together", sampling_.around_surface + sampling_.before_surface), fmt::format("{}", sampling_.samples));
  if (sampling_.mode == SamplingMode::surface_only && sampling_.samples != 1) throw InputError("samples", "", "1 with sampling_mode surface_only", fmt::format("{}", sampling_.samples));
  if (settings.arithmetic == Arithmetic::cooperative_matrix) networks_.make_half_weights(device);
  if (bakes()) baked_.emplace(device, avatar, settings.bake_cell);
  if (searches_surface()) surface_finder_.emplace(device, networks_, searched_at_a_time(rays_));
  samples_.emplace(device, networks_, rays_, sampling_);
  if (settings.inspect) samples_->root_finder().note_steps();
  if (settings.half_width_b > 0) samples_->set_half_width(std::min(sampling_.half_width, settings.half_width_b * density_scale(avatar)));
  shaded_.emplace(device, networks_, rays_, sampling_.samples, most_shaded_at_a_time, settings.normals, settings.arithmetic);
}

uint32_t Renderer::planned_rays() {
  const uint32_t most = rays_at_a_time(avatar_.spec, sampling_.samples, settings_.memory_bytes, settings_.most_rays);
  if (!device_.memory_ceiling()) return most;
  // Of the frames to come, one at a time, with a grid whose nodes all have a root: more than any pose needs.
  const uint64_t frame_bytes = device_.bytes_of([&] {
    TemplateOnDevice body(device_, avatar_.body);
    FrameOnDevice(device_, avatar_, body, rest_pose(avatar_.body.skeleton), sampling_.shell).make_correspondences(device_, sampling_.shell);
  });
  return rays_that_fit(device_, "a picture", most, frame_bytes, [&](uint32_t rays) {
    AvatarNetworks networks(device_, avatar_, false);
    std::optional<SurfaceFinder> finder;
    if (searches_surface()) finder.emplace(device_, networks, searched_at_a_time(rays));
    if (settings_.arithmetic == Arithmetic::cooperative_matrix) networks.make_half_weights(device_);
    RaySamples samples(device_, networks, rays, sampling_);
    ShadedRays shaded(device_, networks, rays, sampling_.samples, most_shaded_at_a_time, settings_.normals, settings_.arithmetic);
    if (samples.has_gaps()) shaded.field().make_room_for_gaps();
    if (samples.opaque()) shaded.field().opaque_distances();
    if (settings_.baked_distances) shaded.field().distances_by_row();
    std::optional<SkinningWeights> weights;
    if (settings_.inspect) weights.emplace(device_, networks, avatar_);
    if (!bakes()) return;
    BakedDistances baked(device_, avatar_, settings_.bake_cell);
    baked.make_room_for_points(shaded.field().capacity());
    SkinningWeights of_mesh(device_, networks, avatar_);
  });
}

Picture Renderer::render(const Camera& camera, const Pose& pose, std::size_t latent_row, const RenderingProgress& progress) {
  const Camera every_pixel = computed(camera);
  return whole(render_rows(every_pixel, pose, latent_row, 0, every_pixel.height, progress), camera);
}

Camera Renderer::computed(const Camera& camera) const {
  return settings_.pixel_step <= 1 ? camera : camera.scaled(std::max(1, (camera.width + settings_.pixel_step - 1) / settings_.pixel_step));
}

Picture Renderer::whole(Picture rows, const Camera& camera) const { return settings_.pixel_step <= 1 ? std::move(rows) : enlarged(rows, camera.width, camera.height); }

Picture Renderer::render_rows(const Camera& camera, const Pose& pose, std::size_t latent_row, int begin, int end, const RenderingProgress& progress) {
  Picture picture;
  int rows = 0;
  const auto report = [&](double done) {
    if (progress && !progress({done, picture, rows})) throw RenderingStopped();
  };
  const auto between = [&] { report(0); };
  FrameOnDevice& frame = packed(pose, latent_row, between);
  bake(frame, latent_row, between);

  picture.width = camera.width;
  picture.height = camera.height;
  const size_t pixels = static_cast<size_t>(camera.width) * static_cast<size_t>(camera.height);
  picture.color.assign(3 * pixels, 0);
  picture.alpha.assign(pixels, 0);
  picture.depth.assign(pixels, 0);
  if (settings_.normals) picture.normal.assign(3 * pixels, 0);
  if (settings_.inspect) picture.inspection.emplace(pixels);

  SurfaceHits surface;
  if (draws_mesh()) surface = mesh_->seen(pose, camera, settings_.outline * density_scale(avatar_));
  const std::vector<uint32_t> seen = pixels_to_render(frame, camera, begin, end, surface);
  // A search of the surface takes about as long as what follows.
  const double searching = searches_surface() ? 0.5 : 0;
  if (searches_surface()) surface = find_surface(frame, camera, seen, [&](double done) { report(searching * done); });
  const uint32_t chunk = samples_->capacity_rays();
  for (size_t first = 0; first < seen.size(); first += chunk) {
    rows = static_cast<int>(seen[first] >> 16);
    report(searching + (1 - searching) * double(first) / double(seen.size()));
    render_chunk(frame, camera, {seen.begin() + static_cast<ptrdiff_t>(first), seen.begin() + static_cast<ptrdiff_t>(std::min(seen.size(), first + chunk))}, surface, picture);
  }
  return picture;
}

// The networks' weights and the frame.
FrameOnDevice& Renderer::packed(const Pose& pose, std::size_t latent_row, const std::function<void()>& between) {
  commands_.stage("weights");
  if (avatar_.spec.skinning.kind == Skinning::backward) networks_.record_pose(commands_, posed(pose, between).joint_rotations());
  networks_.record_pack(commands_, latent_row, settings_.shared_sdf ? std::vector<float>{} : pose_input(avatar_, pose));
  commands_.submit_and_wait();
  return posed(pose, between);
}

DistanceSlice Renderer::slice(const SlicePlane& plane, int width, int height, const Pose& pose, std::size_t latent_row, const std::function<bool(double)>& progress) {
  if (avatar_.spec.sdf.kind == FieldKind::density) throw InputError("slice", "", "an avatar with signed distances (sdf.kind sdf)", "one with sdf.kind density");
  FrameOnDevice& frame = packed(pose, latent_row, {});
  commands_.stage("slice");
  return distance_slice(device_, commands_, frame, *samples_, shaded_->field(), {}, avatar_.cube.metres_per_unit(), plane, width, height, progress);
}

std::vector<float> Renderer::skinning_weights(std::span<const glm::vec3> points) {
  if (!frame_) throw std::logic_error("skinning weights before the first picture");
  if (!weights_) weights_.emplace(device_, networks_, avatar_);
  commands_.stage("skinning weights");
  return weights_->at(commands_, frame_->constants(), points);
}

// The frame of this pose, with its correspondences where the settings want them.
FrameOnDevice& Renderer::posed(const Pose& pose, const std::function<void()>& between) {
  if (frame_ && pose_ == pose) return *frame_;
  frame_.emplace(device_, avatar_, body_, pose, sampling_.shell);
  pose_ = pose;
  if (avatar_.spec.sdf.pose != PoseConditioning::none && !settings_.shared_sdf) baked_row_.reset();
  if (avatar_.spec.skinning.kind == Skinning::network && sampling_.mode != SamplingMode::surface_only && sampling_.root.correspondence != Correspondence::search) {
    frame_->make_correspondences(device_, sampling_.shell);
    try {
      frame_->correspondences()->solve(commands_, samples_->root_finder(), *frame_, sampling_.root, between);
    } catch (...) {
      frame_.reset();  // half of its roots are not a frame
      throw;
    }
  }
  return *frame_;
}

// With the networks as they are packed now. Unless the SDF follows code or pose the distances are the same for all frames.
void Renderer::bake(FrameOnDevice& frame, std::size_t latent_row, const std::function<void()>& between) {
  if (!baked_ || (baked_row_ && (avatar_.spec.sdf.conditioning == SdfConditioning::none || *baked_row_ == latent_row))) return;
  const auto start = std::chrono::steady_clock::now();
  commands_.stage("baking");
  baked_row_.reset();
  baked_->bake(commands_, shaded_->field(), frame.constants(), between);
  if (draws_mesh()) mesh_.emplace(device_, commands_, networks_, avatar_, smooth_net(baked_->samples()), frame.constants());
  baked_row_ = latent_row;
  work_.baking_seconds += std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

// What the rays of these pixels hit, by searching.
SurfaceHits Renderer::find_surface(FrameOnDevice& frame, const Camera& camera, const std::vector<uint32_t>& pixels, const std::function<void(double)>& progress) {
  const size_t all = static_cast<size_t>(camera.width) * static_cast<size_t>(camera.height);
  SurfaceHits seen{std::vector<std::array<float, 4>>(all, {0, 0, 0, 0}), std::vector<float>(all, 0.0f)};
  const SurfaceHits hits = samples_->search_surface(commands_, frame, camera, pixels, *surface_finder_, SurfaceFinder::Candidates::not_diverged, progress);
  for (size_t i = 0; i < pixels.size(); ++i) {
    const size_t at = pixel_index(pixels[i], camera.width);
    seen.points[at] = hits.points[i];
    seen.depths[at] = hits.depths[i];
  }
  return seen;
}

// Those where something may be seen, so that only they fill chunks: where the mesh is all there is to see, what it covers;
// else those whose rays enter the shell.
std::vector<uint32_t> Renderer::pixels_to_render(FrameOnDevice& frame, const Camera& camera, int begin, int end, const SurfaceHits& seen) {
  std::vector<uint32_t> all, some;
  for (int v = begin; v < end; ++v)
    for (int u = 0; u < camera.width; ++u) all.push_back(static_cast<uint32_t>(u) | static_cast<uint32_t>(v) << 16);
  if (draws_mesh() && sampling_.mode == SamplingMode::surface_only) {
    for (const uint32_t pixel : all)
      if (seen.points[pixel_index(pixel, camera.width)][3] > 0) some.push_back(pixel);
    return some;
  }
  const uint32_t look = samples_->capacity_pixels();
  for (size_t first = 0; first < all.size(); first += look) {
    const std::vector<uint32_t> looked(all.begin() + static_cast<ptrdiff_t>(first), all.begin() + static_cast<ptrdiff_t>(std::min(all.size(), first + look)));
    samples_->set_pixels(commands_, frame, camera, looked);
    const std::vector<uint32_t> kept = samples_->kept_counts(static_cast<uint32_t>(looked.size()));
    for (size_t i = 0; i < looked.size(); ++i)
      if (kept[i]) some.push_back(looked[i]);
  }
  return some;
}

void Renderer::render_chunk(FrameOnDevice& frame, const Camera& camera, const std::vector<uint32_t>& pixels, const SurfaceHits& seen, Picture& picture) {
  const auto rays = static_cast<uint32_t>(pixels.size());
  samples_->set_pixels(commands_, frame, camera, pixels);
  if (asks_for_surface(sampling_.mode)) {
    SurfaceHits hits;
    for (const uint32_t pixel : pixels) {
      const size_t at = pixel_index(pixel, camera.width);
      hits.points.push_back(seen.points[at]);
      hits.depths.push_back(seen.depths[at]);
    }
    hits.points.resize(padded_points(rays), {0, 0, 0, 0});
    samples_->set_surface(hits);
  }
  samples_->place(commands_, frame, rays, {});
  if (settings_.inspect) inspector_.note_placed(device_, commands_, *samples_, rays);
  ShadedRays::Options options{settings_.least_weight, settings_.normals, {}, settings_.color_groups};
  if (settings_.baked_distances) options.baked = baked_->nodes();
  shaded_->record_forward(commands_, frame, *samples_, rays, options);
  work_.rays += rays;
  work_.samples += samples_->rows(rays);
  work_.shaded += shaded_->queue().shaded();
  commands_.submit_and_wait();
  if (settings_.inspect) inspector_.note_shaded(device_, *shaded_, pixels, camera.width, *picture.inspection);

  using Rgba = std::array<float, 4>;
  const auto colors = device_.download<Rgba>(shaded_->colors().sub(0, rays * 16ull));
  const auto depths = device_.download<float>(shaded_->ray_depths().elements(0, rays));
  const auto normals = settings_.normals ? device_.download<Rgba>(shaded_->normals().sub(0, rays * 16ull)) : std::vector<Rgba>{};
  for (size_t i = 0; i < rays; ++i) {
    const size_t at = pixel_index(pixels[i], picture.width);
    const float alpha = colors[i][3];
    picture.alpha[at] = alpha;
    for (size_t c = 0; c < 3; ++c) picture.color[3 * at + c] = colors[i][c];
    if (alpha >= 0.5f) picture.depth[at] = depths[i] / alpha;
    if (!normals.empty())
      for (size_t c = 0; c < 3; ++c) picture.normal[3 * at + c] = normals[i][c];
  }
}

}  // namespace arah
