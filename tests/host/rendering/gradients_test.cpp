// Gradients of composited colours with respect to the parameters of every part, in a small configuration with all that
// the paper's has (mapping network, an SDF that follows the pose, normals and view as colour inputs, samples around the
// surface), against differences of the same function. The pose acts by a change of low rank, whose gradients are all written
// out; the hypernetwork's last layers have theirs in conditioning_test.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "host/rendering/field.h"
#include "host/rendering/ray_samples.h"
#include "host/training/pose_refinement.h"
#include "host/training/skinning_gradient.h"
#include "kernels/compositing/backward.h"
#include "kernels/compositing/forward.h"
#include "host/body/kinematics_gradient.h"
#include "kernels/reduction/sum.h"
#include "shaders/shared/ray.h"
#include "shaders/shared/skinning.h"
#include "tests/host/rendering/capsule_scene.h"

namespace arah {
namespace {

constexpr uint32_t ray_count = 31, samples = 34, latent_row_used = 0;

// L = Σ rays (rgb, Σ w) · fixed random numbers, of samples that stay where they are.
class ColorGradients : public DeviceTest, public testing::WithParamInterface<DirectionSpace> {
 protected:
  ColorGradients()
      : avatar(changed_avatar(device)), networks(device, avatar, true), body(device, avatar.body), frame(device, avatar, body, bent_pose(avatar.body.skeleton), {}),
        ray_samples(device, networks, ray_count, sampling()), field(device, networks, rows, samples, {.capacity = rows}, true), skinning(device, networks, rows, 64, counts.slice()), points(device, networks, rows) {
    const auto make = [&](const char* what, uint64_t bytes) {
      Buffer buffer(device, what, bytes, BufferPlace::device);
      commands.fill(buffer.slice(), 0);
      commands.submit_and_wait();
      return buffer;
    };
    const uint64_t padded_rays = padded_points(ray_count), padded_rows = padded_points(rows);
    colors = make("colours", padded_rays * 16), d_colors = make("d colours", padded_rays * 16), ray_depths = make("depths", padded_rays * 4);
    weights = make("weights", padded_rows * 4), transmittances = make("transmittances", padded_rows * 4), partials = make("partials", partial_bytes(ray_count, 2));
    canonical = make("canonical", padded_rows * 16), targets = make("targets", padded_rows * 16), transforms = make("transforms", padded_rows * 48);
    scratch = make("scratch", 4 * std::max(field.scratch_floats(), skinning.scratch_floats()));
    cotangent = uniform(padded_rays * 4);
    std::fill(cotangent.begin() + 4 * ray_count, cotangent.end(), 0.0f);
    device.upload(d_colors.slice(), cotangent);
    place();
  }

  static SamplingSettings sampling() {
    SamplingSettings settings;
    settings.mode = SamplingMode::surface;
    settings.samples = samples;
    settings.root.tolerance = 3e-6f;
    settings.root.max_iterations = 15;
    return settings;
  }

  // The mapping network's last layer starts at 0, which would hide the layers before it and the codes. Colours depend on
  // normal and view as strongly as on the density only with larger weights than the initial ones. b is large enough for
  // differences to be taken across several samples.
  static Avatar changed_avatar(Device& device) {
    AvatarSpec spec = following_the_pose(small_paper_spec());
    spec.color.directions = GetParam();
    Avatar avatar = capsule_avatar(device, spec);
    std::mt19937_64 generator(11);
    std::normal_distribution<float> normal(0, 0.01f);
    for (float& w : avatar.tensor("mapping.2.W")) w += normal(generator);
    let_the_pose_show(avatar, 2e-3f, generator);
    for (const char* gain : {"color.0.g", "color.1.g", "color.2.g", "color.3.g"})
      for (float& g : avatar.tensor(gain)) g *= 2.5f;
    avatar.tensor("b")[0] = 0.02f;
    return avatar;
  }

