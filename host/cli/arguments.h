// Options and arguments that several subcommands take.
#pragma once

#include <filesystem>
#include <string>

#include "kernels/vulkan/device.h"

namespace CLI {
class App;
}

namespace arah {

// "--device NAME" into device.wanted, ahead of ARAH_DEVICE. device: DeviceOptions::from_environment().
void add_device_option(CLI::App& command, DeviceOptions& device);

inline constexpr const char* kAvatarHelp = "an avatar (.safetensors) or the folder of a training run";

// The avatar's file: the path itself, or avatar.safetensors in the folder of a run. Throws InputError where there is
// none.
std::filesystem::path avatar_file(const std::filesystem::path& path);

// Makes the folder that results go to. Throws InputError where that name is a file's, or the disk refuses.
void make_folder(const std::filesystem::path& folder);

}  // namespace arah
