#include "kernels/vulkan/commands.h"

#include <fmt/format.h>

#include <functional>
#include <stdexcept>

#include "kernels/vulkan/device_state.h"

namespace arah {
namespace {
constexpr uint32_t launches_per_pool = 2048;  // two timestamps each, and where wanted a count of the work
}

struct Commands::State {
  VkCommandPool pool = VK_NULL_HANDLE;
  VkCommandBuffer buffer = VK_NULL_HANDLE, compiling = VK_NULL_HANDLE;
  VkFence fence = VK_NULL_HANDLE;
  bool recording = false;
  bool running = false;  // between submit() and wait()
  bool anything_written = false;

  // What was recorded, kept until it is submitted: meanwhile the pipelines of a batch are made side by side.
  struct Recorded {
    Launch launch;  // without a pipeline: `encode` alone
    std::vector<std::byte> push_constants;
    std::vector<VkDescriptorBufferInfo> buffers;
    std::vector<VkBufferView> views;
    std::vector<VkWriteDescriptorSet> writes;
    std::function<void(VkCommandBuffer)> encode;  // after binding, where there is a pipeline
  };
  static_assert(std::is_nothrow_move_constructible_v<Recorded>, "the descriptor writes point into the other vectors");
  std::vector<Recorded> recorded;

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
  for (VkCommandBuffer* buffer : {&state_->buffer, &state_->compiling}) check(vkAllocateCommandBuffers(s.device, &allocation, buffer), "command buffer");
  const VkFenceCreateInfo fence{VK_STRUCTURE_TYPE_FENCE_CREATE_INFO};
  check(vkCreateFence(s.device, &fence, nullptr, &state_->fence), "fence");
}

Commands::~Commands() {
  DeviceState& s = device_.state();
  {
    const std::lock_guard lock(s.queue_mutex);
    vkDeviceWaitIdle(s.device);
  }
  for (VkQueryPool pool : state_->queries) vkDestroyQueryPool(s.device, pool, nullptr);
  if (state_->fence) vkDestroyFence(s.device, state_->fence, nullptr);
  if (state_->pool) vkDestroyCommandPool(s.device, state_->pool, nullptr);
}

// Makes all earlier writes visible to what follows: one memory barrier, and none before the first work of a batch
// (submission itself makes host writes visible).
void Commands::barrier(uint32_t next_stage_is_transfer) {
  State& s = *state_;
  if (s.running) throw std::logic_error("commands were recorded that wait() had not been called for");
  s.recording = true;
  if (s.anything_written) {
    const VkAccessFlags next = next_stage_is_transfer ? VK_ACCESS_TRANSFER_READ_BIT | VK_ACCESS_TRANSFER_WRITE_BIT
                                                      : VK_ACCESS_SHADER_READ_BIT | VK_ACCESS_SHADER_WRITE_BIT | VK_ACCESS_UNIFORM_READ_BIT | VK_ACCESS_INDIRECT_COMMAND_READ_BIT;
    const VkPipelineStageFlags stages = next_stage_is_transfer ? VK_PIPELINE_STAGE_TRANSFER_BIT : VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT | VK_PIPELINE_STAGE_DRAW_INDIRECT_BIT;
    s.recorded.emplace_back().encode = [next, stages](VkCommandBuffer buffer) {
      const VkMemoryBarrier memory{VK_STRUCTURE_TYPE_MEMORY_BARRIER, nullptr, VK_ACCESS_SHADER_WRITE_BIT | VK_ACCESS_TRANSFER_WRITE_BIT, next};
      vkCmdPipelineBarrier(buffer, VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT | VK_PIPELINE_STAGE_TRANSFER_BIT, stages, 0, 1, &memory, 0, nullptr, 0, nullptr);
    };
  }
  s.anything_written = true;
}

void Commands::stage(const std::string& name) { state_->stage = name; }

void Commands::bind(VkCommandBuffer buffer, const Launch& launch, const void* descriptor_writes, uint32_t count) const {
  vkCmdBindPipeline(buffer, VK_PIPELINE_BIND_POINT_COMPUTE, launch.pipeline->handle);
  device_.state().push_descriptors(buffer, VK_PIPELINE_BIND_POINT_COMPUTE, launch.pipeline->layout, 0, count, static_cast<const VkWriteDescriptorSet*>(descriptor_writes));
  if (launch.push_constant_bytes) vkCmdPushConstants(buffer, launch.pipeline->layout, VK_SHADER_STAGE_COMPUTE_BIT, 0, launch.push_constant_bytes, launch.push_constants);
}

// Waits for the pipeline, then launches no workgroups: that makes a driver compile which does so at the first launch, and so
// that time is known.
void Commands::compile(const Launch& launch, const void* descriptor_writes, uint32_t count) {
  DeviceState& device = device_.state();
  const CompilationTimer timer(device, launch.pipeline->name);
  device.finish(*launch.pipeline);
  const VkCommandBufferBeginInfo begin{VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO, nullptr, VK_COMMAND_BUFFER_USAGE_ONE_TIME_SUBMIT_BIT, nullptr};
  check(vkBeginCommandBuffer(state_->compiling, &begin), "recording commands");
  bind(state_->compiling, launch, descriptor_writes, count);
  vkCmdDispatch(state_->compiling, 0, 0, 0);
  start(state_->compiling);
  finish();
  launch.pipeline->launched = true;
}

void Commands::dispatch(const Launch& launch) {
  DeviceState& device = device_.state();
  if (device.planning) return;
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

  State::Recorded recorded;
  std::vector<VkDescriptorBufferInfo>& infos = recorded.buffers;
  std::vector<VkBufferView>& views = recorded.views;
  infos.resize(face.bindings.size()), views.resize(face.bindings.size());
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
      views[i] = binding.slice.buffer->texel_view(binding.slice.offset, binding.slice.bytes, want.words);
      write.descriptorType = want.type == BindingType::storage_texel_buffer ? VK_DESCRIPTOR_TYPE_STORAGE_TEXEL_BUFFER : VK_DESCRIPTOR_TYPE_UNIFORM_TEXEL_BUFFER;
      write.pTexelBufferView = &views[i];
    }
    recorded.writes.push_back(write);
  }

  State& s = *state_;
  const bool counted = device.profiler.enabled && !launch.cost_count.empty();
  if (counted) {  // before the launch: it may be one that overwrites the count
    const size_t pool = s.timed.size() / launches_per_pool;
    while (s.counts.size() <= pool) s.counts.emplace_back(device_, "counts of work, for the profile", launches_per_pool * 4ull, BufferPlace::shared);
    copy(launch.cost_count.sub(0, 4), s.counts[pool].slice().elements(s.timed.size() % launches_per_pool, 1));
  }
  if (launch.after_previous || !s.recording) barrier(0);
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
    s.timed.push_back({launch.name, launch.pipeline->name, s.stage, launch.cost, counted ? launch.cost_groups : 0});
  }
  recorded.encode = [pool, query, groups = launch.groups, indirect = launch.indirect.empty() ? VK_NULL_HANDLE : launch.indirect.buffer->handle(), offset = launch.indirect.offset](VkCommandBuffer buffer) {
    if (pool && query == 0) vkCmdResetQueryPool(buffer, pool, 0, launches_per_pool * 2);
    if (pool) vkCmdWriteTimestamp(buffer, VK_PIPELINE_STAGE_BOTTOM_OF_PIPE_BIT, pool, query);
    if (indirect) vkCmdDispatchIndirect(buffer, indirect, offset);
    else vkCmdDispatch(buffer, groups[0], groups[1], groups[2]);
    if (pool) vkCmdWriteTimestamp(buffer, VK_PIPELINE_STAGE_BOTTOM_OF_PIPE_BIT, pool, query + 1);
  };
  const auto* constants = static_cast<const std::byte*>(launch.push_constants);
  if (launch.push_constant_bytes) recorded.push_constants.assign(constants, constants + launch.push_constant_bytes);
  recorded.launch.pipeline = launch.pipeline;
  recorded.launch.push_constants = recorded.push_constants.data();
  recorded.launch.push_constant_bytes = launch.push_constant_bytes;
  s.recorded.push_back(std::move(recorded));  // the vectors keep their places, which the writes point to
}

