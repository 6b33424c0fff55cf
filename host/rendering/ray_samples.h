// Rays and their samples with canonical correspondences: what both rendering and training shade (DESIGN.md §2's story).
#pragma once

#include <functional>
#include <vector>

#include "host/capture/camera.h"
#include "host/rendering/avatar_networks.h"
#include "host/rendering/frame_on_device.h"
#include "host/rendering/root_finder.h"
#include "host/rendering/surface_finder.h"
#include "kernels/compositing/forward.h"
#include "kernels/rays/generate.h"
#include "kernels/sampling/jitter.h"

namespace arah {

// Where a ray is sampled.
enum class SamplingMode {
  shell,         // stratified over the part of it inside the template's shell
  surface,       // the paper's: densely around the surface that the ray hits, uniformly in the box where it hits none
  surface_only,  // one opaque sample where the ray hits the surface, nothing where it hits none
  uniform,       // evenly over its part in the body's box, whatever it hits (the paper's ablation)
};

// Whether samples are placed by what their rays hit.
constexpr bool asks_for_surface(SamplingMode mode) { return mode == SamplingMode::surface || mode == SamplingMode::surface_only; }

// Where the surface that a ray hits comes from.
enum class SurfaceSource {
  search,  // sphere tracing, then the joint search (the paper)
  mesh,    // the posed mesh of the baked distances, drawn (surface_mesh.h); in pictures alone
};

struct SamplingSettings {
  SamplingMode mode = SamplingMode::shell;
  SurfaceSource surface = SurfaceSource::search;  // of the modes that ask for the surface
  // Of each ray. surface: room for them, used in full on rays without a surface (the paper: 64); at least
  // around_surface + before_surface. surface_only: 1. uniform: 64 in the paper.
  uint32_t samples = 20;
  // surface: of a ray that hits one, so many samples (odd) within half_width metres of it and so many in front, from where the
  // ray enters the box (ARAH.md §6).
  uint32_t around_surface = 17, before_surface = 16;
  double half_width = 0.05;
  // All but shell: rays that stay farther than shell.outer from the template are not looked at, and samples that lie
  // farther are taken as empty, without a search. off: every ray that meets the body's box is traced, and every sample's
  // correspondence searched and its distance evaluated, wherever it lies.
  bool shell_bound = true;
  ShellSettings shell;
  RootFindingSettings root;
};

// Of a pixel (column | row << 16) in a picture of so many columns.
constexpr std::size_t pixel_index(uint32_t pixel, int width) { return static_cast<std::size_t>(pixel >> 16) * static_cast<std::size_t>(width) + (pixel & 0xffff); }

const char* to_string(SamplingMode mode);
const char* to_string(SurfaceSource source);

RayCamera ray_camera(const Camera& camera);

class RaySamples {
 public:
  RaySamples(Device& device, AvatarNetworks& networks, uint32_t capacity_rays, const SamplingSettings& settings);

  uint32_t capacity_rays() const { return capacity_rays_; }     // with samples
  uint32_t capacity_pixels() const { return capacity_pixels_; }  // of set_pixels alone
  uint32_t samples() const { return settings_.samples; }
  uint32_t rows(uint32_t rays) const { return rays * settings_.samples; }

  // Rays of the listed pixels (column | row << 16), and which of their bins lie in the shell. Submits.
  void set_pixels(Commands& commands, FrameOnDevice& frame, const Camera& camera, const std::vector<uint32_t>& pixels);
  // For each ray of the last set_pixels, 0 where nothing can be seen along it: the number of its bins in the shell; without
  // shell_bound 1 where it meets the body's box.
  std::vector<uint32_t> kept_counts(uint32_t rays);
  // Likewise, 0 for rays that training does not draw: in all modes but shell those that miss the box, whatever
  // shell_bound says: what is left out for speed must not decide which rays there are.
  std::vector<uint32_t> drawn_from(uint32_t rays);
  // What the rays of these pixels hit, by searching, as many at a time as `finder` has room for. Afterwards the rays are those of
  // the last of them. Submits. progress: the part done.
  SurfaceHits search_surface(Commands& commands, FrameOnDevice& frame, const Camera& camera, const std::vector<uint32_t>& pixels, SurfaceFinder& finder,
                             SurfaceFinder::Candidates candidates, const std::function<void(double)>& progress = {});
  // surface, surface_only: what the rays of the last set_pixels hit.
  void set_surface(const SurfaceHits& hits);
  // surface: from the next place() on instead of the settings' half_width, metres.
  void set_half_width(double metres) { settings_.half_width = metres; }
  // Samples on the rays of the last set_pixels and their canonical points. Submits.
  void place(Commands& commands, FrameOnDevice& frame, uint32_t rays, const Jitter& jitter);

  // Whether a good part of the rows has no point to evaluate: unused places of rays, and samples outside the shell.
  bool has_gaps() const { return in_box() && !opaque(); }
  // Whether a sample hides all that is behind it, whatever its distance.
  bool opaque() const { return settings_.mode == SamplingMode::surface_only; }
  BufferSlice rays() { return rays_.slice(); }            // Ray by ray
  BufferSlice kept() { return bounded_by_shell() ? kept_.slice() : BufferSlice{}; }  // uvec2 by ray: its bins in the shell
  BufferSlice depths() { return depths_.slice(); }        // float by row
  BufferSlice deltas() { return deltas_.slice(); }        // float by row; surface, uniform: compositing writes them
  DeltaMode delta_mode() const { return has_gaps() ? DeltaMode::differences : DeltaMode::given; }
  BufferSlice points() { return points_.slice(); }        // vec4 by row: posed, without the root translation; w > 0: wanted, 0: no sample, EMPTY (shared/empty_sample.h)
  BufferSlice canonical() { return canonical_.slice(); }  // vec4 by row; w = 1 where a correspondence was found
  const PointRootFinder& root_finder() const { return finder_; }
  PointRootFinder& root_finder() { return finder_; }

 private:
  std::vector<uint32_t> meet_box(uint32_t rays);
  bool in_box() const { return settings_.mode != SamplingMode::shell; }  // and not in the shell alone
  // What the drawn mesh covers needs no other bound.
  bool bounded_by_shell() const { return !in_box() || (settings_.shell_bound && !(opaque() && settings_.surface == SurfaceSource::mesh)); }
  void place_in_box(Commands& commands, FrameOnDevice& frame, uint32_t rays, const Jitter& jitter);

  Device& device_;
  SamplingSettings settings_;
  uint32_t capacity_rays_, capacity_pixels_;
  PointRootFinder finder_;
  Buffer surface_points_, surface_depths_, pixels_, rays_, kept_, kept_counts_, depths_, deltas_, points_, canonical_;
};

}  // namespace arah