  // Samples on rays at the body, once; their correspondences and transforms are kept.
  void place() {
    const Camera camera = capsule_camera(45, 53);
    std::vector<uint32_t> pixels;
    for (uint32_t i = 0; i < ray_count; ++i) pixels.push_back((13 + (i * 7) % 19) | (10 + (i * 11) % 31) << 16);
    networks.record_pack(commands, latent_row_used, read_of_pose);
    commands.submit_and_wait();
    SurfaceFinder finder(device, networks, ray_count);
    SurfaceHits found_surface = ray_samples.search_surface(commands, frame, camera, pixels, finder, SurfaceFinder::Candidates::in_box);
    hits = finder.counts().hits;
    found_surface.points.resize(padded_points(ray_count), {0, 0, 0, 0});
    ray_samples.set_surface(found_surface);
    ray_samples.place(commands, frame, ray_count, {true, 4, 2, 0});
    const uint64_t bytes = uint64_t(padded_points(rows)) * 16;
    commands.copy(ray_samples.canonical().sub(0, bytes), canonical.slice());
    commands.copy(ray_samples.root_finder().record_transforms(commands, frame, {{rows, {}}, {}}, ray_samples.canonical()).sub(0, 3 * bytes), transforms.slice());
    commands.submit_and_wait();
    found = device.download<float>(canonical.slice());
    // Where the samples lie in posed space, for searches with other skinning parameters.
    const auto rays = device.download<Ray>(ray_samples.rays().sub(0, ray_count * sizeof(Ray)));
    const auto depths = device.download<float>(ray_samples.depths().elements(0, rows));
    std::vector<float> posed(padded_points(rows) * 4, 0.0f);
    for (uint32_t r = 0; r < rows; ++r) {
      for (size_t i = 0; i < 3; ++i) posed[4 * r + i] = rays[r / samples].origin[i] + depths[r] * rays[r / samples].direction[i] - frame.root_translation()[i];
      posed[4 * r + 3] = found[4 * r + 3];
      with_root += found[4 * r + 3] > 0;
    }
    device.upload(targets.slice(), posed);
  }

  // The frame in another pose, and the same places of the world as targets of the search.
  void set_pose(const Pose& pose) {
    if (world.empty()) {
      world = device.download<float>(targets.slice());
      for (size_t i = 0; i < world.size(); ++i)
        if (i % 4 < 3) world[i] += frame.root_translation()[i % 4];
    }
    frame.set_pose(device, avatar, pose);
    read_of_pose = pose_input(avatar, pose);
    std::vector<float> posed = world;
    for (size_t i = 0; i < posed.size(); ++i)
      if (i % 4 < 3) posed[i] -= frame.root_translation()[i % 4];
    device.upload(targets.slice(), posed);
  }

  Field::Inputs inputs() { return {frame.constants(), canonical.slice(), ray_samples.rays(), rows, transforms.slice()}; }

  CompositeForwardArgs composite() {
    CompositeForwardArgs args;
    args.samples.rays = ray_count;
    args.samples.samples = samples;
    args.samples.sdf = field.sdf();
    args.samples.metres_per_unit = static_cast<float>(avatar.cube.metres_per_unit());
    args.samples.rgb = field.rgb();
    args.samples.points = canonical.slice();
    args.samples.deltas = ray_samples.deltas();
    args.samples.parameters = networks.parameter("b");
    args.delta_mode = ray_samples.delta_mode();
    args.depths = ray_samples.depths();
    args.colors = colors.slice();
    args.ray_depths = ray_depths.slice();
    args.weights = weights.slice();
    args.transmittances = transmittances.slice();
    return args;
  }

  // search: correspondences are found anew, as a change of the skinning network asks for.
  double loss(const std::vector<float>& parameters, bool search) {
    device.upload(networks.parameters(), parameters);
    networks.record_pack(commands, latent_row_used, read_of_pose);
    if (search) points.solve(commands, frame, rows, targets.slice(), canonical.slice(), sampling().root);
    field.record_forward(commands, inputs());
    record_composite_forward(commands, composite());
    commands.submit_and_wait();
    if (search) {
      const std::vector<float> again = device.download<float>(canonical.slice());
      for (uint32_t r = 0; r < rows; ++r)
        if (again[4 * r + 3] != found[4 * r + 3]) ADD_FAILURE() << "the root of sample " << r << " was lost";
    }
    const std::vector<float> values = device.download<float>(colors.slice());
    double sum = 0;
    for (size_t i = 0; i < 4 * ray_count; ++i) sum += double(values[i]) * cotangent[i];
    return sum;
  }

