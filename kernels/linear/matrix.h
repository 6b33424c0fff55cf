// How a batch of activations lies in memory.
#pragma once

#include <cstdint>

#include "kernels/vulkan/device.h"

namespace arah {

// Rows are padded to `point_padding`, columns to `channel_padding`, so that kernels need neither bounds checks nor tails.
inline constexpr uint32_t point_padding = 64;
inline constexpr uint32_t channel_padding = 8;

constexpr uint32_t padded_points(uint32_t points) { return (points + point_padding - 1) / point_padding * point_padding; }
constexpr uint32_t padded_channels(uint32_t channels) { return (channels + channel_padding - 1) / channel_padding * channel_padding; }

// What activations are stored as. half: 11 bits of significand, at most 65,504; between the layers of a network that gives
// pictures alone, written and read by the forward kernels of linear.h and by nothing else.
enum class Element : uint32_t { float32, half };
constexpr uint32_t bytes_of(Element element) { return element == Element::half ? 2 : 4; }

// A view of activations, row-major: element (point p, channel c) is number p·stride + column + c of the slice.
// stride and column are multiples of channel_padding; the slice holds at least padded_points(points)·stride numbers.
struct Matrix {
  BufferSlice slice;
  uint32_t stride = 0;
  uint32_t column = 0;
  Element element = Element::float32;

  bool empty() const { return slice.empty(); }
  Matrix columns_from(uint32_t first) const { return {slice, stride, column + first, element}; }
  // Rows from `first` on; their offset in bytes must respect the device's offset alignment (multiples of 64 rows do).
  Matrix rows_from(uint32_t first) const {
    const uint64_t skip = uint64_t(first) * stride * bytes_of(element);
    return {slice.sub(skip, slice.bytes - skip), stride, column, element};
  }
};

}  // namespace arah
