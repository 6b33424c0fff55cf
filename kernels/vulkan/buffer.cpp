#include <fmt/format.h>

#include <algorithm>
#include <stdexcept>
#include <tuple>
#include <utility>

#include "kernels/vulkan/device_state.h"

namespace arah {

struct Buffer::Views {
  std::map<std::tuple<uint64_t, uint64_t, bool>, VkBufferView> made;
};

BufferSlice BufferSlice::sub(uint64_t at, uint64_t length) const {
  if (at > bytes || length > bytes - at)
    throw std::out_of_range(fmt::format("slice [{}, {}+{}) of {} bytes of buffer '{}'", at, at, length, bytes, buffer ? buffer->name() : "nothing"));
  return {buffer, offset + at, length};
}

namespace {

// The memory type that suits the place best; ~0u where the device has none that fits.
uint32_t memory_type(const DeviceState& s, uint32_t allowed, BufferPlace place) {
  const VkMemoryPropertyFlags host = VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT | VK_MEMORY_PROPERTY_HOST_COHERENT_BIT;
  const VkMemoryPropertyFlags local = VK_MEMORY_PROPERTY_DEVICE_LOCAL_BIT;
  const VkMemoryPropertyFlags cached = VK_MEMORY_PROPERTY_HOST_CACHED_BIT;
  std::vector<VkMemoryPropertyFlags> wishes;
  if (s.host_memory_is_device_memory) wishes = {host | local | cached, host | local, host};
  else if (place == BufferPlace::device) wishes = {local};
  else wishes = {host | cached, host};
  for (const VkMemoryPropertyFlags wish : wishes)
    for (uint32_t i = 0; i < s.memory.memoryTypeCount; ++i)
      if ((allowed & (1u << i)) && (s.memory.memoryTypes[i].propertyFlags & wish) == wish) return i;
  return ~0u;
}

}  // namespace

Buffer::Buffer() = default;

Buffer::Buffer(Device& device, std::string name, uint64_t bytes, BufferPlace place)
    : device_(&device), name_(std::move(name)), bytes_((bytes + 255) / 256 * 256), views_(std::make_unique<Views>()) {
  DeviceState& s = device.state();
  if (bytes == 0) throw std::invalid_argument("buffer '" + name_ + "': asked for 0 bytes");
  const uint64_t limit = s.report.max_allocation_bytes;
  auto too_large = [&](const std::string& offer) {
    return std::runtime_error(fmt::format("buffer '{}': asks for {:.1f} MB, {}; {:.1f} MB are in use by this program. Use fewer rays a chunk or a smaller picture.",
                                          name_, double(bytes_) * 1e-6, offer, double(s.allocated_bytes) * 1e-6));
  };
  if (bytes_ > limit) throw too_large(fmt::format("the device allows {:.1f} MB in one piece", double(limit) * 1e-6));
  if (s.planning) {
    s.planned_bytes += bytes_;
    return;
  }
  if (s.memory_ceiling && s.allocated_bytes + bytes_ > s.memory_ceiling) throw device.beyond_ceiling("buffer '" + name_ + "'", bytes_);

  VkBufferCreateInfo info{VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO};
  info.size = bytes_;
  info.usage = VK_BUFFER_USAGE_STORAGE_BUFFER_BIT | VK_BUFFER_USAGE_UNIFORM_BUFFER_BIT | VK_BUFFER_USAGE_STORAGE_TEXEL_BUFFER_BIT |
               VK_BUFFER_USAGE_UNIFORM_TEXEL_BUFFER_BIT | VK_BUFFER_USAGE_INDIRECT_BUFFER_BIT | VK_BUFFER_USAGE_TRANSFER_SRC_BIT |
               VK_BUFFER_USAGE_TRANSFER_DST_BIT | VK_BUFFER_USAGE_SHADER_DEVICE_ADDRESS_BIT;
  check(vkCreateBuffer(s.device, &info, nullptr, &handle_), "buffer '" + name_ + "'");
  VkMemoryRequirements needs;
  vkGetBufferMemoryRequirements(s.device, handle_, &needs);
  VkMemoryAllocateFlagsInfo flags{VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_FLAGS_INFO};
  flags.flags = VK_MEMORY_ALLOCATE_DEVICE_ADDRESS_BIT;
  VkMemoryAllocateInfo allocation{VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_INFO, &flags};
  allocation.allocationSize = needs.size;
  allocation.memoryTypeIndex = memory_type(s, needs.memoryTypeBits, place);
  VkDeviceMemory memory = VK_NULL_HANDLE;
  const VkResult result = allocation.memoryTypeIndex == ~0u ? VK_ERROR_OUT_OF_DEVICE_MEMORY : vkAllocateMemory(s.device, &allocation, nullptr, &memory);
  if (result != VK_SUCCESS) {
    vkDestroyBuffer(s.device, handle_, nullptr);
    throw too_large(fmt::format("the device answers {}", to_string(result)));
  }
  memory_ = memory;
  check(vkBindBufferMemory(s.device, handle_, memory, 0), "memory of buffer '" + name_ + "'");
  if (s.memory.memoryTypes[allocation.memoryTypeIndex].propertyFlags & VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT)
    check(vkMapMemory(s.device, memory, 0, VK_WHOLE_SIZE, 0, &mapped_), "mapping buffer '" + name_ + "'");
  const VkBufferDeviceAddressInfo address{VK_STRUCTURE_TYPE_BUFFER_DEVICE_ADDRESS_INFO, nullptr, handle_};
  address_ = vkGetBufferDeviceAddress(s.device, &address);
  s.buffers[this] = {name_, bytes_};
  s.allocated_bytes += bytes_;
  s.most_allocated_bytes = std::max(s.most_allocated_bytes, s.allocated_bytes);
}

Buffer::~Buffer() {
  if (!handle_) return;
  DeviceState& s = device_->state();
  for (auto& [range, view] : views_->made) vkDestroyBufferView(s.device, view, nullptr);
  vkDestroyBuffer(s.device, handle_, nullptr);
  vkFreeMemory(s.device, static_cast<VkDeviceMemory>(memory_), nullptr);
  s.buffers.erase(this);
  s.allocated_bytes -= bytes_;
}

Buffer::Buffer(Buffer&& other) noexcept { *this = std::move(other); }

Buffer& Buffer::operator=(Buffer&& other) noexcept {
  std::swap(device_, other.device_);
  std::swap(name_, other.name_);
  std::swap(bytes_, other.bytes_);
  std::swap(address_, other.address_);
  std::swap(mapped_, other.mapped_);
  std::swap(handle_, other.handle_);
  std::swap(memory_, other.memory_);
  std::swap(views_, other.views_);
  for (Buffer* buffer : {this, &other}) {
    if (!buffer->device_) continue;
    auto& ledger = buffer->device_->state().buffers;
    ledger.erase(buffer);
    if (buffer->handle_) ledger[buffer] = {buffer->name_, buffer->bytes_};
  }
  return *this;
}

VkBufferView_T* Buffer::texel_view(uint64_t offset, uint64_t bytes, bool words) {
  VkBufferView& view = views_->made[{offset, bytes, words}];
  if (view) return view;
  VkBufferViewCreateInfo info{VK_STRUCTURE_TYPE_BUFFER_VIEW_CREATE_INFO};
  info.buffer = handle_;
  info.format = words ? VK_FORMAT_R32G32B32A32_UINT : VK_FORMAT_R32G32B32A32_SFLOAT;
  info.offset = offset;
  info.range = bytes / 16 * 16;
  check(vkCreateBufferView(device_->state().device, &info, nullptr, &view), "texel view of buffer '" + name_ + "'");
  return view;
}

}  // namespace arah
