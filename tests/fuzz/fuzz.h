// What the fuzzing targets share. A reader may answer any bytes with a result or with an InputError of one line that a terminal
// can show; every other exception, a crash, a leak and more than 512 MB are findings.
#pragma once

#include <unistd.h>

#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>
#include <string_view>

#include "host/input_error.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size);

namespace arah {

inline std::string_view text_of(const std::uint8_t* data, std::size_t size) { return {reinterpret_cast<const char*>(data), size}; }

template <typename Reader>
void expect_result_or_input_error(const Reader& reader) {
  try {
    reader();
  } catch (const InputError& error) {
    const std::string_view text = error.what();
    if (std::any_of(text.begin(), text.end(), [](unsigned char letter) { return letter < ' ' || letter == 0x7f; })) std::abort();
  }
}

// A folder of this process, for readers that take paths. TMPDIR=/dev/shm keeps it in memory.
class FuzzFolder {
 public:
  FuzzFolder() : path_(std::filesystem::temp_directory_path() / ("arah_fuzz_" + std::to_string(::getpid()))) { std::filesystem::create_directories(path_); }
  ~FuzzFolder() { std::filesystem::remove_all(path_); }
  FuzzFolder(const FuzzFolder&) = delete;
  FuzzFolder& operator=(const FuzzFolder&) = delete;

  const std::filesystem::path& path() const { return path_; }
  std::filesystem::path write(const char* name, std::string_view content) const {
    std::ofstream(path_ / name, std::ios::binary).write(content.data(), static_cast<std::streamsize>(content.size()));
    return path_ / name;
  }

 private:
  std::filesystem::path path_;
};

// Gives the bytes to `reader` as a file of this name.
template <typename Reader>
int fuzz_file(const char* name, const std::uint8_t* data, std::size_t size, const Reader& reader) {
  static const FuzzFolder folder;
  const std::filesystem::path path = folder.write(name, text_of(data, size));
  expect_result_or_input_error([&] { reader(path); });
  return 0;
}

}  // namespace arah