void Commands::fill(const BufferSlice& slice, uint32_t word) {
  if (slice.empty() || device_.state().planning) return;
  barrier(1);
  state_->recorded.emplace_back().encode = [handle = slice.buffer->handle(), offset = slice.offset, bytes = slice.bytes, word](VkCommandBuffer buffer) { vkCmdFillBuffer(buffer, handle, offset, bytes, word); };
}

void Commands::copy(const BufferSlice& from, const BufferSlice& to) {
  if (from.bytes != to.bytes) throw std::invalid_argument(fmt::format("copy of {} bytes of '{}' to {} bytes of '{}'", from.bytes, from.buffer->name(), to.bytes, to.buffer->name()));
  if (device_.state().planning) return;
  barrier(1);
  state_->recorded.emplace_back().encode = [source = from.buffer->handle(), target = to.buffer->handle(), region = VkBufferCopy{from.offset, to.offset, from.bytes}](VkCommandBuffer buffer) {
    vkCmdCopyBuffer(buffer, source, target, 1, &region);
  };
}

// Ends the recording of `buffer` and runs it; finish() waits for it.
void Commands::start(VkCommandBuffer buffer) {
  DeviceState& device = device_.state();
  check(vkEndCommandBuffer(buffer), "recording commands");
  VkSubmitInfo submit{VK_STRUCTURE_TYPE_SUBMIT_INFO};
  submit.commandBufferCount = 1;
  submit.pCommandBuffers = &buffer;
  const std::lock_guard lock(device.queue_mutex);
  check(vkQueueSubmit(device.queue, 1, &submit, state_->fence), "submitting work to " + device.report.name);
}

