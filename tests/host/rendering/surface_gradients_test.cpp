// Surface rendering's gradients with respect to the parameters of every part, against differences of the same function with
// surfaces and correspondences searched anew: of colours at hits, and of the mask loss.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>

#include "host/training/mask_loss.h"
#include "host/training/surface_gradient.h"
#include "kernels/compositing/backward.h"
#include "kernels/reduction/sum.h"
#include "shaders/shared/skinning.h"
#include "tests/host/rendering/capsule_scene.h"

namespace arah {
namespace {

constexpr uint32_t ray_count = 61, row_used = 0;

// Of an avatar of this spec.
class Scene : public DeviceTest {
 protected:
  explicit Scene(const AvatarSpec& spec)
      : avatar(changed_avatar(device, spec)), networks(device, avatar, true), body(device, avatar.body), frame(device, avatar, body, bent_pose(avatar.body.skeleton), {}),
        settings(training_settings()), samples(device, networks, ray_count, settings.color_sampling()), shaded(device, networks, ray_count, 1, padded_points(ray_count)),
        skinning(spec.skinning.kind == Skinning::network ? std::make_unique<SkinningGradient>(device, networks, padded_points(ray_count), 64, counts.slice()) : nullptr),
        surface(device, networks, padded_points(ray_count), skinning.get(), counts.slice()), finder(device, networks, ray_count),
        mask_loss(device, networks, settings, padded_points(ray_count)) {
    const auto make = [&](const char* what, uint64_t bytes) {
      Buffer buffer(device, what, bytes, BufferPlace::device);
      commands.fill(buffer.slice(), 0);
      commands.submit_and_wait();
      return buffer;
    };
    const uint64_t padded = padded_points(ray_count);
    d_colors = make("d colours", padded * 16), partials = make("partials", std::max<uint64_t>(partial_bytes(ray_count, 2), 256)), losses = make("losses", 256);
    scratch = make("scratch", 4 * std::max({shaded.field().scratch_floats(), skinning ? skinning->scratch_floats() : 64, mask_loss.scratch_floats()}));
    cotangent = uniform(padded * 4);
    for (size_t ray = 0; ray < padded; ++ray) {
      if (ray >= ray_count) std::fill_n(cotangent.begin() + static_cast<ptrdiff_t>(4 * ray), 3, 0.0f);
      cotangent[4 * ray + 3] = 0;  // colour alone
    }
    device.upload(d_colors.slice(), cotangent);
    for (uint32_t i = 0; i < ray_count; ++i) pixels.push_back((13 + (i * 7) % 19) | (10 + (i * 11) % 31) << 16);
  }

  // Pixels of rays that meet the surface well before its edge, where it recedes by less than a ray's distance to its
  // neighbours: differences cannot follow a hit that slides away along a ray that grazes.
  std::vector<uint32_t> facing_pixels() {
    constexpr int width = 45, height = 53;
    use(avatar.parameters);
    std::vector<uint32_t> all, facing;
    for (int v = 0; v < height; ++v)
      for (int u = 0; u < width; ++u) all.push_back(static_cast<uint32_t>(u) | static_cast<uint32_t>(v) << 16);
    const SurfaceHits found = samples.search_surface(commands, frame, capsule_camera(width, height), all, finder, SurfaceFinder::Candidates::in_box);
    const auto at = [&](int u, int v) { return static_cast<size_t>(v * width + u); };
    for (int v = 2; v + 2 < height; ++v)
      for (int u = 2; u + 2 < width; ++u) {
        const double beside = 2 * found.depths[at(u, v)] / (1.55 * height);  // metres between rays two pixels apart
        bool faces = found.points[at(u, v)][3] > 0;
        for (const auto& [i, j] : {std::pair{-2, 0}, {2, 0}, {0, -2}, {0, 2}})
          faces = faces && found.points[at(u + i, v + j)][3] > 0 && std::abs(found.depths[at(u + i, v + j)] - found.depths[at(u, v)]) < beside;
        if (faces) facing.push_back(all[at(u, v)]);
      }
    std::printf("  %zu rays face the surface\n", facing.size());
    std::vector<uint32_t> some;
    for (uint32_t i = 0; i < ray_count && !facing.empty(); ++i) some.push_back(facing[i * facing.size() / ray_count]);
    return some;
  }

