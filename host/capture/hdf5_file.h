// Arrays of numbers in HDF5 files that may be anything, through HDF5's own library. Reads what lies in the file itself as
// simple arrays of integers and reals, plain or compressed by deflate or h5py's LZF, which are undone here; links to other files,
// virtual datasets, other filters and the library's plugins are refused. One call at a time.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <vector>

namespace arah {

// What an array may have at most: numbers that are read at once, frames, bytes that are compressed together.
inline constexpr std::size_t kMostHdf5Numbers = 16'000'000;
inline constexpr std::size_t kMostHdf5Frames = 1'000'000;
inline constexpr std::size_t kMostHdf5ChunkBytes = 64'000'000;
inline constexpr std::size_t kMostHdf5RowBytes = 512'000'000;  // of frames in the same chunks

class Hdf5File {
 public:
  // Throws InputError naming the file and what the library says: missing, no HDF5 file, cut off.
  explicit Hdf5File(const std::filesystem::path& path);
  ~Hdf5File();
  Hdf5File(const Hdf5File&) = delete;
  Hdf5File& operator=(const Hdf5File&) = delete;

  // All numbers of the array `name` in C order. `shape`: its axes' lengths; −1: any. Throws InputError naming file and array:
  // none of that name, another shape, no numbers, more than kMostHdf5Numbers, not finite, damaged, and what is refused above.
  std::vector<double> numbers(const std::string& name, const std::vector<long>& shape) const;

  // An array [frame][row][column] of whole numbers of one byte, which frame() reads one frame at a time.
  struct Frames {
    std::size_t count = 0;
    int height = 0, width = 0;  // pixels, 1 to `largest`
  };
  Frames open_frames(const std::string& name, int largest);
  // [height · width] bytes of the array opened last. Throws InputError: damaged.
  void frame(std::size_t number, std::span<std::uint8_t> pixels) const;

 private:
  struct Handles;
  std::string where_;
  std::unique_ptr<Handles> handles_;
};

}  // namespace arah
