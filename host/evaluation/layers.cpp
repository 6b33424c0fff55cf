#include "host/evaluation/layers.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

#include "host/body/canonical.h"
#include "host/evaluation/picture.h"
#include "host/input_error.h"

namespace arah {
namespace {

constexpr double most_mean_steps = 8;     // of the scale
constexpr double line_spacing = 0.1;      // metres between lines of the canonical layer
constexpr double line_shade = 0.55;
constexpr double body_shade = 0.6, least_grey = 0.12;  // of the picture behind failures
constexpr Rgb no_weight{222, 224, 228}, half_weight{250, 165, 45}, all_weight{165, 0, 30};
constexpr double farthest_distance = 0.1, distance_spacing = 0.01, distance_shade = 0.82;  // of the slice; metres, but the last
constexpr double most_strips = 2;  // that neighbouring pixels lie apart
constexpr std::size_t weights_at_a_time = 65536;
constexpr Rgb deep_inside{25, 80, 170}, at_surface{255, 255, 255}, far_outside{205, 75, 60}, without_distance{110, 110, 110};
constexpr Rgb few_failures{255, 225, 60}, all_failures{255, 0, 80};

struct LayerName {
  PictureLayer layer;
  const char* name;
};
constexpr std::array<LayerName, 9> layer_names{{{PictureLayer::color, "color"}, {PictureLayer::normal, "normal"}, {PictureLayer::depth, "depth"}, {PictureLayer::canonical, "canonical"}, {PictureLayer::weights, "weights"}, {PictureLayer::slice, "slice"}, {PictureLayer::samples, "samples"}, {PictureLayer::steps, "steps"}, {PictureLayer::failures, "failures"}}};

uint8_t in_byte(double value) { return static_cast<uint8_t>(std::lround(255 * std::clamp(value, 0.0, 1.0))); }

Rgb mixed(const Rgb& from, const Rgb& to, double part) {
  Rgb color{};
  for (std::size_t c = 0; c < 3; ++c) color[c] = static_cast<uint8_t>(std::lround(from[c] + std::clamp(part, 0.0, 1.0) * (double(to[c]) - from[c])));
  return color;
}

std::vector<Rgb> opencv_scale(int map) {
  cv::Mat ramp(1, 256, CV_8UC1), colors;
  for (int i = 0; i < 256; ++i) ramp.at<uint8_t>(0, i) = static_cast<uint8_t>(i);
  cv::applyColorMap(ramp, colors, map);
  std::vector<Rgb> scale;
  for (int i = 0; i < 256; ++i) {
    const auto& bgr = colors.at<cv::Vec3b>(0, i);
    scale.push_back({bgr[2], bgr[1], bgr[0]});
  }
  return scale;
}

std::vector<Rgb> two_color_scale(const Rgb& low, const Rgb& high) {
  std::vector<Rgb> scale;
  for (int i = 0; i < 256; ++i) scale.push_back(mixed(low, high, i / 255.0));
  return scale;
}

std::vector<Rgb> three_color_scale(const Rgb& low, const Rgb& middle, const Rgb& high) {
  std::vector<Rgb> scale = two_color_scale(low, middle);
  const std::vector<Rgb> upper = two_color_scale(middle, high);
  scale.insert(scale.end(), upper.begin() + 1, upper.end());
  return scale;
}

Rgb on_scale(const Legend& legend, double value) {
  const double part = std::clamp((value - legend.low) / (legend.high - legend.low), 0.0, 1.0);
  return legend.colors[static_cast<std::size_t>(std::lround(part * double(legend.colors.size() - 1)))];
}

const Inspection& inspected(const Picture& picture, const char* layer) {
  if (!picture.inspection) throw std::invalid_argument(fmt::format("layer {}: the picture was rendered without RenderSettings::inspect", layer));
  return *picture.inspection;
}

class Canvas {
 public:
  Canvas(int width, int height, Legend legend) {
    image_.width = width;
    image_.height = height;
    image_.rgba.assign(4 * static_cast<std::size_t>(width) * static_cast<std::size_t>(height), 0);
    image_.legend = std::move(legend);
  }
  Canvas(const Picture& picture, Legend legend) : Canvas(picture.width, picture.height, std::move(legend)) {}
  void set(std::size_t pixel, const Rgb& color, double alpha = 1) {
    std::copy(color.begin(), color.end(), image_.rgba.begin() + static_cast<std::ptrdiff_t>(4 * pixel));
    image_.rgba[4 * pixel + 3] = in_byte(alpha);
  }
  const Legend& legend() const { return image_.legend; }
  LayerImage take() { return std::move(image_); }

