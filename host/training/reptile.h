// Reptile (Nichol et al. 2018) with Adam inside and out, as the paper pre-trains its networks (ARAH.md section 10): from
// where the parameters start, each task is followed for some steps, and the mean of start − end is the gradient of an
// outer step. The loop knows no network: a task is whatever leaves gradients.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "host/avatar/safetensors.h"
#include "kernels/optimizer/outer_product.h"
#include "kernels/vulkan/commands.h"

namespace arah {

// The gradient of a matrix that is nowhere written out, at [begin, end) of the parameters, multiples of 64.
struct OuterGradient {
  uint64_t begin = 0, end = 0;
  OuterProduct product;
};

// A range of the parameters that is learned, with rates of its own. The others stay as they are.
struct ReptileGroup {
  std::string name;
  uint64_t begin = 0, end = 0;  // floats, multiples of 64 (ParameterGroup)
  double inner_rate = 1e-4, outer_rate = 1e-5;
  // Where a group has no place in the buffer of gradients: what an inner step's are, asked after the task has given them.
  std::function<std::vector<OuterGradient>()> outer_gradients;
};

// Beside the parameters four times the groups' numbers lie on the device (two moments inside, two outside) and, while a step
// runs, 1 + tasks times on the host.
class Reptile {
 public:
  // parameters and gradients: floats of the same layout, which the groups count in. Outer moments start at 0.
  Reptile(Device& device, const BufferSlice& parameters, const BufferSlice& gradients, std::vector<ReptileGroup> groups, uint32_t inner_steps);

  // Leaves the gradients (+=, they are 0) of one inner step of a task, by launches recorded or already run; may submit.
  using TaskGradients = std::function<void(Commands& commands, std::size_t task, uint32_t inner_step)>;

  // One outer step: the tasks one after the other, each from the same parameters and with moments of its own at 0; then
  // Adam on the mean of start − end. Throws std::runtime_error naming the group where a task ends in numbers that are not
  // finite, and leaves the parameters as they were. outer_factor: on the outer rates of this step.
  void step(std::span<const std::size_t> tasks, const TaskGradients& gradients, double outer_factor = 1);

  uint64_t steps() const { return steps_; }

  // Outer moments and steps as "reptile.<group>.first_moments", "….second_moments" and metadata "reptile.<group>.steps".
  void save(SafetensorsFile& file);
  // Throws InputError naming what is missing or of another size.
  void load(const SafetensorsFile& file);

 private:
  struct Moments {
    Buffer first, second;
  };
  std::vector<Moments> make_moments(const std::string& which) const;
  void record_inner_update(Commands& commands, std::size_t group, uint32_t step);
  void record_outer_update(Commands& commands, std::size_t group, double rate);
  std::vector<std::vector<float>> download_parameters() const;
  void upload_parameters(const std::vector<std::vector<float>>& values) const;

  Device& device_;
  BufferSlice parameters_, gradients_;
  std::vector<ReptileGroup> groups_;
  uint32_t inner_steps_;
  std::vector<Moments> inner_;  // by group
  std::vector<Moments> outer_;
  uint64_t steps_ = 0;
};

}  // namespace arah
