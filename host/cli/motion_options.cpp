#include "host/cli/motion_options.h"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <glm/matrix.hpp>

#include "host/input_error.h"

namespace arah {
namespace {

constexpr double kUnknownRate = 25;  // frames a second

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

}  // namespace

void add_motion_options(CLI::App& command, MotionOptions& options) {
  CLI::Option* capture = command.add_option("--capture", options.capture, "take poses of this capture's frames");
  command.add_option("--split", options.split, "of the capture: train, novel, ...")->capture_default_str()->needs(capture);
  command.add_option("--motion", options.motion, "take the poses of this motion_<split>.json")->excludes(capture);
}

ChosenMotion chosen_motion(const MotionOptions& options, const Avatar& avatar) {
  ChosenMotion chosen;
  const Skeleton& skeleton = avatar.body.skeleton;
  if (!options.capture.empty()) {
    chosen.capture = open_capture(options.capture);
    chosen.where = fmt::format("{}: split {}", options.capture.string(), options.split);
    chosen.trained = options.split == "train";
    const Motion& motion = motion_of(*chosen.capture, options.split);
    chosen.frames_per_second = motion.frames_per_second;
    chosen.frames = adapt_motion(motion, skeleton, options.capture.string()).frames;
    for (MotionFrame& frame : chosen.frames) frame.pose = Pose(pose_to_render(avatar.refined, options.split, frame));
  } else if (!options.motion.empty()) {
    chosen.where = options.motion.string();
    const Motion motion = read_motion(options.motion);
    chosen.frames_per_second = motion.frames_per_second;
    chosen.frames = adapt_motion(motion, skeleton, chosen.where).frames;
  } else {
    const bool still = avatar.spec.skinning.kind == Skinning::none;
    chosen.where = "the pose at rest";
    chosen.frames.push_back({0, still ? pose_of(avatar.canonical, skeleton) : rest_pose(skeleton), ""});
    if (!still) chosen.up = UpAxis::y;
  }
  return chosen;
}

const MotionFrame& frame_of(const ChosenMotion& motion, int number) {
  for (const MotionFrame& frame : motion.frames)
    if (frame.number == number) return frame;
  throw InputError(motion.where, "frame",
                   fmt::format("one of {} frames, {} to {}", motion.frames.size(), motion.frames.front().number, motion.frames.back().number),
                   fmt::format("{}", number));
}

void add_rate_option(CLI::App& command, std::optional<double>& rate, const std::string& what) {
  command.add_option("--fps", rate, fmt::format("{} (default: the motion's own frames a second, divided by --every; {:g} where it states none)", what, kUnknownRate))->check(CLI::Range(0.1, 1000.0));
}

double rate_of(const ChosenMotion& motion, const std::optional<double>& stated, int every, bool single) {
  if (stated) return *stated;
  return motion.frames_per_second > 0 && motion.frames.size() > 1 && !single ? motion.frames_per_second / every : kUnknownRate;
}

std::size_t latent_row_of(const ChosenMotion& motion, const Avatar& avatar, int number) {
  return avatar.spec.latent_size > 0 ? latent_row(avatar, motion.trained ? number : -1) : 0;
}

}  // namespace arah
