// Reading and writing .safetensors files: named tensors in one file that any tool of the field opens.
//
// Layout: an 8-byte little-endian header length, a JSON header {name: {dtype, shape, data_offsets: [begin, end)}} with
// an optional "__metadata__" entry of string values, then the raw little-endian row-major data. Offsets count from the
// end of the header. The ranges of the tensors, sorted, must fill the data exactly: no gap, no overlap, nothing after.
//
// Files of ours have a metadata entry "arah.crc32": the CRC-32 (zlib's, eight digits to base 16) of the whole file with these digits as
// zeros, so that one flipped bit does not open as other numbers. Readers elsewhere pass over it; whoever changes a file leaves it out.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <map>
#include <span>
#include <string>
#include <vector>

namespace arah {

// One array. `dtype` is F32, F64, I32, I64 or U8. An empty `shape` is a scalar (one number); a 0 in it means no number.
// `data` holds count() numbers of the type, row-major, in the byte order of the machine (little-endian).
struct Tensor {
  std::string dtype;
  std::vector<int64_t> shape;
  std::vector<std::byte> data;

  // The product of the shape: 1 for a scalar.
  int64_t count() const;

  // A copy of the numbers, row-major, as T: float, double, int32_t, int64_t or uint8_t. Floating T takes every dtype
  // (and rounds to the nearest). Throws InputError when an integer T is asked of a floating dtype, or does not hold a
  // value; the error has no file name (SafetensorsFile::values adds it).
  template <typename T>
  std::vector<T> as() const;

  // A tensor of the dtype of T. Throws std::invalid_argument when values.size() is not the product of the shape.
  template <typename T>
  static Tensor from(std::vector<int64_t> shape, std::span<const T> values);
  template <typename T>
  static Tensor from(std::vector<int64_t> shape, const std::vector<T>& values) {
    return from(std::move(shape), std::span<const T>(values));
  }
};

struct SafetensorsFile {
  std::map<std::string, Tensor> tensors;
  std::map<std::string, std::string> metadata;
  std::filesystem::path path;  // where it was read from, for error texts; write_safetensors ignores it

  // The tensor of that name. Throws InputError naming file and tensor when it is absent.
  const Tensor& at(const std::string& name) const;

  // The numbers of the tensor, which must have exactly this shape. Throws InputError naming file and tensor when it is
  // absent, has another shape, or does not convert to T (see Tensor::as).
  template <typename T>
  std::vector<T> values(const std::string& name, const std::vector<int64_t>& shape) const;
};

// Reads a whole file. No length, offset or shape in it is trusted: whatever does not add up, the checksum where there is one with it,
// throws InputError naming the file and the field. Memory use is bounded by the size of the file. The checksum is not among the metadata.
SafetensorsFile read_safetensors(const std::filesystem::path& path);

// Writes the whole file, with its checksum, or nothing (host/file_writing.h): a reader sees the old file or the new one, never half of one.
// Larger element types come first and the header is padded, so that every tensor is naturally aligned in the file.
// Throws InputError when the folder does not exist, std::runtime_error when the disk refuses (an existing file stays as
// it was), and std::invalid_argument when a tensor's data and shape disagree, a dtype is unknown, or a name is reserved
// or no UTF-8. Needs as much memory again as the tensors take.
void write_safetensors(const std::filesystem::path& path, const SafetensorsFile& file);

}  // namespace arah
