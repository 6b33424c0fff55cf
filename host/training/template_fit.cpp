#include "host/training/template_fit.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>
#include <stdexcept>

#include "host/body/canonical.h"
#include "host/training/skinning_gradient.h"
#include "kernels/optimizer/adam.h"
#include "shaders/shared/frame.h"

namespace arah {
namespace {

constexpr uint32_t points = 2048;  // a step
constexpr double distance_weight = 10, eikonal_weight = 0.1;  // RECIPE.md §1, "init"
constexpr uint64_t eikonal_every = 4;
// Radians about each axis of each joint, of the poses that a backward network begins with.
constexpr double deviation_from_rest = 0.3, deviation_from_given = 0.05;
constexpr double end_fraction = 0.02;  // of the rate, by a cosine

// Adam over one group of the flat buffer.
class GroupOptimizer {
 public:
  GroupOptimizer(Device& device, AvatarNetworks& networks, const std::string& group)
      : networks_(networks), begin_(networks.layout().group(group).begin), count_(networks.layout().group(group).size()),
        first_(device, "fit: first moments", count_ * 4, BufferPlace::device), second_(device, "fit: second moments", count_ * 4, BufferPlace::device) {
    Commands zero(device);
    zero.fill(first_.slice(), 0);
    zero.fill(second_.slice(), 0);
    zero.submit_and_wait();
  }
  BufferSlice gradients() { return networks_.gradients().elements(begin_, count_); }
  BufferSlice parameters() { return networks_.parameters().elements(begin_, count_); }
  void record(Commands& commands, uint32_t step, double rate) {
    AdamArgs adam;
    adam.step = step;
    adam.rate = rate;
    adam.parameters = parameters();
    adam.gradients = gradients();
    adam.first_moments = first_.slice().elements(0, count_);
    adam.second_moments = second_.slice().elements(0, count_);
    record_adam(commands, adam);
  }

