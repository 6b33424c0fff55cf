#include "host/training/pretrain_tasks.h"

#include <algorithm>
#include <cmath>

#include "host/input_error.h"
#include "kernels/losses/eikonal.h"
#include "kernels/losses/normal.h"
#include "kernels/losses/sdf_penalty.h"
#include "kernels/reduction/sum.h"
#include "shaders/shared/frame.h"

namespace arah {

ScanPoints::ScanPoints(const FamilyScan& scan, const CubeNormalization& cube) : surface_(scan.surface), cube_(cube) {
  if (surface_.triangles.empty()) throw InputError("family", fmt::format("body {}", scan.member), "a visible surface", "no triangle of it");
  double sum = 0;
  for (const glm::uvec3& t : surface_.triangles) {
    sum += glm::length(glm::cross(surface_.vertices[t.y] - surface_.vertices[t.x], surface_.vertices[t.z] - surface_.vertices[t.x]));
    areas_.push_back(sum);
  }
}

void ScanPoints::draw(std::mt19937_64& generator, float* position, float* normal) const {
  std::uniform_real_distribution<double> unit(0, 1);
  const double area = areas_.back() * unit(generator), root = std::sqrt(unit(generator)), v = unit(generator);
  const auto found = std::min<std::ptrdiff_t>(std::upper_bound(areas_.begin(), areas_.end(), area) - areas_.begin(), static_cast<std::ptrdiff_t>(areas_.size()) - 1);
  const glm::uvec3& t = surface_.triangles[static_cast<std::size_t>(found)];
  const glm::dvec3 w(1 - root, root * (1 - v), root * v);
  const glm::dvec3 p = cube_.to_cube(w.x * surface_.vertices[t.x] + w.y * surface_.vertices[t.y] + w.z * surface_.vertices[t.z]);
  const glm::dvec3 sum = w.x * surface_.normals[t.x] + w.y * surface_.normals[t.y] + w.z * surface_.normals[t.z];
  const double length = glm::length(sum);
  const glm::dvec3 n = length > 1e-6 ? sum / length : surface_.normals[t.x];
  for (int axis = 0; axis < 3; ++axis) position[axis] = static_cast<float>(p[axis]), normal[axis] = static_cast<float>(n[axis]);
}

ScanLoss::ScanLoss(Device& device, AvatarNetworks& networks, const PretrainSettings& settings)
    : device_(device), networks_(networks), settings_(settings), volume_first_(padded_points(settings.surface_points)),
      tape_(device, "pre-training: sdf", networks.sdf_shape(), volume_first_ + padded_points(settings.volume_points), SirenTape::Holds::second_order),
      normals_(device, "pre-training: normals", volume_first_ * 16ull, BufferPlace::device),
      losses_(device, "pre-training: losses", 256, BufferPlace::shared),
      partials_(device, "pre-training: partial sums of losses", partial_bytes(std::max(settings.surface_points, settings.volume_points)), BufferPlace::device),
      scratch_(device, "pre-training: partial sums", 4 * networks.sdf().weight_gradient_scratch(tape_.capacity()), BufferPlace::device) {}

ScanBatch ScanLoss::draw(const ScanPoints& points, std::mt19937_64& generator) const {
  ScanBatch batch{std::vector<float>(size_t(tape_.capacity()) * channel_padding, 0.0f), std::vector<float>(size_t(volume_first_) * 4, 0.0f)};
  for (uint32_t i = 0; i < settings_.surface_points; ++i) points.draw(generator, &batch.positions[size_t(i) * channel_padding], &batch.normals[size_t(i) * 4]);
  std::uniform_real_distribution<float> cube(-1, 1);
  for (uint32_t i = 0; i < settings_.volume_points; ++i)
    for (size_t axis = 0; axis < 3; ++axis) batch.positions[size_t(volume_first_ + i) * channel_padding + axis] = cube(generator);
  return batch;
}

void ScanLoss::upload(const ScanBatch& batch) {
  device_.upload(tape_.input().slice, batch.positions);
  device_.upload(normals_.slice(), batch.normals);
}

void ScanLoss::record(Commands& commands, uint32_t scans, bool gradients) {
  const PointRange all{volume_first_ + settings_.volume_points, {}};
  networks_.sdf().record_forward(commands, tape_, all, true);
  networks_.sdf().record_gradient(commands, tape_, all, true);
  const float normaliser = (float(settings_.surface_points) + float(settings_.volume_points)) * float(scans);
  const auto penalty = [&](SdfPenalty kind, uint32_t first, uint32_t points, double weight, Slot slot) {
    SdfPenaltyArgs args;
    args.penalty = kind;
    args.points = points;
    args.normaliser = normaliser;
    args.weight = static_cast<float>(weight);
    args.sdf = tape_.sdf().rows_from(first);
    args.d_sdf = tape_.sdf_cotangent().rows_from(first);
    args.losses = losses_.slice();
    args.slot = slot;
    args.partials = partials_.slice();
    record_sdf_penalty(commands, args);
  };
  penalty(SdfPenalty::on_surface, 0, settings_.surface_points, settings_.surface_weight, surface_slot);
  penalty(SdfPenalty::near_zero, volume_first_, settings_.volume_points, settings_.volume_weight, volume_slot);
  const auto unit_slope = [&](uint32_t first, uint32_t points) {
    EikonalLossArgs args;
    args.points = points;
    args.normaliser = normaliser;
    args.weight = static_cast<float>(settings_.eikonal_weight);
    args.gradients = tape_.gradient().rows_from(first);
    args.d_gradients = tape_.gradient_cotangent().rows_from(first);
    args.losses = losses_.slice();
    args.slot = unit_slope_slot;
    args.partials = partials_.slice();
    record_eikonal_loss(commands, args);
  };
  unit_slope(0, settings_.surface_points);
  unit_slope(volume_first_, settings_.volume_points);
  NormalLossArgs normal;
  normal.points = settings_.surface_points;
  normal.normaliser = normaliser;
  normal.weight = static_cast<float>(settings_.normal_weight);
  normal.gradients = tape_.gradient();
  normal.normals = normals_.slice();
  normal.d_gradients = tape_.gradient_cotangent();
  normal.losses = losses_.slice();
  normal.slot = normal_slot;
  normal.partials = partials_.slice();
  record_normal_loss(commands, normal);
  if (!gradients) return;
  Siren::Backward backward;
  backward.gradient = true;
  backward.scratch = scratch_.slice();
  networks_.sdf().record_backward(commands, tape_, all, backward);
}

double ScanLoss::value() {
  std::vector<float> sums(slots);
  device_.download(losses_.slice().elements(0, slots), sums.data(), sums.size() * 4);
  return settings_.surface_weight * double{sums[surface_slot]} + settings_.normal_weight * double{sums[normal_slot]} + settings_.volume_weight * double{sums[volume_slot]} +
         settings_.eikonal_weight * double{sums[unit_slope_slot]};
}

void SdfTasks::draw(std::size_t scan, uint32_t inner_step, std::mt19937_64& generator) {
  if (inner_step == 0) loss_.upload(loss_.draw(points_[scan], generator));
}

void SdfTasks::record(Commands& commands) {
  networks_.record_pack_shared_sdf(commands);
  loss_.record(commands, 1, true);
  networks_.record_unpack_shared_sdf(commands);
}

PoseTasks::PoseTasks(Device& device, AvatarNetworks& networks, ScanLoss& loss, const std::vector<ScanPoints>& points, const std::vector<std::vector<PosedScan>>& bodies, const PretrainSettings& settings)
    : networks_(networks), loss_(loss), points_(points), bodies_(bodies), settings_(settings),
      scratch_(device, "pre-training: partial sums of the pose networks", 4 * networks.unpack_scratch(), BufferPlace::device) {
  const auto poses = static_cast<uint32_t>(bodies.front().size());
  batches_ = (poses + settings.pose_batch - 1) / settings.pose_batch;
}

void PoseTasks::draw(std::size_t body, uint32_t inner_step, std::mt19937_64& generator) {
  const std::size_t poses = bodies_[body].size(), first = std::size_t{inner_step % batches_} * settings_.pose_batch;
  if (inner_step == 0) {
    body_ = body;
    drawn_.clear();
    for (const PosedScan& scan : bodies_[body]) drawn_.push_back(loss_.draw(points_[scan.scan], generator));
  }
  if (first == 0) {
    order_.resize(poses);
    for (std::size_t i = 0; i < poses; ++i) order_[i] = i;
    for (std::size_t i = 0; i + 1 < poses; ++i) std::swap(order_[i], order_[std::uniform_int_distribution<std::size_t>(i, poses - 1)(generator)]);
  }
  batch_ = std::span(order_).subspan(first, std::min<std::size_t>(settings_.pose_batch, poses - first));
}

void PoseTasks::record(Commands& commands) {
  const AvatarNetworks::PoseRegulariser regulariser{static_cast<float>(settings_.parameter_weight / frames()), loss_.losses(), ScanLoss::parameter_slot};
  for (uint32_t frame = 0; frame < frames(); ++frame) {
    commands.submit_and_wait();  // points and pose are uploaded at once
    loss_.upload(drawn_[batch_[frame]]);
    networks_.record_pack(commands, 0, bodies_[body_][batch_[frame]].pose);
    loss_.record(commands, frames(), true);
    networks_.record_unpack(commands, 0, {true, false, false}, scratch_.slice(), frame, regulariser);
  }
}

SkinningTasks::SkinningTasks(Device& device, AvatarNetworks& networks, std::vector<std::vector<WeightSample>> pools, const std::vector<CubeNormalization>& cubes, const PretrainSettings& settings)
    : device_(device), networks_(networks), pools_(std::move(pools)), cubes_(cubes), gradient_(device, networks, point_padding, settings.skinning_points),
      frame_(device, "pre-training: cube", sizeof(FrameConstants), BufferPlace::device), losses_(device, "pre-training: losses of skinning", 256, BufferPlace::shared),
      scratch_(device, "pre-training: partial sums of skinning", 4 * gradient_.scratch_floats(), BufferPlace::device) {}

void SkinningTasks::draw(std::size_t body, uint32_t inner_step, std::mt19937_64& generator) {
  gradient_.set_surface(pools_[body], generator, {});
  if (inner_step > 0) return;
  FrameConstants constants{};  // only the cube's map is read of a frame here
  constants.cube_scale = static_cast<float>(1 / cubes_[body].metres_per_unit());
  for (int axis = 0; axis < 3; ++axis) constants.cube_offset[axis] = static_cast<float>(cubes_[body].to_cube(glm::dvec3(0))[axis]);
  device_.upload(frame_.slice(), &constants, sizeof constants);
}

void SkinningTasks::record(Commands& commands) {
  networks_.skinning().record_pack(commands);
  gradient_.record_surface_loss(commands, frame_.slice(), WeightsMeasure::cross_entropy, 1, false, losses_.slice(), 0, scratch_.slice());
  networks_.skinning().record_unpack(commands);
}

double SkinningTasks::loss() {
  float sum = 0;
  device_.download(losses_.slice().elements(0, 1), &sum, 4);
  return double{sum};
}

}  // namespace arah
