#include "host/training/mask_loss.h"

#include <algorithm>
#include <cmath>

#include "kernels/losses/mask.h"
#include "kernels/reduction/sum.h"
#include "kernels/sampling/least_distance.h"
#include "kernels/skinning/position_gradient.h"
#include "kernels/tracing/normalise_inputs.h"

namespace arah {
namespace {

constexpr const char* sharpness_tensor = "training.mask_alpha";

SamplingSettings evenly(const TrainingSettings& settings) {
  SamplingSettings sampling = settings.sampling;
  sampling.mode = SamplingMode::uniform;
  sampling.samples = settings.mask_samples;
  return sampling;
}

}  // namespace

void MaskSharpness::learn(double gradient) {
  updates_ += 1;
  first_ = 0.9 * first_ + 0.1 * gradient;
  second_ = 0.999 * second_ + 0.001 * gradient * gradient;
  const double size = std::sqrt(second_ / (1 - std::pow(0.999, updates_))) + 1e-8;
  alpha_ -= rate_ * first_ / (1 - std::pow(0.9, updates_)) / size;
}

void MaskSharpness::save(SafetensorsFile& file) const { file.tensors[sharpness_tensor] = Tensor::from<double>({4}, std::vector<double>{alpha_, first_, second_, updates_}); }

void MaskSharpness::load(const SafetensorsFile& file) {
  const std::vector<double> saved = file.values<double>(sharpness_tensor, {4});
  alpha_ = saved[0], first_ = saved[1], second_ = saved[2], updates_ = saved[3];
}

MaskLoss::MaskLoss(Device& device, AvatarNetworks& networks, const TrainingSettings& settings, uint32_t rays)
    : device_(device), networks_(networks), settings_(settings), rays_(rays), samples_(device, networks, rays, evenly(settings)),
      distances_(device, networks, rays * settings.mask_samples, settings.mask_samples, {.capacity = point_padding}, false),
      tape_(device, "least distances", networks.sdf_shape(), rays, SirenTape::Holds::first_order) {
  const auto make = [&](const char* what, uint64_t bytes) {
    Buffer buffer(device, std::string("mask loss: ") + what, bytes, BufferPlace::device);
    Commands zero(device);
    zero.fill(buffer.slice(), 0);
    zero.submit_and_wait();
    return buffer;
  };
  distances_.make_room_for_gaps();
  least_ = make("nearest points", rays * 16ull);
  masks_ = make("masks", rays * 4ull);
  if (settings.ray_importance > 0) weights_ = make("weights of rays", rays * 4ull);
  partials_ = make("partial sums", std::max<uint64_t>(partial_bytes(rays, 2), 256));
  if (!samples_.root_finder().searches()) return;
  upstream_ = make("gradient at x", rays * 16ull);
  no_other_path_ = make("gradient of no other path", rays * 16ull);
}

void MaskLoss::record(Commands& commands, FrameOnDevice& frame, const Camera& camera, const Rays& rays, double alpha, uint32_t step, SkinningGradient* skinning, const BufferSlice& losses,
                      uint32_t slot, const BufferSlice& scratch) {
  for (size_t first = 0; first < rays.pixels.size(); first += rays_) {
    const auto count = static_cast<uint32_t>(std::min<size_t>(rays_, rays.pixels.size() - first));
    const auto part = [&](const auto& all) { return std::vector(all.begin() + static_cast<ptrdiff_t>(first), all.begin() + static_cast<ptrdiff_t>(first + count)); };
    samples_.set_pixels(commands, frame, camera, part(rays.pixels));
    device_.upload(masks_.slice(), part(rays.masks));
    if (!rays.weights.empty()) device_.upload(weights_.slice(), part(rays.weights));
    samples_.place(commands, frame, count, {true, static_cast<uint32_t>(settings_.seed), step, rays.first + static_cast<uint32_t>(first)});
    commands.stage("mask loss");
    const Matrix by_row = distances_.record_distances(commands, frame.constants(), samples_.canonical(), samples_.rows(count), true);
    record_least_distance(commands, {count, settings_.mask_samples, by_row, samples_.canonical(), least_.slice()});

    const PointRange range{count, {}};
    record_normalise_inputs(commands, {{range, {}}, frame.constants(), least_.slice(), tape_.input()});
    networks_.sdf().record_forward(commands, tape_, range, true);
    MaskLossArgs loss;
    loss.rays = count;
    loss.normaliser = float(all_rays(settings_));
    loss.weight = static_cast<float>(settings_.mask_weight);
    loss.alpha = static_cast<float>(alpha);
    loss.sdf = tape_.sdf();
    loss.points = least_.slice();
    loss.masks = masks_.slice();
    loss.d_sdf = tape_.sdf_cotangent();
    loss.losses = losses;
    loss.slot = slot;
    loss.partials = partials_.slice();
    if (!rays.weights.empty()) loss.weights = weights_.slice();
    record_mask_loss(commands, loss);
    Siren::Backward backward;
    backward.accumulate = true;
    backward.input_gradient = skinning != nullptr;
    backward.scratch = scratch;
    networks_.sdf().record_backward(commands, tape_, range, backward);
    if (skinning) {
      record_position_gradient(commands, {count, frame.constants(), tape_.input_gradient(), no_other_path_.slice(), upstream_.slice()});
      skinning->record_from_positions(commands, frame, count, least_.slice(), upstream_.slice(), true, scratch);
    }
    if (first + count < rays.pixels.size()) commands.submit_and_wait();  // before the next ones' uploads
  }
}

}  // namespace arah
