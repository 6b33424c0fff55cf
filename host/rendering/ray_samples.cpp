#include "host/rendering/ray_samples.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "kernels/rays/shell_bins.h"
#include "kernels/sampling/outside_shell.h"
#include "kernels/sampling/shell_samples.h"
#include "kernels/sampling/surface_samples.h"
#include "shaders/shared/ray.h"

namespace arah {

namespace {

// Half of the 64th part of a ray through the box, at most; metres.
double half_bin(const RayBox& box) {
  double squared = 0;
  for (size_t axis = 0; axis < 3; ++axis) squared += std::pow(double{box.maximum[axis]} - double{box.minimum[axis]}, 2);
  return std::sqrt(squared) / 128;
}

}  // namespace

RayCamera ray_camera(const Camera& camera) {
  RayCamera result;
  const glm::dvec3 center = camera.center();
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) result.rotation[static_cast<size_t>(3 * row + column)] = static_cast<float>(camera.R[column][row]);
    result.origin[static_cast<size_t>(row)] = static_cast<float>(center[row]);
  }
  result.fx = static_cast<float>(camera.K[0][0]);
  result.fy = static_cast<float>(camera.K[1][1]);
  result.cx = static_cast<float>(camera.K[2][0]);
  result.cy = static_cast<float>(camera.K[2][1]);
  return result;
}

RaySamples::RaySamples(Device& device, AvatarNetworks& networks, uint32_t capacity_rays, const SamplingSettings& settings)
    : device_(device), settings_(settings), capacity_rays_(padded_points(capacity_rays)),
      capacity_pixels_(std::max(capacity_rays_, 16384u)), finder_(device, networks, capacity_rays_ * settings.samples, settings.root) {
  const uint64_t rays = capacity_pixels_, rows = padded_points(capacity_rays_ * settings.samples);
  auto make = [&](const char* what, uint64_t bytes) {
    Buffer buffer(device, std::string("samples: ") + what, bytes, BufferPlace::device);
    Commands zero(device);
    zero.fill(buffer.slice(), 0);
    zero.submit_and_wait();
    return buffer;
  };
  pixels_ = make("pixels", rays * 4);
  rays_ = make("rays", rays * sizeof(Ray));
  if (in_box()) {
    surface_points_ = make("surface points", capacity_rays_ * 16ull);
    surface_depths_ = make("surface depths", capacity_rays_ * 4ull);
  }
  if (bounded_by_shell()) {
    kept_ = make("kept bins", rays * 8);
    kept_counts_ = make("numbers of kept bins", rays * 4);
  }
  depths_ = make("depths", rows * 4);
  deltas_ = make("deltas", rows * 4);
  points_ = make("posed points", rows * 16);
  canonical_ = make("canonical points", rows * 16);
}

void RaySamples::set_pixels(Commands& commands, FrameOnDevice& frame, const Camera& camera, const std::vector<uint32_t>& pixels) {
  if (pixels.size() > capacity_pixels_) throw std::invalid_argument("more pixels than room for rays");
  commands.stage("rays");
  device_.upload(pixels_.slice(), pixels);
  const auto count = static_cast<uint32_t>(pixels.size());
  GenerateRaysArgs generate;
  generate.camera = ray_camera(camera);
  generate.box = frame.box();
  generate.count = count;
  generate.pixels = pixels_.slice();
  generate.rays = rays_.slice();
  record_generate_rays(commands, generate);
  if (!bounded_by_shell()) return commands.submit_and_wait();
  ShellBinsArgs bins;
  bins.count = count;
  bins.root_translation = frame.root_translation();
  bins.grid = frame.shell_grid();
  // A bin is judged by its middle. Where what matters may lie anywhere in it, half its length is added.
  bins.outer = static_cast<float>(settings_.shell.outer + (in_box() ? half_bin(frame.box()) : 0));
  // Samples of the shell end deep inside; a ray that looks for the surface goes on to where it leaves the shell.
  bins.inner = in_box() ? std::numeric_limits<float>::infinity() : static_cast<float>(settings_.shell.inner);
  bins.rays = rays_.slice();
  bins.distances = frame.shell_distances();
  bins.kept = kept_.slice();
  bins.kept_counts = kept_counts_.slice();
  record_shell_bins(commands, bins);
  commands.submit_and_wait();
}

std::vector<uint32_t> RaySamples::kept_counts(uint32_t rays) { return bounded_by_shell() ? device_.download<uint32_t>(kept_counts_.slice().elements(0, rays)) : meet_box(rays); }