 private:
  LayerImage image_;
};

LayerImage color_layer(const Picture& picture) {
  Canvas canvas(picture, {.text = "colour"});
  const std::vector<float> rgba = straight_alpha(picture.color, picture.alpha, picture.width, picture.height);
  for (std::size_t i = 0; i < picture.alpha.size(); ++i) canvas.set(i, {in_byte(rgba[4 * i]), in_byte(rgba[4 * i + 1]), in_byte(rgba[4 * i + 2])}, rgba[4 * i + 3]);
  return canvas.take();
}

LayerImage normal_layer(const Picture& picture) {
  if (picture.normal.size() != 3 * picture.alpha.size()) throw std::invalid_argument("layer normal: the picture was rendered without RenderSettings::normals");
  Canvas canvas(picture, {.text = "normals in world axes: red, green and blue are x, y and z, −1 to 1"});
  for (std::size_t i = 0; i < picture.alpha.size(); ++i) {
    const float* n = &picture.normal[3 * i];
    const double length = std::hypot(n[0], n[1], n[2]);
    if (length > 0) canvas.set(i, {in_byte(0.5 * n[0] / length + 0.5), in_byte(0.5 * n[1] / length + 0.5), in_byte(0.5 * n[2] / length + 0.5)}, picture.alpha[i]);
  }
  return canvas.take();
}

LayerImage depth_layer(const Picture& picture) {
  double nearest = 0, farthest = 0;
  for (const float depth : picture.depth) {
    if (depth <= 0) continue;
    nearest = nearest > 0 ? std::min(nearest, double{depth}) : double{depth};
    farthest = std::max(farthest, double{depth});
  }
  const std::vector<float> grey = depth_to_grey(picture.depth, picture.width, picture.height);
  Canvas canvas(picture, {"depth along the ray", nearest, farthest, "m", two_color_scale({255, 255, 255}, {51, 51, 51})});
  for (std::size_t i = 0; i < grey.size(); ++i)
    if (grey[i] > 0) canvas.set(i, {in_byte(grey[i]), in_byte(grey[i]), in_byte(grey[i])});
  return canvas.take();
}

LayerImage canonical_layer(const Picture& picture, const Avatar& avatar) {
  const std::vector<std::array<float, 4>>& places = inspected(picture, "canonical").canonical;
  std::array<double, 3> low{}, high{};
  bool first = true;
  for (const glm::dvec3& vertex : canonical_vertices(avatar.body, avatar.canonical))
    for (int axis = 0; axis < 3; ++axis) {
      const auto k = static_cast<std::size_t>(axis);
      low[k] = first ? vertex[axis] : std::min(low[k], vertex[axis]);
      high[k] = first ? vertex[axis] : std::max(high[k], vertex[axis]);
      first = first && axis < 2;
    }
  Canvas canvas(picture, {.text = fmt::format("place on the canonical body: red x {:.2f} to {:.2f} m, green y {:.2f} to {:.2f} m, blue z {:.2f} to {:.2f} m; lines every {:.0f} cm", low[0], high[0], low[1], high[1], low[2], high[2], 100 * line_spacing)});
  const auto strip = [](float x) { return std::floor(double{x} / line_spacing); };
  const auto width = static_cast<std::size_t>(picture.width);
  for (std::size_t i = 0; i < places.size(); ++i) {
    if (places[i][3] <= 0) continue;
    // A line is where the pixel to the right or below lies in the next strip, unless it is on another part of the body.
    bool line = false;
    for (const std::size_t next : {(i + 1) % width ? i + 1 : i, i + width < places.size() ? i + width : i}) {
      if (places[next][3] < 0.5f || places[i][3] < 0.5f) continue;
      for (std::size_t k = 0; k < 3; ++k) line = line || (std::abs(places[i][k] - places[next][k]) < 0.5 * line_spacing && strip(places[i][k]) != strip(places[next][k]));
    }
    Rgb color{};
    for (std::size_t k = 0; k < 3; ++k) color[k] = in_byte((line ? line_shade : 1) * std::clamp((places[i][k] - low[k]) / std::max(high[k] - low[k], 1e-9), 0.0, 1.0));
    canvas.set(i, color, places[i][3]);
  }
  return canvas.take();
}

LayerImage samples_layer(const Picture& picture) {
  const Inspection& told = inspected(picture, "samples");
  const uint32_t most = told.placed.empty() ? 0 : *std::max_element(told.placed.begin(), told.placed.end());
  Canvas canvas(picture, {"samples of the ray for which a colour was evaluated, of those placed on it", 0, std::max(1.0, double(most)), "samples", opencv_scale(cv::COLORMAP_INFERNO)});
  for (std::size_t i = 0; i < told.placed.size(); ++i)
    if (told.placed[i]) canvas.set(i, on_scale(canvas.legend(), told.shaded[i]));
  return canvas.take();
}

LayerImage steps_layer(const Picture& picture) {
  const Inspection& told = inspected(picture, "steps");
  Canvas canvas(picture, {"steps of Broyden's method for a sample's canonical point, mean of the ray", 0, most_mean_steps, "steps", opencv_scale(cv::COLORMAP_VIRIDIS)});
  for (std::size_t i = 0; i < told.wanted.size(); ++i)
    if (told.wanted[i]) canvas.set(i, on_scale(canvas.legend(), told.mean_steps(i)));
  return canvas.take();
}

LayerImage failures_layer(const Picture& picture) {
  const Inspection& told = inspected(picture, "failures");
  Canvas canvas(picture, {"samples of the ray without a canonical point; grey: all found", 0, 1, "of those searched", two_color_scale(few_failures, all_failures)});
  for (std::size_t i = 0; i < told.wanted.size(); ++i) {
    const float* color = &picture.color[3 * i];
    const uint8_t grey = in_byte(least_grey + body_shade * (0.2126 * color[0] + 0.7152 * color[1] + 0.0722 * color[2]));
    if (told.unfound[i]) canvas.set(i, on_scale(canvas.legend(), double(told.unfound[i]) / told.wanted[i]));
    else if (told.wanted[i]) canvas.set(i, {grey, grey, grey});
  }
  return canvas.take();
}

}  // namespace

const char* to_string(PictureLayer layer) {
  for (const LayerName& known : layer_names)
    if (known.layer == layer) return known.name;
  return "";
}

const std::vector<PictureLayer>& all_layers() {
  static const std::vector<PictureLayer> layers = [] {
    std::vector<PictureLayer> all;
    for (const LayerName& known : layer_names) all.push_back(known.layer);
    return all;
  }();
  return layers;
}

PictureLayer layer_named(const std::string& name) {
  std::vector<std::string> names;
  for (const LayerName& known : layer_names) {
    if (name == known.name) return known.layer;
    names.emplace_back(known.name);
  }
  throw InputError("layer", "", fmt::format("one of {}", fmt::join(names, ", ")), "'" + name + "'");
}

bool needs_inspection(PictureLayer layer) { return layer != PictureLayer::slice && layer != PictureLayer::color && layer != PictureLayer::normal && layer != PictureLayer::depth; }
bool needs_normals(PictureLayer layer) { return layer == PictureLayer::normal; }
bool needs_renderer(PictureLayer layer) { return layer == PictureLayer::weights || layer == PictureLayer::slice; }

std::string describe(const Legend& legend) {
  if (legend.colors.empty()) return legend.text;
  return fmt::format("{}: {:.4g} to {:.4g}{}{}", legend.text, legend.low, legend.high, legend.unit.empty() ? "" : " ", legend.unit);
}

std::vector<uint8_t> encode_png(const LayerImage& image) {
  std::vector<float> values;
  values.reserve(image.rgba.size());
  for (const uint8_t byte : image.rgba) values.push_back(static_cast<float>(byte) / 255.0f);
  return encode_png(values, image.width, image.height, 4);
}

LayerImage layer_image(PictureLayer layer, const Picture& picture, const Avatar& avatar) {
  switch (layer) {
    case PictureLayer::color: return color_layer(picture);
    case PictureLayer::normal: return normal_layer(picture);
    case PictureLayer::depth: return depth_layer(picture);
    case PictureLayer::canonical: return canonical_layer(picture, avatar);
    case PictureLayer::samples: return samples_layer(picture);
    case PictureLayer::steps: return steps_layer(picture);
    case PictureLayer::failures: return failures_layer(picture);
    case PictureLayer::weights:
    case PictureLayer::slice: break;
  }
  throw std::invalid_argument(fmt::format("layer {} of a picture alone", to_string(layer)));
}

Rgb joint_color(std::size_t joint) {
  const double hue = 6 * std::fmod(0.618034 * double(joint), 1.0), value = joint % 2 ? 0.7 : 1.0, pale = joint % 3 == 2 ? 0.35 : 0.0;
  Rgb color{};
  for (std::size_t c = 0; c < 3; ++c) {
    const double pure = std::clamp(std::abs(std::fmod(hue + (c == 0 ? 0.0 : c == 1 ? 4.0 : 2.0), 6.0) - 3) - 1, 0.0, 1.0);
    color[c] = in_byte(value * (pale + (1 - pale) * pure));
  }
  return color;
}

LayerImage weights_layer(Renderer& renderer, const Avatar& avatar, const Picture& picture, const Camera& camera, const Pose& pose, int joint) {
  const std::vector<std::array<float, 4>>& places = inspected(picture, "weights").canonical;
  const std::vector<std::string>& names = avatar.body.skeleton.names;
  const std::size_t joints = names.size();
  if (joint < -1 || joint >= static_cast<int>(joints)) throw std::invalid_argument(fmt::format("weights of joint {} of {}", joint, joints));
  Canvas canvas(picture, joint < 0 ? Legend{.text = "skinning weights: each joint in a colour of its own, mixed"}
                                   : Legend{fmt::format("skinning weight of {}", names[static_cast<std::size_t>(joint)]), 0, 1, "", three_color_scale(no_weight, half_weight, all_weight)});
  const bool by_posed_points = avatar.spec.skinning.kind == Skinning::backward;
  const glm::dvec3 root = root_translation(avatar.body.skeleton, pose);
  std::vector<glm::vec3> points;
  std::vector<std::size_t> pixels;
  const auto draw = [&] {
    const std::vector<float> weights = renderer.skinning_weights(points);
    for (std::size_t i = 0; i < pixels.size(); ++i) {
      const float* of_point = &weights[i * joints];
      Rgb color{};
      std::array<double, 3> sum{};
      for (std::size_t j = 0; j < joints; ++j)
        for (std::size_t c = 0; c < 3; ++c) sum[c] += double{of_point[j]} * joint_color(j)[c] / 255;
      for (std::size_t c = 0; c < 3; ++c) color[c] = in_byte(sum[c]);
      canvas.set(pixels[i], joint < 0 ? color : on_scale(canvas.legend(), of_point[joint]), places[pixels[i]][3]);
    }
    points.clear();
    pixels.clear();
  };
  for (std::size_t i = 0; i < places.size(); ++i) {
    if (places[i][3] <= 0 || (by_posed_points && picture.depth[i] <= 0)) continue;
    const PixelRay ray = camera.ray(double(i % static_cast<std::size_t>(picture.width)), double(i / static_cast<std::size_t>(picture.width)));
    points.push_back(by_posed_points ? glm::vec3(ray.origin + double{picture.depth[i]} * ray.direction - root) : glm::vec3(places[i][0], places[i][1], places[i][2]));
    pixels.push_back(i);
    if (points.size() == weights_at_a_time) draw();
  }
  if (!points.empty()) draw();
  return canvas.take();
}

LayerImage slice_layer(const DistanceSlice& slice) {
  Canvas canvas(slice.width, slice.height, {"signed distance on the plane, below 0 inside, with lines every centimetre", -farthest_distance, farthest_distance, "m", three_color_scale(deep_inside, at_surface, far_outside)});
  const auto width = static_cast<std::size_t>(slice.width);
  const auto strip = [](float d) { return std::floor(double{d} / distance_spacing); };
  for (std::size_t i = 0; i < slice.distances.size(); ++i) {
    if (!slice.found[i]) {
      canvas.set(i, without_distance);
      continue;
    }
    // A line between two pixels that lie in neighbouring strips; where the distance jumps there is none.
    bool line = false, surface = false;
    for (const std::size_t next : {(i + 1) % width ? i + 1 : i, i + width < slice.distances.size() ? i + width : i}) {
      if (!slice.found[next] || std::abs(double{slice.distances[i]}) > farthest_distance || std::abs(strip(slice.distances[i]) - strip(slice.distances[next])) > most_strips) continue;
      line = line || strip(slice.distances[i]) != strip(slice.distances[next]);
      surface = surface || (slice.distances[i] < 0) != (slice.distances[next] < 0);
    }
    const Rgb color = on_scale(canvas.legend(), slice.distances[i]);
    canvas.set(i, surface ? Rgb{0, 0, 0} : line ? mixed({0, 0, 0}, color, distance_shade) : color);
  }
  return canvas.take();
}

}  // namespace arah