  static TrainingSettings training_settings() {
    TrainingSettings s;
    s.rendering = Rendering::surface;
    s.rays = ray_count;
    s.seed = 4;
    s.mask_samples = 21;
    s.sampling.root.tolerance = s.sampling.root.trace_tolerance = 1e-6f;
    s.sampling.root.max_iterations = 30;
    return s;
  }
  // As in gradients_test.cpp: so that every part has a gradient to speak of.
  static Avatar changed_avatar(Device& device, const AvatarSpec& spec) {
    Avatar avatar = capsule_avatar(device, spec);
    std::mt19937_64 generator(11);
    std::normal_distribution<float> normal(0, 0.01f);
    for (float& w : avatar.tensor("mapping.2.W")) w += normal(generator);
    for (const char* gain : {"color.0.g", "color.1.g", "color.2.g", "color.3.g"})
      for (float& g : avatar.tensor(gain)) g *= 2.5f;
    return avatar;
  }

  void use(const std::vector<float>& parameters) {
    device.upload(networks.parameters(), parameters);
    networks.record_pack(commands, row_used, {});
    commands.submit_and_wait();
  }

  // Colours of the rays where they hit the surface of now.
  void record_colors() {
    SurfaceHits found = samples.search_surface(commands, frame, capsule_camera(45, 53), pixels, finder, SurfaceFinder::Candidates::in_box);
    std::vector<bool> now;
    for (const auto& point : found.points) now.push_back(point[3] > 0);
    if (hits.empty()) hits = now;
    if (now != hits) ++lost_or_won;
    found.points.resize(padded_points(ray_count), {0, 0, 0, 0});
    samples.set_surface(found);
    samples.place(commands, frame, ray_count, {});
    ASSERT_TRUE(shaded.record_forward(commands, frame, samples, ray_count, {}));
  }

  // Σ over rays of colour · fixed random numbers.
  double color_loss(const std::vector<float>& parameters) {
    use(parameters);
    record_colors();
    commands.submit_and_wait();
    const std::vector<float> values = device.download<float>(shaded.colors());
    double sum = 0;
    for (size_t i = 0; i < 4 * ray_count; ++i) sum += double(values[i]) * cotangent[i];
    return sum;
  }

  std::vector<float> color_gradients(const std::vector<float>& parameters) {
    use(parameters);
    commands.fill(networks.gradients(), 0);
    record_colors();
    CompositeBackwardArgs back;
    back.samples = shaded.composited();
    back.transmittances = shaded.transmittances();
    back.colors = shaded.colors();
    back.d_colors = d_colors.slice();
    back.d_sdf = shaded.field().d_sdf();
    back.d_rgb = shaded.field().d_rgb();
    back.gradients = networks.gradients();
    back.partials = partials.slice();
    shaded.field().record_clear_cotangents(commands, shaded.queue().shaded());
    record_composite_backward(commands, back);
    Field::Backward options;
    options.position = true;
    shaded.field().record_backward(commands, shaded.inputs(), options);
    surface.record(commands, frame, samples, shaded, ray_count, skinning != nullptr, false, scratch.slice());
    networks.record_unpack(commands, row_used, {true, skinning != nullptr, true}, scratch.slice());
    commands.submit_and_wait();
    return device.download<float>(networks.gradients());
  }

