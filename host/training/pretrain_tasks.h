// What a prior's networks learn from, task by task: scans for the SDF, bodies for the skinning network.
#pragma once

#include <random>
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

// The SDF's tasks. A scan's points are drawn once for all its inner steps, as in the released program.
class SdfTasks {
 public:
  // cubes: by member. All must outlive this.
  SdfTasks(Device& device, AvatarNetworks& networks, const std::vector<FamilyScan>& scans, const std::vector<CubeNormalization>& cubes, const PretrainSettings& settings);
  std::size_t count() const { return points_.size(); }

  void clear_losses(Commands& commands) { commands.fill(losses_.slice(), 0); }
  // Uploads the points of a task, at its first inner step.
  void draw(std::size_t scan, uint32_t inner_step, std::mt19937_64& generator);
  // Gradients of the sdf group (+=) and losses (+=) of one inner step.
  void record(Commands& commands);
  double loss();  // weighted sum since clear_losses()

 private:
  enum Slot : uint32_t { surface_slot, normal_slot, volume_slot, unit_slope_slot, slots };

  Device& device_;
  AvatarNetworks& networks_;
  const PretrainSettings& settings_;
  uint32_t volume_first_;  // row of the first point off the surface
  SirenTape tape_;
  Buffer normals_, losses_, partials_, scratch_;
  std::vector<ScanPoints> points_;
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