 private:
  AvatarNetworks& networks_;
  uint64_t begin_, count_;
  Buffer first_, second_;
};

// Whether the SDF of a pose is another than the one that all poses share: V alone, which is never zero, changes nothing.
bool follows_pose(const Avatar& avatar) {
  return std::ranges::any_of(avatar.layout.slots, [&](const TensorSlot& slot) {
    const bool changes = slot.name.starts_with("hyper_last.") || (slot.name.starts_with("low_rank.") && !slot.name.ends_with(".V"));
    return changes && std::ranges::any_of(avatar.tensor(slot.name), [](float p) { return p != 0; });
  });
}

double rate_at(double rate, uint32_t step, uint32_t steps) {
  return rate * (end_fraction + (1 - end_fraction) * 0.5 * (1 + std::cos(std::numbers::pi * step / steps)));
}

// What was fitted, before it goes anywhere: the parameters, and the error that is left, which distances beyond float32 make infinite.
void check_fit(const char* what, const char* rate_name, double rate, const std::vector<float>& parameters, double error) {
  const auto bad = static_cast<uint64_t>(std::ranges::count_if(parameters, [](float p) { return !std::isfinite(p); }));
  if (bad == 0 && std::isfinite(error)) return;
  throw std::runtime_error(fmt::format("stage 'template fit': {} of the {} parameters of the {} are NaN or infinite, its error is {}. {} is {}: choose a lower one, some {}.", bad, parameters.size(), what, error, rate_name, rate,
                                       rate_name == std::string("fit_rate") ? "1e-3" : "5e-3"));
}

}  // namespace

TemplateFit fit_template(Device& device, Avatar& avatar, const TrainingSettings& settings, const std::function<bool(double)>& progress, const std::vector<Pose>& poses) {
  const TemplateSamples samples = draw_template_samples(avatar, settings.seed);
  AvatarNetworks networks(device, avatar, true);
  Commands commands(device);
  std::mt19937_64 generator(settings.seed ^ 0x51f7ull);
  const bool skins = avatar.spec.skinning.learned();
  const double all = settings.fit_steps + (skins ? settings.fit_skinning_steps : 0);
  auto report = [&](double done) {
    if (progress && !progress(done / std::max(all, 1.0))) throw std::runtime_error("stopped");
  };
  TemplateFit fit;

  // SDF. The losses are simple and the points few: the host forms the cotangents from the device's values.
  SirenTape tape(device, "fit: sdf", networks.sdf_shape(), points, SirenTape::Holds::second_order);
  Buffer scratch(device, "fit: partial sums", 4 * std::max(networks.sdf().weight_gradient_scratch(points), networks.unpack_scratch()), BufferPlace::device);
  GroupOptimizer sdf(device, networks, "sdf");
  const double unit = avatar.cube.metres_per_unit();
  std::vector<float> input(size_t(points) * channel_padding), cotangent(input.size()), target(points);
  auto draw = [&](bool near_surface_only) {
    for (uint32_t i = 0; i < points; ++i) {
      const auto& pool = near_surface_only || i % 2 ? samples.near : samples.volume;
      const DistanceSample& s = pool[std::uniform_int_distribution<size_t>(0, pool.size() - 1)(generator)];
      const glm::dvec3 n = avatar.cube.to_cube(s.position);
      for (int axis = 0; axis < 3; ++axis) input[size_t(i) * channel_padding + static_cast<size_t>(axis)] = static_cast<float>(n[axis]);
      target[i] = static_cast<float>((s.signed_distance - settings.clothing) / unit);
    }
    device.upload(tape.input().slice, input);
  };
  const bool posed_sdf = follows_pose(avatar);
  const auto pose_of = [&](uint32_t step) { return posed_sdf ? pose_input(avatar, poses.empty() ? rest_pose(avatar.body.skeleton) : poses[step % poses.size()]) : std::vector<float>{}; };
  for (uint32_t step = 0; step < settings.fit_steps; ++step) {
    const bool eikonal = step % eikonal_every == 0;
    draw(false);
    networks.record_pack(commands, 0, pose_of(step));
    networks.sdf().record_forward(commands, tape, {points, {}}, true);
    if (eikonal) networks.sdf().record_gradient(commands, tape, {points, {}}, true);
    commands.submit_and_wait();
    const auto f = device.download<float>(tape.sdf().slice);
    for (uint32_t i = 0; i < points; ++i) {
      const float error = f[size_t(i) * channel_padding] - target[i];
      cotangent[size_t(i) * channel_padding] = static_cast<float>(distance_weight / points) * (error > 0 ? 1.0f : error < 0 ? -1.0f : 0.0f);
    }
    device.upload(tape.sdf_cotangent().slice, cotangent);
    if (eikonal) {
      auto gradient = device.download<float>(tape.gradient().slice);
      for (uint32_t i = 0; i < points; ++i) {
        float* g = &gradient[size_t(i) * channel_padding];
        const double length = std::sqrt(double(g[0]) * g[0] + double(g[1]) * g[1] + double(g[2]) * g[2]);
        const double factor = length > 0 ? eikonal_weight / points * (length > 1 ? 1 : -1) / length : 0;
        for (int axis = 0; axis < 3; ++axis) g[axis] = static_cast<float>(factor * g[axis]);
      }
      device.upload(tape.gradient_cotangent().slice, gradient);
    }
    commands.fill(networks.gradients(), 0);
    Siren::Backward backward;
    backward.gradient = eikonal;
    backward.scratch = scratch.slice();
    networks.sdf().record_backward(commands, tape, {points, {}}, backward);
    networks.record_unpack_shared_sdf(commands);
    sdf.record(commands, step + 1, rate_at(settings.fit_rate, step, settings.fit_steps));
    commands.submit_and_wait();
    report(step);
  }
  draw(true);
  networks.record_pack(commands, 0, pose_of(settings.fit_steps));
  networks.sdf().record_forward(commands, tape, {points, {}}, false);
  commands.submit_and_wait();
  const auto f = device.download<float>(tape.sdf().slice);
  double sum = 0, count = 0;
  for (uint32_t i = 0; i < points; ++i)
    if (std::abs(target[i] * unit + settings.clothing) < 0.01) sum += std::abs(f[size_t(i) * channel_padding] - target[i]) * unit, count += 1;
  fit.sdf_error = sum / std::max(count, 1.0);
  check_fit("SDF", "fit_rate", settings.fit_rate, device.download<float>(sdf.parameters()), fit.sdf_error);

  if (skins) {
    SkinningGradient gradient(device, networks, point_padding, points);
    Buffer skinning_scratch(device, "fit: partial sums of skinning", 4 * gradient.scratch_floats(), BufferPlace::device);
    Buffer losses(device, "fit: losses", 256, BufferPlace::shared);
    GroupOptimizer skinning(device, networks, "skinning");
    // Of a frame only the cube's map is read here, and by a backward network the pose: another one in each step.
    const bool posed = avatar.spec.skinning.kind == Skinning::backward;
    std::vector<glm::dmat4> bones;
    const FrameConstants cube = frame_constants(avatar.cube, bones, glm::dvec3(0));
    Buffer frame(device, "fit: frame", sizeof cube, BufferPlace::device);
    device.upload(frame.slice(), &cube, sizeof cube);
    const auto joints = static_cast<uint32_t>(avatar.body.skeleton.size());
    Buffer rotations(device, "fit: rotations of joints", std::max(pose_inputs(joints) * 4ull, 256ull), BufferPlace::device);
    const auto take_pose = [&] {
      std::normal_distribution<double> angle(0, poses.empty() ? deviation_from_rest : deviation_from_given);
      Pose pose = poses.empty() ? rest_pose(avatar.body.skeleton) : poses[std::uniform_int_distribution<size_t>(0, poses.size() - 1)(generator)];
      for (glm::dvec3& theta : pose.theta) theta += glm::dvec3{angle(generator), angle(generator), angle(generator)};
      bones = bone_transforms(avatar.body.skeleton, avatar.canonical, pose);
      const FrameConstants constants = frame_constants(avatar.cube, bones, glm::dvec3(0));
      device.upload(frame.slice(), &constants, sizeof constants);
      device.upload(rotations.slice(), joint_rotations(pose));
      networks.record_pose(commands, rotations.slice());
    };
    for (uint32_t step = 0; step < settings.fit_skinning_steps; ++step) {
      const bool last = step + 1 == settings.fit_skinning_steps;  // measured on the surface as training does, and not stepped
      if (posed) take_pose();
      gradient.set_surface(step % 2 && !last ? samples.around : samples.surface, generator, bones);
      commands.fill(networks.gradients(), 0);
      commands.fill(losses.slice(), 0);
      networks.record_pack(commands, 0, {});
      gradient.record_surface_loss(commands, frame.slice(), last ? WeightsMeasure::absolute : WeightsMeasure::cross_entropy, 1, false, losses.slice(), 0, skinning_scratch.slice());
      networks.record_unpack(commands, 0, {false, true, false}, skinning_scratch.slice());
      if (!last) skinning.record(commands, step + 1, rate_at(settings.fit_skinning_rate, step, settings.fit_skinning_steps));
      commands.submit_and_wait();
      if (last) {
        float loss = 0;
        device.download(losses.slice().elements(0, 1), &loss, 4);
        fit.skinning_error = loss;
      }
      report(settings.fit_steps + step);
    }
    check_fit("skinning network", "fit_skinning_rate", settings.fit_skinning_rate, device.download<float>(skinning.parameters()), fit.skinning_error);
  }
  avatar.parameters = device.download<float>(networks.parameters().elements(0, networks.layout().floats));
  return fit;
}

}  // namespace arah
