#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <memory>
#include <optional>

#include "host/cli/arguments.h"
#include "host/cli/command.h"
#include "host/cli/interrupt.h"
#include "host/cli/progress.h"
#include "host/cli/shader_progress.h"
#include "host/input_error.h"
#include "host/training/pretraining.h"
#include "host/training/run_choice.h"

namespace arah {
namespace {

struct PretrainCall {
  PretrainOptions run;
  std::optional<std::string> preset;
  std::optional<uint64_t> family, seed;
  std::filesystem::path folder, rest_as;
  std::vector<std::string> settings;  // NAME=VALUE
  DeviceOptions device = DeviceOptions::from_environment();
};

// Settings by their names, parts of the networks as "spec.sdf.pose=low_rank"; the spec is checked when all are made.
void assign(PretrainSettings& settings, AvatarSpec& spec, const std::vector<std::string>& assignments) {
  const std::string of_spec = "spec.";
  std::string networks = spec_to_json(spec);
  for (const std::string& assignment : assignments) {
    if (assignment.starts_with(of_spec)) networks = with_field(networks, assignment.substr(of_spec.size()), "--set spec", "spec.sdf.width=96");
    else settings = pretrain_settings_from_json(with_field(pretrain_settings_to_json(settings), assignment, "--set", "sdf.steps=200"), "--set");
  }
  spec = spec_from_json(networks, "--set: spec");
}

// begun: the description of the family that a resumed file began with.
BodyFamily make_family(const PretrainCall& call, const PretrainSettings& settings, const std::string& begun, const Interrupt& interrupt) {
  if (!call.folder.empty()) return family_from_folder(call.folder);
  std::optional<RestingArms> arms;
  if (!call.rest_as.empty()) arms = resting_arms(read_body_template(call.rest_as).skeleton, call.rest_as.string());
  else if (!begun.empty()) arms = described_arms(begun);
  Progress progress("make bodies", static_cast<double>(settings.bodies), "bodies");
  try {
    BodyFamily family = generated_family(settings.bodies, 1, [&](std::size_t made) {
      progress.update(static_cast<double>(made));
      return !interrupt.wanted();
    }, arms);
    progress.finish();
    return family;
  } catch (const std::runtime_error&) {
    if (interrupt.wanted()) throw std::runtime_error("stopped before the first step; nothing was written");
    throw;
  }
}

int pretrain(const PretrainCall& call) {
  PretrainSettings settings;
  AvatarSpec spec;
  std::string family_begun;
  if (call.run.resume) {
    const Prior begun = read_prior(call.run.out);
    family_begun = begun.family;
    settings = begun.settings;
    spec = begun.spec;
    if (call.preset && *call.preset != settings.preset) throw InputError("--preset", "", "the one that the file began with, " + settings.preset, *call.preset);
  } else {
    const std::filesystem::path parent = std::filesystem::absolute(call.run.out).parent_path();
    if (!std::filesystem::is_directory(parent)) throw InputError(parent.string(), "", "a folder for the prior's file", "no such folder");
    if (std::filesystem::exists(call.run.out))
      throw InputError(call.run.out.string(), "", "a name that is free", "a file", "Go on with --resume, or choose another name.");
    const std::string preset = call.preset.value_or("tiny");
    settings = preset_pretrain_settings(preset);
    spec = preset_spec(preset);
  }
  if (call.family) settings.bodies = *call.family;
  if (call.seed) settings.seed = *call.seed;
  assign(settings, spec, call.settings);

  Device device(call.device);
  fmt::print(stderr, "device: {} ({})\n", device.report().name, device.report().driver);
  const Interrupt interrupt;
  const BodyFamily family = make_family(call, settings, family_begun, interrupt);
  Pretraining pretraining(device, spec, family, settings);
  std::optional<Progress> progress;
  std::string network;
  double loss = 0;
  const bool finished = run_pretraining(pretraining, settings, call.run, [&](const PretrainEvent& event) {
    if (network != event.network) {
      if (progress) progress->finish(fmt::format("loss {:.4g}", loss));
      network = event.network;
      progress.emplace("learn " + network, static_cast<double>(event.steps), "outer steps", static_cast<double>(event.first));
    }
    loss = event.loss;
    progress->update(static_cast<double>(event.step), fmt::format("loss {:.4g}", loss));
    if (event.saved) progress->say(fmt::format("{} written", call.run.out.string()));
    return !interrupt.wanted();
  });
  if (progress && finished) progress->finish(fmt::format("loss {:.4g}  {}  {}", loss, shaders_text(device), call.run.out.string()));
  if (finished && spec.sdf.pose != PoseConditioning::none) {
    const Pretraining::HeldOut losses = pretraining.held_out();
    fmt::print(stderr, "in poses between those learned from: loss {:.4g}, {:.4g} with the SDF that all poses share\n", losses.posed, losses.shared);
  }
  if (call.device.profile) fmt::print("{}", device.profiler().table());
  if (finished) return 0;
  throw std::runtime_error(fmt::format("stopped; {} holds what there is, continue with --resume", call.run.out.string()));
}

}  // namespace

void add_pretrain_command(CLI::App& program, Run& run) {
  const auto call = std::make_shared<PretrainCall>();
  CLI::App* command = program.add_subcommand("pretrain", "Learn a prior for shape and skinning from many bodies, for arah train --prior");
  command->add_option("-o,--out", call->run.out, "the prior's file, .safetensors")->required();
  command->add_option("--preset", call->preset, "sizes of the networks and settings: tiny, compact or paper (default: tiny)")->check(CLI::IsMember(preset_names()));
  CLI::Option* family = command->add_option("--family", call->family, "learn from so many generated people (default: the preset's 8, 24 or 64)")->check(CLI::Range(1, 10000));
  CLI::Option* folder = command->add_option("--family-folder", call->folder, "learn from the .glb and .gltf bodies of this folder, all with the same joints")->excludes(family);
  command->add_option("--rest-as", call->rest_as, "a body, .glb or .gltf, as whose arms those of the generated people rest: the subject's template (default: a T-pose)")
      ->check(CLI::ExistingFile)
      ->excludes(folder);
  command->add_option("--seed", call->seed, "of first values, poses and points (default: 0)");
  command->add_option("--set", call->settings, "NAME=VALUE: any setting, such as sdf.steps=400 or skinning.inner_rate=1e-4, and of the networks spec.sdf.pose=low_rank; may be repeated")
      ->expected(1)
      ->multi_option_policy(CLI::MultiOptionPolicy::TakeAll);
  command->add_flag("--resume", call->run.resume, "go on with the file; with more sdf.steps, skinning.steps or pose.steps also beyond the end");
  add_device_option(*command, call->device);
  add_memory_option(*command, call->device);
  command->add_flag("--profile", call->device.profile, "time every launch on the device and print the table");
  command->footer(
      "Ctrl-C stops after the current outer step and leaves the file (exit code 1).\n"
      "An SDF that follows the pose (spec.sdf.pose of low_rank or hypernetwork; preset paper) is learned after the one that all poses\n"
      "share. At the paper's 85 million numbers that takes 2.1 GB of buffers and, while its file of 1 GB is written, some 2.5 GB beside them.\n"
      "Example: arah pretrain -o people.safetensors --family 8 --rest-as capture/template.glb && arah train capture -o run --prior people.safetensors");
  command->callback([call, &run] {
    run = [call] { return pretrain(*call); };
  });
}

}  // namespace arah
