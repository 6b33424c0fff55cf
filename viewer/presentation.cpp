#include "viewer/presentation.h"

#define GLFW_INCLUDE_NONE
#define GLFW_INCLUDE_VULKAN
#include <GLFW/glfw3.h>
#include <fmt/format.h>
#include <imgui.h>
#include <imgui_impl_vulkan.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <stdexcept>

#include "kernels/vulkan/result.h"
#include "kernels/vulkan/window_access.h"

namespace arah {
namespace {

constexpr uint32_t kFramesAtOnce = 2;  // one is drawn while the other is shown
constexpr VkClearColorValue kBackground{{0.11f, 0.11f, 0.12f, 1.0f}};

struct HostImage {  // an image on the device and the memory that pictures come through
  VkImage image = VK_NULL_HANDLE;
  VkDeviceMemory memory = VK_NULL_HANDLE;
  int width = 0, height = 0;
  bool filled = false;
};

struct Staging {
  VkBuffer buffer = VK_NULL_HANDLE;
  VkDeviceMemory memory = VK_NULL_HANDLE;
  VkDeviceSize bytes = 0;
  void* mapped = nullptr;
};

struct Frame {
  VkCommandPool pool = VK_NULL_HANDLE;
  VkCommandBuffer commands = VK_NULL_HANDLE;
  VkFence fence = VK_NULL_HANDLE;
  VkSemaphore acquired = VK_NULL_HANDLE;
  Staging staging;
};

struct Target {  // one image of the swapchain
  VkImage image = VK_NULL_HANDLE;
  VkImageView view = VK_NULL_HANDLE;
  VkFramebuffer framebuffer = VK_NULL_HANDLE;
  VkSemaphore drawn = VK_NULL_HANDLE;
};

void check_imgui(VkResult result) { check(result, "drawing the panels"); }

void transition(VkCommandBuffer commands, VkImage image, VkImageLayout from, VkImageLayout to, VkPipelineStageFlags stages_before, VkAccessFlags before, VkPipelineStageFlags stages_after, VkAccessFlags after) {
  VkImageMemoryBarrier barrier{VK_STRUCTURE_TYPE_IMAGE_MEMORY_BARRIER};
  barrier.srcAccessMask = before;
  barrier.dstAccessMask = after;
  barrier.oldLayout = from;
  barrier.newLayout = to;
  barrier.srcQueueFamilyIndex = barrier.dstQueueFamilyIndex = VK_QUEUE_FAMILY_IGNORED;
  barrier.image = image;
  barrier.subresourceRange = {VK_IMAGE_ASPECT_COLOR_BIT, 0, 1, 0, 1};
  vkCmdPipelineBarrier(commands, stages_before, stages_after, 0, 0, nullptr, 0, nullptr, 1, &barrier);
}

}  // namespace

struct Presentation::State {
  WindowAccess vulkan;
  VkSurfaceKHR surface = VK_NULL_HANDLE;
  VkSurfaceFormatKHR format{};
  VkRenderPass pass = VK_NULL_HANDLE;
  VkDescriptorPool descriptors = VK_NULL_HANDLE;
  VkSwapchainKHR swapchain = VK_NULL_HANDLE;
  FramebufferSize size, asked;
  std::vector<Target> targets;
  std::array<Frame, kFramesAtOnce> frames;
  size_t next = 0;
  HostImage picture;
  uint64_t on_device = 0;  // number of the picture that the image holds

