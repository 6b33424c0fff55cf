// Recording and running work: the one place where kernels are launched, checked, named and timed.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "kernels/vulkan/device.h"

struct VkCommandBuffer_T;

namespace arah {

// One argument of a launch. required_bytes: what the kernel will touch; a shorter slice is refused with both values.
struct Binding {
  BufferSlice slice;
  uint64_t required_bytes = 0;
  Binding() = default;
  Binding(const BufferSlice& s, uint64_t required = 0) : slice(s), required_bytes(required) {}  // NOLINT: meant to convert
};

struct Launch {
  const Pipeline* pipeline = nullptr;
  std::string name;                         // plain words for the profile, for example "sdf layer 2 forward"
  std::array<uint32_t, 3> groups{1, 1, 1};  // workgroups; ignored where `indirect` is given
  std::vector<Binding> bindings;            // binding 0, 1, …; an unused optional one may be empty
  const void* push_constants = nullptr;
  uint32_t push_constant_bytes = 0;
  BufferSlice indirect;         // three uint32 group counts on the device
  bool after_previous = true;   // false: reads nothing that the launch before it wrote, so no barrier is needed
  Cost cost;
  // Where only the device knows how much there is to do, the group counts of it (an indirect launch's own, as a rule), and
  // how many groups `cost` is for: the profile takes its part.
  BufferSlice cost_count;
  uint32_t cost_groups = 1;
};

// A command buffer that is recorded and run as often as wanted.
// Launches run in order; each sees all memory written by those before it (unless after_previous is false).
class Commands {
 public:
  explicit Commands(Device& device);
  ~Commands();
  Commands(const Commands&) = delete;
  Commands& operator=(const Commands&) = delete;

  Device& device() { return device_; }

  // The stage of the work that the launches recorded from now on belong to, for the profile: "" for none.
  void stage(const std::string& name);

  // Throws std::invalid_argument naming the launch where bindings, sizes, push constants or groups do not fit.
  void dispatch(const Launch& launch);
  void fill(const BufferSlice& slice, uint32_t word);
  void copy(const BufferSlice& from, const BufferSlice& to);

  // Runs what was recorded, waits for it, collects the profile and starts anew.
  // Throws std::runtime_error on a lost device or exhausted memory.
  void submit_and_wait();
  // In two: between them the host may do something else, but record nothing here (std::logic_error). What is recorded with other
  // Commands, uploaded or downloaded then must not be what runs.
  void submit();
  void wait();

 private:
  struct State;
  void barrier(uint32_t next_stage_is_transfer);
  void bind(VkCommandBuffer_T* buffer, const Launch& launch, const void* descriptor_writes, uint32_t count) const;
  void start(VkCommandBuffer_T* buffer);
  void finish();
  void compile(const Launch& launch, const void* descriptor_writes, uint32_t count);
  Device& device_;
  std::unique_ptr<State> state_;
};

}  // namespace arah