  // The mask loss of all the rays, every second one said to show the person; with its gradients.
  double mask_value(const std::vector<float>& parameters, std::vector<float>* gradients = nullptr, double* d_alpha = nullptr, double alpha = 20) {
    use(parameters);
    commands.fill(networks.gradients(), 0);
    commands.fill(losses.slice(), 0);
    // Colours and regularisers come first in a step and set what the mask loss adds to: here zeros.
    Siren::Backward nothing;
    nothing.scratch = scratch.slice();
    commands.fill(nothing_tape.sdf_cotangent().slice, 0);
    networks.sdf().record_forward(commands, nothing_tape, {64, {}}, true);
    networks.sdf().record_backward(commands, nothing_tape, {64, {}}, nothing);
    commands.fill(zeros.slice(), 0);
    skinning->record_from_positions(commands, frame, 64, zeros.slice(), zeros.slice(), false, scratch.slice());
    MaskLoss::Rays rays;
    rays.pixels = pixels;
    for (uint32_t i = 0; i < ray_count; ++i) rays.masks.push_back(i % 2 ? 1.0f : 0.0f);
    mask_loss.record(commands, frame, capsule_camera(45, 53), rays, alpha, 3, skinning.get(), losses.slice(), 0, scratch.slice());
    networks.record_unpack(commands, row_used, {true, true, false}, scratch.slice());
    commands.submit_and_wait();
    const std::vector<float> values = device.download<float>(losses.slice().elements(0, 2));
    if (gradients) *gradients = device.download<float>(networks.gradients());
    if (d_alpha) *d_alpha = values[1];
    return settings.mask_weight * values[0];
  }

  // The loss's change along a segment of a tensor's parameters is the integral of the analytic slope over it. uncancelled: sum of
  // the slopes' sizes over rays, of a parameter in which they cancel; corners of the networks' ReLUs do not.
  void expect_integral(const TensorSlot& slot, const std::function<double(const std::vector<float>&)>& loss, const std::function<std::vector<float>(const std::vector<float>&)>& gradients,
                       const std::vector<float>& analytic, double aim, double uncancelled = 0) {
    const std::vector<float>& start = avatar.parameters;
    double squares = 0;
    for (uint64_t i = 0; i < slot.count; ++i) squares += std::pow(double(analytic[slot.offset + i]), 2);
    const double length = std::sqrt(squares);
    ASSERT_GT(length, 0) << slot.name;
    std::normal_distribution<double> normal;
    std::vector<double> along(slot.count);
    for (uint64_t i = 0; i < slot.count; ++i) along[i] = analytic[slot.offset + i] / length + normal(generator) / std::sqrt(double(slot.count));
    const auto at = [&](double distance) {
      std::vector<float> moved = start;
      for (uint64_t i = 0; i < slot.count; ++i) moved[slot.offset + i] = static_cast<float>(start[slot.offset + i] + distance * along[i]);
      return moved;
    };
    // Far enough for rounding to drown, and where correspondences move, the searches' tolerance of 1e-6 m.
    const bool search = slot.name.starts_with("skinning");
    const double width = std::min(search ? 0.02 : 4e-3, aim / std::max(length, uncancelled)), limit = search ? 0.02 : 0.01;
    const double change = loss(at(width)) - loss(at(-width));
    double integral = 0;
    constexpr int parts = 5;
    for (int part = 0; part < parts; ++part) {
      const std::vector<float> slopes = gradients(at((2 * part + 1 - parts) * width / parts));
      for (uint64_t i = 0; i < slot.count; ++i) integral += 2 * width / parts * along[i] * slopes[slot.offset + i];
    }
    std::printf("  %-14s change % .5e  integral % .5e  apart %.2e\n", slot.name.c_str(), change, integral, std::abs(change - integral) / std::abs(integral));
    EXPECT_NEAR(change, integral, limit * std::max(std::abs(integral), 2 * width * uncancelled)) << slot.name;
  }