  std::vector<float> gradients(const std::vector<float>& parameters, bool search, PoseGradient* pose = nullptr) {
    device.upload(networks.parameters(), parameters);
    commands.fill(networks.gradients(), 0);
    networks.record_pack(commands, latent_row_used, read_of_pose);
    if (search) points.solve(commands, frame, rows, targets.slice(), canonical.slice(), sampling().root);
    field.record_forward(commands, inputs());
    record_composite_forward(commands, composite());
    CompositeBackwardArgs back;
    back.samples = composite().samples;
    back.transmittances = transmittances.slice();
    back.colors = colors.slice();
    back.d_colors = d_colors.slice();
    back.d_sdf = field.d_sdf();
    back.d_rgb = field.d_rgb();
    back.gradients = networks.gradient("b");
    back.partials = partials.slice();
    record_composite_backward(commands, back);
    Field::Backward options;
    options.position = true;
    field.record_backward(commands, inputs(), options);
    skinning.record_from_positions(commands, frame, rows, canonical.slice(), field.position_gradient(), false, scratch.slice(), {.weights = true, .pose = pose});
    networks.record_unpack(commands, latent_row_used, {}, scratch.slice());
    commands.submit_and_wait();
    return device.download<float>(networks.gradients());
  }

  static constexpr uint32_t rows = ray_count * samples;
  Avatar avatar;
  std::vector<float> read_of_pose = pose_input(avatar, bent_pose(avatar.body.skeleton));
  AvatarNetworks networks;
  TemplateOnDevice body;
  FrameOnDevice frame;
  RaySamples ray_samples;
  Field field;
  Buffer counts = filled("counts", std::vector<shared::ImplicitCounts>(1));
  SkinningGradient skinning;
  PointRootFinder points;
  Buffer colors, d_colors, ray_depths, weights, transmittances, partials, canonical, targets, transforms, scratch;
  std::vector<float> cotangent, found, world;
  uint32_t with_root = 0;
  uint64_t hits = 0;  // of the rays
};

// The loss's change along a segment of a tensor's parameters is the integral of the analytic slope over it, corners of the
// networks' ReLUs included, which plain differences smear.
TEST_P(ColorGradients, IntegrateToTheLosssChangeInEveryTensor) {
  EXPECT_GT(hits, ray_count / 3);
  EXPECT_GT(with_root, rows / 2);
  const std::vector<float> start = avatar.parameters, analytic = gradients(start, false);
  std::normal_distribution<double> normal;
  double worst = 0;
  for (const TensorSlot& slot : avatar.layout.slots) {
    const bool search = slot.name.starts_with("skinning");
    double squares = 0;
    uint64_t largest = 0;
    for (uint64_t i = 0; i < slot.count; ++i) {
      squares += std::pow(double(analytic[slot.offset + i]), 2);
      if (std::abs(analytic[slot.offset + i]) > std::abs(analytic[slot.offset + largest])) largest = i;
    }
    const double length = std::sqrt(squares);
    ASSERT_GT(length, 0) << slot.name;
    // The number with the largest gradient alone; and all at random, with the gradient mixed in, or the change would drown
    // in rounding.
    for (const bool all : {false, true}) {
      if (all && slot.count == 1) continue;
      std::vector<double> along(slot.count, 0.0);
      if (all)
        for (uint64_t i = 0; i < slot.count; ++i) along[i] = analytic[slot.offset + i] / length + normal(generator) / std::sqrt(double(slot.count));
      else along[largest] = 1;
      const auto at = [&](double distance) {
        std::vector<float> moved = start;
        for (uint64_t i = 0; i < slot.count; ++i) moved[slot.offset + i] = static_cast<float>(start[slot.offset + i] + distance * along[i]);
        return moved;
      };
      const double width = std::min(4e-3, (search ? 5e-4 : 4e-3) / (all ? length : std::abs(double(analytic[slot.offset + largest]))));
      const double change = loss(at(width), search) - loss(at(-width), search);
      double integral = 0;
      // The networks between pose and SDF have many corners that one step of their first layers crosses together.
      const int parts = slot.name.starts_with("pose_code") || slot.name.starts_with("hyper") ? 25 : 5;
      for (int part = 0; part < parts; ++part) {
        const std::vector<float> slopes = gradients(at((2 * part + 1 - parts) * width / parts), search);
        for (uint64_t i = 0; i < slot.count; ++i) integral += 2 * width / parts * along[i] * slopes[slot.offset + i];
      }
      const double relative = std::abs(change - integral) / std::abs(integral);
      worst = std::max(worst, relative);
      std::printf("  %-14s %-8s change % .5e  integral % .5e  apart %.2e\n", slot.name.c_str(), all ? "all" : "largest", change, integral, relative);
      EXPECT_NEAR(change, integral, 0.01 * std::abs(integral)) << slot.name;
    }
  }
  std::printf("  largest relative difference %.1e\n", worst);
}

// The same for the pose: rotations of the root and of the joints, and the root's position. Samples stay where they are in the
// world; their roots are searched again, and the gradient goes through the implicit function theorem, the bones and the
// kinematics. The colour's normals are turned by the blended transform, which is held fixed on both sides.
TEST_P(ColorGradients, IntegrateToTheLosssChangeInThePose) {
  const std::vector<float> parameters = avatar.parameters;
  const Pose start = bent_pose(avatar.body.skeleton);
  const size_t joints = start.theta.size(), count = 3 * joints + 3;
  PoseGradient pose_gradient(device, networks, rows, counts.slice());
  const auto slopes = [&](const Pose& pose) {
    set_pose(pose);
    pose_gradient.record_clear(commands);
    gradients(parameters, true, &pose_gradient);
    const std::vector<float> sums = pose_gradient.download();
    std::vector<glm::dmat4> bones(joints, glm::dmat4(0.0));
    std::vector<double> result;
    glm::dvec3 translation(0);
    for (size_t b = 0; b < joints; ++b) {
      for (int i = 0; i < 12; ++i) bones[b][i % 4][i / 4] = double{sums[12 * b + size_t(i)]};
      translation += glm::dvec3(bones[b][3]);
    }
    std::vector<glm::dvec3> theta = kinematics_gradient(avatar.body.skeleton, avatar.canonical, pose, bones).theta;
    // The SDF follows the rotations of all joints but the root.
    const std::vector<float> input = networks.download_pose_gradient(device);
    for (size_t j = 1; j < joints; ++j) {
      glm::dmat3 rotation;
      for (int i = 0; i < 9; ++i) rotation[i % 3][i / 3] = double{input[9 * j + size_t(i)]};
      theta[j] += axis_angle_gradient(pose.theta[j], rotation);
    }
    for (const glm::dvec3& g : theta) result.insert(result.end(), {g.x, g.y, g.z});
    result.insert(result.end(), {translation.x, translation.y, translation.z});
    return result;
  };
  const auto loss_at = [&](const Pose& pose) {
    set_pose(pose);
    return loss(parameters, true);
  };
  const auto moved = [&](size_t number, double by) {
    Pose pose = start;
    (number < 3 * joints ? pose.theta[number / 3] : pose.root_position)[static_cast<int>(number % 3)] += by;
    return pose;
  };
  const std::vector<double> at_start = slopes(start);
  const double largest = std::abs(*std::max_element(at_start.begin(), at_start.end(), [](double a, double b) { return std::abs(a) < std::abs(b); }));
  double worst = 0;
  for (size_t number = 0; number < count; ++number) {
    constexpr int parts = 5;
    const double width = 2e-3;  // radians, metres
    const double change = loss_at(moved(number, width)) - loss_at(moved(number, -width));
    double integral = 0;
    for (int part = 0; part < parts; ++part) integral += 2 * width / parts * slopes(moved(number, (2 * part + 1 - parts) * width / parts))[number];
    const double apart = std::abs(change - integral) / (2 * width * largest);
    worst = std::max(worst, apart);
    std::printf("  %s %zu, axis %zu: change % .5e  integral % .5e  apart %.2e of the largest slope\n", number < 3 * joints ? "joint" : "root position", number < 3 * joints ? number / 3 : 0, number % 3, change, integral,
                apart);
    EXPECT_LE(apart, 0.01) << number;
  }
  std::printf("  largest difference %.1e of the largest slope\n", worst);
}
INSTANTIATE_TEST_SUITE_P(DirectionsOf, ColorGradients, testing::Values(DirectionSpace::observation, DirectionSpace::canonical),
                         [](const auto& chosen) { return std::string(to_string(chosen.param)); });

}  // namespace
}  // namespace arah