void Commands::finish() {
  DeviceState& device = device_.state();
  check(vkWaitForFences(device.device, 1, &state_->fence, VK_TRUE, UINT64_MAX), "waiting for " + device.report.name);
  check(vkResetFences(device.device, 1, &state_->fence), "fence");
}

void Commands::submit_and_wait() {
  submit();
  wait();
}

void Commands::submit() {
  State& s = *state_;
  if (!s.recording) return;
  const std::vector<State::Recorded> recorded = std::move(s.recorded);
  s.recorded.clear();
  for (const State::Recorded& work : recorded)
    if (work.launch.pipeline && !work.launch.pipeline->launched) compile(work.launch, work.writes.data(), static_cast<uint32_t>(work.writes.size()));
  const VkCommandBufferBeginInfo begin{VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO, nullptr, VK_COMMAND_BUFFER_USAGE_ONE_TIME_SUBMIT_BIT, nullptr};
  check(vkBeginCommandBuffer(s.buffer, &begin), "recording commands");
  for (const State::Recorded& work : recorded) {
    if (work.launch.pipeline) bind(s.buffer, work.launch, work.writes.data(), static_cast<uint32_t>(work.writes.size()));
    work.encode(s.buffer);
  }
  VkMemoryBarrier memory{VK_STRUCTURE_TYPE_MEMORY_BARRIER};
  memory.srcAccessMask = VK_ACCESS_SHADER_WRITE_BIT | VK_ACCESS_TRANSFER_WRITE_BIT;
  memory.dstAccessMask = VK_ACCESS_HOST_READ_BIT;
  vkCmdPipelineBarrier(s.buffer, VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT | VK_PIPELINE_STAGE_TRANSFER_BIT, VK_PIPELINE_STAGE_HOST_BIT, 0, 1, &memory, 0, nullptr, 0, nullptr);
  s.recording = false;
  s.anything_written = false;
  start(s.buffer);
  s.running = true;
}

void Commands::wait() {
  State& s = *state_;
  if (!s.running) return;
  s.running = false;
  finish();
  DeviceState& device = device_.state();
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
