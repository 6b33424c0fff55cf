#include "host/cli/arguments.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <CLI/CLI.hpp>
#include <charconv>
#include <cmath>
#include <memory>

#include "host/cli/shader_progress.h"
#include "host/input_error.h"

namespace arah {

namespace fs = std::filesystem;

void add_device_option(CLI::App& command, DeviceOptions& device) {
  command.add_option("--device", device.wanted,
                     "Vulkan device: its number or part of its name, see arah devices (default: the best one). Under mpirun several, with commas between, for the ranks of a machine in turn (default: all of the best type)");
  device.compiling = [line = std::make_shared<ShaderLine>()](const ShaderProgress& progress) { line->show(progress); };
}

DeviceOptions device_of_rank(DeviceOptions options, const Ranks& ranks) {
  if (ranks.count() == 1) return options;
  if (!ranks.first()) options.compiling = {};
  std::vector<std::string> names;
  if (!options.wanted.empty()) {
    names = CLI::detail::split(options.wanted, ',');
  } else {
    const std::vector<DeviceReport> all = survey_devices();
    for (const DeviceType type : {DeviceType::discrete_gpu, DeviceType::integrated_gpu, DeviceType::virtual_gpu, DeviceType::cpu, DeviceType::other}) {
      for (const DeviceReport& device : all)
        if (device.type == type && device.usable()) names.push_back(std::to_string(device.index));
      if (!names.empty()) break;
    }
  }
  if (!names.empty()) options.wanted = names[ranks.on_machine() % names.size()];
  return options;
}

uint64_t memory_size(const std::string& text) {
  double number = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number, std::chars_format::fixed);
  const std::string unit(error == std::errc() ? end : text.data(), text.data() + text.size());
  const std::size_t power = std::string("KMG").find(unit);
  const double bytes = power < 3 && unit.size() == 1 ? number * std::pow(1024.0, static_cast<double>(power + 1)) : 0;
  if (!(bytes >= 1 && bytes < 0x1p60))
    throw InputError("--memory", "", "a size such as 512M or 1.5G (K, M, G: powers of 1024)", "'" + text + "'");
  return static_cast<uint64_t>(bytes);
}

void add_memory_option(CLI::App& command, DeviceOptions& device) {
  command.add_option_function<std::string>(
             "--memory",
             [&device](const std::string& text) {
               try {
                 device.memory_ceiling = memory_size(text);
               } catch (const InputError& error) {
                 const std::string reason = error.what();
                 throw CLI::ValidationError(reason.substr(0, reason.size() - 1));  // main() ends the sentence
               }
             },
             "most memory for buffers on the device, such as 512M or 2G: fewer rays go together, and what cannot fit is "
             "refused. On a CPU device this is memory of the process, beside which the program, the driver with "
             "its compiler, the template's samples and the pictures take 200M to 450M (default: as much as the presets want)")
      ->type_name("SIZE");
}

RenderSettings QualityOptions::settings(const Avatar& avatar) const {
  RenderSettings settings = render_preset(avatar, preset);
  for (const std::string& assignment : knobs) {
    const std::size_t equals = assignment.find('=');
    if (equals == std::string::npos || equals == 0)
      throw InputError("--set", "", "KNOB=VALUE", "'" + assignment + "'", "For instance: --set samples=16");
    set_render_knob(settings, assignment.substr(0, equals), assignment.substr(equals + 1));
  }
  return settings;
}

void add_quality_options(CLI::App& command, QualityOptions& quality) {
  command
      .add_option("--quality", quality.preset,
                  "paper (exact), balanced, fast or preview: what is given up for speed; arah tradeoff measures it")
      ->check(CLI::IsMember(render_presets()))
      ->capture_default_str();
  command.add_option("--set", quality.knobs,
                     fmt::format("KNOB=VALUE, any number of times: {}", fmt::join(render_knobs(), ", ")));
}

void add_lpips_option(CLI::App& command, fs::path& network) {
  command
      .add_option("--lpips", network,
                  "also LPIPS, by this network: an ONNX file that takes two pictures (N x 3 x height x width, float32, R G B, values in "
                  "[-1, 1], sizes left open) and gives one number, as the authors' own exported to ONNX; none comes with the program")
      ->type_name("FILE.onnx");
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
