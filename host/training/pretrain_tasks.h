// What a prior's networks learn from, task by task: scans for the SDF, bodies for the skinning network.
#pragma once

#include <random>
#include <span>
#include <vector>

#include "host/capture/body_family.h"
#include "host/rendering/avatar_networks.h"
#include "host/training/pretrain_settings.h"
#include "host/training/skinning_gradient.h"

namespace arah {

// Points of a scan, uniform by area, with normals; in the cube of its body. Keeps a reference to the scan.
class ScanPoints {
 public:
  // Throws InputError where the scan has no triangle.
  ScanPoints(const FamilyScan& scan, const CubeNormalization& cube);
  // position: in the cube, the first three of a row; normal: the same three of a vec4.
  void draw(std::mt19937_64& generator, float* position, float* normal) const;

 private:
  const CanonicalSurface& surface_;
  CubeNormalization cube_;
  std::vector<double> areas_;  // summed, doubled
};

// Drawn points of a scan, as rows of the device's layout: those on the surface with normals, then those anywhere in the cube.
struct ScanBatch {
  std::vector<float> positions, normals;
};

// MetaAvatar's loss of an SDF on the points of a scan (ARAH.md section 10, "Loss").
class ScanLoss {
 public:
  // settings must outlive this.
  ScanLoss(Device& device, AvatarNetworks& networks, const PretrainSettings& settings);

  ScanBatch draw(const ScanPoints& points, std::mt19937_64& generator) const;
  void upload(const ScanBatch& batch);
  void clear(Commands& commands) { commands.fill(losses_.slice(), 0); }
  // Of the uploaded points and the packed SDF, as one of `scans` scans whose mean is taken: losses (+=) and, with gradients,
  // those of the packed weights.
  void record(Commands& commands, uint32_t scans, bool gradients);
  double value();  // weighted sum since clear()

  BufferSlice losses() { return losses_.slice(); }
  enum Slot : uint32_t { surface_slot, normal_slot, volume_slot, unit_slope_slot, parameter_slot, slots };

 private:
  Device& device_;
  AvatarNetworks& networks_;
  const PretrainSettings& settings_;
  uint32_t volume_first_;  // row of the first point off the surface
  SirenTape tape_;
  Buffer normals_, losses_, partials_, scratch_;
};

// The SDF's tasks. A scan's points are drawn once for all its inner steps, as in the released program.
class SdfTasks {
 public:
  // points: of each scan. All must outlive this.
  SdfTasks(AvatarNetworks& networks, ScanLoss& loss, const std::vector<ScanPoints>& points) : networks_(networks), loss_(loss), points_(points) {}
  std::size_t count() const { return points_.size(); }

  void clear_losses(Commands& commands) { loss_.clear(commands); }
  // Uploads the points of a task, at its first inner step.
  void draw(std::size_t scan, uint32_t inner_step, std::mt19937_64& generator);
  // Gradients of the sdf group (+=) and losses (+=) of one inner step.
  void record(Commands& commands);
  double loss() { return loss_.value(); }

 private:
  AvatarNetworks& networks_;
  ScanLoss& loss_;
  const std::vector<ScanPoints>& points_;
};

// A body's scans, each with what pose_input() says of its pose.
struct PosedScan {
  std::size_t scan = 0;
  std::vector<float> pose;
};

// The pose networks' tasks, MetaAvatar's second stage: a body in all its poses, passed over in batches, in another order each
// time. A task's points are drawn once.
class PoseTasks {
 public:
  // bodies: their scans by number in `points`, as many of each. All must outlive this.
  PoseTasks(Device& device, AvatarNetworks& networks, ScanLoss& loss, const std::vector<ScanPoints>& points, const std::vector<std::vector<PosedScan>>& bodies, const PretrainSettings& settings);
  std::size_t count() const { return bodies_.size(); }
  uint32_t inner_steps() const { return settings_.pose.inner_steps * batches_; }

  void clear_losses(Commands& commands) { loss_.clear(commands); }
  void draw(std::size_t body, uint32_t inner_step, std::mt19937_64& generator);
  // Gradients of the pose networks (+=; those of hyper_last as outer products) and losses (+=) of one inner step; submits.
  void record(Commands& commands);
  uint32_t frames() const { return static_cast<uint32_t>(batch_.size()); }  // of the step that was recorded last
  double loss() { return loss_.value(); }  // without the regulariser

 private:
  AvatarNetworks& networks_;
  ScanLoss& loss_;
  const std::vector<ScanPoints>& points_;
  const std::vector<std::vector<PosedScan>>& bodies_;
  const PretrainSettings& settings_;
  uint32_t batches_ = 0;  // of a pass
  std::size_t body_ = 0;
  std::vector<ScanBatch> drawn_;      // of the body's scans
  std::vector<std::size_t> order_;    // of a pass
  std::span<const std::size_t> batch_;
  Buffer scratch_;
};

// The skinning network's tasks. Every inner step has points of its own.
class SkinningTasks {
 public:
  // pools: of each body's surface; cubes: by body, must outlive this.
  SkinningTasks(Device& device, AvatarNetworks& networks, std::vector<std::vector<WeightSample>> pools, const std::vector<CubeNormalization>& cubes, const PretrainSettings& settings);
  std::size_t count() const { return pools_.size(); }

  void clear_losses(Commands& commands) { commands.fill(losses_.slice(), 0); }
  void draw(std::size_t body, uint32_t inner_step, std::mt19937_64& generator);
  void record(Commands& commands);
  double loss();

 private:
  Device& device_;
  AvatarNetworks& networks_;
  std::vector<std::vector<WeightSample>> pools_;
  const std::vector<CubeNormalization>& cubes_;
  SkinningGradient gradient_;
  Buffer frame_, losses_, scratch_;
};

}  // namespace arah