  void expect_color_integrals() {
    pixels = facing_pixels();
    ASSERT_EQ(pixels.size(), ray_count);
    const std::vector<float> analytic = color_gradients(avatar.parameters);
    EXPECT_EQ(std::count(hits.begin(), hits.end(), true), ray_count);
    double moved_as_one = 0;  // f's bias moves the surface as a whole
    for (const std::vector<float> cotangents = device.download<float>(shaded.field().d_sdf().slice); const float value : cotangents) moved_as_one += std::abs(value);
    const std::string last_bias = "sdf." + std::to_string(avatar.spec.sdf.sine_layers) + ".b";
    for (const TensorSlot& slot : avatar.layout.slots) {
      if (slot.name == "b") {
        EXPECT_EQ(analytic[slot.offset], 0) << "no density, no scale of it";
        continue;
      }
      expect_integral(slot, [&](const auto& p) { return color_loss(p); }, [&](const auto& p) { return color_gradients(p); }, analytic, slot.name.starts_with("skinning") ? 1e-2 : 5e-3, slot.name == last_bias ? moved_as_one : 0);
      if (slot.name == last_bias) std::printf("  %s: slopes of rays add up to %.4f, their sizes to %.4f\n", last_bias.c_str(), analytic[slot.offset], moved_as_one);
      EXPECT_EQ(lost_or_won, 0) << slot.name;
      lost_or_won = 0;
    }
    EXPECT_EQ(device.download<shared::ImplicitCounts>(counts.slice())[0].singular, 0u);
  }

  Avatar avatar;
  AvatarNetworks networks;
  TemplateOnDevice body;
  FrameOnDevice frame;
  TrainingSettings settings;
  RaySamples samples;
  ShadedRays shaded;
  Buffer counts = filled("counts", std::vector<shared::ImplicitCounts>(1));
  std::unique_ptr<SkinningGradient> skinning;
  SurfaceGradient surface;
  SurfaceFinder finder;
  MaskLoss mask_loss;
  SirenTape nothing_tape{device, "nothing", networks.sdf_shape(), 64, SirenTape::Holds::first_order};
  Buffer d_colors, partials, losses, scratch, zeros{device, "zeros", 64 * 16, BufferPlace::device};
  std::vector<float> cotangent;
  std::vector<uint32_t> pixels;
  std::vector<bool> hits;
  int lost_or_won = 0;  // how often not the same rays hit the surface
};

// The blended transform that turns a normal is a constant to the gradient (ARAH.md §1), and not to differences: where it moves
// there are no normals here, and where there are it does not move.
AvatarSpec with_skinning_network() {
  AvatarSpec spec = small_paper_spec();
  spec.color.normal = false;
  return spec;
}
AvatarSpec with_normals() {
  AvatarSpec spec = small_paper_spec();
  spec.skinning = {Skinning::none, 0, 0};
  return spec;
}

class SurfaceGradients : public Scene {
 protected:
  SurfaceGradients() : Scene(with_skinning_network()) {}
};
class SurfaceGradientsWithNormals : public Scene {
 protected:
  SurfaceGradientsWithNormals() : Scene(with_normals()) {}
};

TEST_F(SurfaceGradients, OfColoursIntegrateToTheLosssChangeInEveryTensor) { expect_color_integrals(); }
TEST_F(SurfaceGradientsWithNormals, OfColoursIntegrateToTheLosssChangeInEveryTensor) { expect_color_integrals(); }

TEST_F(SurfaceGradients, OfTheMaskIntegrateToTheLosssChange) {
  std::vector<float> analytic;
  double d_alpha = 0;
  const double value = mask_value(avatar.parameters, &analytic, &d_alpha);
  for (const TensorSlot& slot : avatar.layout.slots) {
    if (!slot.name.starts_with("sdf") && !slot.name.starts_with("skinning") && !slot.name.starts_with("mapping") && slot.name != "latent") continue;
    expect_integral(
        slot, [&](const auto& p) { return mask_value(p); },
        [&](const auto& p) {
          std::vector<float> slopes;
          mask_value(p, &slopes);
          return slopes;
        },
        analytic, 2e-3 * value);
  }
  const double above = mask_value(avatar.parameters, nullptr, nullptr, 20.5), below = mask_value(avatar.parameters, nullptr, nullptr, 19.5);
  EXPECT_NEAR(d_alpha * settings.mask_weight, above - below, 1e-3 * std::abs(above - below));
}

}  // namespace
}  // namespace arah
