#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <memory>
#include <nlohmann/json.hpp>
#include <set>

#include "host/avatar/avatar_file.h"
#include "host/avatar/spec_choice.h"
#include "host/capture/inspect.h"
#include "host/cli/arguments.h"
#include "host/cli/command.h"
#include "host/cli/motion_options.h"
#include "host/cli/progress.h"
#include "host/evaluation/capture_page.h"
#include "host/evaluation/conditioning_page.h"
#include "host/file_writing.h"
#include "host/input_error.h"
#include "host/training/bad_values.h"

namespace arah {
namespace {

// What training would model for this capture, one line a part.
std::string choice_text(const Capture& capture, const std::string& preset) {
  std::string text = fmt::format("an avatar of the preset {} would have:\n", preset);
  try {
    check_extent(cube_normalization(canonical_vertices(capture.body_template, make_canonical_pose(capture.body_template.skeleton))), (capture.path / "template.glb").string());
    for (const std::string& reason : choose_spec(preset, capture_facts(capture)).reasons) text += "  " + reason + "\n";
  } catch (const InputError& error) {
    // A capture for evaluation alone is worth inspecting too.
    text = fmt::format("warning: no avatar can be trained from it: {}\n", error.what());
  }
  return text;
}

struct InspectOptions {
  std::filesystem::path path, out;
  std::string preset = "tiny";
  int pictures = 6;
  // Of an avatar.
  MotionOptions motion;
  std::vector<int> frames;
  int count = 8, size = 0;
  std::string camera;
  double orbit = 0;
  ConditioningSettings conditioning;
  DeviceOptions device = DeviceOptions::from_environment();

