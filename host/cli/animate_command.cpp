#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <memory>
#include <optional>

#include "host/avatar/avatar_file.h"
#include "host/cli/arguments.h"
#include "host/cli/command.h"
#include "host/cli/interrupt.h"
#include "host/cli/motion_options.h"
#include "host/cli/outcome.h"
#include "host/cli/progress.h"
#include "host/cli/rank_devices.h"
#include "host/cli/shader_progress.h"
#include "host/evaluation/animation.h"
#include "host/evaluation/video.h"
#include "host/input_error.h"
#include "host/version.h"

namespace arah {
namespace {

namespace fs = std::filesystem;

constexpr int kCirclingSize = 512, kTurn = 60;  // pixels; pictures of a turn around one pose
constexpr std::size_t kNamedBadPictures = 5;  // on lines of their own

struct AnimateOptions {
  fs::path avatar, out, cameras;
  MotionOptions motion;
  std::string camera, beside, background = "white";
  std::optional<int> frame;
  int every = 1, count = 0, size = 0;
  double orbit = 0, turns = 1;
  std::optional<double> fps;
  bool turntable = false, keep = false;
  QualityOptions quality;
  DeviceOptions device = DeviceOptions::from_environment();

  bool video() const { return out.extension() == ".mp4"; }
};

std::array<float, 3> background_color(const std::string& name) {
  const float grey = name == "white" ? 1.0f : name == "grey" ? 0.5f : 0.0f;
  return {grey, grey, grey};
}

// The frames that pictures are made of, one each: a single pose as often as the camera looks at it.
std::vector<MotionFrame> chosen_frames(const AnimateOptions& options, const ChosenMotion& motion) {
  std::vector<MotionFrame> frames;
  if (options.frame) frames.push_back(frame_of(motion, *options.frame));
  else
    for (std::size_t f = 0; f < motion.frames.size(); f += static_cast<std::size_t>(options.every)) frames.push_back(motion.frames[f]);
  if (frames.size() == 1 && options.turntable) frames.resize(static_cast<std::size_t>(options.count > 0 ? options.count : kTurn), MotionFrame(frames[0]));
  else if (options.count > 0 && frames.size() > static_cast<std::size_t>(options.count)) frames.resize(static_cast<std::size_t>(options.count));
  return frames;
}

// Corners of the box around the template in all of the frames.
std::vector<glm::vec3> box_corners(const BodyTemplate& body, const std::vector<MotionFrame>& frames) {
  glm::vec3 low(std::numeric_limits<float>::infinity()), high(-low);
  for (std::size_t f = 0; f < frames.size(); ++f) {
    if (f > 0 && frames[f].pose == frames[f - 1].pose) continue;
    for (const glm::vec3& vertex : posed_vertices(body, frames[f].pose)) low = glm::min(low, vertex), high = glm::max(high, vertex);
  }
  std::vector<glm::vec3> corners;
  for (int i = 0; i < 8; ++i) corners.emplace_back(i & 1 ? high.x : low.x, i & 2 ? high.y : low.y, i & 4 ? high.z : low.z);
  return corners;
}

std::vector<Camera> chosen_cameras(const AnimateOptions& options, const ChosenMotion& motion, const Avatar& avatar, const std::vector<MotionFrame>& frames) {
  std::vector<Camera> cameras;
  if (!options.cameras.empty()) {
    cameras = read_cameras(options.cameras);
    if (cameras.size() != frames.size()) throw InputError(options.cameras.string(), "cameras", fmt::format("{}, one a picture", frames.size()), fmt::format("{}", cameras.size()));
  } else if (!options.camera.empty()) {
    cameras.assign(frames.size(), motion.capture->cameras[camera_index(*motion.capture, options.camera)]);
  } else {
    const std::vector<glm::vec3> corners = box_corners(avatar.body, frames);
    for (std::size_t f = 0; f < frames.size(); ++f) {
      const double turned = options.turntable ? 360.0 * options.turns * double(f) / double(frames.size()) : 0.0;
      cameras.push_back(orbit_camera(corners, motion.up, options.orbit + turned, options.size > 0 ? options.size : kCirclingSize));
    }
  }
  for (Camera& camera : cameras) {
    if (options.size > 0 && camera.width != options.size) camera = camera.scaled(options.size);
    if (camera.width != cameras[0].width || camera.height != cameras[0].height)
      throw InputError(options.cameras.string(), camera.name, fmt::format("{} x {} pixels, as the first camera", cameras[0].width, cameras[0].height), fmt::format("{} x {}", camera.width, camera.height));
  }
  return cameras;
}

int animate(const AnimateOptions& options) {
  if (!options.camera.empty() && options.motion.capture.empty()) throw InputError("--camera", "", "--capture with it", "none");
  if (options.motion.rests() && !options.turntable)
    throw InputError("arah animate", "", "a motion (--capture or --motion), or --turntable around the pose at rest", "neither");
  if (options.frame && options.motion.rests()) throw InputError("--frame", "", "--capture or --motion with it", "neither");
  const std::string end = options.out.extension().string();
  if (!options.video() && !end.empty() && !fs::is_directory(options.out)) throw InputError(options.out.string(), "", "a name that ends in .mp4, or a folder for PNGs", "'" + end + "'");
  const Avatar avatar = load_avatar(avatar_file(options.avatar));
  const ChosenMotion motion = chosen_motion(options.motion, avatar);
  const std::vector<MotionFrame> frames = chosen_frames(options, motion);
  const std::vector<Camera> cameras = chosen_cameras(options, motion, avatar, frames);
  Animation animation{{}, options.quality.settings(avatar), options.beside == "normals"};
  for (std::size_t f = 0; f < frames.size(); ++f) animation.frames.push_back({frames[f].pose, cameras[f], latent_row_of(motion, avatar, frames[f].number)});

  fs::path working = options.out;
  if (options.video()) working += ".frames";
  const Ranks& ranks = Ranks::of_process();
  ranks.agree({{"version", kVersion}, {"pictures", working.string()}});
  if (!ranks.first()) ranks.wait_for_all();  // the first one makes the folder, the others find in it what they would write
  std::size_t bad_pictures = 0;
  const AnimationFolder folder(working, avatar, animation);
  if (ranks.first()) ranks.wait_for_all();
  if (!ranks.first()) {
    Device device(device_of_rank(options.device, ranks));
    unequal_devices(ranks, device);
    const Interrupt interrupt;
    animation.on_bad_pixels = [&](const fs::path& picture, const BadPixels& bad) {
      if (++bad_pictures <= kNamedBadPictures) fmt::print(stderr, "{}\n", warning_of(bad, picture.string(), options.avatar.string()));
    };
    return folder.render(device, avatar, [&](double) { return !interrupt.wanted(); }, ranks) ? 0 : kFailed;
  }
  const std::size_t before = folder.done();
  Progress progress("animate", double(frames.size()), "frames", double(before));
  if (before > 0) progress.say(fmt::format("{}: {} of {} frames are there", working.string(), before, frames.size()));
  if (before < frames.size() || ranks.count() > 1) {
    Device device(device_of_rank(options.device, ranks));
    if (const std::string unequal = unequal_devices(ranks, device); !unequal.empty()) progress.say(unequal);
    const Interrupt interrupt;
    animation.on_bad_pixels = [&](const fs::path& picture, const BadPixels& bad) {
      if (++bad_pictures <= kNamedBadPictures) progress.say(warning_of(bad, picture.string(), options.avatar.string()));
    };
    const bool whole = folder.render(device, avatar, [&](double done) {
      progress.update(done);
      return !interrupt.wanted();
    }, ranks);
    if (!whole) throw std::runtime_error(fmt::format("stopped after {} of {} frames; the same call goes on", folder.done(), frames.size()));
    progress.say(shaders_text(device));
    if (bad_pictures > kNamedBadPictures) progress.say(fmt::format("warning: {} pictures with pixels that are not finite, of which {} are named above", bad_pictures, kNamedBadPictures));
  }
  if (!options.video()) {
    progress.finish(working.string());
    return 0;
  }
  const double fps = rate_of(motion, options.fps, options.every, options.frame.has_value());
  const std::string codec = write_video(options.out, folder.pictures(), fps, background_color(options.background));
  if (!options.keep) folder.remove();
  progress.finish(fmt::format("{}  {}, {:g} frames a second, {:.2g} s", options.out.string(), codec, fps, double(frames.size()) / fps));
  return 0;
}

}  // namespace

void add_animate_command(CLI::App& program, Run& run) {
  const auto options = std::make_shared<AnimateOptions>();
  CLI::App* command = program.add_subcommand("animate", "A motion as a video, or as a folder of pictures");
  command->add_option("AVATAR", options->avatar, kAvatarHelp)->required();
  command->add_option("-o,--out", options->out, "a video (.mp4: H.264, or MPEG-4 part 2 where OpenCV's FFmpeg lacks that), or a folder for PNGs with alpha")->required();
  add_motion_options(*command, options->motion);
  CLI::Option* frame = command->add_option("--frame", options->frame, "number of one frame of the motion, for a turntable");
  command->add_option("--every", options->every, "take every so-many-th frame of the motion")->check(CLI::Range(1, 1000000))->capture_default_str()->excludes(frame);
  command->add_option("--count", options->count, fmt::format("pictures, at most (default: the motion's frames; {} of a turntable around one pose)", kTurn))->check(CLI::Range(1, 1000000));
  CLI::Option* camera = command->add_option("--camera", options->camera, "of the capture; without it the camera stands so that it sees the whole motion");
  CLI::Option* cameras = command->add_option("--cameras", options->cameras, "a path for the camera: a cameras.json with one camera a picture, in order")->check(CLI::ExistingFile)->excludes(camera);
  CLI::Option* turntable = command->add_flag("--turntable", options->turntable, "the camera circles the person")->excludes(camera)->excludes(cameras);
  command->add_option("--turns", options->turns, "of the turntable, from the first picture to the last; negative: clockwise seen from above")->check(CLI::Range(-1000.0, 1000.0))->capture_default_str()->needs(turntable);
  command->add_option("--orbit", options->orbit, "place of the camera, or where the turntable begins, degrees; 0 is in front of a person at rest")->check(CLI::Range(-1e6, 1e6))->capture_default_str()->excludes(camera)->excludes(cameras);
  command->add_option("--size", options->size, fmt::format("columns of a picture (default: the camera's; {} without one)", kCirclingSize))->check(CLI::Range(1, 8192));
  command->add_option("--beside", options->beside, "normals: a second picture right of the colour (world axes, n/2 + 1/2)")->check(CLI::IsMember({"normals"}));
  add_rate_option(*command, options->fps, "pictures a second of the video");
  command->add_option("--background", options->background, "of the video: white, grey or black; PNGs have alpha instead")->check(CLI::IsMember({"white", "grey", "black"}))->capture_default_str();
  command->add_flag("--keep-frames", options->keep, "keep OUT.mp4.frames, the folder of PNGs that the video is made of");
  add_quality_options(*command, options->quality);
  add_device_option(*command, options->device);
  add_memory_option(*command, options->device);
  command->footer(
      "Ctrl-C stops (exit code 1); the same call goes on with the frame after the last one that is there.\n"
      "Example: arah animate run -o dance.mp4 --capture capture --split novel --turntable --beside normals\n"
      "         arah animate run -o turn.mp4 --turntable --quality balanced\n"
      "         mpirun -n 4 arah animate run -o dance.mp4 --capture capture   (each frame on the rank that is free)");
  command->callback([options, &run] { run = [options] { return animate(*options); }; });
}

}  // namespace arah
