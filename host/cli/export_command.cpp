#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>

#include "host/avatar/avatar_file.h"
#include "host/cli/arguments.h"
#include "host/cli/command.h"
#include "host/cli/interrupt.h"
#include "host/cli/motion_options.h"
#include "host/cli/progress.h"
#include "host/cli/shader_progress.h"
#include "host/evaluation/avatar_export.h"
#include "host/evaluation/recorded_folder.h"
#include "host/file_writing.h"
#include "host/input_error.h"

namespace arah {
namespace {

namespace fs = std::filesystem;

struct ExportOptions {
  fs::path avatar, out;
  MotionOptions motion;
  std::string format, colors;
  std::optional<int> frame, color_frame;
  int every = 1, count = 0, texture_size = 1024;
  std::size_t points = 0, triangles = 0;
  bool largest_part = false;
  uint64_t seed = 0;
  double cell = 0.008;
  std::optional<double> outline, fps;
  DeviceOptions device = DeviceOptions::from_environment();
};

// "glb", "ply" or "obj": by --format, else by the end of -o.
std::string chosen_format(const ExportOptions& options) {
  const std::string end = options.out.extension().string();
  for (const char* format : {"glb", "ply", "obj"})
    if (end == std::string(".") + format) {
      if (!options.format.empty() && options.format != format) throw InputError(options.out.string(), "", "a name that ends in ." + options.format, "'" + end + "'");
      return format;
    }
  if (options.format == "ply" || options.format == "obj") return options.format;  // a folder
  throw InputError(options.out.string(), "", "a name that ends in .glb, .ply or .obj, or a folder with --format ply or obj", end.empty() ? "no such end" : "'" + end + "'");
}

std::vector<MotionFrame> exported_frames(const ExportOptions& options, const ChosenMotion& motion) {
  if (options.frame) return {frame_of(motion, *options.frame)};
  std::vector<MotionFrame> frames;
  for (std::size_t f = 0; f < motion.frames.size() && (options.count == 0 || frames.size() < static_cast<std::size_t>(options.count)); f += static_cast<std::size_t>(options.every)) frames.push_back(motion.frames[f]);
  return frames;
}

MeshSettings mesh_settings(const ExportOptions& options, const Avatar& avatar) {
  MeshSettings settings;
  settings.cell = options.cell;
  settings.outline = options.outline.value_or(0) * density_scale(avatar);
  if (options.largest_part) settings.least_part = 1;
  settings.most_triangles = options.triangles;
  return settings;
}

int export_glb(const ExportOptions& options, const Avatar& avatar, const ChosenMotion& motion, const std::vector<ExportedFrame>& frames) {
  ModelSettings settings;
  settings.colors = options.colors == "none" ? MeshColors::none : options.colors == "vertex" ? MeshColors::vertex : MeshColors::texture;
  settings.texture_size = options.texture_size;
  settings.name = options.out.stem().string();
  settings.motion = options.motion.capture.empty() ? options.motion.motion.stem().string() : options.motion.split;
  settings.outlined = !options.outline;
  settings.animated = !options.motion.rests() && avatar.spec.skinning.kind != Skinning::none;
  settings.z_up = motion.up == UpAxis::z;
  settings.frames_per_second = rate_of(motion, options.fps, options.every, options.frame.has_value());
  Device device(options.device);
  Progress progress("export", 1.0, "");
  MeshExtraction extraction(device, avatar, mesh_settings(options, avatar));
  ModelReport report;
  const SkinnedModel model = skinned_model(extraction, avatar, frames, settings, report, [&](double part) { progress.update(0.5 + 0.5 * part); });
  write_file_safely(options.out, skinned_glb(model));
  progress.finish(options.out.string());
  fmt::print("{}\n", describe(report));
  return 0;
}

// What the meshes depend on.
nlohmann::ordered_json description(const ExportOptions& options, const Avatar& avatar, const std::string& format, const std::vector<ExportedFrame>& frames) {
  Fingerprint poses;
  for (const ExportedFrame& frame : frames) {
    for (const glm::dvec3& theta : frame.pose.theta)
      for (int k = 0; k < 3; ++k) poses.add(theta[k]);
    for (int k = 0; k < 3; ++k) poses.add(frame.pose.root_position[k]);
    poses.add(uint64_t{frame.latent_row});
  }
  return {{"avatar", fingerprint_of(avatar)}, {"frames", frames.size()}, {"poses", poses.text()}, {"format", format}, {"cell", options.cell}, {"outline", options.outline.value_or(0)}, {"triangles", options.triangles}, {"largest_part", options.largest_part},
          {"colors", options.colors == "none" ? "none" : "vertex"}, {"points", options.points}, {"seed", options.points ? options.seed : 0}};
}

int export_meshes(const ExportOptions& options, const Avatar& avatar, const std::string& format, const std::vector<MotionFrame>& numbered, const std::vector<ExportedFrame>& frames) {
  const bool single = options.out.extension() == "." + format;
  if (single && frames.size() > 1) throw InputError(options.out.string(), "", "--frame with a single file, or a folder with --format " + format, fmt::format("{} frames", frames.size()));
  const auto path_of = [&](std::size_t f) { return single ? options.out : options.out / fmt::format("{:06}.{}", numbered[f].number, format); };
  std::vector<std::size_t> missing;
  for (std::size_t f = 0; f < frames.size(); ++f) {
    if (single || !fs::exists(path_of(f))) missing.push_back(f);
  }
  if (!single) claim_folder(options.out, "export.json", description(options, avatar, format, frames), "meshes", [&] { return missing.size() < frames.size(); });
  const std::size_t before = frames.size() - missing.size();
  Progress progress("export", double(frames.size()), "frames", double(before));
  if (before > 0) progress.say(fmt::format("{}: {} of {} frames are there", options.out.string(), before, frames.size()));
  if (!missing.empty()) {
    Device device(options.device);
    MeshExtraction extraction(device, avatar, mesh_settings(options, avatar));
    const Interrupt interrupt;
    for (std::size_t done = before; const std::size_t f : missing) {
      if (interrupt.wanted()) throw std::runtime_error(fmt::format("stopped after {} of {} frames{}", done, frames.size(), single ? "" : "; the same call goes on"));
      ColoredMesh mesh = posed_mesh(extraction, frames[f], options.colors != "none");
      if (options.points) mesh = sampled_points(mesh, options.points, options.seed);
      const std::string comment = fmt::format("arah {}, metres, frame {}", kVersion, numbered[f].number);
      write_file_safely(path_of(f), format == "ply" ? ply_file(mesh, comment) : obj_file(mesh, comment));
      progress.update(double(++done));
    }
  }
  progress.finish(options.out.string());
  return 0;
}

int export_avatar(const ExportOptions& options) {
  const std::string format = chosen_format(options);
  if (options.motion.rests() && options.frame) throw InputError("--frame", "", "--capture or --motion with it", "neither");
  if (format != "glb" && options.colors == "texture") throw InputError("--colors", "", "vertex or none in a ." + format, "texture", "Textures go into a .glb.");
  if (format == "glb" && options.points) throw InputError("--points", "", "a .ply or .obj", ".glb");
  const Avatar avatar = load_avatar(avatar_file(options.avatar));
  require_surface(avatar.spec, "export");
  const ChosenMotion motion = chosen_motion(options.motion, avatar);
  const std::vector<MotionFrame> numbered = exported_frames(options, motion);
  std::vector<ExportedFrame> frames;
  for (const MotionFrame& frame : numbered) {
    frames.push_back({frame.pose, latent_row_of(motion, avatar, frame.number)});
    if (options.color_frame && avatar.spec.latent_size > 0) {
      if (std::find(avatar.latent_frames.begin(), avatar.latent_frames.end(), *options.color_frame) == avatar.latent_frames.end())
        throw InputError("--code", "", fmt::format("one of the avatar's {} training frames", avatar.latent_frames.size()), fmt::format("{}", *options.color_frame));
      frames.back().latent_row = latent_row(avatar, *options.color_frame);
    }
  }
  return format == "glb" ? export_glb(options, avatar, motion, frames) : export_meshes(options, avatar, format, numbered, frames);
}

}  // namespace

void add_export_command(CLI::App& program, Run& run) {
  const auto options = std::make_shared<ExportOptions>();
  CLI::App* command = program.add_subcommand("export", "An avatar for other programs: skinned glTF, or posed meshes and points");
  command->add_option("AVATAR", options->avatar, kAvatarHelp)->required();
  command->add_option("-o,--out", options->out, "a .glb (skinned mesh, texture, skeleton, the motion as its animation; +Y up), or a .ply or .obj of one frame, or a folder of them with --format (in the motion's world), beside which export.json says what they were made with")->required();
  command->add_option("--format", options->format, "ply or obj: a file a frame in the folder -o")->check(CLI::IsMember({"glb", "ply", "obj"}));
  add_motion_options(*command, options->motion);
  CLI::Option* frame = command->add_option("--frame", options->frame, "number of one frame of the motion");
  command->add_option("--every", options->every, "take every so-many-th frame of the motion")->check(CLI::Range(1, 1000000))->capture_default_str()->excludes(frame);
  command->add_option("--count", options->count, "frames, at most (default: all)")->check(CLI::Range(1, 1000000));
  command->add_option("--cell", options->cell, "metres: the surface is meshed on cubes of this edge; half of it gives four times as many triangles")->check(CLI::Range(0.001, 0.1))->capture_default_str();
  command->add_option("--triangles", options->triangles, "at most so many triangles: the mesh of --cell is simplified where that changes it least (default: all of them)")->check(CLI::Range(std::size_t{16}, std::size_t{100'000'000}));
  command->add_flag("--largest", options->largest_part, "the largest connected part of the surface alone (else without parts of less than 1 % of it)");
  command->add_option("--outline", options->outline, "the mesh lies so many b (the scale of the density) outside of the surface (default: in a .glb what gives each place the outline that renderings show, 1 to 3; else 0: the surface itself)")->check(CLI::Range(0.0, 10.0));
  command->add_option("--colors", options->colors, "texture (a .glb's default), vertex (else) or none")->check(CLI::IsMember({"texture", "vertex", "none"}));
  command->add_option("--texture-size", options->texture_size, "columns and rows of the texture")->check(CLI::Range(64, 8192))->capture_default_str();
  command->add_option("--code", options->color_frame, "training frame whose learned code colours (and, where the shape follows it, shapes) all frames (default: each frame's own; the last one's outside of training)");
  add_rate_option(*command, options->fps, "frames a second of the animation");
  command->add_option("--points", options->points, "instead of the mesh so many points, evenly over its surface at random, with normals and colours")->check(CLI::Range(std::size_t{1}, std::size_t{100'000'000}));
  command->add_option("--seed", options->seed, "of the points")->capture_default_str();
  add_device_option(*command, options->device);
  add_memory_option(*command, options->device);
  command->footer(
      "A folder of meshes that was interrupted (Ctrl-C, exit code 1) goes on with the same call: frames that are there are kept.\n"
      "Example: arah export run -o person.glb --capture capture --split novel\n"
      "         arah export run -o meshes --format ply --capture capture --split novel\n"
      "         arah export run -o cloud.ply --points 100000");
  command->callback([options, &run] { run = [options] { return export_avatar(*options); }; });
}

}  // namespace arah
