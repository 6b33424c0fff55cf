// Options and arguments that several subcommands take.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "host/rendering/render_settings.h"
#include "host/training/ranks.h"
#include "kernels/vulkan/device.h"

namespace CLI {
class App;
}

namespace arah {

// "--device NAME" into device.wanted, ahead of ARAH_DEVICE; the device's compiling is shown (shader_progress.h).
// device: DeviceOptions::from_environment().
void add_device_option(CLI::App& command, DeviceOptions& device);
// The device of one of several ranks: what --device names, of several with commas between the next one for each rank of a
// machine; without it the machine's devices of the best type in turn. Only the first rank shows its compiling.
DeviceOptions device_of_rank(DeviceOptions options, const Ranks& ranks);
// "--memory SIZE" into device.memory_ceiling.
void add_memory_option(CLI::App& command, DeviceOptions& device);

// Bytes of a size such as "512M" or "1.5G": a number above 0 and K, M or G, powers of 1024. Throws InputError naming --memory
// for anything else.
uint64_t memory_size(const std::string& text);

// "--quality PRESET" and "--set KNOB=VALUE" (host/rendering/render_settings.h).
struct QualityOptions {
  std::string preset = "paper";
  std::vector<std::string> knobs;
  // Throws InputError naming the option for what is no preset, knob or value.
  RenderSettings settings(const Avatar& avatar) const;
};
void add_quality_options(CLI::App& command, QualityOptions& quality);

// "--lpips FILE.onnx" into `network`; left empty without it.
void add_lpips_option(CLI::App& command, std::filesystem::path& network);

inline constexpr const char* kAvatarHelp = "an avatar (.safetensors) or the folder of a training run";

// The avatar's file: the path itself, or avatar.safetensors in the folder of a run. Throws InputError where there is
// none.
std::filesystem::path avatar_file(const std::filesystem::path& path);

// Makes the folder that results go to. Throws InputError where that name is a file's, or the disk refuses.
void make_folder(const std::filesystem::path& folder);

}  // namespace arah
