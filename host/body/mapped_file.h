// A file's bytes without a copy of them: pages come when they are looked at.
#pragma once

#include <cstddef>
#include <filesystem>
#include <string_view>

namespace arah {

class MappedFile {
 public:
  // Throws InputError: no such file, a folder, a file that may not be read, one of more than `largest` bytes.
  explicit MappedFile(const std::filesystem::path& path, std::size_t largest = std::size_t{1} << 31);
  ~MappedFile();
  MappedFile(const MappedFile&) = delete;
  MappedFile& operator=(const MappedFile&) = delete;

  std::string_view bytes() const { return {start_, size_}; }

 private:
  const char* start_ = nullptr;
  std::size_t size_ = 0;
};

}  // namespace arah