  bool names_poses() const { return !motion.rests() || !frames.empty(); }
};

constexpr int kConditioningSize = 480;

// The named frames, else at most `count`, evenly over the motion.
std::vector<MotionFrame> examined_frames(const InspectOptions& options, const ChosenMotion& motion) {
  std::vector<MotionFrame> frames;
  for (const int number : std::set<int>(options.frames.begin(), options.frames.end())) frames.push_back(frame_of(motion, number));
  if (!frames.empty()) return frames;
  const std::size_t all = motion.frames.size(), count = std::min(all, static_cast<std::size_t>(options.count));
  for (std::size_t i = 0; i < count; ++i) frames.push_back(motion.frames[i * all / count]);
  return frames;
}

// The capture's camera, else one before the person and one behind.
std::vector<Camera> conditioning_cameras(const InspectOptions& options, const ChosenMotion& motion, const ExaminedPose& pose) {
  if (!options.camera.empty()) {
    const Camera& camera = motion.capture->cameras[camera_index(*motion.capture, options.camera)];
    return {options.size > 0 ? camera.scaled(options.size) : camera};
  }
  std::vector<Camera> cameras;
  for (const double degrees : {options.orbit, options.orbit + 180}) cameras.push_back(close_up(orbit_camera(pose.vertices, motion.up, degrees, options.size > 0 ? options.size : kConditioningSize), pose.vertices));
  return cameras;
}

// Lines, one a pose; with -o the page and the JSON.
std::string examine_poses(const InspectOptions& options, const std::filesystem::path& file, const Avatar& avatar) {
  if (options.motion.rests()) throw InputError("--frame", "", "--capture or --motion with it", "neither");
  if (options.motion.capture.empty() && !options.camera.empty()) throw InputError("--camera", "", "--capture with it", "none");
  const ChosenMotion motion = chosen_motion(options.motion, avatar);
  const std::vector<MotionFrame> frames = examined_frames(options, motion);
  if (!options.camera.empty()) camera_index(*motion.capture, options.camera);  // before the work, not after it
  if (!options.out.empty()) make_folder(options.out);
  Device device(options.device);
  Progress progress("inspect", double(frames.size()), "poses");
  Conditioning conditioning(device, avatar, options.conditioning);
  std::vector<ConditioningFigures> figures;
  std::vector<ConditioningEntry> entries;
  std::string report;
  for (const MotionFrame& frame : frames) {
    const ExaminedPose pose = conditioning.examine(frame.pose, latent_row_of(motion, avatar, frame.number), frame.number);
    figures.push_back(pose.figures);
    report += describe(pose.figures) + "\n";
    if (!options.out.empty()) {
      entries.push_back({pose.figures, {}});
      for (const Camera& camera : conditioning_cameras(options, motion, pose)) entries.back().pictures.push_back({fmt::format("frame {}, {}", frame.number, options.camera.empty() ? fmt::format("seen from {:g}°", options.orbit + (entries.back().pictures.empty() ? 0 : 180)) : "camera " + camera.name), conditioning_picture(pose, camera, options.conditioning.reach)});
    }
    progress.update(double(figures.size()));
  }
  progress.finish();
  if (!options.out.empty()) {
    const std::filesystem::path page = options.out / "conditioning.html";
    write_file_safely(options.out / "conditioning.json", conditioning_json(avatar, options.conditioning, figures).dump(2) + "\n");
    write_file_safely(page, conditioning_page(file.parent_path().filename() / file.filename(), motion.where, avatar, options.conditioning, std::move(entries)));
    report += page.string() + "\n";
  }
  return report;
}

std::string inspect_avatar(const InspectOptions& options) {
  const std::filesystem::path path = avatar_file(options.path);
  const SafetensorsFile file = read_safetensors(path);
  const Avatar avatar = avatar_from_tensors(file);
  std::string report;
  if (const auto bad = bad_values_of(file)) report = bad_values_report(*bad);
  report += describe(avatar);
  if (options.names_poses()) return report + examine_poses(options, path, avatar);
  if (!options.out.empty()) throw InputError("--out", "", "poses of the avatar to look at: --capture or --motion with it", "neither");
  return report;
}

}  // namespace

void add_inspect_command(CLI::App& program, Run& run) {
  const auto options = std::make_shared<InspectOptions>();
  CLI::App* command =
      program.add_subcommand("inspect", "Say what a capture, motion, template or avatar holds, and what looks wrong");
  command
      ->add_option("PATH", options->path,
                   "a capture's folder, a motion (.json, .bvh, .npz, .pkl, .glb, .gltf) or cameras.json, a template (.glb, .gltf), an avatar (.safetensors, or the folder of its run) or the failure_*.safetensors of a training that stopped on bad values")
      ->required();
  command->add_option("--preset", options->preset, "sizes that the choice of an avatar's parts starts from")
      ->check(CLI::IsMember(preset_names()))
      ->capture_default_str();
  command->add_option("--pictures", options->pictures, "pictures to read of each camera and split of a capture")
      ->check(CLI::Range(0, 1000000))
      ->capture_default_str();
  command->add_option("-o,--out", options->out,
                      "of a capture: folder for inspect.html, a page with plans of cameras and motion, the template and the masks over the photographs, and what looks wrong; of an avatar in poses: folder for conditioning.html and conditioning.json");
  add_motion_options(*command, options->motion);
  command->get_option("--capture")->description("of an avatar: how its skinning and the search of correspondences stand the poses of this capture's frames");
  CLI::Option* frame = command->add_option("--frame", options->frames, "numbers of the motion's frames to look at, 12,40,66")->delimiter(',')->allow_extra_args(false);
  command->add_option("--count", options->count, "frames, at most, evenly over the motion")->check(CLI::Range(1, 1000000))->capture_default_str()->excludes(frame);
  CLI::Option* camera = command->add_option("--camera", options->camera, "of the capture, for the pictures; without it two circling ones, before the person and behind");
  command->add_option("--orbit", options->orbit, "place of the first circling camera, degrees; 0 is in front of a person at rest")->check(CLI::Range(-1e6, 1e6))->capture_default_str()->excludes(camera);
  command->add_option("--size", options->size, fmt::format("columns of a picture (default: the camera's; {} of a circling one)", kConditioningSize))->check(CLI::Range(16, 8192));
  command->add_option("--cell", options->conditioning.cell, "metres: the avatar's surface is meshed on cubes of this edge")->check(CLI::Range(0.001, 0.1))->capture_default_str();
  command->add_option("--samples", options->conditioning.samples, "points around the surface whose correspondences are searched, about")->check(CLI::Range(std::size_t{5}, std::size_t{10'000'000}))->capture_default_str();
  command->add_option("--reach", options->conditioning.reach, "metres in front of the surface and behind that they lie within")->check(CLI::Range(0.0, 1.0))->capture_default_str();
  add_device_option(*command, options->device);
  add_memory_option(*command, options->device);
  command->footer("Example: arah inspect capture --preset paper\n         arah inspect capture -o inspection\n         arah inspect run --capture capture --split novel -o conditioning");
  command->callback([options, &run] {
    run = [options] {
      std::string report;
      const bool folder = std::filesystem::is_directory(options->path);
      if (options->path.extension() == ".safetensors" || (folder && std::filesystem::exists(options->path / "avatar.safetensors"))) {
        report = inspect_avatar(*options);
      } else if (options->names_poses()) {
        throw InputError(options->motion.rests() ? "--frame" : options->motion.capture.empty() ? "--motion" : "--capture", "", "an avatar to put into poses", "'" + options->path.string() + "'");
      } else if (folder) {
        const Capture capture = open_capture(options->path);
        CaptureInspection found = examine_capture(capture, options->pictures);
        found.report += choice_text(capture, options->preset);
        report = found.report;
        if (!options->out.empty()) {
          make_folder(options->out);
          const std::filesystem::path page = options->out / "inspect.html";
          write_file_safely(page, capture_page(capture, found));
          report += page.string() + "\n";
        }
      } else if (!options->out.empty()) {
        throw InputError("--out", "", "a capture's folder to draw, or an avatar", "'" + options->path.string() + "'");
      } else {
        report = inspect(options->path);
      }
      fmt::print("{}", report);
      return 0;
    };
  });
}

}  // namespace arah
