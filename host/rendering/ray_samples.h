// Rays and their samples with canonical correspondences: what both rendering and training shade (DESIGN.md §2's story).
#pragma once

#include <optional>
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
  shell,    // stratified over the part of it inside the template's shell
  surface,  // the paper's: densely around the surface that the ray hits, uniformly in the box where it hits none
};

inline constexpr uint32_t samples_around_surface = 17, samples_before_surface = 16;  // ARAH.md §6

struct SamplingSettings {
  SamplingMode mode = SamplingMode::shell;
  // Of each ray. surface: room for them, used in full on rays without a surface (the paper: 64); at least 33.
  uint32_t samples = 20;
  // surface: samples farther than shell.outer from the template are taken as empty, without a search. off: every sample's
  // correspondence is searched and its distance evaluated, wherever it lies.
  bool shell_bound = true;
  ShellSettings shell;
  RootFindingSettings root;
};

const char* to_string(SamplingMode mode);

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
  // For each ray of the last set_pixels, 0 where nothing can be seen along it: shell: the number of kept bins; surface: 1
  // where it meets the body's box.
  std::vector<uint32_t> kept_counts(uint32_t rays);
  // Samples on the rays of the last set_pixels and their canonical points. Submits. surface: with jitter, in training, the
  // joint search is tried on all rays in the box.
  void place(Commands& commands, FrameOnDevice& frame, uint32_t rays, const Jitter& jitter);

  // Whether a good part of the rows has no point to evaluate: unused places of rays, and samples outside the shell.
  bool has_gaps() const { return settings_.mode == SamplingMode::surface; }
  BufferSlice rays() { return rays_.slice(); }            // Ray by ray
  BufferSlice depths() { return depths_.slice(); }        // float by row
  BufferSlice deltas() { return deltas_.slice(); }        // float by row; surface: compositing writes them
  DeltaMode delta_mode() const { return settings_.mode == SamplingMode::surface ? DeltaMode::differences : DeltaMode::given; }
  BufferSlice canonical() { return canonical_.slice(); }  // vec4 by row; w = 1 where a correspondence was found
  const PointRootFinder& root_finder() const { return finder_; }
  PointRootFinder& root_finder() { return finder_; }
  SurfaceFinder& surface_finder() { return *surface_; }  // of the surface mode alone

 private:
  void place_around_surface(Commands& commands, FrameOnDevice& frame, uint32_t rays, const Jitter& jitter);

  Device& device_;
  SamplingSettings settings_;
  uint32_t capacity_rays_, capacity_pixels_;
  PointRootFinder finder_;
  std::optional<SurfaceFinder> surface_;
  Buffer pixels_, rays_, kept_, kept_counts_, depths_, deltas_, points_, canonical_;
};

}  // namespace arah
