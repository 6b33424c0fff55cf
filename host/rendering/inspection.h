// What is known of each pixel beside its colour: where on the body it lies, and what its samples cost.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "host/rendering/ray_samples.h"
#include "host/rendering/shaded_rays.h"

namespace arah {

// By pixel, row-major, top left first; zeros where the ray has no sample. Sums over pixels are what Renderer::work() and the
// root finder's counts grew by (which leave out what grid_alone cannot tell). In a picture of every so-manieth pixel (pixel_step) the others repeat the nearest that was computed.
struct Inspection {
  explicit Inspection(std::size_t pixels);

  // Σ w x̂ / Σ w over the samples with compositing weights w and canonical points x̂, metres; then Σ w, 0 where there is nothing.
  // Where two parts of the body share a pixel (at outlines, in front of each other) a point between them.
  std::vector<std::array<float, 4>> canonical;
  std::vector<uint32_t> placed;      // samples on the ray
  std::vector<uint32_t> wanted;      // of these, whose canonical point was asked for; the others lie where nothing can be
  std::vector<uint32_t> unfound;     // of the wanted, for whose canonical point no root was found: they are left out
  std::vector<uint32_t> shaded;      // of the placed, for which a colour was evaluated
  // Of the search of the wanted samples' canonical points by Broyden's method: all their steps together, from all starts, and the most of
  // one sample. 0 where no search is needed: without a skinning network; for points that the frame's grid of
  // roots gives; and with sampling_mode surface_only, whose one sample is the surface point itself.
  std::vector<uint32_t> steps, most_steps;

  // Of a larger picture.
  Inspection enlarged(int width, int height, int to_width, int to_height) const;

  double mean_steps(std::size_t pixel) const { return wanted[pixel] ? double(steps[pixel]) / wanted[pixel] : 0; }
};

// Takes it from the device while a chunk of rays is rendered.
class RayInspector {
 public:
  // After RaySamples::place: its canonical points, which shading may move. Submits.
  void note_placed(Device& device, Commands& commands, RaySamples& samples, uint32_t rays);
  // After ShadedRays::record_forward and what it recorded have run. pixels: of the rays (column | row << 16); width: of the picture.
  void note_shaded(Device& device, ShadedRays& shaded, const std::vector<uint32_t>& pixels, int width, Inspection& inspection);

 private:
  uint32_t rays_ = 0, samples_ = 0;
  std::vector<std::array<float, 4>> points_, canonical_;
  std::vector<uint32_t> steps_;  // by sample; empty where nothing was searched
};

}  // namespace arah