std::vector<uint32_t> RaySamples::drawn_from(uint32_t rays) { return in_box() ? meet_box(rays) : kept_counts(rays); }

std::vector<uint32_t> RaySamples::meet_box(uint32_t rays) {
  std::vector<uint32_t> meet;
  for (const Ray& ray : device_.download<Ray>(rays_.slice().sub(0, rays * sizeof(Ray)))) meet.push_back(ray.near < ray.far);
  return meet;
}

void RaySamples::place(Commands& commands, FrameOnDevice& frame, uint32_t rays, const Jitter& jitter) {
  if (rays > capacity_rays_) throw std::invalid_argument("more rays than room for samples");
  if (in_box()) return place_in_box(commands, frame, rays, jitter);
  commands.stage("rays");
  ShellSamplesArgs samples;
  samples.rays = rays;
  samples.samples = settings_.samples;
  samples.root_translation = frame.root_translation();
  samples.jitter = jitter;
  samples.ray_list = rays_.slice();
  samples.kept = kept_.slice();
  samples.depths = depths_.slice();
  samples.deltas = deltas_.slice();
  samples.points = points_.slice();
  record_shell_samples(commands, samples);
  finder_.solve(commands, frame, rows(rays), points_.slice(), canonical_.slice(), settings_.root);
}

SurfaceHits RaySamples::search_surface(Commands& commands, FrameOnDevice& frame, const Camera& camera, const std::vector<uint32_t>& pixels, SurfaceFinder& finder,
                                       SurfaceFinder::Candidates candidates, const std::function<void(double)>& progress) {
  SurfaceHits hits;
  const size_t at_a_time = std::min(finder.capacity(), capacity_pixels_);
  for (size_t first = 0; first < pixels.size(); first += at_a_time) {
    if (progress) progress(double(first) / double(pixels.size()));
    const auto rays = static_cast<uint32_t>(std::min(at_a_time, pixels.size() - first));
    set_pixels(commands, frame, camera, {pixels.begin() + static_cast<ptrdiff_t>(first), pixels.begin() + static_cast<ptrdiff_t>(first + rays)});
    finder.find(commands, frame, rays, rays_.slice(), kept(), candidates, settings_.root);
    commands.submit_and_wait();
    const auto points = device_.download<std::array<float, 4>>(finder.surface_points().sub(0, rays * 16ull));
    const auto depths = device_.download<float>(finder.surface_depths().elements(0, rays));
    hits.points.insert(hits.points.end(), points.begin(), points.end());
    hits.depths.insert(hits.depths.end(), depths.begin(), depths.end());
  }
  return hits;
}

void RaySamples::set_surface(const SurfaceHits& hits) {
  device_.upload(surface_points_.slice(), hits.points);
  device_.upload(surface_depths_.slice(), hits.depths);
}

void RaySamples::place_in_box(Commands& commands, FrameOnDevice& frame, uint32_t rays, const Jitter& jitter) {
  const bool only = settings_.mode == SamplingMode::surface_only;
  commands.stage("rays");
  SurfaceSamplesArgs samples;
  samples.rays = rays;
  samples.slots = settings_.samples;
  // uniform: no ray has a surface, because none is ever set.
  const bool around = settings_.mode == SamplingMode::surface;
  samples.around_surface = around ? settings_.around_surface : 1;
  samples.before_surface = around ? settings_.before_surface : 0;
  samples.half_width = static_cast<float>(settings_.half_width);
  samples.without_surface = only ? 0 : settings_.samples;
  samples.root_translation = frame.root_translation();
  samples.jitter = jitter;
  samples.ray_list = rays_.slice();
  samples.surface_points = surface_points_.slice();
  samples.surface_depths = surface_depths_.slice();
  samples.depths = depths_.slice();
  samples.points = points_.slice();
  record_surface_samples(commands, samples);
  if (only) {
    constexpr float metre = 1;  // of the inside: nothing passes
    commands.fill(deltas_.slice(), std::bit_cast<uint32_t>(metre));
    // The surface's points are correspondences. With the template's weights they are looked up all the same: that tells which
    // vertex each follows.
    if (finder_.searches()) return commands.copy(samples.surface_points.sub(0, padded_points(rays) * 16ull), canonical_.slice().sub(0, padded_points(rays) * 16ull));
  } else if (settings_.shell_bound) {
    record_outside_shell(commands, {rows(rays), frame.shell_grid(), static_cast<float>(settings_.shell.outer), frame.shell_distances(), points_.slice()});
  }
  finder_.solve(commands, frame, rows(rays), points_.slice(), canonical_.slice(), settings_.root);
}

}  // namespace arah
