#include "host/cli/arguments.h"

#include <CLI/CLI.hpp>

#include "host/input_error.h"

namespace arah {

namespace fs = std::filesystem;

void add_device_option(CLI::App& command, DeviceOptions& device) {
  command.add_option("--device", device.wanted,
                     "Vulkan device: its number or part of its name, see arah devices (default: the best one)");
}

fs::path avatar_file(const fs::path& path) {
  if (!fs::is_directory(path)) {
    if (!fs::exists(path))
      throw InputError(path.string(), "", "an avatar or a run's folder", "no such file", "arah train makes avatars.");
    return path;
  }
  const fs::path file = path / "avatar.safetensors";
  if (!fs::is_regular_file(file))
    throw InputError(path.string(), "avatar.safetensors", "the avatar of a training run", "no such file",
                     "Has its training been interrupted before the first checkpoint?");
  return file;
}

void make_folder(const fs::path& folder) {
  if (fs::exists(folder) && !fs::is_directory(folder))
    throw InputError(folder.string(), "", "a folder", "a file", "Choose another name.");
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) throw InputError(fmt::format("{}: could not be made: {}", folder.string(), error.message()));
}

}  // namespace arah
