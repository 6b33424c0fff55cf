// NumPy's .npz files: a zip archive of .npy arrays, stored or deflated.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "host/body/mapped_file.h"
#include "host/body/python_value.h"

namespace arah {

// All that is inflated from one file may take this much together. A member that would grow by more than kMostNpzGrowth and
// to more than 16 MB is a bomb, not data.
inline constexpr std::size_t kMostNpzBytes = 320'000'000;
inline constexpr std::size_t kMostNpzGrowth = 400;

class NpzFile {
 public:
  // Reads the list of contents. Throws InputError naming the file: no zip archive, truncated, encrypted, a compression other
  // than deflate, a member twice, members outside the file.
  explicit NpzFile(const std::filesystem::path& path);

  std::vector<std::string> names() const;  // without ".npy", ascending
  bool has(const std::string& name) const { return members_.contains(name); }
  // The array called `name`, which keeps its own bytes. Throws InputError naming file and array: none of that name,
  // sizes that disagree with the array's own header, too large (above), a wrong checksum, and what parse_npy() refuses.
  PythonData read(const std::string& name) const;

 private:
  struct Member {
    std::size_t offset = 0;  // of the local header
    std::size_t packed = 0, size = 0;
    std::uint32_t checksum = 0;
    bool deflated = false;
  };
  std::string_view packed_bytes(const Member& member, const std::string& where) const;

  std::string where_;
  std::shared_ptr<const MappedFile> file_;
  std::map<std::string, Member> members_;
  mutable std::size_t inflated_ = 0;
};

}  // namespace arah
