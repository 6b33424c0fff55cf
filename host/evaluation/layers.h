// What is known of a picture's pixels (host/rendering/renderer.h, inspection.h), as pictures in fixed colours that a legend explains.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "host/rendering/renderer.h"

namespace arah {

enum class PictureLayer { color, normal, depth, canonical, weights, slice, samples, steps, failures };
const char* to_string(PictureLayer layer);
const std::vector<PictureLayer>& all_layers();
PictureLayer layer_named(const std::string& name);  // throws InputError naming them all
bool needs_inspection(PictureLayer layer);  // RenderSettings::inspect
bool needs_normals(PictureLayer layer);     // RenderSettings::normals
bool needs_renderer(PictureLayer layer);    // weights and slice: more than the picture

using Rgb = std::array<uint8_t, 3>;

// What the colours say. Where they are a scale, `colors` goes from `low` to `high` and beyond its ends stays as it is there.
struct Legend {
  std::string text;
  double low = 0, high = 0;
  std::string unit;
  std::vector<Rgb> colors;
};
// One line: the text, and of a scale its ends and unit.
std::string describe(const Legend& legend);

// RGBA with straight alpha, row-major, top left first; transparent where there is nothing to say.
struct LayerImage {
  int width = 0, height = 0;
  std::vector<uint8_t> rgba;  // [pixels][4]
  Legend legend;
};

std::vector<uint8_t> encode_png(const LayerImage& image);

// color: as rendered.
// normal: n/2 + 1/2 of unit normals in world axes; alpha: how much of the pixel the person covers.
// depth: grey, from 1 at the nearest pixel to 0.2 at the farthest.
// canonical: where on the canonical body, red, green and blue for x, y and z from 0 to 1 over the canonical template's box,
//   darker on the lines where one of them is a multiple of 10 cm; alpha: coverage.
// samples: how many colours were evaluated along the ray, black through purple and orange to pale yellow (Inferno), from 0 to the samples that rays have.
// steps: Broyden's steps of a pixel's samples in the mean, dark blue through green to yellow (Viridis), 0 to 8.
// failures: share of a pixel's samples for which no root was found, yellow to red; a darker grey picture of the person where all were found.
// Throws std::invalid_argument where the picture was rendered without what the layer needs, and for weights and slice, which follow.
LayerImage layer_image(PictureLayer layer, const Picture& picture, const Avatar& avatar);

// weights: of one joint at the canonical points of a picture that the renderer has just made (of a backward network: at the surface's posed
// points), pale grey through orange to dark red from 0 to 1. joint −1: of all, each in joint_color(), mixed by their weights.
LayerImage weights_layer(Renderer& renderer, const Avatar& avatar, const Picture& picture, const Camera& camera, const Pose& pose, int joint);
// Hues spread by the golden ratio, light and dark by turns.
Rgb joint_color(std::size_t joint);

// slice: signed distances on a plane: blue inside, white at the surface, red outside, to 10 cm; darker on lines of every centimetre as far, black
// on that of 0; grey where no canonical point was found.
LayerImage slice_layer(const DistanceSlice& slice);

}  // namespace arah
