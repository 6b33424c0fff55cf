#include "kernels/vulkan/commands.h"

#include <fmt/format.h>

#include <stdexcept>

#include "kernels/vulkan/device_state.h"

namespace arah {
namespace {
constexpr uint32_t launches_per_pool = 2048;  // two timestamps each, and where wanted a count of the work
}

struct Commands::State {
  VkCommandPool pool = VK_NULL_HANDLE;
  VkCommandBuffer buffer = VK_NULL_HANDLE;
  VkFence fence = VK_NULL_HANDLE;
  bool recording = false;
  bool anything_written = false;

  std::string stage;

  struct Timed {
    std::string name, shader, stage;
    Cost cost;
    uint32_t cost_groups = 0;  // 0: the cost is known
  };
  std::vector<VkQueryPool> queries;
  std::vector<Buffer> counts;  // of each pool: by launch, the groups of work that there were
  std::vector<Timed> timed;
};

Commands::Commands(Device& device) : device_(device), state_(std::make_unique<State>()) {
  DeviceState& s = device.state();
  VkCommandPoolCreateInfo pool{VK_STRUCTURE_TYPE_COMMAND_POOL_CREATE_INFO};
  pool.flags = VK_COMMAND_POOL_CREATE_RESET_COMMAND_BUFFER_BIT;
  pool.queueFamilyIndex = s.queue_family;
  check(vkCreateCommandPool(s.device, &pool, nullptr, &state_->pool), "command pool");
  VkCommandBufferAllocateInfo allocation{VK_STRUCTURE_TYPE_COMMAND_BUFFER_ALLOCATE_INFO};
  allocation.commandPool = state_->pool;
  allocation.level = VK_COMMAND_BUFFER_LEVEL_PRIMARY;
  allocation.commandBufferCount = 1;
  check(vkAllocateCommandBuffers(s.device, &allocation, &state_->buffer), "command buffer");
  const VkFenceCreateInfo fence{VK_STRUCTURE_TYPE_FENCE_CREATE_INFO};
  check(vkCreateFence(s.device, &fence, nullptr, &state_->fence), "fence");
}

Commands::~Commands() {
  DeviceState& s = device_.state();
  vkDeviceWaitIdle(s.device);
  for (VkQueryPool pool : state_->queries) vkDestroyQueryPool(s.device, pool, nullptr);
  if (state_->fence) vkDestroyFence(s.device, state_->fence, nullptr);
  if (state_->pool) vkDestroyCommandPool(s.device, state_->pool, nullptr);
}

// Makes all earlier writes visible to what follows: one memory barrier, and none before the first work of a batch
// (submission itself makes host writes visible).
void Commands::barrier(uint32_t next_stage_is_transfer) {
  State& s = *state_;
  if (!s.recording) {
    const VkCommandBufferBeginInfo begin{VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO, nullptr, VK_COMMAND_BUFFER_USAGE_ONE_TIME_SUBMIT_BIT, nullptr};
    check(vkBeginCommandBuffer(s.buffer, &begin), "recording commands");
    s.recording = true;
  }
  if (s.anything_written) {
    const VkPipelineStageFlags all = VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT | VK_PIPELINE_STAGE_TRANSFER_BIT;
    VkMemoryBarrier memory{VK_STRUCTURE_TYPE_MEMORY_BARRIER};
    memory.srcAccessMask = VK_ACCESS_SHADER_WRITE_BIT | VK_ACCESS_TRANSFER_WRITE_BIT;
    memory.dstAccessMask = next_stage_is_transfer ? VK_ACCESS_TRANSFER_READ_BIT | VK_ACCESS_TRANSFER_WRITE_BIT
                                                  : VK_ACCESS_SHADER_READ_BIT | VK_ACCESS_SHADER_WRITE_BIT | VK_ACCESS_UNIFORM_READ_BIT | VK_ACCESS_INDIRECT_COMMAND_READ_BIT;
    vkCmdPipelineBarrier(s.buffer, all, next_stage_is_transfer ? VK_PIPELINE_STAGE_TRANSFER_BIT : VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT | VK_PIPELINE_STAGE_DRAW_INDIRECT_BIT, 0, 1,
                         &memory, 0, nullptr, 0, nullptr);
  }
  s.anything_written = true;
}

void Commands::stage(const std::string& name) { state_->stage = name; }

void Commands::dispatch(const Launch& launch) {
  DeviceState& device = device_.state();
  auto refuse = [&](const std::string& text) { return std::invalid_argument("launch '" + launch.name + "': " + text); };
  if (!launch.pipeline) throw refuse("has no pipeline");
  const ShaderInterface& face = launch.pipeline->interface;
  if (launch.bindings.size() != face.bindings.size())
    throw refuse(fmt::format("{} takes {} bindings, {} given", launch.pipeline->name, face.bindings.size(), launch.bindings.size()));
  if (launch.push_constant_bytes != face.push_constant_bytes)
    throw refuse(fmt::format("{} takes {} bytes of push constants, {} given", launch.pipeline->name, face.push_constant_bytes, launch.push_constant_bytes));
  if (launch.indirect.empty()) {
    for (const uint32_t groups : launch.groups) {
      if (groups == 0) return;  // nothing to do
      if (groups > device.report.max_workgroups_x) throw refuse(fmt::format("{} workgroups in one dimension, the device allows {}", groups, device.report.max_workgroups_x));
    }
  } else if (launch.indirect.bytes < 12 || launch.indirect.offset % 4) {
    throw refuse("indirect group counts need 12 bytes at a multiple of 4");
  }

  std::vector<VkDescriptorBufferInfo> infos(face.bindings.size());
  std::vector<VkBufferView> views(face.bindings.size());
  std::vector<VkWriteDescriptorSet> writes;
  for (size_t i = 0; i < face.bindings.size(); ++i) {
    const Binding& binding = launch.bindings[i];
    const ShaderBinding& want = face.bindings[i];
    if (binding.slice.empty()) throw refuse(fmt::format("binding {} ({}) is empty", i, want.name));
    if (binding.slice.bytes < binding.required_bytes)
      throw refuse(fmt::format("binding {} ({}) needs {} bytes, '{}' gives {}", i, want.name, binding.required_bytes, binding.slice.buffer->name(), binding.slice.bytes));
    if (binding.slice.bytes > device.report.max_storage_buffer_bytes)
      throw refuse(fmt::format("binding {} ({}): {} bytes of '{}' are more than the {} that the device binds at once", i, want.name, binding.slice.bytes,
                               binding.slice.buffer->name(), device.report.max_storage_buffer_bytes));
    if (binding.slice.offset % device.report.buffer_offset_alignment)
      throw refuse(fmt::format("binding {} ({}): offset {} in '{}' is no multiple of {}", i, want.name, binding.slice.offset, binding.slice.buffer->name(),
                               device.report.buffer_offset_alignment));
    VkWriteDescriptorSet write{VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET};
    write.dstBinding = static_cast<uint32_t>(i);
    write.descriptorCount = 1;
    if (want.type == BindingType::storage_buffer || want.type == BindingType::uniform_buffer) {
      infos[i] = {binding.slice.buffer->handle(), binding.slice.offset, binding.slice.bytes};
      write.descriptorType = want.type == BindingType::storage_buffer ? VK_DESCRIPTOR_TYPE_STORAGE_BUFFER : VK_DESCRIPTOR_TYPE_UNIFORM_BUFFER;
      write.pBufferInfo = &infos[i];
    } else {
      if (binding.slice.bytes / 16 > device.report.max_texel_elements)
        throw refuse(fmt::format("binding {} ({}): {} texels, the device allows {}", i, want.name, binding.slice.bytes / 16, device.report.max_texel_elements));
      views[i] = binding.slice.buffer->texel_view(binding.slice.offset, binding.slice.bytes);
      write.descriptorType = want.type == BindingType::storage_texel_buffer ? VK_DESCRIPTOR_TYPE_STORAGE_TEXEL_BUFFER : VK_DESCRIPTOR_TYPE_UNIFORM_TEXEL_BUFFER;
      write.pTexelBufferView = &views[i];
    }
    writes.push_back(write);
  }

  State& s = *state_;
  const bool counted = device.profiler.enabled && !launch.cost_count.empty();
  if (counted) {  // before the launch: it may be one that overwrites the count
    const size_t pool = s.timed.size() / launches_per_pool;
    while (s.counts.size() <= pool) s.counts.emplace_back(device_, "counts of work, for the profile", launches_per_pool * 4ull, BufferPlace::shared);
    copy(launch.cost_count.sub(0, 4), s.counts[pool].slice().elements(s.timed.size() % launches_per_pool, 1));
  }
  if (launch.after_previous || !s.recording) barrier(0);
  vkCmdBindPipeline(s.buffer, VK_PIPELINE_BIND_POINT_COMPUTE, launch.pipeline->handle);
  device.push_descriptors(s.buffer, VK_PIPELINE_BIND_POINT_COMPUTE, launch.pipeline->layout, 0, static_cast<uint32_t>(writes.size()), writes.data());
  if (launch.push_constant_bytes)
    vkCmdPushConstants(s.buffer, launch.pipeline->layout, VK_SHADER_STAGE_COMPUTE_BIT, 0, launch.push_constant_bytes, launch.push_constants);

  VkQueryPool pool = VK_NULL_HANDLE;
  uint32_t query = 0;
  if (device.profiler.enabled) {
    const uint32_t index = static_cast<uint32_t>(s.timed.size());
    query = index % launches_per_pool * 2;
    if (index / launches_per_pool >= s.queries.size()) {
      VkQueryPoolCreateInfo info{VK_STRUCTURE_TYPE_QUERY_POOL_CREATE_INFO};
      info.queryType = VK_QUERY_TYPE_TIMESTAMP;
      info.queryCount = launches_per_pool * 2;
      s.queries.emplace_back();
      check(vkCreateQueryPool(device.device, &info, nullptr, &s.queries.back()), "query pool");
    }
    pool = s.queries[index / launches_per_pool];
    if (query == 0) vkCmdResetQueryPool(s.buffer, pool, 0, launches_per_pool * 2);
    vkCmdWriteTimestamp(s.buffer, VK_PIPELINE_STAGE_BOTTOM_OF_PIPE_BIT, pool, query);
    s.timed.push_back({launch.name, launch.pipeline->name, s.stage, launch.cost, counted ? launch.cost_groups : 0});
  }
  if (launch.indirect.empty()) vkCmdDispatch(s.buffer, launch.groups[0], launch.groups[1], launch.groups[2]);
  else vkCmdDispatchIndirect(s.buffer, launch.indirect.buffer->handle(), launch.indirect.offset);
  if (pool) vkCmdWriteTimestamp(s.buffer, VK_PIPELINE_STAGE_BOTTOM_OF_PIPE_BIT, pool, query + 1);
}

void Commands::fill(const BufferSlice& slice, uint32_t word) {
  if (slice.empty()) return;
  barrier(1);
  vkCmdFillBuffer(state_->buffer, slice.buffer->handle(), slice.offset, slice.bytes, word);
}

void Commands::copy(const BufferSlice& from, const BufferSlice& to) {
  if (from.bytes != to.bytes) throw std::invalid_argument(fmt::format("copy of {} bytes of '{}' to {} bytes of '{}'", from.bytes, from.buffer->name(), to.bytes, to.buffer->name()));
  barrier(1);
  const VkBufferCopy region{from.offset, to.offset, from.bytes};
  vkCmdCopyBuffer(state_->buffer, from.buffer->handle(), to.buffer->handle(), 1, &region);
}

void Commands::submit_and_wait() {
  State& s = *state_;
  if (!s.recording) return;
  DeviceState& device = device_.state();
  VkMemoryBarrier memory{VK_STRUCTURE_TYPE_MEMORY_BARRIER};
  memory.srcAccessMask = VK_ACCESS_SHADER_WRITE_BIT | VK_ACCESS_TRANSFER_WRITE_BIT;
  memory.dstAccessMask = VK_ACCESS_HOST_READ_BIT;
  vkCmdPipelineBarrier(s.buffer, VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT | VK_PIPELINE_STAGE_TRANSFER_BIT, VK_PIPELINE_STAGE_HOST_BIT, 0, 1, &memory, 0, nullptr, 0, nullptr);
  check(vkEndCommandBuffer(s.buffer), "recording commands");
  s.recording = false;
  s.anything_written = false;
  VkSubmitInfo submit{VK_STRUCTURE_TYPE_SUBMIT_INFO};
  submit.commandBufferCount = 1;
  submit.pCommandBuffers = &s.buffer;
  check(vkQueueSubmit(device.queue, 1, &submit, s.fence), "submitting work to " + device.report.name);
  check(vkWaitForFences(device.device, 1, &s.fence, VK_TRUE, UINT64_MAX), "waiting for " + device.report.name);
  check(vkResetFences(device.device, 1, &s.fence), "fence");

  for (size_t first = 0; first < s.timed.size(); first += launches_per_pool) {
    const uint32_t count = static_cast<uint32_t>(std::min<size_t>(launches_per_pool, s.timed.size() - first));
    std::vector<uint64_t> ticks(count * 2);
    check(vkGetQueryPoolResults(device.device, s.queries[first / launches_per_pool], 0, count * 2, ticks.size() * 8, ticks.data(), 8, VK_QUERY_RESULT_64_BIT | VK_QUERY_RESULT_WAIT_BIT),
          "reading timestamps");
    std::vector<uint32_t> groups(count, 0);
    if (first / launches_per_pool < s.counts.size()) device_.download(s.counts[first / launches_per_pool].slice(), groups.data(), count * 4ull);
    for (uint32_t i = 0; i < count; ++i) {
      const State::Timed& timed = s.timed[first + i];
      const double part = timed.cost_groups ? double(groups[i]) / timed.cost_groups : 1;
      device.profiler.add(timed.name, timed.shader, timed.stage, double(ticks[2 * i + 1] - ticks[2 * i]) * device.report.timestamp_period_ns * 1e-6, {timed.cost.flops * part, timed.cost.bytes * part});
    }
  }
  s.timed.clear();
}

}  // namespace arah