  void wait_idle() const {
    const std::lock_guard lock(*vulkan.queue_mutex);
    vkDeviceWaitIdle(vulkan.device);
  }
  uint32_t memory_type(uint32_t allowed, VkMemoryPropertyFlags wanted) const {
    VkPhysicalDeviceMemoryProperties memory;
    vkGetPhysicalDeviceMemoryProperties(vulkan.physical, &memory);
    for (uint32_t i = 0; i < memory.memoryTypeCount; ++i)
      if ((allowed >> i & 1) && (memory.memoryTypes[i].propertyFlags & wanted) == wanted) return i;
    throw std::runtime_error("the device has no memory for a picture on the screen");
  }
  void drop(HostImage& image) const {
    vkDestroyImage(vulkan.device, image.image, nullptr);
    vkFreeMemory(vulkan.device, image.memory, nullptr);
    image = {};
  }
  void drop(Staging& staging) const {
    vkDestroyBuffer(vulkan.device, staging.buffer, nullptr);
    vkFreeMemory(vulkan.device, staging.memory, nullptr);
    staging = {};
  }
  void make_room(Staging& staging, VkDeviceSize bytes) const {
    if (staging.bytes >= bytes) return;
    drop(staging);
    VkBufferCreateInfo info{VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO};
    info.size = bytes;
    info.usage = VK_BUFFER_USAGE_TRANSFER_SRC_BIT;
    check(vkCreateBuffer(vulkan.device, &info, nullptr, &staging.buffer), "room for a picture");
    VkMemoryRequirements needs;
    vkGetBufferMemoryRequirements(vulkan.device, staging.buffer, &needs);
    VkMemoryAllocateInfo memory{VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_INFO};
    memory.allocationSize = needs.size;
    memory.memoryTypeIndex = memory_type(needs.memoryTypeBits, VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT | VK_MEMORY_PROPERTY_HOST_COHERENT_BIT);
    check(vkAllocateMemory(vulkan.device, &memory, nullptr, &staging.memory), "room for a picture");
    check(vkBindBufferMemory(vulkan.device, staging.buffer, staging.memory, 0), "room for a picture");
    check(vkMapMemory(vulkan.device, staging.memory, 0, VK_WHOLE_SIZE, 0, &staging.mapped), "room for a picture");
    staging.bytes = bytes;
  }
};

Presentation::Presentation(Device& device, const Window& window) : state_(std::make_unique<State>()), window_(window) {
  State& s = *state_;
  s.vulkan = window_access(device);
  check(glfwCreateWindowSurface(s.vulkan.instance, window.handle(), nullptr, &s.surface), "making the window's surface");
  VkBool32 presents = VK_FALSE;
  check(vkGetPhysicalDeviceSurfaceSupportKHR(s.vulkan.physical, s.vulkan.queue_family, s.surface, &presents), "asking whether the device can present");
  if (!presents) {
    vkDestroySurfaceKHR(s.vulkan.instance, s.surface, nullptr);
    throw std::runtime_error(fmt::format("{} cannot draw to this window; choose another device with --device (arah devices lists them)", device.report().name));
  }
  uint32_t count = 0;
  check(vkGetPhysicalDeviceSurfaceFormatsKHR(s.vulkan.physical, s.surface, &count, nullptr), "the window's formats");
  std::vector<VkSurfaceFormatKHR> formats(count);
  check(vkGetPhysicalDeviceSurfaceFormatsKHR(s.vulkan.physical, s.surface, &count, formats.data()), "the window's formats");
  // Pictures and panels are sRGB bytes already: a format that leaves bytes as they are.
  const auto plain = std::find_if(formats.begin(), formats.end(), [](const VkSurfaceFormatKHR& f) { return f.format == VK_FORMAT_B8G8R8A8_UNORM || f.format == VK_FORMAT_R8G8B8A8_UNORM; });
  if (plain == formats.end()) {
    vkDestroySurfaceKHR(s.vulkan.instance, s.surface, nullptr);
    throw std::runtime_error("the window has no format of 8 bits a channel without conversion");
  }
  s.format = *plain;

  VkAttachmentDescription attachment{};
  attachment.format = s.format.format;
  attachment.samples = VK_SAMPLE_COUNT_1_BIT;
  attachment.loadOp = VK_ATTACHMENT_LOAD_OP_LOAD;  // the picture is there
  attachment.storeOp = VK_ATTACHMENT_STORE_OP_STORE;
  attachment.stencilLoadOp = VK_ATTACHMENT_LOAD_OP_DONT_CARE;
  attachment.stencilStoreOp = VK_ATTACHMENT_STORE_OP_DONT_CARE;
  attachment.initialLayout = VK_IMAGE_LAYOUT_COLOR_ATTACHMENT_OPTIMAL;
  attachment.finalLayout = VK_IMAGE_LAYOUT_PRESENT_SRC_KHR;
  const VkAttachmentReference reference{0, VK_IMAGE_LAYOUT_COLOR_ATTACHMENT_OPTIMAL};
  VkSubpassDescription subpass{};
  subpass.pipelineBindPoint = VK_PIPELINE_BIND_POINT_GRAPHICS;
  subpass.colorAttachmentCount = 1;
  subpass.pColorAttachments = &reference;
  VkRenderPassCreateInfo pass{VK_STRUCTURE_TYPE_RENDER_PASS_CREATE_INFO};
  pass.attachmentCount = 1;
  pass.pAttachments = &attachment;
  pass.subpassCount = 1;
  pass.pSubpasses = &subpass;
  check(vkCreateRenderPass(s.vulkan.device, &pass, nullptr, &s.pass), "the panels' pass");

  const VkDescriptorPoolSize pool_size{VK_DESCRIPTOR_TYPE_COMBINED_IMAGE_SAMPLER, 8};
  VkDescriptorPoolCreateInfo pool{VK_STRUCTURE_TYPE_DESCRIPTOR_POOL_CREATE_INFO};
  pool.flags = VK_DESCRIPTOR_POOL_CREATE_FREE_DESCRIPTOR_SET_BIT;
  pool.maxSets = 8;
  pool.poolSizeCount = 1;
  pool.pPoolSizes = &pool_size;
  check(vkCreateDescriptorPool(s.vulkan.device, &pool, nullptr, &s.descriptors), "the panels' descriptors");

  for (Frame& frame : s.frames) {
    VkCommandPoolCreateInfo commands{VK_STRUCTURE_TYPE_COMMAND_POOL_CREATE_INFO};
    commands.queueFamilyIndex = s.vulkan.queue_family;
    check(vkCreateCommandPool(s.vulkan.device, &commands, nullptr, &frame.pool), "command pool");
    VkCommandBufferAllocateInfo buffer{VK_STRUCTURE_TYPE_COMMAND_BUFFER_ALLOCATE_INFO};
    buffer.commandPool = frame.pool;
    buffer.level = VK_COMMAND_BUFFER_LEVEL_PRIMARY;
    buffer.commandBufferCount = 1;
    check(vkAllocateCommandBuffers(s.vulkan.device, &buffer, &frame.commands), "command buffer");
    VkFenceCreateInfo fence{VK_STRUCTURE_TYPE_FENCE_CREATE_INFO};
    fence.flags = VK_FENCE_CREATE_SIGNALED_BIT;
    check(vkCreateFence(s.vulkan.device, &fence, nullptr, &frame.fence), "fence");
    const VkSemaphoreCreateInfo semaphore{VK_STRUCTURE_TYPE_SEMAPHORE_CREATE_INFO};
    check(vkCreateSemaphore(s.vulkan.device, &semaphore, nullptr, &frame.acquired), "semaphore");
  }
  make_panels();
}

void Presentation::make_panels() {
  State& s = *state_;
  ImGui_ImplVulkan_InitInfo panels{};
  panels.Instance = s.vulkan.instance;
  panels.PhysicalDevice = s.vulkan.physical;
  panels.Device = s.vulkan.device;
  panels.QueueFamily = s.vulkan.queue_family;
  panels.Queue = s.vulkan.queue;
  panels.DescriptorPool = s.descriptors;
  panels.MinImageCount = panels.ImageCount = kFramesAtOnce;  // so many sets of vertices, whatever the swapchain has
  panels.MSAASamples = VK_SAMPLE_COUNT_1_BIT;
  panels.CheckVkResultFn = check_imgui;
  ImGui_ImplVulkan_Init(&panels, s.pass);
  // The font's texture, once.
  Frame& frame = s.frames[0];
  VkCommandBufferBeginInfo begin{VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO};
  begin.flags = VK_COMMAND_BUFFER_USAGE_ONE_TIME_SUBMIT_BIT;
  check(vkBeginCommandBuffer(frame.commands, &begin), "recording the font");
  ImGui_ImplVulkan_CreateFontsTexture(frame.commands);
  check(vkEndCommandBuffer(frame.commands), "recording the font");
  VkSubmitInfo submit{VK_STRUCTURE_TYPE_SUBMIT_INFO};
  submit.commandBufferCount = 1;
  submit.pCommandBuffers = &frame.commands;
  {
    const std::lock_guard lock(*s.vulkan.queue_mutex);
    check(vkQueueSubmit(s.vulkan.queue, 1, &submit, VK_NULL_HANDLE), "uploading the font");
    check(vkQueueWaitIdle(s.vulkan.queue), "uploading the font");
  }
  ImGui_ImplVulkan_DestroyFontUploadObjects();
}

Presentation::~Presentation() {
  State& s = *state_;
  s.wait_idle();
  ImGui_ImplVulkan_Shutdown();
  drop_swapchain();
  s.drop(s.picture);
  for (Frame& frame : s.frames) {
    s.drop(frame.staging);
    vkDestroySemaphore(s.vulkan.device, frame.acquired, nullptr);
    vkDestroyFence(s.vulkan.device, frame.fence, nullptr);
    vkDestroyCommandPool(s.vulkan.device, frame.pool, nullptr);
  }
  vkDestroyDescriptorPool(s.vulkan.device, s.descriptors, nullptr);
  vkDestroyRenderPass(s.vulkan.device, s.pass, nullptr);
  vkDestroySurfaceKHR(s.vulkan.instance, s.surface, nullptr);
}

void Presentation::drop_swapchain() {
  State& s = *state_;
  for (Target& target : s.targets) {
    vkDestroyFramebuffer(s.vulkan.device, target.framebuffer, nullptr);
    vkDestroyImageView(s.vulkan.device, target.view, nullptr);
    vkDestroySemaphore(s.vulkan.device, target.drawn, nullptr);
  }
  s.targets.clear();
  vkDestroySwapchainKHR(s.vulkan.device, s.swapchain, nullptr);
  s.swapchain = VK_NULL_HANDLE;
  s.size = {};
}

// None where the window has no area.
void Presentation::make_swapchain() {
  State& s = *state_;
  s.wait_idle();
  drop_swapchain();
  s.asked = window_.framebuffer();
  VkSurfaceCapabilitiesKHR can{};
  check(vkGetPhysicalDeviceSurfaceCapabilitiesKHR(s.vulkan.physical, s.surface, &can), "the window's capabilities");
  VkExtent2D extent = can.currentExtent;
  if (extent.width == 0xffffffff) extent = {static_cast<uint32_t>(s.asked.width), static_cast<uint32_t>(s.asked.height)};
  extent.width = std::clamp(extent.width, can.minImageExtent.width, can.maxImageExtent.width);
  extent.height = std::clamp(extent.height, can.minImageExtent.height, can.maxImageExtent.height);
  if (s.asked.width == 0 || s.asked.height == 0 || extent.width == 0 || extent.height == 0) return;
  if (!(can.supportedUsageFlags & VK_IMAGE_USAGE_TRANSFER_DST_BIT)) throw std::runtime_error("the window's images cannot be copied to");

  VkSwapchainCreateInfoKHR info{VK_STRUCTURE_TYPE_SWAPCHAIN_CREATE_INFO_KHR};
  info.surface = s.surface;
  info.minImageCount = std::max(2u, can.minImageCount);
  if (can.maxImageCount > 0) info.minImageCount = std::min(info.minImageCount, can.maxImageCount);
  info.imageFormat = s.format.format;
  info.imageColorSpace = s.format.colorSpace;
  info.imageExtent = extent;
  info.imageArrayLayers = 1;
  info.imageUsage = VK_IMAGE_USAGE_COLOR_ATTACHMENT_BIT | VK_IMAGE_USAGE_TRANSFER_DST_BIT;
  info.imageSharingMode = VK_SHARING_MODE_EXCLUSIVE;
  info.preTransform = can.currentTransform;
  info.compositeAlpha = can.supportedCompositeAlpha & VK_COMPOSITE_ALPHA_OPAQUE_BIT_KHR ? VK_COMPOSITE_ALPHA_OPAQUE_BIT_KHR : VK_COMPOSITE_ALPHA_INHERIT_BIT_KHR;
  info.presentMode = VK_PRESENT_MODE_FIFO_KHR;  // the one that all devices have, and without tearing
  info.clipped = VK_TRUE;
  check(vkCreateSwapchainKHR(s.vulkan.device, &info, nullptr, &s.swapchain), "making the swapchain");
  ++swapchains_;
  s.size = {static_cast<int>(extent.width), static_cast<int>(extent.height)};
  uint32_t count = 0;
  check(vkGetSwapchainImagesKHR(s.vulkan.device, s.swapchain, &count, nullptr), "the swapchain's images");
  std::vector<VkImage> images(count);
  check(vkGetSwapchainImagesKHR(s.vulkan.device, s.swapchain, &count, images.data()), "the swapchain's images");
  for (VkImage image : images) {
    Target& target = s.targets.emplace_back();
    target.image = image;
    VkImageViewCreateInfo view{VK_STRUCTURE_TYPE_IMAGE_VIEW_CREATE_INFO};
    view.image = image;
    view.viewType = VK_IMAGE_VIEW_TYPE_2D;
    view.format = s.format.format;
    view.subresourceRange = {VK_IMAGE_ASPECT_COLOR_BIT, 0, 1, 0, 1};
    check(vkCreateImageView(s.vulkan.device, &view, nullptr, &target.view), "a view of the swapchain");
    VkFramebufferCreateInfo framebuffer{VK_STRUCTURE_TYPE_FRAMEBUFFER_CREATE_INFO};
    framebuffer.renderPass = s.pass;
    framebuffer.attachmentCount = 1;
    framebuffer.pAttachments = &target.view;
    framebuffer.width = extent.width;
    framebuffer.height = extent.height;
    framebuffer.layers = 1;
    check(vkCreateFramebuffer(s.vulkan.device, &framebuffer, nullptr, &target.framebuffer), "a framebuffer");
    const VkSemaphoreCreateInfo semaphore{VK_STRUCTURE_TYPE_SEMAPHORE_CREATE_INFO};
    check(vkCreateSemaphore(s.vulkan.device, &semaphore, nullptr, &target.drawn), "semaphore");
  }
}

void Presentation::set_picture(ScreenPicture picture) {
  if (picture.rgba.size() != 4ull * static_cast<size_t>(picture.width) * static_cast<size_t>(picture.height)) throw std::invalid_argument("a picture whose bytes do not fit its size");
  picture_ = std::move(picture);
  ++picture_number_;
}

void Presentation::make_picture_image() {
  State& s = *state_;
  if (s.picture.width == picture_.width && s.picture.height == picture_.height) return;
  s.wait_idle();
  s.drop(s.picture);
  VkImageCreateInfo info{VK_STRUCTURE_TYPE_IMAGE_CREATE_INFO};
  info.imageType = VK_IMAGE_TYPE_2D;
  info.format = VK_FORMAT_R8G8B8A8_UNORM;
  info.extent = {static_cast<uint32_t>(picture_.width), static_cast<uint32_t>(picture_.height), 1};
  info.mipLevels = info.arrayLayers = 1;
  info.samples = VK_SAMPLE_COUNT_1_BIT;
  info.tiling = VK_IMAGE_TILING_OPTIMAL;
  info.usage = VK_IMAGE_USAGE_TRANSFER_SRC_BIT | VK_IMAGE_USAGE_TRANSFER_DST_BIT;
  check(vkCreateImage(s.vulkan.device, &info, nullptr, &s.picture.image), "an image on the device");
  VkMemoryRequirements needs;
  vkGetImageMemoryRequirements(s.vulkan.device, s.picture.image, &needs);
  VkMemoryAllocateInfo memory{VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_INFO};
  memory.allocationSize = needs.size;
  memory.memoryTypeIndex = s.memory_type(needs.memoryTypeBits, 0);
  check(vkAllocateMemory(s.vulkan.device, &memory, nullptr, &s.picture.memory), "an image on the device");
  check(vkBindImageMemory(s.vulkan.device, s.picture.image, s.picture.memory, 0), "an image on the device");
  s.picture.width = picture_.width;
  s.picture.height = picture_.height;
}

bool Presentation::present(const PicturePlace& place, ImDrawData* panels) {
  State& s = *state_;
  if (s.swapchain == VK_NULL_HANDLE || window_.framebuffer() != s.asked) make_swapchain();
  if (s.swapchain == VK_NULL_HANDLE) return false;
  Frame& frame = s.frames[s.next];
  check(vkWaitForFences(s.vulkan.device, 1, &frame.fence, VK_TRUE, UINT64_MAX), "waiting for a frame");
  uint32_t index = 0;
  VkResult acquired = vkAcquireNextImageKHR(s.vulkan.device, s.swapchain, UINT64_MAX, frame.acquired, VK_NULL_HANDLE, &index);
  if (acquired == VK_ERROR_OUT_OF_DATE_KHR) {
    make_swapchain();
    if (s.swapchain == VK_NULL_HANDLE) return false;
    acquired = vkAcquireNextImageKHR(s.vulkan.device, s.swapchain, UINT64_MAX, frame.acquired, VK_NULL_HANDLE, &index);
    if (acquired == VK_ERROR_OUT_OF_DATE_KHR) return false;  // it changes faster than it can be followed: the next frame tries again
  }
  if (acquired != VK_SUBOPTIMAL_KHR) check(acquired, "the window's next image");
  check(vkResetFences(s.vulkan.device, 1, &frame.fence), "fence");
  Target& target = s.targets[index];

  const bool shows = picture_.width > 0 && picture_.height > 0 && place.width > 0 && place.height > 0;
  const bool fresh = shows && s.on_device != picture_number_;
  if (fresh) {
    make_picture_image();
    s.make_room(frame.staging, picture_.rgba.size());
    std::memcpy(frame.staging.mapped, picture_.rgba.data(), picture_.rgba.size());
  }
  check(vkResetCommandPool(s.vulkan.device, frame.pool, 0), "recording a frame");
  VkCommandBufferBeginInfo begin{VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO};
  begin.flags = VK_COMMAND_BUFFER_USAGE_ONE_TIME_SUBMIT_BIT;
  check(vkBeginCommandBuffer(frame.commands, &begin), "recording a frame");
  constexpr VkPipelineStageFlags copies = VK_PIPELINE_STAGE_TRANSFER_BIT;
  if (fresh) {
    transition(frame.commands, s.picture.image, VK_IMAGE_LAYOUT_UNDEFINED, VK_IMAGE_LAYOUT_TRANSFER_DST_OPTIMAL, copies, VK_ACCESS_TRANSFER_READ_BIT, copies, VK_ACCESS_TRANSFER_WRITE_BIT);
    VkBufferImageCopy copy{};
    copy.imageSubresource = {VK_IMAGE_ASPECT_COLOR_BIT, 0, 0, 1};
    copy.imageExtent = {static_cast<uint32_t>(picture_.width), static_cast<uint32_t>(picture_.height), 1};
    vkCmdCopyBufferToImage(frame.commands, frame.staging.buffer, s.picture.image, VK_IMAGE_LAYOUT_TRANSFER_DST_OPTIMAL, 1, &copy);
    transition(frame.commands, s.picture.image, VK_IMAGE_LAYOUT_TRANSFER_DST_OPTIMAL, VK_IMAGE_LAYOUT_TRANSFER_SRC_OPTIMAL, copies, VK_ACCESS_TRANSFER_WRITE_BIT, copies, VK_ACCESS_TRANSFER_READ_BIT);
    s.on_device = picture_number_;
  }
  transition(frame.commands, target.image, VK_IMAGE_LAYOUT_UNDEFINED, VK_IMAGE_LAYOUT_TRANSFER_DST_OPTIMAL, copies, 0, copies, VK_ACCESS_TRANSFER_WRITE_BIT);
  const VkImageSubresourceRange whole{VK_IMAGE_ASPECT_COLOR_BIT, 0, 1, 0, 1};
  vkCmdClearColorImage(frame.commands, target.image, VK_IMAGE_LAYOUT_TRANSFER_DST_OPTIMAL, &kBackground, 1, &whole);
  // The part of the place that the window still has: it may have been resized since the place was chosen.
  const int right = std::min(place.x + place.width, s.size.width), bottom = std::min(place.y + place.height, s.size.height);
  if (shows && place.x >= 0 && place.y >= 0 && right > place.x && bottom > place.y) {
    transition(frame.commands, target.image, VK_IMAGE_LAYOUT_TRANSFER_DST_OPTIMAL, VK_IMAGE_LAYOUT_TRANSFER_DST_OPTIMAL, copies, VK_ACCESS_TRANSFER_WRITE_BIT, copies, VK_ACCESS_TRANSFER_WRITE_BIT);
    VkImageBlit blit{};
    blit.srcSubresource = blit.dstSubresource = {VK_IMAGE_ASPECT_COLOR_BIT, 0, 0, 1};
    blit.srcOffsets[1] = {std::max(1, picture_.width * (right - place.x) / place.width), std::max(1, picture_.height * (bottom - place.y) / place.height), 1};
    blit.dstOffsets[0] = {place.x, place.y, 0};
    blit.dstOffsets[1] = {right, bottom, 1};
    vkCmdBlitImage(frame.commands, s.picture.image, VK_IMAGE_LAYOUT_TRANSFER_SRC_OPTIMAL, target.image, VK_IMAGE_LAYOUT_TRANSFER_DST_OPTIMAL, 1, &blit, VK_FILTER_LINEAR);
  }
  transition(frame.commands, target.image, VK_IMAGE_LAYOUT_TRANSFER_DST_OPTIMAL, VK_IMAGE_LAYOUT_COLOR_ATTACHMENT_OPTIMAL, copies, VK_ACCESS_TRANSFER_WRITE_BIT, VK_PIPELINE_STAGE_COLOR_ATTACHMENT_OUTPUT_BIT,
             VK_ACCESS_COLOR_ATTACHMENT_READ_BIT | VK_ACCESS_COLOR_ATTACHMENT_WRITE_BIT);
  VkRenderPassBeginInfo pass{VK_STRUCTURE_TYPE_RENDER_PASS_BEGIN_INFO};
  pass.renderPass = s.pass;
  pass.framebuffer = target.framebuffer;
  pass.renderArea.extent = {static_cast<uint32_t>(s.size.width), static_cast<uint32_t>(s.size.height)};
  vkCmdBeginRenderPass(frame.commands, &pass, VK_SUBPASS_CONTENTS_INLINE);
  if (panels) ImGui_ImplVulkan_RenderDrawData(panels, frame.commands);
  vkCmdEndRenderPass(frame.commands);
  check(vkEndCommandBuffer(frame.commands), "recording a frame");

  const VkPipelineStageFlags wait = VK_PIPELINE_STAGE_TRANSFER_BIT;
  VkSubmitInfo submit{VK_STRUCTURE_TYPE_SUBMIT_INFO};
  submit.waitSemaphoreCount = 1;
  submit.pWaitSemaphores = &frame.acquired;
  submit.pWaitDstStageMask = &wait;
  submit.commandBufferCount = 1;
  submit.pCommandBuffers = &frame.commands;
  submit.signalSemaphoreCount = 1;
  submit.pSignalSemaphores = &target.drawn;
  VkPresentInfoKHR show{VK_STRUCTURE_TYPE_PRESENT_INFO_KHR};
  show.waitSemaphoreCount = 1;
  show.pWaitSemaphores = &target.drawn;
  show.swapchainCount = 1;
  show.pSwapchains = &s.swapchain;
  show.pImageIndices = &index;
  VkResult shown = VK_SUCCESS;
  {
    const std::lock_guard lock(*s.vulkan.queue_mutex);
    check(vkQueueSubmit(s.vulkan.queue, 1, &submit, frame.fence), "drawing a frame");
    shown = vkQueuePresentKHR(s.vulkan.queue, &show);
  }
  s.next = (s.next + 1) % kFramesAtOnce;
  ++frames_;
  if (shown == VK_ERROR_OUT_OF_DATE_KHR || shown == VK_SUBOPTIMAL_KHR || acquired == VK_SUBOPTIMAL_KHR) make_swapchain();
  else check(shown, "showing a frame");
  return true;
}

}  // namespace arah
