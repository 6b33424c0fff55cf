#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <glm/matrix.hpp>
#include <memory>
#include <optional>

#include "host/avatar/avatar_file.h"
#include "host/cli/arguments.h"
#include "host/cli/command.h"
#include "host/cli/progress.h"
#include "host/cli/shader_progress.h"
#include "host/evaluation/picture.h"
#include "host/file_writing.h"
#include "host/rendering/orbit_camera.h"
#include "host/rendering/renderer.h"

namespace arah {
namespace {

namespace fs = std::filesystem;

constexpr int kOrbitSize = 512;

struct Options {
  fs::path avatar, out, capture, motion;
  std::string split = "train", camera;
  std::optional<int> frame;
  double orbit = 0;
  int size = 0;
  std::vector<std::string> layers{"color"};
  QualityOptions quality;
  DeviceOptions device = DeviceOptions::from_environment();
};

struct View {
  Pose pose;
  Camera camera;
  std::size_t latent_row = 0;
};

// The pose that an avatar without skinning has, from its bones' transforms rest → posed.
Pose pose_of(const CanonicalPose& canonical, const Skeleton& skeleton) {
  Pose pose = rest_pose(skeleton);
  for (std::size_t j = 0; j < skeleton.size(); ++j) {
    const glm::dmat3 rotation(canonical.rest_to_canonical[j]);
    const int parent = skeleton.parents[j];
    pose.theta[j] = axis_angle_from_rotation(
        parent < 0
            ? rotation
            : glm::transpose(glm::dmat3(canonical.rest_to_canonical[static_cast<std::size_t>(parent)])) * rotation);
  }
  return pose;
}

const MotionFrame& chosen_frame(const Motion& motion, const std::optional<int>& number, const std::string& where) {
  if (!number) return motion.frames.front();
  if (const MotionFrame* frame = find_frame(motion, *number)) return *frame;
  throw InputError(where, "frame",
                   fmt::format("one of {} frames, {} to {}", motion.frames.size(), motion.frames.front().number,
                               motion.frames.back().number),
                   fmt::format("{}", *number));
}

View chosen_view(const Options& options, const Avatar& avatar) {
  View view;
  UpAxis up = UpAxis::z;
  int frame_number = -1;
  std::optional<Camera> camera;
  if (!options.capture.empty()) {
    const Capture capture = open_capture(options.capture);
    const Motion motion =
        adapt_motion(motion_of(capture, options.split), avatar.body.skeleton, options.capture.string());
    const MotionFrame& frame =
        chosen_frame(motion, options.frame, fmt::format("{}: split {}", options.capture.string(), options.split));
    view.pose = pose_to_render(avatar.refined, options.split, frame);
    if (options.split == "train") frame_number = frame.number;
    if (!options.camera.empty()) {
      camera = capture.cameras[camera_index(capture, options.camera)];
      if (options.size > 0) camera = camera->scaled(options.size);
    }
  } else if (!options.motion.empty()) {
    const std::string where = options.motion.string();
    view.pose =
        chosen_frame(adapt_motion(read_motion(options.motion), avatar.body.skeleton, where), options.frame, where).pose;
  } else if (avatar.spec.skinning.kind == Skinning::none) {
    view.pose = pose_of(avatar.canonical, avatar.body.skeleton);
  } else {
    view.pose = rest_pose(avatar.body.skeleton);
    up = UpAxis::y;
  }
  view.camera = camera ? *camera
                       : orbit_camera(posed_vertices(avatar.body, view.pose), up, options.orbit,
                                      options.size > 0 ? options.size : kOrbitSize);
  if (avatar.spec.latent_size > 0) view.latent_row = latent_row(avatar, frame_number);
  return view;
}

// Colour with straight alpha: compositing leaves it multiplied.
std::vector<float> straight_alpha(const Picture& picture) {
  std::vector<float> rgba;
  rgba.reserve(4 * picture.alpha.size());
  for (std::size_t i = 0; i < picture.alpha.size(); ++i) {
    const float alpha = picture.alpha[i];
    for (std::size_t c = 0; c < 3; ++c) rgba.push_back(alpha > 0 ? picture.color[3 * i + c] / alpha : 0.0f);
    rgba.push_back(alpha);
  }
  return rgba;
}

std::vector<uint8_t> layer_png(const Picture& picture, const std::string& layer) {
  if (layer == "color") return encode_png(straight_alpha(picture), picture.width, picture.height, 4);
  if (layer == "depth") return encode_depth_png(picture.depth, picture.width, picture.height);
  return encode_png(normals_to_rgb(picture.normal, picture.width, picture.height), picture.width, picture.height, 3);
}

// Where each layer goes, in the order of options.layers.
std::vector<fs::path> layer_files(const Options& options) {
  std::vector<fs::path> files;
  const bool named = options.out.extension() == ".png";
  for (const std::string& layer : options.layers) {
    if (!named) {
      files.push_back(options.out / (layer + ".png"));
    } else if (options.layers.size() == 1 || layer == "color") {
      files.push_back(options.out);
    } else {
      files.push_back(options.out.parent_path() / fmt::format("{}_{}.png", options.out.stem().string(), layer));
    }
  }
  if (!named) make_folder(options.out);
  return files;
}

int render(const Options& options) {
  if (options.capture.empty() && !options.camera.empty()) throw InputError("--camera", "", "--capture with it", "none");
  if (options.capture.empty() && options.motion.empty() && options.frame)
    throw InputError("--frame", "", "--capture or --motion with it", "neither");
  const Avatar avatar = load_avatar(avatar_file(options.avatar));
  const View view = chosen_view(options, avatar);
  Device device(options.device);
  RenderSettings settings = options.quality.settings(avatar);
  settings.normals = std::find(options.layers.begin(), options.layers.end(), "normal") != options.layers.end();
  Renderer renderer(device, avatar, settings);
  Progress progress("render", 1.0, "");
  const Picture picture = renderer.render(view.camera, view.pose, view.latent_row, [&](double part) {
    progress.update(part);
    return true;
  });
  const std::vector<fs::path> files = layer_files(options);
  for (std::size_t i = 0; i < files.size(); ++i) {
    write_file_safely(files[i], layer_png(picture, options.layers[i]));
    progress.say(files[i].string());
  }
  progress.finish(fmt::format("{} x {} pixels  {}", picture.width, picture.height, shaders_text(device)));
  return 0;
}

}  // namespace

void add_render_command(CLI::App& program, Run& run) {
  const auto options = std::make_shared<Options>();
  CLI::App* command = program.add_subcommand("render", "Render an avatar: at rest, in a capture's pose or a motion's");
  command->add_option("AVATAR", options->avatar, kAvatarHelp)->required();
  command
      ->add_option("-o,--out", options->out,
                   "a .png, beside which further layers become NAME_depth.png and NAME_normal.png; or a folder for "
                   "color.png, depth.png, normal.png")
      ->required();
  CLI::Option* capture = command->add_option("--capture", options->capture, "take the pose of a capture's frame");
  command->add_option("--split", options->split, "of the capture: train, novel, ...")
      ->capture_default_str()
      ->needs(capture);
  CLI::Option* camera =
      command->add_option("--camera", options->camera, "of the capture; without it the camera circles the body");
  command->add_option("--motion", options->motion, "take the pose of a frame of this motion_<split>.json")
      ->excludes(capture);
  command->add_option("--frame", options->frame, "number of the capture's or the motion's frame (default: the first)");
  command
      ->add_option("--orbit", options->orbit,
                   "place of the circling camera, degrees; 0 is in front of a person at rest")
      ->check(CLI::Range(-1e6, 1e6))
      ->capture_default_str()
      ->excludes(camera);
  command
      ->add_option("--size", options->size,
                   fmt::format("columns of the picture (default: the camera's; {} of a circling one)", kOrbitSize))
      ->check(CLI::Range(1, 8192));
  command
      ->add_option("--layers", options->layers,
                   "with commas between: color (RGBA), depth (16-bit grey, millimetres along the ray, 0 = nothing), "
                   "normal (world axes, n/2 + 1/2)")
      ->delimiter(',')
      ->check(CLI::IsMember({"color", "depth", "normal"}))
      ->capture_default_str();
  add_quality_options(*command, options->quality);
  add_device_option(*command, options->device);
  add_memory_option(*command, options->device);
  command->footer("Example: arah render run -o turned.png --orbit 90 --layers color,depth,normal");
  command->callback([options, &run] { run = [options] { return render(*options); }; });
}

}  // namespace arah
