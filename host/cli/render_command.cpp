#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <memory>
#include <optional>

#include "host/avatar/avatar_file.h"
#include "host/cli/arguments.h"
#include "host/cli/command.h"
#include "host/cli/motion_options.h"
#include "host/cli/progress.h"
#include "host/cli/rank_devices.h"
#include "host/cli/shader_progress.h"
#include "host/evaluation/animation.h"
#include "host/evaluation/bad_pixels.h"
#include "host/evaluation/layers.h"
#include "host/evaluation/picture.h"
#include "host/evaluation/shared_work.h"
#include "host/file_writing.h"
#include "host/rendering/orbit_camera.h"
#include "host/rendering/renderer.h"

namespace arah {
namespace {

namespace fs = std::filesystem;

constexpr int kOrbitSize = 512;

struct Options {
  fs::path avatar, out;
  MotionOptions motion;
  std::string camera;
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

View chosen_view(const Options& options, const Avatar& avatar) {
  const ChosenMotion motion = chosen_motion(options.motion, avatar);
  const MotionFrame& frame = options.frame ? frame_of(motion, *options.frame) : motion.frames.front();
  View view{frame.pose, {}, latent_row_of(motion, avatar, frame.number)};
  if (!options.camera.empty()) {
    view.camera = motion.capture->cameras[camera_index(*motion.capture, options.camera)];
    if (options.size > 0) view.camera = view.camera.scaled(options.size);
  } else {
    view.camera = orbit_camera(posed_vertices(avatar.body, view.pose), motion.up, options.orbit, options.size > 0 ? options.size : kOrbitSize);
  }
  return view;
}

// "weights:left_knee": a layer, of a joint. Throws InputError for what is no layer, or takes no joint.
struct AskedLayer {
  PictureLayer layer = PictureLayer::color;
  std::string joint;  // empty: none was named

