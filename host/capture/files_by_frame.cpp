#include "host/capture/files_by_frame.h"

#include <algorithm>
#include <charconv>
#include <string>

namespace arah {

std::map<int, std::filesystem::path> files_by_frame(const std::filesystem::path& folder, std::initializer_list<const char*> extensions) {
  std::map<int, std::filesystem::path> files;
  if (!std::filesystem::is_directory(folder)) return files;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    const std::string stem = entry.path().stem().string(), extension = entry.path().extension().string();
    int number = 0;
    const auto [stop, error] = std::from_chars(stem.data(), stem.data() + stem.size(), number);
    const bool wanted = std::find(extensions.begin(), extensions.end(), extension) != extensions.end();
    if (wanted && error == std::errc() && stop == stem.data() + stem.size() && number >= 0) files.emplace(number, entry.path());
  }
  return files;
}

}  // namespace arah
