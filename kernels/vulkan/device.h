// The Vulkan device that all kernels run on: choice, memory, pipelines. With commands.h, the only code that calls Vulkan.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

#include "kernels/vulkan/device_report.h"
#include "kernels/vulkan/pipeline.h"
#include "kernels/vulkan/profiler.h"

struct VkBuffer_T;
struct VkBufferView_T;

namespace arah {

class Device;
struct DeviceState;

// A range of a buffer: what kernels are given. `bytes` is the range's own length; the handle stays with its Buffer.
struct BufferSlice {
  class Buffer* buffer = nullptr;
  uint64_t offset = 0;
  uint64_t bytes = 0;

  bool empty() const { return buffer == nullptr || bytes == 0; }
  // Sub-range in bytes, relative to this slice. Throws std::out_of_range (with both values) where it does not fit.
  BufferSlice sub(uint64_t at, uint64_t length) const;
  // The same in 32-bit elements.
  BufferSlice elements(uint64_t first, uint64_t count) const { return sub(first * 4, count * 4); }
};

// Where a buffer lives. `device`: fastest for kernels; the host reaches it through upload and download.
// `shared`: small things that host and device both touch every step (counters, per-frame constants, read-backs).
enum class BufferPlace { device, shared };

class Buffer {
 public:
  Buffer();
  Buffer(Device& device, std::string name, uint64_t bytes, BufferPlace place);
  ~Buffer();
  Buffer(Buffer&& other) noexcept;
  Buffer& operator=(Buffer&& other) noexcept;

  // The whole buffer. The slice points at this object: do not move the Buffer while slices of it are in use.
  BufferSlice slice() { return {this, 0, bytes_}; }
  uint64_t bytes() const { return bytes_; }
  const std::string& name() const { return name_; }
  uint64_t address() const { return address_; }  // device address of the first byte
  void* mapped() const { return mapped_; }        // nullptr where the host cannot see the memory
  VkBuffer_T* handle() const { return handle_; }
  VkBufferView_T* texel_view(uint64_t offset, uint64_t bytes, bool words);  // of texels of four floats or four uint32, cached

 private:
  struct Views;
  Device* device_ = nullptr;
  std::string name_;
  uint64_t bytes_ = 0;
  uint64_t address_ = 0;
  void* mapped_ = nullptr;
  VkBuffer_T* handle_ = nullptr;
  void* memory_ = nullptr;
  std::unique_ptr<Views> views_;
};

// A buffer was refused because the memory ceiling leaves no room for it: what() says what was asked, what is held by whom and
// which ceiling would do.
class MemoryCeilingError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

// Pipelines are made on threads of their own from when they are first asked for; the batch that launches one first waits for it,
// and for what the driver leaves to the first launch (lavapipe: machine code).
struct ShaderProgress {
  std::string shader;      // "<area>/<stem>"
  bool done = false;       // false: the wait for it begins
  uint64_t pipelines = 0;  // asked for since the device was opened
  uint64_t ready = 0;      // of these, launched before or just now
  double seconds = 0;      // spent waiting until now
};

struct DeviceOptions {
  std::string wanted;       // part of a name, or an index; empty: the best usable one (discrete, integrated, virtual, CPU)
  bool validation = false;  // load VK_LAYER_KHRONOS_validation with synchronisation checks; messages are kept
  bool profile = false;     // time every launch with timestamps
  uint64_t memory_ceiling = 0;  // bytes of all buffers together; 0: as much as the device gives
  std::function<void(const ShaderProgress&)> compiling;  // called before and after each wait
  // Of the instance, as the window system asks for them. Where there are any, the device's queue draws as well as computes and
  // can present (VK_KHR_swapchain); devices without that are refused.
  std::vector<std::string> window_extensions;

  // wanted from ARAH_DEVICE, validation from ARAH_VALIDATION=1.
  static DeviceOptions from_environment();
};

class Device {
 public:
  // Throws std::runtime_error that names every device with the reason of its refusal where none is usable.
  explicit Device(const DeviceOptions& options = DeviceOptions::from_environment());
  ~Device();
  Device(const Device&) = delete;
  Device& operator=(const Device&) = delete;

  const DeviceReport& report() const;
  Profiler& profiler();

  // A pipeline of the embedded shader "<area>/<stem>" with specialization constants 0, 1, 2, … in order.
  // Made on first use, kept for the device's life. Throws std::invalid_argument for an unknown name; what the driver says
  // against it is thrown when it is first launched.
  const Pipeline& pipeline(const std::string& shader, const std::vector<uint32_t>& specialization = {});

  // Copies between host and buffer; sizes must be equal to the slice's or smaller. Wait for the device's own work first.
  void upload(const BufferSlice& to, const void* from, uint64_t bytes);
  void download(const BufferSlice& from, void* to, uint64_t bytes);
  template <typename T>
  void upload(const BufferSlice& to, const std::vector<T>& from) {
    upload(to, from.data(), from.size() * sizeof(T));
  }
  template <typename T>
  std::vector<T> download(const BufferSlice& from) {
    std::vector<T> values(from.bytes / sizeof(T));
    download(from, values.data(), values.size() * sizeof(T));
    return values;
  }

  // What `ask` says of this device, kept: each question is asked once.
  const std::string& once(const std::string& question, const std::function<std::string()>& ask);

  uint64_t allocated_bytes() const;
  uint64_t most_allocated_bytes() const;  // at any moment since the device was opened
  uint64_t memory_ceiling() const;        // bytes; 0: none
  std::string memory_table() const;  // the buffers that live now, largest first, and their sum
  // Bytes of the buffers that `make` makes, for a plan before the work. It runs as usual, but its buffers get no memory, its
  // uploads and launches do nothing, and its downloads give zeros; none of its buffers may outlive it. Not from within itself.
  uint64_t bytes_of(const std::function<void()>& make);
  // The error for `needed` bytes that the ceiling leaves no room for beside what is allocated now.
  MemoryCeilingError beyond_ceiling(const std::string& what, uint64_t needed) const;

  uint64_t pipelines_made() const;
  double pipeline_seconds() const;  // time spent waiting for them since the device was opened (ShaderProgress)

  // Warnings and errors of the validation layer since the start; empty where it is off or content.
  std::vector<std::string> validation_messages() const;

  DeviceState& state() { return *state_; }  // for kernels/vulkan only

 private:
  std::unique_ptr<DeviceState> state_;
};

}  // namespace arah
