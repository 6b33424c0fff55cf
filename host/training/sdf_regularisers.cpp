#include "host/training/sdf_regularisers.h"

#include <algorithm>

#include "kernels/losses/eikonal.h"
#include "kernels/losses/sdf_penalty.h"

namespace arah {

SdfRegularisers::SdfRegularisers(Device& device, AvatarNetworks& networks, const TrainingSettings& settings, const Ranks& ranks)
    : device_(device), networks_(networks), settings_(settings), eikonal_(ranks.part(settings.eikonal_points)), off_surface_(ranks.part(settings.off_surface_points)),
      inside_(ranks.part(settings.inside_points)), eikonal_tape_(device, "eikonal points", networks.sdf_shape(), eikonal_.size(), SirenTape::Holds::second_order),
      sign_tape_(device, "points inside and outside", networks.sdf_shape(), padded_points(off_surface_.size()) + padded_points(inside_.size()), SirenTape::Holds::first_order) {}

uint64_t SdfRegularisers::scratch_floats() const {
  return std::max(networks_.sdf().weight_gradient_scratch(eikonal_tape_.capacity()), networks_.sdf().weight_gradient_scratch(sign_tape_.capacity()));
}

void SdfRegularisers::draw(const TemplateSamples& samples, std::mt19937_64& generator) {
  std::uniform_real_distribution<float> cube(-1, 1);
  auto pick = [&](const std::vector<glm::vec3>& pool) { return pool[std::uniform_int_distribution<size_t>(0, pool.size() - 1)(generator)]; };
  // Point i of all, in the rows from `first` on, where it is of this rank's part.
  auto put = [](std::vector<float>& rows, uint32_t first, const Ranks::Part& part, uint32_t i, const glm::vec3& n) {
    if (i < part.begin || i >= part.end) return;
    for (int axis = 0; axis < 3; ++axis) rows[size_t(first + i - part.begin) * channel_padding + static_cast<size_t>(axis)] = n[axis];
  };
  std::vector<float> eikonal(size_t(eikonal_tape_.capacity()) * channel_padding, 0.0f), sign(size_t(sign_tape_.capacity()) * channel_padding, 0.0f);
  for (uint32_t i = 0; i < settings_.eikonal_points; ++i) {
    const float x = cube(generator), y = cube(generator), z = cube(generator);
    put(eikonal, 0, eikonal_, i, {x, y, z});
  }
  for (uint32_t i = 0; i < settings_.off_surface_points; ++i) put(sign, 0, off_surface_, i, networks_.cube().to_cube(pick(samples.off_surface)));
  for (uint32_t i = 0; i < settings_.inside_points; ++i) put(sign, padded_points(off_surface_.size()), inside_, i, networks_.cube().to_cube(pick(samples.inside)));
  device_.upload(eikonal_tape_.input().slice, eikonal);
  device_.upload(sign_tape_.input().slice, sign);
}

void SdfRegularisers::record(Commands& commands, const BufferSlice& losses, const Slots& slots, const BufferSlice& partials, const BufferSlice& scratch) {
  // Weight · ½ · mean: the paper's normalisation by its 2,048 rays at 1,024 points. Of several frames each has its part.
  const float frames = static_cast<float>(settings_.frames_per_step);
  const PointRange eikonal{eikonal_.size(), {}};
  networks_.sdf().record_forward(commands, eikonal_tape_, eikonal, true);
  networks_.sdf().record_gradient(commands, eikonal_tape_, eikonal, true);
  EikonalLossArgs loss;
  loss.points = eikonal_.size();
  loss.normaliser = 2.0f * float(settings_.eikonal_points) * frames;
  loss.weight = static_cast<float>(settings_.eikonal_weight);
  loss.gradients = eikonal_tape_.gradient();
  loss.d_gradients = eikonal_tape_.gradient_cotangent();
  loss.losses = losses;
  loss.slot = slots.eikonal;
  loss.partials = partials;
  record_eikonal_loss(commands, loss);
  Siren::Backward backward;
  backward.gradient = true;
  backward.accumulate = true;
  backward.scratch = scratch;
  networks_.sdf().record_backward(commands, eikonal_tape_, eikonal, backward);

  const uint32_t inside_first = padded_points(off_surface_.size());
  const PointRange sign{inside_first + inside_.size(), {}};
  networks_.sdf().record_forward(commands, sign_tape_, sign, true);
  auto penalty = [&](SdfPenalty kind, uint32_t first, uint32_t points, uint32_t of_all_ranks, double weight, uint32_t slot) {
    SdfPenaltyArgs args;
    args.penalty = kind;
    args.points = points;
    args.normaliser = 2.0f * float(of_all_ranks) * frames;
    args.weight = static_cast<float>(weight);
    args.sdf = sign_tape_.sdf().rows_from(first);
    args.d_sdf = sign_tape_.sdf_cotangent().rows_from(first);
    args.losses = losses;
    args.slot = slot;
    args.partials = partials;
    record_sdf_penalty(commands, args);
  };
  penalty(SdfPenalty::off_surface, 0, off_surface_.size(), settings_.off_surface_points, settings_.off_surface_weight, slots.off_surface);
  penalty(SdfPenalty::inside, inside_first, inside_.size(), settings_.inside_points, settings_.inside_weight, slots.inside);
  backward.gradient = false;
  networks_.sdf().record_backward(commands, sign_tape_, sign, backward);
}

}  // namespace arah