  explicit AskedLayer(const std::string& text) : layer(layer_named(text.substr(0, text.find(':')))) {
    const std::size_t colon = text.find(':');
    if (colon == std::string::npos) return;
    joint = text.substr(colon + 1);
    if (layer != PictureLayer::weights && layer != PictureLayer::slice) throw InputError("layer", "", "a joint's name after weights: or slice: alone", "'" + text + "'");
    if (joint.empty()) throw InputError("layer", "", "a joint's name after the colon", "'" + text + "'");
  }
  // -1 without one. Throws InputError for a joint that the body does not have.
  int joint_of(const Skeleton& skeleton) const {
    const int found = joint.empty() ? -1 : find_joint(skeleton, joint);
    if (!joint.empty() && found < 0) throw InputError(fmt::format("layer {}", to_string(layer)), "", fmt::format("a joint of the body, one of {}", fmt::join(skeleton.names, ", ")), "'" + joint + "'");
    return found;
  }
  std::string file_stem() const {
    std::string stem = joint.empty() ? to_string(layer) : fmt::format("{}_{}", to_string(layer), joint);
    for (char& letter : stem)
      if (!std::isalnum(static_cast<unsigned char>(letter)) && letter != '-') letter = '_';
    return stem;
  }
};

std::string is_layer(const std::string& text) {
  try {
    AskedLayer{text};
  } catch (const InputError& error) {
    const std::string text_of_error = error.what();
    return text_of_error.substr(0, text_of_error.find_last_not_of('.') + 1);  // the program ends the sentence
  }
  return "";
}

// With what its colours mean: empty for colour, depth and normals, whose files hold the numbers.
struct LayerFile {
  std::vector<uint8_t> png;
  std::string legend;
};

LayerFile layer_file(Renderer& renderer, const Avatar& avatar, const View& view, const Picture& picture, const AskedLayer& asked) {
  if (asked.layer == PictureLayer::color) return {encode_png(straight_alpha(picture.color, picture.alpha, picture.width, picture.height), picture.width, picture.height, 4), ""};
  if (asked.layer == PictureLayer::depth) return {encode_depth_png(picture.depth, picture.width, picture.height), ""};
  if (asked.layer == PictureLayer::normal) return {encode_png(normals_to_rgb(picture.normal, picture.width, picture.height), picture.width, picture.height, 3), ""};
  LayerImage image;
  if (asked.layer == PictureLayer::weights) {
    image = weights_layer(renderer, avatar, picture, view.camera, view.pose, asked.joint_of(avatar.body.skeleton));
  } else if (asked.layer == PictureLayer::slice) {
    const int joint = asked.joint_of(avatar.body.skeleton);
    glm::dvec3 through(0.0);
    if (joint < 0) {
      const std::vector<glm::vec3> body = posed_vertices(avatar.body, view.pose);
      for (const glm::vec3& vertex : body) through += glm::dvec3(vertex) / double(body.size());
    } else {
      through = glm::dvec3(forward_kinematics(avatar.body.skeleton, view.pose)[static_cast<std::size_t>(joint)][3]) + root_translation(avatar.body.skeleton, view.pose);
    }
    if (!(view.camera.to_camera(through).z > 0)) throw InputError("layer slice", "", "a plane in front of the camera", fmt::format("its middle {:.2f} m behind", -view.camera.to_camera(through).z));
    image = slice_layer(renderer.slice(plane_facing(view.camera, through), picture.width, picture.height, view.pose, view.latent_row));
  } else {
    image = layer_image(asked.layer, picture, avatar);
  }
  return {encode_png(image), describe(image.legend)};
}

// Where each layer goes, in their order.
std::vector<fs::path> layer_files(const Options& options, const std::vector<AskedLayer>& layers) {
  std::vector<fs::path> files;
  const bool named = options.out.extension() == ".png";
  for (const AskedLayer& asked : layers) {
    if (!named) {
      files.push_back(options.out / (asked.file_stem() + ".png"));
    } else if (layers.size() == 1 || asked.layer == PictureLayer::color) {
      files.push_back(options.out);
    } else {
      files.push_back(options.out.parent_path() / fmt::format("{}_{}.png", options.out.stem().string(), asked.file_stem()));
    }
  }
  if (!named) make_folder(options.out);
  return files;
}

int render(const Options& options) {
  if (options.motion.capture.empty() && !options.camera.empty()) throw InputError("--camera", "", "--capture with it", "none");
  if (options.motion.rests() && options.frame)
    throw InputError("--frame", "", "--capture or --motion with it", "neither");
  const Avatar avatar = load_avatar(avatar_file(options.avatar));
  const View view = chosen_view(options, avatar);
  const Ranks& ranks = Ranks::of_process();
  Device device(device_of_rank(options.device, ranks));
  RenderSettings settings = options.quality.settings(avatar);
  std::vector<AskedLayer> layers;
  for (const std::string& text : options.layers) {
    layers.emplace_back(text);
    layers.back().joint_of(avatar.body.skeleton);
    settings.normals = settings.normals || needs_normals(layers.back().layer);
    settings.inspect = settings.inspect || needs_inspection(layers.back().layer);
  }
  agree_on_work(ranks, avatar, fmt::format("{} {} {} {}", fingerprint_of(std::vector<AnimationFrame>{{view.pose, view.camera, view.latent_row}}), render_settings_json(settings), settings.normals, settings.inspect));
  const std::string unequal = unequal_devices(ranks, device);
  Renderer renderer(device, avatar, settings);
  if (!ranks.first()) {
    render_shared(renderer, view.camera, view.pose, view.latent_row, ranks);
    return 0;
  }
  Progress progress("render", 1.0, "");
  if (!unequal.empty()) progress.say(unequal);
  const Picture picture = render_shared(renderer, view.camera, view.pose, view.latent_row, ranks, [&](const PictureSoFar& so_far) {
    progress.update(so_far.part);
    return true;
  });
  const std::vector<fs::path> files = layer_files(options, layers);
  if (const BadPixels bad = bad_pixels(picture); bad.count > 0) progress.say(warning_of(bad, options.out.string(), options.avatar.string()));
  for (std::size_t i = 0; i < files.size(); ++i) {
    const LayerFile file = layer_file(renderer, avatar, view, picture, layers[i]);
    write_file_safely(files[i], file.png);
    progress.say(file.legend.empty() ? files[i].string() : fmt::format("{}  {}", files[i].string(), file.legend));
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
                   "a .png, beside which further layers become NAME_depth.png, NAME_normal.png and so on; or a folder for "
                   "color.png, depth.png, normal.png, ...")
      ->required();
  add_motion_options(*command, options->motion);
  CLI::Option* camera =
      command->add_option("--camera", options->camera, "of the capture; without it the camera circles the body");
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
                   "normal (world axes, n/2 + 1/2), and in colours that a line beside the file's name explains: canonical (where on the "
                   "canonical body: red x, green y, blue z, lines every 10 cm), weights (skinning weights of all joints, mixed) or weights:JOINT, "
                   "slice (signed distances on a plane parallel to the picture through the body's middle: blue inside, red outside, lines every "
                   "cm) or slice:JOINT (through that joint), samples (colours evaluated along the ray), steps (of the root "
                   "search, mean of the ray's samples), failures (share of the ray's samples for which no root was found)")
      ->delimiter(',')
      ->check(is_layer)
      ->capture_default_str();
  add_quality_options(*command, options->quality);
  add_device_option(*command, options->device);
  add_memory_option(*command, options->device);
  command->footer(
      "Example: arah render run -o turned.png --orbit 90 --layers color,depth,normal\n"
      "         mpirun -n 4 arah render run -o large.png --size 2048   (bands of rows, each on the rank that is free)");
  command->callback([options, &run] { run = [options] { return render(*options); }; });
}

}  // namespace arah
